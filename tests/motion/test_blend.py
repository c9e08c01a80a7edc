import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from gesturegen.motion import blend, rotation
from gesturegen.settings.models import Blend
from tests.builders import SMALL, random_quaternions

CURVES = ("linear", "sigmoid", "smoothstep")
HOW = ("slerp", "expmap")


def step(left, right, before, after):
    """A held left pose, then a held right one: headings in radians, positions equal to them along X."""
    angles = np.repeat([left, right], [before, after]).astype(float)
    positions = np.zeros((before + after, 1, 3))
    positions[:, 0, 0] = angles
    return rotation.about_y(angles)[:, None], positions


def headings(rotations):
    return rotation.heading(rotations[:, 0])


def test_linear_weights_are_even():
    np.testing.assert_allclose(blend.weights(4, "linear"), [0.2, 0.4, 0.6, 0.8])


def test_smoothstep_weights_follow_its_polynomial():
    np.testing.assert_allclose(blend.weights(3, "smoothstep"), [0.15625, 0.5, 0.84375])


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("count", (0, 1, 2, 7, 16))
def test_weights_rise_inside_0_and_1_and_mirror(curve, count):
    found = blend.weights(count, curve)
    assert found.shape == (count,)
    assert (found > 0).all() and (found < 1).all() and (np.diff(found) > 0).all()
    np.testing.assert_allclose(found + found[::-1], 1.0)


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("curve", CURVES)
def test_crossfade_of_held_poses_is_the_weights(how, curve):
    rotations, positions = step(0.0, 1.0, 10, 10)
    blend.crossfade(rotations, positions, 10, 20, Blend(l_blend=3, curve=curve, rotations=how))
    expected = np.concatenate([np.zeros(7), blend.weights(6, curve), np.ones(7)])
    np.testing.assert_allclose(headings(rotations), expected, atol=1e-12)
    np.testing.assert_allclose(positions[:, 0, 0], expected, atol=1e-12)


def test_crossfade_holds_the_left_at_its_last_and_the_right_at_its_first_frame():
    positions = np.arange(8.0)[:, None, None] * np.array([[[1.0, 0.0, 0.0]]])
    positions[4:] += 100.0
    rotations = rotation.about_y(positions[..., 0] / 100)
    before = positions.copy()
    blend.crossfade(rotations, positions, 4, 8, Blend(l_blend=2))
    expected = before[:, 0, 0].copy()
    for frame, weight in zip(range(2, 6), (0.2, 0.4, 0.6, 0.8), strict=True):
        left, right = before[min(frame, 3), 0, 0], before[max(frame, 4), 0, 0]
        expected[frame] = (1 - weight) * left + weight * right
    np.testing.assert_allclose(positions[:, 0, 0], expected)
    np.testing.assert_allclose(headings(rotations), expected / 100)


def test_short_sides_shorten_the_blend():
    rotations, positions = step(0.0, 1.0, 1, 12)
    blend.crossfade(rotations, positions, 1, 3, Blend(l_blend=8))
    expected = np.concatenate([[0.25, 0.5, 0.75], np.ones(10)])
    np.testing.assert_allclose(positions[:, 0, 0], expected)
    np.testing.assert_allclose(headings(rotations), expected)


@pytest.mark.parametrize("how", HOW)
def test_no_blend_frames_change_nothing(how):
    rotations, positions = step(0.0, 1.0, 4, 4)
    before = rotations.copy(), positions.copy()
    blend.crossfade(rotations, positions, 4, 8, Blend(l_blend=0, rotations=how))
    np.testing.assert_array_equal(rotations, before[0])
    np.testing.assert_array_equal(positions, before[1])


@SMALL
@given(st.integers(0, 10**6), st.sampled_from(HOW), st.sampled_from(CURVES), st.integers(0, 9))
def test_crossfade_keeps_unit_length_and_frames_outside(seed, how, curve, length):
    rng = np.random.default_rng(seed)
    rotations, positions = random_quaternions(rng, 20, 3), rng.normal(size=(20, 3, 3))
    before = rotations.copy(), positions.copy()
    blend.crossfade(rotations, positions, 9, 16, Blend(l_blend=length, rotations=how, curve=curve))
    np.testing.assert_allclose(np.linalg.norm(rotations, axis=-1), 1.0, atol=1e-12)
    outside = np.r_[0 : 9 - length, min(9 + length, 16) : 20]
    np.testing.assert_array_equal(rotations[outside], before[0][outside])
    np.testing.assert_array_equal(positions[outside], before[1][outside])


@pytest.mark.parametrize("how", HOW)
def test_mixing_ends_at_its_sides(how):
    rng = np.random.default_rng(0)
    left, right = random_quaternions(rng, 5), random_quaternions(rng, 5)
    for amount, side in ((0.0, left), (1.0, right)):
        mixed = blend.mix_rotations(left, right, np.full(5, amount), how)
        np.testing.assert_allclose(rotation.to_matrix(mixed), rotation.to_matrix(side), atol=1e-9)


@pytest.mark.parametrize("how", HOW)
def test_mixing_goes_the_short_way_across_pi(how):
    left, right = rotation.about_y(np.radians([170.0])), rotation.about_y(np.radians([-150.0]))
    mixed = blend.mix_rotations(left, right, np.array([0.25]), how)
    np.testing.assert_allclose(rotation.angle_between(mixed, rotation.about_y(np.pi)), 0.0, atol=1e-9)


def test_expmap_mixing_is_the_weighted_map():
    left, right = np.array([[0.2, -0.5, 0.9]]), np.array([[0.8, 0.3, -0.1]])
    mixed = blend.mix_rotations(rotation.from_expmap(left), rotation.from_expmap(right), np.array([0.3]), "expmap")
    np.testing.assert_allclose(rotation.to_expmap(mixed), 0.7 * left + 0.3 * right, atol=1e-12)


@pytest.mark.parametrize("how", HOW)
def test_mixing_from_the_rest_pose_is_finite(how):
    rest, turned = rotation.IDENTITY[None], rotation.about_y(np.array([1.0]))
    assert rotation.heading(blend.mix_rotations(rest, turned, np.array([0.5]), how)) == pytest.approx(0.5)
    assert rotation.heading(blend.mix_rotations(turned, rest, np.array([0.5]), how)) == pytest.approx(0.5)


# --- inertialization ----------------------------------------------------------------------------------------


def test_spring_starts_at_the_offset_with_its_velocity():
    offset, velocity = np.array([2.0, -1.0]), np.array([3.0, 0.5])
    small = 1e-6
    start, soon = blend.spring_decay(offset, velocity, np.array([0.0, small]), 0.1)
    np.testing.assert_array_equal(start, offset)
    np.testing.assert_allclose((soon - start) / small, velocity, atol=1e-3)


def test_spring_is_critically_damped():
    half_life, dt = 0.2, 1e-4
    rate = 2 * np.log(2) / half_life
    times = np.arange(0, 1, dt)
    x = blend.spring_decay(np.array([1.5]), np.array([-4.0]), times, half_life)[:, 0]
    speed, force = np.gradient(x, dt)[5:-5], np.gradient(np.gradient(x, dt), dt)[5:-5]
    np.testing.assert_allclose(force, -2 * rate * speed - rate**2 * x[5:-5], atol=0.05)


def test_spring_comes_to_rest():
    decayed = blend.spring_decay(np.array([100.0]), np.array([-50.0]), np.array([2.0]), 0.1)
    assert abs(decayed[0, 0]) < 1e-6


def test_spring_shapes():
    offset = np.ones((4, 3))
    assert blend.spring_decay(offset, 0 * offset, np.arange(5.0), 0.1).shape == (5, 4, 3)


# --- corrections of least jerk ------------------------------------------------------------------------------

REACH = 2.4


def flags(count, *frames):
    """bool `[shape=(count,)]`, True at the frames."""
    jumps = np.zeros(count, dtype=bool)
    jumps[list(frames)] = True
    return jumps


def still(count):
    return np.tile(rotation.IDENTITY, (count, 1, 1))


def smoothed(values, jumps, reach=REACH):
    """Positions `[shape=(T,)]` along X after the correction."""
    positions = np.zeros((len(values), 1, 3))
    positions[:, 0, 0] = values
    return blend.least_jerk(still(len(values)), positions, jumps, reach)[1][:, 0, 0]


def dense(values, jumps, reach):
    """The values `[shape=(T, K)]` with the correction of the least squares written out in full."""
    count = len(values)
    third = np.diff(np.eye(count), 3, axis=0)
    wanted = np.zeros((count - 3, values.shape[1]))
    for row in range(count - 3):
        if jumps[row + 1] or jumps[row + 2] or jumps[row + 3]:
            wanted[row] = -third[row] @ values
    system = np.concatenate([third, reach**-3.0 * np.eye(count)])
    sides = np.concatenate([wanted, np.zeros_like(values)])
    return values + np.linalg.lstsq(system, sides, rcond=None)[0]


@SMALL
@given(st.integers(0, 10**6), st.integers(4, 40), st.floats(0.5, 12.0), st.floats(0.02, 0.7))
def test_least_jerk_of_positions_is_the_least_squares_solution(seed, count, reach, share):
    rng = np.random.default_rng(seed)
    positions, jumps = rng.normal(size=(count, 3, 3)).cumsum(axis=0), rng.random(count) < share
    _, moved = blend.least_jerk(random_quaternions(rng, count, 3), positions, jumps, reach)
    expected = dense(positions.reshape(count, 9), jumps, reach).reshape(count, 3, 3) if jumps.any() else positions
    np.testing.assert_allclose(moved, expected, atol=1e-7)


@SMALL
@given(st.integers(0, 10**6), st.integers(4, 40), st.floats(0.5, 6.0))
def test_least_jerk_of_turns_about_one_axis_is_the_least_squares_solution(seed, count, reach):
    # Such turns add up, so that one round finds all and the others nothing more.
    rng = np.random.default_rng(seed)
    angles, jumps = 0.1 * rng.normal(size=count).cumsum(), flags(count, int(rng.integers(1, count)))
    turned, _ = blend.least_jerk(rotation.about_y(angles)[:, None], np.zeros((count, 1, 3)), jumps, reach)
    np.testing.assert_allclose(headings(turned), dense(angles[:, None], jumps, reach)[:, 0], atol=1e-8)


@pytest.mark.parametrize(("count", "jumps"), [(20, ()), (3, (1,)), (2, (1,)), (1, (0,)), (1, ())])
def test_least_jerk_leaves_motion_without_jumps_or_of_few_frames(count, jumps):
    rng = np.random.default_rng(2)
    rotations, positions = random_quaternions(rng, count, 2), rng.normal(size=(count, 2, 3))
    turned, moved = blend.least_jerk(rotations, positions, flags(count, *jumps), REACH)
    np.testing.assert_array_equal(turned, rotations)
    np.testing.assert_array_equal(moved, positions)


def test_least_jerk_leaves_its_inputs_alone():
    rng = np.random.default_rng(3)
    rotations, positions, jumps = random_quaternions(rng, 20, 2), rng.normal(size=(20, 2, 3)), flags(20, 9)
    before = rotations.copy(), positions.copy(), jumps.copy()
    for marked in (jumps, flags(20)):
        turned, moved = blend.least_jerk(rotations, positions, marked, REACH)
        turned[:], moved[:] = 7.0, 7.0
    for now, then in zip((rotations, positions, jumps), before, strict=True):
        np.testing.assert_array_equal(now, then)


@pytest.mark.parametrize("reach", (1.5, 2.4, 6.0))
def test_least_jerk_makes_a_step_smooth_on_both_sides(reach):
    rotations, positions = step(0.0, 1.0, 60, 60)
    turned, moved = blend.least_jerk(rotations, positions, flags(120, 60), reach)
    for found in (moved[:, 0, 0], headings(turned)):
        # The third differences of the bare step are 1, -2, 1.
        assert np.abs(np.diff(found, 3)).max() < 2.0 * {1.5: 0.03, 2.4: 0.007, 6.0: 0.0004}[reach]
        np.testing.assert_allclose(found + found[::-1], 1.0, atol=1e-8)
        # The slowest part of the correction falls by e every two reaches.
        far = np.where(np.arange(120) < 60, 60 - np.arange(120), np.arange(120) - 59)
        assert (np.abs(found - (np.arange(120) >= 60)) <= np.exp(-far / (2.0 * reach)) + 1e-8).all()


def test_least_jerk_keeps_what_goes_on_evenly():
    # Of constant velocity, and of constant acceleration: no third difference to take out at the jump.
    frames = np.arange(30.0)
    for curve in (0.3 * frames, 0.3 * frames - 0.01 * frames**2):
        np.testing.assert_allclose(smoothed(curve, flags(30, 12)), curve, atol=1e-10)
    spinning = rotation.from_expmap(frames[:, None, None] * [0.06, -0.02, 0.03])
    turned, _ = blend.least_jerk(spinning, np.zeros((30, 1, 3)), flags(30, 12), REACH)
    assert rotation.angle_between(turned, spinning).max() < 1e-10


def test_least_jerk_leaves_joints_that_do_not_jump():
    frames = np.arange(40)
    positions = np.zeros((40, 3, 3))
    positions[20:, 0] = [5.0, -3.0, 2.0]
    positions[:, 2, 1] = 0.01 * frames**2
    rotations = np.tile(random_quaternions(np.random.default_rng(4), 3), (40, 1, 1))
    rotations[20:, 0] = rotation.IDENTITY
    turned, moved = blend.least_jerk(rotations, positions, flags(40, 20), REACH)
    np.testing.assert_array_equal(moved[:, 1], positions[:, 1])
    np.testing.assert_allclose(moved[:, 2], positions[:, 2], atol=1e-10)
    np.testing.assert_allclose(turned[:, 1:], rotations[:, 1:], atol=1e-13)
    assert np.abs(moved[:, 0] - positions[:, 0]).max() > 0.5


@pytest.mark.parametrize("degrees", (5.0, 30.0, 60.0, 90.0))
@SMALL
@given(st.integers(0, 10**6))
def test_least_jerk_spreads_a_rotation_jump(degrees, seed):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    left = random_quaternions(rng)
    right = rotation.multiply(rotation.from_expmap(np.radians(degrees) * axis / np.linalg.norm(axis)), left)
    rotations = np.repeat([left, right], 25, axis=0)[:, None]
    turned, _ = blend.least_jerk(rotations, np.zeros((50, 1, 3)), flags(50, 25), REACH)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=-1), 1.0, atol=1e-12)
    assert np.degrees(rotation.angle_between(turned[1:], turned[:-1])).max() < 0.15 * degrees


def smooth_rotations(rng, count, joints):
    """Rotations whose random steps are smooth over some ten frames."""
    maps = gaussian_filter1d(rng.normal(size=(count, joints, 3)), 5.0, axis=0)
    return rotation.from_expmap(1.5 * maps)


def second_steps(rotations):
    """Third differences of rotations: the second ones of the steps from frame to frame `[shape=(T - 3, J, 3)]`."""
    return np.diff(rotation.to_expmap(rotation.multiply(rotations[1:], rotation.inverse(rotations[:-1]))), 2, axis=0)


@SMALL
@given(st.integers(0, 10**6))
def test_least_jerk_keeps_the_jerk_that_was_recorded(seed):
    rng = np.random.default_rng(seed)
    rotations = smooth_rotations(rng, 120, 2)
    jump = rotation.from_expmap(0.6 * np.array([[0.8, 0.0, -0.6], [0.0, 1.0, 0.0]]))
    rotations[60:] = rotation.multiply(jump, rotations[60:])
    turned, _ = blend.least_jerk(rotations, np.zeros((120, 2, 3)), flags(120, 60), REACH)
    kept, jumped = np.abs(second_steps(turned) - second_steps(rotations)).max(axis=(1, 2)), slice(57, 60)
    assert np.abs(second_steps(rotations)[jumped]).max() > 0.5
    assert np.abs(second_steps(turned)[jumped]).max() < 0.02
    # Next to the jump, of 0.6, up to a sixtieth of it per frame^3; thirty frames off nothing to speak of.
    assert np.delete(kept, np.r_[jumped]).max() < 0.01
    assert kept[np.r_[:27, 90:117]].max() < 1e-4


@SMALL
@given(st.integers(0, 10**6), st.lists(st.integers(0, 59), min_size=1, max_size=12))
def test_least_jerk_of_several_jumps_is_smoother_and_finite(seed, frames):
    rng = np.random.default_rng(seed)
    rotations, positions = smooth_rotations(rng, 60, 3), np.zeros((60, 3, 3))
    positions[:, 0] = gaussian_filter1d(rng.normal(size=(60, 3)), 5.0, axis=0)
    for frame in frames:
        rotations[frame:] = rotation.multiply(rotation.from_expmap(0.4 * rng.normal(size=(3, 3))), rotations[frame:])
        positions[frame:, 0] += rng.normal(size=3)
    turned, moved = blend.least_jerk(rotations, positions, flags(60, *frames), REACH)
    assert np.isfinite(turned).all() and np.isfinite(moved).all()
    np.testing.assert_allclose(np.linalg.norm(turned, axis=-1), 1.0, atol=1e-12)
    jumps = [frame for frame in frames if frame > 0]
    if jumps:
        assert (
            np.square(np.diff(moved[:, 0], 3, axis=0)).sum()
            < 0.5 * np.square(np.diff(positions[:, 0], 3, axis=0)).sum()
        )
        assert np.square(second_steps(turned)).sum() < 0.5 * np.square(second_steps(rotations)).sum()


def test_overlapping_corrections_of_positions_add_up():
    curve = np.repeat([0.0, 3.0, -2.0], [20, 4, 20])
    first, second = np.repeat([0.0, 3.0], [20, 24]), np.repeat([0.0, -5.0], [24, 20])
    both = smoothed(curve, flags(44, 20, 24))
    one, other = (smoothed(part, flags(44, 20, 24)) for part in (first, second))
    np.testing.assert_allclose(both, one + other, atol=1e-10)
    np.testing.assert_allclose(one, smoothed(first, flags(44, 20)), atol=1e-10)


@pytest.mark.parametrize("reach", (0.1, 60.0, 300.0, 3000.0))
def test_least_jerk_takes_any_reach(reach):
    # Of 100 s at 30 frames per second, and of a fraction of a frame.
    curve = np.repeat([0.0, 1.0], 200)
    found = smoothed(curve, flags(400, 200), reach)
    assert np.isfinite(found).all() and np.abs(found).max() < 2.0

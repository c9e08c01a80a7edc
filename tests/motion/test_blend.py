import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gesturegen.config import Blend
from gesturegen.motion import blend, rotation
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

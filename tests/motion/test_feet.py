"""Contacts, legs and locked feet, on a figure whose legs are bent by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from gesturegen.metrics.feet import foot_skate
from gesturegen.motion import feet, kinematics, rotation
from gesturegen.motion.skeleton import Motion
from gesturegen.settings.models import Feet
from tests.builders import chain, make_skeleton, random_quaternions

# GENEA's names and its twist joint; the toe is below what is locked, the arm has nothing to do with it.
LEG = ("upleg", "leg", "foot_twist", "foot", "toe")
NAMES = ("body_world", "b_root", "b_spine0", "b_r_arm", *(f"b_{side}_{part}" for side in "lr" for part in LEG))
PARENTS = (-1, 0, 1, 2, 1, 4, 5, 6, 7, 1, 9, 10, 11, 12)
OFFSETS = [
    (0, 0, 0), (0, 90, 0), (0, 20, 0), (-20, 20, 0),
    (9, -4, 0), (0, -40, 0), (0, -42, 0), (0, 0, 0), (0, -5, 12),
    (-9, -4, 0), (0, -40, 0), (0, -42, 0), (0, 0, 0), (0, -5, 12),
]  # fmt: skip
PELVIS, FEET, LEGS = 1, [7, 12], [4, 5, 6, 9, 10, 11]
LOCK = Feet(lock=True)
FEW = settings(deadline=None, derandomize=True, max_examples=8)


def bones():
    return make_skeleton(NAMES, PARENTS, OFFSETS)


def figure(places, bend=0.35, headings=0.0):
    """A figure that stands with bent knees, its root at `places` `[shape=(T, 2)]` over the floor.

    bend : of each knee in radians, `[shape=(T, 2)]` or one for all; headings : of the body, radians
    """
    count = len(places)
    skeleton = bones()
    positions = np.tile(skeleton.offsets, (count, 1, 1))
    positions[:, 0, [0, 2]] = places
    rotations = np.tile(rotation.IDENTITY, (count, len(NAMES), 1))
    rotations[:, 0] = rotation.about_y(np.broadcast_to(headings, count))
    bend = np.broadcast_to(bend, (count, 2))
    for side, (hip, knee, ankle) in enumerate(((4, 5, 6), (9, 10, 11))):
        for joint, share in ((hip, -0.5), (knee, 1.0), (ankle, -0.5)):
            rotations[:, joint] = rotation.from_expmap(share * bend[:, side, None] * [1.0, 0.0, 0.0])
    return Motion(skeleton, rotations, positions, 30.0)


def slide(count, way, start=10, end=None):
    """Places that go from nothing to `way` (x, z) in cm between two frames."""
    end = count - 10 if end is None else end
    return np.clip((np.arange(count) - start) / (end - start), 0, 1)[:, None] * np.array(way)


def locked(motion, recorded, chosen=LOCK, bearing=None, jumps=None):
    count = motion.n_frames
    bearing = np.ones((count, 2), dtype=bool) if bearing is None else bearing
    jumps = np.zeros(count, dtype=bool) if jumps is None else jumps
    return feet.lock(motion, recorded, bearing, jumps, PELVIS, chosen)


def ankles(motion):
    return kinematics.joint_positions(motion, FEET)


def drift(motion):
    """How far each foot is over the floor from where it was at first, cm `[shape=(T, F)]`."""
    places = ankles(motion)[..., [0, 2]]
    return np.linalg.norm(places - places[0], axis=-1)


# --- contacts -----------------------------------------------------------------------------------------------


def test_contacts_are_near_each_foots_own_floor():
    positions = np.zeros((5, 2, 3))
    positions[:, 0, 1] = [10.0, 10.0, 12.5, 12.6, 40.0]
    positions[:, 1, 1] = [0.0, 3.0, 0.0, 2.0, 1.0]
    found = feet.contacts(positions, floor_percentile=0)
    assert found[:, 0].tolist() == [True, True, True, False, False]
    assert found[:, 1].tolist() == [True, False, True, True, True]
    # The median of the first is 12.5, of the second 1.
    assert feet.contacts(positions, height=0.1, floor_percentile=50)[:, 0].tolist() == [True, True, True, True, False]
    assert feet.contacts(positions, height=0.0, floor_percentile=50)[:, 1].tolist() == [True, False, True, False, True]


def test_contacts_of_nothing():
    assert feet.contacts(np.empty((0, 2, 3))).shape == (0, 2)
    assert feet.contacts(np.empty((4, 0, 3))).shape == (4, 0)
    assert feet.contacts(np.ones((1, 2, 3))).tolist() == [[True, True]]


# --- legs ---------------------------------------------------------------------------------------------------


def test_the_leg_of_a_genea_foot_passes_its_twist_joint():
    assert feet.leg_of(bones(), 7) == feet.leg_of(bones(), 6) == feet.Leg(4, 5, 6)
    assert feet.leg_of(bones(), 12) == feet.Leg(9, 10, 11)


def test_the_names_of_the_joints_do_not_matter():
    names = ("Hips", "LeftUpLeg", "LeftLeg", "LeftFoot")
    assert feet.leg_of(make_skeleton(names, (-1, 0, 1, 2)), 3) == feet.Leg(1, 2, 3)


def test_twist_joints_at_every_place_of_the_leg_count_as_one():
    offsets = [(0, 90, 0), (9, 0, 0), (0, 0, 0), (0, -40, 0), (0, 0, 5e-4), (0, -42, 0), (0, 0, 0), (0, 0, 0)]
    assert feet.leg_of(chain(8, offsets=offsets), 7) == feet.Leg(1, 3, 5)


@pytest.mark.parametrize("joint", (0, 1, 2))
def test_a_foot_without_two_bones_and_a_body_above_has_no_leg(joint):
    assert feet.leg_of(chain(4), joint) is None


def test_a_foot_at_the_place_of_the_root_has_no_leg():
    assert feet.leg_of(make_skeleton(("a", "b"), (-1, 0), [(0, 0, 0), (0, 0, 0)]), 1) is None


# --- what stays ---------------------------------------------------------------------------------------------


def swaying(seed, count=120, turning=0.3):
    """Two figures: one that sways over the floor and turns, and one that was recorded doing something like it."""
    rng = np.random.default_rng(seed)
    places, recorded = 60.0 * gaussian_filter1d(rng.normal(size=(2, count, 2)), 12.0, axis=1)
    headings = turning * 5.0 * gaussian_filter1d(rng.normal(size=(2, count)), 12.0, axis=1)
    bend = 0.5 + gaussian_filter1d(rng.normal(size=(count, 2)), 8.0, axis=0)
    return figure(places, bend, headings[0]), figure(0.05 * recorded, bend, headings[1])


@FEW
@given(st.integers(0, 10**6))
def test_only_legs_turn_and_feet_keep_their_direction(seed):
    motion, recorded = swaying(seed)
    rng = np.random.default_rng(seed)
    bearing, jumps = rng.random((120, 2)) < 0.8, rng.random(120) < 0.05
    before = motion.rotations.copy(), motion.positions.copy()
    held = locked(motion, recorded, bearing=bearing, jumps=jumps)
    np.testing.assert_array_equal(motion.rotations, before[0])
    np.testing.assert_array_equal(held.positions, before[1])
    others = [joint for joint in range(len(NAMES)) if joint not in LEGS]
    np.testing.assert_array_equal(held.rotations[:, others], before[0][:, others])
    np.testing.assert_allclose(np.linalg.norm(held.rotations, axis=-1), 1.0, atol=1e-12)
    turned, _ = kinematics.world_transforms(held, [*FEET, 8, 13])
    kept, _ = kinematics.world_transforms(motion, [*FEET, 8, 13])
    assert rotation.angle_between(turned, kept).max() < 1e-7
    # The legs have something to do here.
    assert rotation.angle_between(held.rotations[:, LEGS], motion.rotations[:, LEGS]).max() > 0.05
    assert held.skeleton is motion.skeleton and held.fps == motion.fps


@FEW
@given(st.integers(0, 10**6))
def test_a_motion_just_as_it_was_recorded_stays(seed):
    motion, _ = swaying(seed)
    bearing = feet.contacts(ankles(motion))
    # A leg is never stretched quite straight, which is 0.0001 of its 82 cm.
    np.testing.assert_allclose(ankles(locked(motion, motion, bearing=bearing)), ankles(motion), atol=0.009)


@FEW
@given(st.integers(0, 10**6), st.floats(-3.0, 3.0))
def test_a_motion_turned_as_a_whole_stays(seed, turn):
    # Standing elsewhere and facing elsewhere, the feet still do what they did in the recording.
    recorded, _ = swaying(seed)
    turned = rotation.multiply(rotation.about_y(turn), recorded.rotations[:, 0])
    positions = recorded.positions.copy()
    positions[:, 0] = rotation.rotate(rotation.about_y(np.full(120, turn)), positions[:, 0])
    positions[:, 0] += [50.0, 0.0, -20.0]
    motion = replace(
        recorded, rotations=np.concatenate([turned[:, None], recorded.rotations[:, 1:]], 1), positions=positions
    )
    bearing = feet.contacts(ankles(motion))
    np.testing.assert_allclose(ankles(locked(motion, recorded, bearing=bearing)), ankles(motion), atol=0.009)


def test_a_skeleton_without_such_feet_or_legs_stays_the_same_object():
    motion, recorded = swaying(0)
    bearing, jumps = np.ones((120, 0), dtype=bool), np.zeros(120, dtype=bool)
    nobody = Feet(lock=True, joints=("left_foot", "right_foot"))
    assert feet.lock(motion, recorded, bearing, jumps, PELVIS, nobody) is motion
    short = Motion(chain(3), random_quaternions(np.random.default_rng(0), 9, 3), np.ones((9, 3, 3)), 30.0)
    chosen = Feet(lock=True, joints=("j2",))
    assert feet.lock(short, short, np.ones((9, 1), dtype=bool), np.zeros(9, dtype=bool), 0, chosen) is short


def test_a_motion_of_one_frame_stays_and_one_of_two_is_finite():
    motion = figure(np.array([[0.0, 0.0], [1.0, 0.0]]))
    one = motion.take(slice(0, 1))
    assert locked(one, one) is one
    assert np.isfinite(locked(motion, motion.take([0, 0])).rotations).all()


def test_one_foot_of_two_may_be_known():
    motion, recorded = figure(slide(60, (8.0, 0.0))), figure(np.zeros((60, 2)))
    chosen = Feet(lock=True, joints=("no_such_foot", "b_r_foot"))
    held = locked(motion, recorded, chosen, bearing=np.ones((60, 1), dtype=bool))
    assert drift(held)[:, 1].max() < 0.3 and drift(held)[-1, 0] == pytest.approx(8.0)


# --- held feet ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", [(10.0, 0.0), (-10.0, 0.0), (0.0, 10.0), (6.0, -8.0)])
@pytest.mark.parametrize("heading", (0.0, 2.0))
def test_feet_stay_in_place_under_a_body_that_slides(way, heading):
    recorded, motion = (figure(places, headings=heading) for places in (np.zeros((90, 2)), slide(90, way)))
    held = locked(motion, recorded)
    assert drift(motion)[-1] == pytest.approx(10.0)
    assert drift(held).max() < 0.3
    # Legs are stretched ever more slowly: feet hang a little.
    np.testing.assert_allclose(ankles(held)[..., 1], ankles(motion)[..., 1], atol=0.2)
    pelvis = kinematics.joint_positions(held, [PELVIS])[:, 0]
    np.testing.assert_allclose(pelvis[-1, [0, 2]] - pelvis[0, [0, 2]], way, atol=1e-12)


def test_feet_slide_as_they_did_in_the_recording():
    recorded, motion = figure(slide(90, (0.0, 6.0))), figure(slide(90, (8.0, 6.0)))
    moved = ankles(locked(motion, recorded))
    np.testing.assert_allclose(moved[-1] - moved[0], [[0.0, 0.0, 6.0]] * 2, atol=0.3)


def test_a_foot_that_bore_no_weight_in_the_recording_is_held_as_well():
    # Near the floor now, but not when it was recorded: it does not go the recorded way, but none.
    recorded, motion = figure(slide(90, (0.0, 6.0))), figure(slide(90, (8.0, 6.0)))
    bearing = np.tile([False, True], (90, 1))
    moved = ankles(locked(motion, recorded, bearing=bearing))
    np.testing.assert_allclose(moved[-1] - moved[0], [[0.0, 0.0, 0.0], [0.0, 0.0, 6.0]], atol=0.3)


def test_the_recorded_step_across_a_jump_is_not_followed():
    # Two places of the recording 9 cm apart, while the motion was made to stay where it was.
    recorded = figure(np.repeat([[0.0, 0.0], [9.0, 0.0]], 30, axis=0))
    motion = figure(np.zeros((60, 2)))
    jumps = np.zeros(60, dtype=bool)
    jumps[30] = True
    assert drift(locked(motion, recorded, jumps=jumps)).max() < 1e-6
    assert drift(locked(motion, recorded))[-1].min() > 8.0


# --- steps --------------------------------------------------------------------------------------------------


def test_a_foot_that_is_too_far_off_makes_a_step():
    recorded, motion = figure(np.zeros((300, 2)), 0.7), figure(slide(300, (40.0, 0.0)), 0.7)
    held = locked(motion, recorded)
    up = ankles(held)[..., 1] - ankles(motion)[..., 1]
    off = np.linalg.norm((ankles(held) - ankles(motion))[..., [0, 2]], axis=-1)
    # Of 15 cm at most, up to what is added while one foot waits for the other one: 15 frames of 1 / 7 cm.
    assert off.max() < 15.0 + 15 * 40 / 280 + 0.5
    # Each foot steps twice over 40 cm, up to the height of a step, less what the filter takes off its top.
    for foot in range(2):
        steps = np.flatnonzero(np.diff(np.concatenate([[False], up[:, foot] > 0.5]).astype(int)) == 1)
        assert len(steps) == 2
        assert 5.5 < up[:, foot].max() < 6.01
    assert (up.min(axis=1) < 0.8).all()
    assert up.min() > -1e-6
    # On the floor, feet stand: those that are not up do not move.
    speed = np.linalg.norm(np.diff(ankles(held)[..., [0, 2]], axis=0), axis=-1)
    down = (up[1:] < 0.01) & (up[:-1] < 0.01)
    assert (
        speed[down].mean() < 0.02 and down.mean() > 0.4
    )  # the others hang a little, where the leg is nearly at its longest


def test_a_step_takes_its_time_and_goes_back_under_the_body():
    chosen = Feet(lock=True, max_offset=5.0, step_seconds=1.0, step_height=3.0)
    recorded, motion = figure(np.zeros((90, 2))), figure(slide(90, (5.6, 0.0), 5, 25))
    held = locked(motion, recorded, chosen)
    up = ankles(held)[..., 1] - ankles(motion)[..., 1]
    assert up.max(axis=0) == pytest.approx([3.0, 3.0], abs=0.1)
    # One after the other, each of 30 frames; the sine is above a tenth of its height for 0.8 of them.
    assert (up > 0.3).sum(axis=0) == pytest.approx([24, 24], abs=1) and not (up > 0.3).all(axis=1).any()
    np.testing.assert_allclose(ankles(held)[-1], ankles(motion)[-1], atol=0.02)


def test_a_step_out_of_a_crouch_bends_the_knee_no_further_than_was_recorded():
    bend = 0.35 + 1.25 * np.interp(np.arange(300), [60, 100, 200, 240], [0.0, 1.0, 1.0, 0.0])[:, None]

    def crouching(places):
        motion = figure(places, bend)
        positions = motion.positions.copy()
        positions[:, 0, 1] -= ankles(motion)[:, 0, 1] - ankles(motion)[0, 0, 1]
        return replace(motion, positions=positions)

    def bends(motion):
        places = kinematics.joint_positions(motion, [4, 5, 6, 9, 10, 11]).reshape(-1, 2, 3, 3)
        thigh, shin = places[:, :, 1] - places[:, :, 0], places[:, :, 2] - places[:, :, 1]
        return np.arctan2(np.linalg.norm(np.cross(thigh, shin), axis=-1), (thigh * shin).sum(axis=-1))

    motion = crouching(slide(300, (40.0, 0.0), 105, 195))
    held = locked(motion, crouching(np.zeros((300, 2))))
    assert drift(held)[100:200].max() > 10.0 and rotation.angle_between(held.rotations, motion.rotations).max() > 0.1
    assert bends(held).max() < bend.max() + 1e-6


def test_a_raised_foot_is_left_where_it_was_once_its_offset_has_faded():
    # The right foot goes up at frame 60, with an offset of 10 cm, and stays there for four seconds.
    count = 180
    bend = np.full((count, 2), 0.35)
    bend[:, 1] += 1.2 * np.clip((np.arange(count) - 60) / 10, 0, 1)
    recorded, motion = figure(np.zeros((count, 2)), bend), figure(slide(count, (10.0, 0.0), 10, 50), bend)
    bearing = np.tile(np.arange(count)[:, None] < 60, (1, 2)) | [True, False]
    held = locked(motion, recorded, bearing=bearing)
    off = np.linalg.norm(ankles(held) - ankles(motion), axis=-1)
    assert off[55] == pytest.approx([10.0, 10.0], abs=0.2)
    # It halves every 9 frames: the filter is none to a geometric decay but for a factor near 1.
    assert off[90, 1] / off[81, 1] == pytest.approx(0.5, abs=1e-3)
    assert off[-1, 1] < 10.0 * 0.5 ** (110 / 9) * 1.5
    np.testing.assert_allclose(off[60:, 0], 10.0, atol=0.2)


# --- reach --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", [(300.0, 0.0), (0.0, -300.0), (0.0, 50.0)])
def test_a_goal_out_of_reach_is_pointed_at(way):
    chosen = Feet(lock=True, max_offset=1000.0)
    recorded, motion = figure(np.zeros((90, 2))), figure(slide(90, way))
    held = locked(motion, recorded, chosen)
    assert np.isfinite(held.rotations).all()
    np.testing.assert_allclose(np.linalg.norm(held.rotations, axis=-1), 1.0, atol=1e-12)
    hips = kinematics.joint_positions(held, [4, 9])
    assert np.linalg.norm(ankles(held) - hips, axis=-1)[-1] == pytest.approx([81.688, 81.688], abs=0.01)
    # As far as a knee of 170 degrees lets it, in a line with where the foot should be.
    goal = ankles(motion)[0]
    cosine = np.sum((goal - hips[-1]) * (ankles(held)[-1] - hips[-1]), axis=1)
    cosine /= np.linalg.norm(goal - hips[-1], axis=1) * np.linalg.norm(ankles(held)[-1] - hips[-1], axis=1)
    np.testing.assert_allclose(cosine, 1.0, atol=1e-4)


@pytest.mark.parametrize("bend", (0.0, 1e-9, 1e-3, 0.02))
def test_straight_legs_under_a_sliding_body_are_finite_and_in_reach(bend):
    recorded, motion = figure(np.zeros((60, 2)), bend), figure(slide(60, (10.0, 0.0)), bend)
    held = locked(motion, recorded)
    assert np.isfinite(held.rotations).all()
    # 0.6 cm too short for 10 cm aside: the feet hang that much above where they should be, in line with it.
    np.testing.assert_allclose(ankles(held)[-1] - ankles(held)[0], [[0.1, 0.6, 0.0]] * 2, atol=0.2)


def test_a_straight_leg_is_bent_for_a_step():
    chosen = Feet(lock=True, max_offset=5.0)
    recorded, motion = figure(np.zeros((90, 2)), 0.0), figure(slide(90, (8.0, 0.0)), 0.0)
    up = (ankles(locked(motion, recorded, chosen)) - ankles(motion))[..., 1]
    assert up.max() > 4.0


@pytest.mark.parametrize("seed", range(4))
def test_no_goal_straightens_a_knee_beyond_the_recording_or_170_degrees(seed):
    rng = np.random.default_rng(seed)
    recorded = figure(np.zeros((120, 2)), 0.2 + 0.4 * rng.random())
    motion = figure(60.0 * gaussian_filter1d(rng.normal(size=(120, 2)), 6.0, axis=0), 0.6)
    held = locked(motion, recorded, Feet(lock=True, max_offset=float(rng.uniform(5, 200))))
    hips, feet_at = kinematics.joint_positions(held, [4, 9]), ankles(held)
    longest = max(float(np.linalg.norm(ankles(m) - kinematics.joint_positions(m, [4, 9]), axis=-1).max())
                  for m in (recorded, motion))  # fmt: skip
    reached = np.linalg.norm(feet_at - hips, axis=-1)
    assert reached.max() <= max(longest, 81.689) + 1e-6 and np.ptp(reached) > 0.5


# --- foot skate ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_foot_skate_falls_in_motion_with_jumps(seed):
    rng = np.random.default_rng(seed)
    count = 600
    recorded = figure(
        8.0 * gaussian_filter1d(rng.normal(size=(count, 2)), 20.0, axis=0),
        0.5 + 0.3 * gaussian_filter1d(rng.normal(size=(count, 2)), 15.0, axis=0),
        gaussian_filter1d(rng.normal(size=count), 20.0),
    )
    # Stretches of the recording in any order, on a root that drifts and turns smoothly through the joins.
    starts = rng.integers(0, count - 60, size=10)
    shown = np.concatenate([np.arange(start, start + 60) for start in starts])
    jumps = np.zeros(count, dtype=bool)
    jumps[60::60] = True
    source = recorded.take(shown)
    rotations, positions = source.rotations.copy(), source.positions.copy()
    rotations[:, 0] = rotation.about_y(8.0 * gaussian_filter1d(rng.normal(size=count), 30.0))
    positions[:, 0, [0, 2]] = 150.0 * gaussian_filter1d(rng.normal(size=(count, 2)), 30.0, axis=0)
    motion = replace(source, rotations=rotations, positions=positions)
    bearing = feet.contacts(ankles(recorded))[shown]
    held = feet.lock(motion, source, bearing, jumps, PELVIS, LOCK)
    before, after = (foot_skate(ankles(m), [0, 1], fps=30.0) for m in (motion, held))
    assert before.speed > 8.0 and after.contact_share > 0.5
    assert after.speed < before.speed / 3.0

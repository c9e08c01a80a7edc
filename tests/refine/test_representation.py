import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gesturegen.motion import rotation
from gesturegen.motion.kinematics import joint_positions
from gesturegen.refine.representation import Description, Normalisation, describe, from_channels, to_channels
from tests.builders import SMALL, chain, random_motion

SKELETON = chain(5)
JOINTS = [1, 3, 4]


def bone_lengths(motion):
    positions = joint_positions(motion)
    parents = motion.skeleton.parents
    return np.linalg.norm(positions[:, 1:] - positions[:, parents[1:]], axis=-1)


def test_six_numbers_are_the_first_two_columns():
    motion = random_motion(SKELETON, 4)
    channels = to_channels(motion, JOINTS)
    assert channels.shape == (4, 18)
    matrix = rotation.to_matrix(motion.rotations[2, 3])
    np.testing.assert_allclose(channels[2, 6:12], [*matrix[:, 0], *matrix[:, 1]], atol=1e-15)


def test_a_round_trip_is_exact():
    motion = random_motion(SKELETON, 200)
    back = from_channels(motion, JOINTS, to_channels(motion, JOINTS))
    np.testing.assert_allclose(back.rotations, motion.rotations, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(back.positions, motion.positions)


def test_channels_carry_a_motion_to_another():
    one, other = random_motion(SKELETON, 20, seed=1), random_motion(SKELETON, 20, seed=2)
    made = from_channels(other, JOINTS, to_channels(one, JOINTS))
    assert rotation.angle_between(made.rotations[:, JOINTS], one.rotations[:, JOINTS]).max() < 1e-7
    np.testing.assert_array_equal(made.rotations[:, [0, 2]], other.rotations[:, [0, 2]])


@SMALL
@given(arrays(np.float64, (3, 18), elements=st.floats(-1e6, 1e6)))
def test_any_channels_give_rotations_and_keep_bone_lengths(channels):
    motion = random_motion(SKELETON, 3)
    made = from_channels(motion, JOINTS, channels)
    np.testing.assert_allclose(np.linalg.norm(made.rotations, axis=-1), 1.0, atol=1e-12)
    np.testing.assert_allclose(bone_lengths(made), 10.0, rtol=1e-12)


def test_the_first_column_keeps_its_direction():
    motion = random_motion(SKELETON, 1)
    made = from_channels(motion, [1], np.array([[0.0, 2.0, 0.0, -5.0, 1.0, 0.0]]))
    expected = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(rotation.to_matrix(made.rotations[0, 1]), expected, atol=1e-12)


@pytest.mark.parametrize("six", [[0] * 6, [1, 0, 0, 2, 0, 0], [0, 0, 0, 0, 1, 0], [1, 2, 3, 1e-12, 0, 0]])
def test_columns_that_span_no_plane_leave_the_rotation(six):
    motion = random_motion(SKELETON, 1)
    made = from_channels(motion, [2], np.array([six], dtype=float))
    np.testing.assert_array_equal(made.rotations, motion.rotations)


def test_channels_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="not finite"):
        from_channels(random_motion(SKELETON, 1), [1], np.full((1, 6), np.nan))


def test_normalisation_and_back():
    windows = np.random.default_rng(0).normal(3.0, 2.0, size=(10, 4, 16))
    windows[:, 3] = 5.0
    scale = Normalisation.of(windows)
    normal = scale.apply(windows)
    assert normal.dtype == np.float32
    np.testing.assert_allclose(normal[:, :3].mean(axis=(0, 2)), 0.0, atol=1e-6)
    np.testing.assert_allclose(normal[:, :3].std(axis=(0, 2)), 1.0, atol=1e-6)
    np.testing.assert_array_equal(normal[:, 3], 0.0)
    np.testing.assert_allclose(scale.undo(normal), windows, atol=1e-5)


def test_normalisation_of_unequal_lengths_is_refused():
    with pytest.raises(ValueError, match="do not fit"):
        Normalisation(np.zeros(3), np.ones(2))


def test_descriptions_say_what_differs():
    mine = describe(random_motion(SKELETON, 1, fps=15.0), JOINTS)
    assert mine == Description(("j1", "j3", "j4"), 15.0)
    assert mine.channels == 18
    assert mine.difference(mine) is None
    assert mine.difference(Description(("j1",), 15.0)) == "3 joints (18 channels) against 1 (6)"
    assert mine.difference(Description(("j1", "j2", "j4"), 15.0)) == "joint 'j3' against 'j2'"
    assert mine.difference(Description(mine.joints, 30.0)) == "15 frames per second against 30"

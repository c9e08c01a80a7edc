import numpy as np
import pytest

from gesturegen.motion import kinematics, rotation
from gesturegen.motion.skeleton import Motion
from tests.builders import chain, make_skeleton, product, random_motion

# A shoulder at height 10, an upper arm of 30 and a forearm of 25 along X.
ARM = make_skeleton(["shoulder", "elbow", "wrist"], [-1, 0, 1], [[0, 10, 0], [30, 0, 0], [25, 0, 0]])


def arm(shoulder, elbow, order="ZXY"):
    """One frame with Euler angles in degrees."""
    angles = np.radians([shoulder, elbow, (0.0, 0.0, 0.0)])
    return Motion(ARM, rotation.from_euler(order, angles)[None], ARM.offsets[None], 30.0)


@pytest.mark.parametrize(
    ("shoulder", "elbow", "elbow_at", "wrist_at"),
    [
        ((0, 0, 0), (0, 0, 0), (30, 10, 0), (55, 10, 0)),
        ((90, 0, 0), (0, 0, 0), (0, 40, 0), (0, 65, 0)),
        ((90, 0, 0), (90, 0, 0), (0, 40, 0), (-25, 40, 0)),
        ((0, 0, 90), (0, 0, 0), (0, 10, -30), (0, 10, -55)),
        ((0, 0, 90), (90, 0, 0), (0, 10, -30), (0, 35, -30)),
        ((0, 90, 0), (90, 0, 0), (30, 10, 0), (30, 10, 25)),
    ],
)
def test_two_joint_arm(shoulder, elbow, elbow_at, wrist_at):
    positions = kinematics.joint_positions(arm(shoulder, elbow))
    np.testing.assert_allclose(positions[0], [(0, 10, 0), elbow_at, wrist_at], atol=1e-12)


def test_position_channels_replace_the_offset():
    positions = np.array([[[1.0, 2.0, 3.0], [0.0, 5.0, 0.0], [25.0, 0.0, 0.0]]])
    motion = Motion(ARM, np.tile(rotation.IDENTITY, (1, 3, 1)), positions, 30.0)
    np.testing.assert_allclose(kinematics.joint_positions(motion)[0], [[1, 2, 3], [1, 7, 3], [26, 7, 3]])


def test_world_rotation_is_the_product_down_the_chain():
    rotations, _ = kinematics.world_transforms(arm((10, 20, 30), (-40, 50, 60)))
    expected = product("ZXY", (10, 20, 30)) @ product("ZXY", (-40, 50, 60))
    np.testing.assert_allclose(rotation.to_matrix(rotations[0, 2]), expected, atol=1e-12)


def test_matrix_chain_agrees_on_a_random_tree():
    skeleton = make_skeleton(list("abcdef"), [-1, 0, 1, 1, 0, 4], np.random.default_rng(1).normal(size=(6, 3)))
    motion = random_motion(skeleton, 4)
    found = kinematics.joint_positions(motion)
    local = rotation.to_matrix(motion.rotations)
    for frame in range(4):
        turns, places = [], []
        for joint, parent in enumerate(skeleton.parents):
            above, origin = (np.eye(3), np.zeros(3)) if parent < 0 else (turns[parent], places[parent])
            places.append(origin + above @ motion.positions[frame, joint])
            turns.append(above @ local[frame, joint])
        np.testing.assert_allclose(found[frame], places, atol=1e-12)


def test_selected_joints_come_from_the_full_skeleton_in_the_order_asked_for():
    motion = random_motion(chain(6), 3)
    everything = kinematics.joint_positions(motion)
    np.testing.assert_array_equal(kinematics.joint_positions(motion, [5, 2]), everything[:, [5, 2]])


def moved(motion, turn, shift):
    """The whole motion turned about the vertical and carried elsewhere."""
    rotations, positions = motion.rotations.copy(), motion.positions.copy()
    rotations[:, 0] = rotation.multiply(rotation.about_y(turn), rotations[:, 0])
    positions[:, 0] = rotation.rotate(rotation.about_y(turn), positions[:, 0]) + shift
    return Motion(motion.skeleton, rotations, positions, motion.fps)


@pytest.mark.parametrize(
    ("relative_to", "turn", "shift", "unchanged"),
    [
        ("root", 0.0, (40, -3, 7), True),
        ("root", 1.0, (0, 0, 0), False),
        ("root_heading", 2.5, (40, -3, 7), True),
        ("world", 0.0, (40, -3, 7), False),
        ("world", 1.0, (0, 0, 0), False),
    ],
)
def test_what_relative_positions_ignore(relative_to, turn, shift, unchanged):
    motion = random_motion(chain(4), 5)
    before = kinematics.relative_positions(motion, [1, 2, 3], 1, relative_to)
    after = kinematics.relative_positions(moved(motion, turn, shift), [1, 2, 3], 1, relative_to)
    assert np.allclose(before, after, atol=1e-9) is unchanged


def test_relative_positions_put_the_pelvis_at_the_origin():
    motion = random_motion(chain(4), 5)
    found = kinematics.relative_positions(motion, [0, 2, 3], 2, "root")
    world = kinematics.joint_positions(motion)
    np.testing.assert_allclose(found[:, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(found[:, 0], world[:, 0] - world[:, 2], atol=1e-12)
    np.testing.assert_array_equal(kinematics.relative_positions(motion, [0, 3], 2, "world"), world[:, [0, 3]])


def test_root_heading_brings_the_facing_to_z():
    facing = Motion(ARM, np.tile(rotation.about_y(np.pi / 2), (1, 3, 1)), ARM.offsets[None], 30.0)
    found = kinematics.relative_positions(facing, [0, 1], 0, "root_heading")
    np.testing.assert_allclose(found[0], [[0, 0, 0], [30, 0, 0]], atol=1e-12)


def test_travelling_joint_is_the_first_whose_position_varies():
    skeleton = chain(4)
    still = np.tile(skeleton.offsets, (5, 1, 1))
    rotations = np.tile(rotation.IDENTITY, (5, 4, 1))
    assert kinematics.travelling_joint([Motion(skeleton, rotations, still, 30.0)]) == 0
    walking = still.copy()
    walking[:, 1, 2] += np.arange(5)
    walking[:, 3, 0] += np.arange(5)
    assert kinematics.travelling_joint([Motion(skeleton, rotations, walking, 30.0)]) == 1


def test_a_joint_that_stands_elsewhere_in_another_motion_travels():
    skeleton = chain(3)
    rotations = np.tile(rotation.IDENTITY, (2, 3, 1))
    here = Motion(skeleton, rotations, np.tile(skeleton.offsets, (2, 1, 1)), 30.0)
    there = Motion(skeleton, rotations, np.add(here.positions, [[0, 0, 0], [0, 0, 4], [0, 0, 0]]), 30.0)
    assert kinematics.travelling_joint([here, here]) == 0
    assert kinematics.travelling_joint([here, there]) == 1

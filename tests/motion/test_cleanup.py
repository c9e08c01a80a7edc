import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

from gesturegen.motion import bvh, cleanup, rotation
from gesturegen.motion.skeleton import Motion
from gesturegen.settings.models import Wrists
from tests.builders import SMALL, chain, make_skeleton, random_motion

BODY = make_skeleton(["root", "forearm", "b_l_wrist_twist", "b_l_wrist", "finger"], [-1, 0, 1, 2, 3])
TWIST, WRIST = 2, 3
ONE = np.array([0])
SETTINGS = Wrists(joints=("b_l_wrist", "b_l_wrist_twist"))


def planted(roll, yaw, pitch, axes="XYZ", joint=WRIST):
    """Random motion whose wrist has the given angles in radians, by scipy."""
    motion = random_motion(BODY, len(roll), seed=5)
    rotations = motion.rotations.copy()
    angles = np.stack([roll, yaw, pitch], axis=1)
    rotations[:, joint] = Rotation.from_euler(axes, angles).as_quat(scalar_first=True)
    return Motion(BODY, rotations, motion.positions, 30.0)


def wrist_angles(motion, axes="XYZ", joint=WRIST):
    return Rotation.from_quat(motion.rotations[:, joint], scalar_first=True).as_euler(axes)


def assert_same_angle(found, expected, tolerance=1e-7):
    np.testing.assert_allclose(np.angle(np.exp(1j * (np.asarray(found) - expected))), 0.0, atol=tolerance)


def noise(frames, scale, seed=0):
    return scale * np.random.default_rng(seed).standard_normal(frames)


@pytest.mark.parametrize("axes", ("XYZ", "ZYX", "YZX"))
@pytest.mark.parametrize("centre", (0.4, 3.0, -3.1), ids=("within", "across the wrap", "across the lower wrap"))
def test_yaw_and_pitch_are_locked_and_roll_is_filtered(axes, centre):
    frames = 60
    roll = centre + 0.3 * np.sin(np.arange(frames) / 6.0) + noise(frames, 0.05)
    yaw, pitch = -0.2 + noise(frames, 0.1, 1), 0.7 + noise(frames, 0.1, 2)
    motion = planted(roll, yaw, pitch, axes)
    cleaned, notes = cleanup.clean_wrists(motion, ONE, Wrists(joints=("b_l_wrist",), axes=axes))
    found = wrist_angles(cleaned, axes)
    assert notes == []
    assert_same_angle(found[:, 0], savgol_filter(roll, 15, 3))
    assert_same_angle(found[:, 1], np.median(yaw))
    assert_same_angle(found[:, 2], np.median(pitch))


def test_pitch_around_the_wrap_locks_at_its_circular_median():
    frames = 41
    pitch = np.pi + np.linspace(-0.3, 0.5, frames)
    cleaned, _ = cleanup.clean_wrists(planted(np.zeros(frames), np.zeros(frames), pitch), ONE, SETTINGS)
    assert_same_angle(wrist_angles(cleaned)[:, 2], np.pi + 0.1)


def test_roll_that_turns_all_the_way_round_has_no_jump():
    roll = np.linspace(-1.0, 9.0, 120)
    motion = planted(roll, np.zeros(120), np.zeros(120))
    cleaned, _ = cleanup.clean_wrists(motion, ONE, SETTINGS)
    # A straight line is a polynomial of order 3, so that the filter repeats it.
    assert_same_angle(wrist_angles(cleaned)[:, 0], roll)


@pytest.mark.parametrize(("window", "order"), [(5, 1), (31, 2)])
def test_window_and_order_are_the_settings(window, order):
    roll = noise(80, 0.3)
    settings = Wrists(joints=("b_l_wrist",), window=window, order=order)
    cleaned, _ = cleanup.clean_wrists(planted(roll, 0 * roll, 0 * roll), ONE, settings)
    assert_same_angle(wrist_angles(cleaned)[:, 0], savgol_filter(roll, window, order))


def test_each_segment_is_filtered_by_itself_and_locked_with_the_others():
    frames = 70
    roll = np.where(np.arange(frames) < 40, 0.0, 1.5) + noise(frames, 0.05)
    pitch = np.where(np.arange(frames) < 40, 0.1, 0.5)
    cleaned, notes = cleanup.clean_wrists(planted(roll, 0 * roll, pitch), np.array([0, 40]), SETTINGS)
    found = wrist_angles(cleaned)
    expected = np.concatenate([savgol_filter(roll[:40], 15, 3), savgol_filter(roll[40:], 15, 3)])
    assert_same_angle(found[:, 0], expected)
    assert_same_angle(found[:, 2], 0.1)
    assert notes == []


def test_a_segment_shorter_than_the_window_is_locked_but_not_filtered():
    frames = 15 + 14
    roll, pitch = noise(frames, 0.2), noise(frames, 0.1, 1)
    cleaned, notes = cleanup.clean_wrists(planted(roll, 0 * roll, pitch), np.array([0, 15]), SETTINGS)
    found = wrist_angles(cleaned)
    assert_same_angle(found[15:, 0], roll[15:])
    assert_same_angle(found[:15, 0], savgol_filter(roll[:15], 15, 3))
    assert_same_angle(found[:, 2], np.median(pitch))
    assert notes == ["1 segment(s) shorter than 15 frames: their wrists are locked but not filtered"]


def test_one_frame_stays_as_it_is():
    motion = planted(np.array([0.3]), np.array([0.2]), np.array([0.1]))
    cleaned, _ = cleanup.clean_wrists(motion, ONE, SETTINGS)
    np.testing.assert_allclose(wrist_angles(cleaned), [[0.3, 0.2, 0.1]], atol=1e-12)


def test_both_wrist_joints_and_no_other_joint_change():
    motion = random_motion(BODY, 40, seed=1)
    cleaned, _ = cleanup.clean_wrists(motion, ONE, SETTINGS)
    changed = [j for j in range(5) if not np.array_equal(cleaned.rotations[:, j], motion.rotations[:, j])]
    assert changed == [TWIST, WRIST]
    np.testing.assert_array_equal(cleaned.positions, motion.positions)
    np.testing.assert_allclose(np.linalg.norm(cleaned.rotations, axis=-1), 1.0, atol=1e-12)


def test_switched_off_returns_the_motion_itself():
    motion = random_motion(BODY, 40)
    assert cleanup.clean_wrists(motion, ONE, Wrists(enabled=False)) == (motion, [])


def test_a_missing_wrist_is_named_and_the_other_cleaned():
    body = make_skeleton(["root", "b_l_wrist"], [-1, 0])
    motion = random_motion(body, 20)
    cleaned, notes = cleanup.clean_wrists(motion, ONE, SETTINGS)
    assert notes == ["the skeleton has no wrist joint b_l_wrist_twist, which is not cleaned (wrists.joints)"]
    assert not np.array_equal(cleaned.rotations[:, 1], motion.rotations[:, 1])


def test_a_skeleton_without_wrists_is_noted_and_left_alone():
    motion = random_motion(chain(3), 5)
    cleaned, notes = cleanup.clean_wrists(motion, ONE, SETTINGS)
    assert cleaned is motion
    assert notes == ["the skeleton has none of the wrist joints, so no wrist is cleaned (wrists.joints)"]


def test_an_empty_list_of_wrists_needs_no_note():
    motion = random_motion(chain(3), 20)
    assert cleanup.clean_wrists(motion, ONE, Wrists(joints=()))[1] == []


@SMALL
@given(st.floats(-20, 20, allow_nan=False), st.integers(1, 30), st.integers(0, 1000))
def test_circular_median_turns_with_the_angles(turn, count, seed):
    angles = np.random.default_rng(seed).uniform(-1.0, 1.0, count)
    wrapped = rotation.wrap_angle(angles + turn)
    assert_same_angle(cleanup.circular_median(wrapped), np.median(angles) + turn, 1e-9)


# --- frame rate and jumps -----------------------------------------------------------------------------------


def test_resampling_to_the_same_rate_returns_the_motion_itself():
    motion = random_motion(chain(2), 7)
    assert cleanup.resample(motion, 30) is motion


def test_resampling_a_multiple_rate_takes_every_nth_frame():
    motion = random_motion(chain(2), 42, fps=120.0)
    found = cleanup.resample(motion, 30)
    np.testing.assert_allclose(found.positions, motion.positions[::4], atol=1e-12)
    np.testing.assert_allclose(
        rotation.to_matrix(found.rotations), rotation.to_matrix(motion.rotations[::4]), atol=1e-12
    )


@pytest.mark.parametrize("fps", (12.5, 24.0, 29.97, 33.0, 60.0, 120.0, 240.0))
@pytest.mark.parametrize("frames", (1, 2, 3, 50, 101))
def test_resampling_never_reaches_past_the_last_frame(fps, frames):
    found = cleanup.resample(random_motion(chain(2), frames, fps=fps), 30)
    last = (frames - 1) / fps
    assert (found.n_frames - 1) / 30 <= last + 1e-6 < found.n_frames / 30 + 1e-6
    assert np.isfinite(found.rotations).all()


def test_interpolation_at_halves():
    motion = random_motion(chain(2), 3)
    found = cleanup.interpolate(motion, np.array([0.0, 0.5, 2.0]))
    np.testing.assert_allclose(found.positions[1], (motion.positions[0] + motion.positions[1]) / 2)
    whole = rotation.angle_between(motion.rotations[0], motion.rotations[1])
    np.testing.assert_allclose(rotation.angle_between(motion.rotations[0], found.rotations[1]), whole / 2, atol=1e-9)
    np.testing.assert_allclose(found.positions[2], motion.positions[2])


def test_tracking_jumps_are_the_frames_before_the_jump():
    positions = np.zeros((10, 2, 3))
    positions[4:, 1, 0] = 20.0  # 20 units in one frame: 600 units per second
    positions[7:, 0, 2] = 5.0  # 150 units per second
    assert cleanup.tracking_jumps(positions, 30, 500.0).tolist() == [3]
    assert cleanup.tracking_jumps(positions, 30, 149.0).tolist() == [3, 6]
    assert cleanup.tracking_jumps(positions, 30, 600.0).tolist() == []
    assert cleanup.tracking_jumps(positions, 60, 600.0).tolist() == [3]


def test_no_limit_and_one_frame_have_no_jumps():
    assert len(cleanup.tracking_jumps(np.zeros((10, 2, 3)), 30, None)) == 0
    assert len(cleanup.tracking_jumps(np.zeros((1, 2, 3)), 30, 1.0)) == 0


def test_frames_that_resampling_takes_over_keep_their_angles():
    """A body that has turned more than once round, at 120 fps: every fourth frame is the file's."""
    turns = np.linspace(370.0, 560.0, 41)
    angles = np.stack([np.zeros(41), np.zeros(41), turns], axis=1)
    skeleton = make_skeleton(["root"], [-1])
    motion = Motion(
        skeleton, rotation.from_euler("ZXY", np.radians(angles))[:, None], np.zeros((41, 1, 3)), 120.0,
        np.array([0]), angles[:, None],
    )  # fmt: skip
    rows = bvh.format_bvh(cleanup.resample(motion, 30.0)).splitlines()[-11:]
    np.testing.assert_allclose([float(row.split()[-1]) for row in rows], turns[::4], atol=1e-6)
    # Between frames they go on from there.
    between = bvh.format_bvh(cleanup.resample(motion, 50.0)).splitlines()[-17:]
    np.testing.assert_allclose(
        [float(row.split()[-1]) for row in between], np.interp(np.arange(17) * 2.4, range(41), turns), atol=1e-4
    )

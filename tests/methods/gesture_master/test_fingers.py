"""Poses of any length become rows, and the nearest row is the nearest, whatever float32 says."""

import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from threadpoolctl import threadpool_limits

from gesturegen.methods.gesture_master import fingers
from gesturegen.methods.gesture_master.fingers import describe_poses, has_fingers, nearest
from gesturegen.motion import bvh, rotation
from tests.builders import SMALL, data_folder

# --- has_fingers ------------------------------------------------------------------------------------------------


def turned(*degrees):
    """One finger joint that turns about x."""
    return rotation.from_expmap(np.radians(degrees)[:, None, None] * [1.0, 0.0, 0.0])


def test_a_finger_that_moves_is_enough():
    still = turned(20, 20, 20)
    assert has_fingers(np.concatenate([still, turned(20, 21, 20), still], axis=1))


def test_constant_fingers_are_none():
    assert not has_fingers(np.concatenate([turned(20, 20, 20), turned(0, 0, 0)], axis=1))
    assert not has_fingers(turned(20, 20.01, 20)) and has_fingers(turned(20, 20.1, 20))


def test_a_changed_sign_is_no_movement():
    assert not has_fingers(turned(20, 20) * [[[1.0]], [[-1.0]]])


@pytest.mark.parametrize("shape", [(0, 3, 4), (5, 0, 4), (0, 0, 4)])
def test_no_frames_or_no_joints(shape):
    assert not has_fingers(np.zeros(shape))


def test_a_single_frame_does_not_move():
    assert not has_fingers(turned(30))


# --- describe_poses ---------------------------------------------------------------------------------------------


def test_poses_are_taken_evenly_and_linearly():
    positions = np.arange(5.0)[:, None, None] * [[[1.0, 10.0, -1.0], [0.0, 2.0, 0.0]]]
    row = describe_poses(positions, samples=3)
    assert row.dtype == np.float32 and row.shape == (18,)
    assert row.reshape(3, 2, 3)[:, 0, 1].tolist() == [0, 20, 40]
    assert describe_poses(positions, samples=9).reshape(9, 2, 3)[:, 0, 0] == pytest.approx(np.arange(9) / 2)


def test_as_many_samples_as_frames_are_the_frames():
    positions = np.random.default_rng(0).normal(scale=50.0, size=(8, 4, 3))
    assert np.array_equal(describe_poses(positions), positions.astype(np.float32).ravel())


def test_one_frame_is_repeated_and_none_is_refused():
    positions = np.random.default_rng(0).normal(size=(1, 2, 3))
    assert np.array_equal(describe_poses(positions, 4), np.tile(positions.astype(np.float32).ravel(), 4))
    with pytest.raises(ValueError, match="without frames"):
        describe_poses(positions[:0])


@SMALL
@given(st.integers(0, 10**6), st.integers(1, 40), st.integers(1, 9))
def test_poses_equal_interp(seed, frames, samples):
    positions = np.random.default_rng(seed).normal(scale=30.0, size=(frames, 3, 3))
    times = np.linspace(0, frames - 1, samples)
    expected = [np.interp(times, np.arange(frames), track) for track in positions.reshape(frames, 9).T]
    assert describe_poses(positions, samples) == pytest.approx(np.array(expected).T.ravel(), abs=1e-4)


# --- nearest ----------------------------------------------------------------------------------------------------


def naive_nearest(wanting, offered):
    numbers, distances = [], []
    for row in np.asarray(wanting, dtype=np.float64):
        squares = np.square(row - np.asarray(offered, dtype=np.float64)).sum(axis=1)
        numbers.append(int(np.argmin(squares)))
        distances.append(np.sqrt(squares.min() * 3 / len(row)))
    return numbers, distances


def check(wanting, offered):
    numbers, distances = nearest(wanting, offered)
    expected = naive_nearest(wanting, offered)
    assert numbers.dtype == np.int64 and numbers.tolist() == expected[0]
    assert distances == pytest.approx(expected[1])


@SMALL
@given(st.integers(0, 10**6), st.integers(1, 30), st.integers(1, 30), st.integers(1, 12), st.booleans())
def test_nearest_equals_naive(seed, wanted, given_, width, coarse):
    """Coarse rows have many equal ones and many equally near ones."""
    rng = np.random.default_rng(seed)
    wanting, offered = rng.normal(size=(wanted, width)), rng.normal(size=(given_, width))
    if coarse:
        wanting, offered = np.round(wanting), np.round(offered)
    check(wanting, offered)


def test_float32_does_not_decide():
    """Far from the origin, rows differ by less than float32 can tell."""
    rng = np.random.default_rng(0)
    offered = 1e4 + rng.normal(scale=1e-5, size=(50, 24))
    offered[0] = -1e4
    check(offered[1:] + rng.normal(scale=1e-6, size=(49, 24)), offered)


def test_blocks_leave_no_seam(monkeypatch):
    rng = np.random.default_rng(1)
    wanting, offered = rng.integers(0, 3, size=(57, 6)), rng.integers(0, 3, size=(41, 6))
    monkeypatch.setattr(fingers, "_BLOCK", 100)
    monkeypatch.setattr(fingers, "_PAIRS", 7)
    check(wanting, offered)


def test_the_first_of_equal_rows_at_no_distance():
    row = np.arange(6.0)
    numbers, distances = nearest([row], [row + 1, row, row - 1, row])
    assert numbers.tolist() == [1] and distances.tolist() == [0.0]


def test_the_distance_is_that_of_a_joint():
    pose = np.zeros((1, 8 * 5 * 3))
    moved = pose + np.tile([3.0, 0.0, 4.0], 8 * 5)
    assert nearest(pose, moved)[1] == pytest.approx([5.0])


def test_nothing_wanted_and_nothing_offered():
    numbers, distances = nearest(np.zeros((0, 6)), np.zeros((2, 6)))
    assert numbers.shape == distances.shape == (0,)
    with pytest.raises(ValueError, match="no clip with fingers is offered"):
        nearest(np.zeros((2, 6)), np.zeros((0, 6)))
    with pytest.raises(ValueError, match=r"expected \(A, D\)"):
        nearest(np.zeros((2, 6)), np.zeros((2, 9)))
    with pytest.raises(ValueError, match="not finite"):
        nearest(np.full((2, 6), np.nan), np.zeros((2, 6)))


def test_many_clips_take_little_time_and_memory():
    rng = np.random.default_rng(0)
    offered = rng.normal(scale=20.0, size=(4000, 90)).astype(np.float32)
    offered[2000:] = offered[0]  # recordings repeat themselves, as when nobody moves
    wanting = offered[rng.integers(0, 4000, size=4000)] + rng.normal(scale=0.1, size=(4000, 90)).astype(np.float32)
    tracemalloc.start()
    with threadpool_limits(limits=1):
        began = time.thread_time()  # of this thread alone: however busy the machine is
        numbers, _ = nearest(wanting, offered)
        seconds, peak = time.thread_time() - began, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    print(f"{seconds:.2f} s")
    assert seconds < 20 and peak < 150e6
    assert numbers[:20].tolist() == naive_nearest(wanting[:20], offered)[0]


def test_recorded_fingers_move():
    path = next((data_folder() / "genea_split_sample/val/main-agent/bvh").glob("*.bvh"))
    motion = bvh.read(path)
    joints = [j for side in "lr" for j in motion.skeleton.descendants(motion.skeleton.index(f"b_{side}_wrist"))]
    assert has_fingers(motion.rotations[:, joints])
    assert not has_fingers(np.tile(motion.rotations[:1, joints], (50, 1, 1)))

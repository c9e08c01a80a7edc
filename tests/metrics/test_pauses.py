"""What is shown in pauses, and speeds, on hand-made frames and against naive loops."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gesturegen.metrics.pauses import mean_speed, pause_share, source_speed
from tests.builders import SMALL


def places(*x):
    """One joint at these places along X."""
    return np.array(x, dtype=float)[:, None, None] * [1.0, 0.0, 0.0]


# --- share of pauses from pauses ----------------------------------------------------------------------------


def test_share_of_pause_frames_that_show_a_pause():
    paused = [False, True, True, True, True, False]
    speaking = [True, False, False, True]
    # Nodes 1, 3, 2, 2 are shown in the pause; a node counts as often as it is shown.
    assert pause_share(paused, [1, 1, 3, 2, 2, 0], speaking) == 0.75
    assert pause_share(paused, [1, 0, 3, 3, 0, 1], speaking) == 0.0
    assert pause_share(paused, [0, 1, 1, 2, 1, 0], speaking) == 1.0


def test_share_is_undefined_without_a_pause_on_either_side():
    assert math.isnan(pause_share([False, False], [0, 1], [True, False]))
    assert math.isnan(pause_share([True, True], [0, 1], [True, True]))
    assert math.isnan(pause_share([], [], [False]))
    assert pause_share([True, True], [0, 1], [False, False]) == 1.0


# --- speeds -------------------------------------------------------------------------------------------------


def test_a_frames_speed_leads_to_it():
    moved = places(0, 1, 3, 7)
    assert mean_speed(moved, [False, True, False, False], fps=10) == pytest.approx(10.0)
    assert mean_speed(moved, [False, False, True, True], fps=10) == pytest.approx(30.0)
    assert mean_speed(moved, [True] * 4, fps=30) == pytest.approx(70.0)


def test_the_first_frame_of_a_segment_has_no_speed():
    moved = places(0, 1, 100, 103)
    assert mean_speed(moved, [True] * 4, (0, 2), fps=1) == pytest.approx(2.0)
    assert mean_speed(moved, [False, False, True, True], (0, 2), fps=1) == pytest.approx(3.0)
    assert math.isnan(mean_speed(moved, [True, False, True, False], (0, 2), fps=1))


def test_speeds_are_of_all_joints_in_space():
    moved = np.zeros((2, 2, 3))
    moved[1] = [[3.0, 4.0, 0.0], [0.0, 0.0, 1.0]]
    assert mean_speed(moved, [True, True], fps=2) == pytest.approx(6.0)
    assert source_speed(moved, [1], fps=2) == pytest.approx(6.0)


def test_mean_speed_is_undefined_where_no_frame_has_one():
    moved = places(0, 1, 3)
    assert math.isnan(mean_speed(moved, [False] * 3, fps=30))
    assert math.isnan(mean_speed(moved, [True, False, False], fps=30))
    assert math.isnan(mean_speed(moved[:1], [True], fps=30))
    assert math.isnan(mean_speed(np.empty((3, 0, 3)), [True] * 3, fps=30))


def test_mean_speed_of_no_frames_is_undefined():
    assert math.isnan(mean_speed(np.empty((0, 1, 3)), [], fps=30))


def test_mean_speed_leaves_its_frames_alone():
    frames = np.ones(3, dtype=bool)
    mean_speed(places(0, 1, 3), frames, fps=30)
    assert frames.all()


def test_source_speed_counts_a_node_as_often_as_it_is_shown():
    recorded = places(0, 1, 3, 7)
    assert source_speed(recorded, [1, 2, 3], fps=1) == pytest.approx(7 / 3)
    assert source_speed(recorded, [1, 3, 3, 3], fps=1) == pytest.approx(13 / 4)
    assert source_speed(recorded, [3, 1], fps=10) == pytest.approx(25.0)


def test_source_speed_leaves_out_first_nodes_of_segments():
    recorded = places(0, 1, 100, 103)
    assert source_speed(recorded, [0, 1, 2, 3, 2], (0, 2), fps=1) == pytest.approx(2.0)
    assert math.isnan(source_speed(recorded, [0, 2, 2], (0, 2), fps=1))


def test_source_speed_is_undefined_without_nodes_or_joints():
    assert math.isnan(source_speed(places(0, 1), [], fps=30))
    assert math.isnan(source_speed(np.empty((2, 0, 3)), [1], fps=30))


def test_speeds_of_stored_floats_are_formed_in_double_precision():
    recorded = places(1e4, 1e4 + 0.5).astype(np.float32)
    assert source_speed(recorded, [1], fps=30) == mean_speed(recorded, [True, True], fps=30) == 15.0


def naive_speed(positions, frames, segment_starts, fps):
    """Over the given frame numbers, one joint at a time."""
    speeds = []
    for frame in frames:
        if frame not in segment_starts:
            for joint in range(positions.shape[1]):
                speeds.append(fps * math.dist(positions[frame, joint], positions[frame - 1, joint]))
    return sum(speeds) / len(speeds) if speeds else float("nan")


@SMALL
@given(st.integers(0, 10**6), st.integers(1, 12), st.integers(0, 3), st.sets(st.integers(0, 11)))
def test_speeds_equal_naive_ones(seed, count, joints, starts):
    rng = np.random.default_rng(seed)
    positions, frames = rng.normal(size=(count, joints, 3)), rng.random(count) < 0.5
    starts = sorted({0} | {start for start in starts if start < count})
    nodes = rng.integers(0, count, size=9)
    expected = naive_speed(positions, np.flatnonzero(frames).tolist(), starts, 30)
    assert mean_speed(positions, frames, starts, fps=30) == pytest.approx(expected, nan_ok=True)
    expected = naive_speed(positions, nodes.tolist(), starts, 30)
    assert source_speed(positions, nodes, starts, fps=30) == pytest.approx(expected, nan_ok=True)


@SMALL
@given(st.integers(0, 10**6), st.integers(0, 12), st.integers(1, 6))
def test_share_equals_a_naive_one(seed, count, n_nodes):
    rng = np.random.default_rng(seed)
    paused, shown, speaking = rng.random(count) < 0.5, rng.integers(0, n_nodes, size=count), rng.random(n_nodes) < 0.6
    rows = [not speaking[node] for node, pause in zip(shown.tolist(), paused.tolist(), strict=True) if pause]
    expected = sum(rows) / len(rows) if rows and not all(speaking) else float("nan")
    assert pause_share(paused, shown, speaking) == pytest.approx(expected, nan_ok=True)

"""Seam jerk on planted jumps, and join statistics."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.metrics.seams import join_statistics, seam_jerk
from tests.metrics import naive_metrics as naive

FPS = 10.0


def cubic(frames, scale=1.0):
    """One joint with x = scale * t^3, t in seconds: jerk 6 * scale everywhere."""
    positions = np.zeros((frames, 1, 3))
    positions[:, 0, 0] = scale * (np.arange(frames) / FPS) ** 3
    return positions


def test_copied_motion_has_ratio_one():
    source = cubic(40)
    seam = seam_jerk(source[5:35], [10, 20], np.arange(5, 35), source, [0], fps=FPS)
    assert seam.ratio == pytest.approx(1.0)
    assert seam.generated == pytest.approx(6.0) and seam.source == pytest.approx(6.0)
    assert seam.n_frames == 18


def test_a_jump_shows_in_three_frames():
    source = cubic(60)
    frames = np.concatenate([np.arange(0, 15), np.arange(15, 30)])
    output = source[frames].copy()
    output[15:, 0, 1] += 2.0  # a jump of 2 cm between frames 14 and 15
    seam = seam_jerk(output, [15], frames, source, [0], fps=FPS)
    # third difference of a step: 1, -2, 1 times 2 cm, at frames 14, 15, 16, at right angles to the motion's 6
    jump = np.array([2.0, 4.0, 2.0]) * FPS**3
    assert seam.generated == pytest.approx((6 * 6.0 + np.hypot(jump, 6.0).sum()) / 9)
    assert seam.ratio == pytest.approx(seam.generated / 6.0)
    assert seam_jerk(output, [15], frames, source, [0], fps=FPS, radius=0).generated == pytest.approx(np.hypot(4e3, 6))


def test_jerk_is_centred_on_the_seam():
    source = cubic(60)
    output = source[:30].copy()
    output[15:, 0, 1] += 2.0
    left = seam_jerk(output, [14], np.arange(30), source, [0], fps=FPS, radius=0).generated
    right = seam_jerk(output, [16], np.arange(30), source, [0], fps=FPS, radius=0).generated
    assert left == pytest.approx(right)
    assert seam_jerk(output, [13], np.arange(30), source, [0], fps=FPS, radius=0).ratio == pytest.approx(1.0)


def test_frames_near_two_seams_count_once():
    source = cubic(40)
    assert seam_jerk(source, [10, 12, 12], np.arange(40), source, [0], fps=FPS).n_frames == 11


def test_source_jerk_stays_inside_its_segment():
    source = np.concatenate([cubic(10), cubic(10, scale=3.0) + 500.0])  # a break between frames 9 and 10
    output = source[:10]
    seam = seam_jerk(output, [8], np.arange(10), source, [0, 10], fps=FPS)
    assert seam.source == pytest.approx(6.0)
    wild = seam_jerk(output, [8], np.arange(10, 20), source, [0, 10], fps=FPS)
    assert wild.source == pytest.approx(18.0) and wild.ratio == pytest.approx(1 / 3)


def test_frames_of_tiny_segments_count_on_neither_side():
    source = np.concatenate([cubic(10), np.random.default_rng(0).normal(size=(3, 1, 3))])
    shown = np.array([0, 1, 2, 3, 4, 10, 11, 12, 5, 6, 7])
    seam = seam_jerk(source[shown], [5], shown, source, [0, 10], fps=FPS, radius=3)
    assert seam.n_frames == 4  # 2, 3, 4 and 8; 5 to 7 show the segment of three frames


def test_joints_can_be_selected():
    source = np.concatenate([cubic(30), cubic(30, scale=5.0)], axis=1)
    one = seam_jerk(source, [15], np.arange(30), source, [0], fps=FPS, joints=[1])
    assert one.generated == pytest.approx(30.0)
    assert seam_jerk(source, [15], np.arange(30), source, [0], fps=FPS).generated == pytest.approx(18.0)


@pytest.mark.parametrize("frames", [0, 1, 2, 3])
def test_too_few_frames_are_undefined(frames):
    source = cubic(20)
    seam = seam_jerk(source[:frames], [1], np.arange(frames), source, [0], fps=FPS)
    assert np.isnan(seam.ratio) and np.isnan(seam.generated) and seam.n_frames == 0


def test_no_seam_and_static_source_are_undefined():
    source = cubic(20)
    assert np.isnan(seam_jerk(source, [], np.arange(20), source, [0], fps=FPS).ratio)
    static = seam_jerk(source, [9], np.arange(20), np.zeros((20, 1, 3)), [0], fps=FPS)
    assert np.isnan(static.ratio) and static.source == 0.0 and static.generated == pytest.approx(6.0)


def test_bad_frame_numbers_are_refused():
    source = cubic(20)
    with pytest.raises(ValueError, match="expected"):
        seam_jerk(source, [9], np.arange(19), source, [0], fps=FPS)
    with pytest.raises(ValueError, match="0 to 19"):
        seam_jerk(source, [9], np.arange(1, 21), source, [0], fps=FPS)
    with pytest.raises(ValueError, match="ascend from 0"):
        seam_jerk(source, [9], np.arange(20), source, [3], fps=FPS)


@settings(deadline=None, derandomize=True, max_examples=25)
@given(
    st.integers(0, 10**6),
    st.integers(8, 16),
    st.integers(0, 4),
    st.lists(st.integers(2, 7), min_size=1, max_size=4),
)
def test_equals_naive(seed, frames, radius, seams):
    rng = np.random.default_rng(seed)
    source, starts = rng.normal(size=(20, 2, 3)), [0, 7, 9, 14]
    positions, shown = rng.normal(size=(frames, 2, 3)), rng.choice([0, 3, 6, 9, 12, 13, 14, 19], size=frames)
    seam = seam_jerk(positions, seams, shown, source, starts, fps=30, radius=radius)
    generated, recorded = naive.seam_jerk(positions, seams, shown, source, starts, 30, radius)
    assert (seam.generated, seam.source) == pytest.approx((generated, recorded))


def test_join_statistics():
    joins = join_statistics([80.0, 0.0, 40.0], [False, True, False], n_frames=900, fps=30)
    assert (joins.n_joins, joins.n_hard) == (3, 2)
    assert joins.hard_per_minute == pytest.approx(4.0)
    assert (joins.mean_distance, joins.max_distance, joins.sum_distance) == (60.0, 80.0, 120.0)


def test_join_statistics_without_hard_joins():
    joins = join_statistics([0.0], [True], n_frames=900, fps=30)
    assert (joins.n_hard, joins.hard_per_minute, joins.sum_distance) == (0, 0.0, 0.0)
    assert np.isnan(joins.mean_distance) and np.isnan(joins.max_distance)
    assert np.isnan(join_statistics([], [], n_frames=0, fps=30).hard_per_minute)
    with pytest.raises(ValueError, match="parallel"):
        join_statistics([1.0], [], n_frames=9, fps=30)

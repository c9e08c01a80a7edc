"""Angle change rate, motion beats and both readings of beat consistency."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.metrics.beats import (
    angle_change_rate,
    beat_distance,
    beat_kernel,
    motion_beats,
    nearest_distances,
    selected_parents,
)
from tests.metrics import naive_metrics as naive

times = st.lists(st.floats(0, 10), min_size=1, max_size=8)


def arm(angles, length=20.0):
    """A root at (5, 5, 5) and one child that points in direction `angles` (radians) in the xy plane."""
    angles = np.asarray(angles, dtype=np.float64)
    positions = np.full((len(angles), 2, 3), 5.0)
    positions[:, 1, 0] += length * np.cos(angles)
    positions[:, 1, 1] += length * np.sin(angles)
    return positions


def test_rate_of_a_steady_turn():
    rates = angle_change_rate(arm(0.1 * np.arange(6)), [-1, 0], fps=25)
    assert np.isnan(rates[0])
    np.testing.assert_allclose(rates[1:], 2.5, rtol=1e-12)


def test_rate_keeps_its_digits_at_tiny_angles():
    rates = angle_change_rate(arm([0.0, 1e-9, 3e-9]), [-1, 0], fps=1)
    np.testing.assert_allclose(rates[1:], [1e-9, 2e-9], rtol=1e-5)  # acos would give 0


def test_rate_of_a_reversal_is_pi():
    assert angle_change_rate(arm([0.0, math.pi]), [-1, 0], fps=2)[1] == pytest.approx(2 * math.pi)


def test_rate_does_not_see_translation_or_length():
    still = angle_change_rate(arm([0.3] * 4) + np.arange(4)[:, None, None], [-1, 0], fps=30)
    np.testing.assert_allclose(still[1:], 0.0, atol=1e-12)
    longer = angle_change_rate(arm([0.0, 0.2], length=50.0), [-1, 0], fps=30)
    assert longer[1] == pytest.approx(6.0)


def test_direction_without_length_is_left_out():
    turning = arm(0.1 * np.arange(5))
    twist = turning[:, :1] + np.random.default_rng(0).normal(scale=1e-5, size=(5, 1, 3))
    rates = angle_change_rate(np.concatenate([turning, twist], axis=1), [-1, 0, 0], fps=10)
    np.testing.assert_allclose(rates[1:], 1.0, rtol=1e-9)


def test_a_direction_must_exist_in_both_frames():
    positions = arm(0.1 * np.arange(6))
    positions[2, 1] = positions[2, 0]
    rates = angle_change_rate(positions, [-1, 0], fps=1)
    np.testing.assert_allclose(rates, [np.nan, 0.1, np.nan, np.nan, 0.1, 0.1])


def test_rate_averages_over_joints():
    turning, still = arm([0.0, 0.4]), arm([0.0, 0.0])
    rates = angle_change_rate(np.concatenate([turning, still[:, 1:]], axis=1), [-1, 0, 0], fps=1)
    assert rates[1] == pytest.approx(0.2)


@pytest.mark.parametrize("frames", [0, 1])
def test_rate_of_too_few_frames_is_undefined(frames):
    rates = angle_change_rate(arm(np.zeros(frames)), [-1, 0], fps=30)
    assert rates.shape == (frames,) and np.isnan(rates).all()
    assert len(motion_beats(rates, fps=30)) == 0


def test_rate_without_any_direction_is_undefined():
    assert np.isnan(angle_change_rate(arm([0.0, 1.0]), [-1, -1], fps=30)).all()
    assert np.isnan(angle_change_rate(np.zeros((3, 2, 3)), [-1, 0], fps=30)).all()


def test_parents_must_fit():
    with pytest.raises(ValueError, match="do not fit"):
        angle_change_rate(arm([0.0, 1.0]), [-1, 0, 0], fps=30)


def test_selected_parents_skip_what_is_not_selected():
    # root - a - b - c, and d below a; a and b are not selected
    np.testing.assert_array_equal(selected_parents([-1, 0, 1, 2, 1], [0, 3, 4]), [-1, 0, 0])
    np.testing.assert_array_equal(selected_parents([-1, 0, 1, 2, 1], [1, 3, 2]), [-1, 2, 0])


def test_beats_of_a_swinging_arm():
    # angle -cos(2 pi t): |rate| peaks at the quarter and three-quarter points of each swing of one second
    fps = 100
    angles = -np.cos(2 * np.pi * np.arange(200) / fps)
    rates = angle_change_rate(arm(angles), [-1, 0], fps=fps)
    # frame t holds the turn since t - 1, so a peak of the rate half way between two frames falls on either
    np.testing.assert_allclose(motion_beats(rates, fps=fps), [0.25, 0.75, 1.25, 1.75], atol=1.01 / fps)
    dips = motion_beats(rates, fps=fps, extrema="minima")
    np.testing.assert_allclose(dips, [0.5, 1.0, 1.5], atol=1.01 / fps)


def test_beats_by_kind_of_extremum():
    rates = np.array([np.nan, 0.0, 2.0, 1.0, 1.0, 3.0, 0.0])
    np.testing.assert_allclose(motion_beats(rates, fps=10), [0.2, 0.5])
    np.testing.assert_allclose(motion_beats(rates, fps=10, extrema="minima"), [0.3])  # level: its middle
    np.testing.assert_allclose(motion_beats(rates, fps=10, extrema="both"), [0.2, 0.3, 0.5])
    with pytest.raises(ValueError, match="maxima, minima, both"):
        motion_beats(rates, fps=10, extrema="peaks")


def test_rounding_makes_no_beats():
    rates = angle_change_rate(arm(0.1 * np.arange(200)), [-1, 0], fps=30)
    assert len(motion_beats(rates, fps=30)) == 0
    assert len(motion_beats(rates, fps=30, min_prominence=0.0)) > 0


def test_static_motion_has_no_beats_and_the_worst_score():
    beats = motion_beats(angle_change_rate(arm(np.zeros(30)), [-1, 0], fps=30), fps=30)
    assert len(beats) == 0
    assert np.isnan(beat_distance([0.5], beats))
    assert beat_kernel([0.5], beats) == 0.0
    assert np.isnan(nearest_distances([0.5], beats)).all()


def test_no_onset_is_undefined():
    assert np.isnan(beat_distance([], [0.5]))
    assert np.isnan(beat_kernel([], [0.5]))
    assert np.isnan(beat_kernel([], []))


def test_known_distances():
    assert beat_distance([1.0, 2.0], [2.1, 0.7]) == pytest.approx((0.3 + 0.1) / 2)
    assert beat_kernel([1.0], [1.1]) == pytest.approx(math.exp(-0.5))
    assert beat_kernel([1.0], [1.3], sigma_seconds=0.3) == pytest.approx(math.exp(-0.5))
    assert beat_kernel([1.0, 2.0], [1.0, 2.0]) == 1.0


@settings(deadline=None, derandomize=True, max_examples=30)
@given(times, times, st.floats(0.05, 1))
def test_consistency_equals_naive(onsets, beats, sigma):
    assert beat_distance(onsets, beats) == pytest.approx(naive.beat_distance(onsets, beats), abs=1e-12)
    expected = naive.beat_kernel(onsets, beats, sigma)
    assert beat_kernel(onsets, beats, sigma_seconds=sigma) == pytest.approx(expected, abs=1e-12)


@settings(deadline=None, derandomize=True, max_examples=15)
@given(st.integers(0, 10**6), st.integers(2, 6))
def test_rate_equals_naive(seed, frames):
    positions = np.random.default_rng(seed).normal(scale=10, size=(frames, 4, 3))
    parents = [-1, 0, 1, 0]
    expected = naive.angle_change_rate(positions, parents, 30)
    np.testing.assert_allclose(angle_change_rate(positions, parents, fps=30), expected, rtol=1e-6)

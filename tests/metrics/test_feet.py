"""Foot skate on planted slides and lifts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.metrics.feet import foot_skate
from gesturegen.motion.feet import contacts
from tests.metrics import naive_metrics as naive


def foot(frames, speed=0.0, height=9.0):
    """One foot at a constant height that slides along x, `speed` in cm per frame."""
    positions = np.zeros((frames, 1, 3))
    positions[:, 0, 0] = speed * np.arange(frames)
    positions[:, 0, 1] = height
    return positions


def test_a_planted_foot_does_not_skate():
    assert foot_skate(foot(10), [0], fps=30) == (0.0, 1.0)


def test_a_sliding_foot_skates_at_its_speed():
    skate = foot_skate(foot(10, speed=0.5), [0], fps=30)
    assert skate.speed == pytest.approx(15.0) and skate.contact_share == 1.0


def test_vertical_motion_is_no_skate():
    positions = foot(10)
    positions[:, 0, 1] += np.linspace(0, 1, 10)
    assert foot_skate(positions, [0], fps=30).speed == 0.0


def test_a_lifted_foot_may_move():
    positions = foot(20)
    positions[8:12, 0, 1] += 10.0
    positions[9:, 0, 0] += 40.0  # moves while both frames 8 and 9 are in the air
    skate = foot_skate(positions, [0], fps=30)
    assert skate == (0.0, pytest.approx(16 / 20))


def test_both_frames_must_be_in_contact():
    positions = foot(20)
    positions[8:12, 0, 1] += 10.0
    positions[8:, 0, 2] += 40.0  # moves from frame 7, on the floor, to frame 8, in the air
    assert foot_skate(positions, [0], fps=30).speed == 0.0


def test_each_foot_has_its_own_floor():
    positions = np.concatenate([foot(10, speed=1.0), foot(10, height=14.0)], axis=1)
    skate = foot_skate(positions, [0, 1], fps=1)
    assert skate.speed == pytest.approx(0.5) and skate.contact_share == 1.0


def test_only_the_feet_count():
    positions = np.concatenate([foot(10, speed=5.0), foot(10, speed=2.0)], axis=1)
    assert foot_skate(positions, [1], fps=1).speed == pytest.approx(2.0)


def test_height_and_percentile_are_arguments():
    ramp = foot(11)
    ramp[:, 0, 1] = np.arange(11)
    assert contacts(ramp, height=2.0, floor_percentile=0).sum() == 3
    assert contacts(ramp, height=2.0, floor_percentile=50).sum() == 8


def test_one_frame_has_contact_but_no_speed():
    skate = foot_skate(foot(1), [0], fps=30)
    assert np.isnan(skate.speed) and skate.contact_share == 1.0
    assert foot_skate(foot(2, speed=1.0), [0], fps=30).speed == pytest.approx(30.0)


def test_nothing_to_measure_is_undefined():
    assert np.isnan(foot_skate(foot(0), [0], fps=30)).all()
    assert np.isnan(foot_skate(foot(5), [], fps=30)).all()


@settings(deadline=None, derandomize=True, max_examples=15)
@given(st.integers(0, 10**6), st.integers(2, 9))
def test_equals_naive(seed, frames):
    feet = np.random.default_rng(seed).normal(scale=2.0, size=(frames, 2, 3))
    expected = naive.foot_skate(feet, contacts(feet), 30)
    assert foot_skate(feet, [0, 1], fps=30).speed == pytest.approx(expected, nan_ok=True)

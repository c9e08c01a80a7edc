"""Syn: analytic, naive and edge cases."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.metrics.synchrony import mean_speed, synchrony
from tests.metrics import naive_metrics as naive


def line(frames, *speeds):
    """Joints that move along x, each at its own constant speed in cm per frame."""
    positions = np.zeros((frames, len(speeds), 3))
    positions[..., 0] = np.arange(frames)[:, None] * np.array(speeds)
    return positions


def test_constant_speeds_differ_by_their_difference():
    assert synchrony(line(6, 3.0, 1.0), line(6, 1.0, 1.5)) == pytest.approx((2.0 + 0.5) / 2)


def test_direction_and_place_do_not_count():
    moved = line(5, 2.0)[:, :, [2, 0, 1]] * -1 + 100
    assert synchrony(line(5, 2.0), moved) == pytest.approx(0.0, abs=1e-12)


def test_against_a_statue_it_is_the_mean_speed():
    positions = np.random.default_rng(0).normal(size=(9, 4, 3))
    statue = np.zeros_like(positions)
    assert synchrony(statue, positions) == pytest.approx(mean_speed(positions))
    assert mean_speed(line(4, 3.0, 1.0)) == pytest.approx(2.0)


def test_longer_motion_is_cut():
    generated, truth = line(8, 1.0), line(5, 1.0)
    generated[5:, :, 1] = 50.0
    assert synchrony(generated, truth) == 0.0
    assert synchrony(truth, generated) == 0.0


@pytest.mark.parametrize("frames", [0, 1])
def test_too_few_common_frames_are_undefined(frames):
    assert np.isnan(synchrony(line(5, 1.0), line(frames, 1.0)))
    assert np.isnan(mean_speed(line(frames, 1.0)))


def test_two_frames_are_enough():
    assert synchrony(line(2, 1.0), line(2, 4.0)) == pytest.approx(3.0)


def test_other_joints_are_refused():
    with pytest.raises(ValueError, match="expected the same"):
        synchrony(line(5, 1.0), line(5, 1.0, 2.0))


@settings(deadline=None, derandomize=True, max_examples=20)
@given(st.integers(0, 10**6), st.integers(2, 7), st.integers(2, 7), st.integers(1, 4))
def test_equals_naive(seed, frames, other_frames, joints):
    rng = np.random.default_rng(seed)
    generated, truth = rng.normal(size=(frames, joints, 3)), rng.normal(size=(other_frames, joints, 3))
    assert synchrony(generated, truth) == pytest.approx(naive.synchrony(generated, truth))
    assert synchrony(generated, truth) == pytest.approx(synchrony(truth, generated))

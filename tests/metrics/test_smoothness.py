"""Acceleration and jerk of known curves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.metrics.smoothness import (
    difference_norms,
    joint_accelerations,
    joint_jerks,
    mean_acceleration,
    mean_jerk,
)
from tests.metrics import naive_metrics as naive


def curve(x, frames=12, fps=10.0):
    """One joint with x(t), t in seconds, at z = 4."""
    positions = np.full((frames, 1, 3), 4.0)
    positions[:, 0, 0] = x(np.arange(frames) / fps)
    return positions


def test_constant_velocity_has_no_acceleration_and_no_jerk():
    positions = curve(lambda t: 7 * t)
    assert mean_acceleration(positions, fps=10) == pytest.approx(0.0, abs=1e-10)
    assert mean_jerk(positions, fps=10) == pytest.approx(0.0, abs=1e-9)


def test_polynomials_are_exact():
    assert mean_acceleration(curve(lambda t: t**2), fps=10) == pytest.approx(2.0)
    assert mean_jerk(curve(lambda t: t**3), fps=10) == pytest.approx(6.0)


def test_circle():
    fps, omega, radius = 200.0, 2.0, 30.0
    t = np.arange(100) / fps
    positions = radius * np.stack([np.cos(omega * t), 0 * t, np.sin(omega * t)], axis=-1)[:, None]
    assert mean_acceleration(positions, fps=fps) == pytest.approx(radius * omega**2, rel=1e-3)
    assert mean_jerk(positions, fps=fps) == pytest.approx(radius * omega**3, rel=1e-3)


def test_joints_are_averaged():
    positions = np.concatenate([curve(lambda t: t**3), curve(lambda t: -2 * t**3)], axis=1)
    np.testing.assert_allclose(joint_jerks(positions, fps=10), [6.0, 12.0])
    assert mean_jerk(positions, fps=10) == pytest.approx(9.0)
    np.testing.assert_allclose(joint_accelerations(positions[:3], fps=10), [0.6, 1.2])


def test_fps_scales_by_its_power():
    positions = np.random.default_rng(1).normal(size=(10, 2, 3))
    assert mean_jerk(positions, fps=60) == pytest.approx(8 * mean_jerk(positions, fps=30))
    assert mean_acceleration(positions, fps=60) == pytest.approx(4 * mean_acceleration(positions, fps=30))


@pytest.mark.parametrize("frames", [0, 1, 2, 3])
def test_too_few_frames_are_undefined(frames):
    positions = np.zeros((frames, 2, 3))
    assert joint_jerks(positions, fps=30).shape == (2,) and np.isnan(mean_jerk(positions, fps=30))
    assert np.isnan(mean_acceleration(positions, fps=30)) == (frames < 3)


def test_no_joint_is_undefined():
    assert np.isnan(mean_jerk(np.zeros((9, 0, 3)), fps=30))


def test_shape_is_checked():
    with pytest.raises(ValueError, match="expected"):
        difference_norms(np.zeros((9, 75)), 1)


def test_float32_input_is_computed_in_float64():
    positions = curve(lambda t: t**3).astype(np.float32)
    assert mean_jerk(positions, fps=10) == mean_jerk(positions.astype(np.float64), fps=10)


@settings(deadline=None, derandomize=True, max_examples=15)
@given(st.integers(0, 10**6), st.integers(4, 8), st.integers(1, 3))
def test_equals_naive(seed, frames, joints):
    positions = np.random.default_rng(seed).normal(size=(frames, joints, 3))
    assert mean_jerk(positions, fps=30) == pytest.approx(naive.mean_jerk(positions, 30))

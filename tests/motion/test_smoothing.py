"""Savitzky-Golay smoothing of rotations and positions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from gesturegen.motion import rotation
from gesturegen.motion.skeleton import Motion
from gesturegen.motion.smoothing import savitzky_golay
from gesturegen.settings.models import Smoothing
from tests.builders import SMALL, chain, random_motion, random_quaternions

NONE, ALL = np.array([], dtype=int), np.arange(3)
SETTINGS = Smoothing(enabled=True)
AXIS = np.array([2.0, -1.0, 2.0]) / 3.0


def turning(angles, axis=AXIS, joint=1):
    """Three joints, one of which turns by `angles` (radians) about `axis`."""
    bones = chain(3)
    rotations = np.tile(rotation.IDENTITY, (len(angles), 3, 1))
    half = np.asarray(angles) / 2.0
    rotations[:, joint] = np.column_stack([np.cos(half), np.sin(half)[:, None] * axis])
    return Motion(bones, rotations, np.tile(bones.offsets, (len(angles), 1, 1)), 30.0)


def jitter(motion):
    """Mean angle of the second difference of every joint, radians."""
    steps = rotation.multiply(rotation.inverse(motion.rotations[:-1]), motion.rotations[1:])
    return rotation.angle_between(steps[:-1], steps[1:]).mean()


# --- full turns ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", (1, 2, 3))
def test_a_spin_through_several_turns_keeps_its_speed(order):
    step = np.radians(10.0)
    motion = turning(step * np.arange(120))
    # As files have them: exponential maps wrap at half a turn, so that the sign of the quaternions changes.
    wrapped = rotation.from_expmap(rotation.to_expmap(motion.rotations))
    assert (np.sum(wrapped[1:, 1] * wrapped[:-1, 1], axis=-1) < 0).any()
    motion = Motion(motion.skeleton, wrapped, motion.positions, 30.0)
    smooth = savitzky_golay(motion, ALL, Smoothing(window=7, limb_order=order, order=0))
    off = rotation.angle_between(smooth.rotations, motion.rotations)[:, 1]
    # The components are cosine and sine of one angle and the filter is even: it shrinks both alike, which
    # normalising undoes. At the ends the parabola through seven frames misses t^3 by 6 frames^3 at most, so
    # that a component is off by (step / 2)^3 and the angle by twice that: 0.0762 degrees, measured 0.0756.
    # A straight line misses t^2 (measured 0.479 degrees), a cubic only t^4 (0.0005).
    assert off[3:-3].max() < 1e-7
    assert off.max() < np.radians({1: 0.5, 2: 0.08, 3: 0.001}[order])
    speeds = rotation.angle_between(smooth.rotations[:-1, 1], smooth.rotations[1:, 1])
    np.testing.assert_allclose(speeds, step, atol=np.radians({1: 0.5, 2: 0.16, 3: 0.002}[order]))


@SMALL
@given(st.integers(0, 10**6))
def test_the_sign_of_a_quaternion_says_nothing(seed):
    rng = np.random.default_rng(seed)
    motion = turning(rng.normal(scale=0.3, size=40).cumsum())
    flipped = motion.rotations * rng.choice([-1.0, 1.0], size=(40, 3, 1))
    expected = savitzky_golay(motion, ALL, SETTINGS)
    found = savitzky_golay(Motion(motion.skeleton, flipped, motion.positions, 30.0), ALL, SETTINGS)
    assert rotation.angle_between(found.rotations, expected.rotations).max() < 1e-7


def test_a_spin_of_whole_turns_within_the_window_stays_as_it_is():
    # Seven frames go round the quaternions' circle once: their mean is nothing.
    motion = turning(2.0 * 2.0 * np.pi / 7.0 * np.arange(30))
    smooth = savitzky_golay(motion, NONE, Smoothing(window=7, order=0))
    np.testing.assert_allclose(np.linalg.norm(smooth.rotations, axis=-1), 1.0, atol=1e-12)
    assert rotation.angle_between(smooth.rotations, motion.rotations).max() < 1e-7


# --- orders -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("window", "limb_order", "order"), [(7, 2, 1), (9, 3, 0), (5, 1, 4)])
def test_each_joint_has_the_order_of_its_part(window, limb_order, order):
    rng = np.random.default_rng(3)
    times = np.linspace(-1.0, 1.0, 40)
    angles = 0.02 * np.column_stack([times**2 + 0.3 * times, 1.0 - times**2, 0.5 * times**2])
    angles += 0.002 * rng.normal(size=angles.shape)
    half = angles / 2.0
    rotations = np.stack([np.cos(half), np.sin(half), 0.0 * half, 0.0 * half], axis=-1)
    motion = Motion(chain(3), rotations, np.tile(chain(3).offsets, (40, 1, 1)), 30.0)
    smooth = savitzky_golay(motion, np.array([0, 2]), Smoothing(window=window, limb_order=limb_order, order=order))
    found = rotation.to_expmap(smooth.rotations)
    for joint, used in enumerate((limb_order, order, limb_order)):
        expected = savgol_filter(angles[:, joint], window, used)
        # Sines of half angles below 0.015 are the half angles but for their cube, 0.6e-6.
        np.testing.assert_allclose(found[:, joint, 0], expected, atol=1e-6)
        other = savgol_filter(angles[:, joint], window, order if used == limb_order else limb_order)
        assert np.abs(other - expected).max() > 2e-5
    np.testing.assert_allclose(found[..., 1:], 0.0, atol=1e-15)


@pytest.mark.parametrize("limbs", (NONE, ALL), ids=("no limbs", "all limbs"))
def test_positions_that_travel_have_the_order_of_the_body(limbs):
    motion = random_motion(chain(3), 30)
    smooth = savitzky_golay(motion, limbs, Smoothing(window=7, limb_order=4, order=1))
    np.testing.assert_allclose(smooth.positions[:, 0], savgol_filter(motion.positions[:, 0], 7, 1, axis=0), atol=1e-12)
    np.testing.assert_array_equal(smooth.positions[:, 1:], motion.positions[:, 1:])


def test_what_does_not_move_stays_to_the_bit():
    pose = random_quaternions(np.random.default_rng(0), 1, 3)
    bones = chain(3)
    motion = Motion(bones, np.repeat(pose, 20, axis=0), np.tile(bones.offsets / 7.0, (20, 1, 1)), 30.0)
    smooth = savitzky_golay(motion, np.array([1]), SETTINGS)
    np.testing.assert_array_equal(smooth.rotations, motion.rotations)
    np.testing.assert_array_equal(smooth.positions, motion.positions)


# --- in general ---------------------------------------------------------------------------------------------


def test_jitter_becomes_less():
    rng = np.random.default_rng(1)
    clean = turning(0.8 * np.sin(np.arange(200) / 15.0))
    noise = rotation.from_expmap(rng.normal(scale=0.02, size=(200, 3, 3)))
    noisy = Motion(clean.skeleton, rotation.multiply(clean.rotations, noise), clean.positions, 30.0)
    smooth = savitzky_golay(noisy, np.array([1]), SETTINGS)
    assert jitter(smooth) < 0.3 * jitter(noisy)
    error = [rotation.angle_between(m.rotations, clean.rotations).mean() for m in (smooth, noisy)]
    assert error[0] < 0.7 * error[1]


@pytest.mark.parametrize("frames", (1, 2, 6))
def test_a_motion_shorter_than_the_window_is_returned(frames):
    motion = random_motion(chain(3), frames)
    assert savitzky_golay(motion, ALL, SETTINGS) is motion


def test_a_motion_as_long_as_the_window_is_filtered():
    motion = random_motion(chain(3), 7)
    smooth = savitzky_golay(motion, NONE, SETTINGS)
    # One polynomial, a straight line, for all seven frames.
    np.testing.assert_allclose(np.diff(smooth.positions, n=2, axis=0), 0.0, atol=1e-12)


@SMALL
@given(st.integers(1, 30), st.integers(0, 10**6), st.sampled_from([3, 5, 7, 11]), st.integers(0, 2), st.integers(0, 2))
def test_rotations_stay_rotations(frames, seed, window, limb_order, order):
    rng = np.random.default_rng(seed)
    motion = random_motion(chain(4), frames, seed)
    before = motion.rotations.copy(), motion.positions.copy()
    limbs = np.flatnonzero(rng.random(4) < 0.5)
    smooth = savitzky_golay(motion, limbs, Smoothing(window=window, limb_order=limb_order, order=order))
    assert smooth.rotations.shape == (frames, 4, 4) and smooth.positions.shape == (frames, 4, 3)
    np.testing.assert_allclose(np.linalg.norm(smooth.rotations, axis=-1), 1.0, atol=1e-12)
    assert np.isfinite(smooth.positions).all()
    assert smooth.skeleton is motion.skeleton and smooth.fps == motion.fps
    np.testing.assert_array_equal(motion.rotations, before[0])
    np.testing.assert_array_equal(motion.positions, before[1])

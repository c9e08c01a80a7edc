"""Div: polygons, the floor, the denominator."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.metrics.diversity import direction_change_share, turning_angles
from tests.metrics import naive_metrics as naive


def polygon(corners, frames, side=1.0):
    """One joint that walks round a regular polygon, one side per frame, turning by 360 / corners."""
    headings = np.arange(frames - 1) * 2 * np.pi / corners
    steps = side * np.stack([np.cos(headings), np.zeros(frames - 1), np.sin(headings)], axis=-1)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])[:, None]


@pytest.mark.parametrize(("corners", "expected"), [(3, 1.0), (7, 1.0), (9, 0.0), (40, 0.0)])
def test_polygons_turn_by_their_outer_angle(corners, expected):
    assert direction_change_share(polygon(corners, 20)) == expected
    np.testing.assert_allclose(turning_angles(polygon(corners, 20))[0], 2 * np.pi / corners, rtol=1e-9)


def test_angle_is_an_argument():
    assert direction_change_share(polygon(9, 20), min_angle_degrees=39) == 1.0
    assert direction_change_share(polygon(9, 20), min_angle_degrees=41) == 0.0


def test_both_speeds_must_reach_the_floor():
    zigzag = np.zeros((5, 1, 3))
    zigzag[:, 0, 0] = [0.0, 1.0, 0.95, 1.95, 0.95]  # velocities 1, -0.05, 1, -1: only the last turn counts
    assert direction_change_share(zigzag) == pytest.approx(1 / 3)
    assert direction_change_share(zigzag, speed_floor=0.05 - 1e-9) == 1.0
    assert direction_change_share(zigzag, speed_floor=2.0) == 0.0


def test_joints_at_rest_stay_in_the_denominator():
    moving = polygon(4, 10)
    assert direction_change_share(np.concatenate([moving, np.zeros((10, 3, 3))], axis=1)) == pytest.approx(0.25)


def test_static_motion_never_turns():
    assert direction_change_share(np.ones((6, 2, 3)), speed_floor=0.0) == 0.0


@pytest.mark.parametrize("frames", [0, 1, 2])
def test_too_few_frames_are_undefined(frames):
    assert np.isnan(direction_change_share(np.zeros((frames, 2, 3))))


def test_three_frames_are_enough():
    assert direction_change_share(polygon(4, 3)) == 1.0


@settings(deadline=None, derandomize=True, max_examples=20)
@given(st.integers(0, 10**6), st.integers(3, 8), st.floats(1, 179), st.floats(0, 2))
def test_equals_naive(seed, frames, degrees, floor):
    positions = np.random.default_rng(seed).normal(size=(frames, 3, 3))
    share = direction_change_share(positions, min_angle_degrees=degrees, speed_floor=floor)
    assert share == pytest.approx(naive.direction_change_share(positions, degrees, floor))

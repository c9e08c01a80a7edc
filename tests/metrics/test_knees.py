"""Planted knees."""

import numpy as np
import pytest

from gesturegen.metrics import knees


def leg(degrees):
    """A hip above a knee above an ankle, bent by so much."""
    bend = np.radians(180.0 - np.asarray(degrees, dtype=float))
    hip, knee = np.tile([0.0, 80.0, 0.0], (len(bend), 1)), np.tile([0.0, 40.0, 0.0], (len(bend), 1))
    ankle = knee + 40.0 * np.column_stack([np.zeros(len(bend)), -np.cos(bend), -np.sin(bend)])
    return np.stack([hip, knee, ankle], axis=1)[:, None]


def measured(*legs):
    angles = knees.knee_angles(np.concatenate(legs, axis=1))
    return angles, knees.knees(angles, knees.knee_accelerations(angles, fps=30), fps=30)


def test_angles_of_known_legs():
    angles, found = measured(leg([180.0, 177.5, 176.5, 90.0]))
    assert angles[:, 0] == pytest.approx([180.0, 177.5, 176.5, 90.0])
    assert found.straight_share == 0.5


def test_shares_are_of_frames_and_knees():
    assert measured(leg([178.0] * 10), leg([170.0] * 10))[1].straight_share == 0.5


def test_a_jump_is_one_snap_and_a_slow_bend_none():
    # One jump of 8 degrees at 30 fps: second differences of 7200 degrees/s^2 in two frames beside one another.
    jump = [160.0] * 30 + [168.0] * 30
    assert measured(leg(jump), leg([160.0] * 60))[1].snaps_per_minute == 1 / (2 / 60)
    assert measured(leg(jump), leg(jump))[1].snaps_per_minute == 1 / (2 / 60)
    assert measured(leg(np.linspace(90, 175, 60)))[1].snaps_per_minute == 0
    twice = [160.0] * 20 + [168.0] * 20 + [160.0] * 20
    assert measured(leg(twice))[1].snaps_per_minute == 2 / (2 / 60)


def test_without_legs_there_is_no_figure():
    assert np.isnan(knees.knees(np.empty((9, 0)), np.empty((9, 0)), fps=30)).all()
    assert not knees.knee_accelerations(np.full((2, 1), 170.0), fps=30).any()

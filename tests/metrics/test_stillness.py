"""Planted rests of the hands."""

import numpy as np
import pytest

from gesturegen.metrics import stillness


def speeds(*stretches):
    """Of two hands: (frames, left, right)."""
    return np.concatenate([np.tile([[left, right]], (frames, 1)) for frames, left, right in stretches])


def test_planted_rests():
    # 100 frames: a rest of 15, one of 9 (too short at 30 fps), one in which only one hand rests.
    found = stillness.stillness(speeds((30, 50, 50), (15, 9, 1), (21, 50, 50), (9, 2, 2), (25, 2, 50)), fps=30)
    assert found == (0.15, 0.5)


def test_pauses_do_not_count_and_cut_rests():
    curves = speeds((40, 1, 1), (60, 50, 50))
    paused = np.zeros(100, dtype=bool)
    paused[:20] = True
    assert stillness.stillness(curves, paused, fps=30) == (0.25, pytest.approx(20 / 30))
    paused[:32] = True  # leaves 8 frames
    assert stillness.stillness(curves, paused, fps=30) == (0.0, 0.0)
    assert np.isnan(stillness.stillness(curves, np.ones(100, dtype=bool), fps=30)).all()
    assert np.isnan(stillness.stillness(np.empty((100, 0)), fps=30)).all()


def test_speed_of_known_motion():
    hands = np.zeros((5, 1, 3))
    hands[:, 0, 1] = np.arange(5) * 0.5
    assert stillness.hand_speeds(hands, fps=30) == pytest.approx(15.0)


def test_a_statue_is_one_from_half_of_the_clip_on():
    assert not stillness.is_statue(speeds((50, 0, 0), (50, 90, 90)), fps=30)
    assert stillness.is_statue(speeds((51, 0, 0), (49, 90, 90)), fps=30)
    assert not stillness.is_statue(np.empty((50, 0)), fps=30)

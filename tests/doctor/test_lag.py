"""Lag and drift of sound and motion on curves that were moved apart by a known time."""

import numpy as np
import pytest

from gesturegen.doctor import lag

FPS = 30.0


def recording(seconds=60.0, late=0.0, faster=1.0, seed=0):
    """Speech in phrases, and hands that are fast while it lasts and faster at each onset; `late` s and `faster` times."""
    rng = np.random.default_rng(seed)
    n = round(seconds * FPS)
    bounds = np.cumsum(rng.uniform(0.6, 3.5, 200))
    phrases = [(a, b) for a, b in zip(bounds[::2], bounds[1::2], strict=True) if b < seconds]
    onsets = np.array(sorted(t for a, b in phrases for t in np.arange(a, b, 0.45)))
    times = np.arange(n) / FPS
    speaking = np.any([(times >= a) & (times < b) for a, b in phrases], axis=0)
    heard = (times - late) * faster
    moving = np.any([(heard >= a) & (heard < b) for a, b in phrases], axis=0)
    speeds = 4 + 30 * moving + sum(25 * np.exp(-((heard - t) ** 2) / 0.02) for t in onsets) + rng.uniform(0, 3, n)
    return speaking, onsets, speeds, FPS


@pytest.mark.parametrize("late", (0.0, 1.5, -0.7, 6.0))
def test_a_lag_is_found(late):
    found = lag.measure(*recording(late=late))
    assert found.sure and found.seconds == pytest.approx(late, abs=0.15)


@pytest.mark.parametrize("seed", range(5))
def test_sound_and_motion_of_different_recordings_have_no_sure_lag(seed):
    speaking, onsets, _, fps = recording(seed=seed)
    assert not lag.measure(speaking, onsets, recording(seed=seed + 100)[2], fps).sure


def test_what_never_changes_or_is_short_has_no_lag():
    speaking, onsets, speeds, fps = recording()
    assert lag.measure(np.ones(len(speaking), dtype=bool), onsets, speeds, fps) is None
    assert lag.measure(speaking, onsets, np.full(len(speeds), 5.0), fps) is None
    assert lag.measure(speaking[:300], onsets, speeds, fps) is None
    assert not lag.measure(speaking, np.zeros(0), speeds, fps).sure


@pytest.mark.parametrize(("faster", "late"), [(0.97, 0.0), (1.03, 0.0), (0.98, 1.0)])
def test_drift_is_the_growth_of_the_lag(faster, late):
    seconds = 60.0
    assert lag.drift(*recording(seconds, late, faster)) == pytest.approx(seconds * (1 / faster - 1), abs=0.5)


@pytest.mark.parametrize("seed", range(3))
def test_what_runs_alike_or_is_not_alike_has_no_drift(seed):
    speaking, onsets, speeds, fps = recording(seed=seed)
    assert lag.drift(speaking, onsets, speeds, fps) is None
    assert lag.drift(speaking, onsets, recording(seed=seed + 100)[2], fps) is None
    assert lag.drift(*recording(15.0)) is None

"""Planted beats: on the onsets, beside them, and anywhere."""

import numpy as np
import pytest

from gesturegen.metrics import alignment
from gesturegen.metrics.beats import nearest_distances


def test_beats_on_the_onsets_are_over_chance():
    rng = np.random.default_rng(3)
    onsets = np.sort(rng.choice(np.arange(900), 40, replace=False))
    on, lagging, elsewhere = (
        alignment.surplus(onsets, [beats], 900, fps=30, sigma_seconds=0.1)
        for beats in (onsets, (onsets + 3) % 900, rng.choice(np.arange(900), 40, replace=False))
    )
    assert on.z > 5 and on.surplus > lagging.surplus > elsewhere.surplus
    assert abs(elsewhere.z) < 2.5


def test_many_beats_earn_nothing():
    """A kernel would give this motion, which hears nothing, nearly 1."""
    found = alignment.surplus(np.arange(7, 900, 31), [np.arange(0, 900, 2)], 900, fps=30, sigma_seconds=0.3)
    assert abs(found.surplus) < 1e-3
    always = alignment.surplus([5, 9], [np.arange(30)], 30, fps=30, sigma_seconds=0.3)
    assert always.surplus == 0 and np.isnan(always.z)


def test_surplus_is_that_of_the_obvious_computation():
    onsets, beats, n_frames = np.array([3, 20, 31]), [np.array([4, 17]), np.array([30])], 40
    scores = []
    for turn in range(n_frames):
        turned = (onsets + turn) % n_frames / 30
        scores.append(
            np.mean([np.exp(-0.5 * (nearest_distances(turned, own / 30) / 0.3) ** 2).mean() for own in beats])
        )
    found = alignment.surplus(onsets, [*beats, np.empty(0, int)], n_frames, fps=30, sigma_seconds=0.3)
    assert found.surplus == pytest.approx(scores[0] - np.mean(scores))
    assert found.deviation == pytest.approx(np.std(scores))
    assert found.z == pytest.approx(found.surplus / found.deviation)


def test_without_evidence_there_is_no_figure():
    for onsets, beats in (([], [np.array([3])]), ([3], []), ([3], [np.empty(0, int)]), ([99], [np.array([3])])):
        assert np.isnan(alignment.surplus(onsets, beats, 40, fps=30, sigma_seconds=0.3)).all()
    assert np.isnan(alignment.together([alignment.NONE])).all()


def test_clips_together():
    clips = [alignment.Surplus(0.2, 0.1, 2.0), alignment.NONE, alignment.Surplus(0.0, 0.1, 0.0)]
    found = alignment.together(clips)
    assert found.surplus == pytest.approx(0.1) and found.z == pytest.approx(0.2 / np.hypot(0.1, 0.1))


def test_minima_of_known_speeds():
    frames = np.arange(60)
    # Slowest at 15 and 45; the second joint rests there, which is no beat; the third never slows down.
    speeds = np.column_stack([2 + np.cos(2 * np.pi * (frames - 30) / 30), np.abs(frames - 15.0), np.ones(60)])
    assert [list(own) for own in alignment.speed_minima(speeds)] == [[15, 45], [], []]
    assert list(alignment.speed_minima(speeds, least_share=-1.0)[1]) == [15]


def test_speeds_of_known_motion():
    positions = np.zeros((4, 1, 3))
    positions[:, 0, 2] = [0, 1, 4, 9]
    assert alignment.speeds(positions)[:, 0] == pytest.approx([1, 2, 4, 5])

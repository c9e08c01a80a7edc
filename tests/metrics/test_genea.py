"""Speed histograms, Hellinger distance, CCA, and the figures of the published GENEA scripts."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.metrics.genea import canonical_correlation, genea_compat, hellinger_distance, speed_histogram
from tests.metrics import naive_metrics as naive

histograms = st.lists(st.integers(0, 50), min_size=4, max_size=4).filter(any)


def steps(*speeds):
    """One joint that moves along x by the given steps, cm per frame."""
    positions = np.zeros((len(speeds) + 1, 1, 3))
    positions[1:, 0, 0] = np.cumsum(speeds)
    return positions


def test_histogram_of_known_speeds():
    counts = speed_histogram(steps(0.25, 0.5, 0.25, 24.5, 26.0), fps=2)
    assert counts.shape == (50,)
    assert (counts[0], counts[1], counts[49]) == (2, 1, 1)
    assert counts.sum() == 4  # 52 cm/s is above the range


def test_histogram_widths_and_range():
    fine = speed_histogram(steps(0.25, 0.5), fps=2, bin_width=0.05)
    assert fine.shape == (1000,) and fine.sum() == 2
    assert speed_histogram(steps(0.25), fps=2, top_speed=49).shape == (49,)


@pytest.mark.parametrize("frames", [0, 1])
def test_histogram_of_too_few_frames_is_empty(frames):
    counts = speed_histogram(np.zeros((frames, 2, 3)), fps=30)
    assert counts.sum() == 0
    assert np.isnan(hellinger_distance(counts, counts))


def test_static_motion_is_all_in_the_first_bin():
    counts = speed_histogram(np.ones((5, 2, 3)), fps=30)
    assert counts[0] == counts.sum() == 8


@settings(deadline=None, derandomize=True, max_examples=15)
@given(st.integers(0, 10**6), st.sampled_from([1.0, 0.25]))
def test_histogram_equals_naive(seed, width):
    positions = np.random.default_rng(seed).normal(scale=0.7, size=(8, 3, 3))
    counts = speed_histogram(positions, fps=30, bin_width=width)
    assert counts.tolist() == naive.speed_histogram(positions, 30, width, len(counts))


def test_hellinger_ends():
    assert hellinger_distance([1, 2, 3], [2, 4, 6]) == pytest.approx(0.0, abs=1e-7)
    assert hellinger_distance([1, 0], [0, 5]) == 1.0
    assert hellinger_distance([1, 1], [1, 0]) == pytest.approx(np.sqrt(1 - np.sqrt(0.5)))
    with pytest.raises(ValueError, match="expected the same"):
        hellinger_distance([1, 1], [1, 1, 1])


@settings(deadline=None, derandomize=True, max_examples=30)
@given(histograms, histograms, histograms)
def test_hellinger_is_a_metric(a, b, c):
    assert hellinger_distance(a, b) == pytest.approx(hellinger_distance(b, a))
    assert 0 <= hellinger_distance(a, c) <= hellinger_distance(a, b) + hellinger_distance(b, c) + 1e-6
    # the same as the distance of the roots, which has no cancellation
    roots = [np.sqrt(np.array(h) / sum(h)) for h in (a, b)]
    assert hellinger_distance(a, b) == pytest.approx(np.linalg.norm(roots[0] - roots[1]) / np.sqrt(2), abs=1e-7)


def motions(seed, frames=60, joints=2):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(frames, joints, 3)), rng.normal(size=(frames, joints, 3))


@pytest.mark.parametrize("seed", range(5))
def test_cca_equals_the_textbook(seed):
    x, y = motions(seed)
    expected = naive.canonical_correlation(x.reshape(60, -1), y.reshape(60, -1))
    assert canonical_correlation(x, y) == pytest.approx(expected)


def test_cca_finds_a_hidden_shared_direction():
    x, y = motions(0, frames=400)
    y[:, 1, 2] = 3 * x[:, 0, 0] - x[:, 1, 1] + 0.01 * y[:, 0, 0]
    assert canonical_correlation(x, y) > 0.999
    assert canonical_correlation(*motions(0, frames=400)) < 0.4


def test_cca_ignores_linear_maps_and_repeated_coordinates():
    x, y = motions(3)
    mixed = (x.reshape(60, 6) @ (np.eye(6) + 0.3 * np.ones((6, 6))) + 70).reshape(60, 2, 3)
    assert canonical_correlation(mixed, y) == pytest.approx(canonical_correlation(x, y))
    repeated = np.concatenate([x, x[:, :1], np.full((60, 1, 3), 33.3)], axis=1)
    assert canonical_correlation(repeated, y) == pytest.approx(canonical_correlation(x, y))
    assert canonical_correlation(y, x) == pytest.approx(canonical_correlation(x, y))


def test_cca_truncation_keeps_out_small_noise():
    x, y = motions(4)
    x[:, 1] *= 1e-5
    full_rank = canonical_correlation(x[:, :1], y)
    assert canonical_correlation(x, y) == pytest.approx(full_rank, abs=1e-4)
    assert canonical_correlation(x, y, rank_tolerance=1e-9) > full_rank + 1e-3


def test_cca_cuts_the_longer_motion():
    x, y = motions(5)
    assert canonical_correlation(x, y[:40]) == pytest.approx(canonical_correlation(x[:40], y[:40]))


@pytest.mark.parametrize("frames", [0, 1, 2, 3, 12])
def test_cca_is_undefined_when_there_are_too_few_frames_for_the_coordinates(frames):
    x, y = motions(6, frames=frames)
    assert np.isnan(canonical_correlation(x, y))
    assert not np.isnan(canonical_correlation(*motions(6, frames=13)))


def test_cca_of_a_static_motion_is_undefined():
    x, y = motions(7)
    assert np.isnan(canonical_correlation(np.full_like(x, 91.7), y))
    assert np.isnan(canonical_correlation(np.zeros_like(x), y))


def test_compat_differs_from_the_plain_figures_as_stated():
    rng = np.random.default_rng(8)
    positions = np.cumsum(rng.normal(scale=0.4, size=(50, 10, 3)), axis=0)
    compat = genea_compat(positions, fps=30)
    plain = speed_histogram(positions[:, 8:], fps=30)
    np.testing.assert_array_equal(compat.histogram, plain[:49])
    assert len(compat.fine_histogram) == 980 and compat.fine_histogram.sum() == compat.histogram.sum()
    assert compat.jerk == pytest.approx(naive.mean_jerk(positions, 30))
    assert compat.jerk == pytest.approx(compat.jerk_per_joint.mean())


@pytest.mark.parametrize("frames", [0, 1, 3])
def test_compat_of_too_few_frames(frames):
    compat = genea_compat(np.zeros((frames, 10, 3)), fps=30)
    assert np.isnan(compat.jerk) and compat.histogram.sum() == 2 * max(frames - 1, 0)


@pytest.fixture(scope="module")
def golden():
    folder = os.environ.get("GESTUREGEN_TEST_DATA")
    if not folder:
        pytest.skip("GESTUREGEN_TEST_DATA is not set: the published GENEA figures are not compared")
    folder = Path(folder) / "golden_genea"
    figures = json.loads((folder / "figures.json").read_text())
    motions = {}
    for name in ("truth", "generated"):
        with np.load(folder / f"{name}.npz") as file:
            motions[name] = file["positions"]
    return figures, motions


@pytest.mark.parametrize("name", ["truth", "generated"])
def test_compat_gives_the_published_figures(golden, name):
    figures, positions = golden[0], golden[1][name]
    compat = genea_compat(positions, fps=30)
    assert len(positions) == figures[name]["frames"]
    assert compat.jerk == pytest.approx(figures[name]["jerk"], rel=1e-12)
    assert compat.acceleration == pytest.approx(figures[name]["acceleration"], rel=1e-12)
    np.testing.assert_array_equal(np.round(compat.jerk_per_joint, 6), figures[name]["jerk_per_joint"])
    assert compat.histogram.tolist() == figures["velocity_histogram_width_1"][name]


def test_compat_gives_the_published_hellinger_distances(golden):
    figures, positions = golden
    truth, generated = (genea_compat(positions[name], fps=30) for name in ("truth", "generated"))
    coarse = hellinger_distance(truth.histogram, generated.histogram)
    fine = hellinger_distance(truth.fine_histogram, generated.fine_histogram)
    assert coarse == pytest.approx(figures["hellinger"]["1"], rel=1e-12)
    assert fine == pytest.approx(figures["hellinger"]["0.05"], rel=1e-12)

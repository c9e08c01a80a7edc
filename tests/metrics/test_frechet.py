"""The Fréchet distance: the low-rank identity, known normals, windows."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import sqrtm

from gesturegen.metrics.frechet import frechet_distance, motion_windows, window_frechet_distance
from tests.metrics import naive_metrics as naive


@pytest.mark.parametrize(("n", "m", "dims"), [(40, 30, 4), (40, 5, 4), (9, 30, 8)])
def test_identity_against_the_matrix_square_root(n, m, dims):
    rng = np.random.default_rng(n + m)
    first, second = rng.normal(size=(n, dims)) * np.arange(1, dims + 1), rng.normal(size=(m, dims)) + 2
    s1, s2 = np.cov(first, rowvar=False), np.cov(second, rowvar=False)
    shift = first.mean(axis=0) - second.mean(axis=0)
    expected = shift @ shift + np.trace(s1 + s2 - 2 * sqrtm(s1 @ s2).real)
    assert frechet_distance(first, second) == pytest.approx(expected, rel=1e-8)


@settings(deadline=None, derandomize=True, max_examples=20)
@given(st.integers(0, 10**6), st.integers(2, 9), st.integers(2, 9), st.integers(1, 6))
def test_equals_naive_with_few_and_many_samples(seed, n, m, dims):
    rng = np.random.default_rng(seed)
    first, second = rng.normal(size=(n, dims)), rng.normal(loc=1.0, scale=2.0, size=(m, dims))
    # the naive eigenvalues of a singular product are only good to the root of the rounding error
    assert frechet_distance(first, second) == pytest.approx(naive.frechet_distance(first, second), abs=1e-5)
    assert frechet_distance(first, second) == pytest.approx(frechet_distance(second, first))


def test_one_dimension_by_hand():
    first, second = (
        np.array([[0.0], [2.0], [4.0]]),
        np.array([[10.0], [11.0], [12.0]]),
    )  # sd 2 and 1, means 2, 11
    assert frechet_distance(first, second) == pytest.approx(9.0**2 + (2.0 - 1.0) ** 2)


def test_a_shift_costs_its_square_and_nothing_costs_nothing():
    samples = np.random.default_rng(0).normal(size=(12, 5))
    assert frechet_distance(samples, samples) == pytest.approx(0.0, abs=1e-10)
    assert frechet_distance(samples, samples + 3.0) == pytest.approx(5 * 9.0)
    assert frechet_distance(samples, samples[::-1]) >= 0.0


def test_many_dimensions_are_cheap_and_exact():
    rng = np.random.default_rng(1)
    small = rng.normal(size=(10, 3)), rng.normal(size=(8, 3)) * 2
    rotation = np.linalg.qr(rng.normal(size=(2250, 3)))[0]
    large = [samples @ rotation.T for samples in small]
    assert frechet_distance(*large) == pytest.approx(frechet_distance(*small))


@pytest.mark.parametrize("n", [0, 1])
def test_under_two_samples_are_undefined(n):
    assert np.isnan(frechet_distance(np.zeros((n, 3)), np.zeros((5, 3))))
    assert np.isnan(frechet_distance(np.zeros((5, 3)), np.zeros((n, 3))))


def test_dimensions_must_agree():
    with pytest.raises(ValueError, match="expected"):
        frechet_distance(np.zeros((5, 3)), np.zeros((5, 4)))


def test_windows():
    positions = np.arange(10 * 2 * 3, dtype=np.float64).reshape(10, 2, 3)
    windows = motion_windows(positions, 4)
    assert windows.shape == (4, 24)  # starts 0, 2, 4, 6
    np.testing.assert_array_equal(windows[1], positions[2:6].ravel())
    assert motion_windows(positions, 4, 5).shape == (2, 24)
    assert motion_windows(positions, 10).shape == (1, 60)
    assert motion_windows(positions, 11).shape == (0, 66)
    assert motion_windows(positions, 1).shape == (10, 6)
    with pytest.raises(ValueError, match="1 or more"):
        motion_windows(positions, 4, 0)


def test_windows_never_cross_clips():
    rng = np.random.default_rng(2)
    clips = [rng.normal(size=(7, 2, 3)), rng.normal(size=(9, 2, 3))]
    truth = rng.normal(size=(12, 2, 3))
    stacked = np.concatenate([motion_windows(clip, 4) for clip in clips])
    expected = frechet_distance(stacked, motion_windows(truth, 4))
    assert window_frechet_distance(clips, truth, window_frames=4) == pytest.approx(expected)
    joined = window_frechet_distance(np.concatenate(clips), truth, window_frames=4)
    assert joined != pytest.approx(expected)


def test_too_few_windows_are_undefined():
    clip, short = np.zeros((40, 2, 3)), np.zeros((3, 2, 3))
    assert np.isnan(window_frechet_distance(short, clip, window_frames=30))
    assert np.isnan(window_frechet_distance(clip, [], window_frames=30))
    assert window_frechet_distance(clip, clip, window_frames=10) == 0.0

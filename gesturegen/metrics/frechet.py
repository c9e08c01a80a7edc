"""Do short stretches of the motion look like stretches of recorded motion? Fréchet distance on raw windows.

Source: the Fréchet gesture distance of Yoon et al. 2020 and of genea-workshop/genea_numerical_evaluations,
here on the joint positions of windows of 30, 60 or 90 frames themselves instead of on the features of a
trained autoencoder, so that nothing has to be trained and nobody's weights are needed. Figures are comparable
only between runs with the same joints, window, stride, and frame of reference.

Conventions
- A window of L frames of J joints is one sample of 3 L J numbers, in cm; the distance is in cm^2. Windows
  start every `stride_frames` (default: half a window) and never cross clips; what is left over at a clip's
  end is dropped.
- Positions are world or relative to the pelvis, as the caller passes them; relative ones keep where the
  speaker stands from drowning out the gestures.
- Covariances have n - 1 in the denominator.
- With fewer windows than dimensions the estimate is biased upwards: compare sets of about the same size.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

WINDOW_FRAMES = (30, 60, 90)


def motion_windows(positions: np.ndarray, window_frames: int, stride_frames: int | None = None) -> np.ndarray:
    """Cut one clip into windows, one per row.

    positions : float [shape=(T, J, 3)], cm
    window_frames, stride_frames : in frames, 1 or more; the stride is half a window by default
    Returns float64 [shape=(W, window_frames * J * 3)], W = (T - window_frames) // stride + 1, or 0 rows for a
    clip shorter than a window.
    Raises ValueError for a window or stride under 1.
    """
    stride = max(1, window_frames // 2) if stride_frames is None else stride_frames
    if window_frames < 1 or stride < 1:
        raise ValueError(f"window of {window_frames} frames every {stride}: both must be 1 or more")
    positions = np.asarray(positions, dtype=np.float64)
    starts = range(0, len(positions) - window_frames + 1, stride)
    width = window_frames * int(np.prod(positions.shape[1:]))
    windows = [positions[start : start + window_frames].ravel() for start in starts]
    return np.array(windows, dtype=np.float64).reshape(len(starts), width)


def frechet_distance(first: np.ndarray, second: np.ndarray) -> float:
    """Compute the squared Fréchet distance between the normal distributions fitted to two sets of samples.

        ||mu1 - mu2||^2 + Tr(S1) + Tr(S2) - 2 Tr((S1 S2)^(1/2))

    With the centred samples over sqrt(n - 1) as the rows of A and B, S1 = A^T A and S2 = B^T B. The
    eigenvalues of S1 S2 other than 0 are those of (A B^T)(A B^T)^T, so the last trace is the sum of the
    singular values of A B^T: a matrix as large as the number of samples, not of dimensions, and no matrix
    square root. Where there are more samples than dimensions, A is first replaced by the triangle R of A = Q
    R, since R^T R = A^T A.

    first, second : float [shape=(N, D)] and [shape=(M, D)]
    Returns the distance in squared units of the samples, 0 or more; NaN where either set has under 2 samples.
    Raises ValueError when the dimensions differ.
    """
    first, second = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if first.ndim != 2 or second.ndim != 2 or first.shape[1] != second.shape[1]:
        raise ValueError(f"samples have shapes {first.shape} and {second.shape}, expected (N, D) and (M, D)")
    if len(first) < 2 or len(second) < 2:
        return float("nan")
    shift = first.mean(axis=0) - second.mean(axis=0)
    a, b = _covariance_factor(first), _covariance_factor(second)
    shared = np.linalg.svd(a @ b.T, compute_uv=False).sum()
    # The exact value is never negative; the difference of equal traces can be, by rounding.
    return float(max(0.0, shift @ shift + np.sum(a * a) + np.sum(b * b) - 2.0 * shared))


def window_frechet_distance(
    generated: np.ndarray | Sequence[np.ndarray],
    truth: np.ndarray | Sequence[np.ndarray],
    *,
    window_frames: int,
    stride_frames: int | None = None,
) -> float:
    """Compute the Fréchet distance between the windows of generated and of recorded clips.

    generated, truth : one clip, float [shape=(T, J, 3)], or a sequence of clips; cm, the same joints in all
    window_frames, stride_frames : as in `motion_windows`
    Returns cm^2; NaN where either side has under 2 windows in all.
    """
    first, second = (
        [motion_windows(clip, window_frames, stride_frames) for clip in _clips(side)] for side in (generated, truth)
    )
    if not first or not second:
        return float("nan")
    return frechet_distance(np.concatenate(first), np.concatenate(second))


def _clips(side: np.ndarray | Sequence[np.ndarray]) -> Sequence[np.ndarray]:
    """List the clips of one side, which is one clip or a sequence of clips."""
    return [side] if isinstance(side, np.ndarray) and side.ndim == 3 else list(side)


def _covariance_factor(samples: np.ndarray) -> np.ndarray:
    """Compute a matrix of at most D rows whose product A^T A is the covariance of the samples."""
    centred = (samples - samples.mean(axis=0)) / np.sqrt(len(samples) - 1)
    return np.asarray(np.linalg.qr(centred, mode="r")) if len(centred) > centred.shape[1] else centred

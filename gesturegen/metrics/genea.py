"""How far is the motion from recorded motion, in the figures of the GENEA challenges?

Source: genea-workshop/genea_numerical_evaluations (2022). Mean jerk and acceleration are in `smoothness.py`,
the Fréchet distance in `frechet.py`; here are speed histograms, the Hellinger distance between them, and CCA.

Conventions of the plain functions
- Speeds are cm/s: the norm of the frame difference times fps. Bins are `[k w, (k + 1) w)` of width 1 or 0.05
  from 0 to 50 cm/s, the last one closed; faster frames are left out. All joints passed in count, and add up.
- Histograms are counts, so those of several clips are added before they are compared.

Conventions of the published scripts (`genea_compat`), which differ in two points
- The first 8 joints are dropped, whichever they are. Meant for fixed hips; of the 25 joints used here it
  takes the trunk, the head and the right shoulder.
- The range ends at 49 cm/s at both widths: 49 bins of width 1, 980 of width 0.05.
Jerk and acceleration are the same. The published figures for challenge data were computed on positions from
PyMO, whose skeleton comes out doubled, so true positions do not reproduce those tables whatever the
convention.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gesturegen.metrics.smoothness import difference_norms, joint_accelerations, joint_jerks

TOP_SPEED = 50.0
COMPAT_TOP_SPEED = 49.0
COMPAT_DROPPED_JOINTS = 8


class GeneaCompat(NamedTuple):
    """The figures that the published scripts print for one motion.

    jerk : cm/s^3; acceleration : cm/s^2; both means over joints
    jerk_per_joint, acceleration_per_joint : float64 [shape=(J,)]
    histogram : int [shape=(49,)], speed counts at width 1; fine_histogram : int [shape=(980,)], at width 0.05
    """

    jerk: float
    acceleration: float
    jerk_per_joint: np.ndarray
    acceleration_per_joint: np.ndarray
    histogram: np.ndarray
    fine_histogram: np.ndarray


def speed_histogram(
    positions: np.ndarray, *, fps: float, bin_width: float = 1.0, top_speed: float = TOP_SPEED
) -> np.ndarray:
    """Count the speeds of all joints in all frames.

    positions : float [shape=(T, J, 3)], cm
    fps : frames per second
    bin_width, top_speed : cm/s; `top_speed` is rounded to a whole number of bins
    Returns int [shape=(round(top_speed / bin_width),)]; all 0 where T < 2. Speeds above `top_speed` are left
    out.
    """
    speeds = difference_norms(positions, 1) * fps
    edges = np.arange(round(top_speed / bin_width) + 1) * bin_width
    return np.histogram(speeds, bins=edges)[0]


def hellinger_distance(first: np.ndarray, second: np.ndarray) -> float:
    """Compute the Hellinger distance of two histograms, each normalised to sum 1.

    sqrt(1 - sum_k sqrt(p_k q_k))

    first, second : counts of 0 or more [shape=(B,)]
    Returns 0 (same shape) to 1 (no bin in common); NaN where either histogram is empty.
    Raises ValueError when the bins differ in number.
    """
    first, second = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if first.shape != second.shape:
        raise ValueError(f"histograms have shapes {first.shape} and {second.shape}, expected the same")
    if not first.sum() > 0 or not second.sum() > 0:
        return float("nan")
    overlap = np.sqrt(first / first.sum() * (second / second.sum())).sum()
    return float(np.sqrt(max(0.0, 1.0 - overlap)))


def canonical_correlation(generated: np.ndarray, truth: np.ndarray, *, rank_tolerance: float = 1e-3) -> float:
    """Compute the largest correlation between a linear function of the generated pose and one of the true pose (CCA).

    The poses of each motion are flattened and centred, X (T, 3J). With X = U S V^T and only the r columns of
    U whose singular value is above `rank_tolerance` times the largest, the first canonical correlation is the
    largest singular value of U_x^T U_y (Björck and Golub 1973). The truncation keeps out constant and
    repeated coordinates and directions of mere rounding, in which the correlation would be fitted to noise.

    generated, truth : float [shape=(T, J, 3)] and [shape=(U, K, 3)], cm, at the same frame rate, frame by
        frame of the same speech; the longer one is cut. Join several clips end to end, each pair cut to its
        common length.
    Returns 0 to 1; NaN where a motion never moves, and where r_x + r_y > T - 1: then two such sets always
    share a direction and the figure would be 1 for any motion.

    The published script fits one component with scikit-learn's iterative CCA over all clips at once, then
    correlates each clip's two projections. This is the exact optimum of the fit itself, so it is no less than
    theirs on the data fitted, up to the truncation. With many joints and few frames either figure comes close
    to 1.
    """
    common = min(len(generated), len(truth))
    if common < 3:
        return float("nan")
    bases = [_orthonormal_basis(np.asarray(p)[:common], rank_tolerance) for p in (generated, truth)]
    ranks = [basis.shape[1] for basis in bases]
    if min(ranks) == 0 or sum(ranks) > common - 1:
        return float("nan")
    return min(1.0, float(np.linalg.norm(bases[0].T @ bases[1], ord=2)))


def genea_compat(positions: np.ndarray, *, fps: float) -> GeneaCompat:
    """Compute the figures of the published scripts for one motion, by their conventions (module header).

    positions : float [shape=(T, J, 3)], cm; the order of joints matters, the first 8 stay out of the
        histograms
    fps : frames per second; the scripts write 30
    Figures are NaN and histograms 0 where there are too few frames. The published Hellinger distance is
    `hellinger_distance` of two `histogram` or two `fine_histogram`, added up over clips first; the published
    mean jerk of several clips is the mean of their `jerk`.
    """
    moving = np.asarray(positions)[:, COMPAT_DROPPED_JOINTS:]
    jerks, accelerations = joint_jerks(positions, fps=fps), joint_accelerations(positions, fps=fps)
    return GeneaCompat(
        jerk=float(jerks.mean()) if len(jerks) else float("nan"),
        acceleration=float(accelerations.mean()) if len(accelerations) else float("nan"),
        jerk_per_joint=jerks,
        acceleration_per_joint=accelerations,
        histogram=speed_histogram(moving, fps=fps, bin_width=1.0, top_speed=COMPAT_TOP_SPEED),
        fine_histogram=speed_histogram(moving, fps=fps, bin_width=0.05, top_speed=COMPAT_TOP_SPEED),
    )


def _orthonormal_basis(positions: np.ndarray, rank_tolerance: float) -> np.ndarray:
    """Compute columns that span the centred coordinates over time.

    Returns float64 [shape=(T, r)]; r = 0 without motion.
    """
    flat = positions.astype(np.float64).reshape(len(positions), -1)
    centred = flat - flat.mean(axis=0)
    left, values, _ = np.linalg.svd(centred, full_matrices=False)
    # Centring a constant leaves rounding errors of the size of the coordinates; they are no motion.
    rounding = 1e-12 * np.sqrt(flat.size) * np.abs(flat).max(initial=0.0)
    return left[:, values > max(rank_tolerance * values.max(initial=0.0), rounding)]

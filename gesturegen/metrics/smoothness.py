"""How fast and how smoothly does the motion move? Speed, acceleration and jerk.

Source: the GENEA numerical evaluations (genea-workshop/genea_numerical_evaluations, 2022), which print the
mean jerk and the mean acceleration of every system. High jerk is jitter or a jump at a seam, low jerk is
motion smoothed flat: the aim is the figure of recorded motion, not the lowest one.

Conventions
- Positions are `(T, J, 3)` in cm. The n-th derivative is the n-th difference of neighbouring frames times
  `fps ** n`; no filter is applied.
- A joint's figure is the mean over frames of the Euclidean norm of the derivative; a motion's figure is the
  mean of its joints' figures. All frames count alike, so both orders of averaging agree.
- On the same positions these equal the published scripts to rounding; those write 30 for `fps`.
- Too few frames (3 for acceleration, 4 for jerk) give NaN.
"""

from __future__ import annotations

import numpy as np


def difference_norms(positions: np.ndarray, order: int) -> np.ndarray:
    """Compute norms of the `order`-th frame difference of every joint: speed for 1, acceleration for 2, jerk for 3.

    positions : float [shape=(T, J, 3)], cm
    Returns float64 [shape=(max(T - order, 0), J)] in cm per frame ** order; row k is made of frames
    k to k + order.
    Raises ValueError when `positions` is not of that shape.
    """
    positions = np.asarray(positions, dtype=np.float64)
    if positions.ndim != 3 or positions.shape[2] != 3:
        raise ValueError(f"positions have shape {positions.shape}, expected (T, J, 3)")
    if len(positions) <= order:
        return np.empty((0, positions.shape[1]))
    return np.linalg.norm(np.diff(positions, n=order, axis=0), axis=-1)


def joint_accelerations(positions: np.ndarray, *, fps: float) -> np.ndarray:
    """Compute the mean acceleration of every joint.

    positions : float [shape=(T, J, 3)], cm
    fps : frames per second
    Returns float64 [shape=(J,)], cm/s^2; NaN where T < 3.
    """
    return _mean_over_frames(difference_norms(positions, 2)) * fps**2


def joint_jerks(positions: np.ndarray, *, fps: float) -> np.ndarray:
    """Compute the mean jerk of every joint.

    positions : float [shape=(T, J, 3)], cm
    fps : frames per second
    Returns float64 [shape=(J,)], cm/s^3; NaN where T < 4.
    """
    return _mean_over_frames(difference_norms(positions, 3)) * fps**3


def mean_acceleration(positions: np.ndarray, *, fps: float) -> float:
    """Compute the mean over joints of `joint_accelerations`, cm/s^2; NaN where T < 3 or there is no joint."""
    return _mean_over_joints(joint_accelerations(positions, fps=fps))


def mean_jerk(positions: np.ndarray, *, fps: float) -> float:
    """Compute the mean over joints of `joint_jerks`, cm/s^3; NaN where T < 4 or there is no joint."""
    return _mean_over_joints(joint_jerks(positions, fps=fps))


def _mean_over_frames(norms: np.ndarray) -> np.ndarray:
    """Average over frames; NaN where there is none."""
    return norms.mean(axis=0) if len(norms) else np.full(norms.shape[1], np.nan)


def _mean_over_joints(figures: np.ndarray) -> float:
    """Average over joints; NaN where there is none."""
    return float(figures.mean()) if len(figures) else float("nan")

"""Joining stretches of motion (§4.2.4): the published cross-fade, inertialization, and corrections of least jerk.

Arrays are local rotations `[shape=(T, J, 4)]` and local positions `[shape=(T, J, 3)]`.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from gesturegen.motion import rotation
from gesturegen.settings.models import Blend

# How steep the sigmoid is over the unit interval: it reaches 0.0067 and 0.9933 at its ends.
_SIGMOID_STEEPNESS = 10.0


def weights(count: int, curve: str) -> np.ndarray:
    """Compute weights of the right side `[shape=(count,)]`, inside (0, 1): evenly placed values through a curve."""
    even = (np.arange(count) + 1.0) / (count + 1.0)
    if curve == "sigmoid":
        return 1.0 / (1.0 + np.exp(-_SIGMOID_STEEPNESS * (even - 0.5)))
    if curve == "smoothstep":
        return even * even * (3.0 - 2.0 * even)
    return even


def mix_rotations(left: np.ndarray, right: np.ndarray, amount: np.ndarray, how: str) -> np.ndarray:
    """Interpolate from `left` (amount 0) to `right` (amount 1), by SLERP or weighted exponential maps."""
    if how == "slerp":
        return rotation.slerp(left, right, amount)
    start, end = rotation.to_expmap(left), rotation.to_expmap(right)
    # A rotation by v is one by v (1 - 2 pi / |v|) too: take the map nearer to the left one.
    length = np.linalg.norm(end, axis=-1, keepdims=True)
    other = end * (1.0 - 2.0 * np.pi / np.where(length > 0, length, np.inf))
    nearer = np.linalg.norm(other - start, axis=-1, keepdims=True) < np.linalg.norm(end - start, axis=-1, keepdims=True)
    end = np.where(nearer, other, end)
    return rotation.from_expmap(start + np.asarray(amount)[..., None] * (end - start))


def crossfade(rotations: np.ndarray, positions: np.ndarray, seam: int, right_end: int, settings: Blend) -> None:
    """Blend, in place, up to `l_blend` frames on each side of the seam between frames `seam` - 1 and `seam`.

    The left side is held at its last frame, the right side at its first (the printed formula swaps the two
    held frames and so blends nothing at the seam). right_end : the frame at which the right side ends.
    """
    left_count = min(settings.l_blend, seam)
    right_count = min(settings.l_blend, right_end - seam)
    frames = np.arange(seam - left_count, seam + right_count)
    left, right = np.minimum(frames, seam - 1), np.maximum(frames, seam)
    amount = weights(len(frames), settings.curve)[:, None]
    mixed = mix_rotations(rotations[left], rotations[right], amount, settings.rotations)
    amount = amount[..., None]
    positions[frames] = (1.0 - amount) * positions[left] + amount * positions[right]
    rotations[frames] = mixed


def spring_decay(offset: np.ndarray, velocity: np.ndarray, times: np.ndarray, half_life: float) -> np.ndarray:
    """Decay an offset and its velocity to zero by a critically damped spring, at `times` in seconds.

    offset, velocity : `[shape=(..., D)]`; times : `[shape=(n,)]`; returns `[shape=(n, ..., D)]`.
    Inertialization: Bollo, Inertialization, GDC 2018; the spring is Holden's.
    """
    rate = 2.0 * np.log(2.0) / half_life
    times = times.reshape(-1, *([1] * offset.ndim))
    return (offset + (velocity + rate * offset) * times) * np.exp(-rate * times)


# Rotations of a correction do not quite add up; so often what is left is corrected again.
_CORRECTIONS = 3
# Frames; beyond it what brings a correction back is lost in rounding.
_LONGEST_REACH = 100.0
_THIRD_DIFFERENCE = (-1.0, 3.0, -3.0, 1.0)


def least_jerk(
    rotations: np.ndarray, positions: np.ndarray, jumps: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Correct rotations and positions on both sides of jumps so that the jerk of the jumps disappears.

    jumps : bool `[shape=(T,)]`, frames that do not follow on the one before; reach : of a correction, in frames

    The correction c minimises sum |third difference of c - r|^2 + reach^-6 sum |c|^2, where r undoes the third
    difference of the motion where a jump is among its four frames, and is 0 elsewhere: what was recorded keeps
    its jerk. The last term brings the correction back to nothing.
    """
    count = len(rotations)
    if count < 4 or not jumps.any():
        return rotations.copy(), positions.copy()
    # A third difference spans three steps; the step into frame k is jumps[k].
    across = (jumps[1:-2] | jumps[2:-1] | jumps[3:])[:, None]
    shape = rotations.shape[1:-1]
    moved = positions.reshape(count, -1).copy()
    travelling = np.ptp(moved, axis=0) > 0
    if travelling.any():
        wanted = np.where(across, -np.diff(moved[:, travelling], 3, axis=0), 0.0)
        moved[:, travelling] += _correction(wanted, np.zeros((count, int(travelling.sum()))), reach)
    recorded = np.diff(_steps(rotations), 2, axis=0)
    turned, correction = rotations, np.zeros((count, 3 * int(np.prod(shape))))
    for _round in range(_CORRECTIONS):
        wanted = np.where(across, 0.0, recorded) - np.diff(_steps(turned), 2, axis=0)
        correction += _correction(wanted, correction, reach)
        turned = rotation.multiply(rotation.from_expmap(correction.reshape(count, *shape, 3)), rotations)
    return turned, moved.reshape(positions.shape)


def _steps(rotations: np.ndarray) -> np.ndarray:
    """Compute the rotation vectors from frame to frame `[shape=(T - 1, J * 3)]`."""
    steps = rotation.to_expmap(rotation.multiply(rotations[1:], rotation.inverse(rotations[:-1])))
    return steps.reshape(len(steps), -1)


def _correction(wanted: np.ndarray, so_far: np.ndarray, reach: float) -> np.ndarray:
    """Find the c `[shape=(T, K)]` that minimises |third difference of c - wanted|^2 + reach^-6 |so_far + c|^2."""
    count, spring = len(so_far), min(reach, _LONGEST_REACH) ** -6.0
    matrix = np.zeros((4, count))  # the upper bands of D^T D + spring, the diagonal last
    right = -spring * so_far
    for i, left_weight in enumerate(_THIRD_DIFFERENCE):
        right[i : count - 3 + i] += left_weight * wanted
        for j in range(i, 4):
            matrix[3 - (j - i), j : count - 3 + j] += left_weight * _THIRD_DIFFERENCE[j]
    matrix[3] += spring
    return solveh_banded(matrix, right)

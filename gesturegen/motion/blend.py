"""Joining two stretches of motion (§4.2.4): the published cross-fade and inertialization.

Arrays are local rotations `[shape=(T, J, 4)]` and local positions `[shape=(T, J, 3)]`.
"""

from __future__ import annotations

import numpy as np

from gesturegen.config import Blend
from gesturegen.motion import rotation

# How steep the sigmoid is over the unit interval: it reaches 0.0067 and 0.9933 at its ends.
_SIGMOID_STEEPNESS = 10.0


def weights(count: int, curve: str) -> np.ndarray:
    """Weights of the right side `[shape=(count,)]`, inside (0, 1): evenly placed values through a curve."""
    even = (np.arange(count) + 1.0) / (count + 1.0)
    if curve == "sigmoid":
        return 1.0 / (1.0 + np.exp(-_SIGMOID_STEEPNESS * (even - 0.5)))
    if curve == "smoothstep":
        return even * even * (3.0 - 2.0 * even)
    return even


def mix_rotations(left: np.ndarray, right: np.ndarray, amount: np.ndarray, how: str) -> np.ndarray:
    """Rotations between `left` (amount 0) and `right` (amount 1), by SLERP or weighted exponential maps."""
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
    """An offset and its velocity brought to zero by a critically damped spring, at `times` in seconds.

    offset, velocity : `[shape=(..., D)]`; times : `[shape=(n,)]`; returns `[shape=(n, ..., D)]`.
    Inertialization: Bollo, Inertialization, GDC 2018; the spring is Holden's.
    """
    rate = 2.0 * np.log(2.0) / half_life
    times = times.reshape(-1, *([1] * offset.ndim))
    return (offset + (velocity + rate * offset) * times) * np.exp(-rate * times)

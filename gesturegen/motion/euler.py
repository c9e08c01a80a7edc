"""Euler angles as curves: of all angles that mean one rotation, those nearest to the frame before.

Intrinsic angles (a, b, c) turn as (a + 180, 180 - b, c + 180) do, and whole turns of any angle change nothing. Where b
is a right angle only a + c or a - c matters. What is between two frames depends on the choice, so a file whose curves
jump cannot be resampled or edited.
"""

from __future__ import annotations

import numpy as np

from gesturegen.motion import rotation

# Degrees. Where no angle steps further from frame to frame, no other equivalent angles are nearer.
CERTAIN = 60.0
# Radians, of rotations that are the same one.
_SAME = 1e-7
# Cosine of the middle angle below which the other two are not told apart.
_LOCKED = 1e-6


def continuous(
    order: str, angles: np.ndarray, rotations: np.ndarray, written: np.ndarray | None = None, one_axis: bool = False
) -> np.ndarray:
    """Equivalent angles of one joint without jumps, degrees `[shape=(T, 3)]`.

    angles : any angles of the rotations `[shape=(T, 4)]`, in the three-letter intrinsic `order`
    written : angles that a file wrote for the frames, NaN where none `[shape=(T, 3)]`. While frames turn as written
        there, their angles change as the file's do, jumps and all; the first frame's are the file's own
    one_axis : whether only the first angle is kept
    """
    steady = not (np.abs(np.diff(angles, axis=0)) > CERTAIN).any() and np.abs(angles[:, 1]).max(initial=0.0) < 89.9
    if written is None and steady:
        return angles
    count = len(angles)
    taken = np.zeros(count, dtype=bool)
    if written is not None:
        known = ~np.isnan(written).any(axis=1)
        there = rotation.from_euler(order, np.radians(written[known]))
        taken[known] = rotation.angle_between(there, rotations[known]) < _SAME
    elif count == 0:
        return angles
    parity = 1.0 if order in ("XYZ", "YZX", "ZXY") else -1.0
    result = np.array(angles, dtype=np.float64)
    mirrored = False  # whether the curves are those of the file with the other equivalent angles
    for frame in range(count):
        own, before = angles[frame], result[frame - 1]
        expected = own if frame == 0 else before
        if taken[frame]:
            if frame == 0:
                expected = written[0]
            elif taken[frame - 1]:
                step = written[frame] - written[frame - 1]
                expected = before + (step * [1.0, -1.0, 1.0] if mirrored else step)
        best = _nearest(own, expected, parity, one_axis)
        if taken[frame]:
            off = best - written[frame]
            whole = np.abs(off - 360.0 * np.round(off / 360.0)).max() < 1e-3
            mirrored = not whole
            if whole:
                best = written[frame] + 360.0 * np.round(off / 360.0)
        result[frame] = best
    return result


def _nearest(own: np.ndarray, expected: np.ndarray, parity: float, one_axis: bool) -> np.ndarray:
    """Of the angles that mean what `own` do those nearest to the expected ones."""
    if one_axis:
        return own + 360.0 * np.round((expected - own) / 360.0)
    choices = []
    for angles in (own, own * [1.0, -1.0, 1.0] + [180.0, 180.0, 180.0]):
        if abs(np.cos(np.radians(angles[1]))) < _LOCKED:
            sign = parity * np.sign(np.sin(np.radians(angles[1])))
            off = (angles[0] + sign * angles[2]) - (expected[0] + sign * expected[2])
            off -= 360.0 * np.round(off / 360.0)
            angles = np.array([expected[0] + off / 2.0, angles[1], expected[2] + sign * off / 2.0])
        choices.append(angles + 360.0 * np.round((expected - angles) / 360.0))
    return min(choices, key=lambda angles: float(np.abs(angles - expected).sum()))

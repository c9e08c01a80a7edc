"""Euler angles as curves: of all angles of one rotation, those nearest to the frame before.

Intrinsic angles (a, b, c) turn as (a + 180, 180 - b, c + 180) do, and whole turns of any angle change nothing. Where b
is a right angle only a + c or a - c matters. What is between two frames depends on the choice, so a file whose curves
jump cannot be resampled or edited.
"""

from __future__ import annotations

import math

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
    """Unwrap the angles of one joint to equivalent ones without jumps, degrees `[shape=(T, 3)]`.

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
    result: list[list[float]] = []
    mirrored = False  # whether the curves are those of the file with the other equivalent angles
    # Plain numbers: arrays of three take ten times as long.
    rows: list[list[float]] = np.asarray(angles, dtype=np.float64).tolist()
    own_rows: list[list[float]] = [] if written is None else written.tolist()
    for frame, (own, took) in enumerate(zip(rows, taken.tolist(), strict=True)):
        expected = result[-1] if frame else own
        if took and not frame:
            expected = own_rows[0]
        elif took and taken[frame - 1]:
            signs = (1.0, -1.0, 1.0) if mirrored else (1.0, 1.0, 1.0)
            step = zip(expected, signs, own_rows[frame], own_rows[frame - 1], strict=True)
            expected = [before + sign * (now - then) for before, sign, now, then in step]
        best = _nearest(own, expected, parity, one_axis)
        if took:
            turns = [round((a - b) / 360.0) for a, b in zip(best, own_rows[frame], strict=True)]
            source = [b + 360.0 * turn for b, turn in zip(own_rows[frame], turns, strict=True)]
            mirrored = max(abs(a - b) for a, b in zip(best, source, strict=True)) > 1e-3
            best = best if mirrored else source
        result.append(best)
    return np.array(result)


def _nearest(own: list[float], expected: list[float], parity: float, one_axis: bool) -> list[float]:
    """Choose, of all angles equivalent to `own`, those nearest to the expected ones."""

    def turned(angles: list[float]) -> list[float]:
        return [a + 360.0 * round((e - a) / 360.0) for a, e in zip(angles, expected, strict=True)]

    if one_axis:
        return turned(own)
    choices = []
    for first, b, last in (own, (own[0] + 180.0, 180.0 - own[1], own[2] + 180.0)):
        if abs(math.cos(math.radians(b))) < _LOCKED:
            sign = math.copysign(parity, parity * math.sin(math.radians(b)))
            off = (first + sign * last) - (expected[0] + sign * expected[2])
            off -= 360.0 * round(off / 360.0)
            choices.append(turned([expected[0] + off / 2.0, b, expected[2] + sign * off / 2.0]))
        else:
            choices.append(turned([first, b, last]))
    return min(choices, key=lambda angles: sum(abs(a - e) for a, e in zip(angles, expected, strict=True)))

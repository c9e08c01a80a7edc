"""Do the legs look like legs? Straightened and snapping knees.

Ours. Feet that are held on the floor pull a leg straight when the pelvis moves away, and a straight knee jumps: the
angle is steepest there.

Conventions
- The angle at a knee is that between thigh and shank, 180 degrees for a straight leg.
- A *snap* is a moment at which the second difference of an angle, times fps squared, is over `SNAP_ACCELERATION`
  degrees/s^2. What lies within `ONE_SNAP_FRAMES` frames, of either knee, is one snap: a jump has several such frames.
- Read them beside the reference's own: some speakers stand with straight legs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

STRAIGHT_DEGREES, SNAP_ACCELERATION, ONE_SNAP_FRAMES = 177.0, 6000.0, 3


class Knees(NamedTuple):
    """Figures of straightened and snapping knees.

    straight_share : share of frames and knees beyond the limit; snaps_per_minute : of all knees together
    """

    straight_share: float
    snaps_per_minute: float


def knee_angles(legs: np.ndarray) -> np.ndarray:
    """Compute the angles at the knees, degrees `[shape=(T, L)]`.

    legs : float [shape=(T, L, 3, 3)], hip, knee and ankle, cm
    """
    legs = np.asarray(legs, dtype=np.float64)
    thigh, shank = legs[:, :, 0] - legs[:, :, 1], legs[:, :, 2] - legs[:, :, 1]
    # atan2, since acos loses half the digits near a straight leg.
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(thigh, shank), axis=-1), np.sum(thigh * shank, axis=-1)))


def knee_accelerations(angles: np.ndarray, *, fps: float) -> np.ndarray:
    """Compute sizes of the second differences of the angles, degrees/s^2 `[shape=(T, L)]`; 0 at the ends."""
    angles = np.asarray(angles, dtype=np.float64)
    found = np.zeros(angles.shape)
    if len(angles) > 2:
        found[1:-1] = np.abs(np.diff(angles, n=2, axis=0)) * fps**2
    return found


def knees(
    angles: np.ndarray, accelerations: np.ndarray, *, fps: float, straight_degrees: float = STRAIGHT_DEGREES,
    snap_acceleration: float = SNAP_ACCELERATION,
) -> Knees:  # fmt: skip
    """Measure straightened and snapping knees of one clip; NaN without a leg or a frame.

    angles, accelerations : float [shape=(T, L)], degrees and degrees/s^2, as of the functions above
    """
    if not np.size(angles):
        return Knees(float("nan"), float("nan"))
    fast = np.flatnonzero((np.asarray(accelerations) > snap_acceleration).any(axis=1))
    snaps = int((np.diff(fast) > ONE_SNAP_FRAMES).sum()) + int(len(fast) > 0)
    return Knees(float((np.asarray(angles) > straight_degrees).mean()), snaps / (len(angles) / fps / 60.0))

"""Do the feet slide over the floor? Foot skate.

Ours, in the way common for motion synthesis: a foot near the floor is taken to bear weight and should not
move sideways.

Conventions
- World positions in cm, y up. Positions relative to the pelvis would make every step a slide.
- The floor is not given: each foot joint has its own, at a low percentile of its height over the motion, so
  that ankles, toes and shoes of any height need no setting. A foot that never stands still at its lowest (a
  seated speaker who swings it) gives figures without meaning.
- A foot skates between two frames only when it is near the floor in both.
- Recorded motion is not at 0 either: compare with the reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

FLOOR_PERCENTILE = 5.0
CONTACT_HEIGHT = 2.5


class FootSkate(NamedTuple):
    """Sliding of the feet in one motion.

    speed : mean horizontal speed of feet in contact, cm/s; NaN where no foot is in contact for two frames on
        end
    contact_share : share of (frame, foot) in contact; NaN where there is no frame or no foot
    """

    speed: float
    contact_share: float


def foot_contacts(
    positions: np.ndarray, *, height: float = CONTACT_HEIGHT, floor_percentile: float = FLOOR_PERCENTILE
) -> np.ndarray:
    """Which feet are near the floor.

    positions : float [shape=(T, F, 3)], world positions of the foot joints, cm, y up
    height : cm above the foot's floor up to which it is in contact
    floor_percentile : percentile of a foot's height that is its floor
    Returns bool [shape=(T, F)].
    """
    heights = np.asarray(positions, dtype=np.float64)[..., 1]
    if not heights.size:
        return np.zeros(heights.shape, dtype=bool)
    return heights <= np.percentile(heights, floor_percentile, axis=0) + height


def foot_skate(
    positions: np.ndarray,
    foot_joints: Sequence[int],
    *,
    fps: float,
    height: float = CONTACT_HEIGHT,
    floor_percentile: float = FLOOR_PERCENTILE,
) -> FootSkate:
    """Mean horizontal speed of the feet while they are near the floor, and how often they are.

        speed = mean of fps * ||(x, z)_t - (x, z)_(t-1)|| over the (t, foot) in contact at both t - 1 and t

    positions : float [shape=(T, J, 3)], world positions, cm, y up
    foot_joints : int [shape=(F,)], the foot joints among the J
    fps : frames per second
    height, floor_percentile : as in `foot_contacts`
    """
    feet = np.asarray(positions, dtype=np.float64)[:, np.asarray(foot_joints, dtype=np.int64)]
    contacts = foot_contacts(feet, height=height, floor_percentile=floor_percentile)
    if not contacts.size:
        return FootSkate(float("nan"), float("nan"))
    speeds = np.linalg.norm(np.diff(feet[..., [0, 2]], axis=0), axis=-1) * fps
    sliding = speeds[contacts[1:] & contacts[:-1]]
    return FootSkate(float(sliding.mean()) if sliding.size else float("nan"), float(contacts.mean()))

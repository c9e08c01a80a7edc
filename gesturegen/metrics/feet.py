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

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gesturegen.motion.feet import CONTACT_HEIGHT, FLOOR_PERCENTILE, contacts


class FootSkate(NamedTuple):
    """Sliding of the feet in one motion.

    speed : mean horizontal speed of feet in contact, cm/s; NaN where no foot is in contact for two frames on
        end
    contact_share : share of (frame, foot) in contact; NaN where there is no frame or no foot
    """

    speed: float
    contact_share: float


def foot_skate(
    positions: ArrayLike,
    foot_joints: ArrayLike,
    *,
    fps: float,
    height: float = CONTACT_HEIGHT,
    floor_percentile: float = FLOOR_PERCENTILE,
) -> FootSkate:
    """Measure the mean horizontal speed of the feet while they are near the floor, and how often they are.

        speed = mean of fps * ||(x, z)_t - (x, z)_(t-1)|| over the (t, foot) in contact at both t - 1 and t

    positions : float [shape=(T, J, 3)], world positions, cm, y up
    foot_joints : int [shape=(F,)], the foot joints among the J
    fps : frames per second
    height, floor_percentile : as in `motion.feet.contacts`
    """
    feet = np.asarray(positions, dtype=np.float64)[:, np.asarray(foot_joints, dtype=np.int64)]
    touching = contacts(feet, height=height, floor_percentile=floor_percentile)
    if not touching.size:
        return FootSkate(float("nan"), float("nan"))
    speeds = np.linalg.norm(np.diff(feet[..., [0, 2]], axis=0), axis=-1) * fps
    sliding = speeds[touching[1:] & touching[:-1]]
    return FootSkate(float(sliding.mean()) if sliding.size else float("nan"), float(touching.mean()))

"""How often does the motion change direction? Div.

Source: §5.2, Table 2 ("the ratio of large angular changes of velocities between frames"). The formula of
the cited work, Zhao et al. 2022 ([21]), is not public. Turns of more than 45 degrees give recorded speech
gestures 0.05 to 0.09 without a speed floor, around the paper's 0.058 to 0.075, hence that default; the floor
is ours, it keeps the trembling of joints at rest from counting and brings the figures down to 0.02 to 0.03.

Conventions
- Velocity is the difference of neighbouring frames, cm per frame.
- The denominator is every (frame, joint) that has two velocities: (T - 2) J of them, moving or not. Slow ones
  can never be counted as turns but stay in the denominator, so a motion that rests a lot has a low Div.
- The floor is per frame: at another frame rate, scale it.
- Higher means more changes of motion; jitter raises it too, so read it beside the mean jerk.
"""

from __future__ import annotations

import numpy as np


def direction_change_share(
    positions: np.ndarray, *, min_angle_degrees: float = 45.0, speed_floor: float = 0.1
) -> float:
    """Compute Div: the share of (frame, joint) at which the velocity turns by more than `min_angle_degrees`.

        Div = #{t, j : angle(v_tj, v_(t+1)j) > min_angle and both speeds >= speed_floor} / ((T - 2) J)

    positions : float [shape=(T, J, 3)], cm
    min_angle_degrees : a turn by exactly this angle does not count
    speed_floor : cm per frame; both speeds must reach it
    Returns a share between 0 and 1; NaN where T < 3 or there is no joint.
    """
    angles, speeds = turning_angles(positions)
    if not angles.size:
        return float("nan")
    fast_enough = (speeds[:-1] >= speed_floor) & (speeds[1:] >= speed_floor)
    return float(np.mean(fast_enough & (angles > np.radians(min_angle_degrees))))


def turning_angles(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the angles between successive velocities of every joint, and the speeds.

    positions : float [shape=(T, J, 3)], cm
    Returns angles float64 [shape=(max(T - 2, 0), J)] in radians, 0 to pi, and speeds float64
    [shape=(max(T - 1, 0), J)] in cm per frame; row k of the angles is the turn at frame k + 1. Where a speed
    is 0 the angle has no meaning and is 0.
    """
    positions = np.asarray(positions, dtype=np.float64)
    velocities = np.diff(positions, axis=0) if len(positions) else positions
    before, after = velocities[:-1], velocities[1:]
    # atan2 of cross and dot: exact where acos of a rounded cosine is not, and defined at speed 0.
    angles = np.arctan2(np.linalg.norm(np.cross(before, after), axis=-1), np.sum(before * after, axis=-1))
    return angles, np.linalg.norm(velocities, axis=-1)

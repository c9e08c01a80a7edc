"""Do the hands hover, or the whole figure stand like a statue, while there is speech? Still hands.

Ours. A path that cycles through a few near frames, or holds one, is smooth and cheap, and dead to the eye.

Conventions
- The speed of a hand is that of its wrist seen from the pelvis and its heading, per second, by central differences:
  hands that hang still on a body that turns are still.
- Hands are still while both are under `STILL_SPEED`, for `STILL_SECONDS` or more on end, outside the pauses of the
  speech: where it pauses a rest is natural. A stretch that a pause cuts is judged by what is left of it.
- Shares are of the frames outside pauses.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

STILL_SPEED, STILL_SECONDS = 10.0, 0.33


class Stillness(NamedTuple):
    """Still hands outside pauses: the share of frames, and the longest stretch in seconds (0 where there is none)."""

    share: float
    longest_seconds: float


def hand_speeds(hands: ArrayLike, *, fps: float) -> np.ndarray:
    """Compute the speeds of the hands `[shape=(T, H)]`, cm/s.

    hands : float [shape=(T, H, 3)], seen from the pelvis, cm
    """
    hands = np.asarray(hands, dtype=np.float64)
    if len(hands) < 2:
        return np.zeros(hands.shape[:2])
    return np.linalg.norm(np.gradient(hands, axis=0), axis=-1) * fps


def still_frames(speeds: ArrayLike, *, fps: float, speed: float = STILL_SPEED, seconds: float = STILL_SECONDS,
                 outside: ArrayLike | None = None) -> np.ndarray:  # fmt: skip
    """Find the frames in stretches in which all hands are still: bool `[shape=(T,)]`.

    speeds : float [shape=(T, H)], cm/s; speed : cm/s that they stay under; seconds : shortest stretch that counts
    outside : bool [shape=(T,)], frames that may count; all by default
    """
    still: np.ndarray = np.all(np.asarray(speeds) < speed, axis=1)
    if outside is not None:
        still &= np.asarray(outside, dtype=bool)
    for start, end in _stretches(still):
        if end - start < seconds * fps - 1e-6:
            still[start:end] = False
    return still


def stillness(
    speeds: ArrayLike, paused: ArrayLike | None = None, *, fps: float, speed: float = STILL_SPEED,
    seconds: float = STILL_SECONDS,
) -> Stillness:  # fmt: skip
    """Measure the share of still hands and the longest such stretch of one clip.

    speeds : float [shape=(T, H)], of the hands, cm/s; paused : bool [shape=(T,)], the pauses of its speech; none by
    default. NaN where there is no hand or no frame outside pauses.
    """
    speeds = np.asarray(speeds)
    outside = np.ones(len(speeds), dtype=bool) if paused is None else ~np.asarray(paused, dtype=bool)
    if not outside.any() or not speeds.shape[1]:
        return Stillness(float("nan"), float("nan"))
    still = still_frames(speeds, fps=fps, speed=speed, seconds=seconds, outside=outside)
    longest = max((end - start for start, end in _stretches(still)), default=0)
    return Stillness(float(still.sum() / outside.sum()), float(longest / fps))


def is_statue(speeds: ArrayLike, *, fps: float, speed: float = STILL_SPEED, seconds: float = STILL_SECONDS) -> bool:
    """Tell whether all is still for over half of a clip, pauses or not: no measure of alignment means anything then."""
    if not np.size(speeds):
        return False
    return bool(still_frames(speeds, fps=fps, speed=speed, seconds=seconds).mean() > 0.5)


def _stretches(chosen: np.ndarray) -> np.ndarray:
    """List first frames and ends of the runs of True `[shape=(R, 2)]`."""
    edges = np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8))
    return np.flatnonzero(edges).reshape(-1, 2)

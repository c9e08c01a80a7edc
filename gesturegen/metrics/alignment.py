"""Does the motion follow the speech? Alignment of motion and onsets, over what chance gives.

Source: `a2m` is the beat alignment of BEAT and BEAT2 (Liu et al. 2022 and 2024); the angle change rate is that of
§5.2 (`beats`); surplus, z and the minima of the hands' speed are ours. A motion with many beats is near to any onset,
real motion that hears nothing as well, so that a kernel by itself says nothing.

Conventions
- A *reading* is one list of motion beats or several. a2m has the speed minima of each joint, over `A2M_ORDER` frames
  to either side; the hands have the minima of their mean speed, over `HANDS_ORDER`; the angle change rate has its
  maxima. Minima under `LEAST_SHARE` of the mean speed are rests and no beats, as in BEAT2. Positions are relative to
  the pelvis; the published script divides by speeds of another data set, here it is the clip's own mean.
- The score of a reading is the mean over onsets of exp(-d^2 / (2 sigma^2)), d the time to the nearest beat, averaged
  over the lists that have a beat. Onsets and beats fall on frames.
- Chance is the mean score over all rotations of the onsets in time within the clip, whole frames each; `surplus` is
  the score less chance, and z is surplus over the standard deviation of the score over these rotations.
- Of several clips, surplus is the mean, and z is the sum of the surpluses over the root of the sum of their variances.
- Higher is not better: nearer to recorded motion with its own speech is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import argrelextrema

A2M_ORDER, HANDS_ORDER, LEAST_SHARE = 7, 5, 0.1
# Seconds, of the kernel: of speed minima as in BEAT; that of the angle change rate is `evaluation.bc_sigma`.
MINIMA_SIGMA = 0.3


class Surplus(NamedTuple):
    """Alignment over chance: the surplus, its standard deviation by chance, and their ratio z; NaN without evidence."""

    surplus: float
    deviation: float
    z: float


NONE = Surplus(float("nan"), float("nan"), float("nan"))


def speed_minima(speeds: np.ndarray, *, order: int = A2M_ORDER, least_share: float = LEAST_SHARE) -> list[np.ndarray]:
    """Find the frames at which each joint is slower than at `order` frames to either side; one array per joint.

    speeds : float [shape=(T, J)], as of `speeds`; least_share : of a joint's mean speed, slower minima are left out
    """
    frames, joints = argrelextrema(speeds, np.less, axis=0, order=order)
    beat = speeds[frames, joints] > least_share * speeds.mean(axis=0)[joints] if len(frames) else np.empty(0, bool)
    return [np.sort(frames[beat & (joints == joint)]) for joint in range(speeds.shape[1])]


def speeds(positions: np.ndarray) -> np.ndarray:
    """Compute speeds by central differences, one-sided at the ends, per frame `[shape=(T, J)]`.

    positions : float [shape=(T, J, 3)]
    """
    if len(positions) < 2:
        return np.zeros(np.shape(positions)[:2])
    return np.linalg.norm(np.gradient(np.asarray(positions, dtype=np.float64), axis=0), axis=-1)


def surplus(
    onset_frames: ArrayLike, beats: Sequence[np.ndarray], n_frames: int, *, fps: float, sigma_seconds: float
) -> Surplus:
    """Measure the alignment of a clip's onsets and motion beats over chance.

    onset_frames : int [shape=(K,)], those outside the clip are left out
    beats : lists of frames, each int [shape=(B,)]; lists without a beat are left out
    NaN where no list has a beat or the clip has no onset; z is NaN where no rotation makes a difference.
    """
    onsets = np.asarray(onset_frames, dtype=np.int64)
    onsets = onsets[(onsets >= 0) & (onsets < n_frames)]
    beats = [frames for frames in beats if len(frames)]
    if not len(onsets) or not beats:
        return NONE
    nearness = np.mean([_nearness(np.sort(frames), n_frames, sigma_seconds * fps) for frames in beats], axis=0)
    rotations = np.arange(n_frames)[:, None]
    scores = nearness[(onsets + rotations) % n_frames].mean(axis=1)
    over, deviation = float(scores[0] - scores.mean()), float(scores.std())
    return Surplus(over, deviation, over / deviation if deviation > 1e-12 else float("nan"))


def together(clips: Sequence[Surplus]) -> Surplus:
    """Combine the surplus of clips that were measured apart; those without evidence are left out."""
    found = np.array([clip for clip in clips if np.isfinite(clip.surplus)]).reshape(-1, 3)
    if not len(found):
        return NONE
    over, deviation = float(found[:, 0].mean()), float(np.sqrt(np.sum(found[:, 1] ** 2)) / len(found))
    return Surplus(over, deviation, over / deviation if deviation > 1e-12 else float("nan"))


def _nearness(beats: np.ndarray, n_frames: int, sigma_frames: float) -> np.ndarray:
    """Compute the kernel of the distance to the nearest beat in every frame `[shape=(n_frames,)]`."""
    frames = np.arange(n_frames)
    after = np.searchsorted(beats, frames)
    distance = np.minimum(
        np.abs(frames - beats[np.maximum(after - 1, 0)]), np.abs(beats[np.minimum(after, len(beats) - 1)] - frames)
    )
    return np.exp(-0.5 * (distance / sigma_frames) ** 2)

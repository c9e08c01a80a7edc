"""Features of k-NN motion matching (Habibie et al. 2022, §3.1.1): sound and pose, now and a little later."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesturegen.methods.motion_matching.settings import MotionMatching
from gesturegen.motion.skeleton import read_only
from gesturegen.pose_distance import segment_ends, spread
from gesturegen.speech.acoustics import Acoustics

# Half-way times go up however their floating point sums came out.
_TOLERANCE = 1e-6
# Of the largest value: a feature that varies less holds nothing but the rounding of float32.
_CONSTANT = 1e-6
# Rows in float64 at once.
_ROWS = 65536


@dataclass(frozen=True, eq=False)
class Scaling:
    """The scaling of features to z-scores.

    means, scales : float [shape=(D,)], mean and standard deviation of each; scale 0 for one that is constant
    """

    means: np.ndarray
    scales: np.ndarray

    def __post_init__(self) -> None:
        for name in ("means", "scales"):
            object.__setattr__(self, name, read_only(np.asarray(getattr(self, name), dtype=np.float64)))
        if self.means.ndim != 1 or self.means.shape != self.scales.shape:
            raise ValueError(f"means {self.means.shape} and scales {self.scales.shape} do not fit together")

    @classmethod
    def of(cls, features: np.ndarray) -> Scaling:
        """Compute the scaling of the rows of `features` `[shape=(n, D)]`, one or more."""
        if len(features) == 0:
            raise ValueError("no features to scale by")
        means = np.asarray(np.mean(features, axis=0, dtype=np.float64))
        squares, largest = np.zeros_like(means), np.zeros_like(means)
        for start in range(0, len(features), _ROWS):
            rows = np.asarray(features[start : start + _ROWS], dtype=np.float64)
            squares += np.square(rows - means).sum(axis=0)
            largest = np.maximum(largest, np.abs(rows).max(axis=0))
        scales = np.sqrt(squares / len(features))
        scales[scales <= _CONSTANT * largest] = 0.0
        return cls(means, scales)


def apply(scaling: Scaling, features: np.ndarray) -> np.ndarray:
    """Scale `features` to z-scores, float32 `[shape=(n, D)]`; those of a constant feature are 0."""
    features = np.asarray(features)
    if features.ndim != 2 or features.shape[1] != len(scaling.means):
        raise ValueError(f"features {features.shape} do not fit a scaling of {len(scaling.means)}")
    varying = scaling.scales > 0
    factors = np.divide(1.0, scaling.scales, out=np.zeros(len(varying)), where=varying)
    scores = np.empty(features.shape, dtype=np.float32)
    for start in range(0, len(features), _ROWS):
        block = slice(start, start + _ROWS)
        scores[block] = (features[block] - scaling.means) * factors
    return scores


def audio_features(acoustics: Acoustics, times: np.ndarray, settings: MotionMatching) -> np.ndarray:
    """Sample the sound at each time and shortly after, float32 `[shape=(n, audio_values * C)]`, value by value.

    times : `[shape=(n,)]`, seconds. Values are the nearest in time, past the end of the clip its last one.
    """
    times = np.asarray(times, dtype=np.float64)
    later = times[:, None] + settings.audio_interval_seconds * np.arange(settings.audio_values)
    places = np.clip(_nearest(later * acoustics.rate), 0, len(acoustics.values) - 1)
    return acoustics.values[places].reshape(len(times), settings.audio_values * acoustics.values.shape[1])


def pose_features(
    positions: np.ndarray, segment_starts: np.ndarray, fps: float, settings: MotionMatching
) -> np.ndarray:
    """Sample the pose of each frame and shortly after, float32 `[shape=(T, pose_values * J * 3)]`, pose by pose.

    positions : `[shape=(T, J, 3)]`, of the configured joints, relative to the pelvis, cm
    segment_starts : int `[shape=(S,)]`, first frames of the uninterrupted stretches; past the end of its stretch
    a frame sees the stretch's last pose
    """
    n_frames = len(positions)
    ends = spread(segment_ends(segment_starts, n_frames), segment_starts, n_frames)
    offsets = _nearest(settings.pose_interval_seconds * fps * np.arange(settings.pose_values))
    frames = np.minimum(np.arange(n_frames)[:, None] + offsets, ends[:, None])
    width = settings.pose_values * int(np.prod(positions.shape[1:]))
    return np.asarray(positions, dtype=np.float32)[frames].reshape(n_frames, width)


def sequences(
    segment_starts: np.ndarray, n_frames: int, fps: float, settings: MotionMatching
) -> tuple[np.ndarray, np.ndarray]:
    """Cut every segment into sequences: their first frames and the frames after their last, int `[shape=(M,)]`.

    Each is `sequence_seconds` long, in whole frames, but for the last one of a segment, which holds the rest.
    """
    length = max(int(_nearest(settings.sequence_seconds * fps)), 1)
    cuts = [
        np.arange(first, last + 1, length)
        for first, last in zip(segment_starts, segment_ends(segment_starts, n_frames), strict=True)
    ]
    starts = np.concatenate([np.empty(0, dtype=np.int64), *cuts])
    return starts, np.append(starts[1:], n_frames)[: len(starts)]


def _nearest(values: np.ndarray | float) -> np.ndarray:
    """Round to the nearest whole numbers, half-way ones up."""
    return np.floor(np.asarray(values) + (0.5 + _TOLERANCE)).astype(np.int64)

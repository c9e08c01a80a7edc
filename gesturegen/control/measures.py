"""Measures that a condition can be about: height, speed and radius of the hands, and how alike their heights are."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

UNITS = {"height": "cm", "speed": "cm/s", "radius": "cm", "symmetry": "cm"}


def hand_measures(hands: np.ndarray, segment_starts: ArrayLike, fps: float) -> dict[tuple[str, str], np.ndarray]:
    """Compute every measure of every hand in every frame: (measure, hand) -> float `[shape=(N,)]`.

        height   = y
        speed    = ||p(t) - p(t - 1)|| * fps
        radius   = sqrt(x^2 + z^2)
        symmetry = |y of the left - y of the right|, of hand `both` alone

    hands : float [shape=(N, 2, 3)], left and right wrist in cm, seen from the pelvis without its heading, y up
    segment_starts : int [shape=(S,)], first frames of the uninterrupted stretches; frame 0 is one in any case
    fps : frames per second
    Heights, radii and symmetry are in cm, speeds in cm/s; `both` is the mean of the hands. The first frame of a
    stretch copies the speed of the second, a lone frame has speed 0.
    Raises ValueError when the shapes do not fit.
    """
    hands = np.asarray(hands, dtype=np.float64)
    if hands.ndim != 3 or hands.shape[1:] != (2, 3):
        raise ValueError(f"hands have shape {hands.shape}, expected (N, 2, 3)")
    per_hand = {
        "height": hands[..., 1],
        "speed": _speeds(hands, np.asarray(segment_starts, dtype=np.int64), fps),
        "radius": np.hypot(hands[..., 0], hands[..., 2]),
    }
    measures: dict[tuple[str, str], np.ndarray] = {}
    for name, values in per_hand.items():
        measures |= {(name, "left"): values[:, 0], (name, "right"): values[:, 1], (name, "both"): values.mean(axis=1)}
    measures["symmetry", "both"] = np.abs(hands[:, 0, 1] - hands[:, 1, 1])
    return measures


def _speeds(hands: np.ndarray, segment_starts: np.ndarray, fps: float) -> np.ndarray:
    """Compute the speeds of both hands in cm/s, float `[shape=(N, 2)]`."""
    frames = len(hands)
    if len(segment_starts) and not 0 <= segment_starts.min() <= segment_starts.max() < frames:
        raise ValueError(f"segment_starts lie outside the {frames} frames")
    # One more than there are frames: the frame after the last one starts a stretch as well.
    first = np.zeros(frames + 1, dtype=bool)
    first[segment_starts] = True
    first[[0, -1]] = True
    speeds = np.zeros((frames + 1, 2))
    speeds[1:-1] = np.linalg.norm(np.diff(hands, axis=0), axis=-1) * fps
    speeds[first] = 0.0
    starts = np.flatnonzero(first[:-1])
    # The frame after a lone one is itself the first of a stretch, of speed 0 until all are copied at once.
    speeds[starts] = speeds[starts + 1]
    return speeds[:frames]

"""Does the speaker rest where the speech pauses? Reference frames shown in pauses, and speeds of the hands there.

Ours. A speaker who goes on gesturing through a silence looks like a machine.

Conventions
- Frames of the output are judged by the test speech's pauses, frames of the reference by its own.
- Speeds are those of joints relative to the pelvis, per second; a frame's speed leads to it from the one
  before, so that the first frame of a recording or segment has none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def pause_share(paused: ArrayLike, shown_nodes: ArrayLike, speaking: ArrayLike) -> float:
    """Compute the share of the test speech's pause frames that show a frame of a pause of the reference.

    paused : bool [shape=(T,)], the test speech's pauses; shown_nodes : int [shape=(T,)], the node shown at each
    output frame; speaking : bool [shape=(N,)], False at the nodes of the reference's pauses
    NaN where the test speech has no pause or the reference has none.
    """
    paused, speaking = np.asarray(paused, dtype=bool), np.asarray(speaking, dtype=bool)
    if not paused.any() or speaking.all():
        return float("nan")
    return float(np.mean(~speaking[np.asarray(shown_nodes)[paused]]))


def mean_speed(positions: np.ndarray, frames: ArrayLike, segment_starts: ArrayLike = (0,), *, fps: float) -> float:
    """Compute the mean speed of all joints at some frames, cm/s; NaN where none of them has a speed.

    positions : float [shape=(T, J, 3)], cm; frames : bool [shape=(T,)]
    segment_starts : int [shape=(S,)], frames that do not follow on the one before
    """
    places = np.setdiff1d(np.flatnonzero(frames), segment_starts)
    if not len(places) or not positions.shape[1]:
        return float("nan")
    steps = np.asarray(positions, dtype=np.float64)
    return float(np.linalg.norm(steps[places] - steps[places - 1], axis=-1).mean() * fps)


def source_speed(positions: np.ndarray, nodes: ArrayLike, segment_starts: ArrayLike = (0,), *, fps: float) -> float:
    """Compute the mean speed that the shown frames had where they were recorded, cm/s; NaN where none has a speed.

    positions : float [shape=(N, J, 3)], of the reference; nodes : int [shape=(T,)], shown, each counted as often
    as it is shown; segment_starts : int [shape=(S,)], of the reference; their frames have no speed
    """
    nodes = np.asarray(nodes, dtype=int)
    nodes = nodes[~np.isin(nodes, np.asarray(segment_starts, dtype=int))]
    if not len(nodes) or not positions.shape[1]:
        return float("nan")
    steps = np.asarray(positions, dtype=np.float64)
    return float(np.linalg.norm(steps[nodes] - steps[nodes - 1], axis=-1).mean() * fps)

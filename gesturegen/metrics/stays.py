"""Does the motion stay with what was recorded, or does it stutter and repeat itself? Stays, stutters, repeats.

Ours: what a viewer complains of first. It is computed from the reference frame (node) that each output frame shows,
so that it holds for every method, whatever that calls a piece.

Conventions
- A *stay* is a stretch of output frames between two seams, hard joins or unnatural edges: the shown frame goes on as
  it was recorded, at whatever rate, or is held.
- A seam is named by the output frame at which its right side starts. It jumps from where the left side would have
  gone on, the frame after its last one, to the first frame of the right side.
- A *stutter* is a jump of at most `STUTTER_FRAMES` frames, back or ahead, within one clip of the references. A mirrored
  copy is a clip of its own.
- A frame is *shown again* when another stay showed a frame of the same clip within `SAME_FRAMES` of it under
  `AGAIN_SECONDS` before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

STUTTER_FRAMES, SAME_FRAMES, AGAIN_SECONDS = 15, 3, 10.0


class Stays(NamedTuple):
    """Figures of how long the motion stays with its recording; all NaN where there is no output.

    mean_seconds : length of a stay; stutters_per_minute; again_share : share of output frames that are shown again
    """

    mean_seconds: float
    stutters_per_minute: float
    again_share: float


def stays(
    shown_nodes: ArrayLike, seam_frames: ArrayLike, clip_starts: ArrayLike, *, fps: float,
    stutter_frames: int = STUTTER_FRAMES, same_frames: int = SAME_FRAMES, again_seconds: float = AGAIN_SECONDS,
) -> Stays:  # fmt: skip
    """Measure the length of stays, stutters and repeats of one clip.

    shown_nodes : int [shape=(T,)], the node that each output frame shows
    seam_frames : int [shape=(K,)], output frames at which the right side of a seam starts; 0 and T are none
    clip_starts : int [shape=(C,)], first nodes of the clips of the references, ascending
    """
    nodes = np.asarray(shown_nodes, dtype=np.int64)
    if not len(nodes):
        return Stays(float("nan"), float("nan"), float("nan"))
    seams = np.unique(np.asarray(seam_frames, dtype=np.int64))
    seams = seams[(seams > 0) & (seams < len(nodes))]
    clips = np.searchsorted(np.asarray(clip_starts), nodes, side="right") - 1
    jumps = np.abs(nodes[seams] - (nodes[seams - 1] + 1))
    stutters = (jumps <= stutter_frames) & (clips[seams] == clips[seams - 1])
    minutes = len(nodes) / fps / 60.0
    again = shown_again(nodes, seams, clips, same_frames=same_frames, within_frames=round(again_seconds * fps))
    return Stays(len(nodes) / (len(seams) + 1) / fps, int(stutters.sum()) / minutes, float(again.mean()))


def shown_again(
    shown_nodes: np.ndarray, seam_frames: np.ndarray, clips: np.ndarray, *, same_frames: int, within_frames: int
) -> np.ndarray:
    """Find output frames whose node, or nearly it, another stay showed shortly before: bool `[shape=(T,)]`.

    shown_nodes, clips : int [shape=(T,)], shown at each output frame, and the clip that it is of
    """
    stay = np.zeros(len(shown_nodes), dtype=np.int64)
    stay[seam_frames] = 1
    stay = np.cumsum(stay)
    again = np.zeros(len(shown_nodes), dtype=bool)
    for lag in range(1, min(within_frames, len(shown_nodes))):
        again[lag:] |= (
            (np.abs(shown_nodes[lag:] - shown_nodes[:-lag]) <= same_frames)
            & (stay[lag:] != stay[:-lag])
            & (clips[lag:] == clips[:-lag])
        )
    return again

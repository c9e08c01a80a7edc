"""Which frames of the reference does a clip use, how often, and does it stop where the test speech does?

Ours, but for the utilisation of the training set (§5.1.1: 0.25 % per clip on average, 17.5 % in all).

Conventions
- A frame is *held* when it shows the same reference frame as the output frame before it, and *re-used* when
  it shows one that was shown earlier and then left. What remains are first uses, so for T output frames
  `held_share + reused_share + n_used / T = 1`.
- A use of a reference frame is one stay at it, however long it is held: resampling a short path shows frames
  twice in a row, which is no repetition to the eye.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class ReferenceUse(NamedTuple):
    """Figures of how one clip uses its reference.

    n_used : number of different reference frames shown
    used_share : n_used over all reference frames; NaN where the reference is empty
    max_uses : largest number of uses of one reference frame; 0 where there is no output
    held_share, reused_share : shares of the output frames; NaN where there is no output
    """

    n_used: int
    used_share: float
    max_uses: int
    held_share: float
    reused_share: float


class TrainingUtilisation(NamedTuple):
    """Shares of the training set that serve as references.

    per_clip : float64 [shape=(P,)], share of the training set's duration that each test clip draws on
    overall : share of it that any test clip draws on, every training clip counted once
    """

    per_clip: np.ndarray
    overall: float


def reference_use(source_frames: ArrayLike, n_reference_frames: int) -> ReferenceUse:
    """Measure coverage and repetition of the reference in one clip.

    source_frames : int [shape=(T,)], the reference frame (graph node) shown at each output frame
    n_reference_frames : number of frames of the clip's reference
    Raises ValueError when a source frame lies outside the reference.
    """
    frames = np.asarray(source_frames, dtype=np.int64)
    if not frames.size:
        share = 0.0 if n_reference_frames else float("nan")
        return ReferenceUse(0, share, 0, float("nan"), float("nan"))
    if frames.min() < 0 or frames.max() >= n_reference_frames:
        raise ValueError(f"source_frames must lie in 0 to {n_reference_frames - 1}")
    held = np.append(False, frames[1:] == frames[:-1])
    stays = np.bincount(frames[~held])
    n_used, n_held = int(np.count_nonzero(stays)), int(held.sum())
    return ReferenceUse(
        n_used=n_used,
        used_share=n_used / n_reference_frames,
        max_uses=int(stays.max()),
        held_share=n_held / len(frames),
        reused_share=(len(frames) - n_held - n_used) / len(frames),
    )


def key_node_share(key_frames: ArrayLike, shown_nodes: ArrayLike, is_stop: ArrayLike) -> float:
    """Compute the share of the test speech's key nodes at which the motion shows a stop node.

    key_frames : int [shape=(K,)], frames of the key nodes in the test speech
    shown_nodes : int [shape=(T,)], the node shown at each output frame
    is_stop : bool [shape=(N,)], whether each node of the graph is a stop node
    A piece that ends at the key node at frame b shows its last node at b - 1 (§4.2.2): that node decides. A
    key node at frame 0 ends no piece and one after the output's end is not reached; both are left out.
    Returns a share between 0 and 1; NaN where no key node counts.
    """
    frames = np.asarray(key_frames, dtype=np.int64)
    nodes = np.asarray(shown_nodes, dtype=np.int64)
    frames = frames[(frames >= 1) & (frames <= len(nodes))]
    return float(np.mean(np.asarray(is_stop, dtype=bool)[nodes[frames - 1]])) if len(frames) else float("nan")


def training_utilisation(
    references: Sequence[Sequence[str]], durations_seconds: Mapping[str, float]
) -> TrainingUtilisation:
    """Compute the share of the training set that serves as reference, per test clip and in all (§5.1.1).

    references : for each test clip, the names of its reference clips; a name given twice counts once
    durations_seconds : duration of every clip of the training set, used or not
    Figures are NaN where the training set has no duration; `overall` is 0 where there is no test clip.
    Raises ValueError that names a reference which is not in the training set.
    """
    unknown = sorted({name for names in references for name in names} - set(durations_seconds))
    if unknown:
        raise ValueError(f"no duration for reference {unknown[0]!r}")
    total = float(sum(durations_seconds.values()))

    def share(names: set[str]) -> float:
        # Sorted: the order of a set of strings, and so the rounding of the sum, changes from run to run.
        return sum(durations_seconds[name] for name in sorted(names)) / total if total > 0 else float("nan")

    per_clip = np.array([share(set(names)) for names in references], dtype=np.float64)
    return TrainingUtilisation(per_clip, share({name for names in references for name in names}))

"""The motion graph as parallel arrays, its construction and its file format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from gesturegen.clips import Reference
from gesturegen.config import Config, Continuity, Phrases
from gesturegen.graph import continuity, pruning, reference_frames
from gesturegen.graph.reference_frames import ReferenceFrames, describe, join, positions_of, require_one_skeleton
from gesturegen.speech.pauses import phrase_ends
from gesturegen.stored import arrays as stored_arrays
from gesturegen.stored.arrays import Array, Kind

FORMAT_VERSION = 3
# Everything a stored graph depends on beyond its clips.
SETTINGS = (
    "fps", "joints", "skeleton", "positions", "continuity", "audio", "voice", "onsets", "keywords.words", "wrists", "exclude", "breaks",
    "pauses", "phrases", "references.seconds",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class MotionGraph(ReferenceFrames):
    """Edges between the frames of the references, in CSR form.

    indptr : int [shape=(N + 1,)], indices : int [shape=(E,)], ascending in each row
    weights : float32 [shape=(E,)], 0 for natural edges; natural : bool [shape=(E,)]
    thresholds : float [shape=(N,)], NaN where there is none
    phrase_ends : int [shape=(E,)], the nodes at which a phrase of the references' speech ends
    """

    indptr: np.ndarray
    indices: np.ndarray
    weights: np.ndarray
    natural: np.ndarray
    thresholds: np.ndarray
    phrase_ends: np.ndarray

    def __post_init__(self):
        super().__post_init__()
        if (
            len(self.indptr) != self.n_nodes + 1
            or self.indptr[-1] != len(self.indices)
            or len(self.weights) != len(self.indices)
        ):
            raise ValueError("the edges of the graph do not fit its nodes")

    @property
    def n_unnatural_edges(self) -> int:
        return int(np.count_nonzero(~self.natural))

    @cached_property
    def poses(self) -> np.ndarray:
        """Flattened positions, float64 `[shape=(N, J * 3)]`."""
        return continuity.flatten(self.positions)

    @cached_property
    def velocities(self) -> np.ndarray:
        """Of the poses, per frame, `[shape=(N, J * 3)]`."""
        return continuity.velocities(self.poses, self.segment_starts)

    def children(self, node: int) -> np.ndarray:
        return self.indices[self.indptr[node] : self.indptr[node + 1]]


def build(references: Sequence[Reference], config: Config, block_pairs: int | None = None) -> MotionGraph:
    """The motion graph of one or several references with the same skeleton (§4.1).

    Raises DataError when the skeletons differ.
    """
    require_one_skeleton(references, config)
    described = join([describe(reference, config) for reference in references])
    positions = np.concatenate([positions_of(reference.motion, config) for reference in references])
    ends = [phrase_nodes(reference, config.phrases) for reference in references]
    ends = np.concatenate([own + start for own, start in zip(ends, described["clip_starts"], strict=True)])
    return from_positions(positions, settings=config.continuity, block_pairs=block_pairs, phrase_ends=ends, **described)


def phrase_nodes(reference: Reference, settings: Phrases) -> np.ndarray:
    """The frames, among those that may be used, at which a phrase of a reference's speech ends."""
    frames = np.unique(
        np.round(phrase_ends(reference.speech.words, settings, reference.speech.voice) * reference.speech.fps).astype(
            np.int64
        )
    )
    kept = reference.source_frames
    return np.searchsorted(kept, frames[np.isin(frames, kept)])


def from_positions(
    positions: np.ndarray, segment_starts: np.ndarray, settings: Continuity, block_pairs: int | None = None,
    phrase_ends: np.ndarray | None = None, **described,
) -> MotionGraph:  # fmt: skip
    """The graph of stored float32 `positions` `[shape=(N, J, 3)]`, which alone define its edges."""
    nodes = len(positions)
    poses = continuity.flatten(positions)
    speeds = continuity.velocities(poses, segment_starts)
    limits = continuity.thresholds(poses, speeds, segment_starts, settings)
    options = {} if block_pairs is None else {"block_pairs": block_pairs}
    parts = []
    for lefts, rights, weights in continuity.candidate_blocks(poses, speeds, limits, settings, **options):
        keep = pruning.thin_runs(lefts, rights, segment_starts, nodes, settings.l_pn)
        parts.append((lefts[keep], rights[keep], weights[keep]))
    lefts, rights, weights = (np.concatenate(column) for column in zip(*parts, strict=True))
    keep = pruning.drop_neighbours(lefts, rights, segment_starts, nodes, settings.l_pn)
    natural_lefts = np.setdiff1d(np.arange(nodes), continuity.segment_ends(segment_starts, nodes))
    lefts = np.concatenate([natural_lefts, lefts[keep]])
    rights = np.concatenate([natural_lefts + 1, rights[keep]])
    weights = np.concatenate([np.zeros(len(natural_lefts)), weights[keep]])
    order = np.lexsort((rights, lefts))
    return MotionGraph(
        positions=positions,
        segment_starts=segment_starts,
        indptr=np.concatenate([[0], np.cumsum(np.bincount(lefts, minlength=nodes))]),
        indices=rights[order],
        weights=weights[order].astype(np.float32),
        natural=(order < len(natural_lefts)),
        thresholds=limits,
        phrase_ends=np.zeros(0, dtype=np.int64) if phrase_ends is None else phrase_ends,
        **described,
    )


# --- files --------------------------------------------------------------------------------------------------


def _unfit(stored: Mapping[str, np.ndarray]) -> str | None:
    """What is wrong between the arrays of a graph, each of which is as it should be."""
    if problem := reference_frames.unfit(stored):
        return problem
    nodes, natural = len(stored["positions"]), stored["natural"]
    lefts = np.repeat(np.arange(nodes), np.diff(stored["indptr"]))
    if not (np.diff(lefts * nodes + stored["indices"]) > 0).all():
        return "indices do not rise in each row"
    rights = stored["indices"][natural]
    if (rights != lefts[natural] + 1).any() or np.isin(rights, stored["segment_starts"]).any():
        return "natural edges do not lead to the next frame of a segment"
    if stored["weights"][natural].any():
        return "weights of natural edges are not 0"
    return None


KIND = Kind(
    "graph", "build-graph",
    reference_frames.ARRAYS | {
        "indptr": Array("i8", "N+1", stored_arrays.pointers("E")),
        "indices": Array("i8", "E", stored_arrays.below("N")),
        "weights": Array("f4", "E", stored_arrays.not_negative),
        "natural": Array("bool", "E"),
        "thresholds": Array("f8", "N", stored_arrays.finite_or_nan),
        "phrase_ends": Array("i8", "P", stored_arrays.rising("N")),
    },
    FORMAT_VERSION, _unfit,
)  # fmt: skip


def save(path: str | Path, graph: MotionGraph, config: Config, clip_digests: Sequence[str] = ()) -> None:
    """Store it, with the settings that it depends on (`reference_frames.save`)."""
    reference_frames.save(path, graph, KIND, config.section_json(*SETTINGS), clip_digests)


def load(path: str | Path, config: Config | None = None, clip_digests: Sequence[str] | None = None) -> MotionGraph:
    """Read a stored one; DataErrors as by `reference_frames.load`."""
    settings = None if config is None else config.section_json(*SETTINGS)
    return reference_frames.load(MotionGraph, KIND, path, settings, clip_digests, mapped=False)

"""The motion graph as parallel arrays, its construction and its file format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gesturegen import frames as reference_frames
from gesturegen import pose_distance
from gesturegen.data.clips import Reference
from gesturegen.frames import ReferenceFrames, describe, join, one_skeleton, positions_of, require_one_skeleton
from gesturegen.methods.motion_graph import continuity, pruning
from gesturegen.motion.skeleton import Skeleton
from gesturegen.settings.models import Config, Continuity
from gesturegen.settings.speech import Phrases
from gesturegen.speech.pauses import phrase_ends
from gesturegen.stored import arrays as stored_arrays
from gesturegen.stored.arrays import Array, Kind

FORMAT_VERSION = 4


@dataclass(frozen=True, eq=False)
class MotionGraph(ReferenceFrames):
    """A motion graph: edges between the frames of the references, in CSR form.

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

    mapped = False

    def __post_init__(self) -> None:
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
        """Flatten the positions, float64 `[shape=(N, J * 3)]`."""
        return pose_distance.flatten(self.positions)

    @cached_property
    def velocities(self) -> np.ndarray:
        """Compute the velocities of the poses, per frame, `[shape=(N, J * 3)]`."""
        return pose_distance.velocities(self.poses, self.segment_starts)

    @cached_property
    def prepared(self) -> dict:
        """Hold tables that searches computed from the graph and use again, by the settings that they depend on."""
        return {}

    def children(self, node: int) -> np.ndarray:
        """Return the nodes that edges lead to from a node, ascending."""
        return self.indices[self.indptr[node] : self.indptr[node + 1]]


@dataclass(frozen=True, eq=False)
class Part:
    """The part of a graph from one recording: `frames.describe`, positions, and the frames where its phrases end."""

    described: dict
    skeleton: Skeleton
    positions: np.ndarray
    phrase_ends: np.ndarray


def part(reference: Reference, config: Config) -> Part:
    """Extract one reference's part of a graph; DataError when its skeleton lacks a configured joint."""
    return Part(
        describe(reference, config),
        reference.motion.skeleton,
        positions_of(reference.motion, config),
        phrase_nodes(reference, config.phrases),
    )


def assemble(parts: Sequence[Part], config: Config, block_pairs: int | None = None) -> MotionGraph:
    """Build the motion graph of several recordings' parts (§4.1); DataError when the skeletons differ."""
    one_skeleton([(one.described["clip_names"][0], one.skeleton) for one in parts], config)
    described = join([one.described for one in parts])
    positions = np.concatenate([one.positions for one in parts])
    ends = np.concatenate([one.phrase_ends + start for one, start in zip(parts, described["clip_starts"], strict=True)])
    return from_positions(positions, settings=config.continuity, block_pairs=block_pairs, phrase_ends=ends, **described)


def build(references: Sequence[Reference], config: Config, block_pairs: int | None = None) -> MotionGraph:
    """Build the motion graph of one or several references; DataErrors as by `part` and `assemble`."""
    require_one_skeleton(references, config)
    return assemble([part(reference, config) for reference in references], config, block_pairs)


def phrase_nodes(reference: Reference, settings: Phrases) -> np.ndarray:
    """Find the frames, among those that may be used, at which a phrase of a reference's speech ends."""
    frames = np.unique(
        np.round(phrase_ends(reference.speech.words, settings, reference.speech.voice) * reference.speech.fps).astype(
            np.int64
        )
    )
    kept = reference.source_frames
    return np.searchsorted(kept, frames[np.isin(frames, kept)])


def from_positions(
    positions: np.ndarray, segment_starts: np.ndarray, settings: Continuity, block_pairs: int | None = None,
    phrase_ends: np.ndarray | None = None, **described: Any,
) -> MotionGraph:  # fmt: skip
    """Build the graph of stored float32 `positions` `[shape=(N, J, 3)]`, which alone define its edges."""
    nodes = len(positions)
    poses = pose_distance.flatten(positions)
    speeds = pose_distance.velocities(poses, segment_starts)
    limits = continuity.thresholds(poses, speeds, segment_starts, settings)
    options = {} if block_pairs is None else {"block_pairs": block_pairs}
    parts = []
    for lefts, rights, weights in continuity.candidate_blocks(poses, speeds, limits, settings, **options):
        keep = pruning.thin_runs(lefts, rights, segment_starts, nodes, settings.l_pn)
        parts.append((lefts[keep], rights[keep], weights[keep]))
    lefts, rights, weights = (np.concatenate(column) for column in zip(*parts, strict=True))
    keep = pruning.drop_neighbours(lefts, rights, segment_starts, nodes, settings.l_pn)
    natural_lefts = np.setdiff1d(np.arange(nodes), pose_distance.segment_ends(segment_starts, nodes))
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
    """Say what is wrong between the arrays of a graph, each valid by itself; None when nothing is."""
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

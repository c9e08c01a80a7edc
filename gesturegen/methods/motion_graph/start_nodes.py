"""Start nodes of a piece: key nodes ranked by their features (§4.2.3, A.1.3)."""

from __future__ import annotations

import numpy as np

from gesturegen.data.keynodes import KeyNodes
from gesturegen.methods.motion_graph.graph import MotionGraph
from gesturegen.methods.motion_graph.settings import Features
from gesturegen.pose_distance import spread
from gesturegen.settings.models import Config


def features(
    frames: np.ndarray, boundaries: np.ndarray, segment_starts: np.ndarray, segment_ends: np.ndarray, settings: Features
) -> np.ndarray:
    """Compute the lengths in frames `[shape=(K, l_feat)]` of the natural pieces after `frames` `[shape=(K,)]`.

    boundaries : the ascending frames of all key nodes; segment_starts, segment_ends : `[shape=(K,)]`, the
    first frame of the segment a frame lies in and the boundary that closes it. Pieces stop at the
    segment's end; beyond it lengths are 0. With `align: as_printed` the list starts one piece earlier,
    as the formula of §4.2.3 is printed.
    """
    lengths = np.zeros((len(frames), settings.l_feat))
    for row, (frame, start, end) in enumerate(zip(frames, segment_starts, segment_ends, strict=True)):
        marks = boundaries[np.searchsorted(boundaries, frame, side="right") :][: settings.l_feat]
        marks = np.unique(np.append(marks[marks < end], end))
        marks = np.concatenate([[frame], marks[marks > frame]])
        if settings.align == "as_printed":
            before = boundaries[: np.searchsorted(boundaries, frame)]
            marks = np.concatenate([[max(before[-1], start) if len(before) else start], marks])
        pieces = np.diff(marks)[: settings.l_feat]
        lengths[row, : len(pieces)] = pieces
    return lengths


def speech_features(key_nodes: KeyNodes, frames: np.ndarray, n_frames: int, settings: Features) -> np.ndarray:
    """Compute the features `[shape=(K, l_feat)]` of frames of a test speech, whose end counts as a boundary."""
    return features(
        frames, key_nodes.frames, np.zeros(len(frames), dtype=int), np.full(len(frames), n_frames), settings
    )


def graph_features(graph: MotionGraph, settings: Features) -> np.ndarray:
    """Compute the features `[shape=(K, l_feat)]` of the graph's key nodes, each within its segment."""
    nodes = graph.key_nodes.frames
    starts = spread(graph.segment_starts, graph.segment_starts, graph.n_nodes)
    ends = spread(graph.segment_ends, graph.segment_starts, graph.n_nodes)
    return features(nodes, nodes, starts[nodes], ends[nodes], settings)


def feature_distances(test: np.ndarray, graph: np.ndarray, occurrences: np.ndarray, settings: Features) -> np.ndarray:
    """Compute d_feat `[shape=(K,)]` of one test feature `[shape=(l_feat,)]` to key nodes `[shape=(K, l_feat)]`.

    occurrences : `[shape=(K,)]`, how many accepted paths contain the key node. A first element of 0 in the
    test feature is replaced by 1 where it divides.
    """
    full = np.linalg.norm(np.asarray(settings.w_full) * (test - graph), axis=1)
    first = np.abs(1.0 - graph[:, 0] / (test[0] or 1.0))
    return settings.lambda_full * full + settings.lambda_first * first + settings.lambda_occ * occurrences


class StartNodes:
    """The starting nodes of one piece's attempts: the ranking in steps, then random nodes."""

    def __init__(self, graph: MotionGraph, distances: np.ndarray, config: Config, rng: np.random.Generator):
        self.n_nodes, self.count, self.rng = graph.n_nodes, config.beam.l_npaths, rng
        # Ties by frame: key nodes ascend, and the sort is stable.
        ranking = graph.key_nodes.frames[np.argsort(distances, kind="stable")]
        self.best = int(ranking[0])
        self.left = ranking if config.initialization == "feature" else ranking[:0]

    def next(self) -> np.ndarray:
        """Return the next `l_npaths` key nodes, or as many random nodes without replacement when fewer are left."""
        if len(self.left) >= self.count:
            nodes, self.left = self.left[: self.count], self.left[self.count :]
            return nodes
        self.left = self.left[:0]
        return self.rng.choice(self.n_nodes, size=min(self.count, self.n_nodes), replace=False)

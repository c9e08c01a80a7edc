"""Where a piece may start: key nodes ranked by their features (§4.2.3, A.1.3)."""

from __future__ import annotations

import numpy as np

from gesturegen.config import Config, Features
from gesturegen.graph.continuity import spread
from gesturegen.graph.motion_graph import MotionGraph
from gesturegen.keynodes import features


def graph_features(graph: MotionGraph, settings: Features) -> np.ndarray:
    """Features `[shape=(K, l_feat)]` of the graph's key nodes, each within its segment."""
    nodes = graph.key_nodes.frames
    starts = spread(graph.segment_starts, graph.segment_starts, graph.n_nodes)
    ends = spread(graph.segment_ends, graph.segment_starts, graph.n_nodes)
    return features(nodes, nodes, starts[nodes], ends[nodes], settings)


def feature_distances(test: np.ndarray, graph: np.ndarray, occurrences: np.ndarray, settings: Features) -> np.ndarray:
    """d_feat `[shape=(K,)]` of one test feature `[shape=(l_feat,)]` to all key nodes `[shape=(K, l_feat)]`.

    occurrences : `[shape=(K,)]`, how many accepted paths contain the key node. A first element of 0 in the
    test feature is replaced by 1 where it divides.
    """
    full = np.linalg.norm(np.asarray(settings.w_full) * (test - graph), axis=1)
    first = np.abs(1.0 - graph[:, 0] / (test[0] or 1.0))
    return settings.lambda_full * full + settings.lambda_first * first + settings.lambda_occ * occurrences


class StartNodes:
    """Hands out the starting nodes of one piece's attempts: the ranking in steps, then random nodes."""

    def __init__(self, graph: MotionGraph, distances: np.ndarray, config: Config, rng: np.random.Generator):
        self.n_nodes, self.count, self.rng = graph.n_nodes, config.beam.l_npaths, rng
        # Ties by frame: key nodes ascend, and the sort is stable.
        ranking = graph.key_nodes.frames[np.argsort(distances, kind="stable")]
        self.best = int(ranking[0])
        self.left = ranking if config.initialization == "feature" else ranking[:0]

    def next(self) -> np.ndarray:
        """The next `l_npaths` key nodes, or as many random nodes without replacement when fewer are left."""
        if len(self.left) >= self.count:
            nodes, self.left = self.left[: self.count], self.left[self.count :]
            return nodes
        self.left = self.left[:0]
        return self.rng.choice(self.n_nodes, size=min(self.count, self.n_nodes), replace=False)

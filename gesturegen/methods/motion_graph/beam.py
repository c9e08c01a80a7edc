"""Beam search for one piece (§4.2.1) and its acceptance (A.1.2)."""

from __future__ import annotations

import numpy as np

from gesturegen.methods.motion_graph import _beam_kernels as _kernels
from gesturegen.methods.motion_graph.graph import MotionGraph
from gesturegen.methods.motion_graph.settings import Beam

# 0.9 and 1.1 have no exact binary form: a length on the bound counts as inside.
_RATIO_SLACK = 1e-9


def accepted_lengths(target: int, settings: Beam) -> tuple[int, int]:
    """Compute the shortest and longest path length, in nodes, accepted for a piece of `target` frames."""
    return ratio_lengths(target, settings.min_ratio, settings.max_ratio)


def ratio_lengths(target: int, min_ratio: float, max_ratio: float) -> tuple[int, int]:
    """Compute the shortest and longest length, at least 1, whose ratio to `target` lies between the two."""
    shortest = int(np.ceil(min_ratio * target - _RATIO_SLACK))
    longest = int(np.floor(max_ratio * target + _RATIO_SLACK))
    return max(shortest, 1), longest


def search(
    graph: MotionGraph, stops: np.ndarray, starts: np.ndarray, target: int, settings: Beam, natural_start: int = -1
) -> tuple[np.ndarray | None, float]:
    """Find the cheapest accepted path `[shape=(n,)]` from `starts` to a stop node, and its cost; None without one.

    stops : bool `[shape=(N,)]`; target : the piece's length in frames. A path is terminated when its last
    node is a stop node and it has at least two nodes (one suffices for a piece of one frame). Terminated
    paths stay, others are replaced by their extensions, dead ends drop out; the `l_npaths` cheapest go on.
    natural_start : among equally cheap paths the one from this node comes first, then lower node numbers.
    """
    shortest, longest = accepted_lengths(target, settings)
    # A copy of `starts`: a read-only array is a type of its own, for which the loop would be compiled once more.
    nodes, cost = _kernels.beam_search(
        graph.indptr, graph.indices, graph.weights, stops, np.array(starts, dtype=np.int64), natural_start,
        target, settings.l_npaths, shortest, longest, settings.lambda_w, settings.lambda_len,
    )  # fmt: skip
    return (nodes, float(cost)) if len(nodes) else (None, np.inf)

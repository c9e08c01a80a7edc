"""Pruning of candidate edges (§4.1.2): without it the graph is full of short loops."""

from __future__ import annotations

import numpy as np

from gesturegen.methods.motion_graph import _graph_kernels as _kernels
from gesturegen.pose_distance import segment_ends, spread


def thin_runs(
    lefts: np.ndarray, rights: np.ndarray, segment_starts: np.ndarray, n_frames: int, l_pn: int
) -> np.ndarray:
    """Apply pruning 1: mark the candidates that stay, bool `[shape=(K,)]`.

    In each run of consecutive rights of one left inside one segment, the first of every block of `l_pn`.
    lefts, rights : `[shape=(K,)]`, ascending by left, then right.
    """
    segments = spread(np.arange(len(segment_starts)), segment_starts, n_frames)
    return _kernels.thin_runs(lefts, rights, segments, l_pn)


def drop_neighbours(
    lefts: np.ndarray, rights: np.ndarray, segment_starts: np.ndarray, n_frames: int, l_pn: int
) -> np.ndarray:
    """Apply pruning 2: mark the candidates that stay, bool `[shape=(K,)]`.

    A candidate goes when the graph already holds an edge, natural or not, from within `l_pn` of one of its frames
    to within `l_pn` of the other. Neighbourhoods do not cross a segment; left frames ascend.
    """
    starts = spread(segment_starts, segment_starts, n_frames)
    ends = spread(segment_ends(segment_starts, n_frames), segment_starts, n_frames)
    return _kernels.drop_neighbours(lefts, rights, starts, ends, l_pn)

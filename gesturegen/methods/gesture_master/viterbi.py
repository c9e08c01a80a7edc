"""The cheapest sequence of gesture clips for a speech, by dynamic programming (GestureMaster §4.2, equation 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesturegen.methods.gesture_master import _viterbi_kernels


@dataclass(frozen=True, eq=False)
class InEdges:
    """The edges p -> q between C clips, by destination q. The arrays may be read-only, mapped and unaligned.

    indptr : int64 `[shape=(C + 1,)]`; the edges to q are `indptr[q]` to before `indptr[q + 1]`
    sources : int32 `[shape=(E,)]`, ascending within a destination; costs : float32 `[shape=(E,)]`
    """

    indptr: np.ndarray
    sources: np.ndarray
    costs: np.ndarray


def search(
    data: np.ndarray, edges: InEdges, missing: float, reuse: float, twins: np.ndarray, weight: float
) -> tuple[np.ndarray, float]:
    """Find the clips D int `[shape=(n,)]` of n segments of speech that cost the least, and their cost.

    sum_i data[i, D_i] + weight * sum_i t(D_i, D_i+1) + reuse * (the number of i where D_i+1 is D_i or its twin)
    data : `[shape=(n, C)]`, finite; t(p, q) : the cost of the edge p -> q, `missing` where there is none
    twins : int `[shape=(C,)]`, the mirrored copy of each clip, itself where it has none

    The least of all sequences, whatever the numbers. Sums run from the first segment to the last: what was paid
    before, then `reuse`, the transition and the data cost. Of equally cheap ways to a clip the one from the lowest
    clip is taken, and the lowest of equally cheap last clips.
    """
    data = np.asarray(np.require(data, np.float64, ["C", "A"]))
    if data.ndim != 2 or 0 in data.shape:
        raise ValueError(f"data costs need one segment and one clip or more, not the shape {data.shape}")
    if not np.isfinite(data).all() or not np.isfinite([missing, reuse, weight]).all():
        raise ValueError("costs and weights must be finite")
    n_clips = data.shape[1]
    twins = np.asarray(twins, dtype=np.int64)
    if twins.shape != (n_clips,) or twins.min() < 0 or twins.max() >= n_clips:
        raise ValueError(f"every clip of {n_clips} needs a twin among them, not {twins}")
    edges = _checked(edges, n_clips)
    missing, reuse, weight = float(missing), float(reuse), float(weight)
    starts, repeats = _repeats(twins)
    ways, back = _viterbi_kernels.search(
        data, edges.indptr, edges.sources, edges.costs, missing, weight, reuse, starts, repeats
    )
    choice = np.empty(len(data), dtype=np.int64)
    choice[-1] = np.argmin(ways)
    if not np.isfinite(ways[choice[-1]]):
        raise ValueError("the costs are too large to add up")
    for segment in range(len(data) - 1, 0, -1):
        choice[segment - 1] = back[segment, choice[segment]]
    return choice, _total(choice, data, edges, missing, reuse, twins, weight)


def edge_cost(edges: InEdges, source: int, destination: int) -> float | None:
    """Look up the cost of an edge; None where there is none."""
    first, last = edges.indptr[destination], edges.indptr[destination + 1]
    place = first + np.searchsorted(edges.sources[first:last], source)
    return float(edges.costs[place]) if place < last and edges.sources[place] == source else None


def _checked(edges: InEdges, n_clips: int) -> InEdges:
    # Plain arrays of the same memory, mapped or not; only of the short one an aligned copy may be made.
    indptr = np.asarray(np.require(edges.indptr, np.int64, ["C", "A"]))
    sources, costs = np.asarray(edges.sources, dtype=np.int32), np.asarray(edges.costs, dtype=np.float32)
    if indptr.shape != (n_clips + 1,) or sources.ndim != 1 or sources.shape != costs.shape:
        raise ValueError(f"edges of {n_clips} clips have other shapes: {indptr.shape}, {sources.shape}, {costs.shape}")
    if indptr[0] != 0 or indptr[-1] != len(sources) or (np.diff(indptr) < 0).any():
        raise ValueError("edges do not cover their arrays in order")
    if not _viterbi_kernels.sound(indptr, sources, costs):
        raise ValueError("edges need ascending sources among the clips and finite costs")
    return InEdges(indptr, sources, costs)


def _repeats(twins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """List the clips p that q repeats, q == p or q == twins[p], of every q, in CSR form."""
    clips = np.arange(len(twins))
    pairs = np.unique(np.concatenate([clips, twins]) * len(twins) + np.concatenate([clips, clips]))
    destinations, repeats = np.divmod(pairs, len(twins))
    return np.searchsorted(destinations, np.arange(len(twins) + 1)), repeats


def _total(
    choice: np.ndarray, data: np.ndarray, edges: InEdges, missing: float, reuse: float, twins: np.ndarray, weight: float
) -> float:
    total = data[0, choice[0]]
    for segment in range(1, len(choice)):
        p, q = choice[segment - 1], choice[segment]
        if q in (p, twins[p]):
            total += reuse
        edge = _viterbi_kernels.place(edges.sources, edges.indptr[q], edges.indptr[q + 1], p)
        total += weight * (float(edges.costs[edge]) if edge >= 0 else missing)
        total += data[segment, q]
    return float(total)

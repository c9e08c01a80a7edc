"""Compiled loops of the dynamic programming over clips, whose inputs `viterbi.py` checks and types."""

from __future__ import annotations

import numpy as np

from gesturegen.compiled import njit


@njit(cache=True, nogil=True)
def sound(indptr, sources, costs):
    """Tell whether the sources of every destination ascend and are clips, and all costs are finite."""
    n_clips = len(indptr) - 1
    for q in range(n_clips):
        before = -1
        for edge in range(indptr[q], indptr[q + 1]):
            if sources[edge] <= before or not np.isfinite(costs[edge]):
                return False
            before = sources[edge]
        if before >= n_clips:
            return False
    return True


@njit(cache=True, nogil=True)
def place(sources, first, last, p):
    """Find the edge from p among those from `first` to before `last`; -1 for none."""
    end = last
    while first < last:
        middle = (first + last) // 2
        if sources[middle] < p:
            first = middle + 1
        else:
            last = middle
    return first if first < end and sources[first] == p else -1


@njit(cache=True, nogil=True)
def search(data, indptr, sources, costs, missing, weight, reuse, repeat_starts, repeats):
    """Find the cheapest way to every clip at the last segment [shape=(C,)], and the predecessors [shape=(n, C)].

    repeats : the clips before q that cost `reuse`, ascending, from repeat_starts[q] to before repeat_starts[q + 1]
    Of equally cheap predecessors it is the lowest.
    """
    n_segments, n_clips = data.shape
    back = np.full((n_segments, n_clips), -1, dtype=np.int32)
    linked = np.empty(len(repeats), dtype=np.bool_)
    for q in range(n_clips):
        for k in range(repeat_starts[q], repeat_starts[q + 1]):
            linked[k] = place(sources, indptr[q], indptr[q + 1], repeats[k]) >= 0
    before = data[0].copy()
    after = np.empty(n_clips)
    raised = np.empty(n_clips)
    without = np.empty(n_clips)
    marks = np.empty(n_clips, dtype=np.int32)
    for segment in range(1, n_segments):
        for p in range(n_clips):
            raised[p] = before[p]  # with `reuse` where the clip at hand repeats p
            without[p] = before[p] + weight * missing
        # By what they cost without an edge, as rounded; stable, so that equals stay in the order of clips.
        order = np.argsort(without, kind="mergesort")
        marks[:] = -1
        for q in range(n_clips):
            begin, end = repeat_starts[q], repeat_starts[q + 1]
            first, last = indptr[q], indptr[q + 1]
            for k in range(begin, end):
                raised[repeats[k]] = before[repeats[k]] + reuse
            least, choice = np.inf, -1
            for edge in range(first, last):
                way = raised[sources[edge]] + weight * costs[edge]
                if way < least:
                    least, choice = way, sources[edge]
            for k in range(begin, end):
                p = repeats[k]
                if not linked[k]:
                    way = raised[p] + weight * missing
                    if way < least or (way == least and p < choice):
                        least, choice = way, p
                raised[p] = before[p]
            # The first clip in order without an edge and without `reuse` is the best of them. Where even the
            # first of all costs more than `least`, which is the rule, there is no need to look.
            if without[order[0]] <= least:
                for edge in range(first, last):
                    marks[sources[edge]] = q
                for k in range(begin, end):
                    marks[repeats[k]] = q
                for k in range(n_clips):
                    p = order[k]
                    if without[p] > least:
                        break
                    if marks[p] != q:
                        if without[p] < least or p < choice:
                            least, choice = without[p], p
                        break
            after[q] = least + data[segment, q]
            back[segment, q] = choice
        before, after = after, before
    return before, back

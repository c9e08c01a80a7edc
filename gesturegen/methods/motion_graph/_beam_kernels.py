"""Compiled loop of the beam search, whose inputs `beam.py` checks and types."""

from __future__ import annotations

import numpy as np

from gesturegen.compiled import njit


@njit(cache=True, nogil=True)
def beam_search(
    indptr, indices, weights, stops, starts, natural_start, target, width, shortest, longest, lambda_w, lambda_len
):
    """Find the cheapest accepted path from `starts`, and its cost; an empty path when there is none.

    stops : bool per node; natural_start : the node to prefer among equals, -1 for none
    shortest, longest : accepted lengths; target : the length wanted
    """
    capacity = max(len(starts), 64)
    nodes = np.empty((capacity, longest), dtype=np.int64)
    fresh = np.empty((capacity, longest), dtype=np.int64)
    lengths = np.ones(capacity, dtype=np.int64)
    fresh_lengths = np.ones(capacity, dtype=np.int64)
    sums = np.zeros(capacity)
    fresh_sums = np.zeros(capacity)
    count = len(starts)
    for k in range(count):
        nodes[k, 0] = starts[k]
    count = _keep_cheapest(
        nodes,
        lengths,
        sums,
        count,
        fresh,
        fresh_lengths,
        fresh_sums,
        natural_start,
        target,
        width,
        lambda_w,
        lambda_len,
    )
    nodes, fresh = fresh, nodes
    lengths, fresh_lengths = fresh_lengths, lengths
    sums, fresh_sums = fresh_sums, sums
    least = 1 if target == 1 else 2
    for _length in range(1, longest):
        watched = 0
        extended = False
        for k in range(count):
            last = nodes[k, lengths[k] - 1]
            done = stops[last] and lengths[k] >= least
            grow = 1 if done else indptr[last + 1] - indptr[last]
            if watched + grow > capacity:
                capacity = 2 * (watched + grow)
                nodes, lengths, sums = _grown(nodes, lengths, sums, capacity)
                fresh, fresh_lengths, fresh_sums = _grown(fresh, fresh_lengths, fresh_sums, capacity)
            if done:
                _copy(nodes[k], fresh[watched], lengths[k])
                fresh_lengths[watched], fresh_sums[watched] = lengths[k], sums[k]
                watched += 1
                continue
            for edge in range(indptr[last], indptr[last + 1]):
                _copy(nodes[k], fresh[watched], lengths[k])
                fresh[watched, lengths[k]] = indices[edge]
                fresh_lengths[watched] = lengths[k] + 1
                fresh_sums[watched] = sums[k] + weights[edge]
                watched += 1
                extended = True
        count = _keep_cheapest(
            fresh,
            fresh_lengths,
            fresh_sums,
            watched,
            nodes,
            lengths,
            sums,
            natural_start,
            target,
            width,
            lambda_w,
            lambda_len,
        )
        if not extended:
            break
    for k in range(count):  # in order of cost, ties settled
        if max(shortest, least) <= lengths[k] <= longest and stops[nodes[k, lengths[k] - 1]]:
            return nodes[k, : lengths[k]].copy(), _cost(sums[k], lengths[k], target, lambda_w, lambda_len)
    return np.empty(0, dtype=np.int64), np.inf


@njit(cache=True, nogil=True)
def _cost(weight_sum, length, target, lambda_w, lambda_len):
    return lambda_w * weight_sum + lambda_len * abs(1.0 - length / target)


@njit(cache=True, nogil=True)
def _copy(source, destination, length):
    for k in range(length):
        destination[k] = source[k]


@njit(cache=True, nogil=True)
def _grown(nodes, lengths, sums, capacity):
    more_nodes = np.empty((capacity, nodes.shape[1]), dtype=np.int64)
    more_lengths = np.ones(capacity, dtype=np.int64)
    more_sums = np.zeros(capacity)
    more_nodes[: len(nodes)] = nodes
    more_lengths[: len(lengths)] = lengths
    more_sums[: len(sums)] = sums
    return more_nodes, more_lengths, more_sums


@njit(cache=True, nogil=True)
def _keep_cheapest(
    nodes, lengths, sums, count, kept, kept_lengths, kept_sums, natural_start, target, width, lambda_w, lambda_len
):
    """Move the `width` cheapest paths, cheapest first, to `kept`; ties: the natural start, then lower nodes."""
    costs = np.empty(count)
    for k in range(count):
        costs[k] = _cost(sums[k], lengths[k], target, lambda_w, lambda_len)
    taken = min(count, width)
    order = np.arange(count)
    for place in range(taken):
        best = place
        for other in range(place + 1, count):
            if _before(order[other], order[best], costs, nodes, lengths, natural_start):
                best = other
        order[place], order[best] = order[best], order[place]
        _copy(nodes[order[place]], kept[place], lengths[order[place]])
        kept_lengths[place], kept_sums[place] = lengths[order[place]], sums[order[place]]
    return taken


@njit(cache=True, nogil=True)
def _before(a, b, costs, nodes, lengths, natural_start):
    if costs[a] != costs[b]:
        return costs[a] < costs[b]
    a_natural, b_natural = nodes[a, 0] == natural_start, nodes[b, 0] == natural_start
    if a_natural != b_natural:
        return a_natural
    for k in range(min(lengths[a], lengths[b])):
        if nodes[a, k] != nodes[b, k]:
            return nodes[a, k] < nodes[b, k]
    return False  # the same path: no watched path continues another

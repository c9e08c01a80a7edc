"""Compiled loops of motion matching, whose inputs `nearest.py` checks and types.

Sums run in one fixed order, so that a distance has the same bits wherever it is computed.
"""

from __future__ import annotations

import numpy as np

from gesturegen.compiled import njit

# A vector whose square is less counts as zero: it has no direction. The limits of float32 are far from it.
SMALLEST = 1e-30


@njit(cache=True, nogil=True)
def squares(features):
    """Compute the squared lengths [shape=(N,)] of the rows."""
    out = np.empty(len(features))
    for row in range(len(features)):
        total = 0.0
        for k in range(features.shape[1]):
            value = np.float64(features[row, k])
            total += value * value
        out[row] = total
    return out


@njit(cache=True, nogil=True)
def largest(values, starts, stops, valid):
    """Find the largest value [shape=(M,)] among the valid nodes of each sequence, 0 for none."""
    out = np.zeros(len(starts))
    for sequence in range(len(starts)):
        for node in range(starts[sequence], stops[sequence]):
            if valid[node] and values[node] > out[sequence]:
                out[sequence] = values[node]
    return out


@njit(cache=True, nogil=True)
def euclidean(features, row, query):
    """Compute |features[row] - query|."""
    total = 0.0
    for k in range(len(query)):
        step = np.float64(features[row, k]) - query[k]
        total += step * step
    return np.sqrt(total)


@njit(cache=True, nogil=True)
def cosine(features, row, query, of_query):
    """Compute 1 - cos of the angle between features[row] and query, at least 0; 1 where one of them is zero.

    of_query : the squared length of the query
    """
    total, of_row = 0.0, 0.0
    for k in range(len(query)):
        value = np.float64(features[row, k])
        total += value * query[k]
        of_row += value * value
    if of_row < SMALLEST or of_query < SMALLEST:
        return 1.0
    # One root of the product: vectors in the same direction then come out equal more often.
    return max(1.0 - total / np.sqrt(of_row * of_query), 0.0)


@njit(cache=True, nogil=True)
def distances(features, rows, query, of_query, by_angle):
    """Compute the distances [shape=(K,)] of the rows from the query, float64 [shape=(D,)], of known squared length."""
    out = np.empty(len(rows))
    for k in range(len(rows)):
        if by_angle:
            out[k] = cosine(features, rows[k], query, of_query)
        else:
            out[k] = euclidean(features, rows[k], query)
    return out


@njit(cache=True, nogil=True)
def _peak(scores, first, last):
    peak = np.float32(-np.inf)
    for place in range(first, last):
        peak = max(peak, scores[place])
    return peak


@njit(cache=True, nogil=True)
def confirm(
    scores, low, first, last, starts, stops, slacks, features, shift, queries, of_queries, by_angle, nodes, apart
):
    """Update the nearest node of each sequence to each query, and its distance, by a block of nodes.

    scores : float32 [shape=(B, n)], of the nodes from `low`, higher is nearer, -inf for never
    first, last : the sequences that the block touches; starts, stops : int [shape=(M,)], their nodes
    slacks : [shape=(B, M)], how far the score of the nearest node may be below the highest one
    features, shift : those of node j are in the row j + shift
    queries : float64 [shape=(B, D)]; of_queries : [shape=(B,)], their squared lengths
    nodes, apart : [shape=(B, M)], -1 and inf where none was found yet; of equally near nodes it is the lowest
    """
    for row in range(scores.shape[0]):
        query = queries[row]
        for sequence in range(first, last):
            begin = max(starts[sequence] - low, 0)
            end = min(stops[sequence] - low, scores.shape[1])
            peak = _peak(scores[row], begin, end)
            if peak == -np.inf:
                continue
            least = np.float64(peak) - slacks[row, sequence]
            for place in range(begin, end):
                if scores[row, place] < least or scores[row, place] == -np.inf:
                    continue
                node = low + place
                if by_angle:
                    distance = cosine(features, node + shift, query, of_queries[row])
                else:
                    distance = euclidean(features, node + shift, query)
                if distance < apart[row, sequence]:
                    nodes[row, sequence], apart[row, sequence] = node, distance

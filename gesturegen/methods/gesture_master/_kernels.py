"""Compiled loops of the transition costs, whose inputs `transitions.py` checks and types.

No fast-math: sums run in one fixed order, so that a cost has the same bits wherever it is computed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gesturegen.compiled import njit


class Side(NamedTuple):
    """Arrays of the ends or of the starts of C clips; float64, a frame's joints follow those of the frame before.

    points : [shape=(C, 3, F * J)], metres; turns : unit quaternions [shape=(C, 4, F * K)]
    point_sums, turn_sums : [shape=(J, 3, C)] and [shape=(K, 9, C)], positions and rotation matrices over
    sqrt(2), summed over the frames
    """

    points: np.ndarray
    turns: np.ndarray
    point_sums: np.ndarray
    turn_sums: np.ndarray


# Clips whose data stay in the cache while many others pass by.
_TILE = 64
# asin(x) = x (1 + x^2 / 6 + 3 x^4 / 40 + ...); at x = sin(pi / 8), the largest, the rest is below a rounding.
_ARCSINE = tuple(math.comb(2 * k, k) / (4**k * (2 * k + 1)) for k in range(17))


@njit(cache=True, nogil=True)
def _distances(left, right, out):
    """Compute the distances `out` between points [shape=(3, N)]."""
    for k in range(left.shape[1]):
        x, y, z = left[0, k] - right[0, k], left[1, k] - right[1, k], left[2, k] - right[2, k]
        out[k] = np.sqrt(x * x + y * y + z * z)


# A check for division by zero would keep the loop from running on several numbers at once.
@njit(cache=True, nogil=True, error_model="numpy")
def _angles(left, right, out):
    """Compute the angles `out` between rotations [shape=(4, N)] in radians."""
    for k in range(left.shape[1]):
        w, x = left[0, k] - right[0, k], left[1, k] - right[1, k]
        y, z = left[2, k] - right[2, k], left[3, k] - right[3, k]
        apart = w * w + x * x + y * y + z * z
        w, x = left[0, k] + right[0, k], left[1, k] + right[1, k]
        y, z = left[2, k] + right[2, k], left[3, k] + right[3, k]
        # q and -q are one rotation. The chord to the nearer is 2 sin(angle / 4), at most sqrt(2).
        square = 0.25 * min(apart, w * w + x * x + y * y + z * z)
        # The square of sin(angle / 8), of which the series is short.
        square = 0.5 * square / (1.0 + np.sqrt(1.0 - square))
        total = _ARCSINE[16]
        total = total * square + _ARCSINE[15]
        total = total * square + _ARCSINE[14]
        total = total * square + _ARCSINE[13]
        total = total * square + _ARCSINE[12]
        total = total * square + _ARCSINE[11]
        total = total * square + _ARCSINE[10]
        total = total * square + _ARCSINE[9]
        total = total * square + _ARCSINE[8]
        total = total * square + _ARCSINE[7]
        total = total * square + _ARCSINE[6]
        total = total * square + _ARCSINE[5]
        total = total * square + _ARCSINE[4]
        total = total * square + _ARCSINE[3]
        total = total * square + _ARCSINE[2]
        total = total * square + _ARCSINE[1]
        total = total * square + _ARCSINE[0]
        out[k] = 8.0 * (np.sqrt(square) * total)


@njit(cache=True, nogil=True)
def _sum(terms):
    """Sum the terms in one fixed order: four sums run beside each other, for speed."""
    a = b = c = d = 0.0
    fours = len(terms) // 4 * 4
    for k in range(0, fours, 4):
        a += terms[k]
        b += terms[k + 1]
        c += terms[k + 2]
        d += terms[k + 3]
    for k in range(fours, len(terms)):
        a += terms[k]
    return (a + b) + (c + d)


@njit(cache=True, nogil=True)
def _cost(ends, starts, p, q, lambda_1, lambda_2, limit, distances, angles):
    """Compute the transition cost from clip p to clip q, from the positions alone where these reach the limit.

    distances, angles : buffers [shape=(F * J,)] and [shape=(F * K,)]
    """
    _distances(ends.points[p], starts.points[q], distances)
    cost = lambda_1 * _sum(distances)
    if cost < limit:
        _angles(ends.turns[p], starts.turns[q], angles)
        cost += lambda_2 * _sum(angles)
    return cost


@njit(cache=True, nogil=True)
def costs(ends, starts, lefts, rights, lambda_1, lambda_2):
    """Compute the transition costs [shape=(N,)] of pairs of clips."""
    distances, angles = np.empty(ends.points.shape[2]), np.empty(ends.turns.shape[2])
    out = np.empty(len(lefts))
    for k in range(len(lefts)):
        out[k] = _cost(ends, starts, lefts[k], rights[k], lambda_1, lambda_2, np.inf, distances, angles)
    return out


@njit(cache=True, nogil=True)
def below(ends, starts, first, last, lambda_1, lambda_2, limit, reach):
    """Compute costs float32 [shape=(last - first, C)] to the clips from `first`, from all; -1 for `limit` or more.

    reach : a lower bound above it, as computed here, means a cost of at least `limit`
    """
    n_clips = len(ends.points)
    distances, angles = np.empty(ends.points.shape[2]), np.empty(ends.turns.shape[2])
    bounds = np.empty(_TILE)
    out = np.empty((last - first, n_clips), dtype=np.float32)
    for begin in range(0, n_clips, _TILE):
        stop = min(begin + _TILE, n_clips)
        for q in range(first, last):
            bounds[:] = 0.0
            _add_apart(ends.point_sums, starts.point_sums, begin, stop, q, lambda_1, bounds)
            _add_apart(ends.turn_sums, starts.turn_sums, begin, stop, q, lambda_2, bounds)
            for p in range(begin, stop):
                cost = limit
                if bounds[p - begin] <= reach:
                    cost = _cost(ends, starts, p, q, lambda_1, lambda_2, limit, distances, angles)
                out[q - first, p] = cost if cost < limit else -1.0
    return out


@njit(cache=True, nogil=True)
def _add_apart(lefts, rights, begin, stop, q, weight, bounds):
    """Add `weight` times the distances between vectors [shape=(J, D, C)] of clips `begin` to `stop` and clip q."""
    squares = np.empty(_TILE)
    for joint in range(lefts.shape[0]):
        squares[:] = 0.0
        for axis in range(lefts.shape[1]):
            left, right = lefts[joint, axis, begin:stop], rights[joint, axis, q]
            for k in range(stop - begin):
                step = left[k] - right
                squares[k] += step * step
        for k in range(stop - begin):
            bounds[k] += weight * np.sqrt(squares[k])

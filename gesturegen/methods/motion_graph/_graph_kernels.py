"""Compiled loops of the graph's construction, whose inputs the public functions check and type.

No fast-math: sums run in one fixed order, so that a distance has the same bits wherever it is computed.
"""

from __future__ import annotations

import numpy as np

from gesturegen._pose_kernels import distance
from gesturegen.compiled import njit


@njit(cache=True, nogil=True)
def thresholds(poses, velocities, ends, l_cn, lambda_pos, lambda_vel):
    """Compute the mean distance of each frame to the next `l_cn` frames of its segment; NaN for a segment's last."""
    out = np.full(len(poses), np.nan)
    for left in range(len(poses)):
        last = min(left + l_cn, ends[left])
        if last == left:
            continue
        total = 0.0
        for right in range(left + 1, last + 1):
            total += distance(poses[left], poses[right], velocities[left], velocities[right], lambda_pos, lambda_vel)
        out[left] = total / (last - left)
    return out


@njit(cache=True, nogil=True)
def confirm(first_left, mask, poses, velocities, limits, lambda_pos, lambda_vel):
    """Select, of the pairs marked in `mask` (left rows from `first_left`), those with distance below the left's limit.

    Returns parallel arrays left, right, distance in ascending (left, right) order, and the count.
    """
    capacity = 1024
    lefts = np.empty(capacity, dtype=np.int64)
    rights = np.empty(capacity, dtype=np.int64)
    weights = np.empty(capacity, dtype=np.float64)
    count = 0
    for row in range(mask.shape[0]):
        left = first_left + row
        limit = limits[left]
        if np.isnan(limit):
            continue
        for right in range(mask.shape[1]):
            # A frame with a threshold is not its segment's last, so left -> left + 1 is a natural edge.
            if not mask[row, right] or right == left or right == left + 1:
                continue
            weight = distance(poses[left], poses[right], velocities[left], velocities[right], lambda_pos, lambda_vel)
            if weight < limit:
                if count == capacity:
                    capacity *= 2
                    lefts = _grown(lefts, capacity)
                    rights = _grown(rights, capacity)
                    weights = _grown(weights, capacity)
                lefts[count], rights[count], weights[count] = left, right, weight
                count += 1
    return lefts[:count], rights[:count], weights[:count]


@njit(cache=True, nogil=True)
def _grown(array, capacity):
    out = np.empty(capacity, dtype=array.dtype)
    out[: len(array)] = array
    return out


@njit(cache=True, nogil=True)
def thin_runs(lefts, rights, segments, l_pn):
    """Apply pruning 1: of each run of consecutive rights inside one segment, keep every `l_pn`-th from the first."""
    keep = np.zeros(len(lefts), dtype=np.bool_)
    run = 0
    for k in range(len(lefts)):
        consecutive = (
            k > 0 and lefts[k] == lefts[k - 1] and rights[k] == rights[k - 1] + 1
            and segments[rights[k]] == segments[rights[k - 1]]
        )  # fmt: skip
        run = run + 1 if consecutive else 0
        keep[k] = run % l_pn == 0
    return keep


@njit(cache=True, nogil=True)
def drop_neighbours(lefts, rights, starts, ends, l_pn):
    """Apply pruning 2: drop a candidate when the graph already holds an edge near it, in either direction.

    lefts ascend; starts, ends : first and last frame of each frame's segment. Natural edges are in the
    graph from the beginning; the candidates of one left frame do not see each other.
    """
    keep = np.zeros(len(lefts), dtype=np.bool_)
    # The rights of the edges kept so far; those of left frame a are kept[begins[a]:stops[a]].
    kept = np.empty(len(lefts), dtype=np.int64)
    begins = np.zeros(len(starts), dtype=np.int64)
    stops = np.zeros(len(starts), dtype=np.int64)
    count = 0
    first = 0
    while first < len(lefts):
        left = lefts[first]
        begins[left] = count
        c = first
        while c < len(lefts) and lefts[c] == left:
            right = rights[c]
            if not (
                _has_natural(left, right, starts, ends, l_pn)
                or _has_kept(left, right, kept, begins, stops, starts, ends, l_pn)
                or _has_kept(right, left, kept, begins, stops, starts, ends, l_pn)
            ):
                keep[c] = True
                kept[count] = right
                count += 1
            c += 1
        stops[left] = count  # only now: candidates of one left frame do not see each other
        first = c
    return keep


@njit(cache=True, nogil=True)
def _has_natural(left, right, starts, ends, l_pn):
    """Tell whether a natural edge a -> a + 1 joins the neighbourhoods of `left` and `right`, either way round."""
    if starts[left] != starts[right]:
        return False
    for here, there in ((left, right), (right, left)):
        low = max(here - l_pn, there - l_pn - 1, starts[left])
        high = min(here + l_pn, there + l_pn - 1, ends[left] - 1)
        if low <= high:
            return True
    return False


@njit(cache=True, nogil=True)
def _has_kept(near, far, kept, begins, stops, starts, ends, l_pn):
    """Tell whether an edge kept for an earlier left frame leads from near `near` to near `far`."""
    for a in range(max(near - l_pn, starts[near]), min(near + l_pn, ends[near]) + 1):
        for edge in range(begins[a], stops[a]):
            if abs(kept[edge] - far) <= l_pn and starts[kept[edge]] == starts[far]:
                return True
    return False

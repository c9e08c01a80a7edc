"""Compiled loops of the global search, whose inputs `global_search.py` checks and types.

Costs run backwards: what remains to be paid from a node in a frame of the speech to the end of the window.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gesturegen._pose_kernels import distance
from gesturegen.compiled import njit

BLOCK, MOST_TARGETS, MOST_TRIED, MOST_BETWEEN, SIDE_BY_SIDE = 16, 32, 64, 3, 8
# What is added to a float32 for its rounding, and how minima, which have no order, may be found many at a time; there
# are no numbers that are none.
ROUNDING, REORDERED_MINIMA = 1.2e-7, {"nnan", "nsz"}
CAP_MARGIN = 1e-5
NATURAL, HOLD = -1, -2  # how a path goes on; a number from 0 on is the node that it joins to


class Joins(NamedTuple):
    """Tables of a graph for the search, of N nodes, G of which are gates: joins lead from gates to gates.

    successors, left : int [shape=(N,)], the natural successor (itself at a segment's end); nodes to the segment's end
    starts, ends : int [shape=(S,)], the first and last node of each segment
    segments : int [shape=(N,)], the number of each node's segment; stutter : no join may jump so few frames in one
    gates : int [shape=(G,)], ascending; `shift` gates before a gate is the one a frame before it, 0 where none is
    barred : int [shape=(G, 2)], the first gate, and the one after the last, that may not join to each gate
    matrix : float32 [shape=(G, B * BLOCK)], what a join to a gate (row) from another one (column) costs beside its
        price, the barred ones too; inf beyond the last gate
    rows : float32 [shape=(G, B)], the least of each `BLOCK` columns of it without what is barred; blocks :
        [shape=(B, B)], of as many rows, too; halls : [shape=(B, H)], of as many blocks of columns
    detours : [shape=(G,)], what a join from the pose that follows the gate `shift` before to each gate would cost
    nearest : float32 [shape=(G,)], the least of what joins from each gate cost, rounded down
    slack : what rounding may add to four costs of `matrix`
    poses, velocities : float64 [shape=(N, D)]; by_pose, by_velocity : their weights in a join cost
    """

    successors: np.ndarray
    left: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    segments: np.ndarray
    stutter: int
    gates: np.ndarray
    shift: int
    barred: np.ndarray
    matrix: np.ndarray
    rows: np.ndarray
    blocks: np.ndarray
    halls: np.ndarray
    detours: np.ndarray
    nearest: np.ndarray
    slack: float
    poses: np.ndarray
    velocities: np.ndarray
    by_pose: float
    by_velocity: float


class Work(NamedTuple):
    """Work arrays of a search, for N nodes and B blocks of `BLOCK` gates in H halls of as many blocks.

    sums, remains : [shape=(min_stay + 1, N)], of the last frames: the costs along natural successors, and what remains
        after a node
    prices, earned, free, entered : [shape=(N,)], of a frame: what it costs to come to a node and what of that is earned
        by the way; what remains from a node on for a path that may do as it likes, and that begins a stay
    room, costs : float32 [shape=(B * BLOCK,)], what a join from each gate may cost at most, and what a stay costs at it;
        -inf and inf beyond the last gate
    to : int32 [shape=(B * BLOCK,)], the cheapest join from each gate, or -1
    least, most : float32 [shape=(B,)], of `costs` and of `room`; hall_most : [shape=(H,)]
    targets : int [shape=(MOST_TARGETS,)], of the frame ahead, n_targets[0] of them; tried : [shape=(MOST_TRIED,)]
    is_tried : bool [shape=(G,)]
    flags, words : see `_try`
    """

    sums: np.ndarray
    remains: np.ndarray
    prices: np.ndarray
    earned: np.ndarray
    free: np.ndarray
    entered: np.ndarray
    room: np.ndarray
    costs: np.ndarray
    to: np.ndarray
    least: np.ndarray
    most: np.ndarray
    hall_most: np.ndarray
    targets: np.ndarray
    n_targets: np.ndarray
    tried: np.ndarray
    is_tried: np.ndarray
    flags: np.ndarray
    words: np.ndarray


def work_for(joins: Joins, min_stay: int) -> Work:
    """Allocate the work arrays for a search with stays of `min_stay` frames at least."""
    n_nodes, n_gates, (n_blocks, n_halls) = len(joins.successors), len(joins.gates), joins.halls.shape
    words = np.zeros(-(-n_blocks // 8), dtype=np.int64)
    sums, remains = np.empty((2, min_stay + 1, n_nodes))
    prices, earned, free, entered = np.empty((4, n_nodes))
    room = np.full(n_blocks * BLOCK, -np.inf, dtype=np.float32)
    costs = np.full(n_blocks * BLOCK, np.inf, dtype=np.float32)
    least, most = np.empty((2, n_blocks), dtype=np.float32)
    return Work(
        sums, remains, prices, earned, free, entered, room, costs, np.empty(n_blocks * BLOCK, dtype=np.int32), least, most,
        np.empty(n_halls, dtype=np.float32),
        np.zeros(MOST_TARGETS, dtype=np.int64), np.zeros(1, dtype=np.int64), np.zeros(MOST_TRIED, dtype=np.int64),
        np.zeros(n_gates, dtype=np.bool_), words.view(np.bool_), words,
    )  # fmt: skip


class Prices(NamedTuple):
    """Costs of frames, for T frames of speech and N nodes.

    states : int [shape=(T,)]; shown, holding : [shape=(S, N)], of showing a node and of holding it, by state
    gains : [shape=(R, T)], rewards : [shape=(R, N)]; their products are taken off the cost of coming to a node
    marks : int [shape=(K, 3)], frame, first node and node after the last, in order of frames; each costs `mark` more
    mark_starts : int [shape=(T + 1,)], where the marks of each frame begin
    """

    states: np.ndarray
    shown: np.ndarray
    holding: np.ndarray
    gains: np.ndarray
    rewards: np.ndarray
    marks: np.ndarray
    mark_starts: np.ndarray
    mark: float
    join: float


@njit(cache=True, nogil=True)
def _frame_costs(frame, prices, costs, earned):
    """Compute what it costs to come to each node in a frame, and what of that is earned on the way, [shape=(N,)]."""
    costs[:] = prices.shown[prices.states[frame]]
    earned[:] = 0.0
    for row in range(len(prices.gains)):
        gain = prices.gains[row, frame]
        if gain != 0.0:
            for node in range(len(costs)):
                earned[node] += gain * prices.rewards[row, node]
    costs -= earned
    for k in range(prices.mark_starts[frame], prices.mark_starts[frame + 1]):
        for node in range(prices.marks[k, 1], prices.marks[k, 2]):
            costs[node] += prices.mark


@njit(cache=True, nogil=True)
def solve(first_frame, last_frame, after, min_stay, prices, joins, work, actions, caps):
    """Fill `actions` for the frames [first_frame, last_frame): how a path that may do as it likes goes on from each node.

    after : the node that is shown in `last_frame`, or -1 for the end of the speech
    min_stay : how many frames a stay plays on before it may do as it likes
    actions : int32 [shape=(>= frames, N)]
    caps : float32 [shape=(frames, G)], the most that a join and what remains after it may cost for a path to be of
        interest, beside the join's price; [shape=(0, G)] where all are

    `work.entered` then holds the costs of stays that begin in the first frame.
    """
    n_nodes, depth = len(joins.successors), min_stay + 1
    sums, remains, free = work.sums, work.remains, work.free
    costs, earned = work.prices, work.earned
    earned[:] = 0.0
    work.n_targets[0] = 0
    for frame in range(last_frame - 1, first_frame - 1, -1):
        here, ahead = frame % depth, (frame + 1) % depth
        rest = remains[here]
        if frame == last_frame - 1:
            if after >= 0:
                _frame_costs(last_frame, prices, costs, earned)
            _finish(rest, after, earned, prices, joins, actions[frame - first_frame], frame)
        else:
            chosen = actions[frame - first_frame]
            _go_on(rest, free, prices.holding[prices.states[frame + 1]], earned, joins, chosen)
            _join(rest, prices.join, joins, chosen, work, caps[frame - first_frame : frame - first_frame + 1])
        _frame_costs(frame, prices, costs, earned)
        for node in range(n_nodes):
            free[node] = costs[node] + rest[node]
        _add(costs, sums[ahead], sums[here], frame == last_frame - 1, joins)
        _enter(frame, last_frame, after, min_stay, joins, work)


@njit(cache=True, nogil=True)
def _add(costs, ahead, here, is_last, joins):
    """Sum the costs along natural successors, from those of the frame ahead."""
    here[:] = costs
    if is_last:
        return
    for segment in range(len(joins.starts)):
        first, end = joins.starts[segment], joins.ends[segment]
        sums, onwards = here[first:end], ahead[first + 1 : end + 1]
        for k in range(len(sums)):
            sums[k] += onwards[k]


@njit(cache=True, nogil=True)
def _enter(frame, last_frame, after, min_stay, joins, work):
    """Compute what a stay costs that begins at each node: its shortest length, then what remains."""
    sums, remains, entered = work.sums, work.remains, work.entered
    depth = len(sums)
    left_in_window = last_frame - frame
    length = min(min_stay, left_in_window)
    here = sums[frame % depth]
    for segment in range(len(joins.starts)):
        first, last = joins.starts[segment], joins.ends[segment] + 1
        # Where the segment goes on after that length, and where it ends before.
        bound = max(first, last - length)
        costs, begun = entered[first:bound], here[first:bound]
        if length < left_in_window:
            beyond = sums[(frame + length) % depth, first + length :]
            rest = remains[(frame + length - 1) % depth, first + length - 1 :]
            for k in range(len(costs)):
                costs[k] = (begun[k] - beyond[k]) + rest[k]
        elif length < min_stay and after >= 0:
            # Cut by the window: only what goes on naturally is long enough.
            for k in range(len(costs)):
                costs[k] = begun[k] if first + k + length == after else np.inf
        else:
            rest = remains[(frame + length - 1) % depth, first + length - 1 :]
            for k in range(len(costs)):
                costs[k] = begun[k] + rest[k]
        for node in range(bound, last):
            entered[node] = here[node] + remains[(frame + last - 1 - node) % depth, last - 1]


@njit(cache=True, nogil=True)
def _finish(rest, after, earned, prices, joins, chosen, frame):
    """Compute what remains after the last frame of a window.

    earned : [shape=(N,)], by the way in the frame that follows
    """
    rest[:], chosen[:] = 0.0, NATURAL
    if after < 0:
        return
    _join_costs(after, joins, rest)
    for node in range(len(chosen)):
        cost = rest[node]
        rest[node] = 0.0
        if joins.successors[node] == after and joins.left[node] > 1:
            continue
        if node == after:
            rest[node], chosen[node] = prices.holding[prices.states[frame + 1], node] + earned[node], HOLD
        elif joins.segments[node] == joins.segments[after] and abs(after - node - 1) <= joins.stutter:
            rest[node] = np.inf
        else:
            rest[node], chosen[node] = prices.join + cost, after


@njit(cache=True, nogil=True)
def _go_on(rest, free, holding, earned, joins, chosen):
    """Choose the cheaper of the natural successor and a hold, for every node. A held frame earns nothing."""
    for segment in range(len(joins.starts)):
        first, end = joins.starts[segment], joins.ends[segment]
        rests, ways, here, onwards = rest[first:end], chosen[first:end], free[first:end], free[first + 1 : end + 1]
        holds, misses = holding[first:end], earned[first:end]
        for k in range(len(rests)):
            held = (holds[k] + misses[k]) + here[k]
            rests[k] = onwards[k] if onwards[k] <= held else held
            ways[k] = NATURAL if onwards[k] <= held else HOLD
        rest[end], chosen[end] = (holding[end] + earned[end]) + free[end], HOLD


@njit(cache=True, nogil=True)
def _join(rest, price, joins, chosen, work, caps):
    """Find the cheapest join of every gate, where that is cheaper than how the path goes on otherwise.

    Joins to the targets of the frame ahead are tried first, since what is worth joining to there has a forerunner that
    likely is here. What else may be cheaper is found block by block: no pose of one block of nodes is nearer to one
    of another than the blocks are. Of that, what costs no less than the join to a target that has been tried and the way
    from there (distances are a metric) is left out but for the gates that may not join to that target.
    """
    entered, gates = work.entered, joins.gates
    n_gates, n_blocks = len(gates), len(joins.blocks)
    room, costs, to = work.room, work.costs, work.to
    if n_gates == len(rest):
        for gate in range(n_gates):
            room[gate] = rest[gate] - price
            costs[gate] = entered[gate]
    else:
        for gate in range(n_gates):
            room[gate] = rest[gates[gate]] - price
            costs[gate] = entered[gates[gate]]
    for row in range(len(caps)):
        for gate in range(n_gates):
            room[gate] = min(room[gate], caps[row, gate])
    to[:] = -1
    _bound_blocks(costs, room, work.least, work.most)
    n_tried = 0
    for k in range(work.n_targets[0], -1, -1):
        target = work.targets[k] - joins.shift if k < work.n_targets[0] else _cheapest(costs, work.least)
        if target >= 0 and not work.is_tried[target]:
            _try(
                target, costs[target], joins.matrix[target], joins.rows[target], joins.barred[target], room, to,
                work.most, work.flags, work.words,
            )  # fmt: skip
            work.is_tried[target] = True
            work.tried[n_tried] = target
            n_tried += 1
    _bound_halls(work.most, work.hall_most)
    for other in range(n_blocks):
        if _may_win(work.least[other], joins.halls[other], work.hall_most) and _may_win(
            work.least[other], joins.blocks[other], work.most
        ):
            n_tried = _try_block(other, n_tried, joins, work)
    for k in range(n_tried):
        work.is_tried[work.tried[k]] = False
    n_targets = 0
    for gate in range(n_gates):
        target = to[gate]
        if target < 0:
            continue
        node = gates[gate]
        cost = price + entered[gates[target]] + joins.matrix[target, gate]
        if cost < rest[node]:
            rest[node], chosen[node] = cost, gates[target]
            if not work.is_tried[target] and n_targets < MOST_TARGETS:
                work.is_tried[target] = True
                work.targets[n_targets] = target
                n_targets += 1
    work.n_targets[0] = n_targets
    for k in range(n_targets):
        work.is_tried[work.targets[k]] = False


@njit(cache=True, nogil=True, fastmath=REORDERED_MINIMA)
def _bound_blocks(costs, room, least, most):
    """Compute the least cost and the most room of each block."""
    for block in range(len(least)):
        cost, space = costs[block * BLOCK : (block + 1) * BLOCK], room[block * BLOCK : (block + 1) * BLOCK]
        low, high = cost[0], space[0]
        for k in range(BLOCK):
            low, high = min(low, cost[k]), max(high, space[k])
        least[block], most[block] = low, high


@njit(cache=True, nogil=True, fastmath=REORDERED_MINIMA)
def _bound_halls(most, hall_most):
    """Compute the most room of each `BLOCK` blocks."""
    for hall in range(len(hall_most)):
        part = most[hall * BLOCK : (hall + 1) * BLOCK]
        high = part[0]
        for k in range(len(part)):
            high = max(high, part[k])
        hall_most[hall] = high


@njit(cache=True, nogil=True)
def _cheapest(costs, least):
    """Find the first of the gates at which a stay costs least."""
    block = np.argmin(least)
    return block * BLOCK + np.argmin(costs[block * BLOCK : (block + 1) * BLOCK])


@njit(cache=True, nogil=True, inline="always")
def _may_win(cost, bounds, most):
    """Tell whether a cost with its bound is below the room left anywhere."""
    found = False
    for block in range(len(most)):
        found |= cost + bounds[block] < most[block]
    return found


@njit(cache=True, nogil=True)
def _try_block(other, n_tried, joins, work):
    """Join to the gates of one block; return how many targets have been tried by then."""
    matrix, rows, barred, detours = joins.matrix, joins.rows, joins.barred, joins.detours
    costs, most, tried, is_tried = work.costs, work.most, work.tried, work.is_tried
    for target in range(other * BLOCK, min((other + 1) * BLOCK, len(detours))):
        cost = costs[target]
        if is_tried[target] or not _may_win(cost, rows[target], most):
            continue
        way = _way_by(target, cost, n_tried, tried, costs, matrix, detours, joins.shift, joins.slack)
        if way >= 0:
            for block in range(barred[way, 0] // BLOCK, -(-barred[way, 1] // BLOCK)):
                if cost + rows[target, block] < most[block]:
                    _join_from(
                        block, block + 1, target, cost, matrix[target], barred[target], work.room, work.to, most
                    )  # fmt: skip
            continue
        _try(
            target, cost, matrix[target], rows[target], barred[target], work.room, work.to, most, work.flags, work.words
        )  # fmt: skip
        if n_tried < len(tried):
            is_tried[target], tried[n_tried] = True, target
            n_tried += 1
    return n_tried


@njit(cache=True, nogil=True, inline="always")
def _way_by(target, cost, n_tried, tried, costs, matrix, detours, shift, slack):
    """Find a tried target by way of which a stay at another one costs no less; -1 where there is none."""
    if target < shift:
        return -1
    limit = np.float64(cost) - detours[target] - slack
    for k in range(n_tried):
        reach = np.float64(costs[tried[k]] + matrix[tried[k], target - shift])
        if reach + ROUNDING * abs(reach) <= limit:
            return tried[k]
    return -1


@njit(cache=True, nogil=True, inline="always")
def _try(target, cost, row, bounds, barred, room, to, most, flags, words):
    """Join to one gate from all gates for which that is cheaper than what is known.

    flags, words : room for a byte for each block, and the same as numbers of eight bytes
    """
    for block in range(len(most)):
        flags[block] = cost + bounds[block] < most[block]
    block, n_blocks = 0, len(most)
    while block < n_blocks:
        if words[block // 8] == 0:
            block += 8 - block % 8
        elif flags[block]:
            # One loop over blocks that lie near to one another is faster than one over each.
            first, end = block, block + 1
            while block < n_blocks and block < end + MOST_BETWEEN:
                if flags[block]:
                    end = block + 1
                block += 1
            _join_from(first, end, target, cost, row, barred, room, to, most)
        else:
            block += 1


@njit(cache=True, nogil=True, inline="always")
def _join_from(first_block, end_block, target, cost, row, barred, room, to, most):
    """Join to one gate from the gates of some blocks, where that is cheaper than what is known."""
    first, end = first_block * BLOCK, end_block * BLOCK
    middle, after = min(max(first, barred[0]), end), max(min(end, barred[1]), first)
    if first < middle:
        _lower(room[first:middle], to[first:middle], row[first:middle], cost, target)
    if after < end:
        _lower(room[after:end], to[after:end], row[after:end], cost, target)
    _find_most(room[first:end], most[first_block:end_block])


@njit(cache=True, nogil=True, inline="always")
def _lower(values, by, row, cost, name):
    """Lower values to a row of costs and one more where that is less, and record by which row."""
    name = np.int32(name)
    for k in range(len(values)):
        new = cost + row[k]
        better = new < values[k]
        values[k] = new if better else values[k]
        by[k] = name if better else by[k]


@njit(cache=True, nogil=True, inline="always", fastmath=REORDERED_MINIMA)
def _find_most(room, most):
    for block in range(len(most)):
        part = room[block * BLOCK : (block + 1) * BLOCK]
        highest = part[0]
        for k in range(BLOCK):
            highest = max(highest, part[k])
        most[block] = highest


@njit(cache=True, nogil=True)
def add_distances(found, products, to_squares, from_squares, weight):
    """Add weighted distances of points to costs, float32, from the points' squares and -2 times their products."""
    for row in range(len(found)):
        costs, product, square = found[row], products[row], to_squares[row]
        for k in range(len(from_squares)):
            apart = (product[k] + square) + from_squares[k]
            costs[k] += weight * np.sqrt(apart if apart > 0.0 else 0.0)


@njit(cache=True, nogil=True, fastmath=REORDERED_MINIMA)
def bound(matrix, barred, rows, blocks, halls, nearest):
    """Lower `rows`, `blocks`, `halls` and `nearest` to the least costs of joins in `matrix`."""
    for target in range(len(matrix)):
        for block in range(rows.shape[1]):
            costs = matrix[target, block * BLOCK : (block + 1) * BLOCK]
            begin, end = barred[target, 0] - block * BLOCK, barred[target, 1] - block * BLOCK
            least = np.float32(np.inf)
            if end <= 0 or begin >= BLOCK:
                least_of = nearest[block * BLOCK : (block + 1) * BLOCK]
                for k in range(BLOCK):
                    least = min(least, costs[k])
                    least_of[k] = min(least_of[k], costs[k])
            else:
                for k in range(BLOCK):
                    if not begin <= k < end:
                        least = min(least, costs[k])
                        nearest[block * BLOCK + k] = min(nearest[block * BLOCK + k], costs[k])
            rows[target, block] = least
            other = target // BLOCK
            blocks[other, block] = min(blocks[other, block], least)
            halls[other, block // BLOCK] = min(halls[other, block // BLOCK], least)


@njit(cache=True, nogil=True)
def _join_costs(other, joins, found):
    """Fill what a join to a node from each one costs beside its price, with the bits of `graph._kernels.distance`.

    Sums run in its order, those of some nodes side by side.
    """
    n_nodes, size = joins.poses.shape
    poses, velocities = joins.poses, joins.velocities
    apart, turned = np.empty(SIDE_BY_SIDE), np.empty(SIDE_BY_SIDE)
    for first in range(0, n_nodes, SIDE_BY_SIDE):
        nodes = joins.successors[first : first + SIDE_BY_SIDE]
        apart[:], turned[:] = 0.0, 0.0
        for k in range(size):
            pose, velocity = poses[other, k], velocities[other, k]
            for place in range(len(nodes)):
                step = poses[nodes[place], k] - pose
                apart[place] += step * step
                turn = velocities[nodes[place], k] - velocity
                turned[place] += turn * turn
        for place in range(len(nodes)):
            found[first + place] = joins.by_pose * np.sqrt(apart[place]) + joins.by_velocity * np.sqrt(turned[place])


@njit(cache=True, nogil=True)
def cap(nodes, first_frame, last_frame, before, after, min_stay, prices, joins, caps):
    """Fill the caps of `solve` for a window: what joins may cost on a path that is no dearer than the present one.

    What a path has paid at least that comes to a gate and may join from there is found forwards, as if any join cost its
    price and what the nearest target of its gate costs.

    nodes : [shape=(T,)], of the present path; the window are the frames [first_frame, last_frame), the first one with
        `before` included
    """
    n_nodes, depth = len(joins.successors), min_stay + 1
    costs, earned, paid, new = np.empty(n_nodes), np.zeros(n_nodes), np.full(n_nodes, np.inf), np.empty(n_nodes)
    # Of the last `depth` frames: the costs along natural forerunners, and what stays that begin have paid before.
    sums, begun = np.zeros((depth, n_nodes)), np.full(depth, np.inf)
    present, scale = 0.0, 0.0
    for frame in range(first_frame, last_frame):
        if frame == first_frame and before >= 0:
            paid[before] = 0.0
        else:
            _frame_costs(frame, prices, costs, earned)
            present += costs[nodes[frame]]
            scale += _largest(costs)
            holding = prices.holding[prices.states[frame]]
            if frame == first_frame:
                begun[frame % depth] = 0.0
            else:
                present += _step(nodes[frame - 1], nodes[frame], holding, earned, prices.join, joins)
                begun[frame % depth] = _nearest(paid, joins.gates, joins.nearest) + prices.join
            _pay(frame, paid, new, costs, holding, earned, begun, sums, joins)
            paid, new = new, paid
        row = caps[frame - first_frame]
        for gate in range(len(row)):
            row[gate] = -paid[joins.gates[gate]] - prices.join
    if after >= 0:
        _frame_costs(last_frame, prices, costs, earned)
        holding = prices.holding[prices.states[last_frame]]
        present += _step(nodes[last_frame - 1], after, holding, earned, prices.join, joins)
    # Costs are float32 where joins are looked for; nothing may be lost by rounding.
    limit = present + CAP_MARGIN * (scale + abs(present) + prices.join)
    for row in range(len(caps)):
        for gate in range(caps.shape[1]):
            caps[row, gate] = limit + caps[row, gate]


@njit(cache=True, nogil=True)
def _pay(frame, paid, new, costs, holding, earned, begun, sums, joins):
    """Compute the least that a path has paid, up to a frame, that comes to each node and may do as it likes there."""
    depth = len(begun)
    min_stay = depth - 1
    here, back, old = sums[frame % depth], sums[(frame - 1) % depth], sums[(frame - min_stay) % depth]
    joined = begun[(frame - min_stay + 1) % depth]
    for segment in range(len(joins.starts)):
        first, end = joins.starts[segment], joins.ends[segment] + 1
        here[first], new[first] = costs[first], costs[first] + (paid[first] + (holding[first] + earned[first]))
        price, holds, misses = costs[first + 1 : end], holding[first + 1 : end], earned[first + 1 : end]
        out, total = new[first + 1 : end], here[first + 1 : end]
        held, gone, before = paid[first + 1 : end], paid[first : end - 1], back[first : end - 1]
        for k in range(len(out)):
            total[k] = before[k] + price[k]
            least = held[k] + (holds[k] + misses[k])
            out[k] = price[k] + (gone[k] if gone[k] < least else least)
        # Stays that have lasted long enough just now, the first of them from the beginning of the segment on.
        youngest = first + min_stay - 1
        if youngest < end:
            new[youngest] = min(new[youngest], joined + here[youngest])
        out, total, before = new[youngest + 1 : end], here[youngest + 1 : end], old[first : end - min_stay]
        for k in range(len(out)):
            least = joined + (total[k] - before[k])
            out[k] = least if least < out[k] else out[k]
        # What is shorter may join from the segment's end.
        for age in range(1, min(min_stay, end - first + 1)):
            before_stay = sums[(frame - age) % depth, end - 1 - age] if age < end - first else 0.0
            new[end - 1] = min(new[end - 1], begun[(frame - age + 1) % depth] + (here[end - 1] - before_stay))


@njit(cache=True, nogil=True)
def _nearest(paid, gates, nearest):
    """Compute the least that a path has paid that has just joined, without the price of the join."""
    least = np.inf
    for gate in range(len(gates)):
        least = min(least, paid[gates[gate]] + nearest[gate])
    return least


@njit(cache=True, nogil=True)
def _step(node, other, holding, earned, price, joins):
    """Compute what the step from one node to another costs beside the price of showing it."""
    if joins.left[node] > 1 and other == node + 1:
        return 0.0
    if other == node:
        return holding[node] + earned[node]
    ahead = joins.successors[node]
    return price + distance(
        joins.poses[ahead], joins.poses[other], joins.velocities[ahead], joins.velocities[other],
        joins.by_pose, joins.by_velocity,
    )  # fmt: skip


@njit(cache=True, nogil=True, fastmath=REORDERED_MINIMA)
def _largest(values):
    largest = 0.0
    for k in range(len(values)):
        largest = max(largest, abs(values[k]))
    return largest


@njit(cache=True, nogil=True)
def repeated(nodes, bounds, n_nodes, near, most_frames):
    """Mark frames that show a node within `near` of one that another stay showed less than `most_frames` before.

    bounds : the first frame of each stay, and the number of frames
    """
    last_shown = np.full(n_nodes, -1)
    found = np.zeros(len(nodes), dtype=np.bool_)
    for stay in range(len(bounds) - 1):
        for frame in range(bounds[stay], bounds[stay + 1]):
            before = -1
            for node in range(max(nodes[frame] - near, 0), min(nodes[frame] + near + 1, n_nodes)):
                before = max(before, last_shown[node])
            found[frame] = before >= 0 and frame - before < most_frames
        for frame in range(bounds[stay], bounds[stay + 1]):
            last_shown[nodes[frame]] = frame
    return found


@njit(cache=True, nogil=True)
def marks(nodes, bounds, first, last, reach, near, n_nodes, inside):
    """List, for the frames [first, last), nodes near those that other stays show up to `reach` frames before or after.

    Rows of the frame, the first node and the node after the last, in order of frames, as in `Prices`.
    inside : whether stays of [first, last) count as well
    """
    rows = np.empty((max(last - first, 0) * (len(bounds) - 1), 3), dtype=np.int64)
    count = 0
    for frame in range(first, last):
        for stay in range(len(bounds) - 1):
            start, end = bounds[stay], bounds[stay + 1]
            if start <= frame < end or (start < last and end > first and not inside):
                continue
            begin, stop = max(start, frame - reach), min(end, frame + reach + 1)
            if begin < stop:
                rows[count, 0] = frame
                rows[count, 1] = max(nodes[begin] - near, 0)
                rows[count, 2] = min(nodes[stop - 1] + near + 1, n_nodes)
                count += 1
    return rows[:count]


@njit(cache=True, nogil=True)
def follow(node, age, first_frame, last_frame, min_stay, joins, actions):
    """Follow the best path from a node in a frame on `[shape=(last_frame - first_frame,)]`.

    age : for how many frames the node's stay has lasted, this one included
    """
    nodes = np.empty(last_frame - first_frame, dtype=np.int64)
    for place in range(len(nodes)):
        nodes[place] = node
        action = NATURAL if age < min_stay and joins.left[node] > 1 else actions[place, node]
        age += 1
        if action == NATURAL:
            node = joins.successors[node]
        elif action >= 0:
            node, age = np.int64(action), 1
    return nodes

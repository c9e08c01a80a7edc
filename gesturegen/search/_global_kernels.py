"""The loops of the global search. Inputs are checked and typed by `global_search.py`.

Costs run backwards: what remains to be paid from a node in a frame of the speech to the end of the window.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gesturegen.compiled import njit
from gesturegen.graph._kernels import distance

BLOCK, MOST_TARGETS = 16, 32
NATURAL, HOLD = -1, -2  # how a path goes on; a number from 0 on is the node that it joins to


class Joins(NamedTuple):
    """What a graph offers to a search, for N nodes, of which G are gates: joins lead from gates to gates.

    successors, left : int [shape=(N,)], the natural successor (itself at a segment's end); nodes to the segment's end
    segments : int [shape=(N,)], the number of each node's segment; stutter : no join may jump so few frames in one
    gates : int [shape=(G,)], ascending; `shift` gates before a gate is the one a frame before it, 0 where none is
    matrix : float32 [shape=(G, G)], what a join to a gate (row) from another one (column) costs beside its price; inf
        for steps that are no joins
    rows : float32 [shape=(G, B)], the least of each `BLOCK` columns of it; blocks : [shape=(B, B)], of as many rows, too
    poses, velocities : float64 [shape=(N, D)]; by_pose, by_velocity : their weights in a join cost
    """

    successors: np.ndarray
    left: np.ndarray
    segments: np.ndarray
    stutter: int
    gates: np.ndarray
    shift: int
    matrix: np.ndarray
    rows: np.ndarray
    blocks: np.ndarray
    poses: np.ndarray
    velocities: np.ndarray
    by_pose: float
    by_velocity: float


class Prices(NamedTuple):
    """What frames cost, for T frames of speech and N nodes.

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
    """What it costs to come to each node in a frame, and what of that is earned by the way, both [shape=(N,)]."""
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
def solve(first_frame, last_frame, after, min_stay, prices, joins, actions, entered):
    """Fill `actions` for the frames [first_frame, last_frame): how a path that may do as it likes goes on from each node.

    after : the node that is shown in `last_frame`, or -1 for the end of the speech
    min_stay : how many frames a stay plays on before it may do as it likes
    actions : int32 [shape=(>= frames, N)]; entered : [shape=(N,)], filled with the costs of stays that begin in the first frame
    """
    n_nodes, depth = len(joins.successors), min_stay + 1
    # Of the last `depth` frames: the costs along natural successors, and what remains after a node.
    sums = np.zeros((depth, n_nodes + 1))
    remains = np.full((depth, n_nodes + 1), np.inf)
    costs, earned = np.empty(n_nodes), np.zeros(n_nodes)
    free = np.full(n_nodes + 1, np.inf)  # of a path that may do as it likes in the frame ahead
    targets = np.empty(MOST_TARGETS + 1, dtype=np.int64)
    n_targets = 0
    for frame in range(last_frame - 1, first_frame - 1, -1):
        here, ahead = frame % depth, (frame + 1) % depth
        rest = remains[here]
        if frame == last_frame - 1:
            if after >= 0:
                _frame_costs(last_frame, prices, costs, earned)
            _finish(rest, after, earned, prices, joins, actions[frame - first_frame], frame)
        else:
            # What is held earns nothing.
            holding = prices.holding[prices.states[frame + 1]] + earned
            chosen = actions[frame - first_frame]
            n_targets = _continue(rest, free, holding, entered, prices.join, joins, chosen, targets, n_targets)
        _frame_costs(frame, prices, costs, earned)
        for node in range(n_nodes):
            free[node] = costs[node] + rest[node]
            sums[here, node] = costs[node]
            if joins.left[node] > 1 and frame < last_frame - 1:
                sums[here, node] += sums[ahead, node + 1]
        _enter(frame, last_frame, after, min_stay, joins, sums, remains, entered)


@njit(cache=True, nogil=True)
def _enter(frame, last_frame, after, min_stay, joins, sums, remains, entered):
    """What a stay costs that begins at each node: its shortest length, then what remains."""
    depth = len(sums)
    left_in_window = last_frame - frame
    for node in range(len(entered)):
        length = min(min_stay, joins.left[node], left_in_window)
        last = frame + length - 1
        cost = sums[frame % depth, node]
        if length < joins.left[node] and length < left_in_window:
            cost -= sums[(last + 1) % depth, node + length]
        end = node + length - 1
        if length < min(min_stay, joins.left[node]) and after >= 0:
            # Cut by the window: only what goes on naturally is long enough.
            if joins.successors[end] != after:
                cost = np.inf
        else:
            cost += remains[last % depth, end]
        entered[node] = cost


@njit(cache=True, nogil=True)
def _finish(rest, after, earned, prices, joins, chosen, frame):
    """What remains after the last frame of a window.

    earned : [shape=(N,)], by the way in the frame that follows
    """
    for node in range(len(chosen)):
        rest[node], chosen[node] = 0.0, NATURAL
        if after < 0 or (joins.successors[node] == after and joins.left[node] > 1):
            continue
        if node == after:
            rest[node], chosen[node] = prices.holding[prices.states[frame + 1], node] + earned[node], HOLD
        elif joins.segments[node] == joins.segments[after] and abs(after - node - 1) <= joins.stutter:
            rest[node] = np.inf
        else:
            rest[node], chosen[node] = prices.join + join_cost(joins.successors[node], after, joins), after


@njit(cache=True, nogil=True)
def _continue(rest, free, holding, entered, price, joins, chosen, targets, n_targets):
    """The cheapest of the natural successor, a hold and a join, for every node.

    Joins to the targets of the frame ahead are tried first, since what is worth joining to there has a forerunner that
    likely is here. What else may be cheaper is found block by block: no pose of one block of nodes is nearer to one
    of another than the blocks are.
    """
    for node in range(len(chosen)):
        natural = free[node + 1] if joins.left[node] > 1 else np.inf
        held = holding[node] + free[node]
        if natural <= held:
            rest[node], chosen[node] = natural, NATURAL
        else:
            rest[node], chosen[node] = held, HOLD
    # What a join from each gate may cost at most, and the cheapest one.
    n_gates, n_blocks = len(joins.gates), len(joins.blocks)
    room = np.full(n_blocks * BLOCK, -np.inf, dtype=np.float32)
    costs = np.full(n_blocks * BLOCK, np.inf, dtype=np.float32)
    for gate in range(n_gates):
        room[gate] = rest[joins.gates[gate]] - price
        costs[gate] = entered[joins.gates[gate]]
    to = np.full(n_blocks * BLOCK, -1, dtype=np.int32)
    targets[n_targets] = np.argmin(costs) + joins.shift
    for k in range(n_targets, -1, -1):
        target = targets[k] - joins.shift
        if target >= 0:
            _try(target, costs[target], joins.matrix, 0, n_gates, room, to)
    least, most = np.empty(n_blocks, dtype=np.float32), np.empty(n_blocks, dtype=np.float32)
    for block in range(n_blocks):
        least[block], most[block] = np.inf, -np.inf
        for gate in range(block * BLOCK, (block + 1) * BLOCK):
            least[block], most[block] = min(least[block], costs[gate]), max(most[block], room[gate])
    for other in range(n_blocks):
        for block in range(n_blocks):
            if least[other] + joins.blocks[other, block] < most[block]:
                first, last = block * BLOCK, min((block + 1) * BLOCK, n_gates)
                for target in range(other * BLOCK, min((other + 1) * BLOCK, n_gates)):
                    if costs[target] + joins.rows[target, block] < most[block]:
                        _try(target, costs[target], joins.matrix, first, last, room, to)
    is_target = np.zeros(n_gates, dtype=np.bool_)
    n_targets = 0
    for gate in range(n_gates):
        target = to[gate]
        if target < 0:
            continue
        node = joins.gates[gate]
        cost = price + entered[joins.gates[target]] + joins.matrix[target, gate]
        if cost < rest[node]:
            rest[node], chosen[node] = cost, joins.gates[target]
            if not is_target[target] and n_targets < MOST_TARGETS:
                is_target[target] = True
                targets[n_targets] = target
                n_targets += 1
    return n_targets


@njit(cache=True, nogil=True)
def join_cost(node, other, joins):
    """What a join costs beside its price, where `node` would have come next and `other` comes."""
    return distance(
        joins.poses[node], joins.poses[other], joins.velocities[node], joins.velocities[other],
        joins.by_pose, joins.by_velocity,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _try(target, cost, matrix, first, last, room, to):
    """Join to one gate from the gates [first, last), where that is cheaper than what is known."""
    for gate in range(first, last):
        if cost + matrix[target, gate] < room[gate]:
            room[gate] = cost + matrix[target, gate]
            to[gate] = target


@njit(cache=True, nogil=True)
def follow(node, age, first_frame, last_frame, min_stay, joins, actions):
    """The best path from a node in a frame on `[shape=(last_frame - first_frame,)]`.

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

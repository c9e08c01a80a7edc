"""The loops of the global search. Inputs are checked and typed by `global_search.py`.

Costs run backwards, from the end of the speech: what remains to be paid from a node at a place in a piece.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gesturegen.compiled import njit
from gesturegen.graph._kernels import distance

_BANDS = 256
_CHUNK = 64
END, NATURAL, HOLD, EDGE = 0, 1, 2, 3  # actions; EDGE + e is the e-th unnatural edge of the node


class Joins(NamedTuple):
    """What a graph offers to a search, for N nodes.

    successors : int [shape=(N,)]; edge_starts, edge_nodes, edge_costs : unnatural edges in CSR form
    with_edges : the nodes that have any; near_nodes, near_costs : [shape=(N, M)], the nearest nodes of each
    nearest_costs : [shape=(N,)], to the nearest one of all
    stops : int [shape=(K,)], successors of stop nodes; stop_costs : float32 [shape=(K, N)], lower bounds of the
    join costs from them, or [shape=(0, 0)] where they would take too much memory
    anchors, anchor_costs : [shape=(N,)], for each node the place in `stops` of one near it, and the cost between
    poses, velocities : float64 [shape=(N, D)]; by_pose, by_velocity : their weights in a join cost
    sketch : float32 [shape=(N, 2, M)], poses and velocities in the few directions in which they differ most
    sketch_weights : [shape=(2,)], their weights in a cost between sketches, a lower bound of the join cost but for
    slack : what rounding may add to it
    """

    successors: np.ndarray
    edge_starts: np.ndarray
    edge_nodes: np.ndarray
    edge_costs: np.ndarray
    with_edges: np.ndarray
    near_nodes: np.ndarray
    near_costs: np.ndarray
    nearest_costs: np.ndarray
    stops: np.ndarray
    stop_costs: np.ndarray
    anchors: np.ndarray
    anchor_costs: np.ndarray
    poses: np.ndarray
    velocities: np.ndarray
    sketch: np.ndarray
    sketch_weights: np.ndarray
    by_pose: float
    by_velocity: float
    slack: float


class Pieces(NamedTuple):
    """Consecutive pieces of a test speech, P of them.

    starts, lengths, shortest, longest : int [shape=(P,)], in frames; rules : their rows of `end_prices`
    end_prices : [shape=(R, N)], of each node as a last one; open_rules : bool [shape=(R,)], all of them 0
    states : int [shape=(T,)], of the test speech (`objective.PriceList`)
    followed : whether more of the path follows the last of them
    """

    starts: np.ndarray
    lengths: np.ndarray
    shortest: np.ndarray
    longest: np.ndarray
    rules: np.ndarray
    end_prices: np.ndarray
    open_rules: np.ndarray
    states: np.ndarray
    followed: bool


PER_PIECE = ("starts", "lengths", "shortest", "longest", "rules")


class Prices(NamedTuple):
    """Prices of nodes, most of them by the state of the test speech [shape=(S, N)], and of a length's misfit.

    shown : of each frame; least_shown : [shape=(N,)], in the node's best state; passing : of leaving the node inside a piece; holding : of staying at it for a frame
    entering : [shape=(N,)], of coming to the node, however long the path stays
    """

    shown: np.ndarray
    least_shown: np.ndarray
    passing: np.ndarray
    holding: np.ndarray
    entering: np.ndarray
    misfit: float


class Tables(NamedTuple):
    """What the program fills.

    actions : [shape=(>= sum of longest * N,)]; offsets : int [shape=(P,)], where a piece begins in it
    first_costs : [shape=(P + 1, N)], what remains from each first node of a piece, and of what follows them
    last_costs : [shape=(P, N)], what remains after each last node, exactly or a lower bound; exact says which
    targets : int [shape=(P, N)], the first node of the next piece after each last node
    wanted : [shape=(P, N)], where `last_costs` must be exact
    """

    actions: np.ndarray
    offsets: np.ndarray
    first_costs: np.ndarray
    last_costs: np.ndarray
    exact: np.ndarray
    targets: np.ndarray
    wanted: np.ndarray


@njit(cache=True, nogil=True)
def solve(last_piece, pieces, prices, joins, tables):
    """Fill the tables of the pieces up to `last_piece`, backwards; those after it are filled already.

    Given are the last row of `first_costs` or, where nothing follows, that of `last_costs`.
    """
    n_nodes = len(joins.successors)
    # `entered` is one longer, so that [u + 1] exists; segment ends are masked by `leaving`.
    ahead = np.full(n_nodes, np.inf)
    here = np.full(n_nodes, np.inf)
    entered = np.full(n_nodes + 1, np.inf)
    leaving = prices.passing.copy()
    for node in range(n_nodes):
        if joins.successors[node] == node:
            leaving[:, node] = np.inf
    ending = np.empty(n_nodes)
    for piece in range(last_piece, -1, -1):
        length = pieces.lengths[piece]
        if piece < len(pieces.starts) - 1 or pieces.followed:
            _bound_joins(piece, pieces, prices, joins, tables)
        for node in range(n_nodes):
            ending[node] = pieces.end_prices[pieces.rules[piece], node] + tables.last_costs[piece, node]
        state_ahead = 0
        for k in range(pieces.longest[piece] - 1, -1, -1):
            state = pieces.states[pieces.starts[piece] + min(k, length - 1)]
            place = tables.offsets[piece] + k * n_nodes
            chosen = tables.actions[place : place + n_nodes]
            misfit = prices.misfit * abs(1.0 - (k + 1) / length) if k + 1 >= pieces.shortest[piece] else np.inf
            if k == pieces.longest[piece] - 1:
                for node in range(n_nodes):
                    here[node] = misfit + ending[node] + prices.shown[state, node]
                    chosen[node] = END
            else:
                _step(here, ahead, entered, chosen, misfit, ending, leaving[state], prices.holding[state_ahead])
                for node in joins.with_edges:
                    first = joins.edge_starts[node]
                    for edge in range(first, joins.edge_starts[node + 1]):
                        cost = prices.passing[state, node] + joins.edge_costs[edge] + entered[joins.edge_nodes[edge]]
                        if cost < here[node]:
                            here[node] = cost
                            chosen[node] = EDGE + edge - first
                for node in range(n_nodes):
                    here[node] += prices.shown[state, node]
            here, ahead = ahead, here
            for node in range(n_nodes):
                entered[node] = ahead[node] + prices.entering[node]
            state_ahead = state
        tables.first_costs[piece] = entered[:n_nodes]


@njit(cache=True, nogil=True)
def _step(here, ahead, entered, chosen, misfit, ending, leaving, holding):
    """Of the end, the natural edge and the hold edge the cheapest, for every node."""
    for node in range(len(chosen)):
        best = misfit + ending[node]
        action = END
        cost = leaving[node] + entered[node + 1]
        if cost < best:
            best = cost
            action = NATURAL
        cost = holding[node] + ahead[node]
        if cost < best:
            best = cost
            action = HOLD
        here[node] = best
        chosen[node] = action


@njit(cache=True, nogil=True)
def _bound_joins(piece, pieces, prices, joins, tables):
    """What remains to be paid after each node as a last one: exact after stop nodes, else a lower bound.

    The cheapest join from a pose to any first node changes no faster than the pose does, because the join
    cost is a metric: that bounds it from the nearest stop node's. Where a path needs more, `wanted` says so.
    """
    first_costs, after, exact = tables.first_costs[piece + 1], tables.last_costs[piece], tables.exact[piece]
    targets, wanted = tables.targets[piece], tables.wanted[piece]
    n_nodes = len(joins.successors)
    least = first_costs.min()
    # Where a piece may end anywhere every node is a likely end that is in the state of the test speech there.
    anywhere = pieces.open_rules[pieces.rules[piece]]
    state = pieces.states[pieces.starts[piece] + pieces.lengths[piece] - 1]
    n_stops = len(joins.stops)
    froms = np.empty(n_stops + n_nodes, dtype=np.int64)
    froms[:n_stops] = joins.stops
    later = np.empty(n_nodes, dtype=np.int64)
    n_later = 0
    for node in range(n_nodes):
        likely = anywhere and prices.shown[state, node] <= prices.least_shown[node]
        if joins.successors[node] == node or wanted[node] or likely:
            later[n_later] = node
            froms[n_stops + n_later] = joins.successors[node]
            n_later += 1
    best, to = _cheapest(froms[: n_stops + n_later], joins.stop_costs, first_costs, least, joins)
    for node in range(n_nodes):
        ahead = joins.successors[node]
        anchor, way = joins.anchors[ahead], joins.anchor_costs[ahead]
        if way == 0.0:
            after[node], targets[node], exact[node] = best[anchor], to[anchor], True
            continue
        bound = max(best[anchor] - way, least + joins.nearest_costs[ahead])
        known, where = first_costs[ahead], ahead
        if anywhere:
            known, where, open_ = _cheapest_near(ahead, first_costs, least, joins)
            beyond = joins.near_costs[ahead, -1] + least if open_ else np.inf
            bound = max(bound, beyond)
        if bound >= known:
            after[node], targets[node], exact[node] = known, where, True
        else:
            after[node], targets[node], exact[node] = bound, -1, False
    holding = prices.holding[pieces.states[pieces.starts[piece] + pieces.lengths[piece]]]
    for k in range(n_later):
        node, place = later[k], n_stops + k
        cost, target = best[place], to[place]
        if joins.successors[node] == node:
            # A segment's last node has no successor: to start there again is to hold it.
            cost, target = _after_segment(node, cost, target, first_costs, least, holding, joins)
        after[node], targets[node], exact[node] = cost, target, True


@njit(cache=True, nogil=True)
def _after_segment(node, best, to, first_costs, least, holding, joins):
    """The cheapest join after a segment's last node, which is its own successor."""
    if to == node:
        without = first_costs.copy()
        without[node] = np.inf
        others, where = _cheapest(np.array([node]), joins.stop_costs[:0], without, least, joins)
        best, to = others[0], where[0]
    held = holding[node] + first_costs[node]
    if held < best:
        return held, node
    return best, to


@njit(cache=True, nogil=True)
def _cheapest_near(ahead, first_costs, least, joins):
    """The cheapest node to join to among `ahead` and its nearest, its place, and whether others may be cheaper."""
    n_nodes, n_near = joins.near_nodes.shape
    cheapest, where = first_costs[ahead], np.int64(ahead)
    for k in range(n_near):
        way = joins.near_costs[ahead, k]
        if way + least >= cheapest:
            return cheapest, where, False
        other = joins.near_nodes[ahead, k]
        if way + first_costs[other] < cheapest:
            cheapest, where = way + first_costs[other], np.int64(other)
    open_ = n_near < n_nodes - 1 and joins.near_costs[ahead, n_near - 1] + least < cheapest
    return cheapest, where, open_


@njit(cache=True, nogil=True)
def _cheapest(froms, bounds, first_costs, least, joins):
    """For each of `froms` the cost of the cheapest join from it, and the node it leads to.

    bounds : float32 [shape=(K, N)], lower bounds of the join costs from the first K of them

    The nearest nodes come from the index. Where they leave it open whether a node beyond them is cheaper, the
    few nodes that could be are looked at, in order of their own cost, by the bounds or by their sketches first.
    """
    n_near = joins.near_nodes.shape[1]
    count = len(froms)
    best = np.empty(count)
    to = np.empty(count, dtype=np.int64)
    unsure = np.empty(count, dtype=np.int64)
    n_unsure = 0
    limit = -np.inf
    for place in range(count):
        before = to[place - 1] if place and place >= len(bounds) else -1
        best[place], to[place], open_ = _good(froms[place], before, first_costs, least, joins)
        if open_:
            unsure[n_unsure] = place
            n_unsure += 1
            limit = max(limit, best[place] - joins.near_costs[froms[place], n_near - 1])
    if n_unsure == 0:
        return best, to
    cheap, bands = _candidates(first_costs, least, limit, joins)
    chunks = _side_by_side(cheap if unsure[n_unsure - 1] >= len(bounds) else cheap[:0], joins)
    apart, low = np.empty(_CHUNK, dtype=np.float32), np.empty(_CHUNK, dtype=np.float32)
    for row in range(n_unsure):
        place = unsure[row]
        ahead = froms[place]
        beyond = joins.near_costs[ahead, n_near - 1]
        cheapest, where = best[place], to[place]
        for first in range(0, len(cheap), _CHUNK):
            if bands[first] + beyond >= cheapest:
                break
            count = min(first + _CHUNK, len(cheap)) - first
            if place < len(bounds):
                for k in range(count):
                    low[k] = bounds[place, cheap[first + k]]
            else:
                _sketch_costs(joins.sketch[ahead], chunks[first // _CHUNK], joins.sketch_weights, low, apart)
            for k in range(count):
                other = cheap[first + k]
                # Beyond the range of single precision a sketch says nothing.
                way = max(low[k] - joins.slack, beyond) if low[k] < np.inf else beyond
                if first_costs[other] + way < cheapest and other != ahead:
                    cheapest, where = _cheaper(ahead, other, cheapest, where, first_costs, joins)
        best[place], to[place] = cheapest, where
    return best, to


@njit(cache=True, nogil=True)
def _cheaper(ahead, other, best, to, first_costs, joins):
    cost = first_costs[other] + _way(ahead, other, joins)
    if cost < best:
        return cost, np.int64(other)
    return best, to


@njit(cache=True, nogil=True)
def _good(ahead, other, first_costs, least, joins):
    """A cheap node to join to from `ahead`, what it costs, and whether one beyond the nearest may be cheaper.

    other : where the join from a pose before leads: the way is likely much the same; -1 for none
    """
    n_near = joins.near_nodes.shape[1]
    best, to, open_ = _cheapest_near(ahead, first_costs, least, joins)
    if not open_ or other < 0:
        return best, to, open_
    for node in (other, joins.successors[other]):
        if node != ahead:
            best, to = _cheaper(ahead, node, best, to, first_costs, joins)
    return best, to, joins.near_costs[ahead, n_near - 1] + least < best


@njit(cache=True, nogil=True)
def _way(node, other, joins):
    return distance(
        joins.poses[node], joins.poses[other], joins.velocities[node], joins.velocities[other],
        joins.by_pose, joins.by_velocity,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _side_by_side(nodes, joins):
    """The sketches of some nodes in chunks [shape=(C, 2, M, _CHUNK)], so that they are compared many at a time."""
    n_terms = joins.sketch.shape[2]
    chunks = np.zeros(((len(nodes) + _CHUNK - 1) // _CHUNK, 2, n_terms, _CHUNK), dtype=np.float32)
    for k in range(len(nodes)):
        for side in range(2):
            for term in range(n_terms):
                chunks[k // _CHUNK, side, term, k % _CHUNK] = joins.sketch[nodes[k], side, term]
    return chunks


@njit(cache=True, nogil=True, error_model="numpy")
def _sketch_costs(sketch, chunk, weights, low, apart):
    """Join costs `low` [shape=(_CHUNK,)] from one sketch [shape=(2, M)] to those of a chunk [shape=(2, M, _CHUNK)]."""
    low[:] = 0.0
    for side in range(2):
        weight = np.float32(weights[side])
        apart[:] = 0.0
        for term in range(chunk.shape[1]):
            own = sketch[side, term]
            for k in range(_CHUNK):
                step = chunk[side, term, k] - own
                apart[k] += step * step
        for k in range(_CHUNK):
            low[k] += weight * np.sqrt(apart[k])


@njit(cache=True, nogil=True)
def _candidates(first_costs, least, limit, joins):
    """The nodes worth joining to for less than `limit`, roughly by cost, and a lower bound of each one's cost.

    Left out are those that cost at least as much as one near them and the way there: because the join cost is a
    metric, it is cheaper to join to that one at once, wherever one comes from.
    """
    kept = np.empty(len(first_costs), dtype=np.int64)
    count = 0
    dearest = least
    for node in range(len(first_costs)):
        cost = first_costs[node]
        if cost < limit and cost < np.inf and not _is_dominated(node, first_costs, least, joins):
            kept[count] = node
            count += 1
            dearest = max(dearest, cost)
    # Sorted into bands of cost, which is faster than to sort.
    width = max((dearest - least) / _BANDS, 1e-300)
    ends = np.zeros(_BANDS + 1, dtype=np.int64)
    for k in range(count):
        ends[1 + min(int((first_costs[kept[k]] - least) / width), _BANDS - 1)] += 1
    ends = np.cumsum(ends)
    nodes = np.empty(count, dtype=np.int64)
    bounds = np.empty(count)
    for k in range(count):
        band = min(int((first_costs[kept[k]] - least) / width), _BANDS - 1)
        nodes[ends[band]] = kept[k]
        bounds[ends[band]] = least + max(band - 1, 0) * width  # one lower, whatever the rounding
        ends[band] += 1
    return nodes, bounds


@njit(cache=True, nogil=True)
def _is_dominated(node, first_costs, least, joins):
    cost = first_costs[node]
    for k in range(joins.near_nodes.shape[1]):
        way = joins.near_costs[node, k]
        if way + least >= cost:
            return False
        # Strictly, so that of two at one place one remains.
        if first_costs[joins.near_nodes[node, k]] + way < cost:
            return True
    return False


@njit(cache=True, nogil=True)
def first_node(before, holding, first_costs, joins):
    """The cheapest first node after a path that ends in `before`, or at all for -1.

    holding : [shape=(N,)], prices of holding a node at the first frame
    """
    if before < 0:
        return np.int64(np.argmin(first_costs))
    ahead = joins.successors[before]
    least = first_costs.min()
    best, to = _cheapest(np.array([ahead]), joins.stop_costs[:0], first_costs, least, joins)
    cost, node = best[0], to[0]
    if ahead == before:
        _, node = _after_segment(before, cost, node, first_costs, least, holding, joins)
    return node


@njit(cache=True, nogil=True)
def follow(first_node, pieces, joins, tables):
    """The best path: its nodes, the number of nodes of each piece, and the piece after which it is open, or -1."""
    n_nodes, n_pieces = len(joins.successors), len(pieces.starts)
    nodes = np.empty(np.sum(pieces.longest), dtype=np.int64)
    counts = np.zeros(n_pieces, dtype=np.int64)
    node, total = first_node, 0
    for piece in range(n_pieces):
        place = tables.offsets[piece]
        while True:
            nodes[total] = node
            total += 1
            counts[piece] += 1
            action = tables.actions[place + node]
            place += n_nodes
            if action == END:
                break
            if action == NATURAL:
                node += 1
            elif action >= EDGE:
                node = joins.edge_nodes[joins.edge_starts[node] + action - EDGE]
        if not tables.exact[piece, node]:
            return nodes[:total], counts, piece
        node = tables.targets[piece, node]
    return nodes[:total], counts, -1

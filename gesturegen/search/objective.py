"""What a path costs by the objective of the global search, term by term, whichever search found it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gesturegen.config import Continuity, GlobalSearch
from gesturegen.graph.motion_graph import MotionGraph
from gesturegen.search.path import CUT, Piece, Target

# Terms of single pieces, and `control` where hands are controlled; the price of repeats belongs to the whole path.
PIECE_TERMS = ("edges", "length", "passed", "state", "held", "end", "keyword", "joins")
TERMS = (*PIECE_TERMS, "repeats")


@dataclass(frozen=True, eq=False)
class PriceList:
    """The prices of a graph's nodes, N of them.

    In arrays of shape (2, N) the first index is the test speech's state: 0 in a pause, else 1. Where a user controls
    the hands, there are two rows for each of S sets of demands, and the state is twice the set's number more.

    controlled : prices of a frame that shows the node, by set of demands, `[shape=(S, N)]`; None for none
    controlled_held : what a frame that holds the node costs more, because the hands then do not move
    """

    graph: MotionGraph
    settings: GlobalSearch
    continuity: Continuity
    controlled: np.ndarray | None = None
    controlled_held: np.ndarray | None = None

    @cached_property
    def shown(self) -> np.ndarray:
        """Of a frame that shows the node, `[shape=(2, N)]`."""
        return self._by_set(self.settings.lambda_state * (self.graph.speaking != [[False], [True]]))

    @cached_property
    def control(self) -> np.ndarray:
        """Of a frame that shows the node against what is demanded, `[shape=(2, N)]`."""
        if self.controlled is None:
            return np.zeros((2, self.graph.n_nodes))
        return np.repeat(self.controlled, 2, axis=0)

    @cached_property
    def control_held(self) -> np.ndarray:
        """Of staying at the node against what is demanded, beside `control`, `[shape=(2, N)]`."""
        if self.controlled_held is None:
            return np.zeros_like(self.control)
        return np.repeat(self.controlled_held, 2, axis=0)

    def _by_set(self, prices: np.ndarray) -> np.ndarray:
        return prices if self.controlled is None else np.tile(prices, (len(self.controlled), 1))

    @cached_property
    def passing(self) -> np.ndarray:
        """Of leaving the node inside a piece, `[shape=(2, N)]`."""
        return self._by_set(self.settings.lambda_pass * np.array([np.zeros(self.graph.n_nodes), self.graph.any_stop]))

    @cached_property
    def holding(self) -> np.ndarray:
        """Of staying at the node for a frame, `[shape=(2, N)]`: a rest in the reference may be drawn out in a pause."""
        prices = np.full((2, self.graph.n_nodes), self.settings.lambda_hold)
        prices[0, ~self.graph.speaking] = self.settings.lambda_rest
        return self._by_set(prices)

    @cached_property
    def _rhythmic(self) -> np.ndarray:
        return self.graph.stop_nodes(None)

    @cached_property
    def _ends(self) -> dict[tuple[bool, str], tuple[np.ndarray, np.ndarray]]:
        return {}

    def end_prices(self, target: Target) -> tuple[np.ndarray, np.ndarray]:
        """Prices `[shape=(N,)]` of each node as the last of a piece: of no stop node, and of another keyword."""
        rule = target.end_kind == CUT, target.keyword
        if rule not in self._ends:
            allowed, other = self._rhythmic, np.zeros(self.graph.n_nodes, dtype=bool)
            if target.end_kind == CUT:
                allowed = ~other
            elif target.keyword:
                met = self.graph.stop_nodes(target.keyword)
                allowed, other = allowed | met, ~met
            self._ends[rule] = self.settings.lambda_end * ~allowed, self.settings.lambda_keyword * other
        return self._ends[rule]

    def join_costs(self, lefts: np.ndarray, rights: np.ndarray) -> np.ndarray:
        """`[shape=(K,)]`, from the last nodes of pieces to the first nodes of the next."""
        return self.settings.lambda_join * self.graph.distances(self.graph.successors[lefts], rights, self.continuity)

    def edge_costs(self, lefts: np.ndarray, rights: np.ndarray) -> np.ndarray:
        """`[shape=(K,)]`, of the graph's edges."""
        graph = self.graph
        weights = [
            float(graph.weights[graph.indptr[left] + np.searchsorted(graph.children(left), right)])
            for left, right in zip(lefts, rights, strict=True)
        ]
        return self.settings.lambda_w * np.array(weights)


def terms(pieces: Sequence[Piece], prices: PriceList, states: np.ndarray) -> dict[str, np.ndarray]:
    """What each piece costs `[shape=(P,)]`, by term; the join into a piece counts with it.

    states : `[shape=(n_frames,)]`, of the test speech (`PriceList`); where nothing is controlled, whether it speaks
    """
    counts = np.array([len(piece.nodes) for piece in pieces])
    targets = [piece.target for piece in pieces]
    lengths = np.array([target.length for target in targets])
    starts = np.array([target.start_frame for target in targets])
    nodes = np.concatenate([piece.nodes for piece in pieces])
    owner = np.repeat(np.arange(len(pieces)), counts)
    firsts = np.cumsum(counts) - counts
    places = np.arange(len(nodes)) - firsts[owner]
    states = np.asarray(states).astype(int)
    shown = states[starts[owner] + np.minimum(places, lengths[owner] - 1)]

    def per_piece(values: np.ndarray, of: np.ndarray) -> np.ndarray:
        return np.bincount(owner[of], values, len(pieces)).astype(float)  # of nothing it counts in whole numbers

    # Steps inside pieces, by the node they come from.
    steps = np.flatnonzero(owner[1:] == owner[:-1])
    held = steps[nodes[steps] == nodes[steps + 1]]
    left = steps[nodes[steps] != nodes[steps + 1]]
    unnatural = left[nodes[left + 1] != prices.graph.successors[nodes[left]]]
    ends = [
        (end[piece.nodes[-1]], other[piece.nodes[-1]])
        for piece, (end, other) in zip(pieces, map(prices.end_prices, targets), strict=True)
    ]
    lasts, nexts = nodes[firsts[1:] - 1], nodes[firsts[1:]]
    costs = {
        "edges": per_piece(prices.edge_costs(nodes[unnatural], nodes[unnatural + 1]), unnatural),
        "length": prices.settings.lambda_len * np.abs(1.0 - counts / lengths),
        "passed": per_piece(prices.passing[shown[left], nodes[left]], left),
        "state": per_piece(prices.shown[shown, nodes], np.arange(len(nodes))),
        "held": per_piece(prices.holding[shown[held + 1], nodes[held + 1]], held + 1),
        "end": np.array([end for end, _ in ends]),
        "keyword": np.array([other for _, other in ends]),
        "joins": np.append(0.0, prices.join_costs(lasts, nexts)),
    }
    if prices.controlled is not None:
        costs["control"] = per_piece(prices.control[shown, nodes], np.arange(len(nodes)))
        costs["control"] += per_piece(prices.control_held[shown[held + 1], nodes[held + 1]], held + 1)
    # A segment's last node has no successor: to start there again is to hold it.
    again = 1 + np.flatnonzero((lasts == nexts) & (prices.graph.successors[lasts] == lasts))
    costs["held"][again] += prices.holding[states[starts[again]], nexts[again - 1]]
    if prices.controlled is not None:
        costs["control"][again] += prices.control_held[states[starts[again]], nexts[again - 1]]
    return costs


def total(pieces: Sequence[Piece], prices: PriceList, states: np.ndarray) -> dict[str, float]:
    """The whole path's cost by term, and `total`, their sum."""
    sums = {name: float(values.sum()) for name, values in terms(pieces, prices, states).items()}
    uses = stays(pieces)
    sums["repeats"] = prices.settings.lambda_repeat * float((uses * (uses - 1) // 2).sum())
    return sums | {"total": sum(sums.values())}


def stays(pieces: Sequence[Piece], n_nodes: int = 0) -> np.ndarray:
    """How often the pieces come to each node `[shape=(>= n_nodes,)]`; however long a piece holds it, it is once."""
    if not pieces:
        return np.zeros(n_nodes, dtype=int)
    nodes = np.concatenate([piece.nodes for piece in pieces])
    fresh = np.append(True, nodes[1:] != nodes[:-1])
    fresh[np.cumsum([len(piece.nodes) for piece in pieces[:-1]], dtype=int)] = True
    return np.bincount(nodes[fresh], minlength=n_nodes)

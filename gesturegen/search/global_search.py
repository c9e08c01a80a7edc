"""Optimal search for the whole test speech at once, beyond the paper.

The cheapest path by the objective (`objective.py`) over all pieces, lengths and nodes, by dynamic programming
from the end. It never fails: every node may be held, and a piece may end anywhere for a price. Exact without
repetition; repeated frames are then priced by how often the rest of the path shows them, a window of pieces
at a time, each window solved exactly and kept where the objective falls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from gesturegen.config import Config, Continuity, GlobalSearch
from gesturegen.graph import neighbours
from gesturegen.graph.motion_graph import MotionGraph
from gesturegen.search import _global_kernels as kernels
from gesturegen.search import objective
from gesturegen.search.beam import ratio_lengths
from gesturegen.search.objective import PriceList
from gesturegen.search.path import CUT, Piece, Target

# Pieces that are solved again together; every other sweep starts half a window later.
WINDOW = 8
# 256 MB of lower bounds; beyond it nodes are compared by sketches.
_MOST_STOP_COSTS = 1 << 26
# Principal components that joins are compared by first.
_SKETCH_TERMS = 12
_ROUNDOFF = float(np.finfo(np.float32).eps)


@dataclass(frozen=True, eq=False)
class Result:
    """The pieces found, and the objective by term: of the exact path without repetition, and of these pieces."""

    pieces: tuple[Piece, ...]
    first: dict[str, float]
    final: dict[str, float]


def search(
    graph: MotionGraph, targets: Sequence[Target], speaking: np.ndarray, config: Config, used: np.ndarray | None = None,
    control: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
) -> Result:  # fmt: skip
    """The cheapest pieces for all of `targets`.

    speaking : bool `[shape=(n_frames,)]`, False in the test speech's pauses
    used : `[shape=(N,)]`, a price of every frame that shows the node, for what other variants show already
    control : for each frame the number of the set of demands that holds there `[shape=(n_frames,)]`, and for each set
        the price of a frame that shows the node, and what a frame that holds it costs more `[shape=(S, N)]`
    """
    settings = config.global_search
    targets = cut_long(targets, settings.max_piece_seconds * graph.fps)
    used = np.zeros(graph.n_nodes) if used is None else used
    states, controlled = speaking.astype(np.int64), (None, None)
    if control is not None:
        states, controlled = states + 2 * control[0], control[1:]
    problem = _Problem(graph, targets, states, config, used, controlled)
    found = problem.solve(np.zeros(graph.n_nodes))
    first = objective.total(found, problem.prices, states)
    if settings.lambda_repeat > 0:
        for sweep in range(settings.sweeps):
            found = problem.sweep(found, WINDOW // 2 * (sweep % 2))
    if control is None:  # frames of a rest are as good as one another, unless somebody says otherwise
        found = [_spread_rests(piece, graph, speaking) for piece in found]
    costs = objective.terms(found, problem.prices, states)
    rows = [{name: float(values[k]) for name, values in costs.items() if values[k]} for k in range(len(found))]
    described = tuple(
        replace(piece, cost=sum(row.values()), fallback=_relaxation(row), costs=row)
        for piece, row in zip(found, rows, strict=True)
    )
    return Result(described, first, objective.total(found, problem.prices, states))


def cut_long(targets: Sequence[Target], max_frames: float) -> list[Target]:
    """Targets of over `max_frames` cut into equal parts, all but the last of which may end anywhere."""
    parts = []
    for target in targets:
        count = min(int(np.ceil(target.length / max_frames - 1e-9)), target.length)
        bounds = [target.start_frame + round(k * target.length / count) for k in range(count + 1)]
        parts += [Target(start, end, CUT) for start, end in pairwise(bounds[:-1])]
        parts.append(Target(bounds[-2], bounds[-1], target.end_kind, target.keyword))
    return parts


def lengths(target: int, settings: GlobalSearch) -> tuple[int, int]:
    """The fewest and the most nodes for a piece of `target` frames."""
    shortest, longest = ratio_lengths(target, settings.min_ratio, settings.max_ratio)
    return max(1, min(shortest, target - settings.slack_frames)), max(longest, target + settings.slack_frames)


def _relaxation(row: dict[str, float]) -> str | None:
    """The gravest thing that had to give way in a piece."""
    return next(
        (name for name, term in (("end", "end"), ("keyword", "keyword"), ("hold", "held")) if term in row), None
    )


def _spread_rests(piece: Piece, graph: MotionGraph, speaking: np.ndarray) -> Piece:
    """Draw a rest out evenly: where frames of a pause are held, all its nodes share them.

    It costs the same, and is slow motion in place of a stop.
    """
    nodes, target = piece.nodes.copy(), piece.target
    states = speaking[target.start_frame + np.minimum(np.arange(len(nodes)), target.length - 1)]
    resting = ~states & ~graph.speaking[nodes]
    onwards = (nodes[1:] == nodes[:-1]) | (nodes[1:] == graph.successors[nodes[:-1]])
    run_ends = np.flatnonzero(~(resting[1:] & resting[:-1] & onwards))
    for first, last in pairwise([-1, *run_ends.tolist(), len(nodes) - 1]):
        run = slice(first + 1, last + 1)
        steps = nodes[last] - nodes[first + 1]
        if 0 < steps < last - first - 1:
            nodes[run] = nodes[first + 1] + np.round(np.linspace(0, steps, last - first)).astype(int)
    return replace(piece, nodes=nodes)


class _Problem:
    """One graph, one speech: the arrays of the dynamic program, for all pieces or for a window of them."""

    def __init__(
        self, graph: MotionGraph, targets: Sequence[Target], states: np.ndarray, config: Config, used: np.ndarray,
        controlled: tuple[np.ndarray | None, np.ndarray | None] = (None, None),
    ):  # fmt: skip
        self.graph, self.targets, self.used = graph, targets, used
        self.settings, self.states = config.global_search, states.astype(np.int64)
        self.prices = PriceList(graph, config.global_search, config.continuity, *controlled)
        self.holding = self.prices.holding + self.prices.control_held
        self.joins = _joins(graph, config.global_search, config.continuity)
        rules = {(target.end_kind == CUT, target.keyword): target for target in targets}
        keys = sorted(rules)
        bounds = np.array([lengths(target.length, self.settings) for target in targets])
        self.all_pieces = kernels.Pieces(
            starts=np.array([target.start_frame for target in targets]),
            lengths=np.array([target.length for target in targets]),
            shortest=np.ascontiguousarray(bounds[:, 0]),
            longest=np.ascontiguousarray(bounds[:, 1]),
            rules=np.array([keys.index((target.end_kind == CUT, target.keyword)) for target in targets]),
            end_prices=np.array([np.add(*self.prices.end_prices(rules[key])) for key in keys]),
            open_rules=np.array([cut for cut, _ in keys]),
            states=self.states,
            followed=False,
        )
        most_actions = kernels.EDGE + int(np.diff(self.joins.edge_starts).max(initial=0))
        size = int(bounds[:, 1].sum()) * graph.n_nodes
        self.actions = np.empty(size, dtype=np.uint8 if most_actions <= 256 else np.uint16)

    def solve(
        self, entering: np.ndarray, first: int = 0, last: int | None = None, before: int = -1, after: int = -1
    ) -> list[Piece]:
        """The cheapest pieces for the targets [first, last).

        entering : `[shape=(N,)]`, price of coming to each node, once in a piece that holds it
        before, after : the node that is shown before them and the one after them; -1 for none
        """
        n_nodes, window = self.graph.n_nodes, slice(first, last)
        pieces = self.all_pieces._replace(
            **{name: getattr(self.all_pieces, name)[window] for name in kernels.PER_PIECE}, followed=after >= 0
        )
        shown = self.prices.shown + self.prices.control + self.used
        prices = kernels.Prices(
            shown, shown.min(axis=0), self.prices.passing, self.holding, entering, self.settings.lambda_len
        )
        shape = (len(pieces.starts), n_nodes)
        tables = kernels.Tables(
            actions=self.actions,
            offsets=np.append(0, np.cumsum(pieces.longest[:-1])) * n_nodes,
            first_costs=np.full((shape[0] + 1, n_nodes), np.inf),
            last_costs=np.zeros(shape),
            exact=np.ones(shape, dtype=bool),
            targets=np.zeros(shape, dtype=np.int32),
            wanted=np.zeros(shape, dtype=bool),
        )
        if after >= 0:
            tables.first_costs[-1, after] = 0.0
        holding = self.holding[int(self.states[pieces.starts[0]])]
        open_piece = shape[0] - 1
        while open_piece >= 0:
            kernels.solve(open_piece, pieces, prices, self.joins, tables)
            start = kernels.first_node(before, holding, tables.first_costs[0], self.joins)
            nodes, counts, open_piece = kernels.follow(start, pieces, self.joins, tables)
            if open_piece >= 0:
                # The path ends a piece where only a bound of what follows is known.
                tables.wanted[open_piece] = True
        parts = np.split(nodes, np.cumsum(counts)[:-1])
        return [Piece(target, part, 0.0) for target, part in zip(self.targets[window], parts, strict=True)]

    def sweep(self, pieces: list[Piece], offset: int) -> list[Piece]:
        """Solve every window of pieces again, a node priced by how often the rest of the path comes to it."""
        best = self._cost(pieces)
        for first, last in pairwise(sorted({0, *range(offset, len(pieces), WINDOW), len(pieces)})):
            head, tail = pieces[:first], pieces[last:]
            elsewhere = objective.stays([*head, *tail], self.graph.n_nodes)
            if not any(elsewhere[piece.nodes].any() for piece in pieces[first:last]):
                continue  # nothing in it is shown twice
            part = self.solve(
                self.settings.lambda_repeat * elsewhere, first, last,
                int(head[-1].nodes[-1]) if head else -1, int(tail[0].nodes[0]) if tail else -1,
            )  # fmt: skip
            other = [*head, *part, *tail]
            cost = self._cost(other)
            if cost < best:
                pieces, best = other, cost
        return pieces

    def _cost(self, pieces: Sequence[Piece]) -> float:
        total = objective.total(pieces, self.prices, self.states)["total"]
        return total + float(sum(self.used[piece.nodes].sum() for piece in pieces))


@lru_cache(maxsize=1)
def _joins(graph: MotionGraph, settings: GlobalSearch, metric: Continuity) -> kernels.Joins:
    """What the kernels need of a graph; test clips that share it share this too."""
    poses, velocities = graph.poses, graph.velocities
    unnatural = ~graph.natural
    lefts = np.repeat(np.arange(graph.n_nodes), np.diff(graph.indptr))[unnatural]
    # Segments' last nodes, which are their own successors, are looked at one by one.
    inner = graph.successors[graph.any_stop & (graph.successors != np.arange(graph.n_nodes))]
    stops = np.unique(inner) if len(inner) else np.array([0])
    anchors, anchor_costs = _nearest_stop(graph, stops, metric)
    sketch, weights, slack = _sketch(poses, velocities, metric)
    return kernels.Joins(
        successors=graph.successors,
        edge_starts=np.append(0, np.cumsum(np.bincount(lefts, minlength=graph.n_nodes))),
        edge_nodes=graph.indices[unnatural].astype(np.int64),
        edge_costs=settings.lambda_w * graph.weights[unnatural].astype(np.float64),
        with_edges=np.unique(lefts),
        near_nodes=graph.near_nodes,
        near_costs=settings.lambda_join * graph.near_distances,
        nearest_costs=settings.lambda_join
        * np.append(graph.near_distances, np.zeros((graph.n_nodes, 1)), axis=1)[:, 0],
        stops=stops,
        stop_costs=_stop_costs(graph, stops, settings, metric),
        anchors=anchors,
        anchor_costs=settings.lambda_join * anchor_costs,
        poses=poses,
        velocities=velocities,
        sketch=sketch,
        sketch_weights=settings.lambda_join * weights,
        by_pose=settings.lambda_join * metric.lambda_pos,
        by_velocity=settings.lambda_join * metric.lambda_vel,
        slack=settings.lambda_join * slack,
    )


def _stop_costs(graph: MotionGraph, stops: np.ndarray, settings: GlobalSearch, metric: Continuity) -> np.ndarray:
    if len(stops) * graph.n_nodes > _MOST_STOP_COSTS:
        return np.empty((0, 0), dtype=np.float32)
    low = neighbours.lower_bounds(graph.poses, graph.velocities, metric, stops)
    return np.float32(settings.lambda_join * (1.0 - _ROUNDOFF)) * low


def _sketch(poses: np.ndarray, velocities: np.ndarray, metric: Continuity) -> tuple[np.ndarray, np.ndarray, float]:
    """Poses and velocities in their first principal components, float32 `[shape=(N, 2, M)]`, and their weights.

    The weighted sum of the distances between two sketches is a lower bound of the pose distance, but for
    rounding: that adds at most the third value.
    """
    terms = min(_SKETCH_TERMS, poses.shape[1])
    sides, weights = [], []
    for points, weight in ((poses, metric.lambda_pos), (velocities, metric.lambda_vel)):
        centred = points - points.mean(axis=0)
        # Squares of very small or large coordinates would leave float32's range.
        scale = float(np.abs(centred).max()) or 1.0
        centred = centred / scale
        _, directions = np.linalg.eigh(centred.T @ centred)
        sides.append(centred @ directions[:, ::-1][:, :terms])
        weights.append(weight * scale)
    # Every coordinate and sum is rounded a few times, relative to the largest distance there is.
    reaches = [2.0 * float(np.sqrt((side**2).sum(axis=1).max())) for side in sides]
    slack = float(np.dot(weights, reaches)) * (terms + 8) * _ROUNDOFF
    return np.stack(sides, axis=1).astype(np.float32), np.array(weights), slack


def _nearest_stop(graph: MotionGraph, stops: np.ndarray, metric: Continuity) -> tuple[np.ndarray, np.ndarray]:
    """For each node the place in `stops` of the nearer of the two around it, and the distance to it."""
    nodes = np.arange(graph.n_nodes)
    after = np.searchsorted(stops, nodes)
    sides = [np.clip(after + shift, 0, len(stops) - 1) for shift in (-1, 0)]
    distances = [graph.distances(stops[side], nodes, metric) for side in sides]
    nearer = distances[1] <= distances[0]
    return np.where(nearer, sides[1], sides[0]), np.where(nearer, distances[1], distances[0])

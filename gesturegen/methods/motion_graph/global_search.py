"""The optimal search for the whole test speech at once, beyond the paper.

A path names one node per frame of the speech; between joins it stays in the recording at its own pace. Onsets,
keywords and phrases of the speech are rewards where the recording answers them, a join has a fixed price and the
distance between its poses, and a stay has a shortest length. The cheapest path is found by dynamic programming over
frames and nodes, exactly (in large graphs among every k-th node for joins) but for what is shown again: windows of the
path are solved again with a price on what the rest of it shows, and kept where the objective (`objective.py`) falls.
The search never fails: every node may be held.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gesturegen._pose_kernels import distances
from gesturegen.data.clips import Speech
from gesturegen.data.keynodes import BREAK
from gesturegen.data.keynodes import speaking as speaking_of
from gesturegen.methods.motion_graph import _global_kernels as kernels
from gesturegen.methods.motion_graph import objective, rewards
from gesturegen.methods.motion_graph.graph import MotionGraph
from gesturegen.methods.motion_graph.objective import NEAR_NODES, PriceList
from gesturegen.path import JOIN, Piece, Target
from gesturegen.runs import runs
from gesturegen.settings.models import Config, Continuity

# In a graph of more nodes than this, joins lead from and to every second, third, ... node and segments' ends alone: the
# costs of all joins take 256 MB at the most.
MOST_GATES = 8192


@dataclass(frozen=True, eq=False)
class Result:
    """The stays of the path, and the objective by term: of the exact path without repetition, and of this one."""

    pieces: tuple[Piece, ...]
    first: dict[str, float]
    final: dict[str, float]


def search(
    graph: MotionGraph, speech: Speech, config: Config, used: np.ndarray | None = None,
    control: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
) -> Result:  # fmt: skip
    """Find the cheapest path for a speech.

    used : `[shape=(N,)]`, a price of every frame that shows the node, for what other variants show already
    control : for each frame the number of the set of demands that holds there `[shape=(n_frames,)]`, and for each set
        the price of a frame that shows the node, and what a frame that holds it costs more `[shape=(D, N)]`
    """
    prices = price_list(graph, speech, config, used, control)
    problem = Problem(prices, speech.n_frames)
    nodes = problem.solve()
    first = objective.total(nodes, prices)
    if config.global_search.lambda_repeat > 0:
        for stays in range(1, config.global_search.sweeps + 1):
            nodes = problem.sweep(nodes, stays)
    if control is None:  # frames of a rest are as good as one another, unless somebody says otherwise
        nodes = spread_rests(nodes, prices)
    return Result(_stays(nodes, prices), first, objective.total(nodes, prices))


def price_list(
    graph: MotionGraph, speech: Speech, config: Config, used: np.ndarray | None = None,
    control: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
) -> PriceList:  # fmt: skip
    """Collect the prices of a graph's nodes for a speech; the arguments are those of `search`."""
    return PriceList(
        graph, config, speaking_of(speech, config.pauses), rewards.find(graph, speech, config),
        np.zeros(graph.n_nodes) if used is None else used, *(control or ()),
    )  # fmt: skip


def _stays(nodes: np.ndarray, prices: PriceList) -> tuple[Piece, ...]:
    """Cut the path at its joins into stays, each with its costs by term; the join into a stay counts with it."""
    costs = objective.terms(nodes, prices)
    pieces = []
    for start, end in pairwise(objective.stay_bounds(nodes, prices.graph).tolist()):
        row = {name: float(values[start:end].sum()) for name, values in costs.items() if values[start:end].any()}
        target = Target(start, end, JOIN if end < len(nodes) else BREAK)
        pieces.append(Piece(target, nodes[start:end], sum(row.values()), costs=row))
    return tuple(pieces)


def spread_rests(nodes: np.ndarray, prices: PriceList) -> np.ndarray:
    """Draw rests out evenly: where frames of a pause are held, all nodes of that rest share them.

    nodes : `[shape=(T,)]`, of the path. It is slow motion in place of a stop, and costs the same but for what a frame or
    two beside an onset earns.
    """
    graph, spread = prices.graph, nodes.copy()
    resting = ~np.asarray(prices.speaking) & ~graph.speaking[nodes]
    joins = objective.joined(nodes, graph)
    for start, end in runs(resting).tolist():
        cuts = [start, *(start + 1 + np.flatnonzero(joins[start + 1 : end])).tolist(), end]
        for first, last in pairwise(cuts):
            steps = nodes[last - 1] - nodes[first]
            if 0 < steps < last - first - 1:
                spread[first:last] = nodes[first] + np.round(np.linspace(0, steps, last - first)).astype(int)
    return spread


class Problem:
    """The dynamic program of one graph and one speech: its arrays, for the whole path or for a window of it."""

    def __init__(self, prices: PriceList, n_frames: int):
        self.prices, self.n_frames = prices, n_frames
        self.settings = prices.config.global_search
        graph = prices.graph
        self.min_stay = max(1, round(self.settings.min_stay_seconds * graph.fps))
        stutter = round(self.settings.stutter_seconds * graph.fps)
        self.joins = joins_of(graph, self.settings.lambda_join, stutter, prices.config.continuity)
        # Rewards of the same gain count as one.
        gains: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
        for reward in prices.rewards:
            curve = reward.gain.tobytes()
            gain, worth = gains.get(curve, (reward.gain, 0.0))
            gains[curve] = gain, worth + reward.worth
        self.gains = np.array([gain for gain, _ in gains.values()]).reshape(-1, n_frames)
        self.worths = np.array([worth for _, worth in gains.values()]).reshape(-1, graph.n_nodes)
        self.actions = np.empty((n_frames, graph.n_nodes), dtype=np.int32)
        self.work = kernels.work_for(self.joins, self.min_stay)

    def _kernel_prices(self, marks: np.ndarray) -> kernels.Prices:
        return kernels.Prices(
            states=self.prices.states, shown=self.prices.shown, holding=self.prices.holding,
            gains=self.gains, rewards=self.worths, marks=marks,
            mark_starts=np.searchsorted(marks[:, 0], np.arange(self.n_frames + 1)),
            mark=float(self.settings.lambda_repeat), join=float(self.settings.join_price),
        )  # fmt: skip

    def solve(
        self, first: int = 0, last: int | None = None, before: int = -1, after: int = -1,
        marks: np.ndarray | None = None, present: np.ndarray | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Find the cheapest nodes `[shape=(last - first,)]` for the frames [first, last).

        before, after : the nodes that are shown before and after them, the first at the end of a stay that is long
            enough; -1 for none
        marks : frames and ranges of nodes that cost `lambda_repeat` more (`_global_kernels.Prices`)
        present : the whole path as it is; what must cost more than it in the window is not looked for
        """
        last = self.n_frames if last is None else last
        begin = first - (before >= 0)  # the frame before chooses how the path goes on
        prices = self._kernel_prices(np.zeros((0, 3), dtype=np.int64) if marks is None else marks)
        caps = np.empty((0 if present is None else last - begin, len(self.joins.gates)), dtype=np.float32)
        if present is not None:
            kernels.cap(present, begin, last, before, after, self.min_stay, prices, self.joins, caps)
        kernels.solve(begin, last, after, self.min_stay, prices, self.joins, self.work, self.actions, caps)
        node, age = (before, self.min_stay) if before >= 0 else (int(self.work.entered.argmin()), 1)
        nodes = kernels.follow(node, age, begin, last, self.min_stay, self.joins, self.actions)
        return nodes[first - begin :]

    def solve_again(self, nodes: np.ndarray, first: int, last: int, inside: bool = False) -> np.ndarray:
        """Find the cheapest nodes for a window of a path, with a price on what the rest of it shows.

        inside : whether what the window's own stays show is priced as well
        """
        return self.solve(
            first, last, int(nodes[first - 1]) if first else -1, int(nodes[last]) if last < self.n_frames else -1,
            self._marks(nodes, first, last, inside), nodes,
        )  # fmt: skip

    def sweep(self, nodes: np.ndarray, stays: int) -> np.ndarray:
        """Solve windows of `stays` stays again, one by one, with a price on what the rest of the path shows.

        A window in which nothing is shown again is left as it is, and so is one whose new path costs no less.
        """
        best = objective.total(nodes, self.prices)["total"]
        last = 0
        while last < self.n_frames:
            bounds = objective.stay_bounds(nodes, self.prices.graph).tolist()
            place = int(np.searchsorted(bounds, last))
            first, last = bounds[place], bounds[min(place + stays, len(bounds) - 1)]
            again = objective.repeated(nodes, self.prices.graph, self.settings.repeat_seconds)
            if last - first == self.n_frames or not again[first:last].any():
                continue
            other = nodes
            # What a window shows again of itself is known only once it is solved: then it is priced, too.
            for inside in (False, True):
                part = self.solve_again(other, first, last, inside)
                if np.array_equal(part, other[first:last]):
                    continue
                other = np.concatenate([nodes[:first], part, nodes[last:]])
                cost = objective.total(other, self.prices)["total"]
                if cost < best and self._long_enough(other):
                    nodes, best = other, cost
        return nodes

    def _long_enough(self, nodes: np.ndarray) -> bool:
        """Tell whether every stay is as long as it must be; what follows a window may have become shorter."""
        bounds = objective.stay_bounds(nodes, self.prices.graph)
        starts, lengths = bounds[:-1], np.diff(bounds)
        least = np.minimum(self.min_stay, self.joins.left[nodes[starts]])
        least = np.minimum(least, len(nodes) - starts)
        return bool((lengths >= least).all())

    def _marks(self, nodes: np.ndarray, first: int, last: int, inside: bool = False) -> np.ndarray:
        """List ranges of nodes that other stays show a short while before or after each frame of [first, last).

        inside : whether stays of this window count as well, not only those outside it
        """
        reach = int(np.ceil(self.settings.repeat_seconds * self.prices.graph.fps - 1e-9)) - 1
        bounds = objective.stay_bounds(nodes, self.prices.graph)
        return kernels.marks(nodes, bounds, first, last, reach, NEAR_NODES, self.prices.graph.n_nodes, inside)


def joins_of(graph: MotionGraph, lambda_join: float, stutter: int, metric: Continuity) -> kernels.Joins:
    """Build the kernels' tables of a graph, which keeps the last of them: test clips that share it share these too.

    stutter : no join may jump so few frames or less, back or ahead, within a segment
    """
    made_of = lambda_join, stutter, metric, MOST_GATES
    if made_of not in graph.prepared:
        graph.prepared.clear()  # they are large
        graph.prepared[made_of] = _joins(graph, lambda_join, stutter, metric)
    return graph.prepared[made_of]


def _joins(graph: MotionGraph, lambda_join: float, stutter: int, metric: Continuity) -> kernels.Joins:
    nodes, ends = np.arange(graph.n_nodes), graph.segment_ends
    step = -(-graph.n_nodes // MOST_GATES)
    gates = np.union1d(nodes[::step], ends)  # where a segment ends a path must be able to leave it
    segments = np.searchsorted(graph.segment_starts, nodes, side="right")
    # Joins within a segment that would jump no further than a stutter; the natural step and a hold are none at all.
    low, high = gates - 1 - stutter, gates - 1 + max(stutter, 1)
    first, last = graph.segment_starts[segments - 1][gates], ends[segments - 1][gates]
    barred = np.column_stack([
        np.searchsorted(gates, np.maximum(low, first)), np.searchsorted(gates, np.minimum(high, last), side="right")
    ])  # fmt: skip
    shift = int(step == 1)
    matrix, slack = _matrix(graph, gates, lambda_join, metric)
    before = graph.successors[gates[np.arange(len(gates)) - shift]]
    detours = lambda_join * distances(
        before, gates, graph.poses, graph.velocities, metric.lambda_pos, metric.lambda_vel
    )
    n_blocks = matrix.shape[1] // kernels.BLOCK
    rows, blocks, halls = (
        np.full(shape, np.inf, dtype=np.float32)
        for shape in ((len(gates), n_blocks), (n_blocks, n_blocks), (n_blocks, -(-n_blocks // kernels.BLOCK)))
    )
    nearest = np.full(matrix.shape[1], np.inf, dtype=np.float32)
    kernels.bound(matrix, barred, rows, blocks, halls, nearest)
    nearest = np.maximum(nearest[: len(gates)] - np.float32(slack), 0)
    return kernels.Joins(
        successors=graph.successors, left=ends[np.searchsorted(ends, nodes)] - nodes + 1,
        starts=np.asarray(graph.segment_starts), ends=ends, segments=segments, stutter=stutter, gates=gates,
        shift=shift, barred=barred, matrix=matrix, rows=rows, blocks=blocks, halls=halls, detours=detours, nearest=nearest, slack=slack,
        poses=graph.poses, velocities=graph.velocities, by_pose=lambda_join * metric.lambda_pos,
        by_velocity=lambda_join * metric.lambda_vel,
    )  # fmt: skip


def _matrix(
    graph: MotionGraph, gates: np.ndarray, lambda_join: float, metric: Continuity
) -> tuple[np.ndarray, float]:  # fmt: skip
    """Compute the costs of joins between gates, float32 `[shape=(G, B * BLOCK)]`, and four times their error."""
    # Whole blocks of columns, so that the loops over a block are of one length.
    width = -(-len(gates) // kernels.BLOCK) * kernels.BLOCK
    found = np.zeros((len(gates), width), dtype=np.float32)
    found[:, len(gates) :] = np.inf
    ahead = graph.successors[gates]
    error = 0.0
    for points, weight in ((graph.poses, metric.lambda_pos), (graph.velocities, metric.lambda_vel)):
        centred = points - points.mean(axis=0)
        to, froms = centred[gates], centred[ahead]
        squares = (to**2).sum(axis=1), (froms**2).sum(axis=1)
        doubled = np.ascontiguousarray(-2.0 * froms.T)
        for rows in np.array_split(np.arange(len(gates)), max(1, len(gates) // 256)):
            kernels.add_distances(
                found[rows[0] : rows[-1] + 1], to[rows] @ doubled, squares[0][rows], squares[1], lambda_join * weight
            )
        most = max(squares[0].max(), squares[1].max())
        # Of a difference of sums that are rounded, and of the two roundings to float32.
        error += lambda_join * weight * np.sqrt(most) * (
            np.sqrt(4 * (points.shape[1] + 4) * np.finfo(float).eps) + 4 * np.finfo(np.float32).eps
        )  # fmt: skip
    return found, 4 * float(error)

"""The objective of the global search: what a path costs, term by term, whichever search found it.

A path names one node for each frame of the speech. A node that follows its natural successor or itself goes on; any
other step is a *join*, and what lies between joins is a *stay*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gesturegen.methods.motion_graph import _global_kernels as kernels
from gesturegen.methods.motion_graph.graph import MotionGraph
from gesturegen.methods.motion_graph.rewards import Reward
from gesturegen.settings.models import Config

# Nodes so near to one another show the same moment.
NEAR_NODES = 3
TERMS = ("state", "beat", "onset", "phrase", "keyword", "control", "used", "held", "price", "distance", "repeats")


@dataclass(frozen=True, eq=False)
class PriceList:
    """The prices of the nodes of a graph, N of them, for a speech of T frames.

    speaking : bool [shape=(T,)], False in the pauses of the speech; rewards : what nodes earn in its frames
    used : [shape=(N,)], the price of showing a node that another variant shows already
    demanded : int [shape=(T,)], which set of demands holds in a frame; None where nothing is demanded
    controlled, controlled_held : [shape=(D, N)], for each set the price of a frame that shows the node, and what a
        frame that holds it costs more, because the hands then do not move
    """

    graph: MotionGraph
    config: Config
    speaking: np.ndarray
    rewards: Sequence[Reward]
    used: np.ndarray
    demanded: np.ndarray | None = None
    controlled: np.ndarray | None = None
    controlled_held: np.ndarray | None = None

    @cached_property
    def states(self) -> np.ndarray:
        """Compute each frame's state `[shape=(T,)]`: 0 in a pause and 1 else, plus twice its set of demands."""
        states = np.asarray(self.speaking).astype(np.int64)
        return states if self.demanded is None else states + 2 * self.demanded

    @cached_property
    def resting(self) -> np.ndarray:
        """Compute the price of a pause shown for speech or speech for a pause, `[shape=(2, N)]`, by speaking."""
        settings = self.config.global_search
        return settings.lambda_state * (self.graph.speaking != np.array([[False], [True]]))

    @cached_property
    def shown(self) -> np.ndarray:
        """Compute the price of a frame that shows the node, without rewards, `[shape=(S, N)]` by state."""
        shown = self.resting + self.used
        if self.controlled is None:
            return shown
        return np.concatenate([shown + row for row in self.controlled])

    @cached_property
    def holding(self) -> np.ndarray:
        """Compute the price of a frame that holds the node, `[shape=(S, N)]`: rests may be drawn out in a pause."""
        settings = self.config.global_search
        holding = np.full((2, self.graph.n_nodes), settings.lambda_hold)
        holding[0, ~self.graph.speaking] = settings.lambda_rest
        if self.controlled_held is None:
            return holding
        return np.concatenate([holding + row for row in self.controlled_held])


def joined(nodes: np.ndarray, graph: MotionGraph) -> np.ndarray:
    """Mark frames in which a join comes, bool `[shape=(T,)]`; a segment's last node that comes again is held."""
    steps = (nodes[1:] != graph.successors[nodes[:-1]]) & (nodes[1:] != nodes[:-1])
    return np.append(False, steps)


def stay_bounds(nodes: np.ndarray, graph: MotionGraph) -> np.ndarray:
    """Find the first frame of each stay, followed by the number of frames `[shape=(S + 1,)]`."""
    return np.concatenate([[0], np.flatnonzero(joined(nodes, graph)), [len(nodes)]])


def terms(nodes: np.ndarray, prices: PriceList) -> dict[str, np.ndarray]:
    """Compute what each frame costs `[shape=(T,)]`, by term; what is earned is negative.

    nodes : `[shape=(T,)]`, shown in each frame
    """
    graph, settings = prices.graph, prices.config.global_search
    frames, join = np.arange(len(nodes)), joined(nodes, graph)
    held = np.append(False, nodes[1:] == nodes[:-1])
    speaking = np.asarray(prices.speaking).astype(int)
    costs = {name: np.zeros(len(nodes)) for name in TERMS}
    costs["state"] = prices.resting[speaking, nodes]
    costs["used"] = np.asarray(prices.used, dtype=float)[nodes]
    for reward in prices.rewards:
        costs[reward.name] -= np.where(held, 0.0, reward.gain * reward.worth[nodes])
    rests = ~np.asarray(prices.speaking) & ~graph.speaking[nodes]
    costs["held"] = np.where(held, np.where(rests, settings.lambda_rest, settings.lambda_hold), 0.0)
    if prices.controlled is not None:
        assert prices.controlled_held is not None, "both are given or none"
        costs["control"] = prices.controlled[prices.demanded, nodes]
        costs["control"] = costs["control"] + np.where(held, prices.controlled_held[prices.demanded, nodes], 0.0)
    costs["price"] = settings.join_price * join
    lefts, rights = nodes[frames[join] - 1], nodes[join]
    costs["distance"][join] = settings.lambda_join * graph.distances(
        graph.successors[lefts], rights, prices.config.continuity
    )
    costs["repeats"] = settings.lambda_repeat * repeated(nodes, graph, settings.repeat_seconds)
    return costs


def total(nodes: np.ndarray, prices: PriceList) -> dict[str, float]:
    """Sum the whole path's cost by term, and as `total` over all terms."""
    sums = {name: float(values.sum()) for name, values in terms(nodes, prices).items()}
    return sums | {"total": sum(sums.values())}


def repeated(nodes: np.ndarray, graph: MotionGraph, seconds: float) -> np.ndarray:
    """Mark frames that show a node within 3 of one that another stay showed recently, bool `[shape=(T,)]`.

    seconds : how long ago that must be at least for it not to count
    """
    return kernels.repeated(
        np.asarray(nodes, dtype=np.int64), stay_bounds(nodes, graph), graph.n_nodes, NEAR_NODES,
        seconds * graph.fps - 1e-9,
    )  # fmt: skip

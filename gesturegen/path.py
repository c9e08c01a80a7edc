"""The result of a search: a `Path` of graph nodes, cut into the pieces of the test speech."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gesturegen.motion.skeleton import read_only

# How a stay of the global search ends that is not the last.
JOIN = "join"


@dataclass(frozen=True)
class Target:
    """A stretch [start_frame, end_frame) of the test speech, and how it ends.

    end_kind : kind of the key node at `end_frame`, `onset`, `keyword` or (the last piece) `break`, else `join`
    """

    start_frame: int
    end_frame: int
    end_kind: str
    keyword: str = ""

    @property
    def length(self) -> int:
        """Count the frames of the stretch."""
        return self.end_frame - self.start_frame


@dataclass(frozen=True, eq=False)
class Piece:
    """The nodes found for one target, as searched, before resampling to the target's length.

    nodes : int [shape=(n,)]; cost : of the path; retries : how many the search needed
    fallback : None, or what had to give way: `keyword`, `discard` or `repeat` (appendix A.1)
    costs : what the cost is made of, by term of the objective; None where the search has no terms
    """

    target: Target
    nodes: np.ndarray
    cost: float
    retries: int = 0
    fallback: str | None = None
    costs: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", read_only(self.nodes))


def resampled_indices(n_nodes: int, length: int) -> np.ndarray:
    """Compute fractional indices `[shape=(length,)]` into a piece's nodes, evenly placed over its target's frames.

    The last frame shows the last node, a stop node; so does the only frame of a piece of one.
    """
    return np.linspace(0.0, n_nodes - 1.0, length) if length > 1 else np.array([n_nodes - 1.0])


@dataclass(frozen=True, eq=False)
class Track:
    """The pieces, in order, that move one set of joints (None: all of them)."""

    pieces: tuple[Piece, ...]
    joints: tuple[str, ...] | None = None

    @property
    def nodes(self) -> np.ndarray:
        """Concatenate the nodes of all pieces `[shape=(n,)]`, as searched."""
        return np.concatenate([piece.nodes for piece in self.pieces])


@dataclass(frozen=True, eq=False)
class Path:
    """The path found for a whole test speech.

    failure : None, or the target at which the search got stuck, with the pieces found before it
    objective : None, or the sums of an objective by term: of a global search `first`, without repetition, and `final`,
        of GestureMaster's for the `upper` and the `lower` body
    notes : what a user should know of it
    demands : what the hands are to be like (`control.schedule.Demand`)
    """

    tracks: tuple[Track, ...]
    failure: Target | None = None
    objective: Mapping[str, Mapping[str, float]] | None = None
    notes: tuple[str, ...] = ()
    demands: tuple = ()

"""The trace that explains the frames of a gestured clip, stored as `reenact/<clip>.trace.json` (docs/files.md).

Frames number those of the speech, from 0; nodes number the frames of the references, one clip after the other. A range
ends before its `end_frame`. Distances and costs are those of the search, without unit.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from gesturegen.errors import DataError
from gesturegen.path import resampled_indices
from gesturegen.stored.documents import Distance, Document, Figure, Many, Number, Part, Rate, Seed

# Before the name of a gesture of a library (`control.gestures`) among the references of a trace.
GESTURE_PREFIX = "gesture:"


class KeyNode(Part):
    """A frame of the speech at which a piece is to end, with the keyword that is said there, else an empty text."""

    frame: Number
    kind: Literal["onset", "keyword", "break"]
    keyword: str


class Origin(Part):
    """A reference clip, as recorded or mirrored, and the node of its first frame."""

    clip: str
    start_node: Number
    mirrored: bool = False

    @property
    def is_gesture(self) -> bool:
        """Tell whether this is a gesture of a library rather than a reference clip."""
        return self.clip.startswith(GESTURE_PREFIX)


class Piece(Part):
    """The nodes chosen for one stretch of the speech, as searched, before resampling to `target_length` frames.

    cost : of the path, `costs` by term where the search has terms; retries : how many the search needed
    fallback : None, or what had to give way
    """

    start_frame: Number
    end_frame: Number
    target_length: Number
    end_kind: str
    keyword: str
    nodes: Annotated[Many[Number], Field(min_length=1)]
    cost: Figure
    retries: Number
    fallback: str | None
    costs: dict[str, Figure] | None = None

    def shown_nodes(self) -> np.ndarray:
        """Compute the node nearest to what each frame of the piece shows, int `[shape=(target_length,)]`."""
        places = np.round(resampled_indices(len(self.nodes), self.target_length)).astype(int)
        return np.array(self.nodes)[places]


class Join(Part):
    """The join of two pieces: the last node of one, the first of the next, and the distance of their poses.

    frame : the first of the next; natural : whether the nodes follow one another in a recording
    """

    frame: Number
    from_node: Number
    to_node: Number
    distance: Distance
    natural: bool


class Demand(Part):
    """A demand of a condition on the hands (`control.schedule.Demand`); None for a bound that was not asked for.

    low, high : in cm or cm/s
    """

    place: Number
    measure: Literal["height", "speed", "radius", "symmetry"]
    hand: Literal["left", "right", "both"]
    low: Figure | None
    high: Figure | None
    start_frame: Number
    end_frame: Number
    hard: bool
    price: Figure
    scale: Figure


class Failure(Part):
    """The stretch of the speech at which the search got stuck."""

    start_frame: Number
    end_frame: Number
    end_kind: str
    keyword: str


class _Walk:
    """The totals over the pieces and joins of one track."""

    if TYPE_CHECKING:
        pieces: tuple[Piece, ...]
        joins: tuple[Join, ...]

    @property
    def n_hard_joins(self) -> int:
        """Count the joins that leave the recording."""
        return sum(not join.natural for join in self.joins)

    @property
    def n_retries(self) -> int:
        """Count how often the search began a piece anew."""
        return sum(piece.retries for piece in self.pieces)

    @property
    def fallbacks(self) -> dict[str, int]:
        """Count the pieces whose search fell back, by what was given up."""
        return dict(sorted(Counter(piece.fallback for piece in self.pieces if piece.fallback).items()))


class Track(Part, _Walk):
    """A group of joints that move independently of the others, with their pieces and joins."""

    joints: Many[str]
    pieces: Many[Piece]
    joins: Many[Join]


class Trace(Document, _Walk):
    """The trace of a clip: which reference frames it shows, why, and what is needed to make it again.

    seed, config_hash, version : what a second run needs for the same bytes; variant : its number, from 1
    graph : the name of what was searched; references : of whose frames it and the gestures shown besides are made
    fps : frames per second of speech and motion; n_frames : of the speech
    pieces, joins : of the first track, of all joints that no other of the `tracks` moves
    pauses : (start, end) frames of the pauses of the speech; objective : its sums by term, by track or stage of the search
    failure : None, or where the search got stuck, after the pieces that are there
    notes : what a user should know; inputs : a hash of all that the result was made of, empty where none was taken
    bvh_sha256 : of the motion's file; None where the search got stuck
    """

    clip: str
    method: str
    search: str
    seed: Seed
    variant: Number = 1
    graph: str
    references: Annotated[Many[Origin], Field(min_length=1)]
    fps: Rate
    n_frames: Number
    version: str
    config_hash: str
    key_nodes: Many[KeyNode]
    pieces: Many[Piece]
    joins: Many[Join]
    pauses: Many[Annotated[Many[Number], Field(min_length=2, max_length=2)]]
    objective: dict[str, dict[str, Figure]] | None
    failure: Failure | None
    control: Many[Demand]
    tracks: Many[Track]
    notes: Many[str]
    inputs: str
    bvh_sha256: str | None

    @model_validator(mode="after")
    def _fits_together(self) -> Trace:
        starts = self.start_nodes
        if starts[0] != 0 or any(b <= a for a, b in pairwise(starts)):
            raise ValueError("the start nodes of the references do not rise from 0")
        frames = [node.frame for node in self.key_nodes] + [end - 1 for _, end in self.pauses]
        frames += [demand.end_frame - 1 for demand in self.control]
        if any(frame >= self.n_frames for frame in frames) or any(d.start_frame >= d.end_frame for d in self.control):
            raise ValueError(f"frames beyond the {self.n_frames} of the clip")
        for track in self.all_tracks:
            _require_gapless(track.pieces, track.joins, None if self.failure else self.n_frames)
        return self

    @property
    def seconds(self) -> float:
        """Return the length of the clip in seconds."""
        return self.n_frames / self.fps

    @property
    def all_tracks(self) -> tuple[Trace | Track, ...]:
        """Return all tracks: the trace itself, which holds the pieces and joins of the first, and the others."""
        return (self, *self.tracks)

    @property
    def all_pieces(self) -> list[Piece]:
        """List the pieces of all tracks, one track after the other."""
        return [piece for track in self.all_tracks for piece in track.pieces]

    @property
    def start_nodes(self) -> list[int]:
        """List the first node of each reference."""
        return [reference.start_node for reference in self.references]

    def shown_nodes(self) -> np.ndarray:
        """Compute the node nearest to what the first track shows in each frame, int `[shape=(n_frames,)]`."""
        return np.concatenate([piece.shown_nodes() for piece in self.pieces])

    def shown_clips(self) -> list[str]:
        """List the reference clips of which any track shows a frame, without the gestures of a library."""
        pieces = self.all_pieces
        nodes = np.concatenate([piece.nodes for piece in pieces]) if pieces else np.empty(0)
        shown = np.unique(np.searchsorted(self.start_nodes, nodes, side="right") - 1)
        return sorted({self.references[k].clip for k in shown if not self.references[k].is_gesture})

    def require_nodes(self, n_nodes: int) -> None:
        """Raise DataError if the trace names nodes that its library of `n_nodes` lacks."""
        last = max((max(piece.nodes) for piece in self.all_pieces), default=-1)
        joined = (max(join.from_node, join.to_node) for track in self.all_tracks for join in track.joins)
        if max(last, *joined, -1) >= n_nodes:
            raise self.of_another_graph()

    def of_another_graph(self) -> DataError:
        """Build the error for a trace whose nodes are not those of the graph that it names."""
        return DataError(
            f"clip {self.clip}: its trace is of another graph than {self.graph}; run `gesturegen reenact` again"
        )

    def to_json(self) -> str:
        """Format the trace as JSON with one line for each piece, join and key node, so that people can read it too."""
        return format_lines(self.model_dump(exclude_unset=True))


def format_lines(value: dict) -> str:
    """Format an object as JSON with one line for each row of its lists."""
    lines = []
    for key, entry in value.items():
        if isinstance(entry, list | tuple) and entry:
            rows = ",\n  ".join(json.dumps(row, ensure_ascii=False, allow_nan=False) for row in entry)
            lines.append(f" {json.dumps(key)}: [\n  {rows}\n ]")
        else:
            lines.append(f" {json.dumps(key)}: {json.dumps(entry, ensure_ascii=False, allow_nan=False)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _require_gapless(pieces: Sequence[Piece], joins: Sequence[Join], n_frames: int | None) -> None:
    """Check that pieces follow one another from frame 0 on, to the end where the search was not stuck."""
    frame = 0
    for piece in pieces:
        if piece.start_frame != frame or piece.end_frame <= frame or piece.target_length != piece.end_frame - frame:
            raise ValueError(f"the piece at frame {piece.start_frame} does not follow the one before")
        frame = piece.end_frame
    if n_frames is not None and frame != n_frames:
        raise ValueError(f"pieces for {frame} of {n_frames} frames")
    if [join.frame for join in joins] != [piece.start_frame for piece in pieces[1:]]:
        raise ValueError("joins are not where pieces meet")

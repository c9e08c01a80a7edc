"""Description of a trace: its header and one line per piece, or per piece and body where bodies move separately."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from itertools import pairwise

import numpy as np

from gesturegen.control.measures import UNITS
from gesturegen.frames import ReferenceFrames
from gesturegen.methods import METHODS
from gesturegen.stored.documents import Figure, Many, Part
from gesturegen.text import align, count
from gesturegen.trace import Demand, Failure, Piece, Trace, Track

_HEADINGS = ("time", "frames", "length", "ends at", "nodes", "source frames", "join", "cost", "retries", "notes")
_FIGURES = (0, 2, 6, 7, 8)
_BODY_HEADINGS = (
    "time", "frames", "kind", "body", "gesture clip", "source frames", "length", "join", "cost", "notes", "of which",
)  # fmt: skip
_BODY_FIGURES = (0, 6, 7, 8)
_MOST_REFERENCES = 10


class Place(Part):
    """The origin of a node: the reference clip, mirrored or not, and the frame of its recording."""

    node: int
    clip: str
    mirrored: bool
    source_frame: int


class PieceFacts(Part):
    """The facts of one piece of a trace (`trace.Piece`).

    seconds : when it starts; searched_length : how many nodes it has; jumps : how many of them do not follow one another
    gesture : name of what it shows as a whole, None where it has none; first, last : its nodes
    join_distance, join_natural : of the join that it starts with, None for the first piece
    """

    start_frame: int
    end_frame: int
    target_length: int
    end_kind: str
    keyword: str
    seconds: float
    searched_length: int
    jumps: int
    gesture: str | None
    first: Place
    last: Place
    cost: Figure
    retries: int
    fallback: str | None
    costs: dict[str, Figure] | None
    join_distance: float | None
    join_natural: bool | None


class TrackFacts(Part):
    """The facts of a further track of a trace, with the totals of its pieces and joins."""

    joints: Many[str]
    hard_joins: int
    retries: int
    fallbacks: dict[str, int]
    pieces: Many[PieceFacts]


class Header(Part):
    """The facts of a trace about the whole clip (`trace.Trace`), with the totals of its first track.

    references : names of the clips, mirrored copies left out; mirrored : whether there are any
    key_nodes : how many of each kind
    """

    clip: str
    method: str
    search: str
    seed: int
    graph: str
    fps: float
    n_frames: int
    version: str
    config_hash: str
    failure: Failure | None
    seconds: float
    references: Many[str]
    mirrored: bool
    key_nodes: dict[str, int]
    hard_joins: int
    retries: int
    fallbacks: dict[str, int]
    objective: dict[str, dict[str, Figure]] | None
    control: Many[Demand]
    notes: Many[str]


class TraceFacts(Part):
    """The facts of a trace: header, pieces of the first track, and the further `tracks`, which move other joints."""

    header: Header
    pieces: Many[PieceFacts]
    tracks: Many[TrackFacts]


def describe_trace(trace: Trace, library: ReferenceFrames | None = None) -> TraceFacts:
    """Describe the header and the pieces of a trace; the result's `model_dump` is ready for JSON.

    library : what it was found in (`is_of`). Without it, a node is placed by the clip starts of the trace,
        `source_frame` counts the frames of the clip that were kept, and gesture clips have no names.
    """
    kinds = Counter(node.kind for node in trace.key_nodes)
    return TraceFacts(
        header=Header(
            clip=trace.clip,
            method=trace.method,
            search=trace.search,
            seed=trace.seed,
            graph=trace.graph,
            fps=trace.fps,
            n_frames=trace.n_frames,
            version=trace.version,
            config_hash=trace.config_hash,
            failure=trace.failure,
            seconds=trace.seconds,
            references=tuple(reference.clip for reference in trace.references if not reference.mirrored),
            mirrored=any(reference.mirrored for reference in trace.references),
            key_nodes=dict(sorted(kinds.items())),
            hard_joins=trace.n_hard_joins,
            retries=trace.n_retries,
            fallbacks=trace.fallbacks,
            objective=trace.objective,
            control=trace.control,
            notes=trace.notes,
        ),
        pieces=_describe_pieces(trace, trace, library),
        tracks=tuple(
            TrackFacts(
                joints=track.joints,
                hard_joins=track.n_hard_joins,
                retries=track.n_retries,
                fallbacks=track.fallbacks,
                pieces=_describe_pieces(trace, track, library),
            )
            for track in trace.tracks
        ),
    )


def is_of(trace: Trace, library: ReferenceFrames) -> bool:
    """Tell whether a trace was searched in `library`, as far as the clips and nodes that it names show."""
    # Gestures of a folder come after the clips of the library.
    own = [one for one in trace.references if not one.is_gesture]
    named = [(one.clip, one.mirrored, one.start_node) for one in own]
    held = [(*clip, start) for clip, start in zip(library.clips, np.asarray(library.clip_starts).tolist(), strict=True)]
    pieces = trace.all_pieces
    if named != held or any(max(piece.nodes) >= library.n_nodes for piece in pieces if piece.end_kind != "gesture"):
        return False
    if not METHODS[trace.method].shows_whole_pieces():
        return True
    # Beside a gesture of a folder, clips are cut and cannot be told by their ends.
    return len(own) < len(trace.references) or all(_gesture(trace, piece, library) is not None for piece in pieces)


def _describe_pieces(trace: Trace, track: Trace | Track, library: ReferenceFrames | None) -> tuple[PieceFacts, ...]:
    joins = {join.frame: join for join in track.joins}
    pieces = []
    for piece in track.pieces:
        join = joins.get(piece.start_frame)
        pieces.append(
            PieceFacts(
                start_frame=piece.start_frame,
                end_frame=piece.end_frame,
                target_length=piece.target_length,
                end_kind=piece.end_kind,
                keyword=piece.keyword,
                seconds=piece.start_frame / trace.fps,
                searched_length=len(piece.nodes),
                jumps=sum(b not in (a, a + 1) for a, b in pairwise(piece.nodes)),
                gesture=_gesture(trace, piece, library),
                first=_place(trace, library, piece.nodes[0]),
                last=_place(trace, library, piece.nodes[-1]),
                cost=piece.cost,
                retries=piece.retries,
                fallback=piece.fallback,
                costs=piece.costs,
                join_distance=None if join is None else join.distance,
                join_natural=None if join is None else join.natural,
            )
        )
    return tuple(pieces)


def _gesture(trace: Trace, piece: Piece, library: ReferenceFrames | None) -> str | None:
    """Return the name of what a piece shows as a whole, such as a gesture clip; None where that has no name."""
    return None if library is None else METHODS[trace.method].piece_name(library, piece.nodes)


def _place(trace: Trace, library: ReferenceFrames | None, node: int) -> Place:
    if library is not None and node >= library.n_nodes:
        library = None  # a gesture of a folder
    reference = trace.references[int(np.searchsorted(trace.start_nodes, node, side="right") - 1)]
    return Place(
        node=node,
        clip=reference.clip,
        mirrored=reference.mirrored,
        source_frame=node - reference.start_node if library is None else int(library.source_frames[node]),
    )


# --- lines --------------------------------------------------------------------------------------------------


def trace_lines(facts: TraceFacts) -> list[str]:
    """Format the facts of `describe_trace`: the header and one line per piece, or per piece and body.

    Fingers have a line only where they are of another gesture clip than the upper body.
    """
    header, by_body = facts.header, bool(facts.tracks)
    lines = [
        f"clip: {header.clip}, {header.n_frames} frames ({header.seconds:.1f} s at {header.fps:g} fps)",
        f"made by: {header.method}/{header.search}, seed {header.seed}, config {header.config_hash}, "
        f"version {header.version}",
        f"graph: {header.graph}, of {_references(header)}",
        *(_body_lines(facts) if by_body else _search_lines(facts)),
        *(_demand(demand, header.fps) for demand in header.control),
        *(f"note: {note}" for note in header.notes),
    ]
    if header.failure:
        stuck = header.failure
        lines.append(
            f"stuck: no path for frames {stuck.start_frame} to {stuck.end_frame}, which end at "
            f"{_ending(stuck.end_kind, stuck.keyword)}"
        )
    if by_body:
        return lines + align([_BODY_HEADINGS, *_body_rows(facts)], _BODY_FIGURES)
    return lines + align([_HEADINGS, *(_piece_cells(piece) for piece in facts.pieces)], _FIGURES)


def _references(header: Header) -> str:
    names = header.references
    text = ", ".join(names[:_MOST_REFERENCES])
    if len(names) > _MOST_REFERENCES:
        text += f" and {len(names) - _MOST_REFERENCES} more (--json lists all)"
    return text + ("; all of them mirrored as well" if header.mirrored else "")


def _search_lines(facts: TraceFacts) -> list[str]:
    header = facts.header
    return [
        "key nodes of the speech: " + (", ".join(f"{n} {kind}" for kind, n in header.key_nodes.items()) or "none"),
        f"{count(len(facts.pieces), 'piece')}, {count(header.hard_joins, 'hard join')}, "
        f"{header.retries} retries, fallbacks: {_fallbacks(header)}",
    ]


def _demand(demand: Demand, fps: float) -> str:
    """Describe in one line what a condition asks of the hands in this clip."""
    unit = UNITS[demand.measure]
    bounds = [
        f"{words} {bound:.1f} {unit}"
        for words, bound in (("at least", demand.low), ("at most", demand.high))
        if bound is not None
    ]
    how = "hard" if demand.hard else f"soft, price {demand.price:g} for {demand.scale:.1f} {unit}"
    return (
        f"condition {demand.place}: {demand.measure} ({demand.hand}) {' and '.join(bounds)} "
        f"from {demand.start_frame / fps:.2f} to {demand.end_frame / fps:.2f} s, {how}"
    )


def _bodies(facts: TraceFacts) -> tuple[str, ...]:
    """Return the names of a trace's tracks, that of its pieces first."""
    return METHODS[facts.header.method].bodies


def _body_lines(facts: TraceFacts) -> list[str]:
    header, pieces = facts.header, facts.pieces
    rests = sum(piece.end_kind == "rest" for piece in pieces)
    lines = [f"{count(len(pieces), 'piece')}, {rests} of them {'a rest' if rests == 1 else 'rests'}"]
    tracks: list[Header | TrackFacts] = [header, *facts.tracks]
    for name, track in zip(_bodies(facts), tracks, strict=False):
        terms = (header.objective or {}).get(name)
        if terms is not None:
            lines.append(
                f"{name} body: {count(track.hard_joins, 'hard join')}, fallbacks: {_fallbacks(track)}; "
                f"cost {terms['total']:.2f}" + (f": {_terms(terms)}" if _terms(terms) else "")
            )
    return lines


def _fallbacks(figures: Header | TrackFacts) -> str:
    return ", ".join(f"{number} {kind}" for kind, number in figures.fallbacks.items()) or "none"


def _terms(costs: Mapping[str, float] | None) -> str:
    """List the terms of a cost that two decimals show."""
    shown = {term: f"{value:.2f}" for term, value in (costs or {}).items() if term != "total"}
    return ", ".join(f"{term} {value}" for term, value in shown.items() if float(value))


def _body_rows(facts: TraceFacts) -> Iterable[tuple[str, ...]]:
    """Yield the table rows of the pieces of all tracks by time, at each time the upper body first."""
    upper = {piece.start_frame: piece for piece in facts.pieces}
    tracks: list[TraceFacts | TrackFacts] = [facts, *facts.tracks]
    rows = [(piece.start_frame, number, piece) for number, track in enumerate(tracks) for piece in track.pieces]
    bodies = _bodies(facts)
    for frame, number, piece in sorted(rows, key=lambda row: row[:2]):
        above = upper.get(frame)
        if bodies[number] == "fingers" and above and above.first.node == piece.first.node:
            continue
        first, last = piece.first, piece.last
        yield (
            *((f"{piece.seconds:.2f} s", f"{frame}-{piece.end_frame}", piece.end_kind)
              if number == 0 else ("", "", "")),
            bodies[number], (piece.gesture or first.clip) + (" mirrored" if first.mirrored else ""),
            f"{first.source_frame}-{last.source_frame}",
            f"{piece.searched_length} -> {piece.target_length}", _join(piece),
            "" if piece.costs is None else f"{piece.cost:.2f}", _notes(piece), _terms(piece.costs),
        )  # fmt: skip


def _piece_cells(piece: PieceFacts) -> tuple[str, ...]:
    first, last = piece.first, piece.last
    other = f"{last.clip}:" if last.clip != first.clip else ""
    return (
        f"{piece.seconds:.2f} s", f"{piece.start_frame}-{piece.end_frame}",
        f"{piece.searched_length} -> {piece.target_length}", _ending(piece.end_kind, piece.keyword),
        f"{first.node}-{last.node}", f"{first.clip}:{first.source_frame}-{other}{last.source_frame}",
        _join(piece), f"{piece.cost:.2f}", str(piece.retries), _notes(piece),
    )  # fmt: skip


def _join(piece: PieceFacts) -> str:
    if piece.join_distance is None:
        return "start"
    return "natural" if piece.join_natural else f"{piece.join_distance:.2f}"


def _notes(piece: PieceFacts) -> str:
    notes = [f"fallback {piece.fallback}"] if piece.fallback else []
    notes += [f"{count(piece.jumps, 'jump')} inside"] if piece.jumps else []
    return ", ".join(notes)


def _ending(kind: str, keyword: str) -> str:
    return f"{kind} {keyword}" if keyword else kind

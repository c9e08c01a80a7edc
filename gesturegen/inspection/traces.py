"""A trace in figures: its header, and each piece in one line; where bodies move by themselves, in one line for each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from itertools import pairwise

import numpy as np

from gesturegen.control.measures import UNITS
from gesturegen.frames import ReferenceFrames
from gesturegen.methods import METHODS
from gesturegen.submission import GESTURE_PREFIX
from gesturegen.text import align, count

_HEADINGS = ("time", "frames", "length", "ends at", "nodes", "source frames", "join", "cost", "retries", "notes")
_FIGURES = (0, 2, 6, 7, 8)
_BODY_HEADINGS = (
    "time", "frames", "kind", "body", "gesture clip", "source frames", "length", "join", "cost", "notes", "of which",
)  # fmt: skip
_BODY_FIGURES = (0, 6, 7, 8)
_MOST_REFERENCES = 10


def describe_trace(trace: Mapping, library: ReferenceFrames | None = None) -> dict:
    """Header and pieces of a trace, ready for JSON; `tracks` are those of other bodies than `pieces` are.

    library : what it was found in (`is_of`). Without it, a node is placed by the clip starts of the trace,
        `source_frame` counts the frames of the clip that were kept, and gesture clips have no names.
    """
    kinds = Counter(node["kind"] for node in trace["key_nodes"])
    tracks = [
        {"joints": track["joints"], **_figures_of(track), "pieces": _describe_pieces(trace, track, library)}
        for track in trace.get("tracks", ())
    ]
    header = {
        key: trace[key]
        for key in ("clip", "method", "search", "seed", "graph", "fps", "n_frames", "version", "config_hash", "failure")
    }
    header |= {
        "seconds": trace["n_frames"] / trace["fps"],
        "references": [reference["clip"] for reference in trace["references"] if not _is_mirrored(reference)],
        "mirrored": any(map(_is_mirrored, trace["references"])),
        "key_nodes": dict(sorted(kinds.items())),
        **_figures_of(trace),
        "objective": trace.get("objective"),
        "control": trace.get("control", []),
        "notes": trace.get("notes", []),
    }
    return {"header": header, "pieces": _describe_pieces(trace, trace, library), "tracks": tracks}


def is_of(trace: Mapping, library: ReferenceFrames) -> bool:
    """Whether a trace was found in `library`, as far as the clips and nodes that it names tell."""
    # Gestures of a folder come after the clips of the library.
    own = [one for one in trace["references"] if not one["clip"].startswith(GESTURE_PREFIX)]
    named = [(one["clip"], _is_mirrored(one), one["start_node"]) for one in own]
    held = [(*clip, start) for clip, start in zip(library.clips, np.asarray(library.clip_starts).tolist(), strict=True)]
    pieces = [piece for track in (trace, *trace.get("tracks", ())) for piece in track["pieces"]]
    if named != held or any(
        max(piece["nodes"]) >= library.n_nodes for piece in pieces if piece["end_kind"] != "gesture"
    ):
        return False
    if not METHODS[trace["method"]].shows_whole_pieces():
        return True
    # Beside a gesture of a folder, clips are cut and cannot be told by their ends.
    return len(own) < len(trace["references"]) or all(_gesture(trace, piece, library) is not None for piece in pieces)


def _is_mirrored(reference: Mapping) -> bool:
    return bool(reference.get("mirrored"))


def _figures_of(track: Mapping) -> dict:
    """What the pieces and joins of a track add up to."""
    fallbacks = Counter(piece["fallback"] for piece in track["pieces"] if piece["fallback"])
    return {
        "hard_joins": sum(not join["natural"] for join in track["joins"]),
        "retries": sum(piece["retries"] for piece in track["pieces"]),
        "fallbacks": dict(sorted(fallbacks.items())),
    }


def _describe_pieces(trace: Mapping, track: Mapping, library: ReferenceFrames | None) -> list[dict]:
    joins = {join["frame"]: join for join in track["joins"]}
    pieces = []
    for piece in track["pieces"]:
        join = joins.get(piece["start_frame"])
        nodes = piece["nodes"]
        pieces.append(
            {
                **{key: piece[key] for key in ("start_frame", "end_frame", "target_length", "end_kind", "keyword")},
                "seconds": piece["start_frame"] / trace["fps"],
                "searched_length": len(nodes),
                "jumps": sum(b not in (a, a + 1) for a, b in pairwise(nodes)),
                "gesture": _gesture(trace, piece, library),
                "first": {"node": nodes[0], **_locate(trace, library, nodes[0])},
                "last": {"node": nodes[-1], **_locate(trace, library, nodes[-1])},
                **{key: piece[key] for key in ("cost", "retries", "fallback")},
                "costs": piece.get("costs"),
                "join_distance": join and join["distance"],
                "join_natural": join and join["natural"],
            }
        )
    return pieces


def _gesture(trace: Mapping, piece: Mapping, library: ReferenceFrames | None) -> str | None:
    """The name of what a piece shows as a whole, such as a gesture clip; None where it has none."""
    return None if library is None else METHODS[trace["method"]].piece_name(library, piece["nodes"])


def _locate(trace: Mapping, library: ReferenceFrames | None, node: int) -> dict:
    if library is not None and node >= library.n_nodes:
        library = None  # a gesture of a folder
    starts = [reference["start_node"] for reference in trace["references"]]
    clip = int(np.searchsorted(starts, node, side="right") - 1)
    reference = trace["references"][clip]
    return {
        "clip": reference["clip"],
        "mirrored": _is_mirrored(reference),
        "source_frame": node - starts[clip] if library is None else int(library.source_frames[node]),
    }


# --- lines --------------------------------------------------------------------------------------------------


def trace_lines(facts: Mapping) -> list[str]:
    """The header of `describe_trace` and one line per piece, of several bodies one per piece and body.

    Fingers have a line only where they are of another gesture clip than the upper body.
    """
    header, by_body = facts["header"], bool(facts["tracks"])
    lines = [
        f"clip: {header['clip']}, {header['n_frames']} frames ({header['seconds']:.1f} s at {header['fps']:g} fps)",
        f"made by: {header['method']}/{header['search']}, seed {header['seed']}, config {header['config_hash']}, "
        f"version {header['version']}",
        f"graph: {header['graph']}, of {_references(header)}",
        *(_body_lines(facts) if by_body else _search_lines(facts)),
        *(_demand(demand, header["fps"]) for demand in header["control"]),
        *(f"note: {note}" for note in header["notes"]),
    ]
    if header["failure"]:
        stuck = header["failure"]
        lines.append(
            f"stuck: no path for frames {stuck['start_frame']} to {stuck['end_frame']}, which end at "
            f"{_ending(stuck['end_kind'], stuck['keyword'])}"
        )
    if by_body:
        return lines + align([_BODY_HEADINGS, *_body_rows(facts)], _BODY_FIGURES)
    return lines + align([_HEADINGS, *(_piece_cells(piece) for piece in facts["pieces"])], _FIGURES)


def _references(header: Mapping) -> str:
    names = header["references"]
    text = ", ".join(names[:_MOST_REFERENCES])
    if len(names) > _MOST_REFERENCES:
        text += f" and {len(names) - _MOST_REFERENCES} more (--json lists all)"
    return text + ("; all of them mirrored as well" if header["mirrored"] else "")


def _search_lines(facts: Mapping) -> list[str]:
    header = facts["header"]
    return [
        "key nodes of the speech: " + (", ".join(f"{n} {kind}" for kind, n in header["key_nodes"].items()) or "none"),
        f"{count(len(facts['pieces']), 'piece')}, {count(header['hard_joins'], 'hard join')}, "
        f"{header['retries']} retries, fallbacks: {_fallbacks(header)}",
    ]


def _demand(demand: Mapping, fps: float) -> str:
    """What a condition asks of the hands in this clip."""
    unit = UNITS[demand["measure"]]
    bounds = [
        f"{words} {demand[name]:.1f} {unit}"
        for name, words in (("low", "at least"), ("high", "at most"))
        if demand[name] is not None
    ]
    how = "hard" if demand["hard"] else f"soft, price {demand['price']:g} for {demand['scale']:.1f} {unit}"
    return (
        f"condition {demand['place']}: {demand['measure']} ({demand['hand']}) {' and '.join(bounds)} "
        f"from {demand['start_frame'] / fps:.2f} to {demand['end_frame'] / fps:.2f} s, {how}"
    )


def _bodies(facts: Mapping) -> tuple[str, ...]:
    """The names of the tracks of a trace, that of its pieces first."""
    return METHODS[facts["header"]["method"]].bodies


def _body_lines(facts: Mapping) -> list[str]:
    header, pieces = facts["header"], facts["pieces"]
    rests = sum(piece["end_kind"] == "rest" for piece in pieces)
    lines = [f"{count(len(pieces), 'piece')}, {rests} of them {'a rest' if rests == 1 else 'rests'}"]
    for name, track in zip(_bodies(facts), [header, *facts["tracks"]], strict=False):
        terms = (header["objective"] or {}).get(name)
        if terms is not None:
            lines.append(
                f"{name} body: {count(track['hard_joins'], 'hard join')}, fallbacks: {_fallbacks(track)}; "
                f"cost {terms['total']:.2f}" + (f": {_terms(terms)}" if _terms(terms) else "")
            )
    return lines


def _fallbacks(figures: Mapping) -> str:
    return ", ".join(f"{number} {kind}" for kind, number in figures["fallbacks"].items()) or "none"


def _terms(costs: Mapping[str, float] | None) -> str:
    """What a cost is made of, as far as two decimals show it."""
    shown = {term: f"{value:.2f}" for term, value in (costs or {}).items() if term != "total"}
    return ", ".join(f"{term} {value}" for term, value in shown.items() if float(value))


def _body_rows(facts: Mapping) -> Iterable[tuple[str, ...]]:
    """The pieces of all tracks by time, at each time the upper body first."""
    upper = {piece["start_frame"]: piece for piece in facts["pieces"]}
    rows = [
        (piece["start_frame"], number, piece)
        for number, track in enumerate([facts, *facts["tracks"]])
        for piece in track["pieces"]
    ]
    bodies = _bodies(facts)
    for frame, number, piece in sorted(rows, key=lambda row: row[:2]):
        above = upper.get(frame)
        if bodies[number] == "fingers" and above and above["first"]["node"] == piece["first"]["node"]:
            continue
        first, last = piece["first"], piece["last"]
        yield (
            *((f"{piece['seconds']:.2f} s", f"{frame}-{piece['end_frame']}", piece["end_kind"])
              if number == 0 else ("", "", "")),
            bodies[number], (piece["gesture"] or first["clip"]) + (" mirrored" if first["mirrored"] else ""),
            f"{first['source_frame']}-{last['source_frame']}",
            f"{piece['searched_length']} -> {piece['target_length']}", _join(piece),
            "" if piece["costs"] is None else f"{piece['cost']:.2f}", _notes(piece), _terms(piece["costs"]),
        )  # fmt: skip


def _piece_cells(piece: Mapping) -> tuple[str, ...]:
    first, last = piece["first"], piece["last"]
    other = f"{last['clip']}:" if last["clip"] != first["clip"] else ""
    return (
        f"{piece['seconds']:.2f} s", f"{piece['start_frame']}-{piece['end_frame']}",
        f"{piece['searched_length']} -> {piece['target_length']}", _ending(piece["end_kind"], piece["keyword"]),
        f"{first['node']}-{last['node']}", f"{first['clip']}:{first['source_frame']}-{other}{last['source_frame']}",
        _join(piece), f"{piece['cost']:.2f}", str(piece["retries"]), _notes(piece),
    )  # fmt: skip


def _join(piece: Mapping) -> str:
    if piece["join_distance"] is None:
        return "start"
    return "natural" if piece["join_natural"] else f"{piece['join_distance']:.2f}"


def _notes(piece: Mapping) -> str:
    notes = [f"fallback {piece['fallback']}"] if piece["fallback"] else []
    notes += [f"{count(piece['jumps'], 'jump')} inside"] if piece["jumps"] else []
    return ", ".join(notes)


def _ending(kind: str, keyword: str) -> str:
    return f"{kind} {keyword}" if keyword else kind

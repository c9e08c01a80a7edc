"""A trace in figures: its header, and each piece in one line."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from gesturegen.graph.motion_graph import MotionGraph
from gesturegen.inspection.graphs import count, describe_node

_HEADINGS = ("time", "frames", "length", "ends at", "nodes", "source frames", "join", "cost", "retries", "notes")
_FIGURES = (0, 2, 6, 7, 8)


def describe_trace(trace: Mapping, graph: MotionGraph | None = None) -> dict:
    """Header and pieces of a trace, ready for JSON.

    Without its graph, a node is placed by the clip starts of the trace, and `source_frame` counts the frames
    of the clip that were kept.
    """
    joins = {join["frame"]: join for join in trace["joins"]}
    fallbacks = Counter(piece["fallback"] for piece in trace["pieces"] if piece["fallback"])
    kinds = Counter(node["kind"] for node in trace["key_nodes"])
    header = {
        key: trace[key]
        for key in ("clip", "method", "search", "seed", "graph", "fps", "n_frames", "version", "config_hash", "failure")
    }
    header |= {
        "seconds": trace["n_frames"] / trace["fps"],
        "references": [reference["clip"] for reference in trace["references"]],
        "key_nodes": dict(sorted(kinds.items())),
        "hard_joins": sum(not join["natural"] for join in trace["joins"]),
        "retries": sum(piece["retries"] for piece in trace["pieces"]),
        "fallbacks": dict(sorted(fallbacks.items())),
    }
    pieces = []
    for piece in trace["pieces"]:
        join = joins.get(piece["start_frame"])
        nodes = piece["nodes"]
        pieces.append(
            {
                **{key: piece[key] for key in ("start_frame", "end_frame", "target_length", "end_kind", "keyword")},
                "seconds": piece["start_frame"] / trace["fps"],
                "searched_length": len(nodes),
                "jumps": sum(b not in (a, a + 1) for a, b in pairwise(nodes)),
                "first": {"node": nodes[0], **_locate(trace, graph, nodes[0])},
                "last": {"node": nodes[-1], **_locate(trace, graph, nodes[-1])},
                **{key: piece[key] for key in ("cost", "retries", "fallback")},
                "join_distance": join and join["distance"],
                "join_natural": join and join["natural"],
            }
        )
    return {"header": header, "pieces": pieces}


def _locate(trace: Mapping, graph: MotionGraph | None, node: int) -> dict:
    if graph is not None:
        return describe_node(graph, node)
    starts = [reference["start_node"] for reference in trace["references"]]
    clip = int(np.searchsorted(starts, node, side="right") - 1)
    return {"clip": trace["references"][clip]["clip"], "source_frame": node - starts[clip]}


def trace_lines(facts: Mapping) -> list[str]:
    """The header of `describe_trace` and one line per piece."""
    header = facts["header"]
    fallbacks = ", ".join(f"{count} {kind}" for kind, count in header["fallbacks"].items()) or "none"
    lines = [
        f"clip: {header['clip']}, {header['n_frames']} frames ({header['seconds']:.1f} s at {header['fps']:g} fps)",
        f"made by: {header['method']}/{header['search']}, seed {header['seed']}, config {header['config_hash']}, "
        f"version {header['version']}",
        f"graph: {header['graph']}, of {', '.join(header['references'])}",
        "key nodes of the speech: " + (", ".join(f"{n} {kind}" for kind, n in header["key_nodes"].items()) or "none"),
        f"{count(len(facts['pieces']), 'piece')}, {count(header['hard_joins'], 'hard join')}, "
        f"{header['retries']} retries, fallbacks: {fallbacks}",
    ]
    if header["failure"]:
        stuck = header["failure"]
        lines.append(
            f"stuck: no path for frames {stuck['start_frame']} to {stuck['end_frame']}, which end at "
            f"{_ending(stuck['end_kind'], stuck['keyword'])}"
        )
    return lines + _align([_HEADINGS, *(_piece_cells(piece) for piece in facts["pieces"])])


def _piece_cells(piece: Mapping) -> tuple[str, ...]:
    first, last = piece["first"], piece["last"]
    join = "start"
    if piece["join_distance"] is not None:
        join = "natural" if piece["join_natural"] else f"{piece['join_distance']:.2f}"
    other = f"{last['clip']}:" if last["clip"] != first["clip"] else ""
    notes = [f"fallback {piece['fallback']}"] if piece["fallback"] else []
    notes += [f"{count(piece['jumps'], 'jump')} inside"] if piece["jumps"] else []
    return (
        f"{piece['seconds']:.2f} s", f"{piece['start_frame']}-{piece['end_frame']}",
        f"{piece['searched_length']} -> {piece['target_length']}", _ending(piece["end_kind"], piece["keyword"]),
        f"{first['node']}-{last['node']}", f"{first['clip']}:{first['source_frame']}-{other}{last['source_frame']}",
        join, f"{piece['cost']:.2f}", str(piece["retries"]), ", ".join(notes),
    )  # fmt: skip


def _align(rows: list[tuple[str, ...]]) -> list[str]:
    """Columns to the width of their widest cell, figures to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(f"{cell:>{width}}" if k in _FIGURES else f"{cell:<{width}}" for k, (cell, width) in cells).rstrip()
        for cells in (list(enumerate(zip(row, widths, strict=True))) for row in rows)
    ]


def _ending(kind: str, keyword: str) -> str:
    return f"{kind} {keyword}" if keyword else kind

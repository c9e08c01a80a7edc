"""A graph in figures.

A piece of a graph is a stretch from one key node to the next within a segment; the lead-in of a segment, from
its first node to its first key node, is one too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from gesturegen.graph.motion_graph import MotionGraph
from gesturegen.graph.reference_frames import ReferenceFrames
from gesturegen.matching.database import MatchingDatabase

_QUANTILES = (0.0, 0.25, 0.5, 0.75, 1.0)


def describe_graph(graph: MotionGraph) -> dict:
    """All figures of a graph, ready for JSON; lengths in frames unless named otherwise."""
    nodes, edges = graph.n_nodes, len(graph.indices)
    degrees = np.diff(graph.indptr)
    lengths, starts = piece_lengths(graph)
    longest = int(lengths.argmax()) if len(lengths) else None
    kinds = Counter(graph.key_nodes.kinds.tolist())
    words = Counter(word for word in graph.key_nodes.keywords.tolist() if word)
    return {
        "clips": _describe_clips(graph),
        "frames": nodes,
        "seconds": nodes / graph.fps,
        "fps": graph.fps,
        "joints": len(graph.joint_names),
        "segments": len(graph.segment_starts),
        "key_nodes": {kind: kinds.get(kind, 0) for kind in ("onset", "keyword", "break")},
        "keywords": dict(sorted(words.items())),
        "edges": {
            "total": edges,
            "natural": int(graph.natural.sum()),
            "unnatural": int(edges - graph.natural.sum()),
            "per_frame_mean": edges / nodes,
            "per_frame_quantiles": _quantiles(degrees),
            "frames_without_edges": int((degrees == 0).sum()),
            "frames_without_unnatural": int((unnatural_degrees(graph) == 0).sum()),
        },
        "thresholds": {
            "quantiles": _quantiles(graph.thresholds[~np.isnan(graph.thresholds)]),
            "frames_without": int(np.isnan(graph.thresholds).sum()),
        },
        "components": {kind: describe_components(graph, kind) for kind in ("strong", "weak")},
        "pieces": {
            "count": len(lengths),
            "quantiles": _quantiles(lengths),
            "longest_frames": 0 if longest is None else int(lengths[longest]),
            "longest_seconds": 0.0 if longest is None else float(lengths[longest] / graph.fps),
            "longest_start_node": None if longest is None else int(starts[longest]),
            "longest_start": None if longest is None else describe_node(graph, int(starts[longest])),
        },
    }


def describe_frames(library: ReferenceFrames) -> dict:
    """What is to be said of any library, ready for JSON: of motion matching and of baselines it is all."""
    kinds = Counter(library.key_nodes.kinds.tolist())
    sequences = len(library.sequence_starts) if isinstance(library, MatchingDatabase) else None
    return {
        "clips": _describe_clips(library),
        "frames": library.n_nodes,
        "seconds": library.n_nodes / library.fps,
        "fps": library.fps,
        "joints": len(library.joint_names),
        "segments": len(library.segment_starts),
        "sequences": sequences,
        "features": None if sequences is None else {"pose": library.pose.shape[1], "audio": library.audio.shape[1]},
        "key_nodes": {kind: kinds.get(kind, 0) for kind in ("onset", "keyword", "break")},
    }


def frames_lines(facts: Mapping) -> list[str]:
    """The facts of `describe_frames`, a line each."""
    lines = [
        f"clip {clip['clip']}: {clip['frames']} frames from node {clip['start_node']} ({clip['seconds']:.1f} s)"
        for clip in facts["clips"]
    ]
    lines.append(f"{facts['frames']} frames, {facts['joints']} joints, {facts['segments']} segments")
    if facts["sequences"] is not None:
        features = facts["features"]
        lines.append(
            f"{facts['sequences']} sequences; features: {features['pose']} of pose, {features['audio']} of sound"
        )
    return lines


def _describe_clips(graph: ReferenceFrames) -> list[dict]:
    ends = np.append(graph.clip_starts[1:], graph.n_nodes)
    return [
        {
            "clip": name,
            "start_node": int(start),
            "frames": int(end - start),
            "seconds": float((end - start) / graph.fps),
        }
        for name, start, end in zip(graph.clip_names, graph.clip_starts, ends, strict=True)
    ]


def piece_lengths(graph: MotionGraph) -> tuple[np.ndarray, np.ndarray]:
    """Lengths in frames and first nodes of the graph's pieces, int `[shape=(P,)]` each."""
    lengths, starts = [], []
    for first, last in zip(graph.segment_starts, graph.segment_ends, strict=True):
        marks = graph.key_nodes.frames
        marks = np.union1d([first], marks[(marks >= first) & (marks <= last)])
        lengths.append(np.diff(marks))
        starts.append(marks[:-1])
    return np.concatenate(lengths).astype(int), np.concatenate(starts).astype(int)


def describe_components(graph: MotionGraph, kind: str) -> dict:
    """Connected components by edges along their direction (`strong`) or regardless of it (`weak`).

    From any frame of a strong component every other one of it can be reached.
    """
    from scipy.sparse import csgraph, csr_array

    # A stored 0 would be no edge to scipy, and natural edges cost 0.
    ones = np.ones(len(graph.indices), dtype=np.int8)
    matrix = csr_array((ones, graph.indices, graph.indptr), shape=(graph.n_nodes, graph.n_nodes))
    count, labels = csgraph.connected_components(matrix, directed=True, connection=kind)
    largest = int(np.bincount(labels).max())
    return {"count": int(count), "largest_frames": largest, "largest_share": largest / graph.n_nodes}


def unnatural_degrees(graph: MotionGraph) -> np.ndarray:
    """Unnatural edges that leave each node `[shape=(N,)]`."""
    rows = np.repeat(np.arange(graph.n_nodes), np.diff(graph.indptr))
    return np.bincount(rows[~graph.natural], minlength=graph.n_nodes)


def _quantiles(values: np.ndarray) -> list[float] | None:
    return np.quantile(values, _QUANTILES).tolist() if len(values) else None


def describe_node(graph: MotionGraph, node: int) -> dict:
    clip = int(np.searchsorted(graph.clip_starts, node, side="right") - 1)
    return {"clip": graph.clip_names[clip], "source_frame": int(graph.source_frames[node])}


def graph_lines(facts: Mapping) -> list[str]:
    """The figures of `describe_graph` for reading."""
    edges, pieces, kinds = facts["edges"], facts["pieces"], facts["key_nodes"]
    lines = [
        f"frames: {facts['frames']} ({facts['seconds']:.1f} s at {facts['fps']:g} fps), {facts['joints']} joints, "
        f"{count(facts['segments'], 'segment')}",
        *(f"clip: {c['clip']}, {c['frames']} frames from node {c['start_node']}" for c in facts["clips"]),
        f"key nodes: {sum(kinds.values())}: " + ", ".join(f"{count} {kind}" for kind, count in kinds.items()),
        "keywords: " + (", ".join(f"{word} {count}" for word, count in facts["keywords"].items()) or "none"),
        f"edges: {edges['total']}: {edges['natural']} natural, {edges['unnatural']} unnatural",
        f"edges per frame: mean {edges['per_frame_mean']:.2f}, {_spread(edges['per_frame_quantiles'])}; "
        f"{count(edges['frames_without_edges'], 'frame')} without any, {edges['frames_without_unnatural']} without an unnatural one",
        f"thresholds: {_spread(facts['thresholds']['quantiles'], 2)}; {count(facts['thresholds']['frames_without'], 'frame')} without",
    ]
    for kind, found in facts["components"].items():
        lines.append(
            f"{kind}ly connected components: {found['count']}, the largest of {found['largest_frames']} frames "
            f"({found['largest_share']:.0%})"
        )
    lines.append(f"pieces between key nodes: {pieces['count']}, frames {_spread(pieces['quantiles'])}")
    if pieces["count"]:
        start = pieces["longest_start"]
        lines.append(
            f"longest piece: {pieces['longest_frames']} frames ({pieces['longest_seconds']:.2f} s), from node "
            f"{pieces['longest_start_node']}, {start['clip']} frame {start['source_frame']}"
        )
    return lines


def _spread(quantiles: list[float] | None, digits: int = 0) -> str:
    if quantiles is None:
        return "-"
    words = ("min", "25%", "median", "75%", "max")
    return ", ".join(f"{word} {value:.{digits}f}" for word, value in zip(words, quantiles, strict=True))


def count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"

"""Statistics of a motion graph.

A piece of a graph is a stretch from one key node to the next within a segment; the lead-in of a segment, from
its first node to its first key node, is one too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from gesturegen.methods.inspection import BLUE, describe_clips, new_figure, save_figure
from gesturegen.methods.method import Inspection
from gesturegen.methods.motion_graph import rewards
from gesturegen.methods.motion_graph.graph import MotionGraph
from gesturegen.settings.models import Config
from gesturegen.text import count

# A lag of beats that stands out by fewer standard deviations may be chance: it is the best of many.
SURE = 3.0
_MOST_DOTS = 5000
_QUANTILES = (0.0, 0.25, 0.5, 0.75, 1.0)


def describe_graph(graph: MotionGraph) -> dict:
    """Compute all figures of a graph, ready for JSON; lengths in frames unless named otherwise."""
    nodes, edges = graph.n_nodes, len(graph.indices)
    degrees = np.diff(graph.indptr)
    lengths, starts = piece_lengths(graph)
    longest = int(lengths.argmax()) if len(lengths) else None
    kinds = Counter(graph.key_nodes.kinds.tolist())
    words = Counter(word for word in graph.key_nodes.keywords.tolist() if word)
    return {
        "clips": describe_clips(graph),
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


def piece_lengths(graph: MotionGraph) -> tuple[np.ndarray, np.ndarray]:
    """Compute lengths in frames and first nodes of the graph's pieces, int `[shape=(P,)]` each."""
    lengths, starts = [], []
    for first, last in zip(graph.segment_starts, graph.segment_ends, strict=True):
        marks = graph.key_nodes.frames
        marks = np.union1d([first], marks[(marks >= first) & (marks <= last)])
        lengths.append(np.diff(marks))
        starts.append(marks[:-1])
    return np.concatenate(lengths).astype(int), np.concatenate(starts).astype(int)


def describe_components(graph: MotionGraph, kind: str) -> dict:
    """Describe the connected components by edges along their direction (`strong`) or regardless of it (`weak`).

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
    """Count the unnatural edges that leave each node `[shape=(N,)]`."""
    rows = np.repeat(np.arange(graph.n_nodes), np.diff(graph.indptr))
    return np.bincount(rows[~graph.natural], minlength=graph.n_nodes)


def _quantiles(values: np.ndarray) -> list[float] | None:
    return np.quantile(values, _QUANTILES).tolist() if len(values) else None


def describe_node(graph: MotionGraph, node: int) -> dict:
    """Name the clip and the recorded frame of a node."""
    clip = int(np.searchsorted(graph.clip_starts, node, side="right") - 1)
    return {"clip": graph.clip_names[clip], "source_frame": int(graph.source_frames[node])}


def graph_lines(facts: Mapping) -> list[str]:
    """Format the figures of `describe_graph` for reading."""
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


def inspect(graph: MotionGraph) -> Inspection:
    """Describe a graph with all its figures and plots."""
    facts = describe_graph(graph)
    return Inspection(facts, graph_lines(facts), partial(plot_graph, graph))


def lines(graph: MotionGraph, config: Config) -> list[str]:
    """Describe a graph in lines for the output of `build-graph`."""
    kinds = ", ".join(f"{int(np.sum(graph.key_nodes.kinds == kind))} {kind}" for kind in ("onset", "keyword", "break"))
    line = (
        f"{graph.n_nodes} nodes, {int(np.sum(graph.natural))} natural and {int(np.sum(~graph.natural))} unnatural edges, "
        f"key nodes: {kinds}"
    )
    return [line, *_beat_lag(graph, config)]


def _beat_lag(graph: MotionGraph, config: Config) -> list[str]:
    """Say in a line how long after the onsets of a reference its hands stop, if both are known."""
    measured = rewards.measure_beat_lag(graph, config)
    if measured is None:
        return []
    lag, sure = measured
    if sure < SURE:
        return [f"beats of the hands follow the onsets by no lag that stands out (z {sure:.1f})"]
    return [
        f"beats of the hands follow the onsets by {lag:+.2f} s (z {sure:.1f}); used is global_search.beat_lag_seconds "
        f"= {config.global_search.beat_lag_seconds:g}"
    ]


# --- pictures -----------------------------------------------------------------------------------------------


def plot_graph(graph: MotionGraph, title: str, file: BinaryIO) -> None:
    """Draw a PNG with the adjacency picture (edges by source and target time) and the degree histogram."""
    figure = new_figure()
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    seconds = graph.n_nodes / graph.fps
    rows = np.repeat(np.arange(graph.n_nodes), np.diff(graph.indptr))[~graph.natural] / graph.fps
    columns = graph.indices[~graph.natural] / graph.fps
    if len(rows) <= _MOST_DOTS:
        left.plot(columns, rows, ".", color=BLUE, markersize=4)
    else:
        _draw_density(figure, left, rows, columns, seconds)
    for first, last in zip(graph.segment_starts, graph.segment_ends, strict=True):
        left.plot(*[[first / graph.fps, last / graph.fps]] * 2, color="0.6", linewidth=1)
    for start in graph.clip_starts[1:] / graph.fps:
        left.axvline(start, color="0.3", linewidth=0.8)
        left.axhline(start, color="0.3", linewidth=0.8)
    left.set(xlim=(0, seconds), ylim=(seconds, 0), aspect="equal", xlabel="to, s", ylabel="from, s")
    left.set_title("unnatural edges; the natural ones are the grey line")
    degrees = unnatural_degrees(graph)
    right.hist(degrees, bins=np.arange(degrees.max() + 2) - 0.5, color=BLUE)
    right.set(xlabel="unnatural edges that leave a frame", ylabel="frames (log)", yscale="log", title="degrees")
    save_figure(figure, title, file)


def _draw_density(figure: Any, axes: Any, rows: np.ndarray, columns: np.ndarray, seconds: float) -> None:
    """Draw edges as counts in small squares, where they are so many that dots would hide each other."""
    edges = np.linspace(0.0, seconds, 301)
    counts, _, _ = np.histogram2d(rows, columns, bins=(edges, edges))
    # One edge must be as visible as a cluster, so the scale is logarithmic and squares without any are white.
    picture = axes.pcolormesh(edges, edges, np.log10(np.where(counts > 0, counts, np.nan)), cmap="viridis_r", vmin=-0.3)
    bar = figure.colorbar(picture, ax=axes, shrink=0.7, label=f"edges in a square of {edges[1]:.2f} s")
    ticks = [t for t in np.log10([1, 3, 10, 30, 100, 300, 1000]) if t <= np.log10(counts.max())]
    bar.set_ticks(ticks, labels=[f"{10**t:.0f}" for t in ticks])

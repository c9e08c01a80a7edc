"""Pictures of a graph, of a gesture database and of a trace, as PNG."""

from __future__ import annotations

from collections.abc import Mapping
from typing import BinaryIO

import numpy as np

from gesturegen.extras import need
from gesturegen.gestures import cutting
from gesturegen.gestures.database import GestureDatabase
from gesturegen.gestures.extraction import BODIES
from gesturegen.graph.motion_graph import MotionGraph
from gesturegen.inspection.databases import PAPER_GAP_SECONDS, leaving, of_copies
from gesturegen.inspection.graphs import unnatural_degrees

_BLUE, _ORANGE = "#0072b2", "#d55e00"
_GREY = "0.6"
_MOST_DOTS = 5000


def plot_graph(graph: MotionGraph, title: str, file: BinaryIO) -> None:
    """A PNG with the adjacency picture (edges by source and target time) and the degree histogram."""
    figure = _new_figure()
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    seconds = graph.n_nodes / graph.fps
    rows = np.repeat(np.arange(graph.n_nodes), np.diff(graph.indptr))[~graph.natural] / graph.fps
    columns = graph.indices[~graph.natural] / graph.fps
    if len(rows) <= _MOST_DOTS:
        left.plot(columns, rows, ".", color=_BLUE, markersize=4)
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
    right.hist(degrees, bins=np.arange(degrees.max() + 2) - 0.5, color=_BLUE)
    right.set(xlabel="unnatural edges that leave a frame", ylabel="frames (log)", yscale="log", title="degrees")
    _save_figure(figure, title, file)


def _draw_density(figure, axes, rows: np.ndarray, columns: np.ndarray, seconds: float) -> None:
    """So many edges that dots would hide each other: how many there are in each small square."""
    edges = np.linspace(0.0, seconds, 301)
    counts, _, _ = np.histogram2d(rows, columns, bins=(edges, edges))
    # One edge must be as visible as a cluster, so the scale is logarithmic and squares without any are white.
    picture = axes.pcolormesh(edges, edges, np.log10(np.where(counts > 0, counts, np.nan)), cmap="viridis_r", vmin=-0.3)
    bar = figure.colorbar(picture, ax=axes, shrink=0.7, label=f"edges in a square of {edges[1]:.2f} s")
    ticks = [t for t in np.log10([1, 3, 10, 30, 100, 300, 1000]) if t <= np.log10(counts.max())]
    bar.set_ticks(ticks, labels=[f"{10**t:.0f}" for t in ticks])


def plot_database(database: GestureDatabase, title: str, file: BinaryIO) -> None:
    """A PNG of clip lengths, clips by gap threshold, styles and edges; the first three without mirrored copies."""
    figure = _new_figure()
    (lengths, thresholds), (styles, edges) = figure.subplots(2, 2)
    own = ~of_copies(database)
    kinds = (("gestures", own & ~database.rests, _BLUE), ("rests", own & database.rests, _ORANGE))
    lengths.hist(
        [database.lengths[which] / database.fps for _, which, _ in kinds], bins=30, stacked=True,
        color=[color for _, _, color in kinds], label=[name for name, _, _ in kinds],
    )  # fmt: skip
    lengths.set(xlabel="length, s", ylabel="gesture clips", title="lengths")
    lengths.yaxis.get_major_locator().set_params(integer=True)
    lengths.legend()
    _draw_thresholds(thresholds, database)
    for name, which, color in kinds:
        styles.plot(database.styles[which, 0], database.styles[which, 2], ".", color=color, markersize=4, label=name)
    styles.set(xlabel="hand speed, cm/s", ylabel="height of the right hand, cm", title="styles")
    degrees = [leaving(database, body) for body in BODIES]
    most = max(int(one.max()) for one in degrees)
    bins = np.arange(most + 2) - 0.5 if most < 40 else np.linspace(-0.5, most + 0.5, 41)
    edges.hist(degrees, bins=bins, color=[_BLUE, _ORANGE], label=[f"{body} body" for body in BODIES])
    edges.set(xlabel="edges that leave a clip", ylabel="clips (log)", yscale="log", title="edges")
    edges.set_ylim(bottom=0.5)  # a single clip must be visible
    edges.yaxis.set_major_formatter("{x:g}")
    edges.yaxis.set_minor_formatter("")
    edges.legend()
    _save_figure(figure, title, file)


def _draw_thresholds(axes, database: GestureDatabase) -> None:
    """The number of clips and, on an axis of its own, their mean length."""
    numbers, means = database.thresholds.T
    axes.plot(cutting.THRESHOLDS, numbers, ".-", color=_BLUE)
    axes.axvline(PAPER_GAP_SECONDS, color=_GREY, linewidth=1)
    axes.set(xlabel="gap between words over, s; the paper's in grey", title="clips by gap threshold")
    axes.set_ylabel("clips", color=_BLUE)
    axes.set_ylim(bottom=0)
    other = axes.twinx()
    other.plot(cutting.THRESHOLDS, means, ".-", color=_ORANGE)
    other.set_ylabel("mean length, s", color=_ORANGE)
    other.set_ylim(bottom=0)


def plot_trace(trace: Mapping, file: BinaryIO) -> None:
    """A PNG with the graph nodes that a trace shows over time, and the histogram of its join distances."""
    figure = _new_figure()
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    others = trace.get("tracks", [])
    for track in others:
        _draw_pieces(left, trace, track, _GREY, _GREY)
    _draw_pieces(left, trace, trace, _BLUE, _ORANGE)
    also = "; grey: lower body and fingers" if others else ""
    left.set(xlabel="time, s", ylabel="graph node", title=f"what is shown; orange: pieces of a fallback{also}")
    right.hist([join["distance"] for join in trace["joins"] if not join["natural"]], bins=30, color=_BLUE)
    right.set(xlabel="distance", ylabel="joins", title="joins that jump")
    _save_figure(figure, trace["clip"], file)


def _draw_pieces(axes, trace: Mapping, track: Mapping, color: str, fallback_color: str) -> None:
    for piece in track["pieces"]:
        nodes = np.array(piece["nodes"])
        times = np.linspace(piece["start_frame"], piece["end_frame"], len(nodes)) / trace["fps"]
        runs = np.flatnonzero(np.abs(np.diff(nodes)) > 1) + 1
        chosen = fallback_color if piece["fallback"] else color
        for part, when in zip(np.split(nodes, runs), np.split(times, runs), strict=True):
            axes.plot(when, part, color=chosen, linewidth=2, marker=".", markersize=2)


def _new_figure():
    # Figure itself, not pyplot: no window system is asked for and no state is kept.
    return need("matplotlib.figure", "video").Figure(figsize=(12, 6.2), dpi=110, layout="constrained")


def _save_figure(figure, title: str, file: BinaryIO) -> None:
    figure.suptitle(title)
    figure.savefig(file, format="png", metadata={"Software": None})

"""Plots of a trace as PNG."""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from gesturegen.methods.inspection import BLUE, GREY, ORANGE, new_figure, save_figure
from gesturegen.trace import Trace, Track


def plot_trace(trace: Trace, file: BinaryIO) -> None:
    """Plot the graph nodes that a trace shows over time, and the histogram of its join distances, as a PNG."""
    figure = new_figure()
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    for track in trace.tracks:
        _draw_pieces(left, trace, track, GREY, GREY)
    _draw_pieces(left, trace, trace, BLUE, ORANGE)
    also = "; grey: lower body and fingers" if trace.tracks else ""
    left.set(xlabel="time, s", ylabel="graph node", title=f"what is shown; orange: pieces of a fallback{also}")
    right.hist([join.distance for join in trace.joins if not join.natural], bins=30, color=BLUE)
    right.set(xlabel="distance", ylabel="joins", title="joins that jump")
    save_figure(figure, trace.clip, file)


def _draw_pieces(axes, trace: Trace, track: Trace | Track, color: str, fallback_color: str) -> None:
    for piece in track.pieces:
        nodes = np.array(piece.nodes)
        times = np.linspace(piece.start_frame, piece.end_frame, len(nodes)) / trace.fps
        runs = np.flatnonzero(np.abs(np.diff(nodes)) > 1) + 1
        chosen = fallback_color if piece.fallback else color
        for part, when in zip(np.split(nodes, runs), np.split(times, runs), strict=True):
            axes.plot(when, part, color=chosen, linewidth=2, marker=".", markersize=2)

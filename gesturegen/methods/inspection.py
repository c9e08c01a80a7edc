"""Shared parts of all descriptions of libraries: figures of clips, frames and key nodes, and the look of plots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, BinaryIO

import numpy as np

from gesturegen.extras import need
from gesturegen.frames import ReferenceFrames
from gesturegen.methods.method import Inspection

BLUE, ORANGE = "#0072b2", "#d55e00"
GREY = "0.6"


def inspect_frames(
    library: ReferenceFrames, more: Mapping[str, Any] | None = None, lines: Sequence[str] = ()
) -> Inspection:
    """Describe a library of any method; more : further facts of the method, lines : its further lines."""
    kinds = Counter(library.key_nodes.kinds.tolist())
    clips = describe_clips(library)
    facts = {
        "clips": clips,
        "frames": library.n_nodes,
        "seconds": library.n_nodes / library.fps,
        "fps": library.fps,
        "joints": len(library.joint_names),
        "segments": len(library.segment_starts),
        **(more or {}),
        "key_nodes": {kind: kinds.get(kind, 0) for kind in ("onset", "keyword", "break")},
    }
    own = [
        f"clip {clip['clip']}: {clip['frames']} frames from node {clip['start_node']} ({clip['seconds']:.1f} s)"
        for clip in clips
    ]
    own.append(f"{facts['frames']} frames, {facts['joints']} joints, {facts['segments']} segments")
    return Inspection(facts, [*own, *lines])


def describe_clips(graph: ReferenceFrames) -> list[dict]:
    """Describe each reference clip of a library: name, first node, frames and seconds."""
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


def new_figure() -> Any:
    """Create an empty matplotlib figure."""
    # Figure itself, not pyplot: no window system is asked for and no state is kept.
    return need("matplotlib.figure", "video").Figure(figsize=(12, 6.2), dpi=110, layout="constrained")


def save_figure(figure: Any, title: str, file: BinaryIO) -> None:
    """Write a figure with a title as PNG, with the same bytes each time."""
    figure.suptitle(title)
    figure.savefig(file, format="png", metadata={"Software": None})

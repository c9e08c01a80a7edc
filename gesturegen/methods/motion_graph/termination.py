"""Targets: where the pieces of a test speech end, and where paths may stop for them (§4.2.2)."""

from __future__ import annotations

from gesturegen.data.keynodes import BREAK, KeyNodes
from gesturegen.path import Target


def targets(key_nodes: KeyNodes, n_frames: int) -> list[Target]:
    """Cut the test speech at its key nodes and at its end; a key node at frame 0 cuts nothing."""
    cuts = [
        (int(frame), str(kind), str(keyword))
        for frame, kind, keyword in zip(key_nodes.frames, key_nodes.kinds, key_nodes.keywords, strict=True)
        if 0 < frame < n_frames
    ]
    pieces, start = [], 0
    for end, kind, keyword in [*cuts, (n_frames, BREAK, "")]:
        pieces.append(Target(start, end, kind, keyword))
        start = end
    return pieces

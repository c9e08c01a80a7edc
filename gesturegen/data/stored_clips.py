"""Stored clips of a work folder as references: loaded, cut to `references.seconds`, identified by their checksums."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gesturegen.data import clips
from gesturegen.settings.models import Config
from gesturegen.stored import arrays as stored_arrays
from gesturegen.stored import sealing
from gesturegen.workspace import clip_path


def load_references(config: Config, names: Sequence[str]) -> list[clips.Reference]:
    """Load stored clips as references, in the order of `names`, cut where `references.seconds` are over."""
    return [load_reference(config, name, limit) for name, limit in zip(names, limits(config, names), strict=True)]


def load_reference(config: Config, name: str, limit: int | None = None) -> clips.Reference:
    """Load a stored clip as a reference of at most `limit` frames."""
    reference = clips.load(clip_path(config, name), config).reference(config)
    return reference if limit is None else _cut(reference, limit)


def limits(config: Config, names: Sequence[str]) -> list[int | None]:
    """Compute how many frames of each stored clip are used: None for all of them."""
    if config.references.seconds is None:
        return [None] * len(names)
    found, left = [], round(config.references.seconds * config.fps)
    for name in names:
        n_frames = len(stored_arrays.read(clip_path(config, name), clips.KIND, ("source_frames",))["source_frames"])
        # A clip whose motion is longer than its sound may leave nothing for the next, which has been chosen.
        found.append(max(left, 1) if left < n_frames else None)
        left -= n_frames
    return found


def _cut(reference: clips.Reference, n_frames: int) -> clips.Reference:
    """Cut a reference to its first frames; key nodes on the others are dropped like those on excluded frames."""
    kept = np.arange(n_frames)  # a slice would keep the whole clip in memory
    return replace(
        reference,
        motion=reference.motion.take(kept),
        source_frames=reference.source_frames[kept],
        segment_starts=reference.segment_starts[reference.segment_starts < n_frames],
    )


def digests(config: Config, names: Sequence[str]) -> tuple[str, ...]:
    """List the checksums of stored clips, so that a graph knows when they changed."""
    return tuple(stored_digest(clip_path(config, name)) for name in names)


def stored_digest(path: Path) -> str:
    """Return the checksum of a stored file after checking it; raises DataError where there is none.

    A worker reads each state of a file once for this and for loading it: with large references that takes longer
    than a search.
    """
    return sealing.checksum(
        path, {"clips": "preprocess", "graphs": "build-graph"}.get(path.parent.name, "train-refiner")
    )

"""What the commands share: their summary, the places of their files, and the index of preprocessed clips."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gesturegen import clips, files, recordings
from gesturegen.config import Config
from gesturegen.errors import DataError
from gesturegen.parallel import Outcome

INDEX_VERSION = 1


@dataclass
class Summary:
    """What a command did: per-clip outcome, warnings `(clip, text)`, lines and the files to look at."""

    outcome: Outcome
    warnings: list[tuple[str, str]] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    written: list[Path] = field(default_factory=list)


def work_path(config: Config, *parts: str) -> Path:
    """A place below the folder for everything that is written."""
    return Path(config.paths.work, *parts)


def clip_path(config: Config, name: str) -> Path:
    return work_path(config, "clips", f"{name}.npz")


def graph_path(config: Config, name: str) -> Path:
    return work_path(config, "graphs", f"{name}.npz")


def graph_name(names: Sequence[str], seconds: float | None = None) -> str:
    """The name of the graph of one clip or of several; seconds : `references.seconds`, at which they are cut."""
    name = names[0] if len(names) == 1 else "multi-" + hashlib.sha256("\n".join(names).encode()).hexdigest()[:12]
    return name if seconds is None else f"{name}-{seconds:g}s"


def require_writable(folder: Path) -> None:
    """DataError when `folder` cannot be written: before the work starts, not after."""
    probe = folder / ".gesturegen"
    files.write_text(probe, "")
    probe.unlink()


def read_index(config: Config) -> dict:
    """What `preprocess` left for later commands; DataError when it is missing or of other settings."""
    path = work_path(config, "clips", "index.json")
    if not path.is_file():
        raise DataError(f"{path}: nothing has been preprocessed there; run `gesturegen preprocess` first")
    index = files.read_json(path)
    if index.get("format_version") != INDEX_VERSION:
        raise DataError(f"{path}: written by another version; run `gesturegen preprocess` again")
    clips.check_settings(path, index["settings"], config.section_json("data", "blacklist"), "preprocess")
    return index


def read_manifest(work: Path) -> dict:
    """What `reenact` left in a work folder; DataError when it has not been run there."""
    path = work / "reenact" / "manifest.json"
    if not path.is_file():
        raise DataError(f"{path.parent}: nothing has been reenacted there; run `gesturegen reenact` first")
    return files.read_json(path)


def chosen_references(config: Config, index: dict) -> dict[str, tuple[str, ...]]:
    """The reference clips of each test clip, among the clips that could be preprocessed."""
    if not index["tests"]:
        raise DataError("no test clip could be preprocessed; mend the errors that `gesturegen preprocess` lists")
    references = {name: row["speaker"] for name, row in index["references"].items()}
    speakers = {name: row["speaker"] for name, row in index["tests"].items()}
    durations = {name: row["seconds"] for name, row in index["references"].items()}
    return recordings.choose_references(sorted(speakers), references, speakers, config, durations)


def load_references(config: Config, names: Sequence[str]) -> list[clips.Reference]:
    """Stored clips as references, in the order of their names here; cut where `references.seconds` are over."""
    loaded, limit = [], config.references.seconds
    left = math.inf if limit is None else round(limit * config.fps)
    for name in names:
        reference = clips.load(clip_path(config, name), config).reference(config)
        if reference.motion.n_frames > left:
            # A clip whose motion is longer than its sound may leave nothing for the next, which has been chosen.
            reference = _cut(reference, max(left, 1))
        left -= reference.motion.n_frames
        loaded.append(reference)
    return loaded


def _cut(reference: clips.Reference, n_frames: int) -> clips.Reference:
    """The first frames of a reference; key nodes on the others are dropped like those on excluded frames."""
    kept = np.arange(n_frames)  # a slice would keep the whole clip in memory
    return replace(
        reference,
        motion=reference.motion.take(kept),
        source_frames=reference.source_frames[kept],
        segment_starts=reference.segment_starts[reference.segment_starts < n_frames],
    )


def digests(config: Config, names: Sequence[str]) -> tuple[str, ...]:
    """What the stored clips hold, so that a graph knows when they changed."""
    return tuple(files.sha256(clip_path(config, name)) for name in names)

"""What the commands share: their summary, the places of their files, and the index of preprocessed clips."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

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


def graph_name(names: Sequence[str]) -> str:
    """The name of the graph of one clip or of several."""
    if len(names) == 1:
        return names[0]
    return "multi-" + hashlib.sha256("\n".join(names).encode()).hexdigest()[:12]


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
    return recordings.choose_references(sorted(speakers), references, speakers, config)


def load_references(config: Config, names: Sequence[str]) -> list[clips.Reference]:
    """Stored clips as references, in the order of their names here."""
    return [clips.load(clip_path(config, name), config).reference(config) for name in names]


def digests(config: Config, names: Sequence[str]) -> tuple[str, ...]:
    """What the stored clips hold, so that a graph knows when they changed."""
    return tuple(files.sha256(clip_path(config, name)) for name in names)

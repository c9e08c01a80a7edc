"""What the commands share: their summary, the places of their files, and the index of preprocessed clips."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gesturegen import clips, recordings
from gesturegen.config import Config
from gesturegen.errors import ConfigError, DamagedError, DataError, GesturegenError
from gesturegen.files import require_writable  # noqa: F401 - for the commands
from gesturegen.gestures import extraction
from gesturegen.motion import space
from gesturegen.parallel import Outcome
from gesturegen.stored import arrays as stored_arrays
from gesturegen.stored import documents, sealing

INDEX_VERSION = 2


@dataclass
class Summary:
    """What a command did: per-clip outcome, warnings `(clip, text)`, lines and the files to look at."""

    outcome: Outcome
    warnings: list[tuple[str, str]] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    written: list[Path] = field(default_factory=list)


def by_kind(notes: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Notes `(clip, text)`, with what is taken for granted of skeletons, units and axes told once, of the first clip."""
    kinds: dict[str, list[int]] = {}
    for place, (_, note) in enumerate(notes):
        kind = note if note.startswith("the skeleton has none") else space.kind_of(note)
        if kind is not None:
            kinds.setdefault(kind, []).append(place)
    told, left_out = dict(enumerate(notes)), set()
    for places in kinds.values():
        name, note = notes[places[0]]
        if len(places) > 1:
            more = len(places) - 1
            told[places[0]] = (name, f"and {more} more {'clip' if more == 1 else 'clips'}: {note}")
        left_out.update(places[1:])
    return [note for place, note in told.items() if place not in left_out]


def work_path(config: Config, *parts: str) -> Path:
    """A place below the folder for everything that is written."""
    return Path(config.paths.work, *parts)


def clip_path(config: Config, name: str) -> Path:
    return work_path(config, "clips", f"{name}.npz")


def graph_path(config: Config, name: str) -> Path:
    return work_path(config, "graphs", f"{name}.npz")


# Of the names of what methods build: several may share a work folder.
_SUFFIXES = {"gesture_master": "-gestures", "motion_matching": "-matching", "baseline": "-frames"}


def graph_name(config: Config, names: Sequence[str]) -> str:
    """The name of what a method builds of one reference clip or of several."""
    name = names[0] if len(names) == 1 else "multi-" + hashlib.sha256("\n".join(names).encode()).hexdigest()[:12]
    seconds = config.references.seconds
    name = name if seconds is None else f"{name}-{seconds:g}s"
    return name + _SUFFIXES.get(config.method, "")


def read_index(config: Config) -> dict:
    """What `preprocess` left for later commands; DataError when it is missing or of other settings."""
    path = work_path(config, "clips", "index.json")
    if not path.is_file():
        raise DataError(f"{path}: nothing has been preprocessed there; run `gesturegen preprocess` first")
    index = documents.read(path, documents.Index, "preprocess")
    if index["format_version"] != INDEX_VERSION:
        raise DamagedError(f"{path}: written by another version; run `gesturegen preprocess` again")
    clips.check_settings(path, index["settings"], data_settings(config), "preprocess")
    _locate_recordings(index["tests"], path, config)
    return index


def data_settings(config: Config) -> str:
    """Canonical JSON of the settings that say which recordings there are.

    Folders are as seen from the work folder of the clips, which others may share, such as those of variants.
    """
    work = work_path(config, "clips").resolve().parent
    settings = json.loads(config.section_json("data", "blacklist"))
    for key in ("references", "tests"):
        if (folder := settings["data"][key]) is not None:
            settings["data"][key] = Path(os.path.relpath(Path(folder).resolve(), work)).as_posix()
    return json.dumps(settings, sort_keys=True)


def relative_to_work(path: Path, config: Config) -> str:
    """How the index names a recording: by its place as seen from the work folder, since both may be moved together."""
    return Path(os.path.relpath(path.resolve(), work_path(config).resolve())).as_posix()


def _locate_recordings(tests: dict[str, dict], index_path: Path, config: Config) -> None:
    """Make the index's places of audio and true motion paths that can be opened.

    Where there is nothing any more, the data folder that the config names is searched for a clip of that name.
    """
    work = index_path.resolve().parent.parent  # that of the clips, which other work folders may share
    for row in tests.values():
        row |= {key: row[key] and os.path.normpath(work / row[key]) for key in ("audio", "truth") if key in row}
    if all(Path(row[key]).exists() for row in tests.values() for key in ("audio", "truth") if row.get(key)):
        return
    try:
        found = {recording.name: recording for recording in recordings.test_recordings(config)}
        truths = recordings.true_motions(config, found)
    except GesturegenError:
        return  # whoever opens the file says what is missing
    for name, row in tests.items():
        moved = {"audio": found[name].audio_path if name in found else None, "truth": truths.get(name)}
        row |= {key: str(path) for key, path in moved.items() if path and row.get(key) and not Path(row[key]).exists()}


def read_manifest(work: Path) -> dict:
    """What `reenact` left in a work folder; DataError when it has not been run there."""
    path = work / "reenact" / "manifest.json"
    if not path.is_file():
        raise DataError(f"{path.parent}: nothing has been reenacted there; run `gesturegen reenact` first")
    return documents.read(path, documents.Manifest, "reenact")


def chosen_references(config: Config, index: dict) -> dict[str, tuple[str, ...]]:
    """The reference clips of each test clip, among the clips that could be preprocessed."""
    if not index["tests"]:
        raise DataError("no test clip could be preprocessed; mend the errors that `gesturegen preprocess` lists")
    require_names(config, [*index["references"]], [*index["tests"], *index["failed"]])
    references = {name: row["speaker"] for name, row in index["references"].items()}
    speakers = {name: row["speaker"] for name, row in index["tests"].items()}
    durations = {name: row["seconds"] for name, row in index["references"].items()}
    return recordings.choose_references(
        sorted(speakers), references, speakers, config, durations, failed=sorted(index["failed"])
    )


def require_names(config: Config, references: Iterable[str], tests: Iterable[str]) -> None:
    """ConfigError, one line for each, where a clip that the settings name is none of these; a typo must not pass.

    Patterns are taken to the letter first, then as globs. `blacklist` and `exclude` are looked at by `preprocess`.
    """
    master = config.gesture_master
    quality = {key: getattr(master.quality, key) for key in ("include", "exclude")}
    of_tests = [
        *((f"control.conditions, {place}", row.clip) for place, row in enumerate(config.control.conditions, 1)),
        *((f"control.gestures, {place}", row.clip) for place, row in enumerate(config.control.gestures, 1)),
        *(("gesture_master.style.targets", row.clip) for row in master.style.targets or ()),
    ]
    of_references = [
        *(("gesture_master.rhythm.corrections", row.clip) for row in master.rhythm.corrections or ()),
        # A gesture clip is called by its recording and a time; of a glob, that may be anywhere.
        *(
            (f"gesture_master.quality.{key}", name.rpartition("@")[0])
            for key, names in quality.items()
            for name in names
            if "@" in name
        ),
    ]
    used = master if config.method == "gesture_master" else None
    problems = [
        recordings.without_match(key, pattern, names, what)
        for rows, names, what in ((of_tests, tests, "test clip"), (of_references, references, "reference clip"))
        for key, pattern in rows
        if used or not key.startswith("gesture_master")
    ]
    if found := list(dict.fromkeys(filter(None, problems))):
        raise ConfigError("\n".join(found))


def load_references(config: Config, names: Sequence[str]) -> list[clips.Reference]:
    """Stored clips as references, in the order of their names here; cut where `references.seconds` are over."""
    return [load_reference(config, name, limit) for name, limit in zip(names, limits(config, names), strict=True)]


def load_reference(config: Config, name: str, limit: int | None = None) -> clips.Reference:
    """A stored clip as a reference, of at most `limit` frames."""
    reference = clips.load(clip_path(config, name), config).reference(config)
    return reference if limit is None else _cut(reference, limit)


def limits(config: Config, names: Sequence[str]) -> list[int | None]:
    """How many frames of each stored clip are used: None for all of them."""
    if config.references.seconds is None:
        return [None] * len(names)
    found, left = [], round(config.references.seconds * config.fps)
    for name in names:
        n_frames = len(stored_arrays.read(clip_path(config, name), clips.KIND, ("source_frames",))["source_frames"])
        # A clip whose motion is longer than its sound may leave nothing for the next, which has been chosen.
        found.append(max(left, 1) if left < n_frames else None)
        left -= n_frames
    return found


class StoredReferences(Sequence):
    """References that are read when they are looked at, and not kept; with mirrored copies after the recordings."""

    def __init__(self, config: Config, names: Sequence[str]):
        self.config, self.names = config, tuple(names)
        self.limits = limits(config, names)

    def __len__(self) -> int:
        return len(self.names) * (2 if self.config.gesture_master.mirror else 1)

    def __getitem__(self, number: int) -> clips.Reference:
        if not 0 <= number < len(self):
            raise IndexError(number)
        copy, own = divmod(number, len(self.names))
        reference = load_reference(self.config, self.names[own], self.limits[own])
        return extraction.mirrored(reference, self.config) if copy else reference


def shown_from(config: Config, names: Sequence[str]) -> Sequence[clips.Reference]:
    """The reference clips of a graph, for rendering what it shows of them."""
    return StoredReferences(config, names) if config.method == "gesture_master" else load_references(config, names)


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
    return tuple(stored_digest(clip_path(config, name)) for name in names)


def stored_digest(path: Path) -> str:
    """The checksum of a stored file, after a look whether it is still right; DataError where there is none.

    A worker reads each state of a file once for this and for loading it: with large references that takes longer
    than a search.
    """
    return sealing.checksum(
        path, {"clips": "preprocess", "graphs": "build-graph"}.get(path.parent.name, "train-refiner")
    )

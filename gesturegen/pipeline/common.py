"""Helpers of all commands: their summary, the places of their files, and the index of preprocessed clips."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gesturegen import remembered
from gesturegen.data import clips, recordings
from gesturegen.data import index as clip_index
from gesturegen.data.index import Index, IndexedTest
from gesturegen.errors import ConfigError, DamagedError, DataError, GesturegenError
from gesturegen.files import require_writable  # noqa: F401 - for the commands
from gesturegen.manifest import Manifest
from gesturegen.methods import METHODS
from gesturegen.motion import space
from gesturegen.outcome import Outcome
from gesturegen.settings.models import Config
from gesturegen.stored import documents
from gesturegen.workspace import work_path


@dataclass
class Summary:
    """The result of a command: per-clip outcome, warnings `(clip, text)`, lines to print and the files written."""

    outcome: Outcome
    warnings: list[tuple[str, str]] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    written: list[Path] = field(default_factory=list)


def by_kind(notes: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Merge notes `(clip, text)` on assumed skeletons, units and axes: each kind is told once, of its first clip."""
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


def read_index(config: Config) -> Index:
    """Read the index of clips that `preprocess` wrote, with paths that can be opened.

    Raises DataError when it is missing or of other settings.
    """
    path = work_path(config, "clips", "index.json")
    if not path.is_file():
        raise DataError(f"{path}: nothing has been preprocessed there; run `gesturegen preprocess` first")
    index = documents.read(path, Index, "preprocess")
    if index.format_version != clip_index.FORMAT_VERSION:
        raise DamagedError(f"{path}: written by another version; run `gesturegen preprocess` again")
    clips.check_settings(path, index.settings, data_settings(config), "preprocess")
    return index.model_copy(update={"tests": _located(index.tests, path, config)})


def data_settings(config: Config) -> str:
    """Format the settings that say which recordings there are as canonical JSON.

    Folders are as seen from the work folder of the clips, which others may share, such as those of variants.
    """
    work = work_path(config, "clips").resolve().parent
    settings = json.loads(config.section_json("data", "blacklist"))
    for key in ("references", "tests"):
        if (folder := settings["data"][key]) is not None:
            settings["data"][key] = Path(os.path.relpath(Path(folder).resolve(), work)).as_posix()
    return json.dumps(settings, sort_keys=True)


def relative_to_work(path: Path, config: Config) -> str:
    """Express a recording's path relative to the work folder, since both may be moved together."""
    return Path(os.path.relpath(path.resolve(), work_path(config).resolve())).as_posix()


def _located(tests: Mapping[str, IndexedTest], index_path: Path, config: Config) -> dict[str, IndexedTest]:
    """Resolve the paths of audio and true motion of the test clips to paths that can be opened.

    Where there is nothing any more, the data folder that the config names is searched for a clip of that name.
    """
    work = index_path.resolve().parent.parent  # that of the clips, which other work folders may share
    placed = {
        name: row.model_copy(
            update={key: place and os.path.normpath(work / place) for key, place in _places(row).items()}
        )
        for name, row in tests.items()
    }
    if all(Path(place).exists() for row in placed.values() for place in _places(row).values() if place):
        return placed
    try:
        found = {recording.name: recording for recording in recordings.test_recordings(config)}
        truths = recordings.true_motions(config, found)
    except GesturegenError:
        return placed  # whoever opens the file says what is missing
    for name, row in placed.items():
        moved = {"audio": found[name].audio_path if name in found else None, "truth": truths.get(name)}
        update = {
            key: str(moved[key])
            for key, place in _places(row).items()
            if place and moved[key] and not Path(place).exists()
        }
        placed[name] = row.model_copy(update=update)
    return placed


def _places(row: IndexedTest) -> dict[str, str | None]:
    return {"audio": row.audio, "truth": row.truth}


def share(config: Config, work: Path, *names: str) -> None:
    """Make another folder a work folder of these settings, so that every command works on it.

    names : folders of the config's work folder that it shares, by links. Raises DataError where it cannot hold links.
    """
    remembered.write(config, work)
    for name in names:
        target = os.path.relpath(work_path(config, name).resolve(), work.resolve())
        try:
            (work / name).symlink_to(target, target_is_directory=True)
        except OSError as error:
            raise DataError(
                f"{work / name}: cannot be a link to {target} ({error.strerror}); choose a folder that can hold links, "
                "with --work"
            ) from None


def read_manifest(work: Path) -> Manifest:
    """Read the manifest that `reenact` wrote in a work folder; DataError when it has not been run there."""
    path = work / "reenact" / "manifest.json"
    if not path.is_file():
        raise DataError(f"{path.parent}: nothing has been reenacted there; run `gesturegen reenact` first")
    return documents.read(path, Manifest, "reenact")


def chosen_references(config: Config, index: Index) -> dict[str, tuple[str, ...]]:
    """Choose the reference clips of each test clip, among the clips that could be preprocessed."""
    if not index.tests:
        raise DataError("no test clip could be preprocessed; mend the errors that `gesturegen preprocess` lists")
    require_names(config, index.references, [*index.tests, *index.failed])
    references = {name: row.speaker for name, row in index.references.items()}
    speakers = {name: row.speaker for name, row in index.tests.items()}
    return recordings.choose_references(
        sorted(speakers), references, speakers, config, index.durations, failed=sorted(index.failed)
    )


def require_names(config: Config, references: Iterable[str], tests: Iterable[str]) -> None:
    """Refuse settings that name a clip which does not exist: ConfigError, one line for each; a typo must not pass.

    Patterns are taken to the letter first, then as globs. `blacklist` and `exclude` are looked at by `preprocess`.
    """
    named = [
        *((f"control.conditions, {n}", row.clip, "test clip") for n, row in enumerate(config.control.conditions, 1)),
        *((f"control.gestures, {n}", row.clip, "test clip") for n, row in enumerate(config.control.gestures, 1)),
        *METHODS[config.method].named_clips(config),
    ]
    known = {"test clip": [*tests], "reference clip": [*references]}
    refuse_unmatched(
        recordings.without_match(key, pattern, known[what], what)
        for kind in known
        for key, pattern, what in named
        if what == kind
    )


def refuse_unmatched(problems: Iterable[str | None]) -> None:
    """Raise ConfigError with the lines of names that match no clip (`recordings.without_match`), each once."""
    if found := list(dict.fromkeys(filter(None, problems))):
        raise ConfigError("\n".join(found))

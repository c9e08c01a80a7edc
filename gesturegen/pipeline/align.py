"""The commands `align` and `transcribe`: write transcripts with times from texts or sound alone (extra `align`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from gesturegen import files, inputs
from gesturegen.data import recordings
from gesturegen.data.recordings import Recording
from gesturegen.errors import DataError
from gesturegen.extras import need
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import Summary, require_writable
from gesturegen.speech import alignment, audio, transcripts
from gesturegen.speech.transcript import Cell

_QUALITY = "of real speech about every third word is wrong: correct the words, or take a better recogniser; do not use them as they are"


def align(paths: Sequence[Path], output: Path | None, force: bool, jobs: int, quiet: bool) -> Summary:
    """Write `<clip>.tsv` for every text without times that lies beside its sound: there, or in `output`."""
    need("pocketsphinx", alignment.EXTRA)
    found = {
        one.name: (one.audio_path, text)
        for one in _recordings(paths)
        if one.audio_path is not None and (text := _text(one)) is not None
    }
    if not found:
        shown = ", ".join(map(inputs.shown, paths))
        raise DataError(f"{shown}: no text beside a sound; expected a.txt beside a.wav, or in folders txt and wav")
    places = {name: (output or text.parent) / f"{name}.tsv" for name, (_, text) in found.items()}
    tasks = {name: partial(_align_clip, sound, text, places[name]) for name, (sound, text) in found.items()}
    return _write_all(tasks, places, force, "align", jobs, quiet)


def transcribe(paths: Sequence[Path], output: Path | None, force: bool, jobs: int, quiet: bool) -> Summary:
    """Write `<clip>.tsv` with what pocketsphinx recognises in every sound: beside it, or in `output`."""
    need("pocketsphinx", alignment.EXTRA)
    found = {one.name: one.audio_path for one in _recordings(paths) if one.audio_path is not None}
    if not found:
        raise DataError(f"{', '.join(map(inputs.shown, paths))}: no WAV, FLAC or OGG file in it")
    places = {name: (output or sound.parent) / f"{name}.tsv" for name, sound in found.items()}
    tasks = {name: partial(_transcribe_clip, sound, places[name]) for name, sound in found.items()}
    summary = _write_all(tasks, places, force, "transcribe", jobs, quiet)
    summary.warnings.append(("transcribe", _QUALITY))
    return summary


def _write_all(
    tasks: Mapping[str, Callable], places: Mapping[str, Path], force: bool, label: str, jobs: int, quiet: bool
) -> Summary:
    """Run the tasks whose file does not exist yet, or all of them by `force`."""
    there = [] if force else [name for name, place in sorted(places.items()) if place.exists()]
    folders = sorted({place.parent for name, place in places.items() if name not in there})
    for folder in folders:
        require_writable(folder)
    outcome = for_each({name: task for name, task in tasks.items() if name not in there}, jobs, label, quiet)
    summary = Summary(outcome, written=folders if outcome.done else [])
    summary.warnings = [
        (name, f"{inputs.shown(places[name])} is there already; --force writes over it") for name in there
    ]
    summary.lines = [f"{name}: {line}" for name, line in outcome.done.items()]
    return summary


def _recordings(paths: Sequence[Path]) -> list[Recording]:
    """List the recordings of folders, and those that single files belong to; DataError for a path that is not there."""
    found: dict[str, Recording] = {}
    for path in paths:
        if inputs.is_dir(path):
            own = recordings.list_recordings(path)
        else:
            if not inputs.is_file(path):
                raise DataError(f"{inputs.shown(path)}: no such file or folder")
            own = [one for one in recordings.list_recordings(path.parent) if one.name == path.stem]
        for one in own:
            if one.problem is None and found.setdefault(one.name, one) != one:
                raise DataError(f"{inputs.shown(path)}: a second clip {one.name}; align them one after the other")
    return list(found.values())


def _text(one: Recording) -> Path | None:
    """Return the first file beside a recording that holds a text without times, None where there is none."""
    texts = [path for path in (one.transcript_path, *one.other_transcripts) if path is not None]
    texts = [path for path in texts if path.suffix.lower() in transcripts.WITHOUT_TIMES]
    return texts[0] if texts else None


def _align_clip(sound: Path, text: Path, place: Path) -> str:
    found = transcripts.align(text, *audio.read_samples(sound))
    _write(place, found.cells)
    count = "1 word" if len(found.cells) == 1 else f"{len(found.cells)} words"
    return f"{count}{found.described()}"


def _transcribe_clip(sound: Path, place: Path) -> str:
    cells = alignment.recognise(*audio.read_samples(sound))
    _write(place, cells)
    return f"{len(cells)} words recognised"


def _write(place: Path, cells: Sequence[Cell]) -> None:
    files.write_text(place, "".join(f"{cell.start:.2f}\t{cell.end:.2f}\t{cell.text}\n" for cell in cells))

"""The command `preprocess`: read recordings into clips (§3)."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path

from gesturegen import inputs
from gesturegen.data import clips, recordings
from gesturegen.data.index import FORMAT_VERSION, Index, IndexedClip, IndexedTest
from gesturegen.data.recordings import Recording
from gesturegen.errors import DamagedError, DataError
from gesturegen.motion import bvh
from gesturegen.outcome import Outcome
from gesturegen.parallel import describe_bugs, for_each
from gesturegen.pipeline.common import (
    Summary,
    by_kind,
    data_settings,
    refuse_unmatched,
    relative_to_work,
    require_names,
    require_writable,
)
from gesturegen.settings.models import Config
from gesturegen.speech import audio
from gesturegen.stored import documents, sealing
from gesturegen.workspace import clip_path, work_path

# From so many clips on, what is odd about all of them is told once.
_MANY = 4
# Names of files that are told of each ending.
_MOST_NAMED = 3


def preprocess(config: Config, jobs: int, quiet: bool, export_bvh: Path | None = None, reuse: bool = False) -> Summary:
    """Read, check and clean every reference and test recording into `clips/<clip>.npz` (§3).

    reuse : keep stored clips whose inputs and settings have not changed
    """
    references = {recording.name: recording for recording in recordings.reference_recordings(config)}
    tests = {recording.name: recording for recording in recordings.test_recordings(config)}
    _refuse_twins(references, tests)
    _require_names(config, references, tests)
    require_writable(work_path(config, "clips"))
    tasks = {
        name: partial(_preprocess_clip, recording, config, name in references, export_bvh, reuse)
        for name, recording in {**tests, **references}.items()
    }
    outcome = for_each(tasks, jobs, "preprocess", quiet)
    for name in outcome.errors | outcome.bugs:
        clip_path(config, name).unlink(missing_ok=True)
    if not any(name in outcome.done for name in references):
        raise DataError(
            "\n".join(
                [*outcome.errors.values(), *describe_bugs(outcome.bugs),
                 "no reference clip could be read, so there is nothing to build from"]
            )
        )  # fmt: skip
    index_path = work_path(config, "clips", "index.json")
    lost = documents.damage(index_path, Index, "preprocess") if reuse else []
    documents.write(index_path, _index(config, references, tests, outcome))
    summary = Summary(outcome, by_kind([(name, note) for name, done in outcome.done.items() for note in done["notes"]]))
    summary.warnings += [("index", note) for note in lost]
    summary.warnings = _together(summary.warnings) + _unused(config)
    summary.warnings += [
        (recording.name, "no BVH file, so it is no reference")
        for recording in recordings.recordings_without_motion(config)
    ]
    if config.keywords.words == {}:
        summary.warnings.append(("keywords", "the keyword list is empty, so no piece ends at a keyword"))
    summary.lines.append(
        f"{len(outcome.done)} of {len(tasks)} clips ready: {sum(n in outcome.done for n in references)} references, "
        f"{sum(n in outcome.done for n in tests)} tests"
    )
    summary.written = [work_path(config, "clips")] + ([export_bvh] if export_bvh else [])
    return summary


def _preprocess_clip(
    recording: Recording, config: Config, with_motion: bool, export_bvh: Path | None, reuse: bool
) -> dict:
    path = clip_path(config, recording.name)
    digest = clips.input_digest(recording)
    clip, lost = None, []
    try:
        clip = clips.load_if_current(path, config, digest, with_motion) if reuse and path.is_file() else None
    except DamagedError as error:
        lost = [sealing.remade(error)]
    if clip is None:
        clip = clips.prepare(recording, config, with_motion)
        clips.save(path, clip, config, digest)
    if export_bvh is not None and clip.motion is not None:
        bvh.write(export_bvh / f"{clip.name}.bvh", clip.motion)
    return {"notes": [*lost, *clip.all_notes(config)], "speaker": clip.speaker, "seconds": clip.duration}


def _refuse_twins(references: dict[str, Recording], tests: dict[str, Recording]) -> None:
    for name in sorted(references.keys() & tests.keys()):
        if references[name].audio_path != tests[name].audio_path:
            raise DataError(
                f"{tests[name].audio_path}: clip {name} is a reference and a test with different files; rename one of them"
            )


def _index(config: Config, references: dict[str, Recording], tests: dict[str, Recording], outcome: Outcome) -> Index:
    """Build the index: what later commands need to know of the data, so that they need not read it again."""
    truths = recordings.true_motions(config, tests)
    done = outcome.done
    return Index(
        format_version=FORMAT_VERSION,
        settings=data_settings(config),
        references={
            name: IndexedClip(speaker=done[name]["speaker"], seconds=done[name]["seconds"])
            for name in references
            if name in done
        },
        tests={
            name: _index_test(recording, done[name], truths.get(name), config)
            for name, recording in tests.items()
            if name in done
        },
        training_seconds=sum(_training_seconds(config, references, outcome)),
        failed={name: outcome.errors.get(name, "a bug of gesturegen") for name in tests if name not in done},
    )


def _index_test(recording: Recording, done: dict, truth: Path | None, config: Config) -> IndexedTest:
    """Build the entry of a test clip; done : what `_preprocess_clip` returned for this clip."""
    assert recording.audio_path is not None  # a clip without sound is not done
    return IndexedTest(
        speaker=done["speaker"],
        seconds=done["seconds"],
        audio=relative_to_work(recording.audio_path, config),
        truth=None if truth is None else relative_to_work(truth, config),
    )


def _training_seconds(config: Config, references: dict[str, Recording], outcome: Outcome) -> list[float]:
    """List the durations of the whole training set, blacklist included, of which utilisation is a share."""
    seconds = [outcome.done[name]["seconds"] for name in references if name in outcome.done]
    for recording in recordings.blacklisted_recordings(config):
        try:
            samples, rate = audio.read_samples(recording.audio_path) if recording.audio_path else ((), 1)
        except DataError:
            continue
        seconds.append(len(samples) / rate)
    return seconds


def _require_names(config: Config, references: Iterable[str], tests: Iterable[str]) -> None:
    """Refuse settings that name a clip which does not exist: ConfigError, one line for each."""
    known = _require_references(config, references)
    require_names(config, known, tests)


def _require_references(config: Config, references: Iterable[str]) -> list[str]:
    """List all references, blacklist included; ConfigError where `blacklist` or `exclude` names an unknown clip."""
    known = [*references, *(recording.name for recording in recordings.blacklisted_recordings(config))]
    patterns = [("blacklist", pattern) for pattern in config.blacklist]
    patterns += [("exclude", range_.clip) for range_ in config.exclude]
    refuse_unmatched(recordings.without_match(key, pattern, known, "reference clip") for key, pattern in patterns)
    return known


def _unused(config: Config) -> list[tuple[str, str]]:
    """Warn, once for each folder of recordings, of files that are not used."""
    warnings = []
    for folder in recordings.folders(config):
        paths = recordings.unused_files(folder)
        kinds: dict[str, list[str]] = {}
        for path in paths:
            kinds.setdefault(path.suffix.lower() or "no ending", []).append(inputs.shown(path.name))
        if kinds:
            listed = [
                f"{len(names)} {kind} ({', '.join(names[:_MOST_NAMED])}{', ...' if len(names) > _MOST_NAMED else ''})"
                for kind, names in kinds.items()
            ]
            files = "1 file is" if len(paths) == 1 else f"{len(paths)} files are"
            warnings.append((inputs.shown(folder), f"{files} not used: {', '.join(listed)}"))
    return warnings


def _together(warnings: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Merge warnings that many clips share but for their names into one, of the first of them."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for clip, note in warnings:
        groups.setdefault(note.replace(f"{clip}.", "\0"), []).append((clip, note))
    told = []
    for own in groups.values():
        (clip, note), *others = own
        told += own if len(own) < _MANY else [(f"{clip} and {len(others)} more", note)]
    return told

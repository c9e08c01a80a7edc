"""`preprocess`: recordings to clips (§3)."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from gesturegen import clips, recordings
from gesturegen.config import Config
from gesturegen.errors import DamagedError, DataError
from gesturegen.motion import bvh
from gesturegen.parallel import Outcome, describe_bugs, for_each
from gesturegen.pipeline.common import INDEX_VERSION, Summary, clip_path, relative_to_work, require_writable, work_path
from gesturegen.recordings import Recording
from gesturegen.speech import audio
from gesturegen.stored import documents, sealing


def preprocess(config: Config, jobs: int, quiet: bool, export_bvh: Path | None = None, reuse: bool = False) -> Summary:
    """Read, check and clean every reference and test recording into `clips/<clip>.npz` (§3).

    reuse : keep stored clips whose inputs and settings have not changed
    """
    references = {recording.name: recording for recording in recordings.reference_recordings(config)}
    tests = {recording.name: recording for recording in recordings.test_recordings(config)}
    _refuse_twins(references, tests)
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
    lost = documents.damage(index_path, documents.Index, "preprocess") if reuse else []
    documents.write(index_path, _index(config, references, tests, outcome))
    summary = Summary(outcome, [(name, note) for name, done in outcome.done.items() for note in done["notes"]])
    summary.warnings += [("index", note) for note in lost]
    summary.warnings += _unmatched_patterns(config, references)
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


def _index(config: Config, references: dict[str, Recording], tests: dict[str, Recording], outcome: Outcome) -> dict:
    """What later commands need to know of the data, so that they need not look at it again."""
    truths = recordings.true_motions(config, tests)
    done = outcome.done
    return {
        "format_version": INDEX_VERSION,
        "settings": config.section_json("data", "blacklist"),
        "references": {
            name: {key: done[name][key] for key in ("speaker", "seconds")} for name in references if name in done
        },
        "tests": {
            name: {
                **{key: done[name][key] for key in ("speaker", "seconds")},
                "audio": relative_to_work(recording.audio_path, config),
                "truth": relative_to_work(truths[name], config) if name in truths else None,
            }
            for name, recording in tests.items()
            if name in done
        },
        "training_seconds": sum(_training_seconds(config, references, outcome)),
        "failed": {name: outcome.errors.get(name, "a bug of gesturegen") for name in tests if name not in done},
    }


def _training_seconds(config: Config, references: dict[str, Recording], outcome: Outcome) -> list[float]:
    """Durations of the whole training set, the blacklist included: what utilisation is a share of."""
    seconds = [outcome.done[name]["seconds"] for name in references if name in outcome.done]
    for recording in recordings.blacklisted_recordings(config):
        try:
            samples, rate = audio.read_samples(recording.audio_path) if recording.audio_path else ((), 1)
        except DataError:
            continue
        seconds.append(len(samples) / rate)
    return seconds


def _unmatched_patterns(config: Config, references: dict[str, Recording]) -> list[tuple[str, str]]:
    blacklisted = [recording.name for recording in recordings.blacklisted_recordings(config)]
    warnings = [
        ("blacklist", f"{pattern!r} matches no reference clip; check its spelling")
        for pattern in config.blacklist
        if not any(recordings.is_listed(name, (pattern,)) for name in blacklisted)
    ]
    return warnings + [
        ("exclude", f"clip {range_.clip!r} is no reference clip; check its spelling")
        for range_ in config.exclude
        if not any(recordings.is_listed(name, (range_.clip,)) for name in [*references, *blacklisted])
    ]

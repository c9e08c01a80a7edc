"""The commands `check` and `pack`: check that a folder is a valid submission, and archive it."""

from __future__ import annotations

import zipfile
from contextlib import suppress
from functools import lru_cache, partial
from operator import methodcaller
from pathlib import Path

import numpy as np

from gesturegen import files, inputs, submission
from gesturegen.data import clips, keynodes, recordings
from gesturegen.errors import DataError
from gesturegen.motion import bvh, cleanup
from gesturegen.motion.skeleton import Skeleton
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import Summary, require_writable
from gesturegen.settings.models import Config
from gesturegen.speech import audio
from gesturegen.stored import sealing
from gesturegen.workspace import clip_path, work_path


def check(config: Config, folder: Path | None, strict: bool, jobs: int, quiet: bool) -> Summary:
    """Say of any BVH folder whether the challenge would accept it; one line per problem.

    folder : this run's own BVH files by default; strict : stretches without motion are problems too
    """
    folder = folder if folder is not None else work_path(config, "reenact")
    if not inputs.is_dir(folder):
        raise DataError(f"{inputs.shown(folder)}: no such folder")
    speeches = {recording.name: recording for recording in recordings.test_recordings(config)}
    skeletons = _training_skeletons(config)
    found = {path.stem for path in folder.glob("*.bvh")}
    tasks = {
        name: partial(_check_clip, folder / f"{name}.bvh", speeches.get(name), skeletons, config)
        for name in found | speeches.keys()
    }
    outcome = for_each(tasks, jobs, "check", quiet)
    summary = Summary(outcome)
    for name, (problems, warnings) in list(outcome.done.items()):
        counted = problems + warnings if strict else problems
        if counted:
            outcome.errors[name] = "\n".join(counted)
            del outcome.done[name]
        if not strict:
            summary.warnings += [(name, warning) for warning in warnings]
    if not outcome.failed:
        summary.lines = [f"{folder}: {len(outcome.done)} clips, all valid"]
    return summary


def _reference_motions(config: Config) -> list[Path]:
    """List the BVH files of the recordings that may become references."""
    found = recordings.reference_recordings(config)
    return [recording.motion_path for recording in found if recording.motion_path is not None]


def _training_skeletons(config: Config) -> list[Skeleton]:
    """Read the skeletons of the training data, each once; DataError when no reference has a readable one.

    A broken reference is for `preprocess` to tell of: it must not keep the clips from being checked.
    """
    skeletons: list[Skeleton] = []
    broken: list[DataError] = []
    for path in _reference_motions(config):
        try:
            skeleton = bvh.read_skeleton(path)
        except DataError as error:
            broken.append(error)
            continue
        if all(skeleton.difference(other) for other in skeletons):
            skeletons.append(skeleton)
    if not skeletons:
        raise broken[0]
    return skeletons


def _check_clip(
    path: Path, recording: recordings.Recording | None, skeletons: list[Skeleton], config: Config
) -> tuple[list[str], list[str]]:
    if (problem := inputs.name_problem(path)) is not None:
        return [problem], []
    if recording is None:
        return [f"{path}: no test clip has this name; name files as the audio is named"], []
    n_frames, problems = None, []
    try:
        if recording.audio_path is None:
            raise DataError(f"{path}: no audio")
        samples, rate = audio.read_samples(recording.audio_path)
        n_frames = round(len(samples) / rate * config.fps)
    except DataError:
        problems.append(f"{path}: its audio {recording.audio_path} cannot be read, so its length is not checked")
    found, warnings = submission.check_motion(
        path, skeletons, n_frames, float(config.fps), partial(_recorded_turns, config),
        partial(_speaking, recording, config),
    )  # fmt: skip
    return found + problems, warnings


def _speaking(recording: recordings.Recording, config: Config) -> np.ndarray | None:
    """Mark the frames in which somebody speaks in a test clip; None where its speech cannot be read."""
    try:
        stored = clip_path(config, recording.name)
        clip = clips.load_if_current(stored, config, clips.input_digest(recording), False) if stored.is_file() else None
        speech = (clip or clips.prepare(recording, config, with_motion=False)).test_speech(config)
    except DataError:
        return None
    return keynodes.speaking(speech, config.pauses)


def _recorded_turns(config: Config) -> dict[str, float]:
    """Find the fastest turn of each joint, by name, in the references that can be read, in degrees a second."""
    paths = [path for path in _reference_motions(config) if path.is_file()]
    return _fastest_turns(tuple((path, sealing.file_state(path)) for path in paths), config.fps)


@lru_cache(maxsize=1)
def _fastest_turns(motions: tuple[tuple[Path, tuple[int, ...]], ...], fps: int) -> dict[str, float]:
    """Find the fastest turn of each joint; remembered for all clips; motions : BVH files, and the state of each."""
    fastest: dict[str, float] = {}
    for path, _ in motions:
        with suppress(DataError):  # of a broken reference `preprocess` tells
            motion = cleanup.resample(bvh.read(path), fps)
            for name, turn in zip(
                motion.skeleton.names, submission.turns_per_second(motion).max(axis=0, initial=0), strict=True
            ):
                fastest[name] = max(fastest.get(name, 0.0), float(turn))
    return fastest


def pack(config: Config, jobs: int, quiet: bool) -> Summary:
    """Check this run's BVH files, then write WORK/submission/ and WORK/submission.zip; nothing when one is invalid."""
    summary = check(config, None, False, jobs, quiet)
    if summary.outcome.failed:
        return summary
    folder, archive = work_path(config, "submission"), work_path(config, "submission.zip")
    require_writable(folder)
    names = sorted(f"{name}.bvh" for name in summary.outcome.done)
    for path in sorted(folder.glob("*.bvh")):
        if path.name not in names:
            path.unlink()
    contents = {name: (work_path(config, "reenact") / name).read_bytes() for name in names}
    for name, content in contents.items():
        files.write_bytes(folder / name, methodcaller("write", content))
    files.write_bytes(archive, lambda file: _write_zip(file, contents))
    summary.written = [folder, archive]
    return summary


def _write_zip(file, contents: dict[str, bytes]) -> None:
    """Write a ZIP archive, with the same bytes for the same contents: entries sorted, no times."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            entry = zipfile.ZipInfo(f"submission/{name}")
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content)

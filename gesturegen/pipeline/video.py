"""The command `render`: write motions and their sound as videos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gesturegen import files, inputs
from gesturegen.errors import DataError
from gesturegen.extras import need
from gesturegen.joints import settings_for
from gesturegen.motion import cleanup, space
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import Summary, read_index, require_writable
from gesturegen.pipeline.motions import folder_motions, folder_sounds, motion_files
from gesturegen.settings.models import Config
from gesturegen.speech import audio
from gesturegen.video import encoding, figure, picture
from gesturegen.workspace import work_path

SMALLEST = 120


@dataclass(frozen=True)
class _Shot:
    """The files of one video: motions `(label, file)` from left to right, the first of which sets the length."""

    name: str
    motions: tuple[tuple[str, Path], ...]
    sound: Path | None


def render_videos(
    config: Config, jobs: int, quiet: bool, path: Path | None = None, sound: Path | None = None,
    beside: Sequence[tuple[str, Path]] = (), out: Path | None = None, size: tuple[int, int] = (960, 540),
) -> Summary:  # fmt: skip
    """Write an MP4 file per clip of `path` (`WORK/reenact` by default), at the config's frame rate.

    sound : a file or folder in place of the run's own audio; beside : (label, folder) of motions of the same
    names; size : width and height in pixels
    """
    need("av", "video")
    need("PIL", "video")
    if min(size) < SMALLEST or size[0] % 2 or size[1] % 2:
        raise DataError(f"a picture of {size[0]}x{size[1]}: width and height must be even and at least {SMALLEST}")
    motions = motion_files(config, [path] if path else [])
    sounds = _sounds(config, motions, path, sound)
    others = [(label, folder_motions(folder)) for label, folder in beside]
    for (_, folder), (_, found) in zip(beside, others, strict=True):
        if not motions.keys() & found.keys():
            raise DataError(f"{folder}: no BVH file in it has the name of a clip to show, such as {min(motions)}.bvh")
    own = "generated" if path is None else (path if path.is_dir() else path.parent).resolve().name
    shots = {name: _shot(name, motion, own, others, sounds) for name, motion in motions.items()}
    folder = out or work_path(config, "video")
    require_writable(folder)
    tasks = {name: partial(_film, shot, config, folder, size) for name, shot in shots.items()}
    outcome = for_each(tasks, jobs, "render", quiet)
    summary = Summary(outcome, written=[folder])
    for name in outcome.done:
        shown = {label for label, _ in shots[name].motions}
        summary.warnings += [(name, f"no motion of it for {label}") for label, _ in others if label not in shown]
        if shots[name].sound is None:
            summary.warnings.append((name, "no audio of that name, so its video is silent; give --audio"))
    summary.lines = [f"{name}: {seconds:.1f} s" for name, seconds in outcome.done.items()]
    return summary


def _shot(
    name: str, motion: Path, own: str, others: Sequence[tuple[str, Mapping[str, Path]]], sounds: Mapping[str, Path]
) -> _Shot:
    beside = [(label, found[name]) for label, found in others if name in found]
    # A motion that stands alone needs no label.
    return _Shot(name, ((own if others else "", motion), *beside), sounds.get(name))


def _sounds(config: Config, motions: Mapping[str, Path], path: Path | None, sound: Path | None) -> dict[str, Path]:
    """Find the audio file of each clip that has one."""
    if sound is not None and inputs.is_file(sound):
        if len(motions) > 1:
            raise DataError(f"{sound}: one audio file for {len(motions)} motions; give a folder of audio files")
        return dict.fromkeys(motions, sound)
    if sound is not None:
        if not inputs.is_dir(sound):
            raise DataError(f"{sound}: no such audio file or folder")
        found = folder_sounds(sound)
        if not motions.keys() & found.keys():
            raise DataError(f"{sound}: no audio file in it has the name of a clip to show, such as {min(motions)}")
        return found
    beside = {} if path is None else folder_sounds(path if path.is_dir() else path.parent)
    if path is None or work_path(config, "clips", "index.json").is_file():
        return beside | {name: Path(row.audio) for name, row in read_index(config).tests.items() if row.audio}
    return beside


def _film(shot: _Shot, config: Config, folder: Path, size: tuple[int, int]) -> float:
    """Write one video and return its duration in seconds."""
    inputs.require_usable_name(shot.motions[0][1])
    samples, rate = audio.read_samples(shot.sound) if shot.sound else (None, 0)
    scenes, n_frames = [], 0
    for label, path in shot.motions:
        motion = cleanup.resample(space.read(path, config), config.fps)
        n_frames = n_frames or motion.n_frames
        pelvis = settings_for(motion.skeleton, config).positions.root_joint
        scenes.append(picture.Scene(label, figure.make_figure(motion, pelvis)))
    pictures = picture.draw_pictures(scenes, shot.name, size, config.fps, n_frames)
    files.write_bytes(
        folder / f"{shot.name}.mp4", lambda file: encoding.write_mp4(file, pictures, config.fps, samples, rate)
    )
    return n_frames / config.fps

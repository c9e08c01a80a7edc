"""The motion and audio files that a user's paths stand for, by clip name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from gesturegen import inputs
from gesturegen.data import recordings
from gesturegen.errors import DataError
from gesturegen.settings.models import Config
from gesturegen.workspace import work_path


def motion_files(config: Config, paths: Sequence[Path]) -> dict[str, Path]:
    """Find BVH files by clip name: files, those of folders in any layout that is read, or of `WORK/reenact`."""
    found: dict[str, Path] = {}
    for path in paths or [work_path(config, "reenact")]:
        for name, motion in _of_path(path).items():
            if name in found and found[name] != motion:
                raise DataError(
                    f"{inputs.shown(motion)}: clip {name} is also {inputs.shown(found[name])}; give them one after the other"
                )
            found[name] = motion
    return found


def _of_path(path: Path) -> dict[str, Path]:
    if inputs.is_file(path):
        if path.suffix.lower() != ".bvh":
            raise DataError(f"{inputs.shown(path)}: not a BVH file; give a file that ends in .bvh, or a folder of them")
        return _with_names([path])
    if not inputs.is_dir(path):
        raise DataError(
            f"{inputs.shown(path)}: no such file or folder; run `gesturegen reenact` first, or give BVH files"
        )
    return folder_motions(path)


def folder_motions(folder: Path, arrays: bool = False) -> dict[str, Path]:
    """Find the BVH files of a folder by clip name; DataError when there is none.

    arrays : where there is no BVH file, `.npz` files will do
    """
    found = _with_names(r.motion_path for r in _recordings(folder) if r.motion_path)
    if not found and arrays:
        found = _with_names(sorted(folder.glob("*.npz")))
    if not found:
        raise DataError(f"{inputs.shown(folder)}: no BVH file in it")
    return found


def folder_sounds(folder: Path) -> dict[str, Path]:
    """Find the audio files of a folder by clip name."""
    return {r.name: r.audio_path for r in _recordings(folder) if r.audio_path}


def _with_names(paths: Iterable[Path]) -> dict[str, Path]:
    """Key files by clip name, as it can be printed; whoever opens one refuses a name that no written file can have."""
    return {inputs.shown(path.stem): path for path in paths}


def _recordings(folder: Path) -> list[recordings.Recording]:
    if not inputs.is_dir(folder):
        raise DataError(f"{inputs.shown(folder)}: no such folder")
    return recordings.list_recordings(folder)

"""Stored libraries of all methods; each file names its method."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gesturegen import files, frames
from gesturegen.errors import DataError
from gesturegen.frames import ReferenceFrames
from gesturegen.methods import METHODS
from gesturegen.methods.method import Job, Method
from gesturegen.settings.models import Config
from gesturegen.stored import sealing


def save(
    path: str | Path, method: Method, library: ReferenceFrames, config: Config, clip_digests: Sequence[str] = ()
) -> None:
    """Store the library of a method, with the settings that it depends on.

    clip_digests : SHA-256 of the stored clips it was built of, so that `load` can tell when they changed
    """
    settings = config.section_json(*method.settings)
    frames.save(path, library, method.kind(), method.name, settings, clip_digests)


def load(
    path: str | Path, method: Method, config: Config | None = None, clip_digests: Sequence[str] | None = None
) -> ReferenceFrames:
    """Read the stored library of a method; DataErrors as by `frames.load`.

    config, clip_digests : where they are given, it must have been built with these settings of these clips
    """
    settings = None if config is None else config.section_json(*method.settings)
    return frames.load(method.library_type(), method.kind(), path, settings, clip_digests)


def read(path: str | Path) -> ReferenceFrames:
    """Read a stored library of any method; DataError when the file is missing, damaged or no library."""
    return load(path, method_of(path))


def method_of(path: str | Path) -> Method:
    """Return the method of a stored library; DataError when the file is missing, damaged or no library."""
    if not Path(path).is_file():
        raise DataError(f"{path}: this graph has not been built; run `gesturegen build-graph` first")
    sealing.checksum(path, "build-graph")
    found = files.map_arrays(path, only={frames.METHOD_ARRAY, "format_version"})
    if {frames.METHOD_ARRAY, "format_version"} <= found.keys():
        name = str(found[frames.METHOD_ARRAY])
        if name in METHODS:
            return METHODS[name]
        raise DataError(f"{path}: a library of method {name!r}, which this version of gesturegen does not have")
    raise DataError(
        f"{path}: a clip or other arrays, not a graph and not a gesture database; both are in the folder `graphs`"
    )


def is_current(job: Job, clip_digests: Sequence[str]) -> bool:
    """Tell whether the stored library was built of these clips with these settings."""
    try:
        load(job.path, METHODS[job.config.method], job.config, clip_digests)
    except DataError:
        return False
    return True

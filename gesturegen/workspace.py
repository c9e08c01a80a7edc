"""Paths of a run's files below its work folder."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from gesturegen.methods import METHODS
from gesturegen.settings.models import Config


def work_path(config: Config, *parts: str) -> Path:
    """Return a path below the work folder."""
    return Path(config.paths.work, *parts)


def clip_path(config: Config, name: str) -> Path:
    """Return the path of a recording's stored clip."""
    return work_path(config, "clips", f"{name}.npz")


def library_path(config: Config, name: str) -> Path:
    """Return the path of the stored library of that name."""
    return work_path(config, "graphs", f"{name}.npz")


def library_name(config: Config, names: Sequence[str]) -> str:
    """Name what a method builds of one reference clip or of several; several methods may share a folder."""
    name = names[0] if len(names) == 1 else "multi-" + hashlib.sha256("\n".join(names).encode()).hexdigest()[:12]
    seconds = config.references.seconds
    name = name if seconds is None else f"{name}-{seconds:g}s"
    return name + METHODS[config.method].suffix

"""From a path to the motion that is written, with all that is laid over what a method has found."""

from __future__ import annotations

from collections.abc import Sequence

from gesturegen import render
from gesturegen.data.clips import Reference, Speech
from gesturegen.frames import ReferenceFrames
from gesturegen.motion.skeleton import Motion
from gesturegen.path import Path
from gesturegen.pipeline import keyword_gestures, refiner
from gesturegen.settings.models import Config


def show(
    path: Path, library: ReferenceFrames, references: Sequence[Reference], speech: Speech, config: Config
) -> tuple[Path, ReferenceFrames, Motion | None]:
    """The path with the gestures that are asked for, what its nodes are of, and its motion; None for a stuck one."""
    path, frames, shown = keyword_gestures.place(path, library, references, speech, config)
    if path.failure is not None:
        return path, frames, None
    motion = render.render(path, shown, frames, config)
    return path, frames, refiner.refine_motion(motion, speech, config) if config.refine else motion

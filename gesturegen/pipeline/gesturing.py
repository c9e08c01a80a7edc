"""The generation of a motion from a speech and a library, for every command: search, render, trace."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from gesturegen import render, submission
from gesturegen.data import clips, keynodes
from gesturegen.frames import ReferenceFrames
from gesturegen.methods import METHODS
from gesturegen.motion.skeleton import Motion
from gesturegen.path import Path
from gesturegen.pipeline import keyword_gestures, refiner
from gesturegen.randomness import generator
from gesturegen.settings.models import Config
from gesturegen.trace import Trace
from gesturegen.workspace import clip_path, library_name


@dataclass(frozen=True, eq=False)
class Gestured:
    """The result of gesturing a test clip.

    found : the path as the method found it, from which further variants are to differ; motion : None where the search
    got stuck; frames : what the nodes of the trace are of; seconds : what the search took, NaN where it was done before
    """

    found: Path
    trace: Trace
    motion: Motion | None
    frames: ReferenceFrames
    speech: clips.Speech
    seconds: float


def read_speech(test: str, config: Config) -> clips.Speech:
    """Read the speech of a stored test clip."""
    return clips.load(clip_path(config, test), config, with_motion=False).test_speech(config)


def title_of(test: str, variant: int) -> str:
    """Name a variant of a test clip, as in messages and for its random draws."""
    return test if variant == 1 else f"{test}, variant {variant}"


def search(
    test: str, library: ReferenceFrames, speech: clips.Speech, config: Config, variant: int = 1,
    earlier: Sequence[Path] = (),
) -> Path:  # fmt: skip
    """Find a path for a test clip that differs from those of earlier variants; the same for the same seed."""
    rng = generator(config.seed, title_of(test, variant))
    return METHODS[config.method].search(library, speech, config, rng, [p for p in earlier if p.failure is None])


def gesture(
    test: str, names: Sequence[str], library: ReferenceFrames, references: Sequence[clips.Reference],
    speech: clips.Speech, config: Config, found: Path | None = None, earlier: Sequence[Path] = (),
) -> Gestured:  # fmt: skip
    """Search for a test clip, render what was found and explain every frame of it.

    names, references : of the library, by name and as they are shown; found : its path, where it has been searched for
    already; earlier : the paths of earlier variants
    """
    variant, seconds = len(earlier) + 1, float("nan")
    if found is None:
        started = time.perf_counter()
        found = search(test, library, speech, config, variant, earlier)
        seconds = time.perf_counter() - started
    # The gestures that are asked for by word are laid over what the method has found.
    path, frames, shown = keyword_gestures.place(found, library, references, speech, config)
    motion = None
    if path.failure is None:
        motion = render.render(path, shown, frames, config)
        if config.refine:
            motion = refiner.refine_motion(motion, speech, config)
    key_nodes = keynodes.of_speech(speech, config.keywords.words or {})
    trace = submission.make_trace(path, frames, library_name(config, names), speech, key_nodes, config, variant)
    return Gestured(found, trace, motion, frames, speech, seconds)

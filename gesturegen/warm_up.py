"""Compilation of loops in one process before the workers of a command start, so that they find them compiled.

Without it every worker would compile the same loops at the same time. Nothing but time depends on the lists here: a
loop that is missing in them is compiled where it is first called, and kept from then on.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import sys
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

import numpy as np

from gesturegen.compiled import hook, is_switched_on, store
from gesturegen.methods import METHODS
from gesturegen.settings.loading import load_config
from gesturegen.speech import acoustics, audio, prosody
from gesturegen.video import _kernels as video_kernels

# Groups that this process has found or made ready.
_ready: set[str] = set()


def prepare(groups: Iterable[str], quiet: bool = True) -> None:
    """Compile groups of loops, those that are not yet kept, and say so in one line unless `quiet`.

    One process compiles while others wait for it; what is damaged or missing is compiled anew. That nothing can be
    kept is no error: then every process compiles for itself.
    """
    groups = [group for group in groups if group not in _ready]
    if is_switched_on() and not all(_is_kept(group) for group in groups):
        with store.alone() as folder:
            missing = [group for group in groups if not _is_kept(group)]
            if missing and not quiet:
                _tell(folder)
            for group in missing:
                for compile_loops in GROUPS[group]():
                    compile_loops()
                store.keep(_record(group), json.dumps(sorted(store.used)).encode())
    _ready.update(groups)


def _tell(folder: Path | None) -> None:
    from tqdm import tqdm

    line = "compiling loops for this version and processor, once; it takes up to a minute"
    reason = store.refusal()
    if folder is None:
        line += f"; they cannot be kept ({reason}): set XDG_CACHE_HOME to a folder that can be written"
    elif folder.parent != store.cache_folder():
        line += f"; they are kept in {folder.parent} ({reason or 'there is no home folder'})"
    tqdm.write(line, file=sys.stderr)


def _record(group: str) -> str:
    """Return the name of the entry that lists what a group needs, as of the present sources."""
    sources = sorted({inspect.getfile(compile_loops) for compile_loops in GROUPS[group]()})
    digest = hashlib.sha256("".join(map(hook.source_digest, sources)).encode()).hexdigest()
    return f"group-{group}-{digest[:24]}"


def _is_kept(group: str) -> bool:
    """Tell whether everything that a group needs is in the store and sound."""
    return any(all(store.is_sound(name) for name in json.load(stored)) for stored in store.read(_record(group)))


def _compile_speech() -> None:
    config = load_config()
    samples = np.random.default_rng(0).normal(size=config.onsets.sample_rate).astype(np.float32)
    audio.detect_onset_peaks(samples, 16000, config.onsets)
    prosody.measure(samples, 16000, config.prosody)
    acoustics.measure(samples, 16000, config.acoustics)


def _compile_video() -> None:
    image, segments, radii, colours = (
        np.zeros((8, 8, 3), np.uint8),
        np.ones((1, 4)),
        np.ones(1),
        np.zeros((1, 3), np.uint8),
    )
    video_kernels.draw_capsules(image, segments, radii, colours, np.array([0, 0, 8, 8]))
    video_kernels.to_yuv420(image, np.empty((12, 8), np.uint8))


def _of_methods(stage: str) -> list[Callable[[], object]]:
    """List the functions that compile what all methods need in `build` or `search`."""
    return [compile_loops for method in METHODS.values() for compile_loops in getattr(method, f"{stage}_loops")()]


GROUPS: dict[str, Callable[[], list[Callable[[], object]]]] = {
    "speech": lambda: [_compile_speech],
    "build": partial(_of_methods, "build"),
    "search": partial(_of_methods, "search"),
    "video": lambda: [_compile_video],
}


if __name__ == "__main__":
    prepare(GROUPS, quiet=False)

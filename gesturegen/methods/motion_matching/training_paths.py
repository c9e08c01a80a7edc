"""Paths to train a network on (§3.3): matches for the speech of a recording that do not show that recording."""

from __future__ import annotations

import numpy as np

from gesturegen.data.clips import Reference
from gesturegen.errors import DataError
from gesturegen.methods.motion_matching import features, nearest
from gesturegen.methods.motion_matching.database import MatchingDatabase, step_frames
from gesturegen.path import Path, Piece, Target, Track
from gesturegen.settings.models import Config


def stand_in(library: MatchingDatabase, own: Reference, k: int, config: Config, rng: np.random.Generator) -> Path:
    """Find the k-th best pieces for a recording's speech, with nothing of the recording itself where possible."""
    settings = config.motion_matching.model_copy(update={"k": k})
    step, n_frames = step_frames(config), own.motion.n_frames
    starts = np.arange(0, n_frames, step)
    assert own.speech.acoustics is not None, "its features are in the database"
    sound = features.audio_features(own.speech.acoustics, own.source_frames[starts] / own.motion.fps, settings)
    audio = features.apply(library.audio_scaling, sound)
    others = _elsewhere(library, own, starts, config)
    first = library.pose[rng.integers(library.n_nodes)]
    (match,) = nearest.search(library.candidates, [audio], first[None], step, settings, [others])
    if match.failed is not None:
        raise DataError(f"clip {own.name}: k-NN matching finds nothing to show for it; give longer references")
    ends = np.minimum(starts + step, n_frames)
    pieces = tuple(
        Piece(Target(start, end, "step"), match.nodes[start : start + end - start], 0.0)
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True)
    )
    return Path((Track(pieces),))


def _elsewhere(
    library: MatchingDatabase, own: Reference, starts: np.ndarray, config: Config
) -> list[np.ndarray] | np.ndarray:
    """Select nodes that each step may show: of other recordings or, of a single one, at least a sequence away."""
    names = np.repeat(np.arange(len(library.clip_names)), np.diff(np.append(library.clip_starts, library.n_nodes)))
    number = library.clip_names.index(own.name)
    if len(library.clip_names) > 1:
        allowed = names != number
        return [allowed] * len(starts)
    away = round(config.motion_matching.sequence_seconds * library.fps)
    return [np.abs(np.arange(library.n_nodes) - start) > away for start in starts]

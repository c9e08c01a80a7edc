"""Recorded motion for comparison: a random stretch of the references, or the motion of other speech.

Neither looks at what the test speech says; `config.baseline` says which of them it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gesturegen import frames as reference_frames
from gesturegen.data.clips import Reference, Speech
from gesturegen.frames import ReferenceFrames, describe, join, one_skeleton, positions_of, require_one_skeleton
from gesturegen.motion.skeleton import Skeleton
from gesturegen.path import Path, Piece, Target, Track
from gesturegen.settings.models import Config
from gesturegen.stored.arrays import Kind

FORMAT_VERSION = 3
STRETCH = "stretch"
KIND = Kind("set of frames", "build-graph", reference_frames.ARRAYS, FORMAT_VERSION, reference_frames.unfit)


@dataclass(frozen=True, eq=False)
class RecordedFrames(ReferenceFrames):
    """The frames of the references without edges: they follow one another only as they were recorded."""


def part(reference: Reference, config: Config) -> tuple[Skeleton, dict, np.ndarray]:
    """Extract a reference's skeleton, `frames.describe` and positions; DataError when a configured joint is missing."""
    return reference.motion.skeleton, describe(reference, config), positions_of(reference.motion, config)


def assemble(parts: Sequence[tuple[Skeleton, dict, np.ndarray]], config: Config) -> RecordedFrames:
    """Join the frames of several references; DataError when their skeletons differ."""
    one_skeleton([(described["clip_names"][0], skeleton) for skeleton, described, _ in parts], config)
    positions = np.concatenate([positions for _, _, positions in parts])
    return RecordedFrames(positions=positions, **join([described for _, described, _ in parts]))


def build(references: Sequence[Reference], config: Config) -> RecordedFrames:
    """Build the frames of one or several references; DataErrors as by `part` and `assemble`."""
    require_one_skeleton(references, config)
    return assemble([part(reference, config) for reference in references], config)


def search(
    library: RecordedFrames, speech: Speech, config: Config, rng: np.random.Generator, _earlier: Sequence[Path] = ()
) -> Path:
    """Choose uninterrupted stretches of the references: one where any is long enough, else several in a row.

    random_stretch : from a frame drawn at random
    mismatched : mismatched speech and motion, which is real motion with the timing of the other speech that it was
        recorded with: a speech onset of the references, drawn at random, falls on the first onset of the test speech
    _earlier : not looked at; another variant draws another stretch
    """
    last = np.repeat(library.segment_ends, np.diff(np.append(library.segment_starts, library.n_nodes)))
    pieces: list[Piece] = []
    shown: set[int] = set()
    frame = 0
    while frame < speech.n_frames:
        starts = _starts(library, speech, frame, config)
        left = speech.n_frames - frame
        fitting = starts[last[starts] - starts >= left - 1]
        if len(fitting):
            start, length = int(rng.choice(fitting)), left
        else:
            start = _draw_stretch(library, starts, last, shown, rng)
            length = int(last[start]) - start + 1
        target = Target(frame, frame + length, STRETCH)
        pieces.append(Piece(target, np.arange(start, start + length), 0.0))
        frame += length
    return Path((Track(tuple(pieces)),))


def _starts(library: RecordedFrames, speech: Speech, frame: int, config: Config) -> np.ndarray:
    """Find the nodes at which the stretch for `frame` of the speech and what comes after may start, ascending."""
    everywhere = np.arange(library.n_nodes)
    coming = speech.onset_frames[speech.onset_frames >= frame]
    if config.baseline == "random_stretch" or not len(coming):
        return everywhere
    onsets = library.key_nodes.frames[library.key_nodes.kinds == "onset"]
    starts = onsets - (int(coming[0]) - frame)
    segments = np.searchsorted(library.segment_starts, onsets, side="right") - 1
    starts = starts[starts >= library.segment_starts[segments]]
    # References without an onset that late in a stretch have none to align.
    return starts if len(starts) else everywhere


def _draw_stretch(
    library: RecordedFrames, starts: np.ndarray, last: np.ndarray, shown: set[int], rng: np.random.Generator
) -> int:
    """Draw where to start when no stretch is long enough: as early as possible in one not shown yet.

    Stretches are drawn by their length, so that many short ones do not make for many joins; once all have been shown
    they come again.
    """
    segments = np.searchsorted(library.segment_starts, starts, side="right") - 1
    own, first = np.unique(segments, return_index=True)
    fresh = ~np.isin(own, list(shown))
    if not fresh.any():
        shown.clear()
        fresh[:] = True
    own, earliest = own[fresh], starts[first[fresh]]
    lengths = last[earliest] - earliest + 1.0
    drawn = int(rng.choice(len(own), p=lengths / lengths.sum()))
    shown.add(int(own[drawn]))
    return int(earliest[drawn])

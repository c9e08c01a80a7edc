"""Gestures of a library folder, shown at a word or a time whatever the search finds (Habibie et al. 2022, §4.2)."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path as FilePath
from typing import overload

import numpy as np

from gesturegen import files, inputs
from gesturegen import frames as reference_frames
from gesturegen.control.gestures import placements
from gesturegen.data.clips import Reference, Speech
from gesturegen.data.recordings import matching
from gesturegen.errors import DataError
from gesturegen.frames import ExtendedFrames, ReferenceFrames
from gesturegen.joints import settings_for
from gesturegen.motion import cleanup, space
from gesturegen.path import Path, Piece, Target, Track, resampled_indices
from gesturegen.settings.models import Config
from gesturegen.speech.transcript import normalize
from gesturegen.trace import GESTURE_PREFIX, Trace

# What a piece that shows one is called in a trace.
KIND = "gesture"


def place(
    path: Path, library: ReferenceFrames, references: Sequence[Reference], speech: Speech, config: Config
) -> tuple[Path, ReferenceFrames, Sequence[Reference]]:
    """Put the gestures asked for into a path; return it with the frames and references of its nodes.

    All as they were where no gesture is asked for. Of several tracks, as GestureMaster has, the second one, which
    moves the lower body, goes on as it was.
    Raises DataError for a gesture that is not in the library or is of another skeleton.
    """
    if not config.control.gestures or path.failure is not None:
        return path, library, references
    found, notes = placements(config.control, speech)
    path = replace(path, notes=(*path.notes, *notes))
    if not found:
        return path, library, references
    names = sorted({one.gesture for one in found})
    gestures = [_load(config, name, references[0]) for name in names]
    frames = extended(library, gestures, config)
    first_nodes = dict(zip(names, frames.clip_starts[-len(names) :].tolist(), strict=True))
    lengths = {name: gesture.motion.n_frames for name, gesture in zip(names, gestures, strict=True)}
    tracks, ends = path.tracks, 0
    for one in found:
        start = max(min(round(one.time * speech.fps), speech.n_frames - 1), ends)
        if start >= speech.n_frames:
            note = f"gesture {one.gesture} at {one.time:.2f} s: the one before lasts to the end, so it is left out"
            path = replace(path, notes=(*path.notes, note))
            continue
        ends = min(start + lengths[one.gesture], speech.n_frames)
        nodes = first_nodes[one.gesture] + np.arange(ends - start)
        piece = Piece(Target(start, ends, KIND, one.gesture), nodes, 0.0)
        tracks = tuple(t if n == 1 else replace(t, pieces=_with_piece(t, piece)) for n, t in enumerate(tracks))
    path = replace(path, tracks=tracks)
    return path, frames, _Joined(references, gestures)


def unsaid(config: Config, words: Mapping[str, Collection[str]]) -> list[str]:
    """List, a line each, gestures whose word is said in none of the clips they are for; words : of each test clip."""
    lines = []
    for place, row in enumerate(config.control.gestures, 1):
        own = matching(row.clip, words)
        if row.word is None or any(normalize(row.word) in words[name] for name in own):
            continue
        all_words = sorted({word for name in own for word in words[name]})
        near = get_close_matches(normalize(row.word), all_words, n=1, cutoff=0.7)
        hint = f"; did you mean {inputs.shown(near[0])!r}?" if near else ""
        lines.append(f"gesture {place} ({row.gesture}): the word {row.word!r} is said in no test clip{hint}")
    return lines


def library_digests(config: Config) -> list[str]:
    """Hash the files of the gestures that may be shown, so that a result made of others is noticed."""
    if not config.control.gestures or not config.control.library:
        return []
    names = sorted({one.gesture for one in config.control.gestures})
    paths = [FilePath(config.control.library) / f"{name}.bvh" for name in names]
    return [files.sha256(path) if path.is_file() else "" for path in paths]


def load_frames(library: ReferenceFrames, trace: Trace, config: Config) -> ReferenceFrames:
    """Load the frames that a trace's nodes number: those of its library, and of the gestures that it shows."""
    own = trace.references[len(library.clip_names) :]
    if not own:
        return library
    names = [one.clip.removeprefix(GESTURE_PREFIX) for one in own]
    frames = extended(library, [_load(config, name, None) for name in names], config)
    last = max(max(piece.nodes) for piece in trace.all_pieces)
    starts = frames.clip_starts[len(library.clip_names) :].tolist()
    if last >= frames.n_nodes or starts != [one.start_node for one in own]:
        raise DataError(f"clip {trace.clip}: its gestures changed since; run `gesturegen reenact` again")
    return frames


def extended(library: ReferenceFrames, gestures: Sequence[Reference], config: Config) -> ExtendedFrames:
    """Append the frames of gestures to those of a library."""
    own = {name: getattr(library, name) for name in ReferenceFrames.__dataclass_fields__}
    own["positions"] = np.asarray(own["positions"])
    described = reference_frames.join([own, *(reference_frames.describe(one, config) for one in gestures)])
    positions = [own["positions"], *(reference_frames.positions_of(one.motion, config) for one in gestures)]
    mirrored = np.array([flag for _, flag in library.clips] + [False] * len(gestures))
    return ExtendedFrames(**described | {"positions": np.concatenate(positions)}, mirrored=mirrored)


def _with_piece(track: Track, new: Piece) -> tuple[Piece, ...]:
    """Put a piece into a track; pieces that it covers in part are cut where it begins and ends."""
    start, end = new.target.start_frame, new.target.end_frame
    before, after = [], []
    for piece in track.pieces:
        target = piece.target
        places = resampled_indices(len(piece.nodes), target.length)
        if target.start_frame < start:
            cut = min(start, target.end_frame)
            last = int(np.floor(places[cut - target.start_frame - 1] + 1e-9))
            before.append(_part(piece, target.start_frame, cut, piece.nodes[: last + 1]))
        if target.end_frame > end:
            cut = max(end, target.start_frame)
            first = int(np.ceil(places[cut - target.start_frame] - 1e-9))
            after.append(_part(piece, cut, target.end_frame, piece.nodes[first:]))
    return (*before, new, *after)


def _part(piece: Piece, start: int, end: int, nodes: np.ndarray) -> Piece:
    target = piece.target
    if (start, end) == (target.start_frame, target.end_frame):
        return piece
    kind, keyword = (target.end_kind, target.keyword) if end == target.end_frame else (KIND, "")
    return replace(piece, target=Target(start, end, kind, keyword), nodes=nodes)


class _Joined(Sequence[Reference]):
    """A sequence of references followed by others, each of which is read when it is looked at."""

    def __init__(self, first: Sequence[Reference], others: Sequence[Reference]):
        self.first, self.others = first, others

    def __len__(self) -> int:
        return len(self.first) + len(self.others)

    @overload
    def __getitem__(self, number: int) -> Reference: ...

    @overload
    def __getitem__(self, number: slice) -> Sequence[Reference]: ...

    def __getitem__(self, number: int | slice) -> Reference | Sequence[Reference]:
        if isinstance(number, slice):
            return [self[one] for one in range(len(self))[number]]
        return self.first[number] if number < len(self.first) else self.others[number - len(self.first)]


def _load(config: Config, name: str, like: Reference | None) -> Reference:
    """Read a gesture of the library; like : a reference whose skeleton it must have."""
    folder = FilePath(config.control.library) if config.control.library else None
    if folder is None or not inputs.is_dir(folder):
        raise DataError(f"control.library: {config.control.library!r} is no folder; give the one that has {name}.bvh")
    path = folder / f"{name}.bvh"
    if not inputs.is_file(path):
        known = sorted(inputs.shown(one.stem) for one in folder.glob("*.bvh"))
        near = get_close_matches(name, known, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]!r}?" if near else f"it has: {', '.join(known) or 'no BVH file'}"
        raise DataError(f"{inputs.shown(path)}: no such gesture; {hint}")
    gesture = _read(str(path), files.sha256(path), config.model_dump_json(by_alias=True))
    difference = like and gesture.motion.skeleton.difference(
        like.motion.skeleton, reference_frames.offset_tolerance(like.motion.skeleton, config)
    )
    if difference:
        raise DataError(f"{inputs.shown(path)}: not the skeleton of the references: {difference}; retarget it first")
    return gesture


@lru_cache(maxsize=32)
def _read(path: str, _digest: str, config_json: str) -> Reference:
    config = Config.model_validate_json(config_json)
    motion = cleanup.resample(space.read(path, config), config.fps)
    motion, _ = cleanup.clean_wrists(motion, np.array([0]), settings_for(motion.skeleton, config).wrists)
    speech = Speech(FilePath(path).stem, np.empty(0), (), motion.n_frames, float(config.fps))
    name = GESTURE_PREFIX + FilePath(path).stem
    return Reference(name, motion, speech, np.arange(motion.n_frames), np.array([0]))

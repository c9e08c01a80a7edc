"""Tiny references with words, pauses and two arms, and settings that cut them into many short clips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from hypothesis import settings

from gesturegen.data.clips import Reference, Speech
from gesturegen.methods.gesture_master.database import GestureDatabase
from gesturegen.methods.gesture_master.extraction import mirrored
from gesturegen.motion import rotation
from gesturegen.motion.skeleton import Motion, Skeleton
from gesturegen.settings.models import Config
from gesturegen.speech.prosody import Contour
from gesturegen.speech.transcript import Word
from tests import tiny
from tests.builders import SMALL, make_skeleton

# For tests that build a database, or cut a recording, in every example.
FEW = settings(SMALL, max_examples=10)
FPS = tiny.FPS
LEGS = tuple(f"b_{side}_{part}" for side in "lr" for part in ("upleg", "foot"))
ARMS = tuple(f"b_{side}_{part}" for side in "lr" for part in ("arm", "forearm", "wrist", "index1"))
NAMES = ("b_root", *LEGS, "b_spine0", "b_neck0", *ARMS)
UPPER = NAMES[5:]
LOWER = NAMES[:5]
FINGERS = ("b_l_index1", "b_r_index1")
_PARENTS = (-1, 0, 1, 0, 3, 0, 5, 5, 7, 8, 9, 5, 11, 12, 13)
_LEFT = [(9, -4, 1), (1, -80, 0)], [(17, 18, -2), (28, 0, 0), (25, 1, 0), (9, 0, 2)]


def skeleton(names: Sequence[str] = NAMES) -> Skeleton:
    """A symmetric body that faces along z, its left at positive x."""
    (left_leg, left_arm), flip = _LEFT, np.array([-1, 1, 1])
    offsets = [(0, 92, 0), *left_leg, *(flip * left_leg), (0, 22, 1), (0, 30, 0), *left_arm, *(flip * left_arm)]
    return make_skeleton(names, _PARENTS, offsets)


def motion(
    rng: np.random.Generator, frames: int, bones: Skeleton | None = None, fingers: bool = True, travel: float = 10.0
) -> Motion:
    """Smooth random motion: every joint turns, and the root travels, by a few slow waves."""
    bones = skeleton() if bones is None else bones
    joints = len(bones.names)
    times = np.arange(frames)[:, None, None] / FPS

    def waves(width: int) -> np.ndarray:
        speeds = rng.uniform(0.2, 1.2, size=(3, width, 3))
        phases = rng.uniform(0, 2 * np.pi, size=(3, width, 3))
        return sum(np.sin(2 * np.pi * speed * times + phase) for speed, phase in zip(speeds, phases, strict=True))

    maps = np.clip(0.2 * waves(joints), -1.0, 1.0)
    if not fingers:
        maps[:, [bones.names.index(name) for name in FINGERS]] = 0.0
    positions = np.tile(bones.offsets, (frames, 1, 1))
    positions[:, 0] += travel * waves(1)[:, 0]
    return Motion(bones, rotation.from_expmap(maps), positions, FPS)


def words(rng: np.random.Generator, frames: int) -> list[tuple[str, int, int]]:
    """Words of up to half a second, short gaps between most of them and now and then a pause, by frame."""
    found, frame = [], int(rng.integers(0, 40))
    while frame < frames:
        length = int(rng.integers(3, 15))
        found.append(("word", frame, min(frame + length, frames)))
        frame += length + int(rng.choice([0, 2, 5, 9, 14, 30, 50], p=[0.2, 0.2, 0.2, 0.1, 0.1, 0.1, 0.1]))
    return found


def speech(
    frames: int, words: Sequence[tuple[str, int, int]] = (), onsets: Sequence[int] = (), voice: int | None = None,
    name: str = "speech",
) -> Speech:  # fmt: skip
    """Words and onsets by frame; voice : the seed of a contour, None for none."""
    spoken = tuple(Word(text, start / FPS, end / FPS) for text, start, end in words)
    onset_times = np.array(sorted(onsets), dtype=float) / FPS
    return Speech(name, onset_times, spoken, frames, FPS, None if voice is None else contour(frames, voice))


def contour(frames: int, seed: int) -> Contour:
    """A random voice, 25 values a second."""
    rng = np.random.default_rng(seed)
    count = int(frames / FPS * 25) + 1
    pitch = np.where(rng.random(count) < 0.3, np.nan, 85 + 3 * rng.normal(size=count))
    return Contour(-30 + 8 * rng.normal(size=count), pitch, 25.0)


def reference(
    rng: np.random.Generator, frames: int, name: str = "clip", *, excluded: Sequence[tuple[int, int]] = (),
    spoken: Sequence[tuple[str, int, int]] | None = None, onsets: Sequence[int] = (), voice: int | None = None,
    moved: Motion | None = None, **options,
) -> Reference:  # fmt: skip
    """A recording of `frames` frames; `excluded` are ranges [from, to) of them that are left out."""
    moved = motion(rng, frames, **options) if moved is None else moved
    spoken = words(rng, frames) if spoken is None else spoken
    kept = np.ones(frames, dtype=bool)
    for start, end in excluded:
        kept[start:end] = False
    source = np.flatnonzero(kept)
    starts = np.append(0, np.flatnonzero(np.diff(source) > 1) + 1)
    return Reference(name, moved.take(source), speech(frames, spoken, onsets, voice, name), source, starts)


def glitch(reference: Reference, frame: int, joint: str = "b_l_arm") -> Reference:
    """The recording with a joint that points elsewhere for one of its frames."""
    moved = reference.motion
    rotations = moved.rotations.copy()
    turn = rotation.from_expmap(np.array([0.0, 0.0, 2.5]))
    place = moved.skeleton.names.index(joint)
    rotations[frame, place] = rotation.multiply(rotations[frame, place], turn)
    return replace(reference, motion=replace(moved, rotations=rotations))


def config(master: dict | None = None, **sections) -> Config:
    """Settings of GestureMaster that cut after 0.2 s and make clips of 0.5 to 2 s; all joints, no style."""
    gesture_master = {
        "cutting": {"gap_seconds": 0.2, "rest_seconds": 0.6, "min_seconds": 0.5, "max_seconds": 2.0},
        "style": {"source": "none"},
    }
    for key, value in (master or {}).items():
        both = isinstance(value, dict) and key in gesture_master
        gesture_master[key] = gesture_master[key] | value if both else value
    usual = {
        "method": "gesture_master", "joints": "all", "keywords": {"words": tiny.WORDS}, "prosody": {"enabled": True},
        "gesture_master": gesture_master, "blend": {"method": "overlap", "l_blend": 4},
    }  # fmt: skip
    return Config(**usual | sections)


def shown(references: Sequence[Reference], database: GestureDatabase, config: Config) -> list[Reference]:
    """The references that the nodes of a database are numbered by: the recordings, then their mirrored copies."""
    copies = [mirrored(reference, config) for reference in references] if database.mirrored.any() else []
    return [*references, *copies]

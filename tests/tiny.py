"""Tiny skeletons, motions, speeches, references and graphs for tests."""

from __future__ import annotations

import numpy as np

from gesturegen.data.clips import Reference, Speech
from gesturegen.data.keynodes import KeyNodes
from gesturegen.methods.motion_graph.graph import MotionGraph, from_positions
from gesturegen.motion import rotation
from gesturegen.motion.skeleton import Motion, Skeleton
from gesturegen.path import Path, Piece, Target, Track
from gesturegen.settings.models import Config, Continuity
from gesturegen.speech.transcript import Word

FPS = 30.0
WORDS = {"hi": "greeting", "hello": "greeting", "one": "counting"}
SIX = ("Xposition", "Yposition", "Zposition", "Zrotation", "Xrotation", "Yrotation")

# b_root, a chest, an arm of two joints and a finger below the wrist.
JOINTS = ("b_root", "b_spine0", "b_r_arm", "b_r_wrist", "b_r_thumb0")
PARENTS = (-1, 0, 1, 2, 3)


def config(**sections) -> Config:
    """Settings with the keyword list of these tests, every joint selected unless told otherwise."""
    return Config(**{"joints": "all", "keywords": {"words": WORDS}, "wrists": {"enabled": False}} | sections)


def skeleton(names=JOINTS, parents=PARENTS) -> Skeleton:
    offsets = np.array([[0.0, 90.0 if parent < 0 else 10.0, 1.0 * j] for j, parent in enumerate(parents)])
    return Skeleton(
        tuple(names), np.array(parents), offsets, np.full((len(names), 3), np.nan), (SIX,) * len(names), "HIERARCHY"
    )


def motion(rng: np.random.Generator, frames: int, bones: Skeleton | None = None, travel: float = 1.0) -> Motion:
    """Smooth random motion; the root travels `travel` per frame or so in each direction."""
    bones = skeleton() if bones is None else bones
    joints = len(bones.names)
    maps = 0.3 * rng.normal(size=(1, joints, 3)) + 0.05 * rng.normal(size=(frames, joints, 3)).cumsum(axis=0)
    positions = np.tile(bones.offsets, (frames, 1, 1))
    positions[:, 0] += travel * rng.normal(size=(frames, 3)).cumsum(axis=0)
    return Motion(bones, rotation.from_expmap(maps), positions, FPS)


def speech(frames: int, onsets=(), words=(), name: str = "speech") -> Speech:
    """Onsets by frame; words as (text, first frame, end frame)."""
    spoken = tuple(Word(text, start / FPS, end / FPS) for text, start, end in words)
    return Speech(name, np.array(sorted(onsets), dtype=float) / FPS, spoken, frames, FPS)


def reference(moved: Motion, onsets=(), words=(), segment_starts=(0,), source_frames=None, name="clip") -> Reference:
    kept = np.arange(moved.n_frames) if source_frames is None else np.array(source_frames)
    spoken = speech(int(kept[-1]) + 1, onsets, words, name)
    return Reference(name, moved, spoken, kept, np.array(segment_starts))


def random_reference(rng: np.random.Generator, frames: int, name: str = "clip") -> Reference:
    """A reference with random onsets, keywords and segments, down to one frame."""
    onsets = np.flatnonzero(rng.random(frames) < 0.15)
    words = [(str(rng.choice(list(WORDS))), f, f + 2) for f in np.flatnonzero(rng.random(frames) < 0.05).tolist()]
    starts = np.unique([0, *rng.integers(0, frames, size=rng.integers(0, 3))])
    return reference(motion(rng, frames), onsets, words, starts, name=name)


def key_nodes(rows) -> KeyNodes:
    """Key nodes from rows (frame, kind) or (frame, "keyword", keyword)."""
    rows = sorted(rows)
    return KeyNodes(
        np.array([row[0] for row in rows], dtype=np.int64),
        np.array([row[1] for row in rows], dtype=str),
        np.array([row[2] if len(row) > 2 else "" for row in rows], dtype=str),
    )


def with_breaks(rows, segment_starts, n_nodes: int) -> KeyNodes:
    """Key nodes with a break at the end of every segment that has no other row."""
    taken = {row[0] for row in rows}
    ends = [*(int(start) - 1 for start in segment_starts[1:]), n_nodes - 1]
    return key_nodes([*rows, *((end, "break") for end in ends if end not in taken)])


def _described(n_nodes: int, nodes: KeyNodes) -> dict:
    return {
        "joint_names": ("joint",), "fps": FPS, "clip_names": ("clip",), "clip_starts": np.array([0]),
        "source_frames": np.arange(n_nodes), "key_nodes": nodes, "speaking": np.ones(n_nodes, dtype=bool),
    }  # fmt: skip


def graph_of_positions(positions, segment_starts=(0,), rows=(), block_pairs=None, **continuity) -> MotionGraph:
    """The graph that the package builds of positions `[shape=(N, J, 3)]`."""
    positions, starts = np.asarray(positions, dtype=np.float32), np.array(segment_starts)
    described = _described(len(positions), with_breaks(rows, segment_starts, len(positions)))
    return from_positions(positions, starts, Continuity(**continuity), block_pairs, **described)


def graph_of_edges(n_nodes: int, edges, rows=(), segment_starts=(0,), natural=True) -> MotionGraph:
    """A graph with the given unnatural edges {(left, right): weight}, and all natural ones unless told otherwise.

    All its poses are the same.
    """
    last = {int(start) - 1 for start in segment_starts[1:]} | {n_nodes - 1}
    edges = dict(edges)
    if natural:
        edges |= {(node, node + 1): 0.0 for node in range(n_nodes) if node not in last}
    pairs = sorted(edges)
    lefts = np.array([left for left, _ in pairs], dtype=np.int64)
    rights = np.array([right for _, right in pairs], dtype=np.int64)
    return MotionGraph(
        positions=np.zeros((n_nodes, 1, 3), dtype=np.float32),
        segment_starts=np.array(segment_starts),
        indptr=np.concatenate([[0], np.cumsum(np.bincount(lefts, minlength=n_nodes))]),
        indices=rights,
        weights=np.array([edges[pair] for pair in pairs], dtype=np.float32),
        natural=(rights == lefts + 1) & ~np.isin(lefts, list(last)),
        thresholds=np.zeros(n_nodes),
        phrase_ends=np.zeros(0, dtype=np.int64),
        **_described(n_nodes, with_breaks(rows, segment_starts, n_nodes)),
    )


def random_graph(rng: np.random.Generator, n_nodes: int) -> MotionGraph:
    """Random edges with few different weights, so that many paths cost the same; some nodes are dead ends."""
    density = rng.choice([0.15, 0.3, 0.6])
    weights = rng.choice([0.0, 0.25, 0.5, 1.0, float(rng.random())], size=(n_nodes, n_nodes))
    edges = {(int(a), int(b)): weights[a, b] for a, b in np.argwhere(rng.random((n_nodes, n_nodes)) < density)}
    return graph_of_edges(n_nodes, edges, natural=False)


def path_of(*pieces) -> Path:
    """A path of pieces, each a run of nodes (its length is its target) or (nodes, target length)."""
    built, frame = [], 0
    for piece in pieces:
        nodes, length = piece if isinstance(piece, tuple) else (piece, len(piece))
        built.append(Piece(Target(frame, frame + length, "onset"), np.array(nodes), 0.0))
        frame += length
    return Path((Track(tuple(built)),))

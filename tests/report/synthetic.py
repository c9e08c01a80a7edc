"""Clips for the report without any recording: a small person who waves, speech, a trace."""

from __future__ import annotations

import numpy as np

from gesturegen.data.clips import Speech
from gesturegen.manifest import ClipRow, Manifest
from gesturegen.motion import rotation
from gesturegen.motion.skeleton import Motion, Skeleton
from gesturegen.report import pack, page
from gesturegen.settings.loading import load_config
from gesturegen.speech.transcript import Word
from gesturegen.submission import failed_row
from gesturegen.trace import Trace
from tests.builders import POSITIONS, ZXY, bursts

FPS = 30.0
# Joint, parent, offset: facing +Z, the left side at +X.
PERSON = (
    ("body_world", None, (0, 0, 0)),
    ("b_root", "body_world", (0, 90, 0)),
    ("b_spine0", "b_root", (0, 45, 0)),
    ("b_head", "b_spine0", (0, 15, 0)),
    ("b_l_eye", "b_head", (3, 8, 8)),
    ("b_l_shoulder", "b_spine0", (18, 0, 0)),
    ("b_l_arm", "b_l_shoulder", (0, -28, 0)),
    ("b_l_wrist", "b_l_arm", (0, -25, 0)),
    ("b_l_index1", "b_l_wrist", (0, -9, 0)),
    ("b_r_shoulder", "b_spine0", (-18, 0, 0)),
    ("b_r_arm", "b_r_shoulder", (0, -28, 0)),
    ("b_r_wrist", "b_r_arm", (0, -25, 0)),
    ("b_l_upleg", "b_root", (10, 0, 0)),
    ("b_l_foot", "b_l_upleg", (0, -85, 0)),
    ("b_r_upleg", "b_root", (-10, 0, 0)),
    ("b_r_foot", "b_r_upleg", (0, -85, 0)),
)
KEYWORDS = {"hello": "greeting"}


def person() -> Skeleton:
    names = [name for name, _, _ in PERSON]
    ends = np.full((len(names), 3), np.nan)
    ends[names.index("b_l_foot")] = ends[names.index("b_r_foot")] = (0, -4, 15)
    return Skeleton(
        tuple(names),
        np.array([-1 if parent is None else names.index(parent) for _, parent, _ in PERSON]),
        np.array([offset for _, _, offset in PERSON], dtype=float),
        ends,
        (POSITIONS + ZXY, *[ZXY] * (len(names) - 1)),
        "HIERARCHY",
    )


def waving(seconds: float, tempo: float = 1.0, skeleton: Skeleton | None = None, shake: float = 0.0) -> Motion:
    """Arms that swing, every frame unlike the one before; `shake` radians of noise make it as large as a real one."""
    skeleton = skeleton or person()
    frames, joints = round(seconds * FPS), len(skeleton.names)
    maps = shake * np.random.default_rng(0).normal(size=(frames, joints, 3))
    times = np.arange(frames) / FPS
    for k, name in enumerate(skeleton.names):
        if "arm" in name or "shoulder" in name:
            maps[:, k, 0] += -0.8 + 0.7 * np.sin(2 * np.pi * tempo * times + k)
    return Motion(skeleton, rotation.from_expmap(maps), np.tile(skeleton.offsets, (frames, 1, 1)), FPS)


def trace(frames: int, clip: str = "clip") -> Trace:
    """A trace of pieces of a second, with a join of each kind and a fallback, over two references of 100 frames."""
    pieces, joins = [], []
    for k, start in enumerate(range(0, frames, 30)):
        length = min(30, frames - start)
        first = 37 * k % 160
        pieces.append({
            "start_frame": start, "end_frame": start + length, "target_length": length,
            "end_kind": "keyword" if k % 4 == 2 else "onset", "keyword": "greeting" if k % 4 == 2 else "",
            "nodes": list(range(first, first + length)), "cost": 0.0, "retries": 0,
            "fallback": "keyword" if k % 4 == 2 else None,
        })  # fmt: skip
        if k:
            joins.append(
                {"frame": start, "from_node": 0, "to_node": first, "distance": 7.0 * (k % 5), "natural": k % 5 == 0}
            )
    return Trace(
        clip=clip, method="motion_graph", search="beam", seed=0, graph="multi", fps=FPS, n_frames=frames, version="0",
        config_hash="", references=[{"clip": "first", "start_node": 0}, {"clip": "second", "start_node": 100}],
        key_nodes=(), pieces=pieces, joins=joins, pauses=(), objective=None, failure=None, control=(), tracks=(), notes=(),
        inputs="", bvh_sha256=None,
    )  # fmt: skip


def speech(name: str, seconds: float) -> Speech:
    onsets = np.arange(0.5, seconds, 1.0)
    words = tuple(Word("hello" if k % 3 == 0 else f"word{k}", t, t + 0.4) for k, t in enumerate(onsets.tolist()))
    return Speech(name, onsets, words, round(seconds * FPS), FPS)


def clip_text(
    name: str = "clip",
    seconds: float = 4.0,
    labels=("generated",),
    sound: bool = True,
    skeleton: Skeleton | None = None,
    shake: float = 0.0,
) -> str:
    """One clip as it stands in a page; the motions differ in tempo."""
    told = pack.pack_trace(trace(round(seconds * FPS), name), np.arange(200) % 100)
    config = load_config()
    motions = [
        pack.pack_motion(
            waving(seconds, 1.0 + k, skeleton, shake),
            config,
            label,
            told if label != "truth" else None,
        )
        for k, label in enumerate(labels)
    ]
    spoken = speech(name, seconds)
    audio = pack.pack_audio(bursts(spoken.onset_times, seconds), 16000) if sound else None
    return pack.inert_json(pack.pack_clip(spoken, KEYWORDS, motions, audio))


def manifest(names, failed=()) -> Manifest:
    config = load_config()
    rows = [
        ClipRow(
            clip=name,
            references=(),
            n_frames=120,
            pieces=4,
            hard_joins=3,
            retries=0,
            fallbacks={},
            stuck=False,
            error=None,
            files={},
        )
        for name in names
    ]
    return Manifest(
        method="motion_graph", search="beam", seed=0, config_hash=config.signature(), gesturegen="0",
        clips=[*rows, *(failed_row(name, (), "it broke") for name in failed)], config={"fps": 30},
    )  # fmt: skip


def reference_length() -> dict:
    """`ablation/reference_length.json` of two searches at seven lengths."""
    lines = {}
    for search, distance in (("beam", 2600.0), ("global", 1900.0)):
        lines[search] = [
            {
                "setup": f"{minutes:g}min_{search}", "asked_seconds": 60.0 * minutes, "reference_seconds": 60.0 * minutes,
                "join_distance_per_minute": distance / (1.0 + minutes) ** 0.3, "join_distance_mean": 8.0,
                "hard_joins_per_minute": 90.0, "reference_share": 0.6 / (1.0 + minutes),
                "used_seconds": 36.0 * minutes / (1.0 + minutes), "objective": 3000.0, "search_seconds": minutes,
            }
            for minutes in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0)
        ]  # fmt: skip
    return {"signature": {}, "n_clips": 2, "lines": lines}


def write_page(path, texts: dict[str, str], failed=(), ablation: page.Ablation | None = None):
    """A report of packed clips, such as the command writes."""
    content = page.Content(
        manifest(texts, failed), None, [], [], dict.fromkeys(failed, "it broke"), ablation, texts, join_scale=28.0
    )
    page.write(path, content, load_config())
    return path

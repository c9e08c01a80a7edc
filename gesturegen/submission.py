"""What a run leaves behind: BVH files, traces that explain every frame, the manifest, and the check of them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from gesturegen import __version__, files
from gesturegen.clips import Speech
from gesturegen.config import Config
from gesturegen.errors import DataError
from gesturegen.graph.motion_graph import MotionGraph
from gesturegen.keynodes import KeyNodes
from gesturegen.motion import bvh
from gesturegen.motion.skeleton import Skeleton
from gesturegen.search.path import Path as SearchPath
from gesturegen.search.path import Piece, resampled_indices


def make_trace(
    path: SearchPath, graph: MotionGraph, graph_name: str, speech: Speech, key_nodes: KeyNodes, config: Config
) -> dict:
    """Everything needed to explain a clip's frames (README, file formats)."""
    pieces = path.tracks[0].pieces
    stuck = path.failure
    return {
        "clip": speech.name,
        "method": config.method,
        "search": config.search,
        "seed": config.seed,
        "graph": graph_name,
        "references": [
            {"clip": name, "start_node": int(start)}
            for name, start in zip(graph.clip_names, graph.clip_starts, strict=True)
        ],
        "fps": graph.fps,
        "n_frames": speech.n_frames,
        "version": __version__,
        "config_hash": config.signature(),
        "key_nodes": [
            {"frame": int(frame), "kind": str(kind), "keyword": str(keyword)}
            for frame, kind, keyword in zip(key_nodes.frames, key_nodes.kinds, key_nodes.keywords, strict=True)
        ],
        "pieces": [_describe_piece(piece) for piece in pieces],
        "joins": _describe_joins(pieces, graph, config),
        "failure": stuck
        and {
            "start_frame": stuck.start_frame,
            "end_frame": stuck.end_frame,
            "end_kind": stuck.end_kind,
            "keyword": stuck.keyword,
        },
    }


def _describe_piece(piece: Piece) -> dict:
    return {
        "start_frame": piece.target.start_frame,
        "end_frame": piece.target.end_frame,
        "target_length": piece.target.length,
        "end_kind": piece.target.end_kind,
        "keyword": piece.target.keyword,
        "nodes": piece.nodes.tolist(),
        "cost": piece.cost,
        "retries": piece.retries,
        "fallback": piece.fallback,
    }


def _describe_joins(pieces: Sequence[Piece], graph: MotionGraph, config: Config) -> list[dict]:
    """A join's distance is from the left side's natural successor to the right side's first node."""
    lefts = np.array([piece.nodes[-1] for piece in pieces[:-1]], dtype=int)
    rights = np.array([piece.nodes[0] for piece in pieces[1:]], dtype=int)
    distances = graph.distances(graph.successors[lefts], rights, config.continuity)
    return [
        {
            "frame": piece.target.start_frame,
            "from_node": int(left),
            "to_node": int(right),
            "distance": float(distance),
            "natural": bool(right == graph.successors[left]),
        }
        for piece, left, right, distance in zip(pieces[1:], lefts, rights, distances, strict=True)
    ]


def format_trace(trace: Mapping) -> str:
    """JSON with one line for each piece, join and key node, so that a person can read it too."""
    lines = []
    for key, value in trace.items():
        if isinstance(value, list) and value:
            rows = ",\n  ".join(json.dumps(row, ensure_ascii=False) for row in value)
            lines.append(f" {json.dumps(key)}: [\n  {rows}\n ]")
        else:
            lines.append(f" {json.dumps(key)}: {json.dumps(value, ensure_ascii=False)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def shown_nodes(trace: Mapping) -> np.ndarray:
    """The graph node nearest to what each output frame shows `[shape=(n_frames,)]`."""
    return np.concatenate(
        [
            np.array(piece["nodes"])[
                np.round(resampled_indices(len(piece["nodes"]), piece["target_length"])).astype(int)
            ]
            for piece in trace["pieces"]
        ]
    )


def manifest(results: Iterable[Mapping], config: Config, folder: Path) -> dict:
    """What was run, on what, with which figures and file hashes; the same for the same inputs.

    results : one row per test clip, of `clip_row`, or with an error in place of figures
    """
    rows = []
    for row in sorted(results, key=lambda row: row["clip"]):
        names = [f"{row['clip']}.bvh", f"{row['clip']}.trace.json"]
        present = {name: files.sha256(folder / name) for name in names if (folder / name).is_file()}
        rows.append({**row, "files": present})
    settings = json.loads(config.model_dump_json(by_alias=True, exclude={"paths"}))
    return {
        "gesturegen": __version__,
        "method": config.method,
        "search": config.search,
        "seed": config.seed,
        "config_hash": config.signature(),
        "n_clips": len(rows),
        "n_failed": sum(row.get("error") is not None for row in rows),
        "clips": rows,
        "config": settings,
    }


def clip_row(trace: Mapping) -> dict:
    """The figures of one clip for the manifest and the summary."""
    fallbacks: dict[str, int] = {}
    for piece in trace["pieces"]:
        if piece["fallback"]:
            fallbacks[piece["fallback"]] = fallbacks.get(piece["fallback"], 0) + 1
    stuck = trace["failure"]
    return {
        "clip": trace["clip"],
        "references": [reference["clip"] for reference in trace["references"]],
        "graph": trace["graph"],
        "n_frames": trace["n_frames"],
        "pieces": len(trace["pieces"]),
        "hard_joins": sum(not join["natural"] for join in trace["joins"]),
        "retries": sum(piece["retries"] for piece in trace["pieces"]),
        "fallbacks": dict(sorted(fallbacks.items())),
        "stuck": stuck is not None,
        "error": stuck and describe_failure(stuck, trace["fps"]),
    }


def describe_failure(stuck: Mapping, fps: float) -> str:
    what = f"keyword {stuck['keyword']!r}" if stuck["keyword"] else f"{stuck['end_kind']} node"
    seconds = stuck["start_frame"] / fps, stuck["end_frame"] / fps
    return (
        f"no path for the piece from {seconds[0]:.2f} to {seconds[1]:.2f} s that ends at a {what}; "
        "set termination.fallbacks=true or give longer references"
    )


def check_motion(path: Path, skeleton: Skeleton, n_frames: int, fps: float) -> list[str]:
    """What is wrong with a BVH file as a challenge submission, one line each; empty when it is valid.

    Raises nothing: a file that cannot be read is one of the problems.
    """
    if not path.is_file():
        return [f"{path}: missing"]
    try:
        motion = bvh.read(path)
    except DataError as error:
        return [str(error)]
    problems = []
    difference = motion.skeleton.difference(skeleton)
    if difference:
        problems.append(f"{path}: not the reference's skeleton: {difference}")
    if motion.n_frames != n_frames:
        problems.append(f"{path}: {motion.n_frames} frames, the speech has {n_frames}")
    if motion.fps != fps:
        problems.append(f"{path}: {motion.fps:g} fps, expected {fps:g}")
    return problems

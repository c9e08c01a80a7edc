"""Check that a run of GestureMaster keeps its promises, on every clip that it wrote, judged by its files alone.

    python scripts/check_gestures.py WORK [MORE...]

Of every body: the pieces cover all frames, each shows one gesture clip of the stored database, whole; what gives way
is said as its `fallback`, the gravest; no clip follows itself or its mirrored copy without its price; the costs add up
to the objective. Prints one line per broken promise; exit code 1 when there is one.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from gesturegen import files
from gesturegen.errors import GesturegenError
from gesturegen.methods import libraries
from gesturegen.methods.gesture_master import database
from gesturegen.motion import bvh

ROUNDING = 1e-9
BODIES = ("upper", "lower")


def broken(work: Path) -> Iterator[str]:
    manifest = files.read_json(work / "reenact" / "manifest.json")
    if manifest["method"] != "gesture_master" or not manifest["clips"]:
        yield f"{work}: no clip of method gesture_master, but {manifest['method']}, {len(manifest['clips'])} clips"
        return
    for row in manifest["clips"]:
        if row["error"]:
            yield f"{work}: {row['clip']}: {row['error']}"
            continue
        trace = files.read_json(work / "reenact" / f"{row['clip']}.trace.json")
        stored = libraries.read(work / "graphs" / f"{trace['graph']}.npz")
        motion = bvh.read(work / "reenact" / f"{row['clip']}.bvh")
        found = list(_of_trace(trace, stored, manifest["config"]["gesture_master"]))
        if motion.n_frames != trace["n_frames"]:
            found.append(f"its BVH has {motion.n_frames} frames, its trace {trace['n_frames']}")
        yield from (f"{work}: {row['clip']}: {what}" for what in found)


def _of_trace(trace: Mapping, stored: database.GestureDatabase, settings: Mapping) -> Iterator[str]:
    tracks = {"upper": trace["pieces"]} | {_track_name(track, stored): track["pieces"] for track in trace["tracks"]}
    if not {*BODIES} <= tracks.keys() <= {*BODIES, "fingers"} or len(tracks) != 1 + len(trace["tracks"]):
        yield f"its tracks move {sorted(map(str, tracks))}"
        return
    shown = {}
    for name, pieces in tracks.items():
        ends = [0, *(piece["end_frame"] for piece in pieces)]
        if ends != [*(piece["start_frame"] for piece in pieces), trace["n_frames"]]:
            yield f"{name}: its pieces do not cover frames 0 to {trace['n_frames']}"
        shown[name] = [_clip(piece["nodes"], stored) for piece in pieces]
        for number, clip in enumerate(shown[name]):
            if clip is None:
                yield f"{name}: piece {number}: its nodes are no gesture clip of the database"
        if None in shown[name]:
            return
    for body in BODIES:
        for what in _of_body(body, tracks[body], shown[body], stored, settings):
            yield f"{body}: {what}"
        for what in _of_objective(tracks[body], trace["objective"][body]):
            yield f"{body}: {what}"
    lent = stored.finger_sources[shown["upper"]].tolist()
    if lent != shown.get("fingers", shown["upper"]):
        yield "fingers: not those that the database lends to the clips of the upper body"


def _track_name(track: Mapping, stored: database.GestureDatabase) -> str | None:
    joints = {"lower": stored.lower_names, "fingers": stored.finger_names}
    return next((name for name, names in joints.items() if track["joints"] == names.tolist()), None)


def _clip(nodes: list[int], stored: database.GestureDatabase) -> int | None:
    """Find the number of the gesture clip of exactly these nodes."""
    if not nodes or nodes != list(range(nodes[0], nodes[-1] + 1)):
        return None
    same = np.flatnonzero((stored.starts == nodes[0]) & (stored.stops == nodes[-1] + 1))
    return int(same[0]) if len(same) == 1 else None


def _of_body(
    body: str, pieces: list[Mapping], clips: list[int], stored: database.GestureDatabase, settings: Mapping
) -> Iterator[str]:
    own, befores = settings[body], [None, *clips]
    for number, (piece, clip, before) in enumerate(zip(pieces, clips, befores, strict=False)):
        gave_way = []
        if body == "upper" and (piece["end_kind"] == "rest") != stored.rests[clip]:
            gave_way.append("kind")
        edge = None if before is None else _edge(stored, body, before, clip)
        if before is not None and edge is None:
            gave_way.append("edge")
        if _is_outside(piece, settings["time_scale"]):
            gave_way.append("scale")
        if piece["fallback"] != (gave_way[0] if gave_way else None):
            yield f"piece {number}: its fallback is {piece['fallback']}, what gave way is {gave_way or 'nothing'}"
        prices = {
            "transition": 0.0 if before is None else own["lambda_4"] * (own["zeta"] if edge is None else edge),
            "reuse": settings["lambda_reuse"] * (before is not None and clip in (before, stored.twins[before])),
            "kind": settings["lambda_kind"] * ("kind" in gave_way),
            "scale": _scale_price(piece, settings["time_scale"]),
        }
        for term, price in prices.items():
            if not _equal(piece["costs"][term], price):
                yield f"piece {number}: {term} costs {piece['costs'][term]}, not {price}"


def _edge(stored: database.GestureDatabase, body: str, before: int, clip: int) -> float | None:
    """Look up what the transition costs; None where it is no edge."""
    indptr, sources, costs = (getattr(stored, f"{body}_{key}") for key in ("indptr", "sources", "costs"))
    into = slice(indptr[clip], indptr[clip + 1])
    place = np.flatnonzero(sources[into] == before)
    return float(costs[into][place[0]]) if len(place) else None


def _limits(piece: Mapping, settings: Mapping) -> tuple[float, float]:
    rest = piece["end_kind"] == "rest"
    return (settings["rest_min"], settings["rest_max"]) if rest else (settings["min"], settings["max"])


def _is_outside(piece: Mapping, settings: Mapping) -> bool:
    low, high = _limits(piece, settings)
    return not low <= piece["target_length"] / len(piece["nodes"]) <= high


def _scale_price(piece: Mapping, settings: Mapping) -> float:
    low, high = _limits(piece, settings)
    scale = piece["target_length"] / len(piece["nodes"])
    outside = max(math.log(scale / high), math.log(low / scale), 0.0)
    return settings["lambda_scale"] * abs(math.log(scale)) + settings["lambda_outside"] * outside


def _of_objective(pieces: list[Mapping], objective: Mapping) -> Iterator[str]:
    """Check that a piece costs the sum of its terms, and the objective has the sums of all pieces by term."""
    for number, piece in enumerate(pieces):
        if not _equal(piece["cost"], sum(piece["costs"].values())):
            yield f"piece {number}: its costs sum up to {sum(piece['costs'].values())}, not {piece['cost']}"
    sums = {term: sum(piece["costs"][term] for piece in pieces) for term in pieces[0]["costs"]}
    sums["total"] = sum(piece["cost"] for piece in pieces)
    for term in sorted(sums.keys() ^ objective.keys()):
        yield f"objective: {term} is not in the objective and the pieces alike"
    for term in sorted(sums.keys() & objective.keys()):
        if not _equal(sums[term], objective[term]):
            yield f"objective: the pieces cost {sums[term]} of {term}, the objective says {objective[term]}"


def _equal(value: float, other: float) -> bool:
    return math.isclose(value, other, rel_tol=ROUNDING, abs_tol=ROUNDING)


def main(*works: str) -> int:
    found = []
    for work in works:
        try:
            found += broken(Path(work))
        except (GesturegenError, OSError, KeyError, TypeError) as error:
            found.append(f"{work}: {type(error).__name__}: {error}")
    for line in found:
        print(f"BROKEN {line}")
    print(f"{len(found)} promises broken")
    return int(bool(found) or not works)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

"""Check what a run wrote: every output there, valid, whole, and as the manifest says.

    python scripts/check_run.py WORK TESTS_FOLDER REFERENCES_FOLDER

The frame counts are counted from the audio files and the hierarchy from a reference BVH file, not from
anything that gesturegen stored. Prints one line per problem; exits with 1 when there is one.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path

import soundfile

from gesturegen import files, submission
from gesturegen.data import recordings
from gesturegen.errors import GesturegenError
from gesturegen.motion import bvh

END_KINDS = {
    "beam": ("onset", "keyword", "break"),
    "global": ("join", "break"),
    "viterbi": ("clip", "rest"),
    "nearest": ("step",),
}
FALLBACKS = {
    "beam": ("keyword", "discard", "repeat"),
    "global": (),
    "viterbi": ("kind", "edge", "scale"),
    "nearest": (),
}
ROUNDING = 1e-9


def problems(work: Path, tests: Path, references: Path) -> list[str]:
    found = []
    manifest = json.loads((work / "reenact" / "manifest.json").read_text())
    speeches = {r.name: r.audio_path for r in recordings.list_recordings(tests) if r.audio_path}
    skeletons = {
        r.name: bvh.read(r.motion_path).skeleton for r in recordings.list_recordings(references) if r.motion_path
    }
    rows = {row["clip"]: row for row in manifest["clips"]}
    found += [f"{name}: not in the manifest" for name in sorted(speeches.keys() - rows.keys())]
    for name, row in rows.items():
        if row["error"]:
            found.append(f"{name}: {row['error']}")
            continue
        info = soundfile.info(speeches[name])
        path = work / "reenact" / f"{name}.bvh"
        frames = round(info.frames / info.samplerate * 30)
        found += submission.check_motion(path, [skeletons[row["references"][0]]], frames, 30.0)[0]
        for file, digest in row["files"].items():
            if files.sha256(work / "reenact" / file) != digest:
                found.append(f"{file}: not the file of the manifest")
        found += _check_trace(work / "reenact" / f"{name}.trace.json", frames)
    for name in ("metrics.csv", "summary.json"):
        if not (work / "evaluate" / name).is_file():
            found.append(f"evaluate/{name}: missing")
    return found


def _check_trace(path: Path, frames: int) -> list[str]:
    """Check that the pieces of a trace cover every frame once, end as the search lets them, and cost what they say."""
    trace = json.loads(path.read_text())
    found = []
    ends = [0, *(piece["end_frame"] for piece in trace["pieces"])]
    starts = [*(piece["start_frame"] for piece in trace["pieces"]), frames]
    if ends != starts:
        found.append(f"{path}: its pieces do not cover frames 0 to {frames}")
    if any(not 0 <= start < end <= frames for start, end in trace["pauses"]):
        found.append(f"{path}: a pause is not within frames 0 to {frames}")
    for number, piece in enumerate(trace["pieces"]):
        found += [f"{path}: piece {number}: {what}" for what in _check_piece(piece, trace["search"])]
    if (trace["objective"] is None) != (trace["search"] in ("beam", "nearest")):
        found.append(f"{path}: its objective does not go with search {trace['search']}")
    elif trace["objective"] is not None:
        found += [f"{path}: {what}" for what in _check_objective(trace)]
    return found


def _check_piece(piece: dict, search: str) -> Iterator[str]:
    if piece["end_kind"] not in END_KINDS[search]:
        yield f"end_kind {piece['end_kind']}"
    if piece["fallback"] not in (None, *FALLBACKS[search]):
        yield f"fallback {piece['fallback']}"
    if not piece["nodes"]:
        yield "no nodes"
    if (piece["costs"] is None) != (search == "beam"):
        yield f"its costs do not go with search {search}"
    elif (
        piece["costs"] is not None
        and search != "nearest"
        and not math.isclose(piece["cost"], sum(piece["costs"].values()), rel_tol=ROUNDING, abs_tol=ROUNDING)
    ):
        yield f"its costs sum up to {sum(piece['costs'].values())}, not {piece['cost']}"


def _check_objective(trace: dict) -> Iterator[str]:
    """Check that both objectives are sums of their terms, and the final one is what the pieces cost."""
    for name, terms in trace["objective"].items():
        total = sum(value for term, value in terms.items() if term != "total")
        if not math.isclose(terms["total"], total, rel_tol=ROUNDING, abs_tol=ROUNDING):
            yield f"objective {name}: its terms sum up to {total}, not {terms['total']}"
    final = trace["objective"]["upper" if trace["search"] == "viterbi" else "final"]
    pieces = sum(piece["cost"] for piece in trace["pieces"])
    if not math.isclose(final["total"], pieces, rel_tol=ROUNDING, abs_tol=ROUNDING):
        yield f"the pieces cost {pieces}, the objective says {final['total']}"


def main() -> None:
    try:
        found = problems(*map(Path, sys.argv[1:4]))
    except (GesturegenError, OSError, KeyError) as error:
        found = [f"{type(error).__name__}: {error}"]
    for line in found:
        print(f"problem: {line}")
    print(f"{sys.argv[1]}: {len(found)} problems")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()

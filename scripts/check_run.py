"""Check what a run wrote: every output there, valid, whole, and as the manifest says.

    python scripts/check_run.py WORK TESTS_FOLDER REFERENCES_FOLDER

The frame counts are counted from the audio files and the hierarchy from a reference BVH file, not from
anything that gesturegen stored. Prints one line per problem; exits with 1 when there is one.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import soundfile

from gesturegen import files, recordings, submission
from gesturegen.errors import GesturegenError
from gesturegen.motion import bvh


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
    """The pieces of a trace cover every output frame once."""
    trace = json.loads(path.read_text())
    ends = [0, *(piece["end_frame"] for piece in trace["pieces"])]
    starts = [*(piece["start_frame"] for piece in trace["pieces"]), frames]
    return [] if ends == starts else [f"{path}: its pieces do not cover frames 0 to {frames}"]


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

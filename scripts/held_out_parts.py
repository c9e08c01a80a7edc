"""Cut recordings into parts, each to be gestured from the others, with its own true motion at hand.

    python scripts/held_out_parts.py DATA/trn/main-agent OUT --parts 3

OUT/part1 is a dataset in GENEA layout: its `val` split is the first part of every recording with its true motion, its
`trn` split what is left of them. `references.mode=all` then gestures a part from all that is left.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
import soundfile

from gesturegen.motion import bvh
from gesturegen.speech import audio


def cut(source: Path, name: str, start: float, end: float, target: Path, part: str) -> None:
    """Write the stretch [start, end) in seconds of one recording as a clip of its own."""
    for kind in ("bvh", "wav", "tsv"):
        (target / "main-agent" / kind).mkdir(parents=True, exist_ok=True)
    places = {kind: target / "main-agent" / kind / f"{part}.{kind}" for kind in ("bvh", "wav", "tsv")}
    motion = bvh.read(source / "bvh" / f"{name}.bvh")
    frames = np.arange(round(start * motion.fps), min(round(end * motion.fps), motion.n_frames))
    bvh.write(places["bvh"], motion.take(frames))
    samples, rate = audio.read_samples(source / "wav" / f"{name}.wav")
    soundfile.write(places["wav"], samples[round(start * rate) : round(end * rate)], rate, subtype="FLOAT")
    lines = []
    for line in (source / "tsv" / f"{name}.tsv").read_text(encoding="utf-8").splitlines():
        first, last, text = line.split("\t")
        if start <= (float(first) + float(last)) / 2 < end:
            lines.append(f"{float(first) - start:.3f}\t{float(last) - start:.3f}\t{text}\n")
    places["tsv"].write_text("".join(lines), encoding="utf-8")


def write_metadata(split: Path, names: list[str]) -> None:
    with (split / "metadata.csv").open("w", newline="") as file:
        csv.writer(file).writerows(
            [["prefix", "main-agent_id"], *([name.removesuffix("_main-agent"), "1"] for name in names)]
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--parts", type=int, default=3)
    given = parser.parse_args()
    names = sorted(path.stem for path in (given.source / "bvh").glob("*.bvh"))
    for part in range(given.parts):
        splits = {"val": [], "trn": []}
        for name in names:
            motion = bvh.read(given.source / "bvh" / f"{name}.bvh")
            samples, rate = audio.read_samples(given.source / "wav" / f"{name}.wav")
            seconds = min(motion.n_frames / motion.fps, len(samples) / rate)
            bounds = np.linspace(0.0, seconds, given.parts + 1)
            stem = name.removesuffix("_main-agent")
            pieces = [
                ("trn", 0.0, bounds[part], "a"),
                ("val", bounds[part], bounds[part + 1], "b"),
                ("trn", bounds[part + 1], seconds, "c"),
            ]
            for split, start, end, letter in pieces:
                if end - start > 1.0:
                    clip = f"{stem}{letter}_main-agent"
                    cut(given.source, name, start, end, given.out / f"part{part + 1}" / split, clip)
                    splits[split].append(clip)
        for split, clips in splits.items():
            write_metadata(given.out / f"part{part + 1}" / split, clips)


if __name__ == "__main__":
    main()

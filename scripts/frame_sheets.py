"""Draw sheets of frames and curves of wrist height of several motions of a clip, one above the other.

    python scripts/frame_sheets.py OUT CLIP beam=WORK_OF_BEAM best=WORK_OF_BEST truth=TRUTH.bvh

A motion is a work folder with a result of the clip or a BVH file. One sheet for each moment: where the last work folder
named has its joins of the largest distance, the largest jerk of a joint and the fastest hands in a pause, and a few at
random. Joins are marked in red, pauses of the speech are grey.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib
import numpy as np

from gesturegen import files
from gesturegen.motion import bvh, kinematics
from gesturegen.randomness import generator
from gesturegen.video.figure import make_figure

matplotlib.use("Agg")
from matplotlib import pyplot

FIGURES, STEP, REACH = 13, 7, 150  # figures in a row, frames from one to the next, frames of the curves to either side
ROOT, WRISTS = "b_root", ("b_l_wrist", "b_r_wrist")
COLOURS = ("dimgrey", "tab:blue", "tab:orange")


class Shown:
    """A named motion with the data of its trace."""

    def __init__(self, text: str, clip: str):
        self.label, _, place = text.partition("=")
        folder = Path(place, "reenact")
        self.motion = bvh.read(folder / f"{clip}.bvh" if folder.is_dir() else Path(place))
        self.trace = files.read_json(folder / f"{clip}.trace.json") if folder.is_dir() else {"joins": [], "pauses": []}
        self.joins = [join for join in self.trace["joins"] if not join["natural"]]
        self.figure = make_figure(self.motion, ROOT)
        names = self.motion.skeleton.names
        places = kinematics.joint_positions(self.motion, [names.index(name) for name in (*WRISTS, ROOT)])
        self.heights = places[:, :2, 1] - places[:, 2:, 1]
        self.wrists = places[:, :2] - places[:, 2:]


def moments(shown: Shown, count: int) -> dict[str, int]:
    """Select frames worth looking at, by reason."""
    found = {}
    for rank, join in enumerate(sorted(shown.joins, key=lambda join: -join["distance"])[:count]):
        found[f"join_{rank + 1}"] = join["frame"]
    jerk = np.linalg.norm(np.diff(kinematics.joint_positions(shown.motion), 3, axis=0), axis=-1).max(axis=1)
    found["jerk"] = int(jerk.argmax()) + 2
    pauses = np.zeros(len(shown.wrists), dtype=bool)
    for start, end in shown.trace["pauses"]:
        pauses[start:end] = True
    if pauses[1:].any():
        speed = np.linalg.norm(np.diff(shown.wrists, axis=0), axis=-1).max(axis=1)
        found["pause"] = int(np.where(pauses[1:], speed, -1.0).argmax()) + 1
    rng = generator(0, "sheets")
    return found | {f"random_{n + 1}": int(rng.integers(len(shown.wrists))) for n in range(count)}


def draw(rows: list[Shown], frame: int, title: str, target: Path) -> None:
    figure, axes = pyplot.subplots(2 * len(rows), 1, figsize=(17, 4.4 * len(rows)), height_ratios=[2.4, 1] * len(rows), constrained_layout=True)  # fmt: skip
    for row, figures, curves in zip(rows, axes[::2], axes[1::2], strict=True):
        last = row.motion.n_frames - 1
        for place, at in enumerate(frame + STEP * (np.arange(FIGURES) - FIGURES // 2)):
            if not 0 <= at <= last:
                continue
            points = row.figure.points[at] - [row.figure.targets[at][0], 0.0, 0.0]
            for (a, b), side in zip(row.figure.bones, row.figure.sides, strict=True):
                figures.plot(0.55 * place + points[[a, b], 0], points[[a, b], 1], color=COLOURS[side], linewidth=1.6)
            figures.text(0.55 * place, -0.08, f"{at / row.motion.fps:.2f}", fontsize=8, ha="center")
        for join in row.joins:
            figures.axvline(0.55 * ((join["frame"] - 0.5 - frame) / STEP + FIGURES // 2), color="red", linewidth=0.8)
            curves.axvline((join["frame"] - 0.5) / row.motion.fps, color="red", linewidth=0.8)
        figures.set(xlim=(-0.4, 0.55 * FIGURES), ylim=(-0.1, 1.1), title=f"{row.label}: {title}")
        figures.set_aspect("equal")
        figures.axis("off")
        around = np.arange(max(frame - REACH, 0), min(frame + REACH, last) + 1)
        for wrist in range(2):
            curves.plot(around / row.motion.fps, row.heights[around, wrist], color=COLOURS[wrist + 1])
        for start, end in rows[-1].trace["pauses"] or row.trace["pauses"]:
            curves.axvspan(start / row.motion.fps, end / row.motion.fps, color="0.85")
        curves.axvline(frame / row.motion.fps, color="black", linewidth=0.5)
        curves.set(xlim=(around[0] / row.motion.fps, around[-1] / row.motion.fps), ylabel="wrists, cm", ylim=(-20, 75))
    figure.savefig(target, dpi=60)
    pyplot.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("clip")
    parser.add_argument("motions", nargs="+", metavar="NAME=WORK or NAME=FILE.bvh")
    parser.add_argument("--count", type=int, default=2, help="joins, and moments at random")
    given = parser.parse_args()
    rows = [Shown(text, given.clip) for text in given.motions]
    judged = [row for row in rows if row.trace["joins"] or row.trace["pauses"]][-1]
    given.out.mkdir(parents=True, exist_ok=True)
    for why, frame in moments(judged, given.count).items():
        target = given.out / f"{given.clip}_{why}.png"
        draw(rows, frame, f"{why.replace('_', ' ')} of {judged.label}, {frame / judged.motion.fps:.2f} s", target)
        print(target)


if __name__ == "__main__":
    main()

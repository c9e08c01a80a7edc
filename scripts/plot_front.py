"""Run a grid of prices of the global search on held-out parts, and draw what each price buys.

    python scripts/plot_front.py PARTS WORK front.png [--config configs/best.yaml] [--grid grid.yaml]

PARTS is what `held_out_parts.py` wrote. A grid names settings: `{name: {global_search.lambda_beat: 5}}`; without a file
each price of the config goes down and up by itself. Joins a minute, alignment with onsets over chance, Fréchet distance
over a random stretch's and repeated frames are drawn against one another, each point with its setting's name, beside
the truth, a random stretch of the reference and a statue, and kept as a table in front.csv beside the picture.
"""

from __future__ import annotations

import argparse
import csv
from importlib import import_module
from pathlib import Path

import matplotlib
import numpy as np
import yaml

from gesturegen import files, viewer
from gesturegen.metrics import alignment
from gesturegen.pipeline import build_graphs, evaluate, preprocess, reenact
from gesturegen.pipeline.common import read_index
from gesturegen.settings.loading import load_config
from gesturegen.submission import read_trace

matplotlib.use("Agg")
from matplotlib import pyplot

# Of the prices of the config: one at a time, by these factors.
PRICES = ("join_price", "lambda_join", "lambda_beat", "lambda_onset", "lambda_state", "lambda_repeat")
FACTORS = (0.5, 2.0)
AXES = {
    "joins": "hard joins a minute",
    "a2m": "a2m over chance, z",
    "hands": "minima of the hands' speed over chance, z",
    "frechet": "Fréchet distance of velocities, random stretch = 1",
    "repeated": "frames shown before in the clip",
}
PANELS = (("joins", "a2m"), ("joins", "hands"), ("joins", "frechet"), ("a2m", "frechet"), ("joins", "repeated"), ("repeated", "frechet"))  # fmt: skip
TOTALS = {"joins": "hard_joins_per_minute", "frechet": "frechet_velocity_ratio", "repeated": "repeated_share"}


def settings_of(config, grid: Path | None) -> dict[str, dict[str, float]]:
    """List overrides by name; the config itself comes first."""
    if grid is not None:
        return {"best": {}} | yaml.safe_load(grid.read_text(encoding="utf-8"))
    prices = config.global_search
    return {"best": {}} | {
        f"{price.removeprefix('lambda_')} {getattr(prices, price) * factor:g}": {
            f"global_search.{price}": getattr(prices, price) * factor
        }
        for price in PRICES
        for factor in FACTORS
    }


def pooled(rows: list[dict], key: str) -> float:
    """Pool the z of several clips from what `evaluate` keeps of each."""
    clips = [(row[key], row[f"{key}_z"]) for row in rows if row.get(key) is not None and row.get(f"{key}_z")]
    return alignment.together([alignment.Surplus(value, value / z, z) for value, z in clips]).z


def figures(rows: list[dict]) -> dict[str, float]:
    found = {"a2m": pooled(rows, "a2m"), "hands": pooled(rows, "hands_beat")}
    return found | {name: float(np.mean([row.get(key, 0.0) for row in rows])) for name, key in TOTALS.items()}


def statue_ratio(config, name: str) -> float:
    """Compute the Fréchet distance of a motionless body to the truth, over that of random stretches."""
    measures = import_module("gesturegen.pipeline.evaluate")
    trace = read_trace(Path(config.paths.work, "reenact", f"{name}.trace.json"))
    truth = measures.locate_file(Path(read_index(config).tests[name].truth), config).curves
    return viewer.velocity_ratio(truth.held(truth.n_frames), truth, measures.recordings(config, trace), config, name)


def run(parts: list[Path], work: Path, given, settings: dict[str, float]) -> list[tuple]:
    """Gesture every part with the settings; return config and figures of each. What needs no search is done once."""
    found = []
    for part in parts:
        sets = [f"paths.data={part}", f"paths.work={work / part.name}", "data.test_split=val", "references.mode=all"]
        config = load_config(given.config, [*sets, *(f"{key}={value}" for key, value in settings.items())])
        stages = [(reenact, {}), (evaluate, {})]
        if not (work / part.name / "graphs").is_dir():
            stages = [(preprocess, {}), (build_graphs, {}), *stages]
        for stage, options in stages:
            summary = stage(config, 1, True, **options)
            if summary.outcome.errors or summary.outcome.bugs:
                raise SystemExit(f"{part}: {stage.__name__} failed: {summary.outcome}")
        found.append((config, files.read_json(work / part.name / "evaluate" / "summary.json")))
    return found


def draw(points: dict[str, dict[str, float]], marks: dict[str, dict[str, float]], target: Path) -> None:
    figure, axes = pyplot.subplots(2, 3, figsize=(18, 10.5), constrained_layout=True)
    for axis, (x, y) in zip(axes.flat, PANELS, strict=True):
        for name, row in points.items():
            best = name == "best"
            axis.plot(row[x], row[y], "o", color="tab:red" if best else "tab:blue", markersize=10 if best else 5)
            axis.annotate(name, (row[x], row[y]), xytext=(4, 3), textcoords="offset points", fontsize=8)
        for (name, row), mark in zip(marks.items(), "*sX", strict=False):
            if np.isfinite(row[x]) and np.isfinite(row[y]):
                axis.plot(row[x], row[y], mark, color="black", markersize=10, label=name)
        axis.set(xlabel=AXES[x], ylabel=AXES[y])
        if y == "frechet":
            axis.set_yscale("symlog", linthresh=1.5)  # a statue is far off
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    figure.savefig(target, dpi=80)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", type=Path)
    parser.add_argument("work", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--config", default="configs/best.yaml")
    parser.add_argument("--grid", type=Path)
    given = parser.parse_args()
    parts = sorted(part for part in given.parts.iterdir() if (part / "val").is_dir())
    points, marks = {}, {}
    for name, settings in settings_of(load_config(given.config, []), given.grid).items():
        done = run(parts, given.work, given, settings)
        points[name] = figures([row for _, summary in done for row in summary["clips"].values()])
        print(name, {key: round(value, 2) for key, value in points[name].items()}, flush=True)
        if marks:
            continue
        still = {"joins": 0.0, "repeated": 0.0}
        for mark, frechet in (("truth", 0.0), ("random stretch", 1.0)):
            rows = [summary["beside"][f"({mark})"] for _, summary in done]
            marks[mark] = figures(rows) | still | {"frechet": frechet}
        ratios = [statue_ratio(config, clip) for config, summary in done for clip in summary["clips"]]
        marks["statue"] = dict.fromkeys(("a2m", "hands"), np.nan) | still | {"frechet": float(np.mean(ratios))}
    with given.picture.with_suffix(".csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([["setting", *AXES]] + [[name, *(row[key] for key in AXES)] for name, row in (points | marks).items()])  # fmt: skip
    draw(points, marks, given.picture)


if __name__ == "__main__":
    main()

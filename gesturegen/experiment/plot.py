"""The bar plot of an ablation: a panel per figure, a bar per setup, whiskers for the spread over seeds."""

from __future__ import annotations

import math
from typing import BinaryIO

from gesturegen.experiment.figures import Result
from gesturegen.experiment.presets import PAPER_CLIPS

# Those that a picture helps with; the rest are in the tables.
_PANELS = (
    "syn", "bc_distance", "bc_kernel", "div", "failure",
    "held_share", "repeated_share", "retries", "pieces", "hard_joins_per_minute",
)  # fmt: skip
_BAR, _FULL_BAR, _PAPER = "#9db4c8", "#1f5a8a", "#c0392b"


def draw(result: Result, file: BinaryIO) -> None:
    """Write a PNG; the same result gives the same bytes. It needs matplotlib."""
    # A Figure of its own needs no display and leaves no state, unlike pyplot.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure(figsize=(15, 1.8 + 0.7 * len(result.setups)), layout="constrained")
    FigureCanvasAgg(figure)
    headings = {measure.key: measure.heading for measure in result.columns}
    for number, (axes, key) in enumerate(zip(figure.subplots(2, 5).flat, _PANELS, strict=True)):
        _panel(axes, result, key)
        axes.set_title(headings[key] + (f" of {result.n_clips}" if key == "failure" else ""), fontsize=9)
        if number % 5:
            axes.set_yticklabels([])
    dot = Line2D([], [], color=_PAPER, marker="D", linestyle="none", label="the paper's Table 2")
    figure.legend(handles=[dot], loc="outside lower right", fontsize=8, frameon=False)
    seeds = ", ".join(map(str, result.signature["seeds"]))
    caption = (
        f"gesturegen {result.signature['version']}, seeds {seeds}; below each name the hash of its config; "
        "whiskers: standard deviation over seeds"
    )
    figure.text(0.01, 0.01, caption, fontsize=7)
    # Without the name of the software, which matplotlib adds, no byte depends on its version alone.
    figure.savefig(file, format="png", dpi=110, metadata={"Software": None})


def _panel(axes, result: Result, key: str) -> None:
    names = list(result.setups)
    means = [result.setups[name].mean[key] for name in names]
    spreads = [result.setups[name].spread[key] for name in names]
    places = range(len(names))
    axes.barh(
        places,
        [0.0 if math.isnan(mean) else mean for mean in means],
        xerr=[0.0 if math.isnan(spread) else spread for spread in spreads],
        color=[_FULL_BAR if name == "full" else _BAR for name in names],
        error_kw={"elinewidth": 1, "capsize": 2},
    )
    for place, name in enumerate(names):
        printed = result.preset.printed.get(name, {}).get(key, math.nan)
        if math.isnan(means[place]):
            axes.text(0, place, " -", va="center", fontsize=8)
        if not math.isnan(printed):
            # The share of clips that failed, on our number of clips.
            printed *= result.n_clips / PAPER_CLIPS if key == "failure" else 1.0
            axes.plot([printed], [place], marker="D", color=_PAPER, markersize=4, linestyle="none", clip_on=False)
    hashes = result.signature["config_hashes"]
    axes.set_yticks(list(places), [f"{name}\n{hashes[name]}" for name in names], fontsize=8)
    axes.tick_params(axis="x", labelsize=7)
    axes.invert_yaxis()
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)

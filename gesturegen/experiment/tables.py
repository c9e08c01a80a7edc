"""The table of an experiment for the terminal, as Markdown, CSV and JSON. Every form ends in what produced it."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence

from gesturegen.experiment.figures import Result, Setup
from gesturegen.experiment.presets import PAPER_CLIPS
from gesturegen.metrics.measures import VIEWER_BLOCKS, Measure
from gesturegen.tables import align, beside_of, exact, format_figure, json_figures

# Which of a publication's columns stands beside which of ours, and its heading.
_BESIDE = {"syn": ("syn", "paper"), "bc_kernel": ("bc", "paper BC ↑"), "div": ("div", "paper"), "failure": ("failure", "paper")}  # fmt: skip


def format_terminal(result: Result) -> str:
    """Write aligned tables, one for each block of columns; printed figures stand beside ours."""
    blocks = [f"[{block}]\n{align(lines)}" for block, lines in _blocks(result).items()]
    return "\n\n".join([*blocks, result.preset.note, _signature_line(result)])


def format_markdown(result: Result) -> str:
    """Write the tables of an experiment as Markdown."""
    parts = [f"# {result.preset.title}"]
    for block, (header, *rows) in _blocks(result).items():
        lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
        parts.append("\n".join([f"## {block}", "", *("| " + " | ".join(line) + " |" for line in lines)]))
    return "\n\n".join([*parts, result.preset.note, f"`{_signature_line(result)}`"]) + "\n"


def format_csv(result: Result) -> str:
    """Write a row per setup for each seed, `mean`, `spread` and, where there is one, `paper`; each ends in what produced it."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    keys = [column.key for column in result.columns]
    printed = result.preset.printed
    beside_ours = ["paper_bc"] if printed else []
    writer.writerow(["setup", "seed", *keys, *beside_ours, "clips", "config_hash", "seeds", "version"])
    seeds, version, empty = (
        " ".join(map(str, result.signature["seeds"])),
        result.signature["version"],
        [""] * len(beside_ours),
    )
    for name, setup in result.setups.items():
        source = [result.n_clips, result.signature["config_hashes"][name], seeds, version]
        runs = {**{str(seed): run for seed, run in setup.by_seed.items()}, "mean": setup.mean, "spread": setup.spread}
        for label, figures in runs.items():
            writer.writerow([name, label, *(exact(figures[key]) for key in keys), *empty, *source])
        if name in printed:
            cells = [exact(printed[name].get(key)) for key in (*keys, "bc")]
            writer.writerow([name, "paper", *cells, PAPER_CLIPS, "", "", ""])
    for name, row in result.beside.items():
        cells = [exact(row.get(key)) for key in keys]
        writer.writerow([name, "", *cells, *empty, result.n_clips, "", seeds.split()[0], version])
    return text.getvalue()


def json_table(result: Result) -> dict:
    """Gather everything, down to the single clips; None where there is no figure."""
    return {
        "signature": result.signature,
        "n_clips": result.n_clips,
        "columns": [{"key": column.key, "heading": column.heading, "block": column.block} for column in result.columns],
        "setups": {name: _json_setup(setup, result.preset.printed.get(name)) for name, setup in result.setups.items()},
        "beside": {name: json_figures(row) for name, row in result.beside.items()},
        "clips": [_json_row(row) for row in result.clips],
    }


def _json_setup(setup: Setup, printed: Mapping[str, float] | None) -> dict:
    return {
        "mean": json_figures(setup.mean),
        "spread": json_figures(setup.spread),
        "seeds": {str(seed): json_figures(run) for seed, run in setup.by_seed.items()},
        "paper": json_figures(printed) | {"n_clips": PAPER_CLIPS} if printed else None,
    }


def _json_row(row: dict) -> dict:
    return {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in row.items()}


def _blocks(result: Result) -> dict[str, list[list[str]]]:
    """Collect heading and rows of each block of columns."""
    return {
        block: _cells(result, [column for column in result.columns if column.block == block])
        for block in dict.fromkeys(column.block for column in result.columns)
    }


def _cells(result: Result, columns: Sequence[Measure]) -> list[list[str]]:
    beside_ours = _BESIDE if result.preset.printed else {}
    rows = [["setup"]]
    for column in columns:
        rows[0] += [column.heading, *([beside_ours[column.key][1]] if column.key in beside_ours else [])]
    for name, setup in result.setups.items():
        row = [name]
        for column in columns:
            of = f" of {result.n_clips}" if column.key == "failure" else ""
            row.append(format_spread(setup.mean[column.key], setup.spread[column.key]) + of)
            if column.key in beside_ours:
                row.append(_printed(result.preset.printed.get(name, {}), beside_ours[column.key][0]))
        rows.append(row)
    return rows + _beside_cells(result.beside, columns)


def _beside_cells(beside: Mapping[str, Mapping], columns: Sequence[Measure]) -> list[list[str]]:
    """Format the rows of what a block's setups are to be compared with, where there are figures of it."""
    if not columns or columns[0].block not in VIEWER_BLOCKS:
        return []
    return [
        [name, *(format_figure(row.get(column.key)) for column in columns)]
        for name, row in beside_of(beside, columns).items()
    ]


def _printed(figures: Mapping[str, float], key: str) -> str:
    """Look up a figure of the paper's Table 2, as printed there."""
    value = figures.get(key, math.nan)
    if math.isnan(value):
        return "-"
    return f"{value} of {PAPER_CLIPS}" if key == "failure" else {"bc": f"{value:.6f}"}.get(key, f"{value:.5f}")


def format_spread(mean: float, spread: float) -> str:
    """Write `mean ± spread`, the spread to two significant digits; one figure alone where there is no spread."""
    if math.isnan(mean):
        return "-"
    if math.isnan(spread):
        return format_figure(mean)
    return f"{_brief(mean)} ± {format_figure(float(f'{spread:.2g}'))}"


def _brief(value: float) -> str:
    """Format a figure to four significant digits, whole ones in full."""
    return format_figure(value if abs(value) >= 1000 and value.is_integer() else float(f"{value:.4g}"))


def _signature_line(result: Result) -> str:
    hashes = "  ".join(f"{name} {digest}" for name, digest in result.signature["config_hashes"].items())
    seeds = ", ".join(map(str, result.signature["seeds"]))
    return f"config hashes: {hashes}  seeds: {seeds}  version: {result.signature['version']}"

"""The ablation's table for the terminal, as Markdown, CSV and JSON. Every form ends in what produced it."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence

from gesturegen.ablation.summary import BLOCKS, FIGURES, PAPER, PAPER_CLIPS, Result, Setup
from gesturegen.metrics.measures import VIEWER_BLOCKS, Measure
from gesturegen.tables import align, beside_of, exact, format_figure, json_figures

NOTE = (
    "mean ± standard deviation over seeds; counts are per seed, over all clips; a setup with failures is measured on "
    "the clips that have an output. The objective is the global search's, by the base config's prices for every setup. "
    "paper: Table 2 as printed, on 70 clips of GENEA 2023; its BC fits neither of ours."
)
# Which of Table 2's columns stands beside which of ours, and its heading.
_BESIDE = {"syn": ("syn", "paper"), "bc_kernel": ("bc", "paper BC ↑"), "div": ("div", "paper"), "failure": ("failure", "paper")}  # fmt: skip


def format_terminal(result: Result) -> str:
    """Aligned tables: Table 2 beside the paper's, then a table for each further block of figures."""
    blocks = {block: _cells(result, block) for block in BLOCKS}
    return "\n\n".join([*aligned_blocks(blocks), NOTE, _signature_line(result)])


def format_markdown(result: Result) -> str:
    blocks = {block: _cells(result, block) for block in BLOCKS}
    parts = ["# Ablation (§5.2, Table 2)", *markdown_blocks(blocks), NOTE, f"`{_signature_line(result)}`"]
    return "\n\n".join(parts) + "\n"


def aligned_blocks(blocks: Mapping[str, list[list[str]]]) -> list[str]:
    """Tables of cells as text for a terminal, by their titles; the first row of each is its heading."""
    return [f"[{block}]\n{align(lines)}" for block, lines in blocks.items()]


def markdown_blocks(blocks: Mapping[str, list[list[str]]]) -> list[str]:
    """The same as Markdown."""
    parts = []
    for block, (header, *rows) in blocks.items():
        lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
        parts.append("\n".join([f"## {block}", "", *("| " + " | ".join(line) + " |" for line in lines)]))
    return parts


def format_csv(result: Result) -> str:
    """Per setup a row for each seed, `mean`, `spread` and `paper`; each ends in what produced it."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    keys = [figure.key for figure in FIGURES]
    writer.writerow(["setup", "seed", *keys, "paper_bc", "clips", "config_hash", "seeds", "version"])
    seeds = " ".join(map(str, result.signature["seeds"]))
    for name, setup in result.setups.items():
        source = [result.signature["config_hashes"][name], seeds, result.signature["version"]]
        runs = {**{str(seed): run for seed, run in setup.by_seed.items()}, "mean": setup.mean, "spread": setup.spread}
        for label, figures in runs.items():
            writer.writerow([name, label, *(exact(figures[key]) for key in keys), "", result.n_clips, *source])
        if name in PAPER:
            printed = PAPER[name]
            cells = [exact(printed.get(key)) for key in keys]
            writer.writerow([name, "paper", *cells, exact(printed["bc"]), PAPER_CLIPS, "", "", ""])
    for name, row in result.beside.items():
        cells = [exact(row.get(key)) for key in keys]
        writer.writerow([name, "", *cells, "", result.n_clips, "", seeds.split()[0], result.signature["version"]])
    return text.getvalue()


def json_table(result: Result) -> dict:
    """Everything, down to the single clips; None where there is no figure."""
    return {
        "signature": result.signature,
        "n_clips": result.n_clips,
        "setups": {name: _json_setup(name, setup) for name, setup in result.setups.items()},
        "beside": {name: json_figures(row) for name, row in result.beside.items()},
        "clips": [_json_row(row) for row in result.clips],
    }


def _json_setup(name: str, setup: Setup) -> dict:
    return {
        "mean": json_figures(setup.mean),
        "spread": json_figures(setup.spread),
        "seeds": {str(seed): json_figures(run) for seed, run in setup.by_seed.items()},
        "paper": json_figures(PAPER[name]) | {"n_clips": PAPER_CLIPS} if name in PAPER else None,
    }


def _json_row(row: dict) -> dict:
    return {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in row.items()}


def _cells(result: Result, block: str) -> list[list[str]]:
    """Heading and rows of one block."""
    figures = [figure for figure in FIGURES if figure.block == block]
    header = ["setup"]
    for figure in figures:
        header += [figure.heading, *([_BESIDE[figure.key][1]] if figure.key in _BESIDE else [])]
    rows = [header]
    for name, setup in result.setups.items():
        row = [name]
        for figure in figures:
            of = f" of {result.n_clips}" if figure.key == "failure" else ""
            row.append(format_spread(setup.mean[figure.key], setup.spread[figure.key]) + of)
            if figure.key in _BESIDE:
                row.append(_printed(name, _BESIDE[figure.key][0]))
        rows.append(row)
    return rows + beside_cells(result.beside, figures)


def beside_cells(beside: Mapping[str, Mapping], columns: Sequence[Measure]) -> list[list[str]]:
    """Rows of what a block's setups are to be compared with, where there are figures of it."""
    if not columns or columns[0].block not in VIEWER_BLOCKS:
        return []
    return [
        [name, *(format_figure(row.get(column.key)) for column in columns)]
        for name, row in beside_of(beside, columns).items()
    ]


def _printed(name: str, key: str) -> str:
    """A figure of the paper's Table 2, as printed there."""
    value = PAPER.get(name, {}).get(key, math.nan)
    if math.isnan(value):
        return "-"
    return f"{value} of {PAPER_CLIPS}" if key == "failure" else {"bc": f"{value:.6f}"}.get(key, f"{value:.5f}")


def format_spread(mean: float, spread: float) -> str:
    """`mean ± spread`, the spread to two significant digits; one figure alone where there is no spread."""
    if math.isnan(mean):
        return "-"
    if math.isnan(spread):
        return format_figure(mean)
    return f"{_brief(mean)} ± {format_figure(float(f'{spread:.2g}'))}"


def _brief(value: float) -> str:
    """Four significant digits; whole figures in full."""
    return format_figure(value if abs(value) >= 1000 and value.is_integer() else float(f"{value:.4g}"))


def _signature_line(result: Result) -> str:
    hashes = "  ".join(f"{name} {digest}" for name, digest in result.signature["config_hashes"].items())
    seeds = ", ".join(map(str, result.signature["seeds"]))
    return f"config hashes: {hashes}  seeds: {seeds}  version: {result.signature['version']}"

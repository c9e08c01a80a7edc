"""Tables of figures: in the terminal, as CSV and as JSON values. NaN is `-`, in CSV an empty cell, in JSON null."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence

from gesturegen.metrics.measures import Measure

# What a terminal shows without folding a line.
WIDTH = 100
# What tells most about a run, in this order, in words of its own.
SUMMARY = {
    "failure": "clips that failed ↓", "syn": "Syn, cm a frame ↓", "bc_kernel": "BC kernel ↑",
    "hard_joins_per_minute": "hard joins a minute ↓", "stay_seconds": "mean stay, s",
    "again_share": "frames shown again within 10 s ↓", "still_share": "frames with still hands",
    "still_longest": "longest stillness of the hands, s", "a2m_z": "alignment with onsets (a2m), z",
    "hands_beat_z": "alignment of the hands' minima, z", "seam_auc": "joins found by a classifier, AUC ↓",
    "seam_auc_control": "the same frames in the recording, AUC",
    "frechet_velocity_ratio": "Fréchet of speeds, to the truth ↓ (random: 1)",
    "frechet_velocity_recording_ratio": "Fréchet of speeds, to recording ↓ (random: 1)",
    "foot_skate_ratio": "foot skate / reference's", "knee_snaps": "knee snaps a minute ↓",
    "pause_share": "pause frames shown from pauses ↑", "reference_share": "reference used",
}  # fmt: skip


def format_figure(value: float | int | None) -> str:
    """Five significant digits, whole numbers as they are, `-` where there is no figure."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if float(value).is_integer() and abs(value) < 1e6:
        return str(int(value))
    return f"{value:.5g}"


def format_blocks(
    rows: Mapping[str, Mapping], total: Mapping, columns: Sequence[Measure], beside: Mapping[str, Mapping]
) -> str:
    """One aligned table per block of measures: a line per clip, the total, and what stands beside it, where it does."""
    blocks = list(dict.fromkeys(measure.block for measure in columns))
    return "\n\n".join(
        f"[{block}]\n" + align(_cells(rows, total, [measure for measure in columns if measure.block == block], beside))
        for block in blocks
    )


def format_summary(total: Mapping, n_clips: int, columns: Sequence[Measure], beside: Mapping[str, Mapping]) -> str:
    """The figures that tell most over all clips, a line each, and beside them those of what stands beside the total."""
    known = {measure.key: measure for measure in columns}
    chosen = [known[key] for key in SUMMARY if format_figure(total.get(key)) != "-" and key in known]
    others = beside_of(beside, chosen)
    lines = [["over all clips", f"all {n_clips}", *others]]
    for measure in chosen:
        figures = [row.get(measure.key) for row in (total, *others.values())]
        lines.append([SUMMARY[measure.key], *(_rounded(value) for value in figures)])
    return align(lines)


def _rounded(value: float | int | None) -> str:
    return format_figure(value if value is None or isinstance(value, int) else float(f"{value:.3g}"))


def beside_of(beside: Mapping[str, Mapping], columns: Sequence[Measure]) -> dict[str, Mapping]:
    """Those rows beside a total that have a figure in any of the columns."""
    return {
        name: row
        for name, row in beside.items()
        if any(format_figure(row.get(measure.key)) != "-" for measure in columns)
    }


def _cells(
    rows: Mapping[str, Mapping], total: Mapping, columns: Sequence[Measure], beside: Mapping[str, Mapping]
) -> list[list[str]]:
    lines = [["clip", *(measure.heading for measure in columns)]]
    for name, row in [*rows.items(), (f"all {len(rows)}", total), *beside_of(beside, columns).items()]:
        lines.append([name, *(format_figure(row.get(measure.key)) for measure in columns)])
    return lines


def align(lines: Sequence[Sequence[str]]) -> str:
    """Cells as a table, its first row the headings; columns beyond the width of a terminal follow in a further table."""
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    groups: list[list[int]] = [[]]
    for k, width in enumerate(widths[1:], start=1):
        if groups[-1] and widths[0] + sum(widths[n] + 2 for n in groups[-1]) + width + 2 > WIDTH:
            groups.append([])
        groups[-1].append(k)
    tables = (
        "\n".join(
            "  ".join([line[0].ljust(widths[0]), *(line[k].rjust(widths[k]) for k in group)]).rstrip() for line in lines
        )
        for group in groups
    )
    return "\n\n".join(tables)


def format_csv(
    rows: Mapping[str, Mapping], total: Mapping, columns: Sequence[Measure], signature: Mapping,
    beside: Mapping[str, Mapping],
) -> str:  # fmt: skip
    """A row per clip, one named `all`, and what stands beside it, each ending in what produced it."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["clip", *(measure.key for measure in columns), *signature])
    for name, row in [*rows.items(), ("all", total), *beside.items()]:
        found = [row.get(measure.key) for measure in columns]
        writer.writerow([name, *map(exact, found), *signature.values()])
    return text.getvalue()


def exact(value: float | int | None) -> str:
    """A figure as CSV holds it: all of its digits, an empty cell where there is none."""
    return "" if format_figure(value) == "-" else repr(value)


def json_figures(row: Mapping[str, float]) -> dict[str, float | None]:
    return {key: None if format_figure(value) == "-" else value for key, value in row.items()}


def from_json(row: Mapping[str, float | None]) -> dict[str, float]:
    """The figures that `json_figures` wrote."""
    return {key: math.nan if value is None else value for key, value in row.items()}

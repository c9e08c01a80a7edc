"""Tables of figures: in the terminal, as CSV and as JSON values. NaN is `-`, in JSON null."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence

from gesturegen.evaluation import Measure


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
        f"[{block}]\n" + _align(rows, total, [measure for measure in columns if measure.block == block], beside)
        for block in blocks
    )


def beside_of(beside: Mapping[str, Mapping], columns: Sequence[Measure]) -> dict[str, Mapping]:
    """Those rows beside a total that have a figure in any of the columns."""
    return {
        name: row
        for name, row in beside.items()
        if any(format_figure(row.get(measure.key)) != "-" for measure in columns)
    }


def _align(
    rows: Mapping[str, Mapping], total: Mapping, columns: Sequence[Measure], beside: Mapping[str, Mapping]
) -> str:
    lines = [["clip", *(measure.heading for measure in columns)]]
    for name, row in [*rows.items(), (f"all {len(rows)}", total), *beside_of(beside, columns).items()]:
        lines.append([name, *(format_figure(row.get(measure.key)) for measure in columns)])
    widths = [max(len(line[k]) for line in lines) for k in range(len(columns) + 1)]
    return "\n".join(
        "  ".join(
            [line[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(line[1:], widths[1:], strict=True))]
        )
        for line in lines
    )


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
        figures = ["-" if format_figure(value) == "-" else repr(value) for value in found]
        writer.writerow([name, *figures, *signature.values()])
    return text.getvalue()


def json_figures(row: Mapping[str, float]) -> dict[str, float | None]:
    return {key: None if format_figure(value) == "-" else value for key, value in row.items()}


def from_json(row: Mapping[str, float | None]) -> dict[str, float]:
    """The figures that `json_figures` wrote."""
    return {key: math.nan if value is None else value for key, value in row.items()}

"""Plots for the report of the measures by length of the references: SVG text that follows the page's colours.

Its input is `ablation/reference_length.json`, which another version may have written: a point without a length
is left out, and so is a figure that is missing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape

from gesturegen.tables import format_figure

# Drawn 1 : 1 at about the width of a telephone; three side by side on a wide page.
_WIDTH, _HEIGHT = 360, 220
_LEFT, _RIGHT, _TOP, _BOTTOM = 46, 348, 10, 178
_MINUTES = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 120, 240, 600, 1200)
_TICKS = 4
_COLOURS = 4  # of lines, in report.css


@dataclass(frozen=True)
class _Panel:
    """One plot: its heading, the unit of a single value, and how to get it from a point."""

    heading: str
    unit: str
    value: Callable[[Mapping], object]


_PANELS = (
    _Panel("Join distance, cm per minute of output", " cm", lambda point: point.get("join_distance_per_minute")),
    _Panel(
        "Share of the reference that a clip shows, %", " %", lambda point: _times(100.0, point.get("reference_share"))
    ),
    _Panel("Reference that a clip shows, seconds", " s", lambda point: point.get("used_seconds")),
)
_COLUMNS = (
    ("join d cm/min ↓", "join_distance_per_minute"),
    ("join d mean cm", "join_distance_mean"),
    ("hard joins/min", "hard_joins_per_minute"),
    ("reference used", "reference_share"),
    ("used s", "used_seconds"),
    ("objective ↓", "objective"),
    ("search s", "search_seconds"),
)


def lines_of(results: object) -> dict[str, list[Mapping]]:
    """Read the points of each line, by length; none where the file is of another shape."""
    lines = results.get("lines") if isinstance(results, Mapping) else None
    found = {}
    for name, points in lines.items() if isinstance(lines, Mapping) else ():
        listed = points if isinstance(points, Sequence) else ()
        kept = [p for p in listed if isinstance(p, Mapping) and (_number(p.get("reference_seconds")) or 0.0) > 0.0]
        if kept:
            found[str(name)] = sorted(kept, key=lambda point: point["reference_seconds"])
    return found


def plots(lines: Mapping[str, Sequence[Mapping]]) -> str:
    """Draw a legend and an SVG figure for each panel."""
    legend = "".join(
        f'<span><svg class="sample" viewBox="0 0 40 12" aria-hidden="true"><path class="line-{k % _COLOURS}" '
        f'd="M2 6H38"/>{_marker(k, 20, 6)}</svg> {escape(name)}</span>'
        for k, name in enumerate(lines)
    )
    figures = "".join(
        f"<figure><figcaption>{escape(panel.heading)}</figcaption>{_plot(panel, lines)}</figure>" for panel in _PANELS
    )
    return f'<p class="legend plot-legend">{legend}</p><div class="plots">{figures}</div>'


def table_rows(lines: Mapping[str, Sequence[Mapping]]) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """Return the headings of the table, and for every point its setup and its cells."""
    rows = []
    for name, points in lines.items():
        for point in points:
            cells = [format_figure(_number(point.get(key))) for _, key in _COLUMNS]
            rows.append((str(point.get("setup", name)), [format_figure(point["reference_seconds"] / 60.0), *cells]))
    return ["setup", "reference min", *(heading for heading, _ in _COLUMNS)], rows


def _plot(panel: _Panel, lines: Mapping[str, Sequence[Mapping]]) -> str:
    drawn = {
        name: [(p["reference_seconds"] / 60.0, value) for p in points if (value := _number(panel.value(p))) is not None]
        for name, points in lines.items()
    }
    everything = [point for points in drawn.values() for point in points]
    if not everything:
        return "<p>No figure.</p>"
    shortest, longest = min(x for x, _ in everything), max(x for x, _ in everything)
    shortest, longest = shortest / 1.15, longest * 1.15  # room beside the first and the last point
    top, step = _scale(max(y for _, y in everything))

    def across(minutes: float) -> float:
        return _LEFT + (_RIGHT - _LEFT) * math.log(minutes / shortest) / math.log(longest / shortest)

    def up(value: float) -> float:
        return _BOTTOM - (_BOTTOM - _TOP) * value / top

    parts = []
    for number in range(round(top / step) + 1):
        y = up(number * step)
        parts.append(f'<path class="grid" d="M{_LEFT} {y:.1f}H{_RIGHT}"/>')
        parts.append(f'<text class="y" x="{_LEFT - 6}" y="{y + 4:.1f}">{_tick(number * step)}</text>')
    for minutes in _MINUTES:
        if shortest <= minutes <= longest:
            x = across(minutes)
            parts.append(f'<path class="axis" d="M{x:.1f} {_BOTTOM}v5"/>')
            parts.append(f'<text class="x" x="{x:.1f}" y="{_BOTTOM + 18}">{minutes:g}</text>')
    parts.append(f'<path class="axis" d="M{_LEFT} {_BOTTOM}H{_RIGHT}"/>')
    middle = (_LEFT + _RIGHT) / 2
    parts.append(f'<text class="x" x="{middle:g}" y="{_HEIGHT - 6}">reference length, minutes (log)</text>')
    for k, (name, points) in enumerate(drawn.items()):
        places = [(across(x), up(y)) for x, y in points]
        path = "L".join(f"{x:.1f} {y:.1f}" for x, y in places)
        parts.append(f'<path class="line-{k % _COLOURS}" d="M{path}"/>' if path else "")
        for (x, y), (minutes, value) in zip(places, points, strict=True):
            told = f"{name}, {format_figure(minutes)} min: {format_figure(value)}{panel.unit}"
            parts.append(f"<g>{_marker(k, x, y)}<title>{escape(told)}</title></g>")
    told = "; ".join(_summary(name, points, panel.unit) for name, points in drawn.items() if points)
    label = escape(f"{panel.heading}, over reference length: {told}")
    return f'<svg class="plot" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{label}">{"".join(parts)}</svg>'


def _summary(name: str, points: Sequence[tuple[float, float]], unit: str) -> str:
    """Describe a line in words, for readers who cannot see the plot."""
    ends = [f"{format_figure(value)}{unit} at {format_figure(minutes)} min" for minutes, value in points]
    return f"{name} " + " to ".join(dict.fromkeys((ends[0], ends[-1])))


def _marker(line: int, x: float, y: float) -> str:
    """Draw the marker of a point; shapes differ by line, as not everybody sees the colours."""
    if line % 2:
        return f'<rect class="mark-{line % _COLOURS}" x="{x - 3.5:.1f}" y="{y - 3.5:.1f}" width="7" height="7"/>'
    return f'<circle class="mark-{line % _COLOURS}" cx="{x:.1f}" cy="{y:.1f}" r="4"/>'


def _scale(largest: float) -> tuple[float, float]:
    """Choose the upper end of an axis from 0, and the step of its ticks: 1, 2 or 5 times a power of ten."""
    if largest <= 0.0:
        return 1.0, 0.5
    rough = largest / _TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= rough * (1.0 - 1e-9))
    return step * math.ceil(largest / step - 1e-9), step


def _tick(value: float) -> str:
    return f"{value:.6g}"


def _times(factor: float, value: object) -> float | None:
    number = _number(value)
    return None if number is None else factor * number


def _number(value: object) -> float | None:
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not math.isfinite(value):
        return None
    return float(value)

"""The HTML page of the report: text, style, scripts and every clip in one file, and nothing from outside.

Clips lie in script tags of type `application/json`, which a browser neither runs nor decodes; the player
reads one when it is opened. A content security policy forbids the page every request.
"""

from __future__ import annotations

import base64
import hashlib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from itertools import islice
from pathlib import Path

from gesturegen import evaluation, files
from gesturegen.experiment.presets import ABLATION_COLUMNS
from gesturegen.experiment.tables import format_spread
from gesturegen.manifest import ClipRow, Manifest
from gesturegen.metrics.measures import VIEWER_BLOCKS
from gesturegen.report import lengths
from gesturegen.settings.models import Config
from gesturegen.stored.documents import Summary
from gesturegen.tables import beside_of, format_figure

_SCRIPTS = ("figure.js", "timeline.js", "player.js", "controls.js")
_NO_FIGURES = Summary(signature={}, total={}, clips={})


@dataclass(frozen=True)
class Ablation:
    """Results of `gesturegen ablate`: a PNG and the parsed JSON files, each None where there is none.

    lengths : of `reference_length.json`
    """

    plot: bytes | None
    results: object | None
    lengths: object | None = None


@dataclass(frozen=True)
class Content:
    """The content of a report.

    manifest : of the run; figures : of `evaluate`, None where this run has none; compared : labels of other runs
    notices : sentences for the top; failed : clip -> why it cannot be shown; clips : name -> inert JSON
    join_scale : the largest distance of a join, so that a colour means the same in every clip
    """

    manifest: Manifest
    figures: Summary | None
    compared: Sequence[str]
    notices: Sequence[str]
    failed: Mapping[str, str]
    ablation: Ablation | None
    clips: Mapping[str, str]
    join_scale: float


def write(path: Path, content: Content, config: Config) -> None:
    """Write the page; the same content gives the same bytes."""

    def fill(file) -> None:
        for part in parts(content, config):
            file.write(part.encode())

    files.write_bytes(path, fill)


def parts(content: Content, config: Config) -> Iterator[str]:
    """Yield the page in parts, to be written one after the other."""
    style = _asset("report.css")
    script = '(() => {\n"use strict";\n' + "\n".join(_asset(name) for name in _SCRIPTS) + "})();\n"
    policy = (
        f"default-src 'none'; script-src '{_digest(script)}'; style-src '{_digest(style)}'; "
        "img-src data:; media-src blob:; base-uri 'none'; form-action 'none'"
    )
    filled = {
        "policy": policy,
        "style": style,
        "script": script,
        "signature": _signature(content),
        "notices": "".join(f'<p class="notice">{_code(notice)}</p>' for notice in content.notices),
        "failed": _failed(content.failed),
        "summary": _summary(content, config),
        "viewer": _viewer(content, config),
        "ablation": _ablation(content.ablation),
        "options": "".join(f'<option value="{k}">{escape(name)}</option>' for k, name in enumerate(content.clips)),
        "empty": "" if content.clips else '<p class="notice">No clip of this run can be shown.</p>',
        "join_scale": f"{content.join_scale:.6g}",
        "control_headings": "".join(
            f'<th scope="col">{escape(heading)}</th>' for heading in evaluation.CONTROL_HEADINGS
        ),
        "hidden": "" if content.clips else " hidden",
    }
    # The first clip stands before the script, so that it can be watched while the others are still being read.
    before, script_part, after = _asset("report.html").split("{{clips}}")
    tags = (_data_tag(k, text) for k, text in enumerate(content.clips.values()))
    yield _fill(before, filled)
    yield from islice(tags, 1)
    yield _fill(script_part, filled)
    yield from tags
    yield _fill(after, filled)


def _data_tag(place: int, text: str) -> str:
    return f'<script type="application/json" id="clip-{place}">{text}</script>\n'


def _fill(template: str, filled: Mapping[str, str]) -> str:
    """Fill the placeholders of a template in one pass: inserted text is never searched for placeholders itself."""
    return re.sub(r"\{\{(\w+)\}\}", lambda place: filled[place[1]], template)


def _asset(name: str) -> str:
    return resources.files("gesturegen.report").joinpath(name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")


def _code(text: str) -> str:
    """Escape a text for HTML and set its `commands` as code."""
    return re.sub(r"`([^`]*)`", r"<code>\1</code>", escape(text))


def _signature(content: Content) -> str:
    manifest = content.manifest
    entries = {
        "method": manifest.method,
        "search": manifest.search,
        "seed": manifest.seed,
        "config": manifest.config_hash,
        "gesturegen": manifest.gesturegen,
        "clips": f"{len(content.clips)} shown, {len(content.failed)} failed",
    }
    if content.compared:
        entries["beside"] = ", ".join(content.compared)
    return "".join(f"<div><dt>{escape(key)}</dt><dd>{escape(str(value))}</dd></div>" for key, value in entries.items())


def _failed(failed: Mapping[str, str]) -> str:
    if not failed:
        return ""
    items = "".join(f"<li><b>{escape(name)}</b>: {_code(error)}</li>" for name, error in failed.items())
    return f'<section id="failed"><h2>Failed clips</h2><ul>{items}</ul></section>'


def _summary(content: Content, config: Config) -> str:
    """Build the table of clips and their total: what the manifest counts, then the figures of `evaluate`."""
    figures = content.figures or _NO_FIGURES
    columns = [
        measure
        for measure in evaluation.measures(config)
        if measure.block not in VIEWER_BLOCKS
        and any(row.get(measure.key) is not None for row in [*figures.clips.values(), figures.total])
    ]
    headings = ["clip", "seconds", "pieces", "hard joins", "retries", "fallbacks", *(m.heading for m in columns)]
    places = {name: k for k, name in enumerate(content.clips)}
    fps = content.manifest.fps
    body, rows = [], content.manifest.clips
    for row in rows:
        name = row.clip
        label = escape(name)
        if name in places:
            label = f'<button type="button" class="open" data-clip="{places[name]}">{label}</button>'
        own = figures.clips.get(name, {})
        body.append(_row(label, [*_counts(row, fps), *(format_figure(own.get(m.key)) for m in columns)]))
    listed = content.manifest.made
    total = [
        format_figure(round(sum(row.n_frames for row in listed) / fps, 2)),
        *(str(sum(getattr(row, key) for row in listed)) for key in ("pieces", "hard_joins", "retries")),
        str(sum(sum(row.fallbacks.values()) for row in listed)),
        *(format_figure(figures.total.get(m.key)) for m in columns),
    ]
    return _table(headings, body, _row(f"all {len(rows)}", total))


def _viewer(content: Content, config: Config) -> str:
    """Build a table for each block of the viewer's measures, with the figures that its total is compared with."""
    figures, html = content.figures or _NO_FIGURES, ""
    for block in VIEWER_BLOCKS:
        every = [*figures.clips.values(), figures.total]
        listed = [measure for measure in evaluation.measures(config) if measure.block == block]
        columns = [measure for measure in listed if any(row.get(measure.key) is not None for row in every)]
        if not columns:
            continue

        def cells(row: Mapping, columns=columns) -> list[str]:
            return [format_figure(row.get(measure.key)) for measure in columns]

        rows = [_row(escape(name), cells(row)) for name, row in figures.clips.items()]
        last = [_row(f"all {len(rows)}", cells(figures.total))] if figures.total else []
        last += [_row(escape(name), cells(row)) for name, row in beside_of(figures.beside, columns).items()]
        scroll = f'class="scroll" tabindex="0" role="region" aria-label="{escape(block)}"'
        table = _table(["clip", *(measure.heading for measure in columns)], rows, "".join(last))
        html += f"<h3>{escape(block[0].upper() + block[1:])}</h3><div {scroll}>{table}</div>"
    return f'<section id="viewer"><h2>What a viewer sees</h2>{html}</section>' if html else ""


def _counts(row: ClipRow, fps: float) -> list[str]:
    if row.error is not None:
        return ["-", "-", "-", "-", "failed"]
    return [f"{row.n_frames / fps:.2f}", str(row.pieces), str(row.hard_joins), str(row.retries), row.fallback_text]


def _row(label: str, cells: Sequence[str]) -> str:
    """Build a row of a table; `label` is HTML, the cells are text."""
    return f'<tr><th scope="row">{label}</th>' + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>"


def _table(headings: Sequence[str], body: Sequence[str], foot: str = "") -> str:
    head = "".join(f'<th scope="col">{escape(heading)}</th>' for heading in headings)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody><tfoot>{foot}</tfoot></table>"


def _ablation(ablation: Ablation | None) -> str:
    if ablation is None:
        return ""
    html = "<h2>Ablation</h2>"
    if ablation.plot is not None:
        data = base64.b64encode(ablation.plot).decode("ascii")
        html += f'<img alt="Bar plot of the ablation: each setup by each measure" src="data:image/png;base64,{data}">'
    results = ablation.results if isinstance(ablation.results, dict) else {}
    setups = results.get("setups")
    if isinstance(setups, dict) and all(isinstance(setup, dict) for setup in setups.values()):
        scroll = 'class="scroll" tabindex="0" role="region" aria-label="Ablation table"'
        html += f"<div {scroll}>{_ablation_table(setups, results.get('beside') or {})}</div>"
        signature = results.get("signature") or {}
        seeds = ", ".join(map(str, signature.get("seeds", [])))
        html += (
            "<p>Mean ± spread over seeds; below each setup, what the paper's Table 2 prints for it. "
            f"Seeds: {escape(seeds)}; gesturegen {escape(str(signature.get('version', '-')))}.</p>"
        )
    elif ablation.results is not None:
        html += "<p><code>ablation/ablation.json</code> holds no table that this version can show.</p>"
    return f'<section id="ablation">{html}</section>{_reference_length(ablation.lengths)}'


def _reference_length(results: object | None) -> str:
    if results is None:
        return ""
    html = "<h2>Reference length</h2>"
    if lines := lengths.lines_of(results):
        headings, rows = lengths.table_rows(lines)
        scroll = 'class="scroll" tabindex="0" role="region" aria-label="Table of reference lengths"'
        table = _table(headings, [_row(escape(name), cells) for name, cells in rows])
        html += (
            "<p>One graph of as much reference as the horizontal axis says; means over the test clips.</p>"
            f"{lengths.plots(lines)}<div {scroll}>{table}</div>"
        )
    else:
        html += "<p><code>ablation/reference_length.json</code> holds no lines that this version can show.</p>"
    return f'<section id="reference-length">{html}</section>'


def _ablation_table(setups: Mapping[str, Mapping], beside: Mapping[str, Mapping]) -> str:
    """Build the ablation table: a row per setup and one of the paper's figures, then the figures to compare them with.

    The paper's BC is neither of the two beat measures here, so it has a column of its own.
    """
    rows = []
    for name, setup in setups.items():
        mean, spread = (
            {key: math.nan if value is None else value for key, value in (setup.get(part) or {}).items()}
            for part in ("mean", "spread")
        )
        cells = [format_spread(mean.get(f.key, math.nan), spread.get(f.key, math.nan)) for f in ABLATION_COLUMNS]
        rows.append(_row(escape(name), [*cells, ""]))
        if printed := setup.get("paper"):
            cells = [format_figure(printed[f.key]) if printed.get(f.key) is not None else "" for f in ABLATION_COLUMNS]
            rows.append(_row("in the paper", [*cells, format_figure(printed.get("bc"))]))
    for name, row in beside.items():
        rows.append(_row(escape(name), [*(format_figure(row.get(f.key)) for f in ABLATION_COLUMNS), ""]))
    return _table(["setup", *(figure.heading for figure in ABLATION_COLUMNS), "paper's BC"], rows)

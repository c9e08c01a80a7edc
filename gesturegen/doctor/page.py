"""The doctor's findings as one HTML file: text and style, no script, and no resource from outside."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from gesturegen import __version__
from gesturegen.doctor.examination import UNFIT, Examined


def _figure(value: float | None, digits: int) -> str:
    """Format a figure with so many decimals; `-` for None."""
    return "-" if value is None else f"{value:.{digits}f}"


def _lag(one: Examined) -> str:
    """Format the lag of a recording; `?` where it does not stand out."""
    return "-" if one.lag is None else f"{one.lag:+.2f}" if one.lag_sure else "?"


# Heading, what it means, and the text of a recording.
COLUMNS = (
    ("s", "duration of the audio", lambda one: _figure(one.seconds, 1)),
    ("fps", "frames per second of the motion", lambda one: _figure(one.fps, 2)),
    ("height cm", "of the figure, from end to end", lambda one: _figure(one.height, 0)),
    ("hands cm/s", "mean speed of both, seen from the pelvis", lambda one: _figure(one.hand_speed, 1)),
    ("level dB", "root mean square of the audio", lambda one: _figure(one.level, 0)),
    ("speech %", "share of the audio in which somebody speaks", lambda one: _figure(one.voiced and 100 * one.voiced, 0)),
    ("onsets/s", "per second of speech", lambda one: _figure(one.onset_rate, 2)),
    ("words", "in the transcript", lambda one: _figure(one.n_words, 0)),
    ("lag s", "of the motion behind the sound; ? where it does not stand out", _lag),
)  # fmt: skip
_STYLE = """
:root { color-scheme: light dark; --paper: #fff; --panel: #f3f4f6; --ink: #1b1f24; --soft: #59636e; --line: #d0d7de;
  --bad: #b42318; --odd: #8a5a00; --good: #1a7f37; }
@media (prefers-color-scheme: dark) { :root { --paper: #14171a; --panel: #1f2429; --ink: #e8ebee; --soft: #a3adb8;
  --line: #3a424b; --bad: #ff8f80; --odd: #f0b429; --good: #5fce7a; } }
body { margin: 0 auto; padding: 0 1rem 2rem; max-width: 80rem; background: var(--paper); color: var(--ink);
  font: 16px/1.45 system-ui, sans-serif; overflow-wrap: anywhere; }
h1 { font-size: 1.4rem; } h2 { font-size: 1.1rem; margin: 1.6rem 0 .5rem; }
p.soft { color: var(--soft); margin: .25rem 0; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .7rem; border-bottom: 1px solid var(--line); text-align: right; vertical-align: top; }
th:first-child, .text { text-align: left; } tbody th { white-space: nowrap; } thead th { color: var(--soft); font-weight: 600; }
tbody th { font-weight: 600; } td.text { min-width: 7rem; }
.bad { color: var(--bad); font-weight: 600; } .odd { color: var(--odd); font-weight: 600; } .good { color: var(--good); }
code { font: .9em ui-monospace, monospace; background: var(--panel); border-radius: 3px; padding: 0 .25em; }
pre { background: var(--panel); padding: .75rem; border-radius: 6px; overflow-x: auto; font-size: .85rem; }
.counts { display: flex; flex-wrap: wrap; gap: .75rem; padding: 0; list-style: none; }
.counts li { background: var(--panel); border-radius: 6px; padding: .5rem .9rem; } .counts b { display: block; font-size: 1.3rem; }
"""


@dataclass(frozen=True)
class Content:
    """The content of the page: recordings by part of the data set, methods, the blacklist as YAML."""

    data: str
    parts: Mapping[str, Sequence[Examined]]
    methods: Sequence[tuple[str, str, str]]
    blacklist: str


def render(content: Content) -> str:
    """Render the page; the same content gives the same text."""
    everything = [one for part in content.parts.values() for one in part]
    digest = base64.b64encode(hashlib.sha256(_STYLE.encode()).digest()).decode()
    unfit, odd = sum(one.unfit for one in everything), sum(bool(one.findings) and not one.unfit for one in everything)
    counts = [
        ("recordings", len(everything)),
        ("unfit as references", unfit),
        ("with something odd", odd),
        ("with nothing to say", len(everything) - unfit - odd),
    ]
    html = [
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
        f"<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'sha256-{digest}'\">",
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f'<meta name="color-scheme" content="light dark">\n<title>gesturegen doctor</title>\n<style>{_STYLE}</style>\n</head>\n<body>',
        f"<h1>gesturegen doctor: {escape(content.data)}</h1>",
        '<ul class="counts">' + "".join(f"<li><b>{number}</b>{name}</li>" for name, number in counts) + "</ul>",
        "<h2>Findings</h2>", _findings(content.parts),
        "<h2>What each method could do</h2>", _methods(content.methods),
    ]  # fmt: skip
    for part, recordings in content.parts.items():
        html += [f"<h2>{escape(part)}</h2>", _figures(recordings)]
    notes = "; ".join(f"{heading}: {meaning}" for heading, meaning, _ in COLUMNS)
    html += [
        f'<p class="soft">{escape(notes)}.</p>', "<h2>Blacklist</h2>",
        "<p>A config that leaves out what is unfit (<code>gesturegen doctor --blacklist FILE</code> writes it):</p>",
        f"<pre>{escape(content.blacklist)}</pre>", f'<p class="soft">gesturegen {escape(__version__)}</p>\n</body>\n</html>\n',
    ]  # fmt: skip
    return "\n".join(html)


def lines(content: Content) -> list[str]:
    """Format the same content for a terminal: figures, findings and methods."""
    told = []
    for part, recordings in content.parts.items():
        table = [[part, *(heading for heading, _, _ in COLUMNS), "findings"]]
        table += [
            [
                one.name.rpartition("/")[2],
                *(text(one) for _, _, text in COLUMNS),
                ", ".join(dict.fromkeys(f.kind for f in one.findings)) or "-",
            ]
            for one in recordings
        ]
        told += [*_aligned(table), ""]
    found = [(one, f) for part in content.parts.values() for one in part for f in one.findings]
    told += [f"{one.name}: {f.kind}: {f.text}; {f.cure}" for one, f in found] or ["nothing odd was found"]
    return [*told, "", *_aligned([["method", "can it", "why"], *map(list, content.methods)])]


def _aligned(table: Sequence[Sequence[str]]) -> list[str]:
    """Align the columns of a table: the first and the last to the left, the others to the right."""
    widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))]
    return [
        "  ".join(
            [
                row[0].ljust(widths[0]),
                *(cell.rjust(width) for cell, width in zip(row[1:-1], widths[1:-1], strict=True)),
                row[-1],
            ]
        )
        for row in table
    ]


def _findings(parts: Mapping[str, Sequence[Examined]]) -> str:
    """Render the table of findings."""
    rows = [
        f'<tr><th scope="row">{escape(one.name)}</th><td class="text {"bad" if f.kind in UNFIT else "odd"}">{escape(f.kind)}</td>'
        f'<td class="text">{escape(f.text)}</td><td class="text">{escape(f.cure)}</td></tr>'
        for part in parts.values() for one in part for f in one.findings
    ]  # fmt: skip
    if not rows:
        return '<p class="good">Nothing odd was found.</p>'
    return _table(("recording", "what", "found", "what to do"), rows, texts=4)


def _methods(rows: Sequence[tuple[str, str, str]]) -> str:
    """Render the table of methods."""
    classes = {"yes": "good", "limited": "odd", "no": "bad"}
    return _table(
        ("method", "can it", "why"),
        [
            f'<tr><th scope="row">{escape(name)}</th><td class="text {classes[can]}">{can}</td><td class="text">{escape(why)}</td></tr>'
            for name, can, why in rows
        ],
        texts=3,
    )


def _figures(recordings: Sequence[Examined]) -> str:
    """Render the table of figures, a row for each recording."""
    rows = [
        f'<tr><th scope="row">{escape(one.name.rpartition("/")[2])}</th>' + "".join(f"<td>{escape(text(one))}</td>" for _, _, text in COLUMNS) + "</tr>"
        for one in recordings
    ]  # fmt: skip
    return _table(("recording", *(heading for heading, _, _ in COLUMNS)), rows)


def _table(headings: Sequence[str], rows: Sequence[str], texts: int = 0) -> str:
    """Render a table from its headings and rows.

    texts : how many columns from the left hold text, not figures
    """
    head = "".join(
        f'<th scope="col"{" class=text" if place < texts else ""}>{escape(heading)}</th>'
        for place, heading in enumerate(headings)
    )
    scroll = '<div class="scroll" tabindex="0" role="region" aria-label="table">'
    return f"{scroll}<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"

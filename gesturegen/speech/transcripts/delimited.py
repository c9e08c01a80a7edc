"""Tables of start, end and text: GENEA's TSV, and variants of spreadsheets, Audacity, Whisper and Praat.

GENEA's has no header: `start<TAB>end<TAB>text` in seconds. Read as well, and said: a header, columns parted by commas,
semicolons or spaces, quotes, decimal commas, clock times, milliseconds, and durations in place of ends.
"""

from __future__ import annotations

import csv
import itertools
import re
from collections import Counter
from dataclasses import dataclass

from gesturegen import inputs
from gesturegen.speech.transcript import Cell, tokens
from gesturegen.speech.transcripts.source import (
    LATEST,
    LINE_END,
    Found,
    Source,
    clock_seconds,
    in_seconds,
    without_marks,
)

_EXPECTED = "expected start<TAB>end<TAB>text"
_NAMES = {
    "start": {"start", "begin", "from", "onset", "tmin", "xmin", "start_time", "starttime", "begin_time", "time"},
    "end": {"end", "stop", "to", "offset", "tmax", "xmax", "end_time", "endtime", "stop_time"},
    "duration": {"duration", "dur", "length"},
    "text": {"text", "word", "words", "token", "label", "transcript", "transcription", "utterance", "sentence", "mark"},
}
_UNIT = re.compile(r"[\s_]*[\[(]?(ms|msec|milliseconds|s|sec|secs|seconds)[\])]?")
_DECIMAL_COMMA = re.compile(r"[-+]?[0-9]+,[0-9]+")
_DELIMITERS = {"\t": "tabs", ";": "semicolons", ",": "commas"}
# Of durations read as ends, how far one may reach into the next word, and how many may: more where most ends cannot be
# ends, for they lie before their starts.
_OVERLAP_SECONDS, _MOST_OVERLAPS, _MOST_OVERLAPS_WHEN_SURE = 0.02, 0.02, 0.3


@dataclass(frozen=True)
class _Columns:
    """The places of the columns in a row, and their units."""

    start: int
    end: int
    text: int
    count: int
    is_duration: bool = False
    milliseconds: bool = False


_PLAIN = _Columns(0, 1, 2, 3)


def is_table(text: str) -> bool:
    """Tell whether the first lines have times in their first two columns, or a header with a start and a text."""
    lines = [line for line in LINE_END.split(text[:5000]) if line.strip() and not line.startswith("\\")][:20]
    if not lines:
        return False
    delimiter = _delimiter(lines)
    rows = [_split(line, delimiter) for line in lines]
    # "Time to go" is a text, not a header.
    if len(_header(rows[0])) >= (3 if delimiter is None else 2):
        return True
    timed = sum(len(row) >= 2 and None not in (_time(row[0]), _time(row[1])) for row in rows)
    return timed > len(rows) / 2


def read(source: Source) -> Found:
    """Read the rows of a table; raises DataError with the line of anything that is no row."""
    lines = source.lines()
    spectral = sum(line.startswith("\\") for _, line in lines)
    lines = [(place, line) for place, line in lines if not line.startswith("\\")]
    if not lines:
        return Found(())
    delimiter = _delimiter([line for _, line in lines])
    rows = [(place, _split(line, delimiter), line) for place, line in lines]
    read_as = [f"{_DELIMITERS[delimiter]} between columns"] if delimiter in (";", ",") else []
    columns = _PLAIN
    if found := _header(rows[0][1]):
        columns, unused = _columns(source, rows[0][0], found, rows[0][1])
        read_as.append("a header" + (f" (columns not used: {unused})" if unused else ""))
        rows = rows[1:]
    quoted = sum(line.lstrip().startswith('"') for _, _, line in rows)
    read_as += ["quotes around cells"] if rows and quoted > len(rows) / 2 else []
    cells: list[Cell] = []
    kinds: Counter[str] = Counter()
    empty, unit = 0, None
    for place, row, line in rows:
        cell = _cell(source, place, row, line, columns, kinds)
        empty += not cell.text.strip() and len(row) < columns.count
        cells.append(cell)
    if kinds["decimal comma"] and kinds["decimal point"]:
        raise source.error("has decimal commas and decimal points in its times; write all of them with points")
    read_as += [kind + "s" for kind in ("decimal comma", "clock time") if kinds[kind]]
    if columns.milliseconds:
        cells, unit = [Cell(cell.start / 1000, cell.end / 1000, cell.text) for cell in cells], "milliseconds"
    else:
        cells, unit = in_seconds(cells, source.duration)
    read_as += [f"times in {unit}"] if unit else []
    if columns.is_duration or _are_durations(cells, source.duration):
        cells = [Cell(cell.start, cell.start + cell.end, cell.text) for cell in cells]
        read_as.append("durations in place of ends")
    # As aligners of segments write them; GENEA's cells of several words are shared out evenly.
    segments = columns is not _PLAIN and any(len(tokens(cell.text)) > 1 for cell in cells)
    read_as += ["words spread over each row by syllables"] if segments else []
    dropped = {
        "lines of frequencies, as Audacity writes them, passed over": spectral,
        "lines without a text, passed over": empty,
    }
    return Found(cells, tuple(read_as), {what: count for what, count in dropped.items() if count}, segments)


def _delimiter(lines: list[str]) -> str | None:
    """Detect what separates the columns of most lines; None for spaces."""
    if sum("\t" in line for line in lines) > len(lines) / 2:
        return "\t"
    for delimiter in (";", ","):
        rows = [_split(line, delimiter) for line in lines[:50]]
        timed = sum(len(row) >= 2 and None not in (_time(row[0]), _time(row[1])) for row in rows)
        if timed > len(rows) / 2 or (len(rows[0]) > 1 and _header(rows[0])):
            return delimiter
    return None


def _split(line: str, delimiter: str | None) -> list[str]:
    """Split a line into cells without the quotes around them; empty ones at its end are left out."""
    if delimiter is None or (delimiter == "\t" and "\t" not in line):
        return line.split(None, 2)
    if delimiter == "\t":
        cells = [_unquoted(cell) for cell in line.split("\t")]
    else:
        try:
            cells = next(csv.reader([line], delimiter=delimiter, strict=True, skipinitialspace=True), [])
        except csv.Error:
            cells = line.split(delimiter)
    while len(cells) > 2 and not cells[-1].strip():
        cells.pop()
    return cells


def _unquoted(cell: str) -> str:
    """Remove the quotes around a cell."""
    bare = cell.strip()
    whole = len(bare) > 1 and bare[0] == bare[-1] == '"'
    return bare[1:-1].replace('""', '"') if whole else cell


def _header(cells: list[str]) -> dict[str, tuple[int, str]]:
    """Find the known columns of a header, with their place and unit; empty for a row that is no header."""
    if any(_time(cell) is not None for cell in cells):
        return {}
    found: dict[str, tuple[int, str]] = {}
    for place, cell in enumerate(cells):
        name, unit = cell.strip().lower(), ""
        for kind, names in _NAMES.items():
            known = next((known for known in names if name.startswith(known)), None)
            if name not in names and known is not None:
                known = max((known for known in names if name.startswith(known)), key=len)
                matched = _UNIT.fullmatch(name[len(known) :])
                unit = matched[1] if matched else ""
                known = known if matched else None
            if known is not None and kind not in found:
                found[kind] = place, unit
    # A row of words, such as "from here to there", is none.
    return found if len(found) > 1 and "start" in found else {}


def _columns(source: Source, place: int, found: dict[str, tuple[int, str]], names: list[str]) -> tuple[_Columns, str]:
    """Choose the columns to read from a header, and name those that are not used."""
    missing = [name for name in ("start", "text") if name not in found]
    missing += ["end"] if not found.keys() & {"end", "duration"} else []
    shown = inputs.shown(", ".join(name.strip() for name in names)[:80])
    if missing:
        raise source.error(
            f"the header has no column for the {missing[0]}; found {shown}; expected start, end, text", place
        )
    last = "end" if "end" in found else "duration"
    units = {unit for kind in ("start", last) if (unit := found[kind][1])}
    milliseconds = bool(units) and all(unit.startswith("m") for unit in units)
    if len(units) > 1 and any(unit.startswith("m") for unit in units) and not milliseconds:
        raise source.error(f"the header has two units of time: {shown}; use one", place)
    used = {found[kind][0] for kind in ("start", last, "text")}
    unused = [inputs.shown(name.strip())[:30] for n, name in enumerate(names) if n not in used and name.strip()]
    columns = _Columns(
        found["start"][0], found[last][0], found["text"][0], len(names), last == "duration", milliseconds
    )
    return columns, ", ".join(unused[:6])


def _cell(source: Source, place: int, row: list[str], line: str, columns: _Columns, kinds: Counter) -> Cell:
    """Read one row to a cell, and count the kinds of numbers in it."""
    text_last = columns.text == columns.count - 1
    unquoted = text_last and "\t" not in line and '"' not in line
    # Commas of the text; a number among them may be a part of a time, with a comma for a point.
    if len(row) > columns.count and unquoted and _time(row[columns.text]) is None:
        row = [*row[: columns.count - 1], " ".join(row[columns.count - 1 :])]
    # Without the mark before it, an empty text is no cell.
    marked = text_last and any(delimiter in line for delimiter in _DELIMITERS)
    least = max(columns.start, columns.end) + 1 if marked else columns.count
    if not least <= len(row) <= columns.count:
        raise source.error(f"{len(row)} columns in {inputs.shown(line.strip()[:40])!r}; {_EXPECTED}", place)
    times = []
    for column in (columns.start, columns.end):
        time = _time(row[column], kinds)
        if time is None or abs(time) > LATEST:
            raise source.error(
                f"column {column + 1} is {inputs.shown(row[column].strip()[:30])!r}, not a time in seconds", place
            )
        times.append(time)
    text = row[columns.text] if columns.text < len(row) else ""
    return Cell(times[0], times[1], text if columns is _PLAIN else without_marks(text)[0])


def _time(cell: str, kinds: Counter | None = None) -> float | None:
    """Parse a number with a point or a comma, or a clock time, to seconds; None for anything else."""
    bare = cell.strip()
    kind = "number"
    time = inputs.decimal(bare)
    if time is not None:
        kind = "decimal point" if "." in bare else "number"
    elif _DECIMAL_COMMA.fullmatch(bare):
        time, kind = inputs.decimal(bare.replace(",", ".")), "decimal comma"
    elif (time := clock_seconds(bare)) is not None:
        kind = "clock time"
    if kinds is not None:
        kinds[kind] += 1
    return time


def _are_durations(cells: list[Cell], duration: float) -> bool:
    """Tell whether ends must be durations: some lie before their starts, and as durations the words fit in turn."""
    wrong = sum(cell.end < cell.start for cell in cells)
    if wrong < 2 or any(cell.end < 0 for cell in cells):
        return False
    most = _MOST_OVERLAPS_WHEN_SURE if 2 * wrong > len(cells) else _MOST_OVERLAPS
    spans = [(cell.start, cell.start + cell.end) for cell in cells]
    pairs = list(itertools.pairwise(spans))
    overlaps = sum(one[1] > other[0] + _OVERLAP_SECONDS or one[0] > other[0] for one, other in pairs)
    return overlaps <= most * len(pairs) and spans[-1][1] <= duration + 1.0

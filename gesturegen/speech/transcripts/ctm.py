"""NIST's CTM: recording, channel, start, duration and word in each line, as written by Kaldi and NeMo."""

from __future__ import annotations

import re

from gesturegen import inputs
from gesturegen.speech.transcript import Cell
from gesturegen.speech.transcripts.source import LATEST, LINE_END, Found, Source, said

_ROW = re.compile(r"\S+\s+\S+\s+[-+0-9.eE]+\s+[-+0-9.eE]+\s+\S+(\s+\S+){0,3}\s*")


def is_ctm(text: str) -> bool:
    """Tell whether most of the first lines look like CTM, and do not begin with times as tables do."""
    lines = [line for line in LINE_END.split(text[:5000])[:20] if line.strip() and not line.startswith(";;")]
    rows = [line for line in lines if _ROW.fullmatch(line) and "\t" not in line]
    begins = sum(None not in map(inputs.decimal, line.split()[:2]) and len(line.split()) == 3 for line in lines)
    return bool(lines) and len(rows) > len(lines) / 2 > begins


def read(source: Source) -> Found:
    """Read the words of the recording that the file is named after, or of the only one in it."""
    rows: list[tuple[str, str, Cell]] = []
    for place, line in source.lines():
        if line.startswith(";;"):
            continue
        cells = line.split()
        if len(cells) < 5:
            raise source.error(
                f"{len(cells)} columns in {inputs.shown(line.strip()[:40])!r}; expected recording, channel, start, duration, word",
                place,
            )
        start = _seconds(source, place, cells, 3, "start")
        length = _seconds(source, place, cells, 4, "duration")
        rows.append((cells[0], cells[1], Cell(start, start + length, cells[4])))
    names = sorted({name for name, _, _ in rows})
    stem = source.path.stem
    if len(names) > 1 and stem not in names:
        shown = ", ".join(inputs.shown(name)[:40] for name in names[:5])
        raise source.error(
            f"has {len(names)} recordings ({shown}), none of them {inputs.shown(stem)}; give one file a recording"
        )
    own = [row for row in rows if len(names) == 1 or row[0] == stem]
    channels = sorted({channel for _, channel, _ in own})
    if len(channels) > 1:
        raise source.error(
            f"has words of channels {inputs.shown(' and '.join(channels)[:60])}; keep the speaker's alone"
        )
    others = len(rows) - len(own)
    kept, dropped = said([cell for _, _, cell in own])
    return Found(kept, (), dropped | ({"words of other recordings, passed over": others} if others else {}))


def _seconds(source: Source, place: int, cells: list[str], column: int, name: str) -> float:
    """Read the number in a column, counted from 1; raises DataError where there is no time in seconds."""
    value = inputs.decimal(cells[column - 1])
    if value is None or abs(value) > LATEST:
        raise source.error(
            f"column {column} is {inputs.shown(cells[column - 1][:30])!r}, not a {name} in seconds", place
        )
    return value

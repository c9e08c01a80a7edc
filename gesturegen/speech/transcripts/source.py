"""The types that readers of transcripts take and return, and steps that several readers share."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gesturegen import inputs
from gesturegen.errors import DataError
from gesturegen.speech.transcript import Cell, share_out, syllables, tokens

MOST_BYTES = 30_000_000
# Seconds; milliseconds of a week are less.
LATEST = 1e9
# Units of time in files, with their seconds.
_UNITS = (("milliseconds", 1e-3), ("microseconds", 1e-6), ("units of 100 ns", 1e-7))
# What of a transcript may lie beyond the end for a unit to be right, and how much of the recording it must cover.
_MOST_OUTSIDE, _LEAST_COVERED = 0.2, 0.1
# str.splitlines() would also split at the ellipsis of Windows' code page, read as Latin-1.
LINE_END = re.compile(r"\r\n|\r|\n")
_CLOCK = re.compile(r"(?:([0-9]{1,4}):)?([0-9]{1,2}):([0-9]{1,2}(?:[.,][0-9]{1,9})?)")
# Of aligners and recognisers, where no word is said.
_SILENCE = {"sil", "sp", "spn", "nsn", "silence", "<eps>"}
_MARK = re.compile(r"<[^<>]*>|\[[^\[\]]*\]|\{[^{}]*\}|♪")


class NotATranscript(DataError):
    """The error for a file of a kind that may hold a transcript but holds something else."""


@dataclass(frozen=True)
class Source:
    """A file to be read: its text without a byte order mark, and the duration of its recording in seconds."""

    path: Path
    text: str
    duration: float

    def error(self, what: str, line: int | None = None) -> DataError:
        """Return the one-line error that refuses the file, with the line at fault."""
        where = inputs.shown(self.path) if line is None else f"{inputs.shown(self.path)}:{line}"
        return DataError(f"{where}: {what}")

    def lines(self) -> list[tuple[int, str]]:
        """List lines that are not blank, numbered from 1; raises DataError for the mark of a merge conflict."""
        lines = [(number, line) for number, line in enumerate(LINE_END.split(self.text), 1) if line.strip()]
        for number, line in lines:
            if line.startswith(("<<<<<<<", ">>>>>>>", "=======")):
                raise self.error("merge conflict marker; resolve the conflict first", number)
        return lines


@dataclass(frozen=True)
class Found:
    """The result of a reader of transcripts.

    read_as : what was recognised, converted or guessed, in a few words each
    dropped : how many were passed over, by what they are
    by_syllables : whether a cell's words share its time by their syllables, not evenly
    """

    cells: Sequence[Cell]
    read_as: tuple[str, ...] = ()
    dropped: dict[str, int] = field(default_factory=dict)
    by_syllables: bool = False


@dataclass(frozen=True)
class Format:
    """A kind of transcript: its name, endings of its files, a test of a text, and its reader.

    read : None for a text without times
    certain : whether a file with such an ending is a transcript, whatever it holds
    """

    name: str
    extensions: tuple[str, ...]
    holds: Callable[[str], bool]
    read: Callable[[Source], Found] | None
    certain: bool = True


def clock_seconds(text: str) -> float | None:
    """Parse `h:mm:ss.mmm` or `mm:ss`, with a point or a comma, to seconds; None for anything else."""
    found = _CLOCK.fullmatch(text.strip())
    if not found:
        return None
    hours, minutes, seconds = int(found[1] or 0), int(found[2]), float(found[3].replace(",", "."))
    return None if seconds >= 60 or (found[1] and minutes >= 60) else 3600 * hours + 60 * minutes + seconds


def without_marks(text: str) -> tuple[str, int]:
    """Remove `[marks]`, `<tags>` and silences from a text, and count them."""
    bare, count = _MARK.subn(" ", text)
    return ("", count + 1) if bare.strip().lower() in _SILENCE else (bare, count)


def said(cells: Sequence[Cell]) -> tuple[list[Cell], dict[str, int]]:
    """Drop marks such as `[laughter]` from cells, and count them."""
    kept, marks = [], 0
    for cell in cells:
        text, count = without_marks(cell.text)
        marks += count
        if text.strip():
            kept.append(cell._replace(text=text))
    return kept, {"marks such as [laughter] and <sil>, passed over": marks} if marks else {}


def in_seconds(cells: list[Cell], duration: float) -> tuple[list[Cell], str | None]:
    """Convert cells to seconds, and name their unit where it was another one.

    Another unit is taken only where, in seconds, most of the transcript would lie beyond the recording, and in that
    unit little of it does.
    """
    if not cells or _outside(cells, 1.0, duration) <= 0.5:
        return cells, None
    for unit, factor in _UNITS:
        covered = max(cell.start for cell in cells) * factor
        if _outside(cells, factor, duration) <= _MOST_OUTSIDE and covered >= _LEAST_COVERED * duration:
            return [Cell(cell.start * factor, cell.end * factor, cell.text) for cell in cells], unit
    return cells, None


def _outside(cells: Sequence[Cell], factor: float, duration: float) -> float:
    """Compute the share of cells that start after the recording has ended, or end long after it."""
    latest = 2 * duration + 1
    return sum(cell.start * factor >= duration or cell.end * factor > latest for cell in cells) / len(cells)


def with_all_times(
    cells: Sequence[tuple[float | None, float | None, str]], source: Source
) -> tuple[list[Cell], dict[str, int]]:
    """Place cells without times between their neighbours by syllables, and count them.

    DataError where none has times.
    """
    timed = [None if start is None or end is None else Cell(start, end, text) for start, end, text in cells]
    done = [cell for cell in timed if cell is not None]
    if len(done) == len(timed):
        return done, {}
    if not done:
        raise source.error("no word has a start and an end; transcribe it again with word times")
    done = []
    waiting: list[str] = []
    for cell, (_, _, text) in zip(timed, cells, strict=True):
        if cell is None:
            waiting += tokens(text)
            continue
        done += [*_between(done, waiting, cell.start), cell]
        waiting = []
    done += _between(done, waiting, max(source.duration, done[-1].end))
    return done, {"words without times, placed between their neighbours": timed.count(None)}


def _between(before: Sequence[Cell], words: Sequence[str], end: float) -> list[Cell]:
    """Share the time from the end of the last cell to `end` among words, a third of a second a syllable at most."""
    start = min(before[-1].end, end) if before else 0.0
    # At most a third of a second a syllable: a pause is no part of a word.
    longest = sum(map(syllables, words)) / 3
    return share_out(start, min(end, start + longest), words, True)


def number(value: object) -> float | None:
    """Parse a value of JSON or a text to a finite number of a size that times can have; None for anything else."""
    if isinstance(value, str):
        value = inputs.decimal(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if abs(value) <= LATEST else None  # NaN is not less either

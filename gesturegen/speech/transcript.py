"""Transcripts: words with their times, and the frames they cover.

GENEA's TSV has no header: `start<TAB>end<TAB>text` in seconds. Columns may be separated by spaces where
that is unambiguous. `#` marks laughter and is no word; a cell with several words is split evenly.
"""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gesturegen import inputs
from gesturegen.errors import DataError

MOST_BYTES = 2_000_000
# Seconds; milliseconds of a week are less.
_LATEST = 1e9

# Times in TSV files are often a hair below the frame they mean (0.3 * 30 is 8.999...).
_FRAME_SLACK = 1e-6
# str.splitlines() would also split at the ellipsis of Windows' code page, read as Latin-1.
_LINE_END = re.compile(r"\r\n|\r|\n")


@dataclass(frozen=True)
class Word:
    """A word, lower-cased and without punctuation, from `start` to `end` in seconds."""

    text: str
    start: float
    end: float

    def frames(self, fps: float) -> tuple[int, int]:
        """The half-open range of frames the word covers, at least one."""
        start = int(np.floor(self.start * fps + _FRAME_SLACK))
        return start, max(int(np.floor(self.end * fps + _FRAME_SLACK)), start + 1)


def normalize(text: str) -> str:
    """The bare word: lower case, no punctuation but inner apostrophes and hyphens; empty for laughter."""
    return re.sub(r"[^\w'-]|_", "", text.lower().replace("\N{RIGHT SINGLE QUOTATION MARK}", "'")).strip("'-")


def read(path: str | Path, duration: float) -> tuple[tuple[Word, ...], list[str]]:
    """Words of a TSV file in order of time, and what was odd about it, one line each.

    Words outside 0 to `duration` seconds are dropped, words across its ends are clipped; words that end
    before they start are dropped. Raises DataError with the line for anything that is no transcript.
    """
    path = Path(path)
    raw = inputs.read_bytes(path, MOST_BYTES)
    if raw.startswith(b"version https://git-lfs"):
        raise DataError(f"{inputs.shown(path)}: a Git LFS pointer, not the file itself; run `git lfs pull`")
    if b"\0" in raw:
        raise DataError(f"{inputs.shown(path)}: binary data, not a transcript; expected start<TAB>end<TAB>text lines")
    notes = []
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
        notes.append(f"{path.name}: not UTF-8, read as Latin-1")
    cells = [_parse_line(path, number, line) for number, line in enumerate(_LINE_END.split(text), 1) if line.strip()]
    if not cells:
        notes.append(f"{path.name}: the transcript is empty, so there are no keywords")
    words, counts = _fit(cells, duration)
    notes += [f"{path.name}: {what}: {count}" for what, count in counts.items() if count]
    return tuple(words), notes


def _parse_line(path: Path, number: int, line: str) -> tuple[float, float, str]:
    where = f"{inputs.shown(path)}:{number}"
    if line.startswith(("<<<<<<<", ">>>>>>>", "=======")):
        raise DataError(f"{where}: merge conflict marker; resolve the conflict first")
    cells = line.split("\t") if "\t" in line else line.split(None, 2)
    if len(cells) != 3:
        raise DataError(f"{where}: {len(cells)} columns in {line.strip()[:40]!r}; expected start<TAB>end<TAB>text")
    times = []
    for column, cell in enumerate(cells[:2], 1):
        time = inputs.decimal(cell)
        if time is None or abs(time) > _LATEST:
            raise DataError(
                f"{where}: column {column} is {cell.strip()[:30]!r}, not a time in seconds (there is no header line)"
            )
        times.append(time)
    return times[0], times[1], cells[2]


def _fit(cells: list[tuple[float, float, str]], duration: float) -> tuple[list[Word], dict[str, int]]:
    counts = dict.fromkeys(
        (
            "words that end before they start, dropped",
            "words outside the audio, dropped",
            "words that reach beyond the audio, clipped",
            "words out of order, sorted",
            "words that overlap the next one",
        ),
        0,
    )
    reversed_, outside, clipped, unsorted, overlapping = counts
    words: list[Word] = []
    latest = -np.inf
    for start, end, text in cells:
        tokens = [token for token in map(normalize, text.split()) if token]
        if end < start:
            counts[reversed_] += len(tokens)
            continue
        for k, token in enumerate(tokens):
            from_ = start + (end - start) * k / len(tokens)
            to = start + (end - start) * (k + 1) / len(tokens)
            if from_ >= duration or to < 0 or (to == 0 and from_ < 0):
                counts[outside] += 1
                continue
            if from_ < 0 or to > duration:
                counts[clipped] += 1
            counts[unsorted] += from_ < latest
            latest = max(latest, from_)
            words.append(Word(token, max(from_, 0.0), min(to, duration)))
    words.sort(key=lambda word: (word.start, word.end, word.text))
    counts[overlapping] = sum(a.end > b.start + _FRAME_SLACK for a, b in itertools.pairwise(words))
    return words, counts

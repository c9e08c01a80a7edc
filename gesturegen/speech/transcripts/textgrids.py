"""Praat's TextGrid, in its long and its short form: the tier of words."""

from __future__ import annotations

import re

from gesturegen import inputs
from gesturegen.errors import DataError
from gesturegen.speech.transcript import Cell
from gesturegen.speech.transcripts.source import Found, Source, number, said

_WORDS = re.compile(r"(?:.*\W)?(?:words?|tokens?|ortho?|orthography|transcript|transcription|text)", re.I)
_PHONES = re.compile(r"(?:.*\W)?(?:phones?|phonemes?|segments?|mau|syllables?)", re.I)
_HEAD = re.compile(r'\s*(?:File type\s*=\s*)?"ooTextFile( short)?"', re.I)


def is_textgrid(text: str) -> bool:
    """Tell whether a text has the heading of a TextGrid."""
    return _HEAD.match(text[:200]) is not None and "TextGrid" in text[:400]


def read(source: Source) -> Found:
    """Read the intervals of the tier of words, or of the only tier; raises DataError for a file without such a tier."""
    from praatio.utilities import textgrid_io

    try:
        tiers = textgrid_io.parseTextgridStr(source.text, includeEmptyIntervals=False)["tiers"]
        intervals = [(str(tier["name"]), list(tier["entries"])) for tier in tiers if tier["class"] == "IntervalTier"]
    except DataError:
        raise
    except Exception as problem:  # of any kind: it splits and counts, and trusts what it finds
        reason = inputs.shown(f"{type(problem).__name__}: {problem}".splitlines()[0][:100])
        raise source.error(f"damaged or no TextGrid ({reason}); save it again from Praat") from None
    if not intervals:
        raise source.error("no tier of intervals in it; expected one called words")
    name, entries = _tier_of_words(intervals, source)
    cells = []
    for place, entry in enumerate(entries, 1):
        start, end = number(entry[0]), number(entry[1])
        if start is None or end is None:
            raise source.error(f"interval {place} of tier {inputs.shown(name)[:60]!r} has no times in seconds")
        cells.append(Cell(start, end, str(entry[2])))
    kept, dropped = said(cells)
    return Found(kept, (f"tier {inputs.shown(name)[:60]!r}",), dropped, by_syllables=True)


def _tier_of_words(intervals: list[tuple[str, list]], source: Source) -> tuple[str, list]:
    """Choose the tier of words among the interval tiers; raises DataError where more than one may be meant."""
    named = [tier for tier in intervals if _WORDS.fullmatch(tier[0].strip())]
    other = [tier for tier in intervals if not _PHONES.fullmatch(tier[0].strip())]
    chosen = named or (other if len(other) == 1 else [])
    if len(chosen) == 1:
        return chosen[0]
    names = ", ".join(inputs.shown(name)[:40] for name, _ in (named or intervals)[:8])
    raise source.error(f"which tier holds the words? It has {names}; call one of them words, and no other")

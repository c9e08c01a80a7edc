"""SubRip (`.srt`) and WebVTT (`.vtt`): cues of several words each; WebVTT may also time single words."""

from __future__ import annotations

import html
import re

from gesturegen import inputs
from gesturegen.speech.transcript import Cell, tokens
from gesturegen.speech.transcripts.source import LINE_END, Found, Source, clock_seconds, said

_TIME = r"(?:[0-9]{1,4}:)?[0-9]{1,2}:[0-9]{1,2}[.,][0-9]{1,9}"
_CUE = re.compile(rf"\s*({_TIME})\s*-->\s*({_TIME})(?:\s.*)?")
_INLINE = re.compile(rf"<({_TIME})>")
_TAG = re.compile(r"</?(?:[a-zA-Z][^<>]{0,200})?>|\{\\[^{}]{0,200}\}")


def is_srt(text: str) -> bool:
    """Tell whether a text has a line of times as SubRip has, and no heading of WebVTT."""
    return not is_vtt(text) and any(_CUE.fullmatch(line) for line in LINE_END.split(text[:20_000]))


def is_vtt(text: str) -> bool:
    """Tell whether a text has the heading of WebVTT."""
    return re.match(r"WEBVTT(\s|$)", text) is not None


def read(source: Source) -> Found:
    """Read the words of all cues; raises DataError with the line of times that cannot be read."""
    source.lines()  # for the marks of merge conflicts
    cells: list[Cell] = []
    cues, timed = 0, _INLINE.search(source.text) is not None
    shown: list[list[str]] = []
    for start, end, lines in _cues(source):
        cues += 1
        # Captions that roll show a line again when the next one comes.
        new = [line for line in lines if not (timed and tokens(_plain(line)) in shown)]
        shown = [tokens(_plain(_INLINE.sub(" ", line))) for line in lines] if timed else []
        cells += _timed(start, end, "\n".join(new)) if timed else [Cell(start, end, _plain("\n".join(new)))]
    kept, dropped = said(cells)
    several = any(len(tokens(cell.text)) > 1 for cell in kept)
    read_as = [f"{cues} cues" if cues != 1 else "1 cue"] if not cells else []
    read_as += ["times within cues"] if timed else []
    read_as += ["words spread over each cue by syllables"] if several else []
    return Found(kept, tuple(read_as), dropped, by_syllables=True)


def _cues(source: Source) -> list[tuple[float, float, list[str]]]:
    """List start, end and lines of text of each cue.

    A cue is a block between blank lines, with a line of times first or second.
    """
    found = []
    block: list[tuple[int, str]] = []
    for number, line in [*enumerate(LINE_END.split(source.text), 1), (0, "")]:
        if line.strip():
            block.append((number, line))
            continue
        if block:
            found += _cue(source, block)
        block = []
    return found


def _cue(source: Source, block: list[tuple[int, str]]) -> list[tuple[float, float, list[str]]]:
    """Read one block of lines: a list of one cue, or of none for a comment of WebVTT."""
    for place, (number, line) in enumerate(block[:2]):
        if "-->" not in line:
            continue
        times = _CUE.fullmatch(line)
        start, end = (clock_seconds(times[1]), clock_seconds(times[2])) if times else (None, None)
        if start is None or end is None:
            raise source.error(
                f"{inputs.shown(line.strip()[:60])!r} are no times of a cue; expected 00:00:01,000 --> 00:00:02,500",
                number,
            )
        return [(start, end, [text.strip() for _, text in block[place + 1 :]])]
    heading = is_vtt(block[0][1]) or re.match(r"(NOTE|STYLE|REGION)(\s|$)", block[0][1]) is not None
    if heading and is_vtt(source.text):
        return []
    number, line = block[0]
    raise source.error(
        f"no times of a cue with {inputs.shown(line.strip()[:60])!r}; expected 00:00:01,000 --> 00:00:02,500", number
    )


def _timed(start: float, end: float, text: str) -> list[Cell]:
    """Split a cue at the times in its text into cells."""
    parts = _INLINE.split(text)
    times = [start]
    # A time that is out of order is that of the word before.
    for seconds in [*map(clock_seconds, parts[1::2]), end]:
        times.append(times[-1] if seconds is None else max(seconds, times[-1]))
    cells = zip(times, times[1:], parts[::2], strict=False)
    return [Cell(a, b, _plain(part)) for a, b, part in cells if tokens(_plain(part))]


def _plain(text: str) -> str:
    """Remove tags from a text and resolve character references."""
    return html.unescape(_TAG.sub(" ", text))

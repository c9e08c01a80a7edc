"""JSON of recognisers and aligners: Whisper, WhisperX, whisper.cpp, Gentle, Vosk, Seamless Interaction, and their like.

They have lists of words, or of segments that have lists of words, under a few names; times may be missing.
"""

from __future__ import annotations

import json
import re
from typing import Any

from gesturegen import inputs
from gesturegen.speech.transcript import tokens
from gesturegen.speech.transcripts.source import Found, NotATranscript, Source, in_seconds, number, said, with_all_times

# Where lists of words or segments stand in a document, and whose they are.
_LISTS = (
    ("segments", "Whisper"),
    ("word_segments", "WhisperX"),
    ("metadata:transcript", "Seamless Interaction"),
    ("words", "words"),
    ("result", "Vosk"),
    ("transcription", "whisper.cpp"),
    ("fragments", "aeneas"),
)
_TEXT = ("word", "text", "transcript", "punctuated_word", "lines")
_START, _END = ("start", "start_time", "begin", "from"), ("end", "end_time", "to")
_WORDS = ("words", "result")


def is_json(text: str) -> bool:
    """Tell whether a text looks like JSON."""
    return re.match(r"\s*(?:\{\s*[\"}]|\[\s*[\[{\]])", text[:2000]) is not None


def read(source: Source) -> Found:
    """Read the words of all segments, or the texts of segments without words.

    DataError for what is no JSON and for words with odd times; NotATranscript for JSON of another kind.
    """
    document = _parse(source)
    entries, kind = _entries(document, source)
    loose: list[tuple[float | None, float | None, str]] = []
    segments = 0
    for place, entry in enumerate(entries, 1):
        where = f"{kind}, entry {place}"
        if not isinstance(entry, dict):
            raise source.error(f"{where}: {_brief(entry)}, expected a word or a segment with start and end")
        words = next((entry[key] for key in _WORDS if isinstance(entry.get(key), list) and entry[key]), None)
        if words is None:
            loose.append(_cell(entry, where, source))
            segments += len(tokens(loose[-1][2])) > 1
        else:
            loose += [_cell(word, f"{where}, word {n}", source) for n, word in enumerate(words, 1)]
    loose = [cell for cell in loose if cell[2].strip()]
    cells, placed = with_all_times(loose, source) if loose else ([], {})
    cells, unit = in_seconds(cells, source.duration)
    kept, dropped = said(cells)
    read_as = [f"entries of {kind}" if kind[0].isupper() else kind, *([f"times in {unit}"] if unit else [])]
    read_as += ["words spread over each segment by syllables"] if segments else []
    return Found(kept, tuple(read_as), placed | dropped, by_syllables=True)


def _parse(source: Source) -> Any:
    """Parse JSON, in which NaN and Infinity are refused; raises DataError for invalid JSON."""

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no number")

    try:
        return json.loads(source.text, parse_constant=refuse)
    except (ValueError, RecursionError) as problem:
        reason = inputs.shown(str(problem).splitlines()[0][:100] or type(problem).__name__)
        raise source.error(f"not valid JSON ({reason}); export it again") from None


def _entries(document: Any, source: Source) -> tuple[list, str]:
    """Find the list of words or segments, and name it for messages."""
    if isinstance(document, list):
        if all(isinstance(entry, dict) and entry.keys() & {*_TEXT, *_WORDS} for entry in document):
            return document, "words" if document and "word" in document[0] else "segments"
        raise NotATranscript(f"{inputs.shown(source.path)}: a list without words and times, so no transcript")
    if isinstance(document, dict):
        found = [(document[key], kind) for key, kind in _LISTS if isinstance(document.get(key), list)]
        if found:
            # WhisperX has the same words twice.
            return (found[0][0], "WhisperX") if "word_segments" in document else found[0]
        if {"names", "frames"} <= document.keys():
            raise NotATranscript(
                f"{inputs.shown(source.path)}: movements of the face, as BEAT has them, and no transcript"
            )
        keys = inputs.shown(", ".join(map(str, list(document)[:8]))[:100])
        raise NotATranscript(
            f"{inputs.shown(source.path)}: JSON without words and times (it has: {keys or 'nothing'}), so no transcript"
        )
    raise NotATranscript(f"{inputs.shown(source.path)}: JSON without words and times, so no transcript")


def _cell(entry: Any, where: str, source: Source) -> tuple[float | None, float | None, str]:
    """Read start and end, None where they are missing, and text of a word or a segment."""
    if not isinstance(entry, dict):
        raise source.error(f"{where}: {_brief(entry)}, expected a word with start and end")
    text = next((entry[key] for key in _TEXT if key in entry), "")
    if isinstance(text, list) and all(isinstance(line, str) for line in text):
        text = " ".join(text)
    if not isinstance(text, str):
        raise source.error(f"{where}: the word is {_brief(text)}, expected a text")
    times: list[float | None] = []
    offsets = entry.get("offsets")
    if isinstance(offsets, dict):  # of whisper.cpp, in milliseconds
        found = [number(offsets.get(key)) for key in ("from", "to")]
        times = [None if time is None else time / 1000 for time in found]
    for names in (_START, _END) if not times else ():
        value = next((entry[key] for key in names if entry.get(key) is not None), None)
        time = number(value)
        if value is not None and time is None:
            raise source.error(f"{where}: {names[0]} is {_brief(value)}, not a time in seconds")
        times.append(time)
    return times[0], times[1], text


def _brief(value: Any) -> str:
    """Format a value for an error message, cut to 40 characters."""
    return inputs.shown(str(value)[:40]) or "empty"

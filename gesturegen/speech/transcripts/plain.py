"""Text without times, which is aligned with the sound of its recording."""

from __future__ import annotations

import re

from gesturegen.speech.transcripts.source import LINE_END, Source, without_marks

_LETTER = re.compile(r"[^\W_]")


def is_text(text: str) -> bool:
    """Tell whether a file holds words and is no table, such as BEAT's labels of gestures."""
    lines = [line for line in LINE_END.split(text[:5000]) if line.strip()]
    tables = sum(line.count("\t") >= 2 for line in lines)
    return _LETTER.search(text) is not None and tables <= len(lines) / 2


def words(source: Source) -> tuple[list[str], int]:
    """List the words as they are written, without marks such as `[laughter]`, and count these marks."""
    source.lines()  # for the marks of merge conflicts
    text, marks = without_marks(source.text)
    return [word for word in text.split() if _LETTER.search(word)], marks

"""Transcripts in any common form: recognised by ending and content, read strictly, described in one line.

A format is one line in `FORMATS`: its name, the endings of its files, whether a text is of it, and its reader.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gesturegen import inputs
from gesturegen.errors import DataError
from gesturegen.speech import alignment
from gesturegen.speech.transcript import Word, fit, tokens
from gesturegen.speech.transcripts import ctm, delimited, plain, subtitles, textgrids, word_json
from gesturegen.speech.transcripts.source import MOST_BYTES, Format, NotATranscript, Source

# Where a clip has several, the first is read: from times of words over times of cues to no times.
FORMATS = (
    Format("table", (".tsv",), delimited.is_table, delimited.read),
    Format("Praat TextGrid", (".textgrid",), textgrids.is_textgrid, textgrids.read),
    Format("CTM", (".ctm",), ctm.is_ctm, ctm.read),
    Format("JSON", (".json",), word_json.is_json, word_json.read, certain=False),
    Format("table", (".csv",), delimited.is_table, delimited.read, certain=False),
    Format("WebVTT", (".vtt",), subtitles.is_vtt, subtitles.read),
    Format("SRT", (".srt",), subtitles.is_srt, subtitles.read),
    Format("text without times", (".txt", ".lab"), plain.is_text, None, certain=False),
)
_TEXT = FORMATS[-1]
EXTENSIONS = tuple(extension for one in FORMATS for extension in one.extensions)
# Files with these endings are transcripts, whatever lies beside them.
CERTAIN = tuple(extension for one in FORMATS if one.certain for extension in one.extensions)
WITHOUT_TIMES = _TEXT.extensions
_EMPTY = "the transcript is empty, so there are no keywords"
_ENCODINGS = {"latin-1": "not UTF-8, read as Latin-1", "utf-16": "in UTF-16"}
_LFS = "version https://git-lfs"


def read(
    path: str | Path, duration: float, sound: tuple[np.ndarray, int] | None = None
) -> tuple[tuple[Word, ...], list[str]]:
    """Read words in order of time, and notes on what was recognised, converted, guessed or odd.

    duration : of the recording in seconds
    sound : mono samples and their rate in Hz, with which a text without times is aligned
    Words outside 0 to `duration` are dropped, words across its ends are clipped; words that end before they start
    are dropped. Raises DataError with the line for anything that cannot be right, and NotATranscript for a file of
    an ending that others share, such as `.json`, that holds something else.
    """
    words, notes, _ = _read(Path(path), duration, sound)
    return words, notes


def read_best(
    paths: Sequence[Path], duration: float, sound: tuple[np.ndarray, int]
) -> tuple[tuple[Word, ...], list[str]]:
    """Read the first usable one of a recording's transcripts, and note which it is and what the others are.

    paths : in the order of `EXTENSIONS`. The first that holds one is taken, but for one whose words share the times of
    whole segments: then a later one that has the times of words. A text without times is taken where there is nothing else.
    """
    notes: list[str] = []
    others: list[Path] = []
    best: tuple[Path, tuple[Word, ...], list[str], bool] | None = None
    for path in paths:
        is_text = path.suffix.lower() in WITHOUT_TIMES
        if best is not None and (is_text or not best[3]):
            others.append(path)
            continue
        try:
            found = (path, *_read(path, duration, sound))
        except NotATranscript as problem:
            notes.append(f"{path.name}: {str(problem).partition(': ')[2]}, and not used")
            continue
        except DataError:
            if best is None:
                raise
            others.append(path)
            continue
        if best is None or not found[3]:
            others += [best[0]] if best is not None else []
            best = found
        else:
            others.append(path)
    if best is None:
        return (), notes
    if others:
        notes.append(f"{best[0].name} is read, and not {', '.join(inputs.shown(other.name) for other in others)}")
    return best[1], notes + best[2]


def _read(
    path: Path, duration: float, sound: tuple[np.ndarray, int] | None
) -> tuple[tuple[Word, ...], list[str], bool]:
    """Read as `read`, and tell whether most words share the time of a segment with others."""
    text, encoding = _decoded(path, inputs.read_bytes(path, MOST_BYTES))
    source = Source(path, text, duration)
    format_ = _recognised(source) if text.strip() else None
    words: tuple[Word, ...] = ()
    segments = False
    if format_ is None:
        notes = [_EMPTY]
    elif format_.read is None:
        words, notes = _aligned(source, sound)
    else:
        found = format_.read(source)
        words, odd = fit(found.cells, duration, found.by_syllables)
        lengths = [len(tokens(cell.text)) for cell in found.cells]
        segments = 2 * sum(length for length in lengths if length > 1) > sum(lengths)
        notes = _read_as(path, format_, found.read_as) + _counted(found.dropped | odd)
        if not words:
            meant = any(tokens(cell.text) for cell in found.cells)
            lost = f"no word of it lies in the audio of {duration:.1f} s; is it another recording's?"
            notes.append(lost if meant else _EMPTY)
    if encoding in _ENCODINGS:
        notes.insert(0, _ENCODINGS[encoding])
    return words, [f"{path.name}: {'; '.join(notes)}"] if notes else [], segments


def _counted(counts: Mapping[str, int]) -> list[str]:
    """Format counts, one text for each kind."""
    return [f"{what}: {count}" for what, count in counts.items()]


def _read_as(path: Path, format_: Format, details: Sequence[str]) -> list[str]:
    """Describe what a file was taken for, unless it is a TSV of the expected form."""
    own = path.suffix.lower() in format_.extensions
    if path.suffix.lower() == ".tsv" and own and not details:
        return []
    name = f"a {format_.name}" if format_.name == "table" else format_.name
    described = f"{name} with {', '.join(details)}" if details else name
    return [f"read as {described}" if own else f"read as {described}, whatever its ending says"]


def align(path: str | Path, samples: np.ndarray, rate: int) -> alignment.Aligned:
    """Align the words of a text without times, as written, with mono `samples`.

    DataError for a text that has times, or none, and as by `alignment.align`.
    """
    path = Path(path)
    text, _ = _decoded(path, inputs.read_bytes(path, MOST_BYTES))
    source = Source(path, text, len(samples) / rate)
    if text.strip() and _recognised(source) is not _TEXT:
        raise source.error("has times already, so there is nothing to align; it is read as it is")
    words, _ = plain.words(source)
    if not words:
        raise source.error("no word in it; write down what is said")
    return alignment.align(words, samples, rate, inputs.shown(path))


def _recognised(source: Source) -> Format:
    """Recognise the format of a text: that of its ending if the content fits, else the first that fits."""
    ending = source.path.suffix.lower()
    own = [one for one in FORMATS if ending in one.extensions]
    # A text without times is whatever is nothing else.
    others = [one for one in FORMATS if one not in own and one is not _TEXT]
    for one in [*others, *own] if own == [_TEXT] else [*own, *others]:
        if one.holds(source.text):
            return one
    if own and own[0].certain:
        return own[0]  # whose reader says in which line it is none
    raise NotATranscript(f"{inputs.shown(source.path)}: neither words with times nor a text, so no transcript")


def _decoded(path: Path, raw: bytes) -> tuple[str, str]:
    """Decode a file to text and name its encoding; raises DataError for binary data."""
    encoding = "utf-8-sig"
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        encoding = "utf-16"
    elif b"\0" in raw[:200]:
        half = len(raw[:200]) // 2 * 0.9
        encoding = next(
            (name for name, at in (("utf-16-le", 1), ("utf-16-be", 0)) if raw[at:200:2].count(0) >= half), encoding
        )
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError:
        if encoding != "utf-8-sig":
            raise DataError(f"{inputs.shown(path)}: damaged text in UTF-16; save it again as UTF-8") from None
        text, encoding = raw.decode("latin-1"), "latin-1"
    if text.startswith(_LFS):
        raise DataError(f"{inputs.shown(path)}: a Git LFS pointer, not the file itself; run `git lfs pull`")
    if "\0" in text:
        raise DataError(f"{inputs.shown(path)}: binary data, not a transcript; expected start<TAB>end<TAB>text lines")
    return text.removeprefix("\ufeff"), "utf-16" if encoding.startswith("utf-16") else encoding


def _aligned(source: Source, sound: tuple[np.ndarray, int] | None) -> tuple[tuple[Word, ...], list[str]]:
    """Align a text without times; where that cannot be done here, return no words and a note."""
    written, marks = plain.words(source)
    missing = alignment.missing()
    if sound is None or missing is not None:
        what = missing or "run `gesturegen align`"
        return (), [f"a text without times, so its words are not used; {what}"]
    found = alignment.align(written, *sound, what=inputs.shown(source.path))
    words, odd = fit(found.cells, source.duration)
    odd |= {"marks such as [laughter], passed over": marks} if marks else {}
    return words, [f"a text without times, aligned with the sound{found.described()}", *_counted(odd)]

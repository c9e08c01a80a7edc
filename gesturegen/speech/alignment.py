"""Forced alignment of English text with speech, by pocketsphinx and the model in its wheel.

Words that the model's dictionary does not have are put together from parts that it has, spelled, or pronounced by rule.
Needs the extra `align`; nothing is downloaded.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gesturegen import inputs
from gesturegen.compiled import load_librosa
from gesturegen.errors import DataError
from gesturegen.extras import need
from gesturegen.speech import pronunciation
from gesturegen.speech.transcript import Cell, normalize, share_out

if TYPE_CHECKING:
    import pocketsphinx

EXTRA = "align"
_NEEDED = ("pocketsphinx", "inflect")
RATE = 16000
_FRAMES_PER_SECOND = 100
# The default beams, and wider ones for where they lose the way.
_BEAMS: tuple[dict[str, float], ...] = (
    {},
    {"beam": 1e-80, "wbeam": 1e-60, "pbeam": 1e-80},
    {"beam": 1e-120, "wbeam": 1e-100, "pbeam": 1e-120},
)
# A text of so few words a minute may lack some that are said.
_FEW_WORDS_A_MINUTE = 60
# Nobody says more; a text of more would take long to be refused.
_MOST_WORDS_A_SECOND, _MORE_WORDS = 10, 10
# Longer recordings are aligned in pieces, each with the next so many words; of the end of a piece little is sure.
_LONG_SECONDS, _PIECE_SECONDS, _UNSURE_SECONDS, _MOST_WORDS = 100.0, 60.0, 10.0, 300
_MOST_NAMED = 8
# What pocketsphinx adds to a word's second, third, ... pronunciation.
_ALTERNATIVE = re.compile(r"\([0-9]+\)$")


@dataclass(frozen=True)
class Aligned:
    """Words with their times, as written, in order.

    pace : words a minute of sound; wide : whether the default beams lost the way; by_rule : words whose pronunciation is a guess
    spread : words that cannot be pronounced and were placed between their neighbours
    """

    cells: list[Cell]
    pace: float
    wide: bool
    by_rule: tuple[str, ...]
    spread: tuple[str, ...]

    def described(self) -> str:
        """Describe what was guessed, as the end of a line."""
        texts = ["with wide beams"] if self.wide else []
        texts += [f"pronounced by rule: {_named(self.by_rule)}"] if self.by_rule else []
        texts += [f"placed between their neighbours: {_named(self.spread)}"] if self.spread else []
        few = self.pace < _FEW_WORDS_A_MINUTE
        texts += [f"only {self.pace:.0f} words a minute; is the text that of all that is said?"] if few else []
        return "".join(f"; {text}" for text in texts)


def _named(words: Sequence[str]) -> str:
    """Format a list of words, cut after the first eight."""
    more = f" and {len(words) - _MOST_NAMED} more" if len(words) > _MOST_NAMED else ""
    return inputs.shown(", ".join(words[:_MOST_NAMED])) + more


def missing() -> str | None:
    """Describe what to install before `align` can be called; None where everything is installed."""
    if all(importlib.util.find_spec(module) is not None for module in _NEEDED):
        return None
    return f"to have it aligned, run: pip install 'gesturegen[{EXTRA}]'"


def version() -> str:
    """Name the aligner and its version, for stored files that depend on it; empty where it is not installed."""
    return "" if missing() else f"pocketsphinx {importlib.metadata.version('pocketsphinx')}"


def to_pcm(samples: np.ndarray, rate: int) -> bytes:
    """Convert mono samples to the format of pocketsphinx: 16 bits, 16 kHz, scaled to full amplitude."""
    if rate != RATE:
        samples = load_librosa().resample(samples, orig_sr=rate, target_sr=RATE)
    loudest = float(np.abs(samples).max(initial=0.0))
    scale = 0.95 / loudest if loudest > 0 else 1.0
    return np.round(samples * scale * 32767).astype("<i2").tobytes()


def align(words: Sequence[str], samples: np.ndarray, rate: int, what: str) -> Aligned:
    """Align the words of a text with the sound of it.

    words : as they are written; samples : mono, at `rate` Hz; what : file to name in errors
    DataError where the text does not fit the sound, and where the extra is not installed.
    """
    need("pocketsphinx", EXTRA)
    words = [word for word in words if normalize(word)]
    if not words:
        return Aligned([], 0.0, False, (), ())
    seconds, pcm = len(samples) / rate, to_pcm(samples, rate)
    fits = len(words) <= _MOST_WORDS_A_SECOND * seconds + _MORE_WORDS
    for beams in _BEAMS if fits else ():
        decoder, entries, by_rule = _decoder(words, beams)
        said = {place: entry for place, entry in enumerate(entries) if entry is not None}
        if not said:
            raise DataError(f"{what}: no word of it can be pronounced as English; give a transcript with times")
        times = _times(decoder, list(said.values()), pcm)
        if times is not None:
            cells, spread = _all(words, dict(zip(said, times, strict=True)), seconds)
            return Aligned(cells, 60 * len(words) / seconds, bool(beams), by_rule, spread)
    raise DataError(
        f"{what}: its {len(words)} words cannot be found in {seconds:.1f} s of sound; is it the text of this recording, "
        "in English, word for word? Correct it, or give a transcript with times"
    )


def recognise(samples: np.ndarray, rate: int) -> list[Cell]:
    """Recognise English words in mono samples at `rate` Hz by pocketsphinx; of real speech many are wrong."""
    pocketsphinx = need("pocketsphinx", EXTRA)
    decoder = pocketsphinx.Decoder(samprate=RATE, loglevel="FATAL")
    decoder.start_utt()
    decoder.process_raw(to_pcm(samples, rate), no_search=False, full_utt=True)
    decoder.end_utt()
    if decoder.hyp() is None:
        return []
    return [
        Cell(segment.start_frame / _FRAMES_PER_SECOND, (segment.end_frame + 1) / _FRAMES_PER_SECOND, word)
        for segment in decoder.seg() or ()
        if (word := _ALTERNATIVE.sub("", segment.word)) and not word.startswith(("<", "[", "("))
    ]


def _decoder(
    words: Sequence[str], beams: dict[str, float]
) -> tuple[pocketsphinx.Decoder, list[str | None], tuple[str, ...]]:
    """Set up pocketsphinx with a pronunciation for each word.

    Returns the decoder, its entries (None for a word that cannot be pronounced), and words with guessed pronunciations.
    """
    pocketsphinx = need("pocketsphinx", EXTRA)
    decoder = pocketsphinx.Decoder(samprate=RATE, loglevel="FATAL", lm=None, **beams)
    entries: list[str | None] = []
    known: dict[str, str | None] = {}
    by_rule: list[str] = []
    for word in words:
        bare = normalize(word)
        if word not in known:
            if decoder.lookup_word(bare) is not None:
                known[word] = bare
            else:
                ways, guessed = pronunciation.pronounce(word, decoder.lookup_word)
                # No word of the dictionary has such a name.
                entry = f"word-{len(known)}"
                for number, way in enumerate(ways, 1):
                    decoder.add_word(entry if number == 1 else f"{entry}({number})", way, False)
                known[word] = entry if ways else None
                by_rule += [bare] if guessed and bare not in by_rule else []
        entries.append(known[word])
    return decoder, entries, tuple(by_rule)


def _times(decoder: pocketsphinx.Decoder, entries: Sequence[str], pcm: bytes) -> list[tuple[float, float]] | None:
    """Align entries: start and end of each in seconds; None where the decoder does not reach the end of the text.

    A text of many words takes a time in proportion to its square, so a long recording is aligned piece by piece: of each
    piece with more text than it can hold, all is kept but the end, where the next one begins.
    """
    found: list[tuple[float, float]] = []
    begin, seconds = 0.0, len(pcm) / (2 * RATE)
    while seconds - begin > _LONG_SECONDS:
        following = entries[len(found) : len(found) + _MOST_WORDS]
        own = _segments(decoder, following, pcm[_byte(begin) : _byte(begin + _PIECE_SECONDS)], whole=False)
        kept = [(start, end) for start, end in own or () if end <= _PIECE_SECONDS - _UNSURE_SECONDS]
        if not kept or len(found) + len(kept) == len(entries):
            break  # silence, or the end of the text
        found += [(begin + start, begin + end) for start, end in kept]
        begin = found[-1][1]
    rest = _segments(decoder, entries[len(found) :], pcm[_byte(begin) :], whole=True)
    return None if rest is None else found + [(begin + start, begin + end) for start, end in rest]


def _byte(seconds: float) -> int:
    """Convert seconds to a place in 16-bit samples, in bytes."""
    return 2 * round(seconds * RATE)


def _segments(
    decoder: pocketsphinx.Decoder, entries: Sequence[str], pcm: bytes, whole: bool
) -> list[tuple[float, float]] | None:
    """Align entries with one stretch of sound: start and end in seconds.

    whole : whether all entries must be in the sound; else those that are count, from the first on
    """
    decoder.set_align_text(" ".join(entries))
    decoder.start_utt()
    decoder.process_raw(pcm, no_search=False, full_utt=True)
    # Before its end, an utterance has the best path so far.
    read = None if whole else _read(decoder)
    decoder.end_utt()
    read = _read(decoder) if whole else read
    if (
        read is None
        or [word for word, _, _ in read] != list(entries)[: len(read)]
        or (whole and len(read) < len(entries))
    ):
        return None
    return [(start / _FRAMES_PER_SECOND, end / _FRAMES_PER_SECOND) for _, start, end in read]


def _read(decoder: pocketsphinx.Decoder) -> list[tuple[str, int, int]] | None:
    """Read the decoder's entries with their first frame and the frame after their last."""
    if decoder.hyp() is None:
        return None
    return [
        (_ALTERNATIVE.sub("", segment.word), segment.start_frame, segment.end_frame + 1)
        for segment in decoder.seg() or ()
        if not segment.word.startswith(("<", "[", "("))
    ]


def _all(
    words: Sequence[str], times: dict[int, tuple[float, float]], seconds: float
) -> tuple[list[Cell], tuple[str, ...]]:
    """Make a cell for each word; words without times are put between their neighbours, by syllables."""
    cells: list[Cell] = []
    spread: list[str] = []
    waiting: list[str] = []
    for place in range(len(words) + 1):
        if place < len(words) and place not in times:
            waiting.append(words[place])
            continue
        start, end = times.get(place, (seconds, seconds))
        if waiting:
            before = cells[-1].end if cells else 0.0
            cells += share_out(before, max(start, before), waiting, True)
            spread += [normalize(word) for word in waiting]
            waiting = []
        if place < len(words):
            cells.append(Cell(start, min(end, seconds), words[place]))
    return cells, tuple(dict.fromkeys(spread))

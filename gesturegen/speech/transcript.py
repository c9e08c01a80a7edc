"""Words with their times, and the frames they cover; `transcripts/` reads them from files.

`#` marks laughter and is no word; a stretch of time with several words is shared among them.
"""

from __future__ import annotations

import itertools
import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

# Times in files are often a hair below the frame they mean (0.3 * 30 is 8.999...).
_FRAME_SLACK = 1e-6
_VOWELS = re.compile("[aeiouy]+")


@dataclass(frozen=True)
class Word:
    """A word, lower-cased and without punctuation, from `start` to `end` in seconds."""

    text: str
    start: float
    end: float

    def frames(self, fps: float) -> tuple[int, int]:
        """Return the half-open range of frames the word covers, at least one."""
        start = int(np.floor(self.start * fps + _FRAME_SLACK))
        return start, max(int(np.floor(self.end * fps + _FRAME_SLACK)), start + 1)


class Cell(NamedTuple):
    """A stretch of a transcript from `start` to `end` in seconds: a word or several, with punctuation."""

    start: float
    end: float
    text: str


def normalize(text: str) -> str:
    """Reduce a word to lower case without punctuation but inner apostrophes and hyphens; empty for laughter."""
    return re.sub(r"[^\w'-]|_", "", text.lower().replace("\N{RIGHT SINGLE QUOTATION MARK}", "'")).strip("'-")


def tokens(text: str) -> list[str]:
    """List the bare words of a text, in order."""
    return [token for token in map(normalize, text.split()) if token]


def syllables(word: str) -> int:
    """Estimate the syllables of a bare word, at least one: groups of vowels, without a silent final e."""
    plain = unicodedata.normalize("NFD", word)
    count = len(_VOWELS.findall(plain)) + sum(map(str.isdigit, plain))
    if plain.endswith("e") and not plain.endswith(("le", "ee", "ie", "ye")):
        count -= 1
    return max(count, 1)


def share_out(start: float, end: float, words: Iterable[str], by_syllables: bool) -> list[Cell]:
    """Divide the time from `start` to `end` among words: by their syllables, or in equal parts. Returns a cell each."""
    words = list(words)
    shares = [syllables(word) for word in words] if by_syllables else [1] * len(words)
    ends = list(itertools.accumulate(shares, initial=0))
    total = ends[-1]
    return [
        Cell(start + (end - start) * before / total, start + (end - start) * after / total, word)
        for word, before, after in zip(words, ends, ends[1:], strict=False)
    ]


def fit(cells: Iterable[Cell], duration: float, by_syllables: bool = False) -> tuple[tuple[Word, ...], dict[str, int]]:
    """Fit the words of cells into a recording, in order of time, and count how many were odd, by the kind of oddity.

    duration : of the recording in seconds. Words outside are dropped, words across its ends are clipped; words that
    end before they start are dropped.
    """
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
        bare = tokens(text)
        if end < start:
            counts[reversed_] += len(bare)
            continue
        for from_, to, token in share_out(start, end, bare, by_syllables):
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
    return tuple(words), {what: count for what, count in counts.items() if count}

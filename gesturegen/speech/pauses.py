"""Pauses: stretches in which neither a word nor an onset nor a voice is heard for a while."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesturegen.runs import runs
from gesturegen.settings.speech import Phrases
from gesturegen.speech.transcript import Word

# A gap of exactly the limit, in frames, is no pause, whatever the rounding of the limit.
_FRAME_SLACK = 1e-6
# Of times, which are read from text.
_TIME_SLACK = 1e-9


def speaking_frames(
    words: Sequence[Word], onset_frames: np.ndarray, n_frames: int, fps: float, min_seconds: float,
    voice: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Tell which frames lie outside pauses: runs of over `min_seconds` without a word, an onset and voice.

    Returns bool `[shape=(n_frames,)]`.

    voice : seconds `[shape=(S, 2)]` in which somebody is heard to speak, whatever the words are; None for none

    Runs at the beginning and at the end count as well, and so does a speech in which nothing at all is heard.
    """
    heard = np.zeros(n_frames, dtype=bool)
    for word in words:
        start, end = word.frames(fps)
        heard[max(start, 0) : max(end, 0)] = True
    for start, end in np.zeros((0, 2)) if voice is None else voice:
        heard[max(int(np.floor(start * fps)), 0) : int(np.ceil(end * fps))] = True
    heard[onset_frames] = True
    speaking = np.ones(n_frames, dtype=bool)
    for start, end in runs(~heard):
        if end - start > min_seconds * fps + _FRAME_SLACK:
            speaking[start:end] = False
    return speaking


def phrase_ends(words: Sequence[Word], settings: Phrases, voice: np.ndarray | None = None) -> np.ndarray:
    """Find the times in seconds, ascending, of phrase ends: ends of words that no other word follows soon.

    A gap of over `min_gap_seconds` ends a phrase, and so does the last word. Words of several speakers may overlap.
    voice : seconds `[shape=(S, 2)]` in which somebody is heard to speak, which stand in for words where there is none
    """
    spoken = sorted((word.start, word.end) for word in words)
    spoken = spoken or sorted(map(tuple, [] if voice is None else voice.tolist()))
    ends = np.maximum.accumulate([end for _, end in spoken]) if spoken else np.zeros(0)
    starts = np.array([start for start, _ in spoken[1:]])
    return ends[np.append(starts - ends[:-1] > settings.min_gap_seconds + _TIME_SLACK, True)] if spoken else ends

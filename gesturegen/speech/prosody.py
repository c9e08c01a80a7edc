"""Loudness and pitch of the voice over time.

The question answered: how loud and how high is the voice at each moment, and is it voiced at all? Pitch is
librosa's pYIN (Mauch and Dixon 2014) on the whole clip, never on crops: its path through voiced and unvoiced
frames depends on what comes before and after.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesturegen.compiled import load_librosa
from gesturegen.motion.skeleton import read_only
from gesturegen.settings.speech import Prosody

# Nothing in a recording is heard below this level, and the logarithm of digital silence is not finite.
_FLOOR_DB = -80.0
# Seconds of sound that one value looks at: some eight periods of a deep voice, and no longer than a syllable.
_WINDOW_SECONDS = 0.128
# Semitones between the pitches pYIN tells apart; librosa's 0.1 takes four times as long.
_RESOLUTION = 0.2
# Octaves per second a voice may glide, librosa's default.
_FASTEST_GLIDE = 35.92


@dataclass(frozen=True, eq=False)
class Contour:
    """Loudness and pitch of a clip; value k is that of the time k / rate.

    energy : float [shape=(T,)], dB of full scale, at least -80
    pitch : float [shape=(T,)], semitones above 1 Hz, NaN where the voice is silent or unvoiced
    rate : values per second
    """

    energy: np.ndarray
    pitch: np.ndarray
    rate: float

    def __post_init__(self) -> None:
        for name in ("energy", "pitch"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        if self.energy.ndim != 1 or self.energy.shape != self.pitch.shape or len(self.energy) == 0:
            raise ValueError(f"energy {self.energy.shape} and pitch {self.pitch.shape} do not fit together")


def measure(samples: np.ndarray, rate: int, settings: Prosody) -> Contour:
    """Measure loudness and pitch of mono `samples` `[shape=(n,)]` at `rate` Hz, every `hop_length` samples.

    Audio shorter than the analysis window (0.128 s) is padded with silence to that length.
    """
    librosa = load_librosa()

    samples = np.asarray(samples, dtype=np.float32)
    if rate != settings.sample_rate:
        samples = librosa.resample(samples, orig_sr=rate, target_sr=settings.sample_rate)
    window = _window(settings)
    if len(samples) < window:
        samples = np.pad(samples, (0, window - len(samples)))
    frames = {"frame_length": window, "hop_length": settings.hop_length}
    loudness = librosa.feature.rms(y=samples, **frames)[0].astype(np.float64)
    hertz, _, _ = librosa.pyin(
        samples,
        sr=settings.sample_rate,
        fmin=settings.pitch_min,
        fmax=settings.pitch_max,
        resolution=_RESOLUTION,
        max_transition_rate=_glide(settings),
        **frames,
    )
    return Contour(
        energy=20 * np.log10(np.maximum(loudness, 10 ** (_FLOOR_DB / 20))),
        pitch=12 * np.log2(hertz),
        rate=settings.sample_rate / settings.hop_length,
    )


def _window(settings: Prosody) -> int:
    """Compute the length of the analysis window in samples: a power of two of two or more periods of the lowest pitch."""
    usual = round(np.log2(_WINDOW_SECONDS * settings.sample_rate))
    needed = int(np.ceil(np.log2(2 * settings.sample_rate / settings.pitch_min + 2)))
    return 2 ** max(usual, needed)


def _glide(settings: Prosody) -> float:
    """Return the octaves per second the pitch may glide: pYIN refuses more between two values than the whole range."""
    whole_range = np.floor(12 * np.log2(settings.pitch_max / settings.pitch_min))
    return min(_FASTEST_GLIDE, whole_range / 12 * settings.sample_rate / settings.hop_length)

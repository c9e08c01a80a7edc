"""Acoustic features of the voice over time, as k-NN motion matching compares them (Habibie et al. 2022, §3.1.1).

The question answered: which 13 mel-frequency cepstral coefficients and which energy does the voice have at each
moment? They are measured on the whole clip, never on crops: librosa cuts off what is 80 dB below the loudest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesturegen.compiled import load_librosa
from gesturegen.motion.skeleton import read_only
from gesturegen.settings.speech import Acoustics as Settings

# Samples that one value looks at: 93 ms at 22050 Hz.
_WINDOW = 2048
# Of the mean square; the logarithm of digital silence is not finite. librosa's mel powers have the same floor.
_FLOOR = 1e-10


@dataclass(frozen=True, eq=False)
class Acoustics:
    """Acoustic features of a clip; value k is that of the time k / rate.

    values : float32 [shape=(T, coefficients + 1)], MFCC and the natural logarithm of the mean square, last
    rate : values per second
    """

    values: np.ndarray
    rate: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", read_only(np.asarray(self.values, dtype=np.float32)))
        if self.values.ndim != 2 or 0 in self.values.shape:
            raise ValueError(f"values have shape {self.values.shape}, expected one of each kind or more")


def measure(samples: np.ndarray, rate: int, settings: Settings) -> Acoustics:
    """Compute MFCC and log mean energy of mono `samples` `[shape=(n,)]` at `rate` Hz, `settings.rate` values a second.

    Value k looks at the 2048 samples around k / settings.rate, with silence beyond the ends. Audio shorter than
    that is padded with silence to that length.
    """
    librosa = load_librosa()

    samples = np.asarray(samples, dtype=np.float32)
    if rate != settings.sample_rate:
        samples = librosa.resample(samples, orig_sr=rate, target_sr=settings.sample_rate)
    if len(samples) < _WINDOW:
        samples = np.pad(samples, (0, _WINDOW - len(samples)))
    hop = settings.sample_rate // settings.rate
    coefficients = librosa.feature.mfcc(
        y=samples, sr=settings.sample_rate, n_mfcc=settings.coefficients, n_fft=_WINDOW, hop_length=hop
    )
    squares = np.square(librosa.feature.rms(y=samples, frame_length=_WINDOW, hop_length=hop).astype(np.float64))
    energy = np.log(np.maximum(squares, _FLOOR))
    return Acoustics(np.concatenate([coefficients, energy]).T, float(settings.rate))

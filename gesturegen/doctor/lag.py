"""Does the sound of a recording lie where its motion does? Lag and drift between them.

Who speaks gestures: hands are faster while somebody speaks than in pauses, and strokes fall on stressed syllables. So
the speed of the hands is correlated with the voice and with its onsets, at every lag of up to 8 s. Over a minute that
tells a lag only where a speaker rests in his pauses; where it does not stand out, or the two disagree, nothing is said.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import correlate

LARGEST_LAG_SECONDS = 8.0
# Curves are smoothed by so much, and what changes more slowly than a minute's part is left out.
_SMOOTHING_SECONDS, _SLOW_SECONDS = 0.2, 2.0
# cm/s; below it, hands are as good as still.
_REST_SPEED = 3.0
# A lag is told where the correlation is as high, and as much higher than at any other peak a second or more away.
_LEAST_CORRELATION, _LEAST_MARGIN = 0.45, 0.12
# Seconds by which the lags of the voice and of its onsets may differ.
_AGREEING_SECONDS = 0.5
_SHORTEST_SECONDS = 20.0
# A drift is told where the correlation is as high, and as much higher than without one; clocks and frame rates that
# somebody mixed up (29.97 for 30, 24 for 25) differ by less than this share.
_DRIFT_STEP_SECONDS, _LEAST_DRIFT_CORRELATION, _LEAST_DRIFT_MARGIN, _LARGEST_DRIFT_SHARE = 0.25, 0.5, 0.08, 0.05


@dataclass(frozen=True)
class Lag:
    """The lag of the motion behind the sound in seconds, and the correlation there; `sure` if it stands out."""

    seconds: float
    correlation: float
    sure: bool


def measure(speaking: np.ndarray, onset_times: np.ndarray, hand_speeds: np.ndarray, fps: float) -> Lag | None:
    """Measure the lag of a recording; None where it is too short, or either of sound and motion never changes.

    speaking : bool [shape=(T,)], whether somebody speaks; onset_times : seconds [shape=(K,)]
    hand_speeds : float [shape=(T,)], cm/s
    """
    n = min(len(speaking), len(hand_speeds))
    if n < _SHORTEST_SECONDS * fps:
        return None
    energy = _curve(np.log(np.asarray(hand_speeds[:n], dtype=np.float64) + _REST_SPEED), fps)
    voice = _curve(np.asarray(speaking[:n], dtype=np.float64), fps)
    if not (energy.any() and voice.any()):
        return None
    frames = np.round(np.asarray(onset_times) * fps).astype(int)
    onsets = _curve(np.bincount(frames[(frames >= 0) & (frames < n)], minlength=n).astype(np.float64), fps)
    seconds, correlation, margin = _best(voice, energy, fps)
    agree = onsets.any() and abs(_best(onsets, energy, fps)[0] - seconds) <= _AGREEING_SECONDS
    return Lag(seconds, correlation, bool(agree and correlation >= _LEAST_CORRELATION and margin >= _LEAST_MARGIN))


def drift(speaking: np.ndarray, onset_times: np.ndarray, hand_speeds: np.ndarray, fps: float) -> float | None:
    """Measure the seconds by which the motion falls behind the sound from beginning to end; None where it is not sure.

    The sound is played slower and faster, so that it gets up to 8 s, or a twentieth, longer or shorter; what correlates best counts
    where it does so clearly better than the sound as it is, for the voice and for its onsets alike.
    """
    n = min(len(speaking), len(hand_speeds))
    if n < _SHORTEST_SECONDS * fps:
        return None
    energy = _curve(np.log(np.asarray(hand_speeds[:n], dtype=np.float64) + _REST_SPEED), fps)
    frames = np.round(np.asarray(onset_times) * fps).astype(int)
    onsets = np.bincount(frames[(frames >= 0) & (frames < n)], minlength=n).astype(np.float64)
    heard = [_curve(values, fps) for values in (np.asarray(speaking[:n], dtype=np.float64), onsets)]
    if not (energy.any() and all(curve.any() for curve in heard)):
        return None
    most = int(min(LARGEST_LAG_SECONDS, _LARGEST_DRIFT_SHARE * n / fps) / _DRIFT_STEP_SECONDS)
    drifts = np.arange(-most, most + 1) * _DRIFT_STEP_SECONDS
    stretched = [np.arange(n) / (1 + seconds * fps / n) for seconds in drifts]
    voice, beats = (
        np.array([_highest(np.interp(times, np.arange(n), curve, right=0.0), energy, fps) for times in stretched])
        for curve in heard
    )
    best = int(voice.argmax())
    clear = voice[best] >= _LEAST_DRIFT_CORRELATION and voice[best] - voice[most] >= _LEAST_DRIFT_MARGIN
    agree = abs(drifts[int(beats.argmax())] - drifts[best]) <= 2 * _AGREEING_SECONDS
    return float(drifts[best]) if clear and agree else None


def _highest(heard: np.ndarray, moved: np.ndarray, fps: float) -> float:
    """Compute the highest correlation of two curves at any lag."""
    most = round(LARGEST_LAG_SECONDS * fps)
    scores = correlate(moved, heard, "full", "fft")[len(heard) - 1 - most : len(heard) + most]
    norm = np.sqrt(np.dot(heard, heard) * np.dot(moved, moved))
    return float(scores.max() / norm) if norm > 0 else 0.0


def _curve(values: np.ndarray, fps: float) -> np.ndarray:
    """Smooth `values` and remove slow changes; zeros where they do not change."""
    if np.ptp(values) == 0:
        return np.zeros(len(values))
    smooth = gaussian_filter1d(values, _SMOOTHING_SECONDS * fps)
    found = smooth - gaussian_filter1d(smooth, _SLOW_SECONDS * fps)
    return found - found.mean()


def _best(heard: np.ndarray, moved: np.ndarray, fps: float) -> tuple[float, float, float]:
    """Find the lag in seconds with the highest correlation.

    Returns the lag, its correlation, and by how much that exceeds those over a second away.
    """
    most = min(round(LARGEST_LAG_SECONDS * fps), len(heard) // 3)
    lags = np.arange(-most, most + 1)
    scores = np.array([_correlation(heard, moved, lag) for lag in lags.tolist()])
    best = int(scores.argmax())
    others = scores[np.abs(lags - lags[best]) >= fps]
    return float(lags[best] / fps), float(scores[best]), float(scores[best] - others.max(initial=-1.0))


def _correlation(heard: np.ndarray, moved: np.ndarray, lag: int) -> float:
    """Correlate two curves at one lag in frames."""
    n = len(heard)
    one, other = heard[max(-lag, 0) : n - max(lag, 0)], moved[max(lag, 0) : n - max(-lag, 0)]
    norm = np.sqrt(np.dot(one, one) * np.dot(other, other))
    return float(np.dot(one, other) / norm) if norm > 0 else 0.0

"""Curves in time: minimum-jerk moves laid one over the other, and band-limited noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt


@dataclass(frozen=True, eq=False)
class Move:
    """A move to `target` `[shape=(K,)]` between two times in seconds, bulging by `arc` `[shape=(K,)]` midway."""

    start: float
    end: float
    target: np.ndarray
    arc: np.ndarray


def follow(times: np.ndarray, base: np.ndarray, moves: list[Move]) -> np.ndarray:
    """Compute the curve `[shape=(T, K)]` that starts at `base` and makes `moves` one after the other.

    Each move adds its difference from the previous target on a minimum-jerk profile 10 s^3 - 15 s^4 + 6 s^5
    (Flash and Hogan 1985), so moves that overlap in time blend and nothing ever snaps.
    """
    values = np.tile(np.asarray(base, dtype=np.float64), (len(times), 1))
    previous = base
    for move in moves:
        first, last = np.searchsorted(times, (move.start, move.end))
        s = ((times[first:last] - move.start) / (move.end - move.start))[:, None]
        delta = move.target - previous
        values[first:last] += delta * s**3 * (10.0 + s * (6.0 * s - 15.0)) + move.arc * 64.0 * (s * (1.0 - s)) ** 3
        values[last:] += delta
        previous = move.target
    return values


def bumps(times: np.ndarray, centres: np.ndarray, heights: np.ndarray, width: float) -> np.ndarray:
    """Sum Gaussian bumps `[shape=(T,)]` at `centres` seconds with standard deviation `width` seconds."""
    values = np.zeros(len(times))
    for centre, height in zip(centres, heights, strict=True):
        first, last = np.searchsorted(times, (centre - 4.0 * width, centre + 4.0 * width))
        values[first:last] += height * np.exp(-0.5 * ((times[first:last] - centre) / width) ** 2)
    return values


def smooth_noise(rng: np.random.Generator, n: int, fps: float, cutoff: float, columns: int) -> np.ndarray:
    """Draw noise `[shape=(n, columns)]` below `cutoff` Hz, standard deviation about 1."""
    pad = round(2.0 * fps / cutoff)
    sections = butter(2, cutoff, fs=fps, output="sos")
    noise = sosfiltfilt(sections, rng.standard_normal((n + 2 * pad, columns)), axis=0)[pad : pad + n]
    # White noise of variance 1 keeps this share of it after a second-order low-pass run both ways.
    return noise / np.sqrt(0.83 * 2.0 * cutoff / fps)


def paced_noise(rng: np.random.Generator, pace: np.ndarray, fps: float, cutoff: float, columns: int) -> np.ndarray:
    """Draw smooth noise `[shape=(T, columns)]` that passes at `pace` `[shape=(T,)]` times the usual speed."""
    n = len(pace)
    noise = smooth_noise(rng, n, fps, cutoff, columns)
    places = np.cumsum(pace) - pace[0]
    return np.stack([np.interp(places, np.arange(n), column) for column in noise.T], axis=1)


def smooth_gate(times: np.ndarray, closed: tuple[tuple[float, float], ...], flank: float) -> np.ndarray:
    """Compute a gate: 0 inside the `closed` intervals (seconds), else 1, with minimum-jerk flanks inside them."""
    gate = np.ones(len(times))
    for start, end in closed:
        s = np.clip(np.minimum((times - start) / flank, (end - times) / flank), 0.0, 1.0)
        gate *= 1.0 - s**3 * (10.0 + s * (6.0 * s - 15.0))
    return gate

"""Do gestures peak where the speech does? Beat consistency (BC).

Source: §5.2, Table 2 ("the mean distance between the audio onsets and the nearest peaks of angle change
rate"), after its [11], Li et al. 2022 (DanceFormer); angle change rate and kernel as in Liu et al. 2022
(HA2G). The paper prints 0.022 with an arrow upwards; that fits neither reading, so both are computed and
neither is claimed to match:
`beat_distance` (seconds, lower is better) and `beat_kernel` (0 to 1, higher is better).

Conventions
- The direction of joint j is u_j(t) = (p_j - p_parent) / ||p_j - p_parent||, the parent being the nearest one
  among the selected joints; theta_j(t) is the angle between u_j(t - 1) and u_j(t).
- The rate of frame t is the mean of theta_j(t) over joints, times fps: radians per second. A beat at frame t
  has the time t / fps.
- Beats are local maxima, as the paper says. HA2G takes local extrema, so `extrema` can ask for minima or
  both.
- The distance goes from each onset to its nearest beat, never the other way: many beats make it small, so
  read it beside the number of beats.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import find_peaks

# Joints whose files put them at their parent's place (GENEA's arm_twist) have a direction made of rounding
# errors.
SHORTEST_SHARE_OF_LONGEST = 1e-4


def selected_parents(parents: np.ndarray | Sequence[int], joints: np.ndarray | Sequence[int]) -> np.ndarray:
    """Find, for each of `joints`, the place in `joints` of its nearest ancestor among them, -1 for none.

    parents : int [shape=(J,)], parent of every joint of the skeleton, -1 for the root
    joints : int [shape=(K,)], the selected joints as numbers in the skeleton
    Returns int [shape=(K,)], which `angle_change_rate` takes as `parents`.
    """
    places = {int(joint): place for place, joint in enumerate(joints)}
    found = []
    for joint in joints:
        ancestor = int(parents[joint])
        while ancestor >= 0 and ancestor not in places:
            ancestor = int(parents[ancestor])
        found.append(places.get(ancestor, -1))
    return np.array(found, dtype=np.int64)


def angle_change_rate(positions: ArrayLike, parents: ArrayLike, *, fps: float) -> np.ndarray:
    """Compute the mean angle by which the bone directions turn from the frame before, per second.

        rate(t) = fps * mean over j of acos(u_j(t) . u_j(t - 1))

    computed as atan2(||a x b||, a . b), since acos loses half the digits for the small angles between frames.

    positions : float [shape=(T, K, 3)], cm
    parents : int [shape=(K,)], place of each joint's parent among the K joints, -1 for none
        (`selected_parents`)
    fps : frames per second
    Returns float64 [shape=(T,)], rad/s. NaN at frame 0, which has no frame before it, and at frames without
    any usable direction. A direction shorter than 1e-4 of the longest is left out of the mean.
    Raises ValueError when `parents` does not fit the joints.
    """
    positions = np.asarray(positions, dtype=np.float64)
    parents = np.asarray(parents, dtype=np.int64)
    if positions.ndim != 3 or parents.shape != positions.shape[1:2] or np.any(parents >= len(parents)):
        raise ValueError(f"positions {positions.shape} and parents {parents.shape} do not fit together")
    rates = np.full(len(positions), np.nan)
    children = np.flatnonzero(parents >= 0)
    if len(positions) < 2 or not len(children):
        return rates
    directions = positions[:, children] - positions[:, parents[children]]
    lengths = np.linalg.norm(directions, axis=-1)
    long_enough = (lengths > SHORTEST_SHARE_OF_LONGEST * lengths.max()) & (lengths > 0)
    before, after = directions[:-1], directions[1:]
    # The angle needs no normalising: both arguments of atan2 carry the same factor ||a|| ||b||.
    angles = np.arctan2(np.linalg.norm(np.cross(before, after), axis=-1), np.sum(before * after, axis=-1))
    usable = long_enough[:-1] & long_enough[1:]
    counts = usable.sum(axis=1)
    sums = np.where(usable, angles, 0.0).sum(axis=1)
    rates[1:][counts > 0] = sums[counts > 0] / counts[counts > 0] * fps
    return rates


def motion_beats(rates: ArrayLike, *, fps: float, extrema: str = "maxima", min_prominence: float = 1e-6) -> np.ndarray:
    """Find the times of the local extrema of the angle change rate.

    rates : float [shape=(T,)], rad/s, as `angle_change_rate` gives them
    fps : frames per second
    extrema : `maxima` (the paper's peaks), `minima`, or `both` (HA2G's extrema)
    min_prominence : rad/s by which a peak must stand out; the default only keeps out rounding errors
    Returns float64 [shape=(B,)], seconds, ascending; empty where nothing peaks. A level stretch counts once,
    at its middle (the earlier of two middle frames); the first and last frames and those beside a NaN are no
    extrema.
    Raises ValueError for another word in `extrema`.
    """
    signs = {"maxima": (1.0,), "minima": (-1.0,), "both": (1.0, -1.0)}
    if extrema not in signs:
        raise ValueError(f"extrema is {extrema!r}, expected one of {', '.join(signs)}")
    rates = np.asarray(rates, dtype=np.float64)
    frames = [find_peaks(sign * rates, prominence=min_prominence)[0] for sign in signs[extrema]]
    return np.sort(np.concatenate(frames)) / fps


def beat_distance(onset_times: ArrayLike, beat_times: ArrayLike) -> float:
    """Compute BC as a distance: mean over audio onsets of the time to the nearest motion beat, in seconds.

    onset_times : float [shape=(A,)], seconds; beat_times : float [shape=(B,)], seconds, in any order
    Returns seconds, lower is better; NaN where there is no onset or no beat.
    """
    distances = nearest_distances(onset_times, beat_times)
    return float(distances.mean()) if len(distances) and np.size(beat_times) else float("nan")


def beat_kernel(onset_times: ArrayLike, beat_times: ArrayLike, *, sigma_seconds: float = 0.1) -> float:
    """Compute BC as a score: mean over audio onsets of exp(-d^2 / (2 sigma^2)).

    d is the time to the nearest motion beat.

    onset_times : float [shape=(A,)], seconds; beat_times : float [shape=(B,)], seconds, in any order
    sigma_seconds : width of the kernel; 0.1 in HA2G, 0.3 in BEAT
    Returns 0 to 1, higher is better; NaN where there is no onset. A motion without beats scores 0, the limit
    of a beat infinitely far away, so that a statue does not drop out of an average.
    """
    distances = nearest_distances(onset_times, beat_times)
    if not len(distances):
        return float("nan")
    if not np.size(beat_times):
        return 0.0
    return float(np.exp(-0.5 * (distances / sigma_seconds) ** 2).mean())


def nearest_distances(onset_times: ArrayLike, beat_times: ArrayLike) -> np.ndarray:
    """Compute the time from each onset to its nearest beat.

    Returns float64 [shape=(A,)], seconds; NaN where there is no beat.
    """
    onsets = np.asarray(onset_times, dtype=np.float64).ravel()
    beats = np.sort(np.asarray(beat_times, dtype=np.float64).ravel())
    if not len(beats):
        return np.full(len(onsets), np.nan)
    right = np.searchsorted(beats, onsets)
    before = np.abs(onsets - beats[np.maximum(right - 1, 0)])
    after = np.abs(beats[np.minimum(right, len(beats) - 1)] - onsets)
    return np.minimum(before, after)

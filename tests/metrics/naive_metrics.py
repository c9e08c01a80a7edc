"""The metrics restated in the obvious way, one number at a time, to compare the array code with."""

from __future__ import annotations

import math

import numpy as np
from scipy import linalg


def norm(vector) -> float:
    return math.sqrt(sum(float(x) ** 2 for x in vector))


def angle(first, second) -> float:
    cosine = float(np.dot(first, second)) / (norm(first) * norm(second))
    return math.acos(min(1.0, max(-1.0, cosine)))


def synchrony(generated, truth) -> float:
    differences = []
    for t in range(1, min(len(generated), len(truth))):
        for j in range(generated.shape[1]):
            speed = norm(generated[t, j] - generated[t - 1, j])
            differences.append(abs(speed - norm(truth[t, j] - truth[t - 1, j])))
    return sum(differences) / len(differences)


def jerk_at(positions, t, j) -> float:
    """Norm of the third difference of frames t - 2 to t + 1, per frame^3."""
    return norm(positions[t + 1, j] - 3 * positions[t, j] + 3 * positions[t - 1, j] - positions[t - 2, j])


def mean_jerk(positions, fps) -> float:
    frames, joints = positions.shape[:2]
    values = [jerk_at(positions, t, j) for t in range(2, frames - 1) for j in range(joints)]
    return sum(values) / len(values) * fps**3


def direction_change_share(positions, min_angle_degrees, speed_floor) -> float:
    turns = total = 0
    for t in range(1, len(positions) - 1):
        for j in range(positions.shape[1]):
            before, after = positions[t, j] - positions[t - 1, j], positions[t + 1, j] - positions[t, j]
            total += 1
            if min(norm(before), norm(after)) >= speed_floor:
                turns += math.degrees(angle(before, after)) > min_angle_degrees
    return turns / total


def angle_change_rate(positions, parents, fps) -> list[float]:
    rates = [math.nan]
    for t in range(1, len(positions)):
        angles = []
        for j, parent in enumerate(parents):
            if parent >= 0:
                bone = [positions[s, j] - positions[s, parent] for s in (t - 1, t)]
                angles.append(angle(*bone))
        rates.append(sum(angles) / len(angles) * fps)
    return rates


def beat_distance(onsets, beats) -> float:
    return sum(min(abs(onset - beat) for beat in beats) for onset in onsets) / len(onsets)


def beat_kernel(onsets, beats, sigma) -> float:
    nearest = [min(abs(onset - beat) for beat in beats) for onset in onsets]
    return sum(math.exp(-(d**2) / (2 * sigma**2)) for d in nearest) / len(onsets)


def speed_histogram(positions, fps, bin_width, n_bins) -> list[int]:
    counts = [0] * n_bins
    for t in range(1, len(positions)):
        for j in range(positions.shape[1]):
            k = int(norm(positions[t, j] - positions[t - 1, j]) * fps / bin_width)
            if k < n_bins:
                counts[k] += 1
    return counts


def frechet_distance(first, second) -> float:
    covariances = [np.atleast_2d(np.cov(samples, rowvar=False)) for samples in (first, second)]
    values = linalg.eigvals(covariances[0] @ covariances[1])
    root = np.sqrt(np.maximum(values.real, 0.0)).sum()
    shift = first.mean(axis=0) - second.mean(axis=0)
    return float(shift @ shift + np.trace(covariances[0]) + np.trace(covariances[1]) - 2 * root)


def canonical_correlation(first, second) -> float:
    """First root of the textbook eigenproblem S11^-1 S12 S22^-1 S21; needs full rank."""
    n = first.shape[1]
    joint = np.cov(np.hstack([first, second]), rowvar=False)
    s11, s12, s22 = joint[:n, :n], joint[:n, n:], joint[n:, n:]
    values = linalg.eigvals(linalg.solve(s11, s12) @ linalg.solve(s22, s12.T))
    return math.sqrt(max(values.real))


def seam_jerk(positions, seams, source_frames, source, segment_starts, fps, radius) -> tuple[float, float]:
    """Mean jerks of the output and of the source near the seams."""
    ends = [*segment_starts[1:], len(source)]
    generated, recorded = [], []
    for t in range(2, len(positions) - 1):
        if not any(abs(t - seam) <= radius for seam in seams):
            continue
        frame = source_frames[t]
        start, end = next((s, e) for s, e in zip(segment_starts, ends, strict=True) if s <= frame < e)
        usable = [f for f in range(start, end) if f - 2 >= start and f + 1 < end]
        if not usable:
            continue
        nearest = min(usable, key=lambda f, frame=frame: abs(f - frame))
        for j in range(positions.shape[1]):
            generated.append(jerk_at(positions, t, j) * fps**3)
            recorded.append(jerk_at(source, nearest, j) * fps**3)
    return sum(generated) / len(generated), sum(recorded) / len(recorded)


def reference_use(source_frames) -> tuple[int, int, int, int]:
    """Frames used, largest number of stays at one frame, held frames, re-used frames."""
    stays: dict[int, int] = {}
    held = reused = 0
    previous = None
    for frame in source_frames:
        if frame == previous:
            held += 1
        else:
            reused += frame in stays
            stays[frame] = stays.get(frame, 0) + 1
        previous = frame
    return len(stays), max(stays.values()), held, reused


def foot_skate(feet, contacts, fps) -> float:
    speeds = [
        math.hypot(feet[t, j, 0] - feet[t - 1, j, 0], feet[t, j, 2] - feet[t - 1, j, 2]) * fps
        for t in range(1, len(feet))
        for j in range(feet.shape[1])
        if contacts[t, j] and contacts[t - 1, j]
    ]
    return sum(speeds) / len(speeds) if speeds else math.nan

"""Distances between poses (§4.1.2), and the uninterrupted stretches of motion that they are measured in."""

from __future__ import annotations

import numpy as np

from gesturegen import _pose_kernels as _kernels
from gesturegen.settings.models import Continuity


def segment_ends(segment_starts: np.ndarray, n_frames: int) -> np.ndarray:
    """Return the last frames `[shape=(S,)]` of the segments."""
    return np.append(segment_starts[1:], n_frames) - 1


def spread(values: np.ndarray, segment_starts: np.ndarray, n_frames: int) -> np.ndarray:
    """Repeat one value per segment `[shape=(S,)]` for each of the segment's frames `[shape=(T,)]`."""
    return np.repeat(values, np.diff(np.append(segment_starts, n_frames)))


def flatten(positions: np.ndarray) -> np.ndarray:
    """Flatten stored positions `[shape=(T, J, 3)]` to poses `[shape=(T, J * 3)]`, float64."""
    width = int(np.prod(positions.shape[1:]))  # -1 could not be told where there is no frame
    return np.ascontiguousarray(positions.reshape(len(positions), width), dtype=np.float64)


def velocities(poses: np.ndarray, segment_starts: np.ndarray) -> np.ndarray:
    """Compute backward differences `[shape=(T, D)]` per frame inside each segment.

    The first frame of a segment copies the second's velocity; a segment of one frame has velocity 0.
    """
    out = np.zeros_like(poses)
    out[1:] = np.diff(poses, axis=0)
    ends = segment_ends(segment_starts, len(poses))
    longer = ends > segment_starts
    out[segment_starts[longer]] = out[segment_starts[longer] + 1]
    out[segment_starts[~longer]] = 0.0
    return out


def pose_distances(
    poses: np.ndarray, speeds: np.ndarray, lefts: np.ndarray, rights: np.ndarray, settings: Continuity
) -> np.ndarray:
    """Compute d(l, r) `[shape=(K,)]` of pairs of frames: lambda_pos ||p_l - p_r|| + lambda_vel ||v_l - v_r||."""
    lefts, rights = np.asarray(lefts, dtype=np.int64), np.asarray(rights, dtype=np.int64)
    return _kernels.distances(lefts, rights, poses, speeds, settings.lambda_pos, settings.lambda_vel)

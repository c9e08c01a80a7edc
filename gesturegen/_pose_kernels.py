"""The pose distance as a loop. No fast-math: a distance has the same bits wherever it is computed."""

from __future__ import annotations

import numpy as np

from gesturegen.compiled import njit


@njit(cache=True, nogil=True)
def distance(left, right, left_velocity, right_velocity, lambda_pos, lambda_vel):
    """The pose distance of §4.1.2 between two flattened poses and velocities."""
    total = 0.0
    for k in range(left.shape[0]):
        step = left[k] - right[k]
        total += step * step
    turn = 0.0
    for k in range(left.shape[0]):
        step = left_velocity[k] - right_velocity[k]
        turn += step * step
    return lambda_pos * np.sqrt(total) + lambda_vel * np.sqrt(turn)


@njit(cache=True, nogil=True)
def distances(lefts, rights, poses, velocities, lambda_pos, lambda_vel):
    """The pose distances [shape=(K,)] of pairs of frames."""
    out = np.empty(len(lefts))
    for k in range(len(lefts)):
        a, b = lefts[k], rights[k]
        out[k] = distance(poses[a], poses[b], velocities[a], velocities[b], lambda_pos, lambda_vel)
    return out

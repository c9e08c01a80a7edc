"""Joining stretches of motion by their differences: each stretch keeps its speed, acceleration and jerk.

What is wanted of a motion is not its poses but how they change: at a seam, both sides played on as recorded say
that. The correction that brings the poses into line departs least from it, each order of difference measured by
its usual size in the joint, so that it is spread as widely as the joint's habits ask. After the gradient-domain
editing of images: Perez, Gangnet and Blake, Poisson image editing, SIGGRAPH 2003; orders and weights are ours.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import solveh_banded

from gesturegen.motion import rotation

# Rotations of a correction do not quite add up; so often what is left is corrected again.
_ROUNDS = 3
_DIFFERENCES = {1: (-1.0, 1.0), 2: (1.0, -2.0, 1.0), 3: (-1.0, 3.0, -3.0, 1.0)}
# What a change of speed, acceleration and jerk counts, each in units of its mean square; the distance from the
# recorded pose counts 1. With equal weights seams of the real sample are rougher than the recording.
_WEIGHTS = {1: 1.0, 2: 3.0, 3: 10.0}
# Of the largest entry of an equation; below it what brings a correction back is lost in rounding.
_LEAST_SPRING = 1e-10

Played = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


class _Across(NamedTuple):
    """Differences across seams: a row for each of their frames that is shown by another run.

    order, start : of the difference; factor : of the frame in it
    pair : number of the frame, as shown by the run that the difference belongs to, among the pairs of both
    """

    order: np.ndarray
    start: np.ndarray
    factor: np.ndarray
    pair: np.ndarray


def least_change(
    rotations: np.ndarray, positions: np.ndarray, runs: np.ndarray, played: Played
) -> tuple[np.ndarray, np.ndarray]:
    """Correct rotations and positions around all seams so that the recorded motion changes least.

    rotations : `[shape=(T, J, 4)]`; positions : `[shape=(T, J, 3)]`
    runs : int `[shape=(T,)]`, ascending, the uninterrupted stretch that each frame shows
    played : rotations and positions that runs `[shape=(P,)]` show at frames `[shape=(P,)]`, up to three beyond their
        own ends

    The correction c minimises, over the differences of orders n = 1, 2 and 3, sum w_n |D^n c - r_n|^2 / s_n^2 +
    sum |c|^2 / s_0^2. s_n is the root mean square of the differences within runs, s_0 that of the distance from the
    mean pose. r_n is 0 within a run; across a seam it makes up for what the other run's frames differ from those of
    the run that has the middle of the difference, had it been played on (of both, where the middle is the seam).
    """
    count = len(rotations)
    if count < 4 or runs[0] == runs[-1]:
        return rotations.copy(), positions.copy()
    across, owners, frames = _across(runs)
    there_rotations, there_positions = played(owners, frames)
    back = rotation.inverse(there_rotations)
    steps = rotation.to_expmap(rotation.multiply(rotations[1:], rotation.inverse(rotations[:-1])))
    turning = np.flatnonzero((steps != 0).any(axis=(0, 2)))
    equations = {j: _Equation(_away(rotations[:, j]), steps[:, j], runs) for j in turning.tolist()}
    correction, turned = np.zeros((*rotations.shape[:2], 3)), rotations
    for _round in range(_ROUNDS):
        gaps = rotation.to_expmap(rotation.multiply(turned[frames], back)) - correction[frames]
        for joint, equation in equations.items():
            correction[:, joint] = equation.solve(across, gaps[:, joint])
        turned = rotation.multiply(rotation.from_expmap(correction), rotations)
    moved = np.array(positions, dtype=np.float64)
    for joint in np.flatnonzero((np.ptp(positions, axis=0) > 0).any(axis=-1)).tolist():
        places = positions[:, joint]
        equation = _Equation(places - places.mean(axis=0), np.diff(places, axis=0), runs)
        moved[:, joint] += equation.solve(across, places[frames] - there_positions[:, joint])
    return turned, moved


def _away(rotations: np.ndarray) -> np.ndarray:
    """Compute rotation vectors `[shape=(T, 3)]` from the mean of rotations `[shape=(T, 4)]` to each."""
    mean = np.linalg.eigh(rotations.T @ rotations)[1][:, -1]
    return rotation.to_expmap(rotation.multiply(rotations, rotation.inverse(mean)))


def _across(runs: np.ndarray) -> tuple[_Across, np.ndarray, np.ndarray]:
    """List the rows of all differences across seams, and the runs and frames whose poses they need."""
    rows = []
    for order, factors in _DIFFERENCES.items():
        for start in np.flatnonzero(runs[:-order] != runs[order:]).tolist():
            owners = {int(runs[start + order // 2]), int(runs[start + (order + 1) // 2])}
            rows += [
                (order, start, factor / len(owners), owner * len(runs) + start + place)
                for owner in sorted(owners)
                for place, factor in enumerate(factors)
                if runs[start + place] != owner
            ]
    orders, starts, shares, pairs = (np.array(column) for column in zip(*rows, strict=True))
    unique, places = np.unique(pairs, return_inverse=True)
    return _Across(orders, starts, shares, places), *np.divmod(unique, len(runs))


class _Equation:
    """The banded equation of one joint's correction; see `least_change`."""

    def __init__(self, away: np.ndarray, steps: np.ndarray, runs: np.ndarray):
        """Set up the bands of the equation.

        away, steps : distances from the mean and steps between frames, `[shape=(T, 3)]` and `[shape=(T - 1, 3)]`
        """
        count, inside = len(runs), runs[1:] == runs[:-1]
        matrix = np.zeros((4, count))  # upper bands, the diagonal last
        matrix[3] = 1.0 / max(float((away**2).sum(axis=1).mean()), 1e-30)
        self._weights = {}
        for order, factors in _DIFFERENCES.items():
            if order > 1:
                steps, inside = np.diff(steps, axis=0), inside[1:] & inside[:-1]
            powers = (steps**2).sum(axis=1)
            own = powers[inside] if (powers[inside] > 0).any() else powers
            weight = self._weights[order] = _WEIGHTS[order] / max(float(own.mean()), 1e-30)
            for i, left in enumerate(factors):
                for j in range(i, order + 1):
                    matrix[3 - (j - i), j : count - order + j] += left * factors[j] * weight
        matrix[3] += _LEAST_SPRING * matrix[3].max()
        self._matrix = matrix

    def solve(self, across: _Across, gaps: np.ndarray) -> np.ndarray:
        """Solve for the correction `[shape=(T, 3)]`.

        gaps : how far the pairs' frames are away from their runs `[shape=(P, 3)]`
        """
        count = self._matrix.shape[1]
        right = np.zeros((count, 3))
        for order, factors in _DIFFERENCES.items():
            of = across.order == order
            wanted = np.zeros((count - order, 3))
            np.add.at(wanted, across.start[of], -across.factor[of, None] * gaps[across.pair[of]])
            for i, factor in enumerate(factors):
                right[i : count - order + i] += factor * self._weights[order] * wanted
        return solveh_banded(self._matrix, right)

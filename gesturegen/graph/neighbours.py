"""The nearest frames of every frame, so that a search need not compare all with all.

Exact: pairs are ranked by a lower bound of their distance from float32 products, and everything that this
bound leaves open is computed in float64. The result depends on the stored positions alone.
"""

from __future__ import annotations

import numpy as np

from gesturegen.config import Continuity
from gesturegen.graph import _kernels
from gesturegen.graph.continuity import BLOCK_PAIRS, Products

# More makes an index larger and certifies more joins; results do not depend on it.
COUNT = 32


def nearest(
    poses: np.ndarray, speeds: np.ndarray, settings: Continuity, count: int = COUNT, block_pairs: int = BLOCK_PAIRS
) -> tuple[np.ndarray, np.ndarray]:
    """The `count` nearest other frames of each frame, nearest first, and their distances, both `[shape=(T, count)]`.

    poses, speeds : float64 `[shape=(T, D)]`. Fewer than `count` columns where there are not as many other
    frames. Ties: the lower frame first.
    """
    frames = len(poses)
    count = min(count, frames - 1)
    nodes, distances = np.empty((frames, count), dtype=np.int32), np.empty((frames, count))
    if count == 0:
        return nodes, distances
    bounds = _Bounds(poses, speeds, settings)
    rows = max(1, block_pairs // frames)
    for first in range(0, frames, rows):
        lefts = np.arange(first, min(first + rows, frames))
        block = slice(first, first + rows)
        _kernels.nearest(
            lefts, bounds.of(lefts), poses, speeds, settings.lambda_pos, settings.lambda_vel, nodes[block],
            distances[block],
        )  # fmt: skip
    return nodes, distances


def lower_bounds(poses: np.ndarray, speeds: np.ndarray, settings: Continuity, frames: np.ndarray) -> np.ndarray:
    """Lower bounds, float32 `[shape=(K, T)]`, of the distances from some of the frames to all of them."""
    return _Bounds(poses, speeds, settings).of(frames)


class _Bounds:
    def __init__(self, poses: np.ndarray, speeds: np.ndarray, settings: Continuity):
        self.sides = [(Products(poses), settings.lambda_pos), (Products(speeds), settings.lambda_vel)]

    def of(self, lefts: np.ndarray) -> np.ndarray:
        low = np.zeros((len(lefts), len(self.sides[0][0].points)), dtype=np.float32)
        for products, weight in self.sides:
            _kernels.add_lower_bounds(
                lefts, products.of(lefts), products.halves, products.slack, weight * products.scale, low
            )
        return low

"""Continuity analysis (§4.1.2): which pairs of frames are close enough for a transition.

Pairs are selected with blocked float32 matrix products, whose error is bounded and added as slack, and
confirmed in float64 from the same float32 positions. The edge set is therefore exactly the definition's,
whatever the block size, the number of threads or the machine.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gesturegen.methods.motion_graph import _graph_kernels as _kernels
from gesturegen.pose_distance import segment_ends, spread
from gesturegen.settings.models import Continuity

# Of a block of the N x N comparison; small enough to stay in the cache's neighbourhood, memory is 5 bytes each.
BLOCK_PAIRS = 8_000_000
_UNIT_ROUNDOFF = float(np.finfo(np.float32).eps) / 2


def thresholds(poses: np.ndarray, speeds: np.ndarray, segment_starts: np.ndarray, settings: Continuity) -> np.ndarray:
    """Compute the dynamic threshold of each frame `[shape=(T,)]`: its mean distance to the next `l_cn` frames.

    Fewer at a segment's end; NaN for a segment's last frame, which has no unnatural edge.
    """
    ends = spread(segment_ends(segment_starts, len(poses)), segment_starts, len(poses))
    return _kernels.thresholds(poses, speeds, ends, settings.l_cn, settings.lambda_pos, settings.lambda_vel)


def candidate_blocks(
    poses: np.ndarray, speeds: np.ndarray, limits: np.ndarray, settings: Continuity, block_pairs: int = BLOCK_PAIRS
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield candidate pairs in ascending (left, right) order, in blocks: lefts, rights, distances `[shape=(K,)]`.

    A candidate of l is every r not in {l, l + 1} with d(l, r) < threshold(l), over all segments.
    """
    near_poses, near_speeds = Products(poses), Products(speeds)
    rows = max(1, block_pairs // len(poses))
    for first in range(0, len(poses), rows):
        lefts = slice(first, min(first + rows, len(poses)))
        limit = np.nan_to_num(limits[lefts], nan=-1.0)
        # Each term alone must stay below the limit: a bound that two products and two comparisons give.
        mask = near_poses.within(lefts, limit, settings.lambda_pos)
        mask &= near_speeds.within(lefts, limit, settings.lambda_vel)
        yield _kernels.confirm(first, mask, poses, speeds, limits, settings.lambda_pos, settings.lambda_vel)


class Products:
    """Euclidean distances of points from float32 products, with a proven bound of their error."""

    def __init__(self, points: np.ndarray):
        centred = points - points.mean(axis=0)
        # Squares of very small or large coordinates would leave float32's range.
        self.scale = float(np.abs(centred).max()) or 1.0
        centred = centred / self.scale
        self.points = centred.astype(np.float32)
        self.squares = np.einsum("ij,ij->i", centred, centred)
        self.halves = (0.5 * self.squares).astype(np.float32)
        # Rounding the inputs, a dot product of D terms in any order and the sum, each relative to the norms.
        norm = np.sqrt(self.squares.max())
        self.slack = 2.0 * (points.shape[1] + 8) * _UNIT_ROUNDOFF * (2.0 * norm) ** 2

    def of(self, lefts: slice) -> np.ndarray:
        """Compute a . b `[shape=(L, T)]` of scaled points: half their squares less it is half the distance's square."""
        return self.points[lefts] @ self.points.T

    def within(self, lefts: slice, limits: np.ndarray, weight: float) -> np.ndarray:
        """Mark pairs bool `[shape=(L, T)]`, False only where `weight` times the distance reaches the left's limit."""
        if weight == 0.0:
            return np.broadcast_to(limits[:, None] > 0, (len(limits), len(self.points))).copy()
        reach = np.where(limits > 0, (limits / (weight * self.scale)) ** 2 + self.slack, -np.inf)
        # ||a - b||^2 < reach  <=>  a . b > (||a||^2 + ||b||^2 - reach) / 2, and both sides fit float32 with the slack.
        products = self.of(lefts)
        products -= self.halves
        return products > (0.5 * (self.squares[lefts] - reach)).astype(np.float32)[:, None]

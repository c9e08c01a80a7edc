"""Transition costs between gesture clips and the edges below a threshold (GestureMaster §4.1, equation 1).

T(p, q) = lambda_1 * T_p + lambda_2 * T_r, summed over the transitional frames at the end of clip p and at the
start of clip q: of the distances of the joints' positions, and of the angles between the joints' rotations.

Most pairs are rejected by a lower bound, the norms of sums over frames in place of the sums of norms; its
rounding is bounded and added as slack. The rest is decided in float64 on the cost that `costs` returns. The
edges are therefore exactly the definition's, whatever the block size or the number of threads.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from gesturegen.methods.gesture_master import _kernels

# Of a block of the C x C comparison; memory is 5 bytes each, and 24 for each edge found.
BLOCK_PAIRS = 4_000_000
_UNIT_ROUNDOFF = float(np.finfo(np.float64).eps) / 2
_UNIT_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Borders:
    """The transitional frames at the ends, or at the starts, of C clips: F frames, J joints, K rotations.

    positions : float32 `[shape=(C, F, J, 3)]`, metres; rotations : float32 unit quaternions `[shape=(C, F, K, 4)]`
    """

    positions: np.ndarray
    rotations: np.ndarray

    def __post_init__(self) -> None:
        points, turns = np.shape(self.positions), np.shape(self.rotations)
        if len(points) != 4 or len(turns) != 4 or points[3] != 3 or turns[3] != 4 or points[:2] != turns[:2]:
            raise ValueError(f"borders need [C, F, J, 3] positions and [C, F, K, 4] rotations, not {points}, {turns}")

    def __len__(self) -> int:
        return len(self.positions)

    @cached_property
    def side(self) -> _kernels.Side:
        """Prepare the arrays of the compiled loops, in float64."""
        n_clips, frames = self.positions.shape[:2]
        positions = np.asarray(self.positions, dtype=np.float64)
        turns = np.asarray(self.rotations, dtype=np.float64)
        norms = np.linalg.norm(turns, axis=-1, keepdims=True)
        if not np.isfinite(positions).all():
            raise ValueError("positions must be finite")
        if not (np.abs(norms - 1.0) <= _UNIT_TOLERANCE).all():
            raise ValueError("rotations must be unit quaternions")
        # As stored they are off by a float32 rounding, which small angles would show.
        turns /= norms
        matrices = np.zeros((n_clips, turns.shape[2], 9))
        for frame in range(frames):  # all at once they would be the largest array by far
            matrices += _matrices(turns[:, frame])
        matrices /= np.sqrt(2.0)
        return _kernels.Side(
            _by_component(positions.reshape(n_clips, frames * positions.shape[2], 3)),
            _by_component(turns.reshape(n_clips, frames * turns.shape[2], 4)),
            np.ascontiguousarray(np.moveaxis(positions.sum(axis=1), 0, -1)),
            np.ascontiguousarray(np.moveaxis(matrices, 0, -1)),
        )

    @cached_property
    def extent(self) -> float:
        """Return the largest magnitude of a coordinate."""
        return float(np.abs(self.positions).max(initial=0.0))


def _by_component(vectors: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(np.swapaxes(vectors, 1, 2))


def _matrices(quaternions: np.ndarray) -> np.ndarray:
    """Convert quaternions to rotation matrices, flat `[shape=(..., 9)]`."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    rows = [
        w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z,
    ]  # fmt: skip
    return np.stack(rows, axis=-1)


def costs(
    ends: Borders, starts: Borders, lefts: ArrayLike, rights: ArrayLike, lambda_1: float, lambda_2: float
) -> np.ndarray:
    """Compute T(p, q) `[shape=(N,)]` of pairs of clips p = `lefts`, q = `rights` `[shape=(N,)]`.

    Equal borders cost exactly 0; small angles keep their relative precision.
    """
    _check(ends, starts, lambda_1, lambda_2)
    lefts, rights = np.asarray(lefts, dtype=np.int64), np.asarray(rights, dtype=np.int64)
    if lefts.ndim != 1 or lefts.shape != rights.shape:
        raise ValueError(f"pairs of clips need two lists of one length, not {lefts.shape} and {rights.shape}")
    for clips, borders in ((lefts, ends), (rights, starts)):
        if len(clips) and not (clips.min() >= 0 and clips.max() < len(borders)):
            raise ValueError(f"clips must lie in 0 to {len(borders) - 1}")
    return _kernels.costs(ends.side, starts.side, lefts, rights, float(lambda_1), float(lambda_2))


def edges(
    ends: Borders, starts: Borders, first: int, last: int, lambda_1: float, lambda_2: float, limit: float,
    block_pairs: int = BLOCK_PAIRS,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Find the edges p -> q, those with T(p, q) < `limit`, to the destinations q from `first` to before `last`.

    Ordered by q, then by p: the number for each q int64 `[shape=(last - first,)]`, the sources p int32
    `[shape=(E,)]` and the costs float32 `[shape=(E,)]`. A clip may follow itself.
    """
    _check(ends, starts, lambda_1, lambda_2)
    if not 0 <= first <= last <= len(starts):
        raise ValueError(f"destinations must lie in 0 to {len(starts)}, not {first} to {last}")
    if np.isnan(limit):
        raise ValueError("the limit is not a number")
    reach = _reach(ends, starts, lambda_1, lambda_2, limit)
    rows = max(1, block_pairs // max(1, len(ends)))
    counts, sources, values = [], [], []
    for begin in range(first, last, rows):
        block = _kernels.below(
            ends.side, starts.side, begin, min(begin + rows, last),
            float(lambda_1), float(lambda_2), float(limit), reach,
        )  # fmt: skip
        mask = block >= 0
        counts.append(np.count_nonzero(mask, axis=1))
        sources.append(np.nonzero(mask)[1].astype(np.int32))
        values.append(block[mask])
    return (
        np.concatenate([np.empty(0, dtype=np.int64), *counts]).astype(np.int64, copy=False),
        np.concatenate([np.empty(0, dtype=np.int32), *sources]),
        np.concatenate([np.empty(0, dtype=np.float32), *values]),
    )


def quantile(
    ends: Borders, starts: Borders, share: float, lambda_1: float, lambda_2: float, rng: np.random.Generator,
    sample: int = 200_000,
) -> float:  # fmt: skip
    """Compute the quantile `share` (0 to 1, as `np.quantile`) of T(p, q) over pairs of different clips.

    Of all pairs where these are at most `sample`, else of as many drawn from `rng`, with repetition.
    """
    n_clips = len(ends)
    if n_clips != len(starts) or n_clips < 2:
        raise ValueError(f"pairs of different clips need two clips or more, not {n_clips} ends, {len(starts)} starts")
    others = n_clips - 1
    if n_clips * others <= sample:
        lefts, rights = np.divmod(np.arange(n_clips * others), others)
    else:
        lefts, rights = rng.integers(n_clips, size=sample), rng.integers(others, size=sample)
    rights = rights + (rights >= lefts)
    return float(np.quantile(costs(ends, starts, lefts, rights, lambda_1, lambda_2), share))


def _check(ends: Borders, starts: Borders, lambda_1: float, lambda_2: float) -> None:
    shapes = [(borders.positions.shape[1:], borders.rotations.shape[1:]) for borders in (ends, starts)]
    if shapes[0] != shapes[1]:
        raise ValueError(f"ends and starts differ in frames, joints or rotations: {shapes[0]} and {shapes[1]}")
    if not all(np.isfinite(weight) and weight >= 0 for weight in (lambda_1, lambda_2)):
        raise ValueError(f"weights must be finite and not negative, not {lambda_1} and {lambda_2}")


def _reach(ends: Borders, starts: Borders, lambda_1: float, lambda_2: float, limit: float) -> float:
    """Compute the greatest lower bound, as rounded, at which a cost, as rounded, may be below `limit`.

    sum_f |d_f| >= |sum_f d_f| for the positions. Rotations an angle a apart have matrices 2 sqrt(2) sin(a / 2)
    apart (Frobenius), so over sqrt(2) at most a, and the same holds for their sums over frames.
    """
    frames, joints = ends.positions.shape[1:3]
    turns = ends.rotations.shape[2]
    # Roundings of inputs and sums over frames, relative to the coordinates, which may cancel in the differences.
    by_joint = 4 * (frames + 16) * _UNIT_ROUNDOFF * frames
    extent = np.sqrt(3.0) * (ends.extent + starts.extent)
    slack = by_joint * (lambda_1 * joints * extent + lambda_2 * turns * 8.0)
    # Roundings of norms, angles and sums of them, relative to these.
    relative = 4 * (frames * (joints + turns) + 64) * _UNIT_ROUNDOFF
    return float(limit * (1.0 + relative) + slack)

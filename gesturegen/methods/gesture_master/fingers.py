"""Finger motion for recordings without any, from the clip whose body poses are nearest.

GestureMaster, §3.1: "For motion capture without finger animation, we simply search and transfer the rotations
from finger motion capture with lowest position distance."
"""

from __future__ import annotations

import numpy as np

from gesturegen.motion import rotation

# Radians: fingers that turn less than this in a whole recording were not recorded.
STILL_FINGERS = 1e-3
# Distances held at once, and pairs confirmed at once: some tens of megabytes each.
_BLOCK = 4_000_000
_PAIRS = 8192


def has_fingers(rotations: np.ndarray) -> bool:
    """Tell whether any finger moves in a recording.

    rotations : float [shape=(T, F, 4)], local rotations of its finger joints; F may be 0
    """
    rotations = np.asarray(rotations)
    if rotations.shape[0] == 0 or rotations.shape[1] == 0:
        return False
    return bool(rotation.angle_between(rotations[:1], rotations).max() > STILL_FINGERS)


def describe_poses(positions: np.ndarray, samples: int = 8) -> np.ndarray:
    """Sample the poses of a gesture clip as one row, whatever its length.

    positions : float [shape=(n, J, 3)], of the upper body, relative to the pelvis, cm
    samples : how many poses are taken, evenly from the first frame to the last and between frames linearly
    Returns float32 [shape=(samples * J * 3,)].
    """
    positions = np.asarray(positions, dtype=np.float64)
    if len(positions) == 0:
        raise ValueError("a clip without frames has no poses")
    times = np.linspace(0.0, len(positions) - 1, samples)
    low = np.floor(times).astype(int)
    high = np.minimum(low + 1, len(positions) - 1)
    weights = (times - low)[:, None, None]
    poses = (1.0 - weights) * positions[low] + weights * positions[high]
    return poses.reshape(-1).astype(np.float32)


def nearest(wanting: np.ndarray, offered: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find for each clip without fingers the clip with fingers whose poses are nearest.

    wanting : float [shape=(A, D)], rows of `describe_poses`; offered : float [shape=(B, D)]
    Returns int64 [shape=(A,)], rows of `offered`, the first of equally near ones, and float64 [shape=(A,)], the
    root mean square distance of the joints over the poses, cm.
    Raises ValueError when nothing is offered, widths differ or a value is not finite.
    """
    wanting, offered = np.asarray(wanting, dtype=np.float64), np.asarray(offered, dtype=np.float64)
    if wanting.ndim != 2 or offered.ndim != 2 or wanting.shape[1] != offered.shape[1]:
        raise ValueError(f"poses have shapes {wanting.shape} and {offered.shape}, expected (A, D) and (B, D)")
    if len(offered) == 0:
        raise ValueError("no clip with fingers is offered")
    if not (np.isfinite(wanting).all() and np.isfinite(offered).all()):
        raise ValueError("poses are not finite")
    # Of equal rows only the first can be chosen; all of them would be confirmed one by one.
    firsts: dict[bytes, int] = {}
    for number, row in enumerate(offered):
        firsts.setdefault(row.tobytes(), number)
    numbers = np.fromiter(firsts.values(), dtype=np.int64)
    chosen, squares = _nearest_of_different(wanting, offered[numbers])
    return numbers[chosen], np.sqrt(squares * 3.0 / max(wanting.shape[1], 1))


def _nearest_of_different(wanting: np.ndarray, offered: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the nearest rows of `offered` and squared distances: float32 preselects, float64 decides."""
    # |a - b|^2 = |a|^2 + |b|^2 - 2ab is the more exact the smaller the norms are.
    centre = offered.mean(axis=0)
    rows, columns = (wanting - centre).astype(np.float32), (offered - centre).astype(np.float32)
    row_squares = np.einsum("ij,ij->i", rows, rows)
    column_squares = np.einsum("ij,ij->i", columns, columns)
    # Bounds the rounding of the sums of D products, of the subtraction and of the conversion to float32.
    rounding = (wanting.shape[1] + 16) * np.finfo(np.float32).eps * (row_squares + column_squares.max())
    chosen, squares = np.empty(len(wanting), dtype=np.int64), np.empty(len(wanting))
    step = max(_BLOCK // len(offered), 1)
    for start in range(0, len(wanting), step):
        block = slice(start, start + step)
        # |a|^2 is the same for a whole row.
        distances = column_squares - 2.0 * (rows[block] @ columns.T)
        bound = distances.min(axis=1) + 2.0 * rounding[block]
        row, column = np.nonzero(distances <= bound[:, None])
        exact = _squared_distances(wanting, offered, row + start, column)
        order = np.lexsort((column, exact, row))
        best = order[np.unique(row[order], return_index=True)[1]]
        chosen[block], squares[block] = column[best], exact[best]
    return chosen, squares


def _squared_distances(wanting: np.ndarray, offered: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Compute the squared distances of the pairs (rows[k], columns[k]), float64 [shape=(len(rows),)]."""
    squares = np.empty(len(rows))
    for start in range(0, len(rows), _PAIRS):
        pairs = slice(start, start + _PAIRS)
        squares[pairs] = np.square(wanting[rows[pairs]] - offered[columns[pairs]]).sum(axis=1)
    return squares

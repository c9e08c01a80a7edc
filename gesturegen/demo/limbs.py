"""Arms and legs as two-bone chains: joint rotations from the place where a hand or foot should be."""

from __future__ import annotations

import numpy as np

from gesturegen.motion import rotation


def two_bone(
    start: np.ndarray, target: np.ndarray, upper: float, lower: float, pole: np.ndarray, soft_from: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Solve a two-bone chain that bends towards `pole`.

    start, target, pole : [shape=(T, 3)]; upper, lower : bone lengths
    soft_from : share of the full length from which a far target is pulled in
    Returns the upper bone's direction [shape=(T, 3)], the direction its middle joint points at, at right
    angles to the bone [shape=(T, 3)], and the bend of the middle joint in radians [shape=(T,)].
    A target out of reach is pulled in smoothly, so that the chain never locks straight with a jerk; one too
    near is pushed out, so that the middle joint bends at most about 140 degrees.
    """
    line = target - start
    length = np.linalg.norm(line, axis=-1, keepdims=True)
    direction = line / length
    longest = 0.997 * (upper + lower)
    knee = soft_from * longest
    over = np.maximum(length - knee, 0.0) / (longest - knee)
    length = np.where(length > knee, knee + (longest - knee) * np.tanh(over), length)
    shortest = 0.36 * (upper + lower)
    length = shortest + 2.0 * np.logaddexp(0.0, (length - shortest) / 2.0)
    side = pole - np.sum(pole * direction, axis=-1, keepdims=True) * direction
    side = side / np.linalg.norm(side, axis=-1, keepdims=True)
    along = (upper**2 - lower**2 + length**2) / (2.0 * length)
    across = np.sqrt(np.maximum(upper**2 - along**2, 0.0))
    first = (along * direction + across * side) / upper
    second = (length * direction - upper * first) / lower
    facing = side - np.sum(side * first, axis=-1, keepdims=True) * first
    facing = facing / np.linalg.norm(facing, axis=-1, keepdims=True)
    bend = np.arccos(np.clip(np.sum(first * second, axis=-1), -1.0, 1.0))
    return first, facing, bend


def align(bone: np.ndarray, side: np.ndarray, direction: np.ndarray, facing: np.ndarray) -> np.ndarray:
    """Compute quaternions `[shape=(T, 4)]` that turn `bone` to `direction` and `side` to `facing`.

    bone, side : unit vectors at right angles [shape=(3,)]; direction, facing : likewise [shape=(T, 3)].
    """
    swing = np.concatenate(
        [
            1.0 + np.sum(bone * direction, axis=-1, keepdims=True),
            np.cross(np.broadcast_to(bone, direction.shape), direction),
        ],
        axis=-1,
    )
    swing = rotation.normalize(swing)
    swung = rotation.rotate(swing, np.broadcast_to(side, direction.shape))
    angle = np.arctan2(np.sum(np.cross(swung, facing) * direction, axis=-1), np.sum(swung * facing, axis=-1))
    twist = rotation.from_expmap(angle[:, None] * direction)
    return rotation.multiply(twist, swing)


def about(axis: int, angles: np.ndarray) -> np.ndarray:
    """Compute quaternions that turn by `angles` (radians) about axis 0, 1 or 2."""
    vectors = np.zeros((*np.shape(angles), 3))
    vectors[..., axis] = angles
    return rotation.from_expmap(vectors)

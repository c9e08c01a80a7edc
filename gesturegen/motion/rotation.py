"""Rotations as unit quaternions wxyz `[shape=(..., 4)]`; the only file where scipy's xyzw appears.

Euler angles are intrinsic: a BVH joint with channels `Zrotation Xrotation Yrotation` has R = Rz Rx Ry,
which scipy spells with upper-case letters. Exponential maps are rotation vectors in radians.
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def _scipy(quaternions: np.ndarray) -> Rotation:
    """Convert quaternions wxyz to a scipy rotation."""
    return Rotation.from_quat(np.asarray(quaternions, dtype=np.float64)[..., [1, 2, 3, 0]].reshape(-1, 4))


def _wxyz(rotation: Rotation, shape: tuple[int, ...]) -> np.ndarray:
    """Convert a scipy rotation to quaternions wxyz of the given shape."""
    return rotation.as_quat()[:, [3, 0, 1, 2]].reshape(*shape, 4)


def from_euler(order: str, angles: np.ndarray) -> np.ndarray:
    """Convert intrinsic Euler `angles` in radians `[shape=(..., len(order))]` to quaternions, order such as `"ZXY"`."""
    angles = np.asarray(angles, dtype=np.float64)
    return _wxyz(Rotation.from_euler(order, angles.reshape(-1, len(order))), angles.shape[:-1])


def to_euler(order: str, quaternions: np.ndarray) -> np.ndarray:
    """Convert to intrinsic Euler angles in radians `[shape=(..., 3)]` in the three-letter `order`.

    At gimbal lock the last angle is set to zero; the rotation is the same.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Gimbal lock detected")
        return _scipy(quaternions).as_euler(order).reshape(*np.shape(quaternions)[:-1], 3)


def from_expmap(expmaps: np.ndarray) -> np.ndarray:
    """Convert exponential maps `[shape=(..., 3)]`, radians, to quaternions."""
    expmaps = np.asarray(expmaps, dtype=np.float64)
    return _wxyz(Rotation.from_rotvec(expmaps.reshape(-1, 3)), expmaps.shape[:-1])


def to_expmap(quaternions: np.ndarray) -> np.ndarray:
    """Convert to exponential maps `[shape=(..., 3)]` of angle at most pi, radians."""
    return _scipy(quaternions).as_rotvec().reshape(*np.shape(quaternions)[:-1], 3)


def to_matrix(quaternions: np.ndarray) -> np.ndarray:
    """Convert to rotation matrices `[shape=(..., 3, 3)]`."""
    return _scipy(quaternions).as_matrix().reshape(*np.shape(quaternions)[:-1], 3, 3)


def from_matrix(matrices: np.ndarray) -> np.ndarray:
    """Convert rotation matrices `[shape=(..., 3, 3)]` to quaternions."""
    matrices = np.asarray(matrices, dtype=np.float64)
    return _wxyz(Rotation.from_matrix(matrices.reshape(-1, 3, 3)), matrices.shape[:-2])


def about_y(angles: ArrayLike) -> np.ndarray:
    """Make quaternions that turn by `angles` (radians) about the vertical."""
    half = np.asarray(angles, dtype=np.float64) / 2
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, np.sin(half), zero], axis=-1)


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Multiply quaternions: the product a b is the rotation `b` followed by `a`."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def inverse(quaternions: np.ndarray) -> np.ndarray:
    """Invert unit quaternions."""
    return np.asarray(quaternions) * np.array([1.0, -1.0, -1.0, -1.0])


def rotate(quaternions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Turn vectors `[shape=(..., 3)]` by quaternions `[shape=(..., 4)]`."""
    vectors = np.asarray(vectors, dtype=np.float64)
    w, u = quaternions[..., :1], quaternions[..., 1:]
    t = 2.0 * np.cross(u, vectors)
    return vectors + w * t + np.cross(u, t)


def normalize(quaternions: np.ndarray) -> np.ndarray:
    """Scale quaternions to length one."""
    return quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Compute the angle in radians, 0 to pi, of the rotation that takes `a` to `b`."""
    difference = multiply(inverse(a), b)
    return 2.0 * np.arctan2(np.linalg.norm(difference[..., 1:], axis=-1), np.abs(difference[..., 0]))


def slerp(a: np.ndarray, b: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Interpolate along the shorter arc of the sphere: `a` at weight 0, `b` at weight 1.

    a, b : `[shape=(..., 4)]`; weights : broadcastable to `(...)`.
    Shoemake, Animating rotation with quaternion curves, SIGGRAPH 1985.
    """
    weights = np.asarray(weights, dtype=np.float64)[..., None]
    dot = np.sum(a * b, axis=-1, keepdims=True)
    b = np.where(dot < 0, -b, b)
    dot = np.minimum(np.abs(dot), 1.0)
    angle = np.arccos(dot)
    sine = np.sin(angle)
    # Below 1e-6 rad the arc is a straight line to machine precision, and the sine quotient is 0 / 0.
    straight = sine < 1e-6
    safe = np.where(straight, 1.0, sine)
    left = np.where(straight, 1.0 - weights, np.sin((1.0 - weights) * angle) / safe)
    right = np.where(straight, weights, np.sin(weights * angle) / safe)
    return normalize(left * a + right * b)


def between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Compute the shortest rotations that turn vectors `[shape=(..., 3)]` into the directions of others.

    None where one of them has no length; opposite ones are turned about any axis across them.
    """
    axis = np.cross(start, end)
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    along = np.sum(start * end, axis=-1, keepdims=True)
    # Any vector that is not parallel to `start` gives an axis across it.
    spare = np.cross(start, np.where(np.abs(start[..., :1]) < np.linalg.norm(start, axis=-1, keepdims=True) / 2,
                                     (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))  # fmt: skip
    spare /= np.maximum(np.linalg.norm(spare, axis=-1, keepdims=True), 1e-300)
    opposite = (along < 0) & (length <= 1e-8 * np.abs(along))
    direction = np.where(opposite, spare, axis / np.maximum(length, 1e-300))
    return from_expmap(direction * np.arctan2(length, along))


def aligning(starts: np.ndarray, ends: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Fit the quaternion that turns vectors `[shape=(n, 3)]` nearest to others, by weighted least squares.

    weights : float `[shape=(n,)]`

    Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Crystallographica A 1976.
    """
    left, _, right = np.linalg.svd((np.asarray(ends) * weights[:, None]).T @ np.asarray(starts))
    sign = np.sign(np.linalg.det(left @ right))
    return from_matrix(left @ np.diag([1.0, 1.0, sign]) @ right)


def heading(quaternions: np.ndarray) -> np.ndarray:
    """Compute the turn about the vertical in radians: the twist angle about Y of q = twist swing.

    Turning a pose by t about Y adds exactly t (modulo 2 pi), whatever the local axes of the joint are.
    """
    return 2.0 * np.arctan2(quaternions[..., 2], quaternions[..., 0])


def wrap_angle(angles: np.ndarray) -> np.ndarray:
    """Bring angles into [-pi, pi)."""
    return (np.asarray(angles) + np.pi) % (2.0 * np.pi) - np.pi

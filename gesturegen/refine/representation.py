"""The representation of a motion for the refiner's networks, and the way back.

Habibie et al. 2022 call their representation parent-relative. Here that is the local rotation of each joint as six
numbers, the first two columns of its rotation matrix (Zhou et al., On the continuity of rotation representations
in neural networks, CVPR 2019). Coming back, any six numbers are made a rotation, and positions are left alone, so
bone lengths hold exactly whatever a network puts out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gesturegen.motion import rotation
from gesturegen.motion.skeleton import Motion, read_only

CHANNELS_PER_JOINT = 6
# Two columns that span less than this say nothing about a rotation.
_NO_LENGTH = 1e-8
# A channel that moves less than this, about half a degree, is scaled as if it moved so much: fingers that stand
# still must not have the weight of arms that move.
_LEAST_SCALE = 0.01


@dataclass(frozen=True)
class Description:
    """The skeleton and rate that a refiner was trained on; it fits no other.

    joints : names of the joints that are refined, in the order of their channels
    fps : frames per second
    """

    joints: tuple[str, ...]
    fps: float

    @property
    def channels(self) -> int:
        """Number of channels of a gesture."""
        return CHANNELS_PER_JOINT * len(self.joints)

    def difference(self, other: Description) -> str | None:
        """Describe how two descriptions differ; None when they are equal."""
        if len(self.joints) != len(other.joints):
            return (
                f"{len(self.joints)} joints ({self.channels} channels) against {len(other.joints)} ({other.channels})"
            )
        for mine, theirs in zip(self.joints, other.joints, strict=True):
            if mine != theirs:
                return f"joint {mine!r} against {theirs!r}"
        if self.fps != other.fps:
            return f"{self.fps:g} frames per second against {other.fps:g}"
        return None


def describe(motion: Motion, joints: Sequence[int]) -> Description:
    """Describe the joints that are refined and the rate of a motion."""
    return Description(tuple(motion.skeleton.names[j] for j in joints), float(motion.fps))


def to_channels(motion: Motion, joints: Sequence[int]) -> np.ndarray:
    """Convert local rotations of `joints` to channels: per joint the first two columns of its matrix.

    Returns float `[shape=(T, 6 * len(joints))]`.
    """
    matrices = rotation.to_matrix(motion.rotations[:, list(joints)])
    return np.swapaxes(matrices[..., :2], -1, -2).reshape(motion.n_frames, -1)


def from_channels(motion: Motion, joints: Sequence[int], channels: np.ndarray) -> Motion:
    """Replace the rotations of `joints` in `motion` by those of `channels` `[shape=(T, 6 * len(joints))]`.

    The two columns are made orthonormal by Gram and Schmidt, the first keeping its direction. Where they span no
    plane the rotation of `motion` stays.
    """
    joints = list(joints)
    own = motion.rotations[:, joints]
    columns = np.asarray(channels, dtype=np.float64).reshape(motion.n_frames, len(joints), 2, 3)
    if not np.isfinite(columns).all():
        raise ValueError("channels that are not finite")
    # Brought to length one before anything is multiplied, so that no number is too small or too large.
    first, first_length = _unit(columns[..., 0, :])
    second, second_length = _unit(columns[..., 1, :])
    second, sine = _unit(second - np.sum(first * second, axis=-1, keepdims=True) * first)
    # Once more: what the subtraction cancelled is lost where the two were nearly parallel.
    second, _ = _unit(second - np.sum(first * second, axis=-1, keepdims=True) * first)
    usable = np.minimum(np.minimum(first_length, second_length), sine)[..., 0] > _NO_LENGTH
    matrices = np.stack([first, second, np.cross(first, second)], axis=-1)
    matrices[~usable] = np.eye(3)
    turned = rotation.from_matrix(matrices)
    # A quaternion and its negative are the same rotation; the nearer one keeps a round trip exact.
    turned = np.where(np.sum(turned * own, axis=-1, keepdims=True) < 0, -turned, turned)
    rotations = motion.rotations.copy()
    rotations[:, joints] = np.where(usable[..., None], turned, own)
    return replace(motion, rotations=rotations)


def _unit(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Scale vectors to length one, and return the lengths they had `[shape=(..., 1)]`."""
    largest = np.abs(vectors).max(axis=-1, keepdims=True)
    scaled = vectors / np.maximum(largest, 1e-300)
    length = np.linalg.norm(scaled, axis=-1, keepdims=True)
    return scaled / np.maximum(length, 1e-300), length * largest


@dataclass(frozen=True, eq=False)
class Normalisation:
    """The mean and the scale of each channel, which normalisation subtracts and divides by.

    mean, scale : float [shape=(C,)]
    """

    mean: np.ndarray
    scale: np.ndarray

    def __post_init__(self) -> None:
        for name in ("mean", "scale"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        if self.mean.ndim != 1 or self.mean.shape != self.scale.shape:
            raise ValueError(f"mean {self.mean.shape} and scale {self.scale.shape} do not fit together")

    @classmethod
    def of(cls, windows: np.ndarray) -> Normalisation:
        """Measure mean and standard deviation of each channel of `windows` `[shape=(K, C, T)]`.

        The standard deviation is at least 0.01.
        """
        mean = windows.mean(axis=(0, 2), dtype=np.float64)
        scale = windows.std(axis=(0, 2), dtype=np.float64)
        return cls(mean, np.maximum(scale, _LEAST_SCALE))

    def apply(self, channels: np.ndarray) -> np.ndarray:
        """Normalise channels `[shape=(..., C, T)]` to mean 0 and standard deviation 1, in float32."""
        return ((channels - self.mean[:, None]) / self.scale[:, None]).astype(np.float32)

    def undo(self, channels: np.ndarray) -> np.ndarray:
        """Convert normalised channels `[shape=(..., C, T)]` back, to float64."""
        return np.asarray(channels, dtype=np.float64) * self.scale[:, None] + self.mean[:, None]

"""Forward kinematics: joint positions from local rotations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesturegen.motion import rotation
from gesturegen.motion.skeleton import Motion, Skeleton


def world_transforms(motion: Motion, joints: list[int] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Compute world rotations `[shape=(T, K, 4)]` and positions `[shape=(T, K, 3)]` of `joints` (all by default).

    Every ancestor is evaluated on the full skeleton; joints are selected afterwards (§3).
    """
    skeleton = motion.skeleton
    joints = list(range(len(skeleton.names))) if joints is None else list(joints)
    rotations: dict[int, np.ndarray] = {}
    positions: dict[int, np.ndarray] = {}
    for joint in _with_ancestors(skeleton, joints):
        parent = int(skeleton.parents[joint])
        if parent < 0:
            rotations[joint] = np.asarray(motion.rotations[:, joint], dtype=np.float64)
            positions[joint] = np.asarray(motion.positions[:, joint], dtype=np.float64)
        else:
            rotations[joint] = rotation.multiply(rotations[parent], motion.rotations[:, joint])
            positions[joint] = positions[parent] + rotation.rotate(rotations[parent], motion.positions[:, joint])
    return (
        np.stack([rotations[j] for j in joints], axis=1),
        np.stack([positions[j] for j in joints], axis=1),
    )


def joint_positions(motion: Motion, joints: list[int] | None = None) -> np.ndarray:
    """Compute world positions `[shape=(T, K, 3)]` of `joints` in file units."""
    return world_transforms(motion, joints)[1]


def _with_ancestors(skeleton: Skeleton, joints: list[int]) -> list[int]:
    """List joints with all of their ancestors, ascending."""
    needed: set[int] = set()
    for joint in joints:
        above = joint
        while above >= 0 and above not in needed:
            needed.add(above)
            above = int(skeleton.parents[above])
    return sorted(needed)


def travelling_joint(motions: Sequence[Motion]) -> int:
    """Find the first joint whose position channels vary (`body_world` in GENEA data), else the root.

    motions : of one skeleton; positions that differ between them vary too
    """
    low = np.min([motion.positions.min(axis=0) for motion in motions], axis=0)
    high = np.max([motion.positions.max(axis=0) for motion in motions], axis=0)
    return next((int(j) for j in np.flatnonzero((high - low).max(axis=-1) > 1e-6)), 0)


def relative_positions(motion: Motion, joints: list[int], pelvis: int, relative_to: str) -> np.ndarray:
    """Compute world positions `[shape=(T, K, 3)]` of `joints` relative to the pelvis.

    `world`: as they are; `root`: minus the pelvis's position, heading kept; `root_heading`: turned by the
    pelvis's heading as well, so that the direction the speaker faces does not count.
    """
    rotations, positions = world_transforms(motion, [*joints, pelvis])
    if relative_to == "world":
        return positions[:, :-1]
    centred = positions[:, :-1] - positions[:, -1:]
    if relative_to == "root":
        return centred
    turn = rotation.about_y(-rotation.heading(rotations[:, -1]))
    return rotation.rotate(turn[:, None], centred)

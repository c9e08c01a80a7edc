"""Conversion from a file's unit and vertical to centimetres with y up, and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gesturegen.motion.skeleton import Motion, Space

# z up to y up: (x, y, z) becomes (x, z, -y).
_AXES = {"y": [0, 1, 2], "z": [0, 2, 1]}
_SIGNS = {"y": [1.0, 1.0, 1.0], "z": [1.0, 1.0, -1.0]}


def to_inside(motion: Motion, space: Space) -> Motion:
    """Convert a motion from the unit and the vertical of its file to centimetres with y up."""
    if space == Space():
        return motion
    return _converted(motion, space.scale, space.up, space, inverse=False)


def to_file(motion: Motion) -> Motion:
    """Convert a motion to the unit and the vertical of its file."""
    space = motion.skeleton.space
    if space == Space():
        return motion
    return _converted(motion, 1.0 / space.scale, space.up, Space(), inverse=True)


def _converted(motion: Motion, scale: float, up: str, space: Space, inverse: bool) -> Motion:
    """Scale a motion by `scale` and exchange its axes, or exchange them back where `inverse` is set."""
    skeleton = motion.skeleton
    order = _AXES[up]
    signs = np.array(_SIGNS[up])
    if inverse:
        signs = signs[order] if up == "z" else signs

    def turned(vectors: np.ndarray) -> np.ndarray:
        return np.asarray(vectors)[..., order] * signs

    rotations = motion.rotations
    if up != "y":
        # C R C^-1 turns about the axis that C takes R's axis to.
        rotations = np.concatenate([rotations[..., :1], turned(rotations[..., 1:])], axis=-1)
    moved = replace(
        skeleton, offsets=scale * turned(skeleton.offsets), end_sites=scale * turned(skeleton.end_sites), space=space
    )
    return replace(motion, skeleton=moved, rotations=rotations, positions=scale * turned(motion.positions))

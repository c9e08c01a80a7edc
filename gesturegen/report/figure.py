"""The stick figure that the report draws of a skeleton: its joints, sides, heading, size and ground."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from gesturegen.motion import kinematics, rotation
from gesturegen.motion.skeleton import Motion, Skeleton

# Helpers of face and flesh say nothing about a gesture and would fill the head with lines.
_HELPERS = re.compile(r"eye|jaw|teeth|tongue|brow|lip_|lips|cheek|lash|_null|^p_", re.IGNORECASE)
_FINGERS = re.compile(r"index|middle|ring|pinky|little|thumb|finger", re.IGNORECASE)
_SIDES = {
    "l": re.compile(r"(?:^|[_.: -])[lL](?:[_.: -]|$)|[lL]eft|LEFT|(?:^|[_:])[lL](?=[A-Z][a-z])"),
    "r": re.compile(r"(?:^|[_.: -])[rR](?:[_.: -]|$)|[rR]ight|RIGHT|(?:^|[_:])[rR](?=[A-Z][a-z])"),
}


@dataclass(frozen=True, eq=False)
class Figure:
    """The points of a stick figure: joints, then the tips of the feet and of whatever else ends in an End Site.

    joints : numbers in the skeleton, parents first; tips : places among `joints` whose End Site is a point too
    parents : places of each point's parent, -1 for none; sides : `l`, `r` or `m` (the middle) of each
    thin : whether it is a finger's; pelvis, head : places; head is -1 where no joint is called one
    """

    joints: list[int]
    tips: list[int]
    parents: list[int]
    sides: list[str]
    thin: list[bool]
    pelvis: int
    head: int


def of_skeleton(skeleton: Skeleton, root_joint: str) -> Figure:
    """Select the points to draw from the pelvis down the hierarchy, without helper joints that carry no other joint."""
    pelvis = skeleton.pelvis(root_joint)
    inside = [pelvis, *skeleton.descendants(pelvis)]
    if len(inside) == 1:
        # A chain has no pelvis: all of it is drawn.
        inside, pelvis = list(range(len(skeleton.names))), 0
    needed: set[int] = {pelvis}
    for drawn in inside:
        if not _HELPERS.search(skeleton.names[drawn]):
            joint = drawn
            while joint not in needed:
                needed.add(joint)
                joint = int(skeleton.parents[joint])
    joints = sorted(needed)
    place = {joint: k for k, joint in enumerate(joints)}
    names = [skeleton.names[joint] for joint in joints]
    heads = [k for k, name in enumerate(names) if "head" in name.lower()]
    thin = [bool(_FINGERS.search(name)) for name in names]
    # Finger tips are too short to see, and the head is drawn as a circle.
    lengths = np.linalg.norm(skeleton.end_sites[joints], axis=-1)
    tips = [k for k, length in enumerate(lengths) if length > 1e-6 and not thin[k] and k not in heads]
    sides = [side(name) for name in names]
    return Figure(
        joints=joints,
        tips=tips,
        parents=[-1 if joint == pelvis else place[int(skeleton.parents[joint])] for joint in joints] + tips,
        sides=sides + [sides[k] for k in tips],
        thin=thin + [False] * len(tips),
        pelvis=place[pelvis],
        head=heads[0] if heads else -1,
    )


def points(figure: Figure, motion: Motion) -> np.ndarray:
    """Compute the world positions of a figure's points `[shape=(T, K, 3)]`, in file units."""
    rotations, positions = kinematics.world_transforms(motion, figure.joints)
    ends = motion.skeleton.end_sites[[figure.joints[k] for k in figure.tips]]
    return np.concatenate(
        [positions, positions[:, figure.tips] + rotation.rotate(rotations[:, figure.tips], ends)], axis=1
    )


def side(name: str) -> str:
    """Return the side of a joint by its name: `l`, `r`, or else `m`."""
    return next((key for key, pattern in _SIDES.items() if pattern.search(name)), "m")


def facing(figure: Figure, positions: np.ndarray) -> float:
    """Compute the heading of a whole motion, radians from +Z towards +X; 0 for a figure without sides.

    positions : world [shape=(T, K, 3)] of the points. Hips and shoulders tell it, and arms do not:
    the joints of a side that hang on the middle.
    """
    roots = {
        key: [k for k, s in enumerate(figure.sides) if s == key and figure.sides[figure.parents[k]] == "m"]
        for key in "lr"
    }
    if not (roots["l"] and roots["r"]):
        return 0.0
    across = (positions[:, roots["l"]].mean(axis=1) - positions[:, roots["r"]].mean(axis=1)).sum(axis=0)
    # Who faces +Z has the left side at +X, so the heading is `across` turned a quarter about Y.
    return float(np.arctan2(-across[2], across[0]))


def size(positions: np.ndarray) -> float:
    """Compute how large the figure usually is along its longest axis; never 0."""
    extent = float(np.median(np.ptp(positions, axis=1).max(axis=-1)))
    return extent if extent > 1e-6 else 1.0


def floor(positions: np.ndarray) -> float:
    """Compute the height that the lowest joint usually reaches: a single dip does not lower the ground."""
    return float(np.percentile(positions[:, :, 1].min(axis=1), 5))

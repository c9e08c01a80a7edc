"""Mirrored motion: left and right exchanged, so that one recording serves for two."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from gesturegen.errors import DataError
from gesturegen.motion import kinematics, rotation
from gesturegen.motion.roles import LIMB_WORDS
from gesturegen.motion.skeleton import Motion, Skeleton

# A word, or a letter that begins a word and is all of it (`b_l_arm`, `Hand.L`) or stands before a capital (`LArm`).
_SIDE = re.compile(r"left|right|Left|Right|LEFT|RIGHT|(?<![A-Za-z0-9])[lrLR](?![a-z0-9])")
_OTHER = {"left": "right", "Left": "Right", "LEFT": "RIGHT", "l": "r", "L": "R"}
_OTHER |= {right: left for left, right in _OTHER.items()}
# A reflection at x = 0 turns rotations about y and z round; those about x stay.
_REFLECTED_QUATERNION = np.array([1.0, 1.0, -1.0, -1.0])
_REFLECTED_POSITION = np.array([-1.0, 1.0, 1.0])


def partners(names: Sequence[str], pairs: Sequence[tuple[str, str]] = ()) -> np.ndarray:
    """Find the partner of each joint on the other side of the body: int `[shape=(J,)]`.

    A joint in the middle is its own partner.

    pairs : names that belong together whatever they are; a joint paired with itself has no partner
    Other joints are paired where one side marker in a name, exchanged for its opposite, gives the name of
    another joint. The partner of a joint's partner is the joint itself.
    """
    names = list(names)
    numbers = {name: joint for joint, name in enumerate(names)}
    found = np.arange(len(names))
    taken: set[str] = set()
    for left, right in pairs:
        for name in dict.fromkeys((left, right)):
            if name not in numbers:
                raise DataError(_unknown(name, names))
            if name in taken:
                raise DataError(f"joint {name!r} is in two mirror pairs; a joint has one partner")
            taken.add(name)
        found[numbers[left]], found[numbers[right]] = numbers[right], numbers[left]
    for name in names:
        if name in taken:
            continue
        # Of a name with several markers the first that leads to a free joint counts.
        other = next((other for other in _opposites(name) if other in numbers and other not in taken), None)
        if other is not None:
            taken |= {name, other}
            found[numbers[name]], found[numbers[other]] = numbers[other], numbers[name]
    return found


def _opposites(name: str) -> list[str]:
    """List the names in which one side marker of `name` is exchanged for its opposite."""
    found = [name[: side.start()] + _OTHER[side[0]] + name[side.end() :] for side in _SIDE.finditer(name)]
    # `lfemur`, of CMU's own skeletons.
    return found + ([_OTHER[name[0]] + name[1:]] if name[:1] in _OTHER and name[1:] in LIMB_WORDS else [])


def _unknown(name: str, names: list[str]) -> str:
    """Describe a joint of a mirror pair that the skeleton does not have, with the nearest name."""
    near = get_close_matches(name, names, n=1, cutoff=0.4)
    hint = f", nearest is {near[0]!r}" if near else ""
    return f"a mirror pair names joint {name!r}, which the skeleton does not have{hint}; it has: {', '.join(names)}"


def mirror(motion: Motion, partners: np.ndarray) -> Motion:
    """Reflect a motion at the plane x = 0.

    partners : int `[shape=(J,)]`, each joint's partner on the other side, itself in the middle
    Assumes a rest pose whose local axes are parallel to the world's, as in BVH, of a body that faces along z,
    so that left and right lie along x. Each joint does what its partner did, but bones keep their own OFFSET:
    on a skeleton that is not quite symmetric, positions in the world are mirrored not quite exactly, and a
    root whose OFFSET is not at x = 0 is reflected there instead. Mirrored twice, a motion is the one it was.
    """
    offsets = motion.skeleton.offsets
    moved = motion.positions[:, partners] - offsets[partners]
    return replace(
        motion,
        rotations=motion.rotations[:, partners] * _REFLECTED_QUATERNION,
        positions=offsets + moved * _REFLECTED_POSITION,
    )


def mirror_places(motion: Motion, partners: np.ndarray) -> Motion:
    """Reflect a motion at the plane x = 0, whatever the local axes of its joints are at rest.

    partners : as in `mirror`. Every joint is turned so that the joints below it come to where the reflected ones of its
    partner are; about a bone, whose direction alone does not tell, it turns with the joint above. Bones keep their own
    lengths, so places are mirrored exactly where both sides are of the same bones.
    """
    skeleton = motion.skeleton
    worlds, places = kinematics.world_transforms(motion)
    reflected = places * _REFLECTED_POSITION
    turns: list[np.ndarray] = []  # from a joint's own axes to the reflected ones of its partner
    rotations, positions = np.empty_like(motion.rotations), np.array(motion.positions, dtype=np.float64)
    found, where = np.empty_like(worlds), np.empty_like(places)
    travels = np.ptp(positions, axis=0).max(axis=-1) > 1e-6
    for joint, parent in enumerate(skeleton.parents.tolist()):
        other = int(partners[joint])
        turns.append(_turn_to_reflected(skeleton, joint, partners, turns[parent] if parent >= 0 else rotation.IDENTITY))
        found[:, joint] = rotation.multiply(worlds[:, other] * _REFLECTED_QUATERNION, turns[joint])
        if parent < 0:
            rotations[:, joint], positions[:, joint] = found[:, joint], reflected[:, other]
            where[:, joint] = positions[:, joint]
            continue
        back = rotation.inverse(found[:, parent])
        rotations[:, joint] = rotation.multiply(back, found[:, joint])
        if travels[joint] or travels[other]:
            positions[:, joint] = rotation.rotate(back, reflected[:, other] - where[:, parent])
        where[:, joint] = where[:, parent] + rotation.rotate(found[:, parent], positions[:, joint])
    return replace(motion, rotations=rotation.normalize(rotations), positions=positions)


# Of the axes of the joint above beside the bones of a joint, where both have a say.
_WEAK = 1e-3


def _turn_to_reflected(skeleton: Skeleton, joint: int, partners: np.ndarray, above: np.ndarray) -> np.ndarray:
    """Compute the quaternion that turns a joint's bones to the reflected bones of its partner."""
    other = int(partners[joint])
    bones = [(skeleton.offsets[j], skeleton.offsets[partners[j]]) for j in skeleton.children(joint)]
    bones.append((skeleton.end_sites[joint], skeleton.end_sites[other]))
    bones = [(a, b * _REFLECTED_POSITION) for a, b in bones if min(np.linalg.norm(a), np.linalg.norm(b)) > 1e-6]
    axes = np.eye(3)
    size = max((np.linalg.norm(a) for a, _ in bones), default=1.0)
    starts = np.array([*(a / size for a, _ in bones), *axes])
    ends = np.array([*(b / size for _, b in bones), *rotation.rotate(np.tile(above, (3, 1)), axes)])
    weights = np.array([*(1.0 for _ in bones), _WEAK, _WEAK, _WEAK])
    return rotation.aligning(starts, ends, weights)

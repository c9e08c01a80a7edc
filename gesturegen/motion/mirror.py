"""Motion seen in a mirror: left and right exchanged, so that one recording serves for two."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from gesturegen.errors import DataError
from gesturegen.motion.skeleton import Motion

# A word, or a letter that begins a word and is all of it (`b_l_arm`, `Hand.L`) or stands before a capital (`LArm`).
_SIDE = re.compile(r"left|right|Left|Right|LEFT|RIGHT|(?<![A-Za-z0-9])[lrLR](?![a-z0-9])")
_OTHER = {"left": "right", "Left": "Right", "LEFT": "RIGHT", "l": "r", "L": "R"}
_OTHER |= {right: left for left, right in _OTHER.items()}
# A reflection at x = 0 turns rotations about y and z round; those about x stay.
_REFLECTED_QUATERNION = np.array([1.0, 1.0, -1.0, -1.0])
_REFLECTED_POSITION = np.array([-1.0, 1.0, 1.0])


def partners(names: Sequence[str], pairs: Sequence[tuple[str, str]] = ()) -> np.ndarray:
    """For each joint the one on the other side of the body, itself in the middle: int `[shape=(J,)]`.

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
    """The name with each of its side markers exchanged, one at a time."""
    return [name[: side.start()] + _OTHER[side[0]] + name[side.end() :] for side in _SIDE.finditer(name)]


def _unknown(name: str, names: list[str]) -> str:
    near = get_close_matches(name, names, n=1, cutoff=0.4)
    hint = f", nearest is {near[0]!r}" if near else ""
    return f"a mirror pair names joint {name!r}, which the skeleton does not have{hint}; it has: {', '.join(names)}"


def mirror(motion: Motion, partners: np.ndarray) -> Motion:
    """The motion reflected at the plane x = 0.

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

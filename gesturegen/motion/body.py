"""Parts of the body, derived from the hierarchy and the rest pose: legs, trunk, limbs, fingers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from gesturegen.motion import roles
from gesturegen.motion.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class Body:
    """The joints of the upper and the lower body, ascending; every joint is in either `upper` or `lower`.

    upper : int [shape=(U,)], trunk, head and arms
    lower : int [shape=(L,)], the pelvis, what is above it in the hierarchy, and legs
    limbs : int [shape=(K,)], arms, hands and head, all of them in `upper`
    """

    upper: np.ndarray
    lower: np.ndarray
    limbs: np.ndarray


def split(skeleton: Skeleton, pelvis: int) -> Body:
    """Split a skeleton into the upper and the lower body, and list the limbs of the upper one.

    A branch of the pelvis is part of the lower body when it has an ankle and of the upper one when it has the head or
    a wrist (`roles`). Of another branch the rest pose decides (y up): the lower body has it when its joint or end
    site farthest from the pelvis is lower than the pelvis. Limbs are what is above the chest.
    """
    found = roles.recognise(skeleton)
    lower_ends, upper_ends = set(found.pair("ankle")), {found["head"], *found.pair("wrist")}
    below = {branch: [branch, *skeleton.descendants(branch)] for branch in skeleton.children(pelvis)}
    rest = rest_positions(skeleton)
    upper, limbs = [], []
    for branch, joints in below.items():
        up, down = bool(upper_ends & set(joints)), bool(lower_ends & set(joints))
        if (down and not up) or (up == down and _hangs(skeleton, rest, joints, rest[pelvis])):
            continue
        upper.extend(joints)
        chest = _chest(skeleton, branch)
        if chest is not None:
            limbs.extend(skeleton.descendants(chest))
    return Body(_numbers(upper), _numbers(set(range(len(skeleton.names))) - set(upper)), _numbers(limbs))


def fingers(skeleton: Skeleton, wrist_names: Sequence[str]) -> np.ndarray:
    """List the joints below any of the named wrists, without these wrists: int `[shape=(K,)]`, ascending.

    Names that the skeleton does not have say nothing.
    """
    wrists = {joint for joint, name in enumerate(skeleton.names) if name in wrist_names}
    return _numbers({joint for wrist in wrists for joint in skeleton.descendants(wrist)} - wrists)


def _numbers(joints: Iterable[int]) -> np.ndarray:
    """Sort joints to an int64 array."""
    return np.array(sorted(joints), dtype=np.int64)


def rest_positions(skeleton: Skeleton) -> np.ndarray:
    """Compute world positions `[shape=(J, 3)]` in the pose in which no joint turns."""
    rest = np.array(skeleton.offsets, dtype=np.float64)
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            rest[joint] += rest[parent]
    return rest


def _hangs(skeleton: Skeleton, rest: np.ndarray, joints: list[int], pelvis: np.ndarray) -> bool:
    """Tell whether the point of a branch that is farthest from the pelvis lies below it at rest."""
    ends = rest[joints] + skeleton.end_sites[joints]
    places = np.concatenate([rest[joints], ends[~np.isnan(ends).any(axis=1)]])
    farthest = places[np.argmax(np.linalg.norm(places - pelvis, axis=1))]
    return bool(farthest[1] < pelvis[1])


def _chest(skeleton: Skeleton, joint: int) -> int | None:
    """Find the first joint from `joint` upwards where two chains part; None where there is none.

    A chain is two joints or more: helpers such as GENEA's `p_navel` are single joints beside the spine.
    """
    while True:
        chains = [child for child in skeleton.children(joint) if skeleton.children(child)]
        if len(chains) != 1:
            return joint if chains else None
        joint = chains[0]

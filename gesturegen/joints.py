"""The joints of a skeleton that the settings mean.

The defaults of all settings that name joints are GENEA's joints. A skeleton that has none of them is another family's:
its own joints of the same roles stand in for them (`motion/roles.py`). Joints that a config names itself are meant.
"""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any

import numpy as np

from gesturegen.methods import METHODS
from gesturegen.motion import body, roles
from gesturegen.motion.roles import SIDES, Roles
from gesturegen.motion.skeleton import Skeleton
from gesturegen.settings.control import Control
from gesturegen.settings.models import GENEA_JOINTS, Config, Evaluation, Feet, Positions, Wrists

# Intrinsic orders that begin with the axis along a bone.
_ROLL_FIRST = ("XYZ", "YZX", "ZXY")
_SEAM_ROLES = ("upper_arm", "elbow", "wrist", "ankle")
_ALIGNMENT_ROLES = ("shoulder", "upper_arm", "elbow", "wrist")


def roles_of(skeleton: Skeleton, config: Config) -> Roles:
    """Recognise the roles of a skeleton's joints, some of them perhaps set in section `skeleton`."""
    return roles.recognise(skeleton, config.roles)


def settings_for(skeleton: Skeleton, config: Config) -> Config:
    """Adapt the config to a skeleton: its joints replace defaults that name joints which it does not have."""
    names = set(skeleton.names)

    def unknown(value: str | tuple[str, ...], default: str | tuple[str, ...]) -> bool:
        given = (value,) if isinstance(value, str) else value
        return value == default and (bool(config.roles) or not names & set(given))

    found = roles_of(skeleton, config)
    changes: dict[str, object] = {}

    def put(section: str, **values: Any) -> None:
        changes[section] = getattr(config, section).model_copy(update={k: v for k, v in values.items() if v})

    def named(joints: Sequence[int]) -> tuple[str, ...]:
        return tuple(skeleton.names[joint] for joint in joints if joint >= 0)

    if unknown(config.positions.root_joint, Positions().root_joint) and found["pelvis"] >= 0:
        put("positions", root_joint=skeleton.names[found["pelvis"]])
    if config.joints != "all" and unknown(config.joints, GENEA_JOINTS) and found.is_body:
        changes["joints"] = named(found.body)
    if unknown(config.wrists.joints, Wrists().joints):
        wrists = _wrists(skeleton, found)
        axes = _roll_first(skeleton, found) if config.wrists.axes == Wrists().axes else None
        put("wrists", joints=named(wrists), axes=axes)
    if unknown(config.feet.joints, Feet().joints):
        put("feet", joints=named(found.pair("ankle")))
    sides = {side: named([found[f"{side}_wrist"]]) for side in SIDES}
    put("control", **{
        side: sides[side][0] for side in SIDES
        if sides[side] and unknown(getattr(config.control, side), getattr(Control(), side))
    })  # fmt: skip
    for method in METHODS.values():
        for key, parts in method.joint_settings.items():
            section, _, name = key.partition(".")
            own = getattr(config, section)
            if unknown(getattr(own, name), getattr(type(own)(), name)):
                put(section, **{name: named([joint for part in parts for joint in _of_part(skeleton, found, part)])})
    evaluation = {}
    if unknown(config.evaluation.seam_joints, Evaluation().seam_joints):
        middle = [found["pelvis"], *found.spine[-1:], found["head"]]
        evaluation["seam_joints"] = named([*middle, *(j for part in _SEAM_ROLES for j in found.pair(part))])
    if unknown(config.evaluation.alignment_joints, Evaluation().alignment_joints):
        trunk = [*found.spine[-3:], found["neck"], found["head"]]
        evaluation["alignment_joints"] = named([*trunk, *(j for part in _ALIGNMENT_ROLES for j in found.pair(part))])
    if evaluation:
        put("evaluation", **evaluation)
    changes = {key: value for key, value in changes.items() if value != getattr(config, key)}
    return config.model_copy(update=changes) if changes else config


def unknown_names(skeleton: Skeleton, config: Config) -> list[str]:
    """Describe names in the config that are not joints of this skeleton and so have no effect, a line for each."""
    given = [
        (f"skeleton.{role}", name) for role, own in config.roles for name in ((own,) if isinstance(own, str) else own)
    ]
    if config.feet.joints != Feet().joints:
        given += [("feet.joints", name) for name in config.feet.joints]
    lines = []
    for key, name in given:
        if name not in skeleton.names:
            near = get_close_matches(name, skeleton.names, n=1, cutoff=0.4)
            hint = f"; nearest is {near[0]!r}" if near else ""
            lines.append(f"{key}: the skeleton has no joint {name!r}, so this says nothing{hint}")
    return lines


def hand_names(skeleton: Skeleton, config: Config) -> tuple[str, ...]:
    """Name the joints that are the left and the right hand by their roles; empty where one is not known."""
    found = roles_of(skeleton, config).pair("wrist")
    return tuple(skeleton.names[joint] for joint in found) if len(found) == 2 else ()


def fingers(skeleton: Skeleton, config: Config) -> np.ndarray:
    """List the joints of the fingers, int `[shape=(K,)]`, ascending: those that are set, else all below the wrists."""
    own = settings_for(skeleton, config)
    if config.skeleton.left_fingers is None and config.skeleton.right_fingers is None:
        return body.fingers(skeleton, own.wrists.joints)
    found = roles_of(skeleton, config).fingers
    return np.array(sorted({joint for joints in found.values() for joint in joints}), dtype=np.int64)


def _wrists(skeleton: Skeleton, found: Roles) -> list[int]:
    """List the wrists, and joints between elbow and wrist that twist the forearm."""
    joints = found.pair("wrist")
    for side in SIDES:
        joint, elbow = found[f"{side}_wrist"], found[f"{side}_elbow"]
        joint = int(skeleton.parents[joint]) if joint >= 0 else -1
        while elbow >= 0 and joint > elbow:
            joints.append(joint)
            joint = int(skeleton.parents[joint])
    return joints


def _roll_first(skeleton: Skeleton, found: Roles) -> str | None:
    """Return the order of angles whose first axis is that of the forearm; None without forearms."""
    ways: list[np.ndarray] = []
    for side in SIDES:
        joint, elbow, way = found[f"{side}_wrist"], found[f"{side}_elbow"], np.zeros(3)
        while elbow >= 0 and joint > elbow:
            way = way + abs(skeleton.offsets[joint])
            joint = int(skeleton.parents[joint])
        if elbow >= 0:
            ways.append(way)
    return _ROLL_FIRST[int(np.sum(ways, axis=0).argmax())] if ways else None


def _of_part(skeleton: Skeleton, found: Roles, part: str) -> list[int]:
    """List the joints of both sides that are a part of the body: one of `roles.LIMBS`, or `finger_roots`."""
    return _finger_roots(skeleton, found) if part == "finger_roots" else list(found.pair(part))


def _finger_roots(skeleton: Skeleton, found: Roles) -> list[int]:
    """List the first joints of the outer fingers, index and little finger, where names tell them."""
    joints = []
    for words in (("index",), ("pinky", "little")):
        for side in SIDES:
            named = [j for j in found.fingers.get(side, ()) if any(w in skeleton.names[j].lower() for w in words)]
            joints += named[:1]
    return joints

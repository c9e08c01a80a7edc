"""The roles of joints (pelvis, left wrist, right ankle), recognised by names, else by the shape of the skeleton.

Names are read as words (`mixamorig:LeftForeArm`, `b_l_forearm`, `lowerarm_l` and `lradius` are the left forearm), and
a role is given to a joint only where the hierarchy agrees: an elbow lies between an upper arm and a wrist. What names
do not tell, the hierarchy does: two legs that part at the pelvis, two arms that part at the chest, and their two
longest bones.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from gesturegen.motion.skeleton import Skeleton

SIDES = ("left", "right")
_MIDDLE = ("pelvis", "neck", "head")
LIMBS = ("shoulder", "upper_arm", "elbow", "wrist", "hip", "knee", "ankle", "toes")
# Every role that one joint has.
ROLES = (*_MIDDLE, *(f"{side}_{part}" for side in SIDES for part in LIMBS))
# Joints nearer than this share of the body's height to the joint above are at the same place.
_SAME_PLACE = 1e-4

_WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")
_PREFIXES = {
    "b", "p", "m", "f", "j", "avg", "mixamorig", "bip", "biped", "def", "org", "mcp", "jnt", "joint", "bn", "bone",
    "robot", "character", "rig", "sk", "skel", "actor", "armature", "cc",
}  # fmt: skip
_HELPERS = {
    "twist", "roll", "ik", "end", "nub", "tip", "null", "eff", "effector", "site", "pole", "target", "ctrl", "helper",
    "corrective", "delt", "scap", "muscle", "share", "weapon", "prop", "socket", "camera", "gun", "navel", "top",
}  # fmt: skip
_FACE = re.compile(r"eye|jaw|teeth|tooth|tongue|brow|lip(?!joint)|lid|cheek|nose|lash|face|mouth|hair|(?<!r)ear(?!m)")
_COLLARS = ("clavicle", "collar", "clav")
_UPPER_ARMS = ("upperarm", "uparm", "humerus", "shldr", "arm", "shoulderjoint")
_ELBOWS = ("elbow", "forearm", "lowerarm", "lowarm", "radius", "lower arm")
_HIPS = ("thigh", "upleg", "upperleg", "femur", "hip")
_KNEES = ("knee", "shin", "calf", "tibia", "lowerleg", "lowleg", "leg")
_TOES = ("toe", "toes", "toebase", "ball", "forefoot", "footf", "foot")
# What follows a side without anything between: `lfemur`, `rightfoot`.
LIMB_WORDS = {
    *_COLLARS, *_UPPER_ARMS, *_ELBOWS, *_HIPS, *_KNEES, *_TOES, "shoulder", "hand", "wrist", "ankle", "hipjoint",
    "fingers", "thumb", "index", "middle", "ring", "pinky", "buttock", "scapula",
}  # fmt: skip


@dataclass(frozen=True)
class _Name:
    """A joint's name taken apart: its side (`left`, `right` or empty), its words in one, and whether it is a helper."""

    side: str
    stem: str
    helper: bool
    number: str = ""


def _read(name: str) -> _Name:
    """Parse a joint's name."""
    words = _WORDS.findall(re.split(r"[:|]", name)[-1])
    lower = [word.lower() for word in words]
    side = ""
    kept: list[str] = []
    number = ""
    for place, word in enumerate(lower):
        if word.isdigit():
            number = word
            continue
        if not side and word in ("l", "r", "left", "right") and len(lower) > 1:
            side = "left" if word.startswith("l") else "right"
            continue
        if not kept and word in _PREFIXES and place < len(lower) - 1:
            continue
        if word == "base" and place and lower[place - 1] == "cc":
            continue
        kept.append(word)
    if not side and kept:
        for mark, of in (("left", "left"), ("right", "right"), ("l", "left"), ("r", "right")):
            rest = kept[0].removeprefix(mark)
            if rest != kept[0] and rest and (rest in LIMB_WORDS or len(mark) > 1):
                side, kept[0] = of, rest
                break
    helper = bool(_HELPERS & set(kept)) or any(word.endswith(("nub", "twist")) for word in kept)
    stem = "".join(kept)
    return _Name(side, stem, helper or bool(_FACE.search(stem)), number)


@dataclass(frozen=True, eq=False)
class Roles:
    """The joints of a body, by number; -1 or empty where there is no such joint.

    family : what the names are those of, in words; joints : by role (`ROLES`)
    spine : from above the pelvis to the joint at which the arms part; fingers : by side, all below the wrist
    by_shape : roles that the hierarchy told and not the names; body : joints that distances are measured on
    """

    family: str
    joints: Mapping[str, int]
    spine: tuple[int, ...] = ()
    fingers: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    by_shape: tuple[str, ...] = ()
    body: tuple[int, ...] = ()

    def __getitem__(self, role: str) -> int:
        return self.joints.get(role, -1)

    def pair(self, part: str) -> list[int]:
        """Return the joints of a part on both sides, left first, as far as there are any."""
        return [joint for side in SIDES if (joint := self[f"{side}_{part}"]) >= 0]

    @property
    def is_body(self) -> bool:
        """Tell whether there is a trunk with a pair of arms or of legs: enough to call the rest of the joints a body."""
        pairs = (len(self.pair("wrist")) == 2, len(self.pair("ankle")) == 2)
        return self["pelvis"] >= 0 and self["head"] >= 0 and any(pairs)


def recognise(skeleton: Skeleton, overrides: Sequence[tuple[str, str | tuple[str, ...]]] = ()) -> Roles:
    """Recognise the roles of a skeleton's joints.

    overrides : (role, joint name), which win, with several names for `spine`, `left_fingers` and `right_fingers`; names
        that the skeleton does not have say nothing
    """
    made_of = skeleton.parents, skeleton.offsets, skeleton.end_sites
    hierarchy = _Hierarchy(skeleton.names, tuple(array.tobytes() for array in made_of), skeleton)
    return _recognise(hierarchy, tuple(overrides))


@dataclass(frozen=True)
class _Hierarchy:
    """A skeleton that equals another one when all is equal that tells roles: every file that is read has its own."""

    names: tuple[str, ...]
    arrays: tuple[bytes, ...]
    skeleton: Skeleton = field(compare=False)


@lru_cache(maxsize=64)
def _recognise(hierarchy: _Hierarchy, overrides: tuple[tuple[str, str | tuple[str, ...]], ...]) -> Roles:
    """Recognise the roles of a skeleton's joints, once for each hierarchy and overrides."""
    skeleton = hierarchy.skeleton
    tree = _Tree(skeleton)
    found = _by_names(tree)
    by_shape: set[str] = set()
    if not _complete(found):
        shaped = _by_shape(tree, found)
        by_shape = {role for role in shaped if role not in found}
        found = shaped | found
    several: dict[str, tuple[int, ...]] = {}
    for role, name in overrides:
        if not isinstance(name, str):
            several[role] = tuple(sorted(skeleton.names.index(one) for one in name if one in skeleton.names))
        elif name in skeleton.names:
            found[role] = skeleton.names.index(name)
            by_shape.discard(role)
    joints = {role: found[role] for role in ROLES if role in found}
    spine = several.get("spine", _spine(tree, joints))
    fingers = {
        side: several.get(f"{side}_fingers", tuple(skeleton.descendants(joints[f"{side}_wrist"])))
        for side in SIDES
        if f"{side}_wrist" in joints
    }
    return Roles(
        family_of(skeleton.names), joints, spine, fingers, tuple(sorted(by_shape, key=ROLES.index)),
        _body_joints(tree, joints, fingers),
    )  # fmt: skip


def _complete(found: Mapping[str, int]) -> bool:
    """Tell whether the pelvis, the head, and both wrists and ankles are known."""
    return all(role in found for role in ("pelvis", "head", *(f"{s}_{p}" for s in SIDES for p in ("wrist", "ankle"))))


class _Tree:
    """A skeleton with its hierarchy and bone lengths in a form that is quick to query."""

    def __init__(self, skeleton: Skeleton):
        self.skeleton = skeleton
        self.parents = [int(parent) for parent in skeleton.parents]
        self.names = [_read(name) for name in skeleton.names]
        self.children: list[list[int]] = [[] for _ in self.parents]
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                self.children[parent].append(joint)
        self.lengths = np.linalg.norm(skeleton.offsets, axis=1)

    def chain(self, joint: int) -> list[int]:
        """List the joint and all of its ancestors, the root first."""
        found = []
        while joint >= 0:
            found.append(joint)
            joint = self.parents[joint]
        return found[::-1]

    def above(self, upper: int, lower: int) -> bool:
        """Tell whether `upper` is `lower` or one of its ancestors."""
        return upper in self.chain(lower)

    def meeting(self, joints: Iterable[int]) -> int:
        """Find the lowest common ancestor of joints; -1 for none."""
        chains = [self.chain(joint) for joint in joints]
        met = -1
        for row in zip(*chains, strict=False):
            if len(set(row)) > 1:
                break
            met = row[0]
        return met

    def between(self, upper: int, lower: int) -> list[int]:
        """List the joints from below `upper` to above `lower`."""
        chain = self.chain(lower)
        return chain[chain.index(upper) + 1 : -1] if upper in chain else []

    def first(self, stems: Sequence[str], side: str, under: int = -1, over: int = -1, number: bool = True) -> int:
        """Find the joint nearest to the root whose name is one of `stems`, earlier stems first; -1 for none.

        under : a joint that it hangs on; over : a joint that hangs on it; number : whether a number may follow
        """
        for stem in stems:
            for joint, name in enumerate(self.names):
                if name.helper or name.side != side or name.stem != stem or (name.number and not number):
                    continue
                if under >= 0 and (joint == under or not self.above(under, joint)):
                    continue
                if over >= 0 and (joint == over or not self.above(joint, over)):
                    continue
                return joint
        return -1

    def middle(self, upper: int, lower: int) -> int:
        """Find the joint nearest to the middle between two joints, by the lengths of bones; -1 for none."""
        inside = self.between(upper, lower)
        if not inside:
            return -1
        chain = [*inside, lower]
        ways = np.cumsum([self.lengths[joint] for joint in chain])
        best = int(np.argmin(np.abs(2.0 * ways[:-1] - ways[-1])))
        return inside[best]


# --- by names -----------------------------------------------------------------------------------------------


def _by_names(tree: _Tree) -> dict[str, int]:
    """Recognise joints by their names: role -> joint."""
    found: dict[str, int] = {}
    for side in SIDES:
        found |= {f"{side}_{part}": joint for part, joint in _arm(tree, side).items() if joint >= 0}
        found |= {f"{side}_{part}": joint for part, joint in _leg(tree, side).items() if joint >= 0}
    head = tree.first(("head", "skull"), "", number=False)
    if head < 0:
        head = tree.first(("head", "skull"), "")
    if head >= 0:
        found["head"] = head
        neck = next((j for j in tree.chain(head)[:-1] if "neck" in tree.names[j].stem and not tree.names[j].helper), -1)
        if neck >= 0:
            found["neck"] = neck
    hips = [found[role] for side in SIDES if (role := f"{side}_hip") in found]
    pelvis = tree.first(("hips", "pelvis", "hip"), "")
    ends = [*hips, *([head] if head >= 0 else [])]
    if pelvis >= 0 and ends and not all(tree.above(pelvis, end) for end in ends):
        # A helper of that name, or a pelvis that the spine does not hang on: then what all of it hangs on is meant.
        pelvis = tree.meeting(hips) if len(hips) == 2 and tree.meeting(hips) in tree.chain(pelvis) else -1
    if pelvis < 0 and len(hips) == 2:
        pelvis = tree.meeting(hips)
    if pelvis < 0 and (root := tree.first(("root",), "")) >= 0 and len(tree.children[root]) > 1:
        pelvis = root if ends and all(tree.above(root, end) for end in ends) else -1
    if pelvis >= 0:
        found["pelvis"] = pelvis
    return found


def _arm(tree: _Tree, side: str) -> dict[str, int]:
    """Recognise the joints of one arm by their names."""
    wrist = tree.first(("wrist",), side)
    wrist = wrist if wrist >= 0 else tree.first(("hand",), side)
    if wrist < 0:
        return {}
    elbow = tree.first(_ELBOWS, side, over=wrist)
    below = elbow if elbow >= 0 else wrist
    upper = tree.first(_UPPER_ARMS, side, over=below)
    collar = tree.first((*_COLLARS, *(("shoulder",) if upper >= 0 else ())), side, over=upper if upper >= 0 else below)
    if upper < 0:
        upper = tree.first(("shoulder",), side, over=below)
    if collar == upper:
        collar = -1
    if elbow < 0 and upper >= 0:
        elbow = tree.middle(upper, wrist)
    if upper < 0 or elbow < 0:
        return {}
    return {"shoulder": collar, "upper_arm": upper, "elbow": elbow, "wrist": wrist}


def _leg(tree: _Tree, side: str) -> dict[str, int]:
    """Recognise the joints of one leg by their names."""
    ankle = tree.first(("ankle",), side)
    ankle = ankle if ankle >= 0 else tree.first(("foot",), side)
    if ankle < 0:
        return {}
    knee = tree.first(_KNEES[:-1], side, over=ankle)
    hip = tree.first(_HIPS, side, over=knee if knee >= 0 else ankle)
    if knee < 0:
        knee = tree.first(("leg",), side, under=hip, over=ankle)
    elif hip < 0:
        hip = tree.first(("leg",), side, over=knee)
    if knee < 0 and hip >= 0:
        knee = tree.middle(hip, ankle)
    if hip < 0 or knee < 0:
        return {}
    return {"hip": hip, "knee": knee, "ankle": ankle, "toes": tree.first(_TOES, side, under=ankle)}


# --- by shape -----------------------------------------------------------------------------------------------


def _by_shape(tree: _Tree, named: Mapping[str, int]) -> dict[str, int]:
    """Recognise joints by the shape of the hierarchy: role -> joint, empty where it is not that of a body.

    named : roles that are known from names; they take part in the recognition
    """
    legs = _symmetric_branches(tree, named.get("pelvis", -1), None)
    if legs is None:
        return {}
    pelvis, left_leg, right_leg = legs
    arms = _symmetric_branches(tree, -1, (pelvis, {left_leg, right_leg}))
    if arms is None:
        return {}
    chest, left_arm, right_arm = arms
    found = {"pelvis": pelvis}
    for parts, pair in (
        (("hip", "knee", "ankle"), (left_leg, right_leg)), (("upper_arm", "elbow", "wrist"), (left_arm, right_arm)),
    ):  # fmt: skip
        limbs = [limb for branch in pair if (limb := _limb(tree, branch)) is not None]
        if len(limbs) < len(pair):
            return {}
        for side, limb in zip(SIDES, _left_first(tree, limbs), strict=True):
            found |= {f"{side}_{part}": joint for part, joint in zip(parts, limb[:3], strict=True)}
            if parts[0] == "hip" and len(limb) > 3:
                found[f"{side}_toes"] = limb[3]
            if parts[0] != "hip" and (above := tree.parents[limb[0]]) != chest:
                found[f"{side}_shoulder"] = above
    trunk = [branch for branch in tree.children[chest] if branch not in (left_arm, right_arm)]
    chains = [chain for branch in trunk if (chain := _main_chain(tree, branch))]
    if chains:
        longest = max(chains, key=lambda chain: sum(tree.lengths[joint] for joint in chain))
        # The last joint of all is often the end of the skull.
        ends = np.isnan(tree.skeleton.end_sites[longest[-1]]).any() or np.allclose(
            tree.skeleton.end_sites[longest[-1]], 0.0
        )
        found["head"] = longest[-2] if ends and len(longest) > 2 else longest[-1]
        if longest[0] != found["head"]:
            found["neck"] = longest[0]
    return found


def _symmetric_branches(tree: _Tree, at: int, below: tuple[int, set[int]] | None) -> tuple[int, int, int] | None:
    """Find the joint nearest to the root from which two long branches of equal bones hang.

    Returns the joint and the two branches; None where there is no such joint.

    at : the only joint that may be it, -1 for any; below : a joint that it hangs on (or is), and branches it is not in
    """
    banned = set()
    if below is not None:
        banned = {j for branch in below[1] for j in (branch, *tree.skeleton.descendants(branch))}
    best = None
    for joint in range(len(tree.parents)):
        if (at >= 0 and joint != at) or joint in banned:
            continue
        if below is not None and not tree.above(below[0], joint):
            continue
        branches = [branch for branch in tree.children[joint] if branch not in banned]
        chains = {branch: _main_chain(tree, branch) for branch in branches}
        pairs = [
            (float(tree.lengths[chains[a]].sum()), a, b)
            for k, a in enumerate(branches)
            for b in branches[k + 1 :]
            if _alike(tree, chains[a], chains[b])
        ]
        # Of legs another branch, the trunk, is to lead on; of arms the head may be missing.
        if pairs and (below is not None or len(branches) > 2):
            _, a, b = max(pairs)
            depth = len(tree.chain(joint))
            if best is None or depth < best[0]:
                best = (depth, (joint, a, b))
    return None if best is None else best[1]


def _main_chain(tree: _Tree, joint: int) -> list[int]:
    """List the joints from `joint` downwards along the longest way."""
    ways: dict[int, float] = {}
    below: dict[int, int] = {}
    for j in sorted([joint, *tree.skeleton.descendants(joint)], reverse=True):
        child = max(tree.children[j], key=lambda c: ways[c], default=-1)
        end = tree.skeleton.end_sites[j]
        tail = 0.0 if np.isnan(end).any() else float(np.linalg.norm(end))
        ways[j] = float(tree.lengths[j]) + (ways[child] if child >= 0 else tail)
        below[j] = child
    chain = [joint]
    while below[chain[-1]] >= 0:
        chain.append(below[chain[-1]])
    return chain


def _alike(tree: _Tree, one: list[int], other: list[int]) -> bool:
    """Tell whether two chains have as many bones, long ones among them, of equal lengths within 15 %."""
    if len(one) != len(other) or len(one) < 3:
        return False
    first, second = tree.lengths[one], tree.lengths[other]
    longest = max(first.max(), second.max())
    # Two long bones at least: fingers and faces have none.
    return bool(
        longest > 0 and np.abs(first - second).max() <= 0.15 * longest and (first[1:] > 0.5 * longest).sum() >= 2
    )


def _limb(tree: _Tree, branch: int) -> list[int] | None:
    """Find the start, middle and end of the last two long bones of a limb, and the joint after them if there is one.

    A collar bone may be as long as a forearm and comes before; a hand or a foot is shorter.
    """
    chain = _main_chain(tree, branch)
    lengths = tree.lengths[chain]
    if len(chain) < 3:
        return None
    long = np.flatnonzero(lengths[1:] >= 0.65 * lengths[1:].max()) + 1
    longest = long[-2:] if len(long) > 1 else sorted(np.argsort(-lengths[1:], kind="stable")[:2] + 1)
    upper, lower = chain[longest[0] - 1], chain[longest[1] - 1]
    rest = [joint for joint in chain[longest[1] + 1 :] if tree.lengths[joint] > 0.02 * lengths.max()]
    return [upper, lower, chain[longest[1]], *rest[:1]]


def _left_first(tree: _Tree, limbs: list[list[int]]) -> list[list[int]]:
    """Order two limbs, the left one first: by names, else by larger x at rest.

    A body at rest faces along z, with y or z up.
    """
    sides = [next((tree.names[j].side for j in limb if tree.names[j].side), "") for limb in limbs]
    if set(sides) == set(SIDES):
        return limbs if sides[0] == "left" else limbs[::-1]
    places = np.array(tree.skeleton.offsets, dtype=float)
    for joint, parent in enumerate(tree.parents):
        if parent >= 0:
            places[joint] += places[parent]
    across = places[limbs[0][0]] - places[limbs[1][0]]
    return limbs if across[0] >= 0 else limbs[::-1]


# --- what follows of the roles ------------------------------------------------------------------------------


def _spine(tree: _Tree, joints: Mapping[str, int]) -> tuple[int, ...]:
    """List the joints of the spine, from above the pelvis to the chest."""
    pelvis = joints.get("pelvis", -1)
    ends = [joints[role] for role in ("left_upper_arm", "right_upper_arm", "head") if role in joints]
    if pelvis < 0 or not ends:
        return ()
    chest = tree.meeting(ends)
    if chest < 0 or not tree.above(pelvis, chest) or chest == pelvis:
        return ()
    return (*tree.between(pelvis, chest), chest)


def _body_joints(tree: _Tree, joints: Mapping[str, int], fingers: Mapping[str, Sequence[int]]) -> tuple[int, ...]:
    """List joints from the pelvis to head, wrists and ankles, each place once.

    Fingers, toes, face and helpers are left out.
    """
    pelvis = joints.get("pelvis", -1)
    ends = [
        joints[role] for role in ("head", *(f"{s}_{p}" for s in SIDES for p in ("wrist", "ankle"))) if role in joints
    ]
    kept = set(joints.values()) - {joints.get(f"{side}_toes", -1) for side in SIDES}
    height = float(tree.lengths.max(initial=0.0))
    for end in ends:
        if pelvis >= 0 and tree.above(pelvis, end):
            kept |= {j for j in tree.between(pelvis, end) if tree.lengths[j] > _SAME_PLACE * height}
    return tuple(sorted(kept - {-1} - {joint for own in fingers.values() for joint in own}))


def bone_length(skeleton: Skeleton, upper: int, lower: int) -> float:
    """Sum the lengths of the OFFSETs from one joint down to another; 0 where neither is below the other."""
    length, joint = 0.0, lower
    while joint >= 0 and joint != upper:
        length += float(np.linalg.norm(skeleton.offsets[joint]))
        joint = int(skeleton.parents[joint])
    return length if joint == upper else 0.0


def body_height(skeleton: Skeleton, roles: Roles) -> float:
    """Compute how tall a standing figure is, in the unit of its skeleton, from the bones of head, trunk and legs.

    Without legs it is told from the trunk, without a trunk or a head it is 0.
    """
    pelvis, head = roles["pelvis"], roles["head"]
    if pelvis < 0 or head < 0:
        return 0.0
    trunk = bone_length(skeleton, pelvis, head)
    neck_to_head = trunk / 6.0
    end = skeleton.end_sites[head]
    skull = 0.0 if np.isnan(end).any() else float(np.linalg.norm(end))
    for joint in skeleton.children(head):
        skull = max(skull, float(np.linalg.norm(skeleton.offsets[joint])))
    trunk += max(skull, neck_to_head)
    legs = []
    for side in SIDES:
        hip, knee, ankle = (roles[f"{side}_{part}"] for part in ("hip", "knee", "ankle"))
        if hip >= 0 and knee >= 0 and ankle >= 0:
            legs.append(bone_length(skeleton, hip, knee) + bone_length(skeleton, knee, ankle))
    # Legs are half of a body; the soles are 4 % below the ankles.
    return (trunk + max(legs)) * 1.04 if legs and max(legs) > 0 else 2.0 * trunk


# --- families -----------------------------------------------------------------------------------------------

# What tells a family: names of joints that all must be there, without case and prefixes.
_FAMILIES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("GENEA", ("b_root", "b_spine0", "b_l_forearm")),
    ("BEAT", ("RArm1", "RHandM1", "RToeBase")),
    ("ZEGGS / Trinity", ("Spine3", "Neck1", "RightForeArmEnd")),
    ("Trinity", ("Spine3", "Neck1", "RightForeArm", "RightHandIndex1")),
    ("CMU", ("LHipJoint", "LowerBack", "LeftUpLeg")),
    ("CMU", ("lhipjoint", "lfemur", "lhumerus")),
    ("CMU / DAZ", ("rButtock", "rThigh", "rShldr")),
    ("Xsens", ("Chest", "RightCollar", "RightElbow", "RightWrist", "RightKnee")),
    ("Xsens", ("L5", "T8", "RightUpperArm", "RightUpperLeg")),
    ("Rokoko", ("LeftThigh", "LeftShin", "LeftArm", "LeftForeArm")),
    ("Perception Neuron", ("RightInHandIndex", "RightForeArm", "RightUpLeg")),
    ("SMPL", ("L_Collar", "L_Elbow", "L_Wrist", "L_Knee")),
    ("SMPL", ("left_collar", "left_elbow", "left_wrist", "left_knee")),
    ("Unreal", ("spine_01", "upperarm_l", "lowerarm_l", "thigh_l")),
    ("Biped", ("Bip01 Pelvis", "Bip01 L UpperArm")),
    ("Biped", ("Bip001 Pelvis", "Bip001 L UpperArm")),
    ("Bandai-Namco", ("joint_Root", "UpperArm_L", "LowerArm_L", "UpperLeg_L")),
    ("Rigify", ("DEF-spine", "DEF-forearm.L")),
)  # fmt: skip


def family_of(names: Sequence[str]) -> str:
    """Name the system that exports joints of such names, in words; empty for an unknown one."""
    if any(re.match(r"mixamorig\d*[:_]?", name) for name in names):
        return "Mixamo"
    bare = {re.split(r"[:|]", name)[-1] for name in names}
    for family, tells in _FAMILIES:
        if bare.issuperset(tells):
            return family
    if "HeadTop_End" in bare and "LeftForeArm" in bare:
        return "Mixamo"
    if {"LeftToe", "LeftForeArm", "LeftUpLeg", "Spine2"} <= bare and len(bare) <= 24:
        return "LAFAN1"
    if {"LeftForeArm", "LeftUpLeg"} <= bare:
        return "MotionBuilder names"
    return ""


def describe(skeleton: Skeleton, roles: Roles) -> dict[str, list[str]]:
    """List the names of the joints of each role, in the order of a body; empty where there is no such joint."""

    def of(*joints: int) -> list[str]:
        return [skeleton.names[joint] for joint in joints if joint >= 0]

    rows = {
        "pelvis": of(roles["pelvis"]),
        "spine": of(*roles.spine),
        "neck": of(roles["neck"]),
        "head": of(roles["head"]),
    }
    for part in LIMBS:
        if part == "hip":
            rows |= {f"{side} fingers": of(*roles.fingers.get(side, ())) for side in SIDES}
        rows |= {f"{side} {part.replace('_', ' ')}": of(roles[f"{side}_{part}"]) for side in SIDES}
    return rows

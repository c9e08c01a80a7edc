"""Which joint is which: small skeletons with the names of the systems that export them, and with none."""

import numpy as np
import pytest

from gesturegen.motion import body, feet, roles
from tests.builders import chain, make_skeleton

UP, DOWN, AHEAD = (0, 1, 0), (0, -1, 0), (0, 0, 1)


def grow(*rows):
    """A skeleton of (name, parent's name, direction, length) rows, its joints in the order of a file."""

    def below(name):
        return [row for own in rows if own[1] == name for row in (own, *below(own[0]))]

    rows = below(None)
    names = [row[0] for row in rows]
    parents = [-1 if row[1] is None else names.index(row[1]) for row in rows]
    return make_skeleton(names, parents, [np.multiply(row[2], row[3]) for row in rows])


def person(
    pelvis, spine, neck, head, arm, leg, sides=("left", "right"), above=(), under_hand=(), helpers=(), name=None
):  # fmt: skip
    """A body: `arm` and `leg` are names with {s} for the side, arms from the collar to the wrist, legs from hip to toes.

    name : how a joint's name is written; above : joints over the pelvis; helpers : (name, parent), without length
    """
    rows = [(joint, before, UP, 0) for joint, before in zip(above, (None, *above), strict=False)]
    rows.append((pelvis, above[-1] if above else None, UP, 90))
    last = pelvis
    for joint in spine:
        rows.append((joint, last, UP, 45 / len(spine)))
        last = joint
    chest = last
    for joint, length in zip((*neck, head), (10, *[8] * len(neck)), strict=False):
        rows.append((joint, last, UP, length))
        last = joint
    for side, x in zip(sides, (1, -1), strict=True):
        last = chest
        for part, length in zip(arm, (12, 15, 28, 25) if len(arm) == 4 else (20, 28, 25), strict=True):
            rows.append((part.format(s=side), last, (x, 0, 0), length))
            last = part.format(s=side)
        for finger in under_hand:
            rows.append((finger.format(s=side), last, (x, 0, 0), 8))
        last = pelvis
        for part, direction, length in zip(leg, ((x, 0, 0), DOWN, DOWN, AHEAD), (9, 42, 40, 14), strict=False):
            rows.append((part.format(s=side), last, direction, length))
            last = part.format(s=side)
    rows += [(helper, parent, UP, 0) for helper, parent in helpers]
    return grow(*rows)


MB_ARM = ("{s}Shoulder", "{s}Arm", "{s}ForeArm", "{s}Hand")
MB_LEG = ("{s}UpLeg", "{s}Leg", "{s}Foot", "{s}ToeBase")
LR, WORDS = ("L", "R"), ("Left", "Right")


def prefixed(prefix):
    return [tuple(prefix + part for part in parts) for parts in (MB_ARM, MB_LEG)]


def mixamo(prefix):
    arm, leg = prefixed(prefix)
    spine = [f"{prefix}Spine{n}" for n in ("", 1, 2)]
    return person(
        f"{prefix}Hips", spine, (f"{prefix}Neck",), f"{prefix}Head", arm, leg, WORDS,
        under_hand=(prefix + "{s}HandThumb1", prefix + "{s}HandIndex1"), helpers=((f"{prefix}HeadTop_End", f"{prefix}Head"),),
    )  # fmt: skip


# Family, skeleton, a prefix of all names, and those of pelvis, head, arms, legs and the left side.
FAMILIES = [
    ("Mixamo", mixamo("mixamorig:"), "mixamorig:", "Hips", "Head", MB_ARM, MB_LEG, "Left"),
    ("Mixamo", mixamo("mixamorig"), "mixamorig", "Hips", "Head", MB_ARM, MB_LEG, "Left"),
    ("Mixamo", mixamo(""), "", "Hips", "Head", MB_ARM, MB_LEG, "Left"),
    ("Mixamo", mixamo("mixamorig7:"), "mixamorig7:", "Hips", "Head", MB_ARM, MB_LEG, "Left"),
]
CMU = person("Hips", ("LowerBack", "Spine", "Spine1"), ("Neck", "Neck1"), "Head", MB_ARM, ("{s}UpLeg", *MB_LEG[1:]), WORDS,
             helpers=(("LHipJoint", "Hips"), ("RHipJoint", "Hips")), under_hand=("{s}FingerBase",))  # fmt: skip
ASF_ARM, ASF_LEG = (
    ("{s}clavicle", "{s}humerus", "{s}radius", "{s}wrist"),
    ("{s}femur", "{s}tibia", "{s}foot", "{s}toes"),
)
ASF = person("root", ("lowerback", "upperback", "thorax"), ("lowerneck", "upperneck"), "head", ASF_ARM, ASF_LEG, ("l", "r"),
             under_hand=("{s}hand", "{s}thumb"), helpers=(("lhipjoint", "root"), ("rhipjoint", "root")))  # fmt: skip
BEAT_ARM, BEAT_LEG = ("{s}Shoulder", "{s}Arm", "{s}Arm1", "{s}Hand"), ("{s}UpLeg", "{s}Leg", "{s}Foot", "{s}ToeBase")
BEAT = person("Hips", ("Spine", "Spine1", "Spine2", "Spine3"), ("Neck", "Neck1"), "Head", BEAT_ARM, BEAT_LEG, LR,
              under_hand=("{s}HandM1", "{s}HandI", "{s}HandT1"), helpers=(("HeadEnd", "Head"),))  # fmt: skip
ZEGGS = person("Hips", ("Spine", "Spine1", "Spine2", "Spine3"), ("Neck", "Neck1"), "Head", MB_ARM, MB_LEG, WORDS,
               under_hand=("{s}HandIndex1",), helpers=(("RightForeArmEnd", "RightHand"), ("LeftForeArmEnd", "LeftHand")))  # fmt: skip
XSENS_ARM, XSENS_LEG = ("{s}Collar", "{s}Shoulder", "{s}Elbow", "{s}Wrist"), ("{s}Hip", "{s}Knee", "{s}Ankle", "{s}Toe")
XSENS = person("Hips", ("Chest", "Chest2", "Chest3", "Chest4"), ("Neck",), "Head", XSENS_ARM, XSENS_LEG, WORDS)
MVN_ARM = ("{s}Shoulder", "{s}UpperArm", "{s}ForeArm", "{s}Hand")
MVN_LEG = ("{s}UpperLeg", "{s}LowerLeg", "{s}Foot", "{s}Toe")
MVN = person("Pelvis", ("L5", "L3", "T12", "T8"), ("Neck",), "Head", MVN_ARM, MVN_LEG, WORDS)
ROKOKO_LEG = ("{s}Thigh", "{s}Shin", "{s}Foot", "{s}Toe")
ROKOKO = person("Hips", ("Spine", "Spine2", "Spine4"), ("Neck",), "Head", MB_ARM, ROKOKO_LEG, WORDS,
                under_hand=("{s}Finger1Metacarpal", "{s}Finger2Metacarpal"), helpers=(("Head_end", "Head"),))  # fmt: skip
NEURON = person("Hips", ("Spine", "Spine1", "Spine2"), ("Neck", "Neck1"), "Head", MB_ARM, MB_LEG[:3], WORDS,
                under_hand=("{s}HandThumb1", "{s}InHandIndex", "{s}InHandPinky"))  # fmt: skip
LAFAN_LEG = ("{s}UpLeg", "{s}Leg", "{s}Foot", "{s}Toe")
LAFAN = person("Hips", ("Spine", "Spine1", "Spine2"), ("Neck",), "Head", MB_ARM, LAFAN_LEG, WORDS)
SMPL_ARM, SMPL_LEG = (
    ("{s}_Collar", "{s}_Shoulder", "{s}_Elbow", "{s}_Wrist"),
    ("{s}_Hip", "{s}_Knee", "{s}_Ankle", "{s}_Foot"),
)
SMPL = person(
    "Pelvis", ("Spine1", "Spine2", "Spine3"), ("Neck",), "Head", SMPL_ARM, SMPL_LEG, LR, under_hand=("{s}_Hand",)
)
SMPLX_ARM = ("{s}_collar", "{s}_shoulder", "{s}_elbow", "{s}_wrist")
SMPLX_LEG = ("{s}_hip", "{s}_knee", "{s}_ankle", "{s}_foot")
SMPLX = person("pelvis", ("spine1", "spine2", "spine3"), ("neck",), "head", SMPLX_ARM, SMPLX_LEG,
               under_hand=("{s}_index1", "{s}_thumb1"), helpers=(("jaw", "head"), ("left_eye_smplhf", "head")))  # fmt: skip
UE_ARM, UE_LEG = (
    ("clavicle_{s}", "upperarm_{s}", "lowerarm_{s}", "hand_{s}"),
    ("thigh_{s}", "calf_{s}", "foot_{s}", "ball_{s}"),
)
UNREAL = person("pelvis", ("spine_01", "spine_02", "spine_03"), ("neck_01",), "head", UE_ARM, UE_LEG, ("l", "r"),
                above=("root",), under_hand=("index_01_{s}", "thumb_01_{s}"),
                helpers=(("ik_foot_root", "root"), ("ik_hand_root", "root"), ("ik_hand_gun", "ik_hand_root"),
                         ("upperarm_twist_01_l", "upperarm_l"), ("lowerarm_twist_01_l", "lowerarm_l"),
                         ("weapon_l", "hand_l"), ("Camera_bone", "root")))  # fmt: skip
BIP = "Bip01 "
BIP_ARM = tuple(BIP + part for part in ("{s} Clavicle", "{s} UpperArm", "{s} Forearm", "{s} Hand"))
BIP_LEG = tuple(BIP + part for part in ("{s} Thigh", "{s} Calf", "{s} Foot", "{s} Toe0"))
BIPED = person(f"{BIP}Pelvis", (f"{BIP}Spine", f"{BIP}Spine1"), (f"{BIP}Neck",), f"{BIP}Head", BIP_ARM, BIP_LEG, LR,
               above=("Bip01",), under_hand=(BIP + "{s} Finger0",))  # fmt: skip
DAZ_ARM, DAZ_LEG = ("{s}Collar", "{s}Shldr", "{s}ForeArm", "{s}Hand"), ("{s}Buttock", "{s}Thigh", "{s}Shin", "{s}Foot")
DAZ = person("hip", ("abdomen", "chest"), ("neck",), "head", DAZ_ARM, DAZ_LEG, ("l", "r"), under_hand=("{s}Thumb1",))
BANDAI_ARM = ("Shoulder_{s}", "UpperArm_{s}", "LowerArm_{s}", "Hand_{s}")
BANDAI_LEG = ("UpperLeg_{s}", "LowerLeg_{s}", "Foot_{s}", "Toes_{s}")
BANDAI = person("Hips", ("Spine", "Chest"), ("Neck",), "Head", BANDAI_ARM, BANDAI_LEG, LR, above=("joint_Root",))
BLENDER_ARM = ("DEF-shoulder.{s}", "DEF-upper_arm.{s}", "DEF-forearm.{s}", "DEF-hand.{s}")
BLENDER_LEG = ("DEF-thigh.{s}", "DEF-shin.{s}", "DEF-foot.{s}", "DEF-toe.{s}")
BLENDER = person("DEF-spine", ("DEF-spine.001", "DEF-spine.002"), ("DEF-neck",), "DEF-head", BLENDER_ARM, BLENDER_LEG, LR,
                 above=("root",), under_hand=("DEF-f_index.01.{s}",))  # fmt: skip
FAMILIES += [
    ("CMU", CMU, "", "Hips", "Head", MB_ARM, MB_LEG, "Left"),
    ("CMU", ASF, "", "root", "head", ASF_ARM, ASF_LEG, "l"),
    ("BEAT", BEAT, "", "Hips", "Head", BEAT_ARM, BEAT_LEG, "L"),
    ("ZEGGS / Trinity", ZEGGS, "", "Hips", "Head", MB_ARM, MB_LEG, "Left"),
    ("Xsens", XSENS, "", "Hips", "Head", XSENS_ARM, XSENS_LEG, "Left"),
    ("Xsens", MVN, "", "Pelvis", "Head", MVN_ARM, MVN_LEG, "Left"),
    ("Rokoko", ROKOKO, "", "Hips", "Head", MB_ARM, ROKOKO_LEG, "Left"),
    ("Perception Neuron", NEURON, "", "Hips", "Head", MB_ARM, (*MB_LEG[:3], None), "Left"),
    ("LAFAN1", LAFAN, "", "Hips", "Head", MB_ARM, LAFAN_LEG, "Left"),
    ("SMPL", SMPL, "", "Pelvis", "Head", SMPL_ARM, SMPL_LEG, "L"),
    ("SMPL", SMPLX, "", "pelvis", "head", SMPLX_ARM, SMPLX_LEG, "left"),
    ("Unreal", UNREAL, "", "pelvis", "head", UE_ARM, UE_LEG, "l"),
    ("Biped", BIPED, "", f"{BIP}Pelvis", f"{BIP}Head", BIP_ARM, BIP_LEG, "L"),
    ("CMU / DAZ", DAZ, "", "hip", "head", DAZ_ARM, (*DAZ_LEG[1:], None), "l"),
    ("Bandai-Namco", BANDAI, "", "Hips", "Head", BANDAI_ARM, BANDAI_LEG, "L"),
    ("Rigify", BLENDER, "", "DEF-spine", "DEF-head", BLENDER_ARM, BLENDER_LEG, "L"),
]


@pytest.mark.parametrize(
    ("family", "skeleton", "prefix", "pelvis", "head", "arm", "leg", "left"), FAMILIES,
    ids=[f"{n}-{row[0]}" for n, row in enumerate(FAMILIES)],
)  # fmt: skip
def test_families(family, skeleton, prefix, pelvis, head, arm, leg, left):
    found = roles.recognise(skeleton)
    assert found.family == family
    assert found.is_body and not found.by_shape
    named = {role: skeleton.names[joint] for role, joint in found.joints.items()}
    parts = dict(
        zip(("shoulder", "upper_arm", "elbow", "wrist", "hip", "knee", "ankle", "toes"), (*arm, *leg), strict=True)
    )
    right = {"Left": "Right", "left": "right", "L": "R", "l": "r"}[left]
    wanted = {
        f"{side}_{role}": prefix + part.format(s=marker)
        for side, marker in (("left", left), ("right", right)) for role, part in parts.items() if part
    }  # fmt: skip
    assert {role: named.get(role) for role in wanted} == wanted
    assert (named["pelvis"], named["head"]) == (prefix + pelvis, prefix + head)
    # Distances are measured on no finger, toe or helper, and the legs are the lower body.
    kept = {skeleton.names[joint] for joint in found.body}
    assert not kept & {skeleton.names[joint] for own in found.fingers.values() for joint in own}
    assert {named[f"{side}_{part}"] for side in roles.SIDES for part in ("wrist", "ankle")} <= kept
    assert not any(word in name.lower() for name in kept for word in ("end", "twist", "ik_", "weapon", "camera", "eye"))
    legs = {skeleton.names[joint] for joint in body.split(skeleton, found["pelvis"]).lower}
    assert named["left_ankle"] in legs and named["left_wrist"] not in legs
    leg_found = feet.leg_of(skeleton, found["left_ankle"])
    assert (leg_found.hip, leg_found.knee) == (found["left_hip"], found["left_knee"])
    assert 120 < roles.body_height(skeleton, found) < 200


@pytest.mark.parametrize(
    "skeleton", [CMU, UNREAL, XSENS, BANDAI, NEURON], ids=["cmu", "unreal", "xsens", "bandai", "neuron"]
)
def test_a_body_without_names_is_recognised_by_its_shape(skeleton):
    bare = make_skeleton([f"joint{n}" for n in range(len(skeleton.names))], skeleton.parents, skeleton.offsets)
    wanted, found = roles.recognise(skeleton), roles.recognise(bare)
    assert found.is_body and set(found.by_shape) == set(found.joints)
    for role in ("pelvis", *(f"{s}_{p}" for s in roles.SIDES for p in ("elbow", "wrist", "hip", "knee", "ankle"))):
        assert found[role] == wanted[role], role


@pytest.mark.parametrize("skeleton", [chain(8), chain(1), make_skeleton(["a", "b", "c"], [-1, 0, 0])])
def test_what_is_no_body_is_not_taken_for_one(skeleton):
    found = roles.recognise(skeleton)
    assert not found.is_body and not found.joints and found.body == () and found.family == ""
    assert roles.body_height(skeleton, found) == 0.0


def test_a_role_that_is_set_wins():
    found = roles.recognise(LAFAN, (("left_wrist", "LeftForeArm"), ("head", "nobody")))
    assert LAFAN.names[found["left_wrist"]] == "LeftForeArm"
    assert LAFAN.names[found["head"]] == "Head"
    assert found.fingers["left"] == (LAFAN.names.index("LeftHand"),)


def test_the_description_names_every_role():
    told = roles.describe(SMPLX, roles.recognise(SMPLX))
    assert told["spine"] == ["spine1", "spine2", "spine3"]
    assert told["left fingers"] == ["left_index1", "left_thumb1"]
    assert told["right upper arm"] == ["right_shoulder"] and told["right toes"] == ["right_foot"]

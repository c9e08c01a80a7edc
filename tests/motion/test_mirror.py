"""Mirror partners by name, and motion reflected at x = 0."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gesturegen.errors import DataError
from gesturegen.motion import bvh, kinematics, rotation
from gesturegen.motion.mirror import mirror, mirror_places, partners
from gesturegen.motion.skeleton import Motion
from tests.builders import SMALL, data_folder, make_skeleton, random_motion, random_quaternions, refused

REFLECTION = np.array([-1.0, 1.0, 1.0])
GENEA = (
    "body_world", "b_root", "b_spine0", "b_neck0", "b_jaw", "b_tongue4", "b_l_tongue4_1", "b_r_tongue4_1",
    "b_r_shoulder", "p_r_scap", "b_r_wrist", "b_r_ring1", "b_r_ring2",
    "b_l_shoulder", "p_l_delt", "p_l_scap", "b_l_wrist", "b_l_ring1", "b_l_ring2",
    "p_navel", "b_r_upleg", "b_r_leg", "b_l_upleg", "b_l_leg",
)  # fmt: skip

# A body and two arms of three joints, the left one at positive x.
ARMS = ("root", "chest", *(f"{side}_{part}" for side in ("left", "right") for part in ("arm", "elbow", "hand")))
ARM_PARENTS = (-1, 0, 1, 2, 3, 1, 5, 6)
LEFT_ARM = [(4.0, 15.0, 2.0), (25.0, -1.0, 0.5), (24.0, 0.0, 3.0)]
MIDDLE = [(0.0, 90.0, 3.0), (0.0, 30.0, -2.0)]
ARM_PARTNERS = np.array([0, 1, 5, 6, 7, 2, 3, 4])


def symmetric():
    return make_skeleton(ARMS, ARM_PARENTS, [*MIDDLE, *LEFT_ARM, *(REFLECTION * np.array(LEFT_ARM))])


def lopsided(rng):
    return make_skeleton(ARMS, ARM_PARENTS, rng.normal(scale=20.0, size=(8, 3)))


def found_pairs(names, pairs=()):
    """The pairs as names, each once, in the order of the names."""
    found = partners(names, pairs)
    np.testing.assert_array_equal(found[found], np.arange(len(names)))
    return [(names[j], names[other]) for j, other in enumerate(found) if j < other]


# --- partners -----------------------------------------------------------------------------------------------


def test_partners_of_genea_joints():
    found = partners(GENEA)
    assert found.dtype.kind == "i" and found.shape == (len(GENEA),)
    assert found_pairs(GENEA) == [
        ("b_l_tongue4_1", "b_r_tongue4_1"), ("b_r_shoulder", "b_l_shoulder"), ("p_r_scap", "p_l_scap"),
        ("b_r_wrist", "b_l_wrist"), ("b_r_ring1", "b_l_ring1"), ("b_r_ring2", "b_l_ring2"),
        ("b_r_upleg", "b_l_upleg"), ("b_r_leg", "b_l_leg"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("b_l_wrist", "b_r_wrist"),
        ("b_L_wrist", "b_R_wrist"),
        ("l_wrist", "r_wrist"),
        ("L_Wrist", "R_Wrist"),
        ("wrist_l", "wrist_r"),
        ("Shoulder_L", "Shoulder_R"),
        ("hand.l", "hand.r"),
        ("Hand.L", "Hand.R"),
        ("Hand-L", "Hand-R"),
        ("Hand.L.001", "Hand.R.001"),
        ("Bip01 L Thigh", "Bip01 R Thigh"),
        ("LeftArm", "RightArm"),
        ("mixamorig:LeftHandIndex1", "mixamorig:RightHandIndex1"),
        ("hip_left", "hip_right"),
        ("lefthand", "righthand"),
        ("LEFTHAND", "RIGHTHAND"),
        ("UpperArmLeft", "UpperArmRight"),
        ("LArm", "RArm"),
        ("LHipJoint", "RHipJoint"),
        ("lShldr", "rShldr"),
        ("skeleton:LArm", "skeleton:RArm"),
        ("Character1_lForeArm", "Character1_rForeArm"),
    ],
)
def test_side_markers(left, right):
    assert partners([left, "root", right]).tolist() == [2, 1, 0]
    assert partners([right, left, "root"]).tolist() == [1, 0, 2]
    assert partners([left, "root"]).tolist() == [0, 1]


@pytest.mark.parametrize(
    "names",
    [
        ("b_root", "b_loot"),
        ("rib", "lib"),
        ("root", "loot"),
        ("collar", "corral", "coLlar", "coRlar"),
        ("LowerBack", "RowerBack"),
        ("b_leg", "b_reg"),
        ("UpperArm", "LpperArm"),
        ("LeftArm", "rightArm"),
        ("b_l_arm", "b_R_arm"),
        ("LArm", "rArm"),
        ("l1", "r1"),
        ("HeelLow", "HeerLow"),
        # Two markers of one name are never exchanged together.
        ("LeftHand_l", "RightHand_r"),
    ],
)
def test_names_that_are_no_pair(names):
    assert found_pairs(names) == []


def test_partners_of_a_mixamo_skeleton():
    sides = [
        f"mixamorig:{side}{part}" for side in ("Left", "Right") for part in ("Shoulder", "Arm", "HandRing1", "Leg")
    ]
    names = ["mixamorig:Hips", "mixamorig:Spine", "mixamorig:Head", *sides]
    assert partners(names).tolist() == [0, 1, 2, 7, 8, 9, 10, 3, 4, 5, 6]


def test_partners_of_a_cmu_skeleton():
    names = ["Hips", "LHipJoint", "LeftUpLeg", "RHipJoint", "RightUpLeg", "LowerBack", "LThumb", "RThumb"]
    assert partners(names).tolist() == [0, 3, 4, 1, 2, 5, 7, 6]


def test_partners_of_a_bandai_skeleton():
    assert found_pairs(("joint_Root", "Hips", "Shoulder_L", "Hand_L", "Shoulder_R", "Hand_R")) == [
        ("Shoulder_L", "Shoulder_R"),
        ("Hand_L", "Hand_R"),
    ]


def test_of_several_markers_the_first_that_leads_to_a_free_joint_counts():
    four = ("l_brow_l", "l_brow_r", "r_brow_l", "r_brow_r")
    assert found_pairs(four) == [("l_brow_l", "r_brow_l"), ("l_brow_r", "r_brow_r")]
    assert found_pairs(("left_lid_L", "left_lid_R", "lid")) == [("left_lid_L", "left_lid_R")]


def test_no_names_have_no_partners():
    assert partners(()).shape == (0,)


def test_given_pairs_are_taken_as_they_are():
    names = ("hip", "arm_a", "arm_b", "hand_l", "hand_r", "p_l_delt")
    assert found_pairs(names, [("arm_b", "arm_a")]) == [("arm_a", "arm_b"), ("hand_l", "hand_r")]


def test_given_pairs_take_precedence_over_names():
    names = ("hand_l", "hand_r", "other", "foot_l", "foot_r")
    assert found_pairs(names, [("hand_l", "other")]) == [("hand_l", "other"), ("foot_l", "foot_r")]


def test_a_joint_given_with_itself_has_no_partner():
    assert found_pairs(("hand_l", "hand_r", "foot_l", "foot_r"), [("hand_l", "hand_l")]) == [("foot_l", "foot_r")]


def test_an_unknown_name_is_refused_with_the_nearest():
    with refused(DataError, r"b_l_rist.*nearest is 'b_l_wrist'"):
        partners(GENEA, [("b_l_rist", "b_r_wrist")])


@pytest.mark.parametrize("second", [("b_l_wrist", "b_root"), ("b_l_leg", "b_r_wrist"), ("b_l_wrist", "b_r_wrist")])
def test_a_joint_in_two_pairs_is_refused(second):
    with refused(DataError, "two mirror pairs", names="_wrist"):
        partners(GENEA, [("b_l_wrist", "b_r_wrist"), second])


WORDS = st.lists(st.sampled_from(["l", "r", "L", "R", "left", "Right", "Left", "arm", "Arm", "_", ".", ":", "1"]))


@SMALL
@given(st.lists(WORDS.map("".join), unique=True, max_size=30), st.data())
def test_partners_are_an_involution(names, data):
    count = data.draw(st.integers(0, len(names) // 2))
    chosen = data.draw(st.permutations(names))[: 2 * count]
    pairs = list(zip(chosen[::2], chosen[1::2], strict=True))
    found = partners(names, pairs)
    np.testing.assert_array_equal(found[found], np.arange(len(names)))
    for left, right in pairs:
        assert found[names.index(left)] == names.index(right)


# --- mirror -------------------------------------------------------------------------------------------------


@SMALL
@given(st.integers(0, 10**6))
def test_mirrored_twice_is_the_same_motion(seed):
    rng = np.random.default_rng(seed)
    bones = lopsided(rng)
    motion = Motion(bones, random_quaternions(rng, 7, 8), rng.normal(scale=50.0, size=(7, 8, 3)), 30.0)
    before = motion.rotations.copy(), motion.positions.copy()
    twice = mirror(mirror(motion, ARM_PARTNERS), ARM_PARTNERS)
    assert twice.rotations.tobytes() == motion.rotations.tobytes()
    np.testing.assert_allclose(twice.positions, motion.positions, rtol=0, atol=1e-12)
    assert twice.skeleton is bones and twice.fps == 30.0
    np.testing.assert_array_equal(motion.rotations, before[0])
    np.testing.assert_array_equal(motion.positions, before[1])


@SMALL
@given(st.integers(0, 10**6))
def test_a_symmetric_body_is_reflected_exactly(seed):
    motion = random_motion(symmetric(), 9, seed)
    found = kinematics.joint_positions(mirror(motion, ARM_PARTNERS))
    np.testing.assert_allclose(found, REFLECTION * kinematics.joint_positions(motion)[:, ARM_PARTNERS], atol=1e-9)


@SMALL
@given(st.integers(0, 10**6))
def test_joints_that_shift_against_their_parents_are_reflected_too(seed):
    rng = np.random.default_rng(seed)
    motion = Motion(symmetric(), random_quaternions(rng, 5, 8), rng.normal(scale=30.0, size=(5, 8, 3)), 30.0)
    found = kinematics.joint_positions(mirror(motion, ARM_PARTNERS))
    np.testing.assert_allclose(found, REFLECTION * kinematics.joint_positions(motion)[:, ARM_PARTNERS], atol=1e-9)


@SMALL
@given(st.integers(0, 10**6))
def test_bones_keep_their_own_length_and_offset(seed):
    bones = lopsided(np.random.default_rng(seed))
    motion = random_motion(bones, 6, seed)
    mirrored = mirror(motion, ARM_PARTNERS)
    np.testing.assert_array_equal(mirrored.positions[:, 1:], np.tile(bones.offsets[1:], (6, 1, 1)))
    places = kinematics.joint_positions(mirrored)
    lengths = np.linalg.norm(places[:, 1:] - places[:, ARM_PARENTS[1:]], axis=-1)
    np.testing.assert_allclose(lengths, np.tile(np.linalg.norm(bones.offsets[1:], axis=-1), (6, 1)), atol=1e-9)


def test_walking_to_the_left_becomes_walking_to_the_right():
    motion = random_motion(symmetric(), 12)
    np.testing.assert_allclose(mirror(motion, ARM_PARTNERS).positions[:, 0], REFLECTION * motion.positions[:, 0])


def test_a_root_whose_offset_is_aside_is_reflected_but_for_a_shift():
    offsets = symmetric().offsets.copy()
    offsets[0, 0] = 7.0
    aside = make_skeleton(ARMS, ARM_PARENTS, offsets)
    motion = random_motion(aside, 5)
    found = kinematics.joint_positions(mirror(motion, ARM_PARTNERS))
    expected = REFLECTION * kinematics.joint_positions(motion)[:, ARM_PARTNERS]
    np.testing.assert_allclose(found - expected, np.tile([14.0, 0.0, 0.0], (5, 8, 1)), atol=1e-9)


def test_a_raised_left_hand_becomes_a_raised_right_hand():
    bones = symmetric()
    rotations = np.tile(rotation.IDENTITY, (1, 8, 1))
    # A quarter turn about z takes the left arm, along x, upwards; the turn about y is the body's.
    rotations[0, 2] = rotation.from_expmap([0.0, 0.0, np.pi / 2])
    rotations[0, 0] = rotation.about_y(0.4)
    mirrored = mirror(Motion(bones, rotations, bones.offsets[None], 30.0), ARM_PARTNERS)
    np.testing.assert_allclose(rotation.to_expmap(mirrored.rotations[0, 5]), [0.0, 0.0, -np.pi / 2], atol=1e-12)
    assert rotation.heading(mirrored.rotations[0, 0]) == pytest.approx(-0.4)
    left, right = kinematics.joint_positions(mirrored, [4, 7])[0]
    assert right[1] > left[1] + 40.0


# --- real data ----------------------------------------------------------------------------------------------


def test_genea_motion_is_reflected_within_a_centimetre():
    folder = data_folder() / "genea_style_sample/trn/main-agent/bvh"
    motion = bvh.read(next(iter(sorted(folder.glob("*.bvh")))))
    names = motion.skeleton.names
    other = partners(names)
    assert other[names.index("b_l_wrist")] == names.index("b_r_wrist")
    assert other[names.index("p_l_delt")] == names.index("p_l_delt")
    assert np.count_nonzero(other != np.arange(len(names))) == 64
    selected = [j for j, name in enumerate(names) if name != "p_l_delt"]
    found = kinematics.joint_positions(mirror(motion, other), selected)
    expected = REFLECTION * kinematics.joint_positions(motion, list(other[selected]))
    # Measured 0.53 cm, at the wrists: their two OFFSETs differ by 0.34 cm.
    assert np.linalg.norm(found - expected, axis=-1).max() < 1.0


LEFT_ARMS = {
    "bandai": "UpperArm_L",
    "deep-motion-editing": "LeftArm",
    "fairmotion": "LeftArm",
    "genea_generated": "b_l_arm",
    "geno": "LeftArm",
    "pymo": "LeftArm",
}


@pytest.mark.parametrize("kind", LEFT_ARMS)
def test_pairs_of_skeletons_in_the_wild(kind):
    seen = set()
    for path in sorted((data_folder() / "bvh" / kind).glob("*.bvh")):
        if "sinusoidal" in path.name:
            continue  # a chain of four joints, no body
        names = bvh.read_skeleton(path).names
        if names in seen:
            continue
        seen.add(names)
        other = partners(names)
        np.testing.assert_array_equal(other[other], np.arange(len(names)))
        right = names[other[names.index(LEFT_ARMS[kind])]]
        assert right == LEFT_ARMS[kind].replace("Left", "Right").replace("_L", "_R").replace("_l_", "_r_"), path
        assert np.count_nonzero(other != np.arange(len(names))) % 2 == 0
        # Without a partner are the spine, the head and what hangs there, nothing named after a side.
        alone = [name for name, j in zip(names, other, strict=True) if names[j] == name and name != "p_l_delt"]
        assert not [name for name in alone if "Left" in name or "Right" in name or "_l_" in name or "_r_" in name]
    assert seen


# --- skeletons whose joints have axes of their own ---------------------------------------------------------------


def test_words_that_follow_their_side_without_a_mark():
    assert found_pairs(("root", "lfemur", "ltibia", "rfemur", "rtibia", "lowerback")) == [
        ("lfemur", "rfemur"), ("ltibia", "rtibia")
    ]  # fmt: skip


def engine_skeleton():
    """A body as some engines export it: bones along x of joints that are turned at rest, the right side backwards."""
    sides = [[("arm", (s * 20, 0, 0)), ("elbow", (s * 28, 0, 0)), ("hand", (s * 24, 0, 0))] for s in (1, -1)]
    names, parents, offsets = ["root", "chest"], [-1, 0], [(0, 0, 0), (30, 0, 0)]
    for marker, rows, y in zip("LR", sides, (5, -5), strict=True):
        for place, (part, offset) in enumerate(rows):
            names.append(f"{part}_{marker}")
            parents.append(1 if place == 0 else len(names) - 2)
            offsets.append((10, y, 0) if place == 0 else offset)
    return make_skeleton(names, parents, offsets)


@given(seed=st.integers(0, 10**6))
def test_places_are_mirrored_whatever_the_axes_of_the_joints(seed):
    skeleton = engine_skeleton()
    motion = random_motion(skeleton, 4, seed)
    own = partners(skeleton.names)
    reflected = mirror_places(motion, own)
    wanted = kinematics.joint_positions(motion)[:, own] * REFLECTION
    np.testing.assert_allclose(kinematics.joint_positions(reflected), wanted, atol=1e-9)
    np.testing.assert_allclose(
        kinematics.joint_positions(mirror_places(reflected, own)), kinematics.joint_positions(motion), atol=1e-9
    )

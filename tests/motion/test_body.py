"""Upper and lower body, limbs and fingers, from the hierarchy and the rest pose."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gesturegen.errors import DataError
from gesturegen.motion import body, bvh
from tests.builders import SMALL, chain, data_folder, make_skeleton

WRISTS = ("b_l_wrist", "b_r_wrist", "b_l_wrist_twist", "b_r_wrist_twist")
LEGS = ["b_r_upleg", "b_r_leg", "b_r_foot_twist", "b_r_foot", "b_l_upleg", "b_l_leg", "b_l_foot_twist", "b_l_foot"]


def build(tree):
    """A skeleton from (name, parent's name, OFFSET) rows, parents first."""
    names = [name for name, _, _ in tree]
    parents = [-1 if parent is None else names.index(parent) for _, parent, _ in tree]
    return make_skeleton(names, parents, [offset for _, _, offset in tree])


def arm(side, x):
    shoulder, scap, upper = f"b_{side}_shoulder", f"p_{side}_scap", f"b_{side}_arm"
    twist, wrist_twist, wrist = f"b_{side}_arm_twist", f"b_{side}_wrist_twist", f"b_{side}_wrist"
    rows = [(shoulder, "b_spine3", (2.8 * x, 7, 9))]
    if side == "l":
        rows.append(("p_l_delt", shoulder, (14.8 * x, 0, -4)))
    rows += [
        (scap, shoulder, (16 * x, -1, -5)), (upper, scap, (0, -4, 0)), (twist, upper, (0, 0, 0)),
        (f"b_{side}_forearm", twist, (25.6 * x, 0, 0)), (wrist_twist, f"b_{side}_forearm", (24.8 * x, 0, 0)),
        (wrist, wrist_twist, (2 * x, 0, 2)),
    ]  # fmt: skip
    for finger in ("index", "ring", "middle", "pinky", "thumb"):
        rows += [
            (f"b_{side}_{finger}1", wrist, (8 * x, 0, 0)),
            (f"b_{side}_{finger}2", f"b_{side}_{finger}1", (4 * x, 0, 0)),
        ]
    return rows


def leg(side, x):
    parts = [f"b_{side}_{part}" for part in ("upleg", "leg", "foot_twist", "foot")]
    offsets = [(8.7 * x, -7.2, -1.3), (0, -37, 0), (0, -40, -3), (0, 0, 0)]
    return list(zip(parts, ["b_root", *parts[:-1]], offsets, strict=True))


SPINE = [
    ("body_world", None, (0, 0, 0)), ("b_root", "body_world", (0, 91.5, 0)), ("b_spine0", "b_root", (0, 2.5, -2.9)),
    ("b_spine1", "b_spine0", (0, 10.9, 2.2)), ("b_spine2", "b_spine1", (0, 10.4, -4.3)),
]  # fmt: skip
CHEST = [
    ("b_spine3", "b_spine2", (0, 18.4, -1.8)), ("b_neck0", "b_spine3", (0, 12.8, 3.3)),
    ("b_head", "b_neck0", (0, 6.3, 3.2)), ("b_head_null", "b_head", (0, 19.9, 4.1)),
    ("b_l_eye", "b_head", (3.4, 7, 8.6)), ("b_r_eye", "b_head", (-3.3, 7, 8.7)), ("b_jaw", "b_head", (0, 5, 2.3)),
]  # fmt: skip
NAVEL = [("p_navel", "b_spine2", (0, -11.87, 1.82))]
GENEA = [*SPINE, *CHEST, *arm("r", -1), *arm("l", 1), *NAVEL, *leg("r", -1), *leg("l", 1)]


def named(skeleton, joints):
    return [skeleton.names[j] for j in joints]


def assert_partition(skeleton, found):
    joints = np.arange(len(skeleton.names))
    np.testing.assert_array_equal(np.sort(np.concatenate([found.upper, found.lower])), joints)
    assert set(found.limbs) <= set(found.upper)
    for numbers in (found.upper, found.lower, found.limbs):
        assert numbers.dtype.kind == "i" and (np.diff(numbers) > 0).all()


def assert_is_genea(skeleton):
    found = body.split(skeleton, skeleton.index("b_root"))
    assert_partition(skeleton, found)
    assert named(skeleton, found.lower) == ["body_world", "b_root", *LEGS]
    trunk = [joint for joint in found.upper if joint not in found.limbs]
    assert named(skeleton, trunk) == ["b_spine0", "b_spine1", "b_spine2", "b_spine3", "p_navel"]
    assert {"b_head", "b_l_shoulder", "p_l_delt", "b_r_ring2"} <= set(named(skeleton, found.limbs))


def test_a_genea_body():
    assert_is_genea(build(GENEA))


def test_a_genea_body_from_its_file():
    assert_is_genea(bvh.read_skeleton(data_folder() / "genea_skeleton/genea2023_restpose_83j.bvh"))


def test_fingers_of_the_genea_skeleton_from_its_file():
    skeleton = bvh.read_skeleton(data_folder() / "genea_skeleton/genea2023_restpose_83j.bvh")
    found = named(skeleton, body.fingers(skeleton, WRISTS))
    assert len(found) == 32 and {name.split("_")[2][:-1] for name in found} == {
        "thumb", "index", "middle", "ring", "pinky"
    }  # fmt: skip


def test_a_body_without_legs():
    skeleton = build([*SPINE, *CHEST, *arm("r", -1), *arm("l", 1), *NAVEL])
    found = body.split(skeleton, 1)
    assert_partition(skeleton, found)
    assert named(skeleton, found.lower) == ["body_world", "b_root"]
    assert named(skeleton, found.upper[:4]) == ["b_spine0", "b_spine1", "b_spine2", "b_spine3"]


def test_what_is_beside_the_pelvis_is_lower():
    rows = [("world", None, (0, 0, 0)), ("prop", "world", (50, 200, 0)), ("pelvis", "world", (0, 90, 0))]
    skeleton = build([*rows, ("spine", "pelvis", (0, 20, 0)), ("camera", "prop", (0, 1, 0))])
    found = body.split(skeleton, 2)
    assert_partition(skeleton, found)
    assert named(skeleton, found.upper) == ["spine"]


def test_arms_that_hang_at_the_sides_do_not_make_the_spine_a_leg():
    rows = [("hips", None, (0, 90, 0)), ("spine", "hips", (0, 50, 0)), ("head", "spine", (0, 25, 0))]
    rows += [("arm", "spine", (18, 5, 0)), ("elbow", "arm", (0, -30, 0)), ("hand", "elbow", (0, -26, 0))]
    skeleton = build([*rows, ("hip", "hips", (9, -2, 0)), ("knee", "hip", (0, -40, 0))])
    assert named(skeleton, body.split(skeleton, 0).lower) == ["hips", "hip", "knee"]


@pytest.mark.parametrize(("end", "upper"), [((0, -5, 0), []), ((0, 5, 0), ["only"]), ((0, -0.5, 0), ["only"])])
def test_an_end_site_counts_as_a_joint(end, upper):
    ends = [(np.nan,) * 3, end]
    skeleton = make_skeleton(("pelvis", "only"), (-1, 0), [(0, 90, 0), (0, 1, 0)], end_sites=ends)
    assert named(skeleton, body.split(skeleton, 0).upper) == upper


def test_a_rest_pose_without_length_has_legs_by_their_names_alone():
    """Rest poses of some systems say nothing; names do. Of joints that have none that is known nothing is."""
    parents = build(GENEA).parents
    skeleton = make_skeleton([name for name, _, _ in GENEA], parents, np.zeros((len(GENEA), 3)))
    assert set(LEGS) < set(named(skeleton, body.split(skeleton, 1).lower))
    skeleton = make_skeleton(
        ["body_world", "b_root", *(f"j{n}" for n in range(len(GENEA) - 2))], parents, np.zeros((len(GENEA), 3))
    )
    found = body.split(skeleton, 1)
    assert_partition(skeleton, found)
    assert named(skeleton, found.lower) == ["body_world", "b_root"]


@pytest.mark.parametrize("pelvis", (0, 2, 3))
def test_a_chain_has_no_limbs(pelvis):
    skeleton = chain(4)
    found = body.split(skeleton, pelvis)
    assert_partition(skeleton, found)
    assert found.limbs.size == 0
    np.testing.assert_array_equal(found.lower, np.arange(pelvis + 1))


def test_the_chest_may_be_the_first_joint_and_each_branch_has_its_own():
    rows = [("hips", None, (0, 90, 0))]
    for name in ("one", "two"):
        rows += [(name, "hips", (0, 20, 0))]
        for side in ("a", "b"):
            rows += [(f"{name}_{side}0", name, (0, 5, 0)), (f"{name}_{side}1", f"{name}_{side}0", (0, 5, 0))]
    rows += [("tail", "hips", (0, 3, 0)), ("tip", "tail", (0, 3, 0)), ("helper", "one", (0, 1, 0))]
    skeleton = build(rows)
    trunk = set(body.split(skeleton, 0).upper) - set(body.split(skeleton, 0).limbs)
    assert named(skeleton, sorted(trunk)) == ["one", "two", "tail", "tip"]


@SMALL
@given(st.integers(1, 20), st.integers(0, 10**6))
def test_every_joint_is_in_one_half(count, seed):
    rng = np.random.default_rng(seed)
    parents = [-1, *(int(rng.integers(0, joint)) for joint in range(1, count))]
    ends = np.where(rng.random((count, 1)) < 0.5, rng.normal(size=(count, 3)), np.nan)
    names = [f"j{joint}" for joint in range(count)]
    skeleton = make_skeleton(names, parents, rng.normal(size=(count, 3)), end_sites=ends)
    pelvis = int(rng.integers(count))
    found = body.split(skeleton, pelvis)
    assert_partition(skeleton, found)
    assert pelvis in found.lower
    assert set(found.upper) <= set(skeleton.descendants(pelvis))


def test_bodies_in_the_wild():
    seen = set()
    for path in sorted(data_folder().rglob("*.bvh")):
        try:
            skeleton = bvh.read_skeleton(path)
        except DataError:
            continue
        if skeleton.names in seen:
            continue
        seen.add(skeleton.names)
        found = body.split(skeleton, skeleton.pelvis("b_root"))
        assert_partition(skeleton, found)
        # Bandai's rest pose is no pose of a body: every bone lies along x.
        if "Hips" in skeleton.names and "joint_Root" not in skeleton.names:
            limbs, lower = named(skeleton, found.limbs), named(skeleton, found.lower)
            assert {"LeftHand", "RightHand", "Head"} <= set(limbs), path
            assert {"Hips", "LeftFoot", "RightFoot"} <= set(lower), path
            assert "Spine" in named(skeleton, found.upper) and "Spine" not in limbs, path
    assert len(seen) >= 5


# --- fingers ------------------------------------------------------------------------------------------------


def test_fingers_are_below_the_wrists():
    skeleton = build(GENEA)
    parts = ("index", "ring", "middle", "pinky", "thumb")
    expected = [f"b_{side}_{part}{n}" for side in "rl" for part in parts for n in (1, 2)]
    assert named(skeleton, body.fingers(skeleton, WRISTS)) == expected
    assert named(skeleton, body.fingers(skeleton, ("b_l_wrist",))) == expected[10:]


def test_a_wrist_below_a_wrist_is_no_finger():
    skeleton = build(GENEA)
    assert "b_r_wrist" in named(skeleton, body.fingers(skeleton, ("b_r_wrist_twist",)))
    assert "b_r_wrist" not in named(skeleton, body.fingers(skeleton, ("b_r_wrist_twist", "b_r_wrist")))


@pytest.mark.parametrize("wrists", [(), ("no_such_joint",), ("j3",)])
def test_no_fingers(wrists):
    found = body.fingers(chain(4), wrists)
    assert found.shape == (0,) and found.dtype.kind == "i"

import numpy as np
import pytest

from gesturegen.errors import DataError
from gesturegen.motion.skeleton import Motion, Skeleton
from tests.builders import POSITIONS, ZXY, chain, make_skeleton, random_motion, refused

BODY = make_skeleton(
    ["world", "hips", "spine", "left_hand", "right_hand", "leg"],
    [-1, 0, 1, 2, 2, 1],
)


def remade(skeleton, **changes):
    fields = ("names", "parents", "offsets", "end_sites", "channels", "hierarchy")
    return Skeleton(**{name: changes.get(name, getattr(skeleton, name)) for name in fields})


def test_children_and_descendants():
    assert BODY.children(1) == [2, 5]
    assert BODY.descendants(1) == [2, 3, 4, 5]
    assert BODY.descendants(2) == [3, 4]
    assert BODY.descendants(5) == []


def test_channels_are_counted():
    assert BODY.n_channels == 6 + 5 * 3


def test_pelvis_by_name_else_where_the_hierarchy_branches():
    assert BODY.pelvis("spine") == 2
    assert BODY.pelvis("b_root") == 1
    assert chain(3).pelvis("b_root") == 2


def test_index_names_the_nearest_joint():
    assert BODY.index("leg") == 5
    with refused(DataError, "no joint 'left_hnd', nearest is 'left_hand'; it has: world, hips"):
        BODY.index("left_hnd")
    with refused(DataError, r"no joint 'qqqq'; it has"):
        BODY.index("qqqq")


def test_equal_skeletons_do_not_differ():
    nudged = remade(BODY, offsets=BODY.offsets + 5e-5, hierarchy="other text")
    assert BODY.difference(nudged) is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"names": ("world", "hips", "spine", "left_hand", "hand", "leg")}, "joint 4 is 'right_hand' against 'hand'"),
        ({"parents": np.array([-1, 0, 1, 2, 2, 0])}, "joint 'leg' has another parent"),
        ({"channels": (POSITIONS + ZXY, *[ZXY] * 4, ZXY[::-1])}, "joint 'leg' has channels Zrotation"),
        ({"offsets": np.add(BODY.offsets, [0, 0.01, 0])}, "joint 'hips' has OFFSET"),
    ],
)
def test_difference_says_what_differs(change, words):
    assert words in BODY.difference(remade(BODY, **change))


def test_offsets_may_differ_by_a_tolerance_and_that_of_a_travelling_root_by_anything():
    far = np.array(BODY.offsets)
    far[0] += 500.0
    far[3] += 0.9
    assert BODY.difference(remade(BODY, offsets=far), 1.0) is None
    assert "joint 'left_hand' has OFFSET" in BODY.difference(remade(BODY, offsets=far), 0.8)


def test_difference_counts_joints():
    assert chain(3).difference(chain(4)) == "3 joints against 4"


@pytest.mark.parametrize("parents", ([0, 0], [-1, 1], [-1, -1], [-1, 2]))
def test_parents_come_before_children_and_there_is_one_root(parents):
    with pytest.raises(ValueError, match="root"):
        Skeleton(("a", "b"), np.array(parents), np.zeros((2, 3)), np.full((2, 3), np.nan), ((), ()), "")


def test_shapes_are_checked():
    with pytest.raises(ValueError, match=r"skeleton offsets has shape \(1, 3\), expected \(2, 3\)"):
        Skeleton(("a", "b"), np.array([-1, 0]), np.zeros((1, 3)), np.full((2, 3), np.nan), ((), ()), "")
    skeleton = chain(2)
    with pytest.raises(ValueError, match=r"motion positions has shape \(4, 2, 3\), expected \(5, 2, 3\)"):
        Motion(skeleton, np.zeros((5, 2, 4)), np.zeros((4, 2, 3)), 30.0)


@pytest.mark.parametrize("name", ("rotations", "positions"))
def test_motion_cannot_be_written_to(name):
    motion = random_motion(chain(2), 3)
    with pytest.raises(ValueError, match="read-only"):
        getattr(motion, name)[0] = 0.0


def test_skeleton_cannot_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        BODY.offsets[0] = 1.0


def test_take_keeps_the_named_frames():
    motion = random_motion(chain(2), 6)
    taken = motion.take([4, 1])
    assert taken.n_frames == 2 and taken.fps == motion.fps
    np.testing.assert_array_equal(taken.rotations, motion.rotations[[4, 1]])
    np.testing.assert_array_equal(taken.positions, motion.positions[[4, 1]])
    assert motion.take(slice(2, 5)).n_frames == 3

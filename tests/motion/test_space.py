"""Units and verticals: told from the body, taken to centimetres and y up, written back as they came."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.motion import axes, bvh, kinematics, roles, rotation, space
from gesturegen.motion.skeleton import Motion, Space
from gesturegen.settings.loading import load_config
from tests.builders import POSITIONS, ZXY, chain, make_skeleton, random_motion
from tests.motion.test_roles import BANDAI, CMU, LAFAN, UNREAL

CONFIG = load_config()
Z_UP = Space(1.0, "z")


def standing(skeleton, frames=4, seed=0):
    """A body that stands, and turns about the vertical while its joints tremble; y up, cm."""
    rng = np.random.default_rng(seed)
    count = len(skeleton.names)
    rotations = rotation.from_expmap(rng.normal(scale=0.05, size=(frames, count, 3)))
    rotations[:, 0] = rotation.about_y(np.linspace(0, 2, frames))
    positions = np.tile(skeleton.offsets, (frames, 1, 1))
    positions[:, 0, [0, 2]] += rng.normal(scale=20.0, size=(frames, 2))
    return Motion(skeleton, rotations, positions, 30.0)


def as_file(motion, unit=1.0, up="y", written=bvh.format_bvh):
    """The text of a file of this motion in another unit and with another vertical: what another system would write."""
    there = axes.to_file(replace(motion, skeleton=replace(motion.skeleton, space=Space(unit, up))))
    own = there.skeleton
    text = bvh.hierarchy_text(list(own.names), list(own.parents), own.offsets, own.end_sites, list(own.channels))
    return bvh.format_bvh(replace(there, skeleton=replace(own, hierarchy=text)))


def read(tmp_path, text, *overrides):
    (tmp_path / "a.bvh").write_text(text)
    return space.read(tmp_path / "a.bvh", load_config(None, overrides))


@pytest.mark.parametrize("skeleton", [LAFAN, UNREAL, BANDAI], ids=["lafan", "unreal", "bandai"])
@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize(("name", "unit"), [("cm", 1.0), ("m", 100.0), ("mm", 0.1), ("inch", 2.54)])
def test_unit_and_vertical_are_told_from_the_body(tmp_path, skeleton, up, name, unit):
    motion = standing(skeleton)
    text = as_file(motion, unit, up)
    found = read(tmp_path, text)
    assert found.skeleton.space == Space(unit, up)
    np.testing.assert_allclose(kinematics.joint_positions(found), kinematics.joint_positions(motion), atol=2e-3)
    notes = space.notes(found.skeleton, CONFIG)
    assert len(notes) == (unit != 1.0) + (up != "y")
    assert all(
        word in " ".join(notes) for word in ([f" in {name}, "] * (unit != 1.0) + ["z is taken to be up"] * (up != "y"))
    )
    # Written back as it came, the hierarchy to the letter and the frames to rounding.
    again = bvh.format_bvh(found).splitlines()
    assert again[: again.index("MOTION") + 3] == text.splitlines()[: again.index("MOTION") + 3]
    rows, before = (np.loadtxt(lines[lines.index("MOTION") + 3 :]) for lines in (again, text.splitlines()))
    np.testing.assert_allclose(rows, before, atol=2e-6)


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), unit=st.sampled_from([1.0, 0.01, 100.0, 2.54, 0.1]), up=st.sampled_from("yz"))
def test_inside_and_back_is_where_it_was(seed, unit, up):
    motion = random_motion(chain(4), 3, seed)
    there = axes.to_inside(motion, Space(unit, up))
    back = axes.to_file(there)
    np.testing.assert_allclose(back.positions, motion.positions, rtol=1e-12)
    np.testing.assert_allclose(back.skeleton.offsets, motion.skeleton.offsets, rtol=1e-12)
    np.testing.assert_allclose(back.rotations, motion.rotations, rtol=1e-12)
    assert back.skeleton.space == Space()
    # The body itself is turned and scaled, no more.
    places, own = kinematics.joint_positions(there), kinematics.joint_positions(motion)
    wanted = own if up == "y" else own[..., [0, 2, 1]] * [1.0, 1.0, -1.0]
    np.testing.assert_allclose(places, unit * wanted, rtol=1e-9, atol=1e-9)


def test_rest_poses_that_lie_do_not_matter(tmp_path):
    """Bones along x at rest, as some engines export them, of a body whose motion stands."""
    bones = np.array(LAFAN.offsets)
    lengths = np.linalg.norm(bones, axis=1)
    along = np.zeros_like(bones)
    along[:, 0] = lengths
    skeleton = make_skeleton(LAFAN.names, LAFAN.parents, along, [POSITIONS + ZXY, *[ZXY] * (len(bones) - 1)])
    turned = standing(LAFAN)
    # Every joint turned so that its bones point where they did: what hangs below the first child follows it.
    world, _ = kinematics.world_transforms(turned)
    aligned = np.array(world)
    for joint in range(len(bones)):
        child = next(iter(LAFAN.children(joint)), None)
        if child is not None and lengths[child] > 0:
            aligned[:, joint] = rotation.multiply(
                world[:, joint], rotation.between(np.array([[1.0, 0, 0]]), bones[[child]])
            )
    local = np.array(aligned)
    for joint, parent in enumerate(LAFAN.parents):
        if parent >= 0:
            local[:, joint] = rotation.multiply(rotation.inverse(aligned[:, parent]), aligned[:, joint])
    positions = np.tile(along, (turned.n_frames, 1, 1))
    positions[:, 0] = turned.positions[:, 0]
    for up in "yz":
        found = read(tmp_path, as_file(Motion(skeleton, local, positions, 30.0), 1.0, up))
        assert found.skeleton.space.up == up


@pytest.mark.parametrize("place", [(40.0, 12.0, 0.0), (0.0, 15.0, 150.0)])
def test_somebody_who_lies_does_not_turn_the_world(tmp_path, place):
    motion = standing(LAFAN)
    lying = np.array(motion.rotations)
    lying[:, 0] = rotation.from_expmap(np.tile([np.pi / 2, 0.0, 0.0], (motion.n_frames, 1)))
    positions = np.array(motion.positions)
    positions[:, 0] = place
    found = read(tmp_path, as_file(replace(motion, rotations=lying, positions=positions)))
    assert found.skeleton.space.up == "y"


def test_settings_overrule(tmp_path):
    text = as_file(standing(LAFAN), 100.0, "z")
    found = read(tmp_path, text, "motion.unit=mm", "motion.up_axis=y")
    assert found.skeleton.space == Space(0.1, "y")
    assert space.notes(found.skeleton, load_config(None, ["motion.unit=mm"])) == [
        "lengths are taken to be in mm, as set (motion.unit); written back as they came"
    ]
    assert read(tmp_path, text, "motion.unit=30").skeleton.space.scale == 30.0


def test_cmu_units_and_heights_that_fit_none(tmp_path):
    tall = standing(CMU)
    small = as_file(tall, 2.54 / 0.45)
    assert read(tmp_path, small).skeleton.space.scale == pytest.approx(5.6444, abs=1e-4)
    odd = read(tmp_path, as_file(standing(LAFAN), 30.0))
    assert odd.skeleton.space == Space()
    (note,) = space.notes(odd.skeleton, CONFIG)
    assert "fits no unit: taken for cm; set motion.unit" in note


def test_what_is_no_body_stays_as_it_is(tmp_path):
    found = read(tmp_path, as_file(random_motion(chain(4), 3), 100.0))
    assert found.skeleton.space == Space() and space.notes(found.skeleton, CONFIG) == []
    assert roles.recognise(found.skeleton).family == ""


@pytest.mark.parametrize("seat", ["chair", "floor"])
@pytest.mark.parametrize("up", ["y", "z"])
def test_somebody_who_sits_stands_along_the_trunk(tmp_path, seat, up):
    motion = standing(LAFAN)
    rotations = np.array(motion.rotations)
    found = roles.recognise(LAFAN)
    for side in roles.SIDES:
        rotations[:, found[f"{side}_hip"]] = rotation.from_expmap(np.array([[-np.pi / 2, 0.0, 0.0]]))
        bend = np.pi / 2 if seat == "chair" else 0.0
        rotations[:, found[f"{side}_knee"]] = rotation.from_expmap(np.array([[bend, 0.0, 0.0]]))
    assert read(tmp_path, as_file(replace(motion, rotations=rotations), 100.0, up)).skeleton.space == Space(100.0, up)


def test_a_body_that_its_root_turns_to_stand_along_z(tmp_path):
    """OFFSETs with y up, and a root that turns all of it: how some programs export what they show with z up."""
    motion = standing(LAFAN)
    turn = rotation.from_expmap(np.array([[np.pi / 2, 0.0, 0.0]]))
    rotations, positions = np.array(motion.rotations), np.array(motion.positions)
    rotations[:, 0] = rotation.multiply(turn, rotations[:, 0])
    positions[:, 0] = rotation.rotate(turn, positions[:, 0])
    found = read(tmp_path, as_file(replace(motion, rotations=rotations, positions=positions)))
    assert found.skeleton.space.up == "z"
    assert np.percentile(kinematics.joint_positions(found)[..., 1], 95) > 120

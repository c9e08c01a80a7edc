"""Other people's skeletons through the commands: units, axes, roles, recordings of several days."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gesturegen import frames as reference_frames
from gesturegen import joints
from gesturegen.control import hands
from gesturegen.data import clips
from gesturegen.errors import DataError
from gesturegen.motion import bvh, kinematics, rotation, space
from gesturegen.motion.skeleton import Motion, Space
from gesturegen.settings.loading import load_config
from gesturegen.settings.models import GENEA_JOINTS, Wrists
from tests import tiny
from tests.builders import make_skeleton, refused, write_clip
from tests.commands import errors, run, succeed
from tests.motion.test_roles import BANDAI, LAFAN, UNREAL, XSENS
from tests.motion.test_space import as_file, standing

SKELETONS = pytest.mark.parametrize(
    "skeleton", [LAFAN, UNREAL, XSENS, BANDAI], ids=["lafan", "unreal", "xsens", "bandai"]
)


def gesturing(skeleton=LAFAN, seconds=4.0, seed=0):
    """A body that stands, turns a little and moves all its joints smoothly; cm, y up."""
    rng, count, frames = np.random.default_rng(seed), len(skeleton.names), round(seconds * 30)
    times = np.linspace(0, seconds, frames)[:, None, None]
    waves = np.sin(times * rng.uniform(2, 9, (count, 3)) + rng.uniform(0, 6, (count, 3))) * 0.12
    rotations = rotation.from_expmap(waves)
    positions = np.tile(skeleton.offsets, (frames, 1, 1))
    positions[:, 0, 0] += 5 * np.sin(times[:, 0, 0])
    return Motion(skeleton, rotations, positions, 30.0)


def dataset(folder, *texts, seconds=4.0):
    for number, text in enumerate(texts):
        name = f"trn_{number}"
        write_clip(folder / "trn", name, seconds, (0.4, 0.9, 1.5, 2.2, 3.1), motion=gesturing(seconds=seconds))
        (folder / "trn/main-agent/bvh" / f"{name}.bvh").write_text(text)
    write_clip(folder / "tst", "tst_0", 2.0, (0.5, 1.1), with_motion=False)
    return folder


def commands(folder, *overrides, names=("preprocess", "build-graph", "reenact")):
    options = [word for override in ("feet.lock=true", "search=global", *overrides) for word in ("--set", override)]
    return [
        succeed(name, "--data", folder, "--work", folder / "work", "-j", 1, *options).output for name in names
    ]  # fmt: skip


def test_metres_and_z_up_give_the_same_motion_scaled_and_turned(tmp_path):
    motions = {}
    for unit, up in ((1.0, "y"), (100.0, "z")):
        folder = dataset(tmp_path / f"{unit}{up}", as_file(gesturing(), unit, up))
        said = commands(folder)[0]
        assert ("lengths are taken to be in" in said) == (unit != 1.0) and ("z is taken to be up" in said) == (
            up == "z"
        )
        written = folder / "work/reenact/tst_0.bvh"
        hierarchy = (folder / "trn/main-agent/bvh/trn_0.bvh").read_text().split("MOTION")[0]
        assert written.read_text().split("MOTION")[0] == hierarchy
        motions[unit, up] = space.read(written, load_config())
        assert motions[unit, up].skeleton.space == Space(unit, up)
    wanted = kinematics.joint_positions(motions[1.0, "y"])
    for key, motion in motions.items():
        np.testing.assert_allclose(kinematics.joint_positions(motion), wanted, atol=0.02, err_msg=str(key))


def test_references_in_different_units_share_a_graph_and_truth_is_compared_in_the_same_unit(tmp_path):
    folder = dataset(tmp_path, as_file(gesturing()), as_file(gesturing(seed=1), 100.0, "z"))
    commands(folder, "references.mode=all")
    (graph,) = sorted((folder / "work/graphs").glob("*.npz"))
    positions = reference_frames.read_arrays(graph, ("positions", "clip_starts"))
    first, second = np.split(positions["positions"], [positions["clip_starts"][1]])
    assert np.ptp(first[..., 1]) == pytest.approx(np.ptp(second[..., 1]), rel=0.2)
    theirs, truth = tmp_path / "theirs", tmp_path / "truth"
    for place, text in ((theirs, as_file(gesturing())), (truth, as_file(gesturing(), 100.0, "z"))):
        place.mkdir()
        (place / "a.bvh").write_text(text)
    said = succeed("evaluate", "--bvh", theirs, "--truth", truth, "--work", tmp_path / "measured", "-j", 1)
    assert "a: lengths are taken to be in m" in said.output and "a: z is taken to be up" in said.output
    figures = json.loads((tmp_path / "measured/evaluate/summary_files.json").read_text())["total"]
    assert figures["syn"] < 1e-3


def day(change, joint="LeftForeArm"):
    """The same performer on another day: a joint's OFFSET has changed."""
    offsets = np.array(LAFAN.offsets)
    offsets[LAFAN.names.index(joint)] += change
    skeleton = make_skeleton(LAFAN.names, LAFAN.parents, offsets)
    return gesturing(skeleton, seed=1)


@pytest.mark.parametrize("change", [(0.0004, 0, 0), (0.9, -0.5, 0.3)])
def test_recordings_of_different_days_share_a_graph(tmp_path, change):
    own, other = gesturing(), day(change)
    folder = dataset(tmp_path, as_file(own), as_file(other))
    commands(folder, "references.mode=all")
    written = bvh.read(folder / "work/reenact/tst_0.bvh")
    np.testing.assert_array_equal(written.skeleton.offsets, LAFAN.offsets)
    (graph,) = sorted((folder / "work/graphs").glob("*.npz"))
    stored = reference_frames.read_arrays(graph, ("positions", "clip_starts", "joint_names"))
    elbow, arm = (stored["joint_names"].tolist().index(name) for name in ("LeftForeArm", "LeftArm"))
    lengths = np.linalg.norm(stored["positions"][:, elbow] - stored["positions"][:, arm], axis=1)
    for part, motion in zip(np.split(lengths, [stored["clip_starts"][1]]), (own, other), strict=True):
        bone = np.linalg.norm(motion.skeleton.offsets[LAFAN.names.index("LeftForeArm")])
        np.testing.assert_allclose(part, bone, atol=1e-4)


def test_another_performer_is_refused(tmp_path):
    folder = dataset(tmp_path, as_file(gesturing()), as_file(day((4.0, 0, 0))))
    commands(folder, "references.mode=all", names=("preprocess",))
    told = errors(
        run("build-graph", "--data", folder, "--work", folder / "work", "-j", 1, "--set", "references.mode=all")
    )
    assert "cannot share a graph: joint 'LeftForeArm' has OFFSET" in told[0]
    commands(folder, "references.mode=all", "motion.same_skeleton=0.05", names=("build-graph",))


@SKELETONS
def test_every_default_that_names_joints_comes_from_the_roles(skeleton):
    own = joints.settings_for(skeleton, load_config())
    found = joints.roles_of(skeleton, load_config())
    names = skeleton.names
    wrists, ankles = ([names[joint] for joint in found.pair(part)] for part in ("wrist", "ankle"))
    assert list(own.wrists.joints) == wrists and list(own.feet.joints) == ankles
    assert [own.control.left, own.control.right] == wrists
    assert own.positions.root_joint == names[found["pelvis"]]
    for given in (own.joints, own.evaluation.seam_joints, own.motion_matching.joints):
        assert set(wrists) <= set(given) <= set(names)
    assert not set(own.joints) & {names[joint] for own in found.fingers.values() for joint in own}


def test_names_in_the_config_and_the_joints_of_genea_stay():
    config = load_config(None, ["feet.joints=[LeftToe, RightToe]", "control.left=LeftForeArm"])
    own = joints.settings_for(LAFAN, config)
    assert own.feet.joints == ("LeftToe", "RightToe") and own.control.left == "LeftForeArm"
    assert own.control.right == "RightHand"
    genea = make_skeleton(GENEA_JOINTS, range(-1, len(GENEA_JOINTS) - 1))
    assert joints.settings_for(genea, load_config()) == load_config()


def test_a_role_can_be_set(tmp_path):
    config = load_config(None, ["skeleton.left_wrist=LeftForeArm", "skeleton.right_ankle=RightToe"])
    own = joints.settings_for(LAFAN, config)
    assert own.wrists.joints == ("LeftForeArm", "RightHand") and own.feet.joints == ("LeftFoot", "RightToe")
    assert config.hands.left == "LeftForeArm"
    config = load_config(None, ["skeleton.spine=[Spine2]", "skeleton.left_fingers=[LeftHand]", "skeleton.head=Hed"])
    found = joints.roles_of(LAFAN, config)
    assert [LAFAN.names[joint] for joint in found.spine] == ["Spine2"]
    assert [LAFAN.names[joint] for joint in joints.fingers(LAFAN, config)] == ["LeftHand"]
    assert joints.unknown_names(LAFAN, config) == [
        "skeleton.head: the skeleton has no joint 'Hed', so this says nothing; nearest is 'Head'"
    ]


def test_the_roll_of_a_wrist_is_about_its_forearm():
    """Of bones along y the roll about y is what the cleaning keeps, not the first angle of GENEA's joints."""
    offsets = np.array(UNREAL.offsets)[:, [1, 0, 2]]
    along_y = make_skeleton(UNREAL.names, UNREAL.parents, offsets)
    assert joints.settings_for(UNREAL, load_config()).wrists.axes == "XYZ" == Wrists().axes
    assert joints.settings_for(along_y, load_config()).wrists.axes == "YZX"


@SKELETONS
def test_hands_are_controlled_by_their_roles(skeleton):
    """Also where no name tells which joint is a hand."""
    config = load_config(None, ["onsets.min_strength=0"])
    bare = make_skeleton([f"j{n}" for n in range(len(skeleton.names))], skeleton.parents, skeleton.offsets)
    for own in (skeleton, bare):
        motion = gesturing(own)
        reference = tiny.reference(motion)
        described = reference_frames.describe(reference, config)
        positions = reference_frames.positions_of(motion, config)
        places = hands.of_positions(
            positions, described["joint_names"], (0,), 30.0, config.hands, described["hand_names"]
        )
        wrist, pelvis = skeleton.names.index(named(skeleton, "left_wrist")), "pelvis"
        world = kinematics.joint_positions(motion, [wrist, joints.roles_of(own, config)[pelvis]])
        np.testing.assert_allclose(places["height", "left"], world[:, 0, 1] - world[:, 1, 1], atol=1e-3)


def named(skeleton, role):
    return skeleton.names[joints.roles_of(skeleton, load_config())[role]]


def test_inspect_tells_what_a_file_is_taken_to_be(tmp_path):
    path = tmp_path / "take.bvh"
    path.write_text(as_file(standing(UNREAL), 100.0, "z"))
    said = succeed("inspect", path).output
    for line in ("recognised: Unreal", "unit: 100 cm, up: z", "left elbow       lowerarm_l", "right toes       ball_r"):
        assert line in said, line
    assert "feet.joints: foot_l, foot_r" in said
    facts = json.loads(
        succeed("inspect", path, "--json", "--quiet").output or succeed("inspect", path, "--json").stdout
    )
    assert facts["roles"]["pelvis"] == ["pelvis"] and facts["centimetres_per_unit"] == 100.0


def test_a_stored_clip_keeps_unit_axes_and_angles(tmp_path):
    motion = standing(LAFAN, frames=60)
    text = as_file(motion, 100.0, "z")
    folder = dataset(tmp_path, text, seconds=2.0)
    config = load_config(None, [f"paths.data={folder}", "wrists.enabled=false"])
    commands(folder, "wrists.enabled=false", names=("preprocess",))
    stored = clips.load(folder / "work/clips/trn_0.npz", config).motion
    read = space.read(folder / "trn/main-agent/bvh/trn_0.bvh", config)
    assert stored.skeleton.space == Space(100.0, "z")
    assert bvh.format_bvh(stored) == bvh.format_bvh(read) == text
    np.testing.assert_array_equal(stored.written_angles, read.written_angles)


def test_a_gesture_library_of_another_unit_fits_and_of_another_body_does_not(tmp_path):
    from gesturegen.pipeline import keyword_gestures

    (tmp_path / "wave.bvh").write_text(as_file(day((0.5, 0, 0)), 100.0))
    (tmp_path / "odd.bvh").write_text(as_file(day((4.0, 0, 0))))
    config = load_config(None, [f"control.library={tmp_path}"])
    like = tiny.reference(replace(gesturing(), fps=30.0))
    assert keyword_gestures._load(config, "wave", like).motion.skeleton.space.scale == 100.0
    with refused(DataError, "not the skeleton of the references"):
        keyword_gestures._load(config, "odd", like)

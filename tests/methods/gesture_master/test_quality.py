"""Planted faults are found in the clips they lie in, good and fast motion passes, and the user's lists overrule."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gesturegen.data.clips import select_joints
from gesturegen.methods.gesture_master.quality import Evidence, evidence, judge, keep
from gesturegen.methods.gesture_master.settings import Quality
from gesturegen.motion import bvh, cleanup, kinematics, rotation
from gesturegen.motion.skeleton import Motion
from gesturegen.settings.loading import load_config
from tests.builders import SMALL, data_folder

FPS = 30.0
SETTINGS = Quality()
IDENTITY = np.tile(rotation.IDENTITY, (150, 1, 1))


def swinging(frames=150, hertz=1.0, centimetres=20.0, seed=0):
    """Two joints: one swings along x, the other leaves it by a random constant."""
    positions = np.zeros((frames, 2, 3))
    positions[:, 0, 0] = centimetres * np.sin(2 * np.pi * hertz * np.arange(frames) / FPS)
    positions[:, 1] = positions[:, 0] * 0.5 + np.random.default_rng(seed).normal(size=3)
    return positions


def verdict(positions, start=0, end=None, rotations=None, settings=SETTINGS):
    found = evidence(
        np.tile(rotation.IDENTITY, (len(positions), 1, 1)) if rotations is None else rotations, positions, FPS
    )
    return judge(found, start, end or len(positions), FPS, settings)


# --- turns, speeds, standing still ----------------------------------------------------------------------------


def test_good_motion_passes():
    assert verdict(swinging()) is None


def test_a_turn_is_named_with_its_figure():
    rotations = np.tile(rotation.IDENTITY, (150, 3, 1))
    rotations[70:, 1] = rotation.from_expmap([np.radians(70), 0, 0])
    assert verdict(swinging(), rotations=rotations) == "turns 2100 degrees/s, above 1350"


def test_quaternions_of_either_sign_are_the_same_rotation():
    rotations = np.tile(rotation.IDENTITY, (150, 3, 1))
    rotations[::2] *= -1
    assert verdict(swinging(), rotations=rotations) is None


def test_a_jump_is_named_with_its_figure():
    positions = swinging(centimetres=1e-9)
    positions[70:, 1, 2] += 50.0
    settings = Quality(frozen_seconds=100.0)
    assert verdict(positions, settings=settings) == "moves 1500 cm/s, above 900"


def test_the_step_between_two_clips_is_in_neither():
    positions = swinging()
    positions[70:, 1, 2] += 50.0
    assert verdict(positions, 0, 70) is None and verdict(positions, 70, 150) is None
    assert verdict(positions, 69, 150) is not None and verdict(positions, 0, 71) is not None


def test_a_frozen_second_is_found_and_a_shorter_one_is_not():
    positions = swinging(hertz=0.7)
    positions[40:71] = positions[40]  # 30 steps
    assert verdict(positions) == "frozen for 1.0 s"
    assert verdict(positions, 0, 60) is None and verdict(positions, 60, 150) is None
    positions = swinging(hertz=0.7)
    positions[40:70] = positions[40]
    assert verdict(positions) is None


def test_one_moving_joint_is_not_frozen():
    positions = swinging()
    positions[:, 1] = 0.0
    assert verdict(positions) is None


def test_the_worst_excess_is_named():
    rotations = np.tile(rotation.IDENTITY, (150, 3, 1))
    rotations[70:, 1] = rotation.from_expmap([np.radians(70), 0, 0])  # 1.6 times the limit
    positions = swinging()
    positions[100:, 1, 2] += 50.0  # 1.7 times
    assert verdict(positions, rotations=rotations).startswith("moves")
    assert verdict(positions, rotations=rotations, settings=Quality(max_speed=1200)).startswith("turns")


def test_figures_at_their_limit_pass():
    zeros = np.zeros(60)
    found = Evidence(zeros + 1350.0, zeros + 900.0, zeros + SETTINGS.max_jitter, zeros.astype(bool))
    assert judge(found, 0, 60, FPS, SETTINGS) is None


@pytest.mark.parametrize("frames", [1, 2, 6, 7, 8, 9, 12, 40])
def test_stretches_of_any_length(frames):
    found = evidence(IDENTITY[:frames], swinging(frames), FPS)
    for array in (found.turns, found.speeds, found.jitter, found.still):
        assert array.shape == (frames,)
    assert not found.still[0] and found.turns[0] == found.speeds[0] == 0
    assert all(judge(found, n, n + 1, FPS, SETTINGS) is None for n in range(frames))


def test_an_empty_stretch_has_no_evidence():
    assert len(evidence(IDENTITY[:0], np.zeros((0, 2, 3)), FPS).turns) == 0


@pytest.mark.parametrize(("start", "end"), [(-1, 5), (5, 5), (6, 5), (0, 151)])
def test_no_clip(start, end):
    with pytest.raises(ValueError, match="no clip from frame"):
        judge(evidence(IDENTITY, swinging(), FPS), start, end, FPS, SETTINGS)


def test_evidence_is_read_only():
    with pytest.raises(ValueError, match="read-only"):
        evidence(IDENTITY, swinging(), FPS).jitter[0] = 1.0


# --- jitter -------------------------------------------------------------------------------------------------


def naive_jitter(positions):
    """The definition, frame by frame and joint by joint."""
    frames, joints = positions.shape[:2]
    if frames < 7:
        return np.zeros(frames)
    away = np.zeros((frames, joints))
    times = np.arange(-3, 4)
    for t in range(3, frames - 3):
        smooth = np.polynomial.polynomial.polyfit(times, positions[t - 3 : t + 4].reshape(7, -1), 4)[0]
        away[t] = np.linalg.norm(positions[t] - smooth.reshape(joints, 3), axis=-1)
    window = min(31, frames - 6 if frames % 2 else frames - 7)
    half, jitter = window // 2, np.zeros(frames)
    for frame in range(frames):
        middle = min(max(frame, 3 + half), frames - 1 - 3 - half)
        jitter[frame] = max(np.median(away[middle - half : middle + half + 1, joint]) for joint in range(joints))
    return jitter


@SMALL
@given(st.integers(0, 10**6), st.one_of(st.integers(1, 12), st.integers(35, 42)))
def test_jitter_equals_naive(seed, frames):
    positions = np.random.default_rng(seed).normal(scale=3.0, size=(frames, 2, 3))
    assert evidence(IDENTITY[:frames], positions, FPS).jitter == pytest.approx(naive_jitter(positions), abs=1e-12)


@SMALL
@given(st.integers(0, 10**6), st.floats(0.1, 30.0))
def test_jitter_grows_with_the_tremble_and_is_blind_to_smooth_ways(seed, factor):
    rng = np.random.default_rng(seed)
    noise, times = rng.normal(size=(60, 1, 3)), np.linspace(-1, 1, 60)
    way = np.polynomial.polynomial.polyval(times, rng.normal(scale=50.0, size=(5, 3))).T[:, None]
    figure = evidence(IDENTITY[:60], noise, FPS).jitter
    assert evidence(IDENTITY[:60], noise * factor + way, FPS).jitter == pytest.approx(figure * factor, abs=1e-9)


def test_fast_waving_is_no_jitter():
    assert verdict(swinging(hertz=3.0, centimetres=15.0)) is None


def test_one_hard_stop_is_no_jitter():
    positions = swinging(centimetres=0.0)
    positions[:, 0, 1] = np.concatenate([np.zeros(80), 14.0 * np.arange(5), np.full(65, 56.0)])
    assert verdict(positions, settings=Quality(frozen_seconds=100.0)) is None


def test_a_tremble_is_found_in_its_clip_and_not_in_the_clips_beside_it():
    positions = swinging(240)
    positions[90:150, 1] += np.random.default_rng(0).normal(scale=1.0, size=(60, 3))
    assert verdict(positions, 90, 150).startswith("jitter 1.")
    assert verdict(positions, 90, 150).endswith("cm, above 0.2")
    assert verdict(positions, 60, 180).startswith("jitter")
    assert verdict(positions, 0, 90) is None and verdict(positions, 150, 240) is None


# --- the user's lists -----------------------------------------------------------------------------------------


def test_lists_overrule_the_filter():
    name, bad = "trn_000@12.30", "jitter 0.9 cm, above 0.5"
    assert keep(name, None, SETTINGS) is None and keep(name, bad, SETTINGS) == bad
    assert keep(name, bad, Quality(include=("trn_000@*",))) is None
    assert keep(name, bad, Quality(include=("trn_001@*",))) == bad
    assert keep(name, None, Quality(exclude=("trn_001", name))) == "excluded"
    assert keep(name, bad, Quality(exclude=("*@12.30",), include=("*",))) == "excluded"
    assert keep(name, None, Quality(exclude=("TRN_*",))) is None


def test_without_the_filter_only_the_exclude_list_counts():
    off = Quality(enabled=False, exclude=("trn_000@*",))
    assert keep("trn_001@0.00", "frozen for 1.4 s", off) is None
    assert keep("trn_000@0.00", None, off) == "excluded"


# --- real recordings --------------------------------------------------------------------------------------------


def real(path, turn_joint=None, turns=None):
    """A recording and its selected joints, with `turns` (expmaps) after the rotation of one joint."""
    motion = cleanup.resample(bvh.read(data_folder() / path), 30)
    if turns is not None:
        rotations, joint = motion.rotations.copy(), motion.skeleton.index(turn_joint)
        rotations[:, joint] = rotation.multiply(rotations[:, joint], rotation.from_expmap(turns(len(rotations))))
        motion = Motion(motion.skeleton, rotations, motion.positions, motion.fps)
    return motion


def verdicts(motion):
    """Of clips of four seconds."""
    joints, _ = select_joints(motion.skeleton, load_config(None, ()))
    positions = kinematics.relative_positions(motion, joints, motion.skeleton.pelvis("b_root"), "root")
    found = evidence(motion.rotations[:, joints], positions, FPS)
    last = max(motion.n_frames - 119, 1)
    return [judge(found, n, min(n + 120, motion.n_frames), FPS, SETTINGS) for n in range(0, last, 120)]


def noise(degrees):
    """Of this angle in root mean square, about any axis."""
    rng = np.random.default_rng(0)
    return lambda frames: rng.normal(scale=np.radians(degrees) / np.sqrt(3), size=(frames, 3))


VAL = "genea_split_sample/val/main-agent/bvh/val_2023_v0_000_main-agent.bvh"
TRN = "genea_split_sample/trn/main-agent/bvh/trn_2023_v0_000_main-agent.bvh"


@pytest.mark.parametrize("path", [VAL, TRN])
def test_recorded_speech_passes(path):
    found = verdicts(real(path))
    assert len(found) >= 5 and set(found) == {None}


@pytest.mark.parametrize("action", ["bye_giant_001", "guide_masculinity_001", "bow_active_001"])
def test_recorded_actions_pass(action):
    assert set(verdicts(real(f"bvh/bandai/dataset-1_{action}.bvh"))) == {None}


def test_recorded_punches_are_fast_but_no_jitter():
    assert all(reason.startswith("turns") for reason in verdicts(real("bvh/bandai/dataset-1_punch_normal_002.bvh")))


@pytest.mark.parametrize(("joint", "degrees"), [("b_r_arm", 1), ("b_r_forearm", 1), ("b_l_shoulder", 2)])
def test_a_trembling_arm_is_caught_in_every_clip(joint, degrees):
    found = verdicts(real(VAL, joint, noise(degrees)))
    assert all(reason is not None and reason.startswith("jitter") for reason in found)


@pytest.mark.parametrize("joint", ["b_r_arm", "b_l_wrist", "b_head"])
def test_a_flip_is_caught_in_its_clip(joint):
    def flip(frames):
        turns = np.zeros((frames, 3))
        turns[150:152, 0] = np.pi
        return turns

    found = verdicts(real(VAL, joint, flip))
    assert found[1].startswith("turns 5") and set(found[:1] + found[2:]) == {None}

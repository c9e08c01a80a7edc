"""Suggestions for the blacklist: planted faults are found where they are, good motion is left alone."""

import numpy as np
import pytest

from gesturegen.motion import bvh, rotation, screening
from gesturegen.motion.cleanup import interpolate
from gesturegen.motion.skeleton import Motion
from tests import tiny
from tests.builders import data_folder


@pytest.fixture
def good() -> Motion:
    """Ten seconds of lively, smooth motion."""
    coarse = tiny.motion(np.random.default_rng(0), 61)
    coarse = Motion(coarse.skeleton, coarse.rotations, coarse.positions * [1.0, 1.0, 1.0], 30.0)
    return interpolate(coarse, np.linspace(0, 60, 300))


def screen(motion: Motion):
    return screening.screen(motion, range(len(motion.skeleton.names)), ["b_r_wrist"])


def with_rotations(motion: Motion, change) -> Motion:
    rotations = motion.rotations.copy()
    change(rotations)
    return Motion(motion.skeleton, rotations, motion.positions, motion.fps)


def test_good_motion_has_no_finding(good):
    assert screen(good) == []


def test_a_motionless_take_is_named_with_its_speed(good):
    still = interpolate(good, np.linspace(0, 1, 300))
    (finding,) = [f for f in screen(still) if "near-motionless" in f.reason]
    assert finding.start is None and "blacklist: [clip]" in finding.describe("clip")


def test_a_frozen_stretch_is_a_range(good):
    frames = np.concatenate([np.arange(100), np.full(60, 100), np.arange(100, 240)])
    (finding,) = screen(good.take(frames))
    assert "frozen: no joint moves for 2.0 s" in finding.reason
    assert (finding.start, finding.end) == pytest.approx((100 / 30, 161 / 30))
    assert "exclude: [{clip: clip, from: 3.33, to: 5.37}]" in finding.describe("clip")


def test_a_twitch_is_named_with_joint_frame_and_figure(good):
    def twitch(rotations):
        rotations[200, 3] = rotation.multiply(rotations[200, 3], rotation.from_expmap([1.5, 0, 0]))

    (finding,) = screen(with_rotations(good, twitch))
    assert "glitch: b_r_wrist turns" in finding.reason and "between frames 199 and 200" in finding.reason
    assert finding.start < 200 / 30 < finding.end


def test_a_clip_that_glitches_all_over_is_one_finding(good):
    def flicker(rotations):
        rotations[::9, 3] = rotation.multiply(rotations[::9, 3], rotation.from_expmap([1.5, 0, 0]))

    (finding,) = screen(with_rotations(good, flicker))
    assert finding.start is None and "glitching" in finding.reason and "b_r_wrist" in finding.reason


def test_a_single_frame(good):
    assert [f.reason for f in screen(good.take([0]))] == ["a single frame"]


def test_the_real_sample_is_good():
    path = next((data_folder() / "genea_style_sample/trn/main-agent/bvh").glob("*.bvh"))
    motion = bvh.read(path)
    joints = [motion.skeleton.index(name) for name in ("b_l_wrist", "b_r_wrist", "b_head", "b_root")]
    assert screening.screen(motion, joints, ["b_l_wrist", "b_r_wrist"]) == []

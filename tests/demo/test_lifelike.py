"""The demo is lifelike: strokes on stressed syllables, rest in pauses, and every measure in its stated range."""

import numpy as np
import pytest
import soundfile

from gesturegen.demo import clip_specs, write_clip
from gesturegen.demo.body import FPS
from gesturegen.demo.shapes import KEYWORDS, keyword_shape
from gesturegen.demo.speaker import speaker
from gesturegen.demo.speech import CATEGORIES, stressed_times, write_script
from gesturegen.motion import bvh, kinematics, rotation
from scripts import compare_demo

SEED = 3


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A clip of 60 s: its paths, motion and script."""
    folder = tmp_path_factory.mktemp("lifelike")
    (spec,) = clip_specs(references=1, tests=0, seed=SEED, reference_seconds=(60.0, 60.0))
    wav, tsv, path = write_clip(folder, spec)
    script = write_script(np.random.default_rng([SEED, 0, 0, 1]), speaker(spec.speaker, SEED), spec.seconds)
    return wav, tsv, bvh.read(path), script


def wrist_speeds(motion):
    """Speed of both wrists in cm/s [shape=(T - 1, 2)]."""
    wrists = [motion.skeleton.index(name) for name in ("b_r_wrist", "b_l_wrist")]
    return np.linalg.norm(np.diff(kinematics.joint_positions(motion, wrists), axis=0), axis=-1) * FPS


def test_measures_are_in_their_ranges(clip):
    wav, tsv, motion, _ = clip
    words = compare_demo.read_words(tsv)
    found = (
        compare_demo.speech_measures(wav, words)
        | compare_demo.motion_measures(motion, words)
        | compare_demo.graph_measures(motion)
    )
    assert set(found) == set(compare_demo.RANGES)
    outside = {
        name: value
        for name, value in found.items()
        if not compare_demo.RANGES[name][0] <= value <= compare_demo.RANGES[name][1]
    }
    assert not outside


def test_strokes_fall_on_stressed_syllables(clip):
    _, _, motion, script = clip
    speeds = wrist_speeds(motion).max(axis=1)
    inner = speeds[1:-1]
    peaks = (np.flatnonzero((inner > speeds[:-2]) & (inner > speeds[2:]) & (inner > 40.0)) + 1.5) / FPS
    stressed = stressed_times(script)

    def share_near_a_peak(times):
        return np.mean(np.abs(times[:, None] - peaks).min(axis=1) < 0.1)

    by_chance = np.mean([share_near_a_peak(stressed + shift) for shift in (-0.67, -0.41, 0.37, 0.53, 0.71)])
    assert share_near_a_peak(stressed) > 0.6
    assert share_near_a_peak(stressed) > by_chance + 0.15


def test_hands_rest_in_long_pauses(clip):
    _, _, motion, script = clip
    pauses = [(start, end) for start, end in script.rests[1:-1]]
    assert len(pauses) >= 3 and all(2.0 <= end - start <= 6.0 for start, end in pauses)
    speeds = wrist_speeds(motion)
    times = (np.arange(len(speeds)) + 0.5) / FPS
    for start, end in pauses:
        inside = (times > start + 1.3) & (times < end - 0.6)
        assert np.median(speeds[inside]) < compare_demo.REST_SPEED


def test_joints_never_flip(clip):
    _, _, motion, _ = clip
    assert np.isfinite(motion.rotations).all() and np.isfinite(motion.positions).all()
    steps = rotation.angle_between(motion.rotations[1:], motion.rotations[:-1])
    assert np.degrees(steps).max() < 40.0


def test_hands_stay_clear_of_the_body_and_each_other(clip):
    _, _, motion, _ = clip
    names = ("b_spine3", "b_r_wrist", "b_l_wrist", "b_r_foot", "b_l_foot")
    rotations, positions = kinematics.world_transforms(motion, [motion.skeleton.index(name) for name in names])
    hands = rotation.rotate(rotation.inverse(rotations[:, :1]), positions[:, 1:3] - positions[:, :1])
    assert np.linalg.norm(hands[:, 0] - hands[:, 1], axis=-1).min() > 10.0
    before_trunk = np.abs(hands[..., 0]) < 12.0
    assert hands[..., 2][before_trunk].min() > 12.0
    # Ankles stand 7 cm above the floor and rise a little in a step.
    ankles = positions[:, 3:, 1]
    assert ankles.min() > 6.5 and np.median(ankles) == pytest.approx(7.0, abs=0.3) and ankles.max() < 14.0


def test_audio_has_a_noise_floor_and_does_not_clip(clip):
    samples, rate = soundfile.read(clip[0])
    assert 0.03 < samples.std() < 0.2
    assert np.mean(np.abs(samples) > 0.97) < 1e-4
    quiet = np.abs(samples[: rate // 4])
    assert 2e-4 < quiet.std() < 0.01


def test_vocabulary_and_keywords():
    words = {word for category in CATEGORIES.values() for word in category}
    assert len(words) > 100
    assert set(KEYWORDS) <= words


def test_a_test_may_hold_a_keyword_that_a_reference_lacks():
    def keywords(split, index):
        script = write_script(np.random.default_rng([SEED, split, index, 1]), speaker(1, SEED), 60.0)
        return {word.text for word in script.words} & set(KEYWORDS)

    assert any(keywords(1, index) - keywords(0, 0) for index in range(4))


def test_either_hand_points_east_to_the_speakers_right():
    for hand, outward in (("r", -1.0), ("l", 1.0)):
        start, end, *_ = keyword_shape("east", hand).points
        # The speaker faces +Z, so the right is at -X.
        assert outward * (end[0] - start[0]) < -10.0

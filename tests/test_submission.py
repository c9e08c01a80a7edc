"""The check of what was written."""

import re

import numpy as np
import pytest

from gesturegen import submission
from gesturegen.motion import bvh, rotation
from gesturegen.motion.cleanup import interpolate
from gesturegen.motion.skeleton import Motion
from tests.builders import chain, random_motion


def smooth(skeleton, frames, fps=30.0):
    """Motion that no joint tears."""
    motion = random_motion(skeleton, 2, fps=fps)
    return interpolate(motion, np.linspace(0.0, 0.02 * frames, frames))


def test_a_valid_file_has_no_problem(tmp_path):
    motion = smooth(chain(3), 20)
    bvh.write(tmp_path / "a.bvh", motion)
    assert submission.check_motion(tmp_path / "a.bvh", [motion.skeleton], 20, 30.0)[0] == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: (m.take(slice(0, 19)), 20), "19 frames, the speech has 20"),
        (lambda m: (smooth(chain(4), 20), 20), "4 joints against 3"),
        (lambda m: (smooth(chain(3, offsets=[[0, 0, 0], [9, 0, 0], [10, 0, 0]]), 20), 20), "OFFSET"),
        (lambda m: (smooth(chain(3), 20, fps=60.0), 20), "60 fps, expected 30"),
    ],
)
def test_an_invalid_file_says_why(change, words, tmp_path):
    motion = smooth(chain(3), 20)
    other, frames = change(motion)
    bvh.write(tmp_path / "a.bvh", other)
    problems = submission.check_motion(tmp_path / "a.bvh", [motion.skeleton], frames, 30.0)[0]
    assert len(problems) == 1 and words in problems[0] and "a.bvh" in problems[0]


def test_missing_and_broken_files_are_problems(tmp_path):
    skeleton = chain(3)
    assert "missing" in submission.check_motion(tmp_path / "a.bvh", [skeleton], 20, 30.0)[0][0]
    (tmp_path / "b.bvh").write_text("HIERARCHY\n")
    assert "MOTION" in submission.check_motion(tmp_path / "b.bvh", [skeleton], 20, 30.0)[0][0]


def test_the_output_is_in_the_strictest_readers_grammar():
    """Some readers know only these tokens, `End` as it is, OFFSET before CHANNELS, and one number per channel."""
    text = bvh.format_bvh(smooth(chain(5, end_sites=[[np.nan] * 3] * 4 + [[1, 2, 3]]), 7))
    tokens, rest = re.Scanner(
        [
            (r"[a-zA-Z_]\w*", lambda _, token: token),
            (r"-*[0-9]*\.?[0-9]+([eE][-+]?[0-9]+)?", lambda _, token: float(token)),
            (r"[{}]", lambda _, token: token),
            (r":|\s+", None),
        ]
    ).scan(text)
    assert rest == ""
    motion = tokens.index("MOTION")
    assert tokens[motion + 1 : motion + 5] == ["Frames", 7.0, "Frame", "Time"]
    assert tokens[motion + 5] == pytest.approx(1 / 30, abs=1e-6)
    channels = sum(int(tokens[k + 1]) for k, token in enumerate(tokens) if token == "CHANNELS")
    assert len(tokens) - (motion + 6) == 7 * channels
    for k, token in enumerate(tokens):
        if token in ("ROOT", "JOINT"):
            assert tokens[k + 2 : k + 4] == ["{", "OFFSET"] and tokens[k + 7] == "CHANNELS"


def test_a_torn_frame_is_named_with_joint_and_figure(tmp_path):
    motion = smooth(chain(3), 20)
    rotations = motion.rotations.copy()
    rotations[7, 1] = rotation.multiply(rotations[7, 1], rotation.from_expmap([0, 2.0, 0]))
    bvh.write(tmp_path / "a.bvh", Motion(motion.skeleton, rotations, motion.positions, 30.0))
    ((problem,), warnings) = submission.check_motion(tmp_path / "a.bvh", [motion.skeleton], 20, 30.0)
    assert re.search(r"frame [78]: j1 turns 3\d\d\d degrees/s, more than 2700", problem) and warnings == []
    # A recording that turns as fast has the glitch itself.
    for recorded, torn in (({"j1": 3500.0}, False), ({"j1": 3000.0}, True), ({"j0": 9000.0}, True)):
        found, _ = submission.check_motion(tmp_path / "a.bvh", [motion.skeleton], 20, 30.0, recorded.copy)
        assert bool(found) == torn


def test_a_frozen_stretch_is_a_warning(tmp_path):
    motion = smooth(chain(3), 60)
    bvh.write(tmp_path / "a.bvh", motion.take([*range(10), *[10] * 35, *range(11, 26)]))
    problems, (warning,) = submission.check_motion(tmp_path / "a.bvh", [motion.skeleton], 60, 30.0)
    assert problems == [] and "frames 10 to 44: no motion for 1.1 s" in warning


@pytest.mark.parametrize(("spoken", "fails"), [(range(90), True), (range(71), True), (range(70), False), ((), False)])
def test_who_speaks_does_not_stand_still(spoken, fails, tmp_path):
    """Of 75 frames without motion from frame 9 on; 2 s of speech, 60 frames, are the most."""
    motion = smooth(chain(3), 60)
    bvh.write(tmp_path / "a.bvh", motion.take([*range(10), *[10] * 75, *range(11, 26)]))
    speaking = np.isin(np.arange(100), [*spoken])
    problems, warnings = submission.check_motion(
        tmp_path / "a.bvh", [motion.skeleton], 100, 30.0, speaking=lambda: speaking
    )
    assert (len(problems), len(warnings)) == ((1, 0) if fails else (0, 1))
    assert not fails or re.search(
        r"frames 10 to 84: no motion for 2\.5 s, in 2\.\d s of which the speech goes on", problems[0]
    )


def test_a_pause_of_a_second_is_no_stretch(tmp_path):
    motion = smooth(chain(3), 60)
    bvh.write(tmp_path / "a.bvh", motion.take([*range(10), *[10] * 31, *range(11, 30)]))
    assert submission.check_motion(tmp_path / "a.bvh", [motion.skeleton], 60, 30.0) == ([], [])

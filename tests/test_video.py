"""`render`: the video has the right length, sound and pictures, and what is drawn is what moves."""

import hashlib
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gesturegen.cli import main
from gesturegen.motion import bvh, rotation
from gesturegen.motion.skeleton import Motion
from gesturegen.video import figure, picture
from gesturegen.video._kernels import draw_capsules, to_yuv420
from tests import tiny
from tests.builders import bursts, chain, make_skeleton, random_motion, write_audio, write_clip

av = pytest.importorskip("av", reason="PyAV is not installed: pip install 'gesturegen[video]'")

NAMES = ("pelvis", "spine", "b_head", "b_head_null", "b_jaw", "b_l_arm", "b_l_wrist", "b_r_arm", "b_r_wrist")
PARENTS = (-1, 0, 1, 2, 2, 1, 5, 1, 7)
OFFSETS = (
    (0, 90, 0), (0, 40, 0), (0, 15, 0), (0, 20, 0), (0, -5, 5), (20, 0, 0), (25, -10, 0), (-20, 0, 0), (-25, -10, 0),
)  # fmt: skip
BODY = make_skeleton(NAMES, PARENTS, OFFSETS)


def still(frames: int, heading: float = 0.0, shift=(0.0, 0.0, 0.0)) -> Motion:
    """The body at rest, turned and moved as a whole."""
    rotations = np.tile(rotation.IDENTITY, (frames, len(NAMES), 1))
    rotations[:, 0] = rotation.about_y(np.array(heading))
    positions = np.tile(BODY.offsets, (frames, 1, 1))
    positions[:, 0] += shift
    return Motion(BODY, rotations, positions, 30.0)


def render(*arguments):
    return CliRunner().invoke(main, ["render", *map(str, arguments), "-j", "1", "--size", "320x180"])


def decode(path: Path) -> tuple[list[np.ndarray], np.ndarray, int, float]:
    """Pictures, samples, sample rate and duration in seconds of a video."""
    with av.open(path) as container:
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        sounds = container.streams.audio
        rate = sounds[0].rate if sounds else 0
        duration = container.duration / av.time_base
    samples = np.empty(0)
    if rate:
        with av.open(path) as container:
            samples = np.concatenate([frame.to_ndarray()[0] for frame in container.decode(audio=0)])
    return pictures, samples, rate, duration


@pytest.fixture(scope="module")
def takes(tmp_path_factory) -> Path:
    """Two clips of 2 s with sound."""
    folder = tmp_path_factory.mktemp("takes")
    for seed, name in enumerate(("one", "two")):
        bvh.write(folder / "bvh" / f"{name}.bvh", random_motion(BODY, 60, seed))
        write_audio(folder / "wav" / f"{name}.wav", bursts((0.5, 1.2), 2.0))
    return folder


def test_a_video_has_the_frames_and_the_sound_of_its_clip(takes, tmp_path):
    result = render(takes / "bvh", "--audio", takes / "wav", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.mp4", "two.mp4"]
    pictures, samples, rate, duration = decode(tmp_path / "one.mp4")
    assert len(pictures) == 60 and pictures[0].shape == (180, 320, 3)
    assert abs(duration - 2.0) <= 1 / 30 and abs(len(samples) / rate - 2.0) <= 1 / 30
    assert np.abs(samples[: round(0.4 * rate)]).max() < 0.1 < np.abs(samples[round(0.45 * rate) : rate]).max()
    body = [frame[20:].astype(int) for frame in pictures]
    assert min(np.abs(a - b).max() for a, b in pairwise(body)) > 60


@pytest.mark.slow
def test_the_bytes_do_not_depend_on_the_number_of_workers(takes, tmp_path):
    hashes = []
    for jobs in ("1", "2"):
        arguments = ["render", str(takes / "bvh"), "--out", str(tmp_path / jobs), "--size", "160x120", "-j", jobs]
        assert CliRunner().invoke(main, arguments).exit_code == 0
        hashes.append([hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted((tmp_path / jobs).iterdir())])
    assert hashes[0] == hashes[1] and len(hashes[0]) == 2


def test_a_run_knows_its_own_audio(tmp_path):
    data, work = tmp_path / "data", tmp_path / "work"
    write_clip(data / "trn", "trn_a", 2.0, motion=tiny.motion(np.random.default_rng(0), 60, chain(4)))
    write_clip(data / "tst", "tst_a", 1.5, (0.3, 0.9), with_motion=False)
    for command in ("preprocess", "build-graph", "reenact"):
        result = CliRunner().invoke(main, [command, "--data", str(data), "--work", str(work), "-j", "1"])
        assert result.exit_code == 0, result.output
    result = render("--data", data, "--work", work)
    assert result.exit_code == 0 and "silent" not in result.output, result.output
    pictures, samples, rate, _ = decode(work / "video/tst_a.mp4")
    assert len(pictures) == 45 and abs(len(samples) / rate - 1.5) <= 1 / 30


def test_without_sound_the_video_is_silent_and_says_so(takes, tmp_path):
    lonely = tmp_path / "lonely.bvh"
    lonely.write_bytes((takes / "bvh/one.bvh").read_bytes())
    result = render(lonely, "--work", tmp_path)
    assert result.exit_code == 0 and "warning: lonely: no audio of that name" in result.output
    assert len(decode(tmp_path / "video/lonely.mp4")[1]) == 0


def test_beside_shows_more_and_names_what_is_missing(takes, tmp_path):
    truth = tmp_path / "truth"
    bvh.write(truth / "one.bvh", random_motion(BODY, 40, 7))
    result = render(takes / "bvh", "--beside", f"truth={truth}", "--out", tmp_path / "out", "--work", tmp_path)
    assert result.exit_code == 0 and "warning: two: no motion of it for truth" in result.output
    assert len(decode(tmp_path / "out/one.mp4")[0]) == 60


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{takes}/bvh", "--audio", "{takes}/wav/one.wav"], "one audio file for 2 motions"),
        (["{takes}/bvh", "--audio", "{takes}/nowhere"], "no such audio file or folder"),
        (["{takes}/bvh", "--audio", "{takes}/bvh"], "no audio file in it"),
        (["{takes}/bvh", "--beside", "truth={takes}/wav"], "no BVH file in it"),
        (["{takes}/nowhere"], "no such file or folder"),
        (["{takes}/wav/one.wav"], "not a BVH file"),
        (["{takes}/bvh", "--size", "321x180"], "must be even"),
    ],
)
def test_what_is_refused(arguments, words, takes, tmp_path):
    given = [argument.format(takes=takes) for argument in arguments]
    result = CliRunner().invoke(main, ["render", *given, "--out", str(tmp_path), "--work", str(tmp_path / "w")])
    assert result.exit_code == 1 and words in result.output and len(result.output.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_broken_clip_leaves_no_half_video_and_the_rest_is_done(takes, tmp_path):
    for name in ("one", "two"):
        (tmp_path / f"{name}.bvh").write_bytes((takes / f"bvh/{name}.bvh").read_bytes())
    (tmp_path / "two.wav").write_bytes((takes / "wav/two.wav").read_bytes()[:500])
    result = render(tmp_path, "--work", tmp_path, "--out", tmp_path / "out")
    assert result.exit_code == 1 and "two.wav" in result.output and "cut off" in result.output
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["one.mp4"]


@pytest.mark.parametrize("module", ["av", "PIL"])
def test_without_the_extra_one_line_says_what_to_install(module, takes, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    result = render(takes / "bvh", "--out", tmp_path)
    assert result.exit_code == 1 and "pip install 'gesturegen[video]'" in result.output
    assert len(result.output.splitlines()) == 1 and "Traceback" not in result.output


# --- what is drawn ------------------------------------------------------------------------------------------


def near(image: np.ndarray, colour) -> int:
    return int((np.abs(image.astype(int) - np.array(colour)).max(axis=-1) < 12).sum())


def test_left_is_blue_and_on_the_viewers_right_whichever_way_the_body_faces():
    for heading in (0.0, 1.9, -3.0):
        shown = figure.make_figure(still(2, heading, (300.0, 0.0, -50.0)), "pelvis")
        image = next(picture.draw_pictures([picture.Scene("", shown)], "x", (400, 200), 30.0, 1))
        front = image[40:, :200]
        blue, orange = front[..., 2] > front[..., 0].astype(int) + 60, front[..., 0] > front[..., 2].astype(int) + 60
        assert blue.sum() > 100 and orange.sum() > 100
        assert np.nonzero(blue)[1].mean() > 100 > np.nonzero(orange)[1].mean()


def test_the_camera_follows_the_body():
    here, there = (figure.make_figure(still(3, shift=shift), "pelvis") for shift in ((0, 0, 0), (500, 0, 250)))
    np.testing.assert_allclose(
        here.points - np.insert(here.targets, 1, 0, axis=1)[:, None],
        there.points - np.insert(there.targets, 1, 0, axis=1)[:, None],
        atol=1e-9,
    )


def test_face_helpers_are_not_drawn_and_the_body_stands_on_the_floor():
    shown = figure.make_figure(still(2), "pelvis")
    with_jaw = BODY.offsets[0] + BODY.offsets[1] + BODY.offsets[2] + BODY.offsets[4]
    assert not (np.abs(shown.points[0] * shown.height + [0, 90, 0] - with_jaw).max(axis=-1) < 1e-6).any()
    ends = shown.points[:, shown.bones.ravel()]
    assert ends[..., 1].min() == pytest.approx(0.0, abs=1e-9) and ends[..., 1].max() < 1.0


@pytest.mark.parametrize(
    ("name", "side"),
    [
        ("b_l_wrist", figure.LEFT), ("LeftArm", figure.LEFT), ("UpperArm_L", figure.LEFT), ("lShldr", figure.LEFT),
        ("LThumb", figure.LEFT), ("b_r_foot", figure.RIGHT), ("RightUpLeg", figure.RIGHT), ("Hand.R", figure.RIGHT),
        ("RHipJoint", figure.RIGHT), ("b_spine3", figure.CENTRE), ("LowerBack", figure.CENTRE), ("Root", figure.CENTRE),
        ("root", figure.CENTRE), ("leftright", figure.CENTRE),
    ],
)  # fmt: skip
def test_sides_by_name(name, side):
    assert figure.side_of(name) == side


def test_a_motion_that_has_ended_is_grey():
    scenes = [picture.Scene(str(n), figure.make_figure(still(n), "pelvis")) for n in (5, 2)]
    images = list(picture.draw_pictures(scenes, "x", (480, 160), 30.0, 5))
    others = [image[40:, 240:] for image in images]
    colourful = [int((np.ptp(image.astype(int), axis=-1) > 60).sum()) for image in others]
    assert colourful[1] > 100 and colourful[4] == 0 and near(others[4], (190, 190, 190)) > 100


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_every_motion_has_its_own_two_boxes(count):
    boxes = [box for pair in picture._arrange(count, 640, 360, 20, 1.0) for box in pair]
    painted = np.zeros((360, 640), dtype=int)
    for left, top, right, bottom in boxes:
        painted[top:bottom, left:right] += 1
    assert len(boxes) == 2 * count and painted.max() == 1 and painted[:20].max() == 0


def test_capsules_against_the_distance_of_every_pixel():
    rng = np.random.default_rng(0)
    image = np.full((40, 60, 3), 200, dtype=np.uint8)
    expected = image.astype(float)
    segments, radii = rng.uniform(-10, 60, size=(12, 4)), rng.uniform(0.5, 6, size=12)
    segments[0, 2:] = segments[0, :2]  # a dot
    segments[1, 3] = segments[1, 1]  # a level line
    colours = rng.integers(0, 256, size=(12, 3)).astype(np.uint8)
    draw_capsules(image, segments, radii, colours, np.array([5, 3, 55, 37]))
    y, x = np.mgrid[:40, :60]
    inside = (x >= 5) & (x < 55) & (y >= 3) & (y < 37)
    for (x0, y0, x1, y1), radius, colour in zip(segments, radii, colours, strict=True):
        dx, dy = x1 - x0, y1 - y0
        t = np.clip(((x - x0) * dx + (y - y0) * dy) / max(dx * dx + dy * dy, 1e-12), 0, 1)
        cover = np.clip(radius + 0.5 - np.hypot(x - x0 - t * dx, y - y0 - t * dy), 0, 1) * inside
        expected = np.floor(expected + cover[..., None] * (colour - expected) + 0.5)
    np.testing.assert_allclose(image, expected, atol=1)


def test_video_planes_are_those_of_ffmpeg():
    rng = np.random.default_rng(0)
    image = np.repeat(np.repeat(rng.integers(0, 256, size=(20, 32, 3)), 2, axis=0), 2, axis=1).astype(np.uint8)
    planes = np.empty((60, 64), dtype=np.uint8)
    to_yuv420(image, planes)
    theirs = av.VideoFrame.from_ndarray(image, format="rgb24").reformat(format="yuv420p", interpolation="AREA")
    assert np.abs(theirs.to_ndarray().astype(int) - planes).max() <= 2

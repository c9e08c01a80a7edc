import itertools
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.errors import DataError
from gesturegen.motion import bvh, cleanup, rotation
from gesturegen.motion.skeleton import Motion
from tests.builders import (
    ARM,
    ARM_CHANNELS,
    ARM_ROW,
    POSITIONS,
    ZXY,
    bvh_text,
    chain,
    data_folder,
    literally,
    make_skeleton,
    product,
    random_motion,
    refused,
)


@pytest.fixture
def read(tmp_path):
    def read(text, name="clip.bvh"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return bvh.read(path)

    return read


def assert_same_motion(found, expected, tolerance=1e-6):
    assert found.skeleton.difference(expected.skeleton) is None
    np.testing.assert_allclose(
        rotation.to_matrix(found.rotations), rotation.to_matrix(expected.rotations), atol=tolerance
    )
    np.testing.assert_allclose(found.positions, expected.positions, atol=tolerance)


# --- what the numbers mean ----------------------------------------------------------------------------------


def test_the_arm(read):
    motion = read(bvh_text())
    assert motion.skeleton.names == ("upper", "lower")
    assert motion.skeleton.parents.tolist() == [-1, 0]
    assert motion.skeleton.n_channels == ARM_CHANNELS
    assert (motion.n_frames, motion.fps) == (3, 30.0)
    np.testing.assert_array_equal(motion.skeleton.offsets, [[0, 10, 0], [30, 0, 0]])
    np.testing.assert_array_equal(motion.skeleton.end_sites, [[np.nan] * 3, [25, 0, 0]])
    np.testing.assert_array_equal(motion.positions[1], [[1, 2, 3], [30, 0, 0]])
    expected = [product("ZXY", (10, 20, 30)), product("ZXY", (40, 50, 60))]
    np.testing.assert_allclose(rotation.to_matrix(motion.rotations[2]), expected, atol=1e-12)


def test_a_single_position_channel_replaces_only_its_axis(read):
    hierarchy = ARM.replace("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS 1 Yposition")
    motion = read(bvh_text(["0 0 0 0 0 0 7.5"], hierarchy))
    np.testing.assert_array_equal(motion.positions[0, 1], [30, 7.5, 0])


def test_still_joints_beside_turning_ones(read):
    rows = [f"1 2 3 10 20 30 {angle} 50 60" for angle in (0, 45, 90)]
    motion = read(bvh_text(rows))
    for frame, angle in enumerate((0, 45, 90)):
        expected = [product("ZXY", (10, 20, 30)), product("ZXY", (angle, 50, 60))]
        np.testing.assert_allclose(rotation.to_matrix(motion.rotations[frame]), expected, atol=1e-12)


NAMES = st.text("abcXYZ:-_.09 ", min_size=1, max_size=12).map(str.strip).filter(bool).map(lambda s: " ".join(s.split()))


@st.composite
def channel_lists(draw):
    turns = draw(st.sampled_from([(), *[(f"{a}rotation",) for a in "XYZ"], *itertools.permutations(ZXY)]))
    moves = draw(st.sampled_from([(), *itertools.permutations(POSITIONS)]))
    mixed = list(turns + moves)
    if draw(st.booleans()):
        # Positions may stand anywhere; the order of the rotations among themselves is what counts.
        places = sorted(draw(st.permutations(range(len(mixed))))[: len(moves)])
        rest = iter(turns)
        moving = iter(moves)
        mixed = [next(moving) if n in places else next(rest) for n in range(len(mixed))]
    return tuple(mixed)


@st.composite
def recordings(draw):
    names = draw(st.lists(NAMES, min_size=1, max_size=6, unique=True))
    parents = [-1, *[draw(st.integers(0, j - 1)) for j in range(1, len(names))]]
    # Depth first, as a file lists them.
    order, pending = [], [0]
    while pending:
        joint = pending.pop()
        order.append(joint)
        pending += [j for j, parent in enumerate(parents) if parent == joint][::-1]
    parents = [-1 if parents[j] < 0 else order.index(parents[j]) for j in order]
    channels = [draw(channel_lists()) for _ in names]
    if not any(channels):
        channels[0] = POSITIONS
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    offsets = rng.uniform(-50, 50, (len(names), 3)).round(6)
    leaves = [j not in parents for j in range(len(names))]
    ends = np.where(np.array(leaves)[:, None], rng.uniform(-9, 9, (len(names), 3)).round(6), np.nan)
    skeleton = make_skeleton(names, parents, offsets, channels, ends)
    values = rng.uniform(-400, 400, (draw(st.integers(1, 4)), skeleton.n_channels)).round(6)
    # Gimbal lock for some.
    values[rng.random(values.shape) < 0.1] = 90.0
    return skeleton, values


@settings(deadline=None, derandomize=True, max_examples=60)
@given(recordings())
def test_random_recordings_read_and_write(tmp_path_factory, recording):
    skeleton, values = recording
    folder = tmp_path_factory.mktemp("bvh")
    path = folder / "clip.bvh"
    path.write_text(bvh_text([" ".join(f"{v:.6f}" for v in row) for row in values], skeleton.hierarchy))
    motion = bvh.read(path)
    assert motion.skeleton.difference(skeleton) is None
    np.testing.assert_allclose(motion.skeleton.end_sites, skeleton.end_sites)
    column = 0
    for joint, channels in enumerate(skeleton.channels):
        named = {name: values[:, column + k] for k, name in enumerate(channels)}
        column += len(channels)
        turns = [name for name in channels if name.endswith("rotation")]
        for frame in range(len(values)):
            expected = product([name[0] for name in turns], [named[name][frame] for name in turns])
            np.testing.assert_allclose(rotation.to_matrix(motion.rotations[frame, joint]), expected, atol=1e-9)
        for axis, name in enumerate(POSITIONS):
            np.testing.assert_allclose(motion.positions[:, joint, axis], named.get(name, skeleton.offsets[joint, axis]))
    bvh.write(folder / "again.bvh", motion)
    assert_same_motion(bvh.read(folder / "again.bvh"), motion)


# --- writing ------------------------------------------------------------------------------------------------


def test_hierarchy_is_repeated_to_the_letter(read, tmp_path):
    odd = ARM.replace("JOINT lower", "joint   lower").replace("End Site", "End site").replace("30.0", "3.00e1")
    bvh.write(tmp_path / "out.bvh", read(bvh_text(hierarchy=odd)))
    assert (tmp_path / "out.bvh").read_text().startswith(odd + "MOTION\nFrames: 3\nFrame Time: 0.033333\n")


def test_values_have_six_decimals_and_no_negative_zero(read, tmp_path):
    rows = ["1e-9 -1e-9 3 0 0 0 0 0 0", "1.23456789 -0.0000004 3 10 0 0 0 0 -1e-12"]
    bvh.write(tmp_path / "out.bvh", read(bvh_text(rows)))
    written = (tmp_path / "out.bvh").read_text().splitlines()[18:]
    assert written[0] == "0.000000 0.000000 3.000000 0.000000 0.000000 0.000000 0.000000 0.000000 0.000000"
    assert written[1] == "1.234568 0.000000 3.000000 10.000000 0.000000 0.000000 0.000000 0.000000 0.000000"


def test_writing_twice_gives_the_same_bytes(tmp_path):
    motion = random_motion(chain(4), 5)
    for name in ("a", "b"):
        bvh.write(tmp_path / name, motion)
    bvh.write(tmp_path / "c", bvh.read(tmp_path / "a"))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes() == (tmp_path / "c").read_bytes()


def test_one_frame_is_written_and_read(tmp_path):
    motion = random_motion(chain(3), 1)
    bvh.write(tmp_path / "one.bvh", motion)
    assert_same_motion(bvh.read(tmp_path / "one.bvh"), motion)


def test_hierarchy_text_of_a_made_skeleton_is_read_back(read):
    channels = [POSITIONS + ZXY, (), ("Yrotation",), ("Xrotation", "Yrotation", "Zrotation", "Zposition")]
    ends = [[np.nan] * 3, [np.nan] * 3, [0.0, -1.5, 0.0], [4.0, 0.0, 0.25]]
    skeleton = make_skeleton(["a", "b:1", "c-2", "d e"], [-1, 0, 1, 0], channels=channels, end_sites=ends)
    motion = read(bvh_text([" ".join(["0"] * skeleton.n_channels)], skeleton.hierarchy))
    assert motion.skeleton.difference(skeleton) is None
    np.testing.assert_array_equal(motion.skeleton.end_sites, skeleton.end_sites)


@pytest.mark.parametrize("fps", (24.0, 25.0, 29.97, 30.0, 50.0, 60.0, 120.0))
def test_frame_rates_survive_writing(tmp_path, fps):
    bvh.write(tmp_path / "a.bvh", random_motion(chain(2), 2, fps=fps))
    assert bvh.read(tmp_path / "a.bvh").fps == pytest.approx(fps, rel=1e-4)


def test_failed_writing_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "out.bvh"
    bvh.write(path, random_motion(chain(2), 3))
    before = path.read_bytes()
    broken = random_motion(chain(2), 3)
    object.__setattr__(broken, "skeleton", None)
    with pytest.raises(AttributeError):
        bvh.write(path, broken)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["out.bvh"]


# --- dialects -----------------------------------------------------------------------------------------------

COMPACT = """HIERARCHY
ROOT upper { OFFSET 0.0 10.0 0.0 CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
JOINT lower { OFFSET 30.0 0.0 0.0
CHANNELS 3 Zrotation Xrotation Yrotation End Site { OFFSET 25.0 0.0 0.0 } } }
"""

DIALECTS = {
    "CRLF": bvh_text().replace("\n", "\r\n"),
    "tabs between values": bvh_text([ARM_ROW.replace(" ", "\t")] * 3),
    "space around every value": bvh_text([f"  {ARM_ROW.replace(' ', '   ')} \t"] * 3),
    "End site": bvh_text().replace("End Site", "End site"),
    "END SITE": bvh_text().replace("End Site", "END SITE"),
    "no End Site": re.sub(r"\t\tEnd Site.*?\}\n", "", bvh_text(), flags=re.DOTALL),
    "no final newline": bvh_text().rstrip("\n"),
    "blank lines at the end": bvh_text() + "\n\n \n",
    "blank lines between": bvh_text().replace("MOTION\n", "MOTION\n\n").replace("033333\n", "033333\n\n"),
    "byte order mark": "\N{ZERO WIDTH NO-BREAK SPACE}" + bvh_text(),
    "blank lines before": "\n\n" + bvh_text(),
    "scientific notation": bvh_text([ARM_ROW.replace("10.0", "1.0e+01").replace("2.0 ", "2E0 ")] * 3),
    "plus signs and no leading zero": bvh_text([ARM_ROW.replace("10.0", "+10.")] * 3, frame_time=".033333"),
    "compact braces": bvh_text(hierarchy=COMPACT),
    "brace after the name": bvh_text(hierarchy=ARM.replace("ROOT upper\n{", "ROOT upper {")),
    "brace glued to the name": bvh_text(hierarchy=ARM.replace("ROOT upper\n{", "ROOT upper{")),
    "lower case words": bvh_text(
        hierarchy=ARM.replace("ROOT", "root").replace("OFFSET", "offset").replace("CHANNELS", "channels")
    ),
    "lower case channels": bvh_text(hierarchy=ARM.replace("Zrotation", "zrotation").replace("Xpos", "xpos")),
    "indented MOTION": bvh_text().replace("MOTION\nFrames: 3\n", "  MOTION \nFrames:\t3\n"),
    "frames without a colon": bvh_text().replace("Frames:", "Frames").replace("Frame Time:", "Frame Time"),
}


@pytest.mark.parametrize("text", DIALECTS.values(), ids=DIALECTS)
def test_dialect_reads_like_the_plain_file(read, text):
    expected, found = read(bvh_text(), "plain.bvh"), read(text)
    assert found.fps == 30.0 and found.n_frames == 3
    assert_same_motion(found, expected, 1e-12)


def test_tiny_scientific_values_are_read(read):
    motion = read(bvh_text(["-1.59e-15 2 3 -1.59e-15 0 0 1.2E-07 0 0"]))
    assert motion.positions[0, 0, 0] == -1.59e-15


@pytest.mark.parametrize("name", ("mixamorig:LeftArm", "b_l-arm", "Bip01 L Hand", "a.b", "Hüfte", "joint", "End", "12"))
def test_odd_joint_names_survive(read, tmp_path, name):
    motion = read(bvh_text(hierarchy=ARM.replace("JOINT lower", f"JOINT {name}")))
    assert motion.skeleton.names == ("upper", name)
    bvh.write(tmp_path / "again.bvh", motion)
    assert bvh.read(tmp_path / "again.bvh").skeleton.names == ("upper", name)


def test_names_that_are_not_utf8_are_read(read):
    text = bvh_text(hierarchy=ARM.replace("JOINT lower", "JOINT Hüfte")).encode("latin-1")
    assert read(text).skeleton.names == ("upper", "Hüfte")


@pytest.mark.parametrize(
    ("written", "fps"),
    [
        ("0.033333", 30.0),
        ("0.0333333", 30.0),
        (".0083333", 120.0),
        ("0.008333", 120.0),
        ("0.016667", 60.0),
        ("0.041667", 24.0),
        ("0.04", 25.0),
        ("3.33333e-02", 30.0),
        ("0.0333", 30.0),
        ("0.033", 30.0),
        ("0.0166666", 60.0),
        ("0.017", 60.0),
        ("0.008", 125.0),
        ("0.03333333507180214", 30.0),
        ("0.03336", 1 / 0.03336),
        ("0.03337", 1 / 0.03337),
        ("0.0333667", 1 / 0.0333667),
        ("0.0166833", 1 / 0.0166833),
        ("0.016683", 1 / 0.016683),
        ("0.04170833", 1 / 0.04170833),
        ("0.0335", 1 / 0.0335),
        ("0.5", 2.0),
    ],
)
def test_only_a_rate_that_the_printed_digits_allow_is_whole(read, written, fps):
    assert read(bvh_text(frame_time=written)).fps == fps


@pytest.mark.parametrize("fps", [24000 / 1001, 30000 / 1001, 60000 / 1001, 120000 / 1001])
def test_rates_of_television_keep_their_time(read, fps):
    """Ten minutes are ten minutes, also when resampled: rounded to a whole rate they would be off by 0.6 s."""
    motion = read(bvh_text(rows=(ARM_ROW,), frame_time=f"{1 / fps:.7f}"))
    assert 600 * motion.fps == pytest.approx(600 * fps, rel=1e-5)
    count = round(600 * fps)
    long = Motion(chain(1), np.tile([1.0, 0, 0, 0], (count, 1, 1)), np.zeros((count, 1, 3)), motion.fps)
    assert cleanup.resample(long, 30.0).n_frames / 30.0 == pytest.approx(600, abs=0.05)


@pytest.mark.parametrize(("rate", "frames"), [(120, 401), (24, 25), (60, 121), (25, 51), (50, 11)])
def test_resampling_keeps_duration_and_end_poses(rate, frames):
    skeleton = chain(3)
    turn = np.linspace(0.0, 2.0, frames)
    rotations = np.repeat(rotation.about_y(turn)[:, None], 3, axis=1)
    positions = np.tile(skeleton.offsets, (frames, 1, 1))
    positions[:, 0, 0] = np.linspace(0, 50, frames)
    motion = Motion(skeleton, rotations, positions, float(rate))
    found = cleanup.resample(motion, 30)
    seconds = (frames - 1) / rate
    assert found.fps == 30 and found.n_frames == round(seconds * 30) + 1
    np.testing.assert_allclose(found.rotations[[0, -1]], rotations[[0, -1]], atol=1e-9)
    np.testing.assert_allclose(found.positions[[0, -1]], positions[[0, -1]], atol=1e-9)
    # The turn is even, so that SLERP hits it at every new frame.
    np.testing.assert_allclose(rotation.heading(found.rotations[:, 1]), np.linspace(0, 2, found.n_frames), atol=1e-9)


# --- refusals -----------------------------------------------------------------------------------------------


def test_a_missing_file_is_named(tmp_path):
    with refused(DataError, r"cannot be read \(No such file or directory\)", tmp_path / "none.bvh"):
        bvh.read(tmp_path / "none.bvh")


def test_a_folder_is_no_file(tmp_path):
    with refused(DataError, r"cannot be read \(Is a directory\)", tmp_path):
        bvh.read(tmp_path)


WHOLE_FILE = {
    "empty": (b"", "the file is empty"),
    "blank": (b" \r\n\n", "the file is empty"),
    "binary": (b"HIERARCHY\n\x00\x01\x02", "binary data"),
    "LFS pointer": (b"version https://git-lfs.github.com/spec/v1\noid sha256:12\nsize 9\n", "Git LFS pointer"),
    "text": (b"Dear reader,\nthis is a letter.\n", r"no MOTION section \(it starts with 'Dear read'\)"),
    "cut in the hierarchy": (ARM.encode()[:150], "no MOTION section .*cut off inside its hierarchy"),
    "cut before MOTION": (ARM.encode(), "no MOTION section .*cut off inside its hierarchy"),
}


@pytest.mark.parametrize(("content", "match"), WHOLE_FILE.values(), ids=WHOLE_FILE)
def test_files_that_are_no_bvh_are_refused(read, tmp_path, content, match):
    with refused(DataError, match, tmp_path / "clip.bvh"):
        read(content)


def edited(old, new, text=None):
    text = text or bvh_text()
    assert old in text
    return text.replace(old, new, 1)


# What is broken: the text, the line that is named, what the message says.
BROKEN = {
    "cut after MOTION": (ARM + "MOTION\n", 17, "expected `Frames: N` and `Frame Time: seconds`"),
    "cut after MOTION without a newline": (ARM + "MOTION", 17, "expected `Frames: N`"),
    "cut after Frames": (ARM + "MOTION\nFrames: 3\n", 17, "expected `Frames: N`"),
    "cut after Frame Time": (ARM + "MOTION\nFrames: 3\nFrame Time: 0.033333\n", 17, "3` but 0 rows .* cut off"),
    "cut between rows": (bvh_text(frames=4), 17, "`Frames: 4` but 3 rows of values follow; the file is cut off"),
    "cut inside a row": (bvh_text()[:-20], 21, "5 values where the hierarchy has 9 channels; the file is cut off"),
    "cut inside a number": (
        bvh_text([ARM_ROW, ARM_ROW, "1.0 2.0 -"])[:-1],
        21,
        "3 values where the hierarchy has 9 channels; the file is cut off",
    ),
    "too many rows": (bvh_text(frames=2), 17, "`Frames: 2` but 3 rows of values follow; the count is wrong"),
    "frames 0": (bvh_text(frames=0), 17, "`Frames: 0` is not a number of frames"),
    "frames -3": (bvh_text(frames=-3), 17, "`Frames: -3` is not a number of frames"),
    "frames 1e9": (bvh_text(frames="1e9"), 17, "`Frames: 1e9` is not a number of frames"),
    "a thousand million frames": (bvh_text(frames=10**9), 17, "`Frames: 1000000000` but 3 rows"),
    "more digits than a number has": (bvh_text(frames="9" * 5000), 17, "Frames: 9"),
    "frames text": (bvh_text(frames="many"), 17, "`Frames: many` is not a number of frames"),
    "frames missing": (bvh_text(frames=""), 17, "`Frames: ` is not a number of frames"),
    "frame time 0": (bvh_text(frame_time="0"), 18, "`Frame Time: 0` is not a time"),
    "frame time nan": (bvh_text(frame_time="nan"), 18, "`Frame Time: nan` is not a time"),
    "frame time inf": (bvh_text(frame_time="inf"), 18, "`Frame Time: inf` is not a time"),
    "frame time negative": (bvh_text(frame_time="-0.033"), 18, "`Frame Time: -0.033` is not a time"),
    "frame time fps": (bvh_text(frame_time="30"), 18, "`Frame Time: 30` is not a time"),
    "frame time text": (bvh_text(frame_time="fast"), 18, "`Frame Time: fast` is not a time"),
    "nan value": (
        bvh_text([ARM_ROW, ARM_ROW.replace("50.0", "nan")]),
        20,
        r"column 8 \(lower Xrotation\) is 'nan', not a finite number",
    ),
    "infinite value": (bvh_text([ARM_ROW.replace("1.0", "-inf", 1)]), 19, r"column 1 \(upper Xposition\) is '-inf'"),
    "letters": (bvh_text([ARM_ROW, ARM_ROW.replace("60.0", "x")]), 20, r"column 9 \(lower Yrotation\) is 'x'"),
    "decimal commas": (bvh_text([ARM_ROW.replace(".", ",")]), 19, r"column 1 \(upper Xposition\) is '1,0'"),
    "short row": (bvh_text([ARM_ROW, ARM_ROW[:-5], ARM_ROW]), 20, "8 values where the hierarchy has 9 channels; every"),
    "long row": (bvh_text([ARM_ROW, ARM_ROW, ARM_ROW + " 7"]), 21, "10 values where the hierarchy has 9 channels; eve"),
    "all rows short": (bvh_text([ARM_ROW[:-5]] * 3), 19, "8 values where the hierarchy has 9 channels; every"),
    "all rows long": (bvh_text([ARM_ROW + " 7"] * 3), 19, "10 values where the hierarchy has 9 channels; every"),
    "nan in CRLF": (
        bvh_text([ARM_ROW, ARM_ROW.replace("50.0", "nan")]).replace("\n", "\r\n"),
        20,
        r"column 8 \(lower Xrotation\) is 'nan'",
    ),
    "fewer channels than announced": (edited("CHANNELS 3 ", "CHANNELS 4 "), 9, "announces 4 channels, found 3 names"),
    "more channels than announced": (edited("CHANNELS 3 ", "CHANNELS 2 "), 9, "cannot be read.*0, 1 or 3 rotations"),
    "more names than announced": (edited("CHANNELS 6 ", "CHANNELS 5 "), 5, "0, 1 or 3 rotations"),
    "no count of channels": (edited("CHANNELS 3 ", "CHANNELS "), 9, "CHANNELS needs a count, found 'Zrotation'"),
    "unknown channel": (edited("Yrotation", "Wrotation"), 5, "unknown channel 'Wrotation'; allowed are Xposition"),
    "doubled channel": (edited("CHANNELS 3 Zrotation", "CHANNELS 3 Yrotation"), 9, "each channel once"),
    "short OFFSET": (edited("OFFSET 30.0 0.0 0.0", "OFFSET 30.0 0.0"), 8, "OFFSET needs three numbers"),
    "long OFFSET": (edited("OFFSET 30.0 0.0 0.0", "OFFSET 30.0 0.0 0.0 1.0"), 8, "unknown word '1.0'"),
    "OFFSET nan": (edited("OFFSET 30.0 0.0 0.0", "OFFSET 30.0 nan 0.0"), 8, "OFFSET needs three numbers"),
    "no OFFSET": (edited("\t\tOFFSET 30.0 0.0 0.0\n", ""), 14, "joint 'lower' has no OFFSET"),
    "conflict marker in the hierarchy": (
        edited("\tJOINT", "<<<<<<< HEAD\n\tJOINT"),
        6,
        "merge conflict marker '<<<<<<<'",
    ),
    "conflict marker in the rows": (
        bvh_text([ARM_ROW, ">>>>>>> main", ARM_ROW]),
        20,
        "merge conflict marker '>>>>>>>'",
    ),
    "two roots": (edited("MOTION", "ROOT second\n{\n\tOFFSET 0 0 0\n}\nMOTION"), 16, "a second ROOT 'second'"),
    "joint name twice": (edited("JOINT lower", "JOINT upper"), 6, "joint name 'upper' stands twice"),
    "joint without a name": (edited("JOINT lower", "JOINT"), 6, "JOINT without a name"),
    "brace missing at the end": (edited("}\nMOTION", "MOTION"), 14, "ends before its braces close"),
    "brace missing at the start": (
        edited("JOINT lower\n\t{\n", "JOINT lower\n"),
        7,
        "a second OFFSET of joint 'upper'",
    ),
    "a second CHANNELS": (
        edited("\tJOINT", "\tCHANNELS 1 Xrotation\n\tJOINT"),
        6,
        "a second CHANNELS of joint 'upper'; keep one",
    ),
    "a second End Site": (
        edited("\t\t}\n\t}", "\t\t}\n\t\tEnd Site\n\t\t{\n\t\t\tOFFSET 1 0 0\n\t\t}\n\t}"),
        14,
        "a second End Site of joint 'lower'; keep one",
    ),
    "a superscript for a count": (edited("CHANNELS 3", "CHANNELS ²"), 9, "CHANNELS needs a count, found '²'"),
    "a count of channels without end": (edited("CHANNELS 3", "CHANNELS " + "9" * 5000), 9, "CHANNELS needs a count"),
    "an Arabic number": (edited("OFFSET 30.0", "OFFSET ٣"), 8, "OFFSET needs three numbers"),
    "a plausible number with an underscore": (edited("OFFSET 30.0", "OFFSET 3_0"), 8, "OFFSET needs three numbers"),
    "a large OFFSET": (edited("OFFSET 30.0", "OFFSET 1e200"), 8, r"OFFSET needs three numbers of at most 1e\+06"),
    "20,000 levels": (
        "HIERARCHY\nROOT r\n" + "".join(f"{{\nOFFSET 0 0 0\nJOINT j{n}\n" for n in range(20_000)) + "MOTION\n",
        603,
        "more than 200 levels",
    ),
    "thousands of joints": (
        "HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\n"
        + "".join(f"JOINT j{n} {{ OFFSET 0 0 0 }}\n" for n in range(3000))
        + "}\nMOTION\n",
        1004,
        "more than 1000 joints",
    ),
    "a name that steers a terminal": (
        edited("JOINT lower", "JOINT lo\x1b[2Jwer"),
        6,
        r"the joint name 'lo\\\\x1b\[2Jwer' holds a",
    ),
    "a name without end": (edited("JOINT lower", "JOINT " + "a" * 300), 6, "longer than 200 characters"),
    "frames in Arabic": (bvh_text(frames="٣"), 17, "is not a number of frames"),
    "brace too many": (edited("}\nMOTION", "}\n}\nMOTION"), 16, "one closing brace too many"),
    "brace of no joint": (edited("{\n", "{\n{\n"), 4, "a brace opens that belongs to no joint"),
    "no HIERARCHY": (edited("HIERARCHY\n", ""), 1, "found 'ROOT upper' where HIERARCHY was expected"),
    "no joint": (edited(ARM, "HIERARCHY\n"), 1, "the hierarchy ends before"),
    "JOINT instead of ROOT": (edited("ROOT", "JOINT"), 2, "JOINT 'upper' stands outside any joint"),
    "JOINT inside an End Site": (edited("\t\t\tOFFSET 25.0 0.0 0.0", "JOINT tip"), 12, "JOINT 'tip' stands outside"),
    "CHANNELS inside an End Site": (
        edited("\t\t\tOFFSET 25.0 0.0 0.0", "CHANNELS 0"),
        12,
        "CHANNELS outside any joint",
    ),
    "unknown word": (edited("\tJOINT", "\tSCALE 2\n\tJOINT"), 6, "unknown word 'SCALE' in the hierarchy"),
}


@pytest.mark.parametrize(("text", "line", "match"), BROKEN.values(), ids=BROKEN)
def test_broken_files_are_refused_with_their_line(read, tmp_path, text, line, match):
    with refused(DataError, literally(tmp_path / "clip.bvh", line) + ".*" + match):
        read(text)


def test_absurd_values_are_refused_with_frame_and_channel(read, tmp_path):
    with refused(DataError, r"frame 1, lower Zrotation: 1e\+07 is not a plausible value", tmp_path / "clip.bvh"):
        read(bvh_text([ARM_ROW, ARM_ROW.replace("40.0", "1e7")]))


def test_joints_without_channels_do_not_fill_the_memory(read, tmp_path):
    joints = "".join(f"JOINT j{n} {{ OFFSET 0 0 0 }}\n" for n in range(900))
    text = bvh_text(["1"] * 10_000, "HIERARCHY\nROOT r {\nOFFSET 0 0 0\nCHANNELS 1 Xposition\n" + joints + "}\n")
    with refused(DataError, "901 joints in 10,000 frames take 505 MB of memory, over 20 times the file", tmp_path):
        read(text)


def test_a_hierarchy_without_end_is_refused_at_once(read, tmp_path):
    with refused(DataError, "a hierarchy of 1,200,... characters", tmp_path):
        read(ARM[:-2] + "End Site { OFFSET 0 0 0 }" * 48_000 + "}\nMOTION\n")


@pytest.mark.parametrize("space", (" ", "\n", " \t\n"))
def test_spaces_without_end_take_no_time(read, tmp_path, space):
    with refused(DataError, "expected `Frames: N`|is not a number of frames", tmp_path):
        read(ARM + "MOTION\nFrames" + space * 1_000_000 + "x 3")


@pytest.mark.parametrize("frame_time", ("0.00001", "1e-9", "1e-320", "1e9", "-0.03", "0", "0.0_3", "٠.١"))
def test_absurd_frame_rates_are_refused(read, tmp_path, frame_time):
    with refused(DataError, literally(tmp_path / "clip.bvh", 18)):
        read(bvh_text(frame_time=frame_time))


def test_a_file_cut_anywhere_is_refused_or_lacks_only_trailing_digits(tmp_path):
    path, text = tmp_path / "clip.bvh", bvh_text()
    whole = len(text) - len("0.0\n")  # the last number still has its first digit
    for cut in range(len(text)):
        path.write_text(text[:cut])
        if cut >= whole:
            assert bvh.read(path).n_frames == 3
        else:
            with refused(DataError, re.escape(str(path))):
                bvh.read(path)


EDITS = st.sampled_from(
    ["", " ", "\n", "\t", "{", "}", "-", "e", "9", "nan ", "1e400 ", "\x0c", "\x85", "\u0663", "\xb2 "]
)


@settings(deadline=None, derandomize=True, max_examples=150)
@given(st.integers(0, len(bvh_text()) - 1), EDITS, st.integers(0, 5))
def test_an_edited_file_is_read_or_refused_in_one_line(tmp_path_factory, at, insert, drop):
    path = tmp_path_factory.mktemp("edit") / "clip.bvh"
    text = bvh_text()
    path.write_text(text[:at] + insert + text[at + drop :])
    try:
        motion = bvh.read(path)
    except DataError as error:
        assert "\n" not in str(error) and str(path) in str(error)
    else:
        assert np.isfinite(motion.rotations).all() and np.isfinite(motion.positions).all()


# --- real files ---------------------------------------------------------------------------------------------


def test_every_real_file_comes_back_with_the_same_matrices(tmp_path):
    paths = sorted(data_folder().rglob("*.bvh"))
    assert len(paths) >= 25
    for path in paths:
        motion = bvh.read(path)
        if motion.n_frames > 400:
            motion = motion.take(slice(0, 400))
        bvh.write(tmp_path / "again.bvh", motion)
        again = bvh.read(tmp_path / "again.bvh")
        assert again.fps == pytest.approx(motion.fps, rel=1e-4), path
        assert again.skeleton.hierarchy == motion.skeleton.hierarchy, path
        assert_same_motion(again, motion)


def test_real_dialects_are_understood():
    folder = data_folder() / "bvh"
    walk = bvh.read(folder / "fairmotion" / "01_01.bvh")
    assert walk.fps == 120.0
    generated = bvh.read(next((folder / "genea_generated").glob("*.bvh")))
    assert len(generated.skeleton.names) == 83 and generated.skeleton.names[:2] == ("body_world", "b_root")


def test_the_sample_has_the_genea_skeleton():
    folder = data_folder()
    rest = bvh.read(folder / "genea_skeleton" / "genea2023_restpose_83j.bvh").skeleton
    sample = bvh.read(next((folder / "genea_style_sample").rglob("*.bvh")))
    assert rest.difference(sample.skeleton) is None
    assert sample.n_frames == 1906 and sample.fps == 30.0 and sample.skeleton.n_channels == 498
    assert np.isfinite(rest.end_sites).all(axis=1).sum() == 27


def test_a_skeleton_is_read_without_its_frames(tmp_path):
    path = tmp_path / "a.bvh"
    path.write_text(bvh_text(rows=("no numbers here",)).replace("\n", "\r\n"))
    skeleton = bvh.read_skeleton(path)
    assert skeleton.names == ("upper", "lower") and skeleton.n_channels == ARM_CHANNELS
    with refused(DataError, "no MOTION section"):
        path.write_text(ARM)
        bvh.read_skeleton(path)

"""Packing: what is stored can be read back as exactly as is said, in as few bytes as is said."""

import base64
import io
import json
import struct
import zlib

import numpy as np
import pytest
import soundfile
from hypothesis import given
from hypothesis import strategies as st

from gesturegen.errors import DataError
from gesturegen.motion import kinematics
from gesturegen.report import figure, pack, sound
from gesturegen.settings.loading import load_config
from tests import tiny
from tests.builders import SMALL, bursts, chain, random_motion, refused
from tests.report import synthetic

CONFIG = load_config()


def unpack(packed: dict) -> np.ndarray:
    """Positions of a packed motion, as the page's script reads them."""
    stored = zlib.decompress(base64.b64decode(packed["data"]))
    frames, points = packed["frames"], len(packed["parents"])
    low, high = np.frombuffer(stored, dtype=np.uint8).reshape(2, points * 3, frames).astype(int)
    differences = low + 256 * high
    steps = np.cumsum(differences, axis=1).astype(np.uint16).astype(np.int16)
    return steps.T.reshape(frames, points, 3) * packed["step"] + np.array(packed["centre"])


# --- motion -------------------------------------------------------------------------------------------------


@SMALL
@given(st.integers(0, 10_000), st.sampled_from([0.0, 1.0, 100.0, 1e5]), st.integers(1, 40))
def test_positions_come_back_within_half_a_step(seed, travel, frames):
    moved = tiny.motion(np.random.default_rng(seed), frames, travel=travel)
    packed = pack.pack_motion(moved, CONFIG, "generated")
    drawn = figure.of_skeleton(moved.skeleton, "b_root")
    error = np.abs(unpack(packed) - figure.points(drawn, moved)).max()
    assert error <= packed["step"] / 2 * (1 + 1e-9) + 1e-6 * (1 + travel)


def test_the_step_is_a_2000th_of_the_figure():
    packed = pack.pack_motion(synthetic.waving(2.0), CONFIG, "generated")
    assert packed["step"] == pytest.approx(packed["size"] / 2000, rel=1e-3)
    assert 140 < packed["size"] < 170


def test_a_motion_in_metres_is_packed_as_finely():
    config = load_config(None, ["positions.scale=100"])
    bones = synthetic.person()
    moved = synthetic.waving(1.0)
    metres = type(moved)(
        type(bones)(bones.names, bones.parents, bones.offsets / 100, bones.end_sites / 100, bones.channels, ""),
        moved.rotations, moved.positions / 100, 30.0,
    )  # fmt: skip
    one, other = (pack.pack_motion(m, c, "a") for m, c in ((moved, CONFIG), (metres, config)))
    np.testing.assert_allclose(unpack(one), unpack(other), atol=one["step"])


def test_still_and_single_frames():
    for frames in (1, 2, 50):
        still = random_motion(chain(3), 1).take(np.zeros(frames, dtype=int))
        packed = pack.pack_motion(still, CONFIG, "a")
        assert unpack(packed).shape == (frames, 3, 3) and np.ptp(unpack(packed), axis=0).max() == 0


def test_a_minute_of_sixty_joints_and_sound_is_under_one_and_a_half_megabytes():
    rng = np.random.default_rng(0)
    frames = 1800
    moved = tiny.motion(rng, frames, chain(60, offsets=np.tile([0.0, 3.0, 0.0], (60, 1))), travel=0.1)
    packed = pack.pack_motion(moved, CONFIG, "generated")
    audio = pack.pack_audio(bursts(np.arange(0, 60, 0.2), 60.0, rate=44100), 44100)
    assert len(pack.inert_json([packed, audio])) < 1_500_000


def test_the_same_motion_packs_to_the_same_text():
    one, other = (pack.pack_motion(synthetic.waving(1.0), CONFIG, "a") for _ in range(2))
    assert pack.inert_json(one) == pack.inert_json(other)


# --- the figure ---------------------------------------------------------------------------------------------


def test_helpers_and_what_lies_above_the_pelvis_are_not_drawn():
    bones = synthetic.person()
    drawn = figure.of_skeleton(bones, "b_root")
    names = [bones.names[j] for j in drawn.joints]
    assert "b_l_eye" not in names and "body_world" not in names and names[drawn.pelvis] == "b_root"
    assert names[drawn.head] == "b_head" and drawn.parents[drawn.pelvis] == -1
    assert [names[k] for k in drawn.tips] == ["b_l_foot", "b_r_foot"]
    assert len(drawn.parents) == len(drawn.sides) == len(drawn.thin) == len(names) + 2
    assert [name for name, thin in zip(names, drawn.thin, strict=False) if thin] == ["b_l_index1"]


def test_points_are_joints_and_end_sites():
    moved = synthetic.waving(0.1)
    drawn = figure.of_skeleton(moved.skeleton, "b_root")
    points = figure.points(drawn, moved)
    np.testing.assert_allclose(points[:, : len(drawn.joints)], kinematics.joint_positions(moved, drawn.joints))
    np.testing.assert_allclose(points[0, -2], [10, 1, 15], atol=1e-9)  # the legs hang straight down from 90 cm


def test_a_helper_that_carries_something_stays():
    bones = tiny.skeleton(("b_root", "p_navel", "b_spine"), (-1, 0, 1))
    assert figure.of_skeleton(bones, "b_root").joints == [0, 1, 2]


def test_a_chain_is_drawn_whole():
    drawn = figure.of_skeleton(chain(4), "b_root")
    assert drawn.joints == [0, 1, 2, 3] and drawn.parents == [-1, 0, 1, 2] and drawn.head == -1


@pytest.mark.parametrize(
    ("name", "side"),
    [("b_l_arm", "l"), ("b_r_arm", "r"), ("LeftArm", "l"), ("mixamorig:RightHand", "r"), ("hand.L", "l"),
     ("rShldr", "r"), ("b_root", "m"), ("b_spine0", "m"), ("Hips", "m"), ("L_Ankle", "l"), ("lowerback", "m")],
)  # fmt: skip
def test_sides_by_name(name, side):
    assert figure.side(name) == side


@pytest.mark.parametrize("degrees", [0, 30, 90, -120, 179])
def test_facing_is_the_heading(degrees):
    turn = np.radians(degrees)
    moved = synthetic.waving(0.5)
    drawn = figure.of_skeleton(moved.skeleton, "b_root")
    points = figure.points(drawn, moved)
    c, s = np.cos(turn), np.sin(turn)
    turned = points @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T  # about Y: +Z goes to (sin, 0, cos)
    assert figure.facing(drawn, turned) == pytest.approx(turn, abs=1e-9)


def test_size_and_floor_of_a_standing_person():
    moved = synthetic.waving(1.0)
    points = figure.points(figure.of_skeleton(moved.skeleton, "b_root"), moved)
    assert figure.floor(points) == pytest.approx(1.0)
    assert figure.size(np.zeros((3, 2, 3))) == 1.0


# --- sound --------------------------------------------------------------------------------------------------


def test_vorbis_has_every_sample_and_at_most_24_khz():
    for rate, expected in ((8000, 8000), (16000, 16000), (44100, 24000), (48000, 24000)):
        samples = bursts((0.3, 1.1), 2.0, rate)
        read, got = soundfile.read(io.BytesIO(sound.vorbis(samples, rate)))
        assert got == expected and len(read) == 2 * expected
        loud = np.abs(read)
        assert loud[: int(0.29 * got)].max() < 0.1 < loud[int(0.3 * got) : int(0.36 * got)].max()


def test_the_serial_number_is_fixed_and_checksums_are_right():
    data = sound.vorbis(bursts((0.1,), 1.0), 16000)
    # Whatever number libsndfile drew, the bytes are the same in the end.
    assert sound.with_serial(sound.with_serial(data, b"\x01\x02\x03\x04"), b"gest") == data
    start = 0
    while start < len(data):
        count = data[start + 26]
        end = start + 27 + count + sum(data[start + 27 : start + 27 + count])
        page = bytearray(data[start:end])
        stored = struct.unpack("<I", page[22:26])[0]
        page[22:26] = bytes(4)
        assert stored == slow_checksum(page) and page[14:18] == b"gest"
        start = end


def slow_checksum(page: bytes) -> int:
    """Bit by bit, as the Ogg specification has it."""
    register = 0
    for byte in page:
        register ^= byte << 24
        for _ in range(8):
            register = (register << 1) ^ (0x04C11DB7 if register & 0x80000000 else 0)
        register &= 0xFFFFFFFF
    return register


def test_peaks_are_the_loudest_sample_of_each_hundredth():
    samples = np.zeros(16000)
    samples[[0, 799, 8000]] = [0.5, -1.0, 0.25]
    peaks = sound.peaks(samples, 16000)
    assert len(peaks) == 100 and np.flatnonzero(peaks).tolist() == [0, 4, 50]
    assert peaks[[0, 4, 50]].tolist() == [128, 255, 64]
    assert sound.peaks(np.zeros(10), 16000).tolist() == [0]


# --- text ---------------------------------------------------------------------------------------------------


@SMALL
@given(st.text(max_size=30))
def test_json_survives_and_is_inert(text):
    packed = pack.inert_json({"text": text + "</script><!--<script>&\u2028é"})
    assert json.loads(packed)["text"].startswith(text)
    assert packed.isascii() and not set("<>&") & set(packed)


def test_a_trace_names_pieces_joins_and_source_frames():
    trace = synthetic.trace(100)
    told = pack.pack_trace(trace, np.arange(1000, 1200))
    assert told["source"][:3] == [1000, 1001, 1002] and told["source"][30] == 1037 and len(told["source"]) == 100
    assert told["pieces"][2] == [60, 90, "keyword", "greeting", "keyword"]
    assert told["joins"][0] == [30, 7.0, False] and told["references"] == ["first", "second"]
    assert [told["references"][k] for k in told["reference"]][89:91] == ["second", "second"]
    assert told["reference"] == [int(frame >= 1100) for frame in told["source"]]


def test_a_trace_of_another_graph_is_refused():
    with refused(DataError, "of another graph"):
        pack.pack_trace(synthetic.trace(100), np.arange(50))


def test_words_carry_their_keyword():
    packed = json.loads(synthetic.clip_text(seconds=3.0))
    assert [word[0::3] for word in packed["words"]] == [["hello", "greeting"], ["word1", None], ["word2", None]]

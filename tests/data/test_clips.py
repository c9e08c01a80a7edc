import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gesturegen import files
from gesturegen.data import clips, keynodes, recordings, stored_clips
from gesturegen.data.clips import Recording, Speech
from gesturegen.errors import ConfigError, DataError
from gesturegen.motion import bvh, rotation
from gesturegen.motion.skeleton import Motion
from gesturegen.runs import runs
from gesturegen.settings.loading import load_config
from gesturegen.settings.models import Paths, References
from gesturegen.speech.transcript import Word
from gesturegen.stored import arrays as stored_arrays
from tests.builders import (
    chain,
    data_folder,
    literally,
    make_skeleton,
    random_motion,
    refused,
    settings_for,
    write_audio,
    write_clip,
)


def names(recordings):
    return [recording.name for recording in recordings]


def metadata(folder, text):
    (folder / "metadata.csv").write_text(text)


def files_side_by_side(folder, *found):
    folder.mkdir(parents=True, exist_ok=True)
    for name in found:
        (folder / name).write_bytes(b"x")


# --- finding recordings -------------------------------------------------------------------------------------


def test_genea_layout(tmp_path):
    for name in ("trn_1_main-agent", "trn_0_main-agent"):
        write_clip(tmp_path / "trn", name)
    write_clip(tmp_path / "trn", "trn_2_main-agent", words=None, with_motion=False)
    (tmp_path / "trn" / "interloctr" / "wav").mkdir(parents=True)
    (tmp_path / "trn" / "interloctr" / "wav" / "trn_0_interloctr.wav").write_bytes(b"x")
    found = recordings.list_recordings(tmp_path / "trn")
    agent = tmp_path / "trn" / "main-agent"
    assert found[0] == Recording(
        "trn_0_main-agent",
        agent / "bvh" / "trn_0_main-agent.bvh",
        agent / "wav" / "trn_0_main-agent.wav",
        agent / "tsv" / "trn_0_main-agent.tsv",
    )
    assert names(found) == ["trn_0_main-agent", "trn_1_main-agent", "trn_2_main-agent"]
    assert (found[2].motion_path, found[2].transcript_path) == (None, None)


def test_files_side_by_side_with_any_case(tmp_path):
    files_side_by_side(tmp_path, "b.BVH", "b.WAV", "a.bvh", "a.flac", "a.TSV", "c.Ogg", ".hidden.wav", "notes.txt")
    found = recordings.list_recordings(tmp_path)
    assert found == [
        Recording("a", tmp_path / "a.bvh", tmp_path / "a.flac", tmp_path / "a.TSV"),
        Recording("b", tmp_path / "b.BVH", tmp_path / "b.WAV", None),
        Recording("c", None, tmp_path / "c.Ogg", None),
    ]


def test_bvh_and_wav_folders_without_main_agent(tmp_path):
    files_side_by_side(tmp_path / "bvh", "a.bvh")
    files_side_by_side(tmp_path / "wav", "a.wav")
    assert recordings.list_recordings(tmp_path) == [
        Recording("a", tmp_path / "bvh" / "a.bvh", tmp_path / "wav" / "a.wav", None)
    ]


def test_two_audio_files_of_one_clip_are_refused(tmp_path):
    files_side_by_side(tmp_path, "a.flac", "a.wav")
    files_side_by_side(tmp_path, "b.wav")
    first, other = recordings.list_recordings(tmp_path)
    assert other.problem is None
    with refused(DataError, r"clip a has a second file a\.flac; keep one", tmp_path / "a.wav"):
        clips.prepare(first, settings_for(tmp_path), with_motion=False)


@pytest.mark.parametrize("fingers", ("fingers_incl", "finger_incl", "fingers_excl", "finger_excl", ""))
def test_speakers_come_from_metadata_whatever_it_says_of_fingers(tmp_path, fingers):
    files_side_by_side(tmp_path / "main-agent" / "wav", "trn_0_main-agent.wav", "trn_1_main-agent.wav", "x.wav")
    metadata(
        tmp_path,
        "prefix,main-agent_id,main-agent_has_fingers,interloctr_id,interloctr_has_fingers\n"
        f"trn_0,17,{fingers},3,{fingers}\nx, 4,{fingers},3,{fingers}\n",
    )
    found = {recording.name: recording.speaker for recording in recordings.list_recordings(tmp_path)}
    assert found == {"trn_0_main-agent": "17", "trn_1_main-agent": None, "x": "4"}


def test_metadata_with_a_byte_order_mark_and_crlf(tmp_path):
    files_side_by_side(tmp_path, "a.wav")
    (tmp_path / "metadata.csv").write_bytes(b"\xef\xbb\xbfprefix,main-agent_id\r\na,5\r\n\r\nb,\r\n")
    assert recordings.list_recordings(tmp_path)[0].speaker == "5"


def test_metadata_without_its_columns_is_refused(tmp_path):
    files_side_by_side(tmp_path, "a.wav")
    metadata(tmp_path, "name,speaker\na,5\n")
    with refused(
        DataError, literally(tmp_path / "metadata.csv", 1) + "column 'prefix' is missing; found .*name,speaker"
    ):
        recordings.list_recordings(tmp_path)


@pytest.mark.parametrize(
    ("rows", "line", "match"),
    [
        ('a,"5\nb,6\n', 3, "not valid CSV .*check the quotes"),
        ("a,5\nb,6\na ,7\n", 4, "'a' stands twice, first in line 2; keep one of the lines"),
        ("a,5\na,5\n", 3, "'a' stands twice, first in line 2"),
        ("a,5\n=======\nb,5\n", 3, "merge conflict marker"),
        ("a\n", 2, "found 1 cells, expected 2"),
        ("a,\x85\n", 2, "not a text file in UTF-8"),
        ("ä,\x07\n", 2, "a cell holds .*control character"),
    ],
)
def test_metadata_that_loses_rows_is_refused(tmp_path, rows, line, match):
    encoding = "latin-1" if "\x85" in rows else "utf-8"
    (tmp_path / "metadata.csv").write_bytes(("prefix,main-agent_id\n" + rows).encode(encoding))
    with refused(DataError, literally(tmp_path / "metadata.csv", line) + match):
        recordings.list_recordings(tmp_path)


def test_spaces_around_speakers_make_no_others(tmp_path):
    files_side_by_side(tmp_path, "a.wav", "b.wav")
    metadata(tmp_path, "prefix,main-agent_id\na,1 \n b,1\n")
    assert {recording.speaker for recording in recordings.list_recordings(tmp_path)} == {"1"}


def test_metadata_that_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "metadata.csv")
    with refused(DataError, "it is a pipe, not a file", tmp_path / "metadata.csv"):
        recordings.list_recordings(tmp_path)


@pytest.mark.parametrize(
    ("name", "shown", "what"),
    [
        (b"a\nb.wav", r"a\nb", r"U\+000A"),
        (b"\xff.wav", r"\udcff", "bytes that are not UTF-8"),
        ("a\u2028b.wav".encode(), r"a\u2028b", r"U\+2028"),
    ],
)
def test_names_that_no_line_can_hold_are_refused_and_harm_no_other(tmp_path, name, shown, what):
    files_side_by_side(tmp_path, "b.wav")
    (Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + name))).write_bytes(b"")
    found = {recording.name: recording.problem for recording in recordings.list_recordings(tmp_path)}
    assert found.pop("b") is None and list(found) == [shown]
    assert re.search(f"the name of the file holds {what}; rename it$", found[shown]) and found[shown].isprintable()


def test_an_empty_metadata_file_is_refused(tmp_path):
    files_side_by_side(tmp_path, "a.wav")
    metadata(tmp_path, "")
    with refused(DataError, "expected a header line with the columns prefix, main-agent_id", tmp_path / "metadata.csv"):
        recordings.list_recordings(tmp_path)


# --- what may be a reference, what is a test ----------------------------------------------------------------


@pytest.fixture
def three(tmp_path):
    files_side_by_side(tmp_path / "trn" / "main-agent" / "bvh", *[f"trn_{n}_main-agent.bvh" for n in range(3)])
    return tmp_path


@pytest.mark.parametrize(
    ("blacklist", "left"),
    [
        ("[]", [0, 1, 2]),
        ("[trn_1]", [0, 2]),
        ("[trn_1_main-agent]", [0, 2]),
        ("['trn_[12]']", [0]),
        ("['*_0_*', trn_2]", [1]),
        ("[trn]", [0, 1, 2]),
        ("[TRN_1]", [0, 1, 2]),
        ("[trn_1_main]", [0, 1, 2]),
    ],
)
def test_blacklist_names_and_globs(three, blacklist, left):
    config = settings_for(three, f"blacklist={blacklist}")
    listed = [f"trn_{n}_main-agent" for n in range(3) if n not in left]
    assert names(recordings.reference_recordings(config)) == [f"trn_{n}_main-agent" for n in left]
    assert names(recordings.blacklisted_recordings(config)) == listed


def test_no_reference_left_is_refused(three):
    with refused(DataError, "no reference is left of 3 after the blacklist; shorten `blacklist`", three / "trn"):
        recordings.reference_recordings(settings_for(three, "blacklist=['*']"))


def test_sound_without_motion_is_no_reference(tmp_path):
    files_side_by_side(tmp_path / "trn", "a.wav", "b.bvh", "b.wav")
    assert names(recordings.reference_recordings(settings_for(tmp_path))) == ["b"]


def test_a_test_clip_needs_no_motion_but_motion_alone_is_none(tmp_path):
    files_side_by_side(tmp_path / "tst", "a.wav", "b.tsv", "c.bvh")
    assert names(recordings.test_recordings(settings_for(tmp_path))) == ["a", "b"]


@pytest.mark.parametrize("split", ("trn", "tst"))
def test_an_empty_folder_is_refused(tmp_path, split):
    (tmp_path / split).mkdir()
    find, what = {
        "trn": (recordings.reference_recordings, "no BVH file"),
        "tst": (recordings.test_recordings, "no audio file"),
    }[split]
    with refused(DataError, what + " in it; expected GENEA's main-agent/", tmp_path / split):
        find(settings_for(tmp_path))


@pytest.mark.parametrize("split", ("trn", "tst"))
def test_a_missing_folder_is_refused_with_the_key(tmp_path, split):
    find, what = {"trn": (recordings.reference_recordings, "reference"), "tst": (recordings.test_recordings, "test")}[
        split
    ]
    with refused(
        DataError, f"no such folder of {what} clips; check paths.data and data.{what}_split", tmp_path / split
    ):
        find(settings_for(tmp_path))
    with refused(DataError, f"no such folder of {what} clips; check data.{what}s", tmp_path / "none"):
        find(settings_for(tmp_path, f"data.{what}s={tmp_path / 'none'}"))


def test_any_other_folders(tmp_path):
    files_side_by_side(tmp_path / "r", "a.bvh", "a.wav")
    files_side_by_side(tmp_path / "t", "b.ogg")
    config = settings_for(tmp_path, f"data.references={tmp_path / 'r'}", f"data.tests={tmp_path / 't'}")
    assert names(recordings.reference_recordings(config)) == ["a"]
    assert names(recordings.test_recordings(config)) == ["b"]


# --- from recording to clip ---------------------------------------------------------------------------------


@pytest.fixture
def prepare(tmp_path):
    """Writes one clip of the given options and prepares it with the given overrides."""

    def prepare(*overrides, with_motion=True, **options):
        write_clip(tmp_path / "trn", "a_main-agent", with_motion=with_motion, **options)
        config = settings_for(tmp_path, *overrides)
        (recording,) = recordings.list_recordings(tmp_path / "trn")
        return clips.prepare(recording, config, with_motion), config

    return prepare


def test_a_reference_has_motion_words_and_onsets(prepare):
    clip, config = prepare(seconds=2.0, onsets=(0.5, 1.2))
    assert clip.notes == () and clip.duration == 2.0
    reference = clip.reference(config)
    assert reference.name == "a_main-agent"
    assert reference.motion.n_frames == reference.speech.n_frames == 60
    assert reference.speech.words == (Word("hello", 0.5, 0.8), Word("there", 1.2, 1.5))
    np.testing.assert_allclose(reference.speech.onset_times, [0.5, 1.2], atol=0.1)
    assert reference.source_frames.tolist() == list(range(60))
    assert reference.segment_starts.tolist() == [0]


@pytest.mark.parametrize(("seconds", "frames"), [(1.0, 30), (1.016, 30), (1.018, 31), (0.017, 1), (2.2, 66)])
def test_a_test_speech_lasts_as_long_as_its_sound(prepare, seconds, frames):
    clip, config = prepare(seconds=seconds, words=None, with_motion=False)
    assert clip.motion is None
    assert clip.test_speech(config).n_frames == frames


def test_a_test_clip_is_no_reference(prepare):
    clip, config = prepare(with_motion=False)
    with refused(DataError, "clip a_main-agent has no motion, so it cannot be a reference"):
        clip.reference(config)


def test_less_than_a_frame_of_sound_is_refused(prepare, tmp_path):
    with refused(DataError, r"0\.010 s is less than one frame", tmp_path / "trn" / "main-agent" / "wav"):
        prepare(seconds=0.01, onsets=(), words=None, with_motion=False)


def test_a_reference_of_one_frame_works(prepare):
    clip, config = prepare(seconds=0.04, onsets=(), words=None, motion=random_motion(chain(3), 1))
    reference = clip.reference(config)
    assert reference.motion.n_frames == 1 and reference.segment_starts.tolist() == [0]


def test_a_missing_wav_is_refused_with_the_clips_name(tmp_path):
    write_clip(tmp_path / "trn", "a_main-agent")
    (tmp_path / "trn" / "main-agent" / "wav" / "a_main-agent.wav").unlink()
    (recording,) = recordings.reference_recordings(settings_for(tmp_path))
    with refused(DataError, r"clip a_main-agent: no audio file beside it; add a_main-agent\.wav"):
        clips.prepare(recording, settings_for(tmp_path), True)


def test_no_transcript_means_no_words(prepare):
    clip, _ = prepare(words=None)
    assert clip.words == () and clip.notes == ()


def test_notes_of_the_transcript_are_kept(prepare):
    clip, _ = prepare(words=[(0.1, 0.2, "a"), (5.0, 6.0, "b")])
    assert clip.notes == ("a_main-agent.tsv: words outside the audio, dropped: 1",)


def test_words_without_onsets_are_noted_with_the_key(prepare):
    clip, config = prepare("onsets.min_strength=500")
    assert len(clip.reference(config).speech.onset_times) == 0
    (note,) = clip.all_notes(config)
    found = re.search(
        r"2 words but no onset in \d\.\d s of speech: the strongest peak is \d+\.\d, onsets\.min_strength is 500; "
        r"for the usual 2 a second set onsets\.min_strength=([0-9.]+), or onsets\.per_second=2",
        note,
    )
    cured, config = prepare(f"onsets.min_strength={found[1]}")
    assert cured.onset_rate(config) >= 0.5 and not cured.all_notes(config)


def test_silence_with_words_is_noted_and_works(prepare, tmp_path):
    write_clip(tmp_path / "trn", "a_main-agent")
    write_audio(tmp_path / "trn" / "main-agent" / "wav" / "a_main-agent.wav", np.zeros(32000))
    (recording,) = recordings.list_recordings(tmp_path / "trn")
    clip = clips.prepare(recording, settings_for(tmp_path), True)
    assert len(clip.onset_peaks.times) == 0
    assert "is it the right audio?" in clip.all_notes(settings_for(tmp_path))[0]


def test_silence_without_words_is_noted(prepare):
    clip, config = prepare(onsets=(), words=None)
    (note,) = clip.all_notes(config)
    assert note == "no words, and no voice is heard, so all of it without an onset is a pause"


@pytest.mark.parametrize("words", (None, ()))
def test_unbroken_speech_without_words_is_no_pause(prepare, tmp_path, words):
    """Slow speech has fewer onsets than one in half a second; an empty transcript says as little as none."""
    prepare(seconds=12.0, words=words)
    times = np.arange(16000 * 12) / 16000
    ringing = np.sin(2 * np.pi * 120 * times) * np.exp(-4 * (times % 0.8)) * (times < 9)
    write_audio(tmp_path / "trn" / "main-agent" / "wav" / "a_main-agent.wav", 0.3 * ringing)
    (recording,) = recordings.list_recordings(tmp_path / "trn")
    config = settings_for(tmp_path)
    clip = clips.prepare(recording, config, True)
    (pause,) = runs(~keynodes.speaking(clip.test_speech(config), config.pauses))
    assert pause[0] == pytest.approx(270, abs=12) and pause[1] == 360
    assert any("no words, so the sound tells when there is speech" in note for note in clip.all_notes(config))


def test_another_frame_rate_is_resampled_and_noted(prepare):
    motion = random_motion(chain(3), 241, fps=120.0)
    clip, config = prepare(motion=motion)
    assert clip.notes == ("a_main-agent.bvh: 120 fps, resampled to 30",)
    reference = clip.reference(config)
    assert (reference.motion.n_frames, reference.motion.fps) == (61, 30)
    np.testing.assert_allclose(reference.motion.positions, motion.positions[::4], atol=1e-6)


@pytest.mark.parametrize(("frames", "noted"), [(31, False), (60, False), (89, False), (29, True), (91, True)])
def test_motion_and_sound_may_differ_by_a_second(prepare, frames, noted):
    clip, _ = prepare(seconds=2.0, motion=random_motion(chain(3), frames))
    assert [note.startswith(f"the motion lasts {frames / 30:.1f} s, its audio 2.0 s") for note in clip.notes] == [
        True
    ] * noted


def test_excluded_frames_are_dropped_and_start_a_segment(prepare):
    motion = random_motion(chain(3), 60)
    clip, config = prepare("exclude=[{clip: a, from: 0.5, to: 1.0}]", motion=motion)
    reference = clip.reference(config)
    assert reference.source_frames.tolist() == [*range(15), *range(30, 60)]
    assert reference.segment_starts.tolist() == [0, 15]
    np.testing.assert_allclose(reference.motion.positions, motion.positions[reference.source_frames], atol=1e-6)
    # The speech keeps its own clock.
    assert reference.speech.n_frames == 60
    assert clip.notes == ()


def test_ranges_at_the_ends_and_several_ranges(prepare):
    clip, _ = prepare(
        "exclude=[{clip: a_main-agent, from: 0, to: 0.1}, {clip: 'a*', from: 1.9, to: 9}, {clip: a, from: 1, to: 1.1}]"
    )
    assert clip.source_frames.tolist() == [*range(3, 30), *range(33, 57)]
    assert clip.segment_starts.tolist() == [0, 27]


def test_ranges_of_other_clips_do_not_matter(prepare):
    clip, _ = prepare("exclude=[{clip: b, from: 0, to: 9}]")
    assert len(clip.source_frames) == 60


def test_a_range_past_the_end_is_noted(prepare):
    clip, _ = prepare("exclude=[{clip: a, from: 2, to: 3}]")
    assert len(clip.source_frames) == 60
    assert clip.notes == ("exclude from 2 s lies past the end at 2.0 s and excludes nothing",)


def test_a_clip_that_is_wholly_excluded_is_refused(prepare):
    with refused(DataError, "clip a_main-agent: `exclude` leaves no frame of it; shorten the ranges"):
        prepare("exclude=[{clip: a, from: 0, to: 1}, {clip: a, from: 1, to: 2}]")


def still(frames):
    skeleton = chain(3)
    rotations = np.tile(rotation.IDENTITY, (frames, 3, 1))
    return skeleton, rotations, np.tile(skeleton.offsets, (frames, 1, 1))


def test_tracking_jumps_start_segments(prepare):
    skeleton, rotations, positions = still(60)
    positions[20:, 0, 0] += 30.0
    motion = Motion(skeleton, rotations, positions, 30.0)
    assert prepare(motion=motion)[0].segment_starts.tolist() == [0]
    assert prepare("breaks.max_joint_speed=500", motion=motion)[0].segment_starts.tolist() == [0, 20]
    assert prepare("breaks.max_joint_speed=901", motion=motion)[0].segment_starts.tolist() == [0]


def test_a_jump_across_an_excluded_range_is_one_segment_start(prepare):
    skeleton, rotations, positions = still(60)
    positions[20:, 0, 0] += 30.0
    clip, _ = prepare(
        "breaks.max_joint_speed=500",
        "exclude=[{clip: a, from: 0.5, to: 1}]",
        motion=Motion(skeleton, rotations, positions, 30.0),
    )
    assert clip.segment_starts.tolist() == [0, 15]


def test_jumps_of_joints_that_are_not_selected_do_not_count(prepare):
    skeleton, rotations, positions = still(60)
    rotations[20:, 1] = rotation.about_y(np.pi)  # moves j2 alone
    motion = Motion(skeleton, rotations, positions, 30.0)
    assert prepare("breaks.max_joint_speed=300", motion=motion)[0].segment_starts.tolist() == [0, 20]
    clip, _ = prepare("breaks.max_joint_speed=300", "joints=[j0, j1]", motion=motion)
    assert clip.segment_starts.tolist() == [0]


def test_wrists_are_cleaned_inside_segments_only(prepare):
    skeleton = make_skeleton(["root", "hand"], [-1, 0])
    motion = random_motion(skeleton, 60)
    clip, _ = prepare("wrists={joints: [hand]}", "exclude=[{clip: a, from: 0.4, to: 0.6}]", motion=motion)
    assert clip.notes == ("1 segment(s) shorter than 15 frames: their wrists are locked but not filtered",)
    locked = rotation.to_euler("XYZ", clip.motion.rotations[:, 1])[:, 1]
    np.testing.assert_allclose(locked, locked[0], atol=1e-9)
    np.testing.assert_allclose(
        rotation.to_matrix(clip.motion.rotations[:, 0]),
        rotation.to_matrix(motion.rotations[clip.source_frames, 0]),
        atol=1e-6,
    )


def test_a_broken_motion_is_refused_by_name(tmp_path):
    write_clip(tmp_path / "trn", "a")
    path = tmp_path / "trn" / "main-agent" / "bvh" / "a.bvh"
    path.write_text(path.read_text()[:-30])
    (recording,) = recordings.list_recordings(tmp_path / "trn")
    with refused(DataError, "the file is cut off", path):
        clips.prepare(recording, settings_for(tmp_path), True)


# --- joints -------------------------------------------------------------------------------------------------


def test_configured_joints_keep_their_order(tmp_path):
    assert clips.select_joints(chain(4), settings_for(tmp_path, "joints=[j3, j1]")) == ([3, 1], [])
    assert clips.select_joints(chain(4), settings_for(tmp_path)) == ([0, 1, 2, 3], [])


def test_a_skeleton_of_another_kind_gives_all_its_joints(tmp_path):
    joints, (note,) = clips.select_joints(chain(4), settings_for(tmp_path, "joints=[b_root, b_head]"))
    assert joints == [0, 1, 2, 3]
    assert note == "the skeleton has none of the configured joints, so all its 4 are used (joints)"


def test_a_skeleton_with_some_of_the_joints_is_refused(tmp_path):
    with refused(DataError, "no joint 'j7', nearest is 'j"):
        clips.select_joints(chain(4), settings_for(tmp_path, "joints=[j0, j7]"))


# --- speeches -----------------------------------------------------------------------------------------------


def test_onset_frames_are_rounded_unique_and_inside():
    speech = Speech("a", np.array([-0.1, 0.0, 0.051, 0.06, 0.99, 1.0, 7.0]), (), 30, 30.0)
    assert speech.onset_frames.tolist() == [0, 2]
    assert Speech("a", np.array([0.95, 0.98, 0.9839]), (), 30, 30.0).onset_frames.tolist() == [28, 29]


def test_the_threshold_is_applied_when_a_clip_is_used(prepare, tmp_path):
    clip, config = prepare(words=None)
    path = tmp_path / "a.npz"
    clips.save(path, clip, config)
    strict = settings_for(tmp_path, "onsets.min_strength=500")
    assert len(clips.load(path, strict).test_speech(strict).onset_times) == 0
    assert len(clips.load(path, config).test_speech(config).onset_times) == 2


# --- storing ------------------------------------------------------------------------------------------------


def travelling(frames=20):
    """Every channel form; the root and one more joint travel."""
    skeleton = make_skeleton(["root", "a:1", "b c"], [-1, 0, 1], end_sites=[[np.nan] * 3, [np.nan] * 3, [0, 1, 2]])
    motion = random_motion(skeleton, frames)
    positions = motion.positions.copy()
    positions[:, 2] += np.random.default_rng(8).normal(size=(frames, 3))
    return Motion(skeleton, motion.rotations, positions, 30.0)


def test_a_stored_clip_comes_back(tmp_path):
    write_clip(tmp_path / "trn", "a", words=[(0.5, 0.8, "größer"), (1.2, 1.5, "one two"), (3, 4, "late")])
    config = settings_for(tmp_path, "exclude=[{clip: a, from: 0.5, to: 1.0}]")
    metadata(tmp_path / "trn", "prefix,main-agent_id\na,17\n")
    (recording,) = recordings.list_recordings(tmp_path / "trn")
    clip = clips.prepare(recording, config, True)
    clips.save(tmp_path / "a.npz", clip, config)
    found = clips.load(tmp_path / "a.npz", config)
    assert (found.name, found.speaker, found.duration) == ("a", "17", 2.0)
    assert found.words == clip.words and len(found.words) == 3
    assert found.notes == clip.notes and len(found.notes) == 1
    assert found.n_recorded == 60
    for name in ("times", "strengths", "near_mute"):
        np.testing.assert_array_equal(getattr(found.onset_peaks, name), getattr(clip.onset_peaks, name))
    np.testing.assert_array_equal(found.source_frames, clip.source_frames)
    np.testing.assert_array_equal(found.segment_starts, clip.segment_starts)
    assert found.segment_starts.tolist() == [0, 15]


def test_stored_motion_comes_back_to_1e_9(tmp_path, prepare):
    clip, config = prepare()
    motion = travelling()
    clip = clips.Clip("a", None, 1.0, clip.onset_peaks, (), motion, np.arange(20), np.array([0]), 20)
    clips.save(tmp_path / "a.npz", clip, config)
    found = clips.load(tmp_path / "a.npz", config)
    assert found.speaker is None and found.words == () and found.notes == ()
    np.testing.assert_allclose(
        rotation.to_matrix(found.motion.rotations), rotation.to_matrix(motion.rotations), atol=1e-9
    )
    np.testing.assert_array_equal(found.motion.positions, motion.positions)
    assert found.motion.fps == 30.0
    assert found.motion.skeleton.difference(motion.skeleton) is None
    assert found.motion.skeleton.hierarchy == motion.skeleton.hierarchy
    np.testing.assert_array_equal(found.motion.skeleton.end_sites, motion.skeleton.end_sites)


def test_without_motion_only_the_speech_is_loaded(tmp_path, prepare):
    clip, config = prepare()
    clips.save(tmp_path / "a.npz", clip, config)
    found = clips.load(tmp_path / "a.npz", config, with_motion=False)
    assert found.motion is None and found.words == clip.words


def test_a_stored_test_clip_comes_back(tmp_path, prepare):
    clip, config = prepare(with_motion=False)
    clips.save(tmp_path / "a.npz", clip, config)
    found = clips.load(tmp_path / "a.npz", config)
    assert found.motion is None
    assert found.test_speech(config).n_frames == 60


def test_storing_twice_gives_the_same_bytes(tmp_path, prepare):
    for name in ("a.npz", "b.npz"):
        clip, config = prepare()
        clips.save(tmp_path / name, clip, config)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_stored_joint_positions_are_those_of_the_selected_joints(tmp_path, prepare):
    skeleton, rotations, positions = still(4)
    clip, _ = prepare(motion=Motion(skeleton, rotations, positions, 30.0))
    config = settings_for(tmp_path, "joints=[j2, j0]")
    clips.save(tmp_path / "a.npz", clip, config)
    stored = files.read_arrays(tmp_path / "a.npz")
    assert stored["joint_names"].tolist() == ["j2", "j0"]
    np.testing.assert_array_equal(stored["joint_positions"][0], [[30, 0, 0], [10, 0, 0]])


@pytest.mark.parametrize(
    ("override", "match"),
    [
        ("fps=25", "made with fps = 30, the config says 25"),
        ("joints=[j0]", r'made with joints = "all", the config says \["j0"\]'),
        ("onsets.hop_length=256", r"made with onsets\.hop_length = 512, the config says 256"),
        ("onsets.sample_rate=16000", r"made with onsets\.sample_rate = 22050, the config says 16000"),
        ("onsets.muted_min_seconds=0.2", r"made with onsets\.muted_min_seconds = 0\.1, the config says 0\.2"),
        ("breaks.max_joint_speed=9", r"made with breaks.*null.*, the config says .*9\.0"),
        ("exclude=[{clip: a, from: 0, to: 1}]", "made with exclude = "),
        ("positions.root_joint=j1", r'made with positions\.root_joint = "b_root", the config says "j1"'),
        ("wrists.enabled=true", "made with wrists.*false.*, the config says .*true"),
        ("wrists.window=9", r"wrists\.window = 15, the config says 9"),
        ("wrists.axes=ZYX", r"wrists.axes.*XYZ.*, the config says .*ZYX"),
    ],
)
def test_clips_made_with_other_settings_are_refused(tmp_path, prepare, override, match):
    clip, config = prepare()
    clips.save(tmp_path / "a.npz", clip, config)
    with refused(DataError, match + ".*; run `gesturegen preprocess` again", tmp_path / "a.npz"):
        clips.load(tmp_path / "a.npz", settings_for(tmp_path, override))


@pytest.mark.parametrize("override", ("seed=3", "continuity.l_pn=1", "onsets.muted_max_share=0.5", "paths.work=x"))
def test_settings_that_do_not_matter_may_change(tmp_path, prepare, override):
    clip, config = prepare()
    clips.save(tmp_path / "a.npz", clip, config)
    assert clips.load(tmp_path / "a.npz", settings_for(tmp_path, override)).name == "a_main-agent"


def test_a_clip_that_was_not_preprocessed_is_refused(tmp_path):
    with refused(DataError, "clip a has not been preprocessed; run `gesturegen preprocess`", tmp_path / "a.npz"):
        clips.load(tmp_path / "a.npz", settings_for(tmp_path))


def test_a_cut_clip_file_is_refused(tmp_path, prepare):
    clip, config = prepare()
    clips.save(tmp_path / "a.npz", clip, config)
    whole = (tmp_path / "a.npz").read_bytes()
    (tmp_path / "a.npz").write_bytes(whole[:-200])
    with refused(DataError, "damaged", tmp_path / "a.npz"):
        clips.load(tmp_path / "a.npz", config)


def changed(path, **arrays):
    stored_arrays.write(path, {k: v for k, v in (files.read_arrays(path) | arrays).items() if v is not None})


@pytest.mark.parametrize(
    ("arrays", "match"),
    [
        ({"word_times": None}, "no array 'word_times' in it"),
        (dict.fromkeys(clips._MOTION), None),
        ({"expmaps": None, "hierarchy": None, "fps": None}, "no array 'fps' in it"),
        ({"hierarchy": None}, "no array 'hierarchy' in it"),
        ({"settings": None}, "no array 'settings' in it"),
        ({"format_version": np.array(99)}, "format 99, this version reads 3; run `gesturegen preprocess` again"),
        ({"skeleton_offsets": np.zeros((1, 3))}, "skeleton_offsets has shape"),
        ({"expmaps": np.zeros((60, 1, 3))}, "run `gesturegen preprocess` again"),
        ({"settings": np.array("{")}, "its settings are not JSON"),
    ],
    ids=[
        "no words",
        "no motion",
        "half a motion",
        "no hierarchy",
        "no settings",
        "later format",
        "offsets",
        "expmaps",
        "settings",
    ],
)
def test_a_clip_file_with_other_arrays_is_refused(tmp_path, prepare, arrays, match):
    clip, config = prepare()
    clips.save(tmp_path / "a.npz", clip, config)
    changed(tmp_path / "a.npz", **arrays)
    if match is None:
        assert clips.load(tmp_path / "a.npz", config).motion is None
        return
    with refused(DataError, match, tmp_path / "a.npz"):
        clips.load(tmp_path / "a.npz", config)


# --- which references ---------------------------------------------------------------------------------------

REFERENCES = {f"trn_{n}_main-agent": speaker for n, speaker in enumerate(("1", "1", "2", None))}
TESTS = [f"tst_{n}_main-agent" for n in range(11)]
NOBODY = dict.fromkeys(TESTS)


def choose(tmp_path, *overrides, tests=TESTS, references=REFERENCES, speakers=NOBODY):
    return recordings.choose_references(tests, references, speakers, settings_for(tmp_path, *overrides))


def test_one_reference_each_without_repeats_until_the_clips_run_out(tmp_path):
    for seed in range(5):
        chosen = choose(tmp_path, f"seed={seed}")
        assert list(chosen) == sorted(TESTS)
        assert all(len(hand) == 1 for hand in chosen.values())
        drawn = [hand[0] for hand in chosen.values()]
        for start in (0, 4):
            assert sorted(drawn[start : start + 4]) == sorted(REFERENCES)
        assert len(set(drawn[8:])) == 3


def test_the_draw_depends_on_the_seed_and_on_names_alone(tmp_path):
    first = choose(tmp_path, "seed=1")
    assert first == choose(tmp_path, "seed=1")
    shuffled = dict(reversed(REFERENCES.items()))
    assert first == choose(tmp_path, "seed=1", tests=TESTS[::-1], references=shuffled)
    assert len({str(choose(tmp_path, f"seed={seed}")) for seed in range(6)}) > 1


SECONDS = dict.fromkeys(REFERENCES, 10.0)


def choose_within(tmp_path, seconds, *overrides, **options):
    """The choice for one test or more, with references of ten seconds each."""
    options = {"tests": TESTS[:1], "speakers": {TESTS[0]: "1"}, "references": REFERENCES} | options
    config = settings_for(tmp_path, *overrides, f"references.seconds={seconds}")
    return recordings.choose_references(options["tests"], options["references"], options["speakers"], config, SECONDS)


@pytest.mark.parametrize(("seconds", "count"), [(0.001, 1), (5, 1), (10, 1), (10.01, 1), (10.1, 2), (25, 3), (99, 4)])
def test_references_are_taken_until_they_last_as_long(tmp_path, seconds, count):
    (hand,) = choose_within(tmp_path, seconds, "references.mode=all").values()
    assert hand == tuple(sorted(REFERENCES))[:count], "to half a frame"


def test_every_mode_takes_references_in_its_own_order(tmp_path):
    (hand,) = choose_within(tmp_path, 12, "references.mode=speaker").values()
    assert hand == ("trn_0_main-agent", "trn_1_main-agent")
    (tmp_path / "pins.yaml").write_text(f"{TESTS[0]}: [trn_2, trn_0, trn_1]\n")
    (hand,) = choose_within(tmp_path, 12, f"references={{mode: list, list: {tmp_path / 'pins.yaml'}}}").values()
    assert hand == ("trn_2_main-agent", "trn_0_main-agent")
    for seed in range(5):
        drawn = choose_within(tmp_path, 40, "references={mode: k, k: 3}", f"seed={seed}", tests=TESTS)
        fewer = choose_within(tmp_path, 20, "references={mode: k, k: 3}", f"seed={seed}", tests=TESTS)
        whole = choose(tmp_path, "references={mode: k, k: 3}", f"seed={seed}")
        for test in TESTS:
            assert fewer[test] == drawn[test][:2] and tuple(sorted(drawn[test])) == whole[test]
    assert choose_within(tmp_path, 3) == choose(tmp_path, tests=TESTS[:1])


def test_no_more_frames_are_loaded_than_the_references_may_last(tmp_path, prepare):
    clip, config = prepare()
    work = tmp_path / "work"
    for name in ("a", "b"):
        clips.save(work / f"clips/{name}.npz", replace(clip, name=name), config)

    def lengths(seconds) -> list[int]:
        cut = config.model_copy(
            update={"paths": Paths(work=str(work)), "references": References(mode="all", seconds=seconds)}
        )
        loaded = stored_clips.load_references(cut, ("a", "b"))
        for reference in loaded:
            frames = reference.motion.n_frames
            assert len(reference.source_frames) == frames and reference.segment_starts.max() < frames
            np.testing.assert_array_equal(reference.motion.positions, clip.motion.positions[:frames])
            np.testing.assert_array_equal(reference.source_frames, clip.source_frames[:frames])
        return [reference.motion.n_frames for reference in loaded]

    frames = clip.motion.n_frames
    assert lengths(None) == lengths(1000.0) == [frames, frames]
    assert lengths((frames + 7) / config.fps) == [frames, 7]
    # A motion that is longer than its sound may leave nothing for the next.
    assert lengths((frames - 3) / config.fps) == [frames - 3, 1]


def test_k_distinct_references_each_and_all_used_evenly(tmp_path):
    for seed in range(5):
        chosen = choose(tmp_path, "references={mode: k, k: 3}", f"seed={seed}", tests=TESTS[:4])
        assert all(len(set(hand)) == len(hand) == 3 for hand in chosen.values())
        assert all(list(hand) == sorted(hand) for hand in chosen.values())
        drawn = [name for hand in chosen.values() for name in hand]
        assert all(drawn.count(name) >= 2 for name in REFERENCES)


def test_k_of_as_many_as_there_are_is_all_of_them(tmp_path):
    chosen = choose(tmp_path, "references={mode: k, k: 4}", tests=TESTS[:2])
    assert set(chosen.values()) == {tuple(sorted(REFERENCES))}


def test_more_than_there_are_is_refused(tmp_path):
    with refused(ConfigError, r"references\.k: found 5, but there are only 4 reference clips"):
        choose(tmp_path, "references={mode: k, k: 5}")


def test_k_does_not_count_in_the_papers_mode(tmp_path):
    assert all(len(hand) == 1 for hand in choose(tmp_path, "references.k=3").values())


def test_all(tmp_path):
    chosen = choose(tmp_path, "references.mode=all")
    assert set(chosen) == set(TESTS) and set(chosen.values()) == {tuple(sorted(REFERENCES))}


def test_speaker(tmp_path):
    speakers = {"a": "1", "b": "2"}
    chosen = choose(tmp_path, "references.mode=speaker", tests=["b", "a"], speakers=speakers)
    assert chosen == {"a": ("trn_0_main-agent", "trn_1_main-agent"), "b": ("trn_2_main-agent",)}


@pytest.mark.parametrize(
    ("speaker", "match"),
    [(None, r"clip a: no speaker in metadata\.csv"), ("9", "clip a: no reference clip of speaker 9")],
)
def test_speakers_that_are_not_there_are_refused(tmp_path, speaker, match):
    with refused(DataError, match + ".*references.mode|" + match + ".*use another mode"):
        choose(tmp_path, "references.mode=speaker", tests=["a"], speakers={"a": speaker})


@pytest.fixture
def pinned(tmp_path):
    def pinned(text, tests=("tst_0_main-agent", "tst_1_main-agent")):
        (tmp_path / "pins.yaml").write_text(text)
        override = f"references={{mode: list, list: '{tmp_path / 'pins.yaml'}'}}"
        return choose(tmp_path, override, tests=list(tests))

    return pinned


def test_pinned_references_by_short_and_long_names(pinned):
    text = "tst_0: trn_2\ntst_1_main-agent: [trn_3, trn_0_main-agent, trn_3]\n"
    assert pinned(text) == {
        "tst_0_main-agent": ("trn_2_main-agent",),
        "tst_1_main-agent": ("trn_3_main-agent", "trn_0_main-agent"),
    }


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("tst_0: trn_0\n", "test clip tst_1_main-agent is given no reference; add a line `tst_1_main-agent: "),
        ("tst_0: trn_0\ntst_1: []\n", "test clip tst_1_main-agent is given no reference"),
        ("tst_0: trn_0\ntst_1: [3]\n", "test clip tst_1_main-agent is given no reference"),
        ("tst_0: trn_9\ntst_1: trn_0\n", r"'trn_9', pinned to tst_0_main-agent, is no reference clip \(missing or"),
        ("- trn_0\n", "expected `test clip: reference clip` lines"),
        ("", "expected `test clip: reference clip` lines"),
        ("tst_0: trn_0\ntst_0: trn_1\n", r"pins\.yaml:2: key 'tst_0' stands twice"),
        ("tst_0: [trn_0\n", r"pins\.yaml:2: not valid YAML"),
    ],
    ids=["missing", "none", "number", "no such reference", "list", "empty", "twice", "no YAML"],
)
def test_wrong_pins_are_refused(pinned, tmp_path, text, match):
    with refused(ConfigError, match, tmp_path / "pins.yaml"):
        pinned(text)


def test_a_missing_pin_file_names_the_key(tmp_path):
    with refused(ConfigError, r"cannot be read .*references\.list", tmp_path / "none.yaml"):
        choose(tmp_path, f"references={{mode: list, list: '{tmp_path / 'none.yaml'}'}}")


# --- the real sample ----------------------------------------------------------------------------------------


def test_the_real_sample(tmp_path):
    config = load_config(None, (f"paths.data={data_folder() / 'genea_style_sample'}",))
    (recording,) = recordings.reference_recordings(config)
    assert (recording.name, recording.speaker) == ("trn_2023_v0_000_main-agent", "2")
    clip = clips.prepare(recording, config, True)
    assert clip.notes == ()
    clips.save(tmp_path / "a.npz", clip, config)
    reference = clips.load(tmp_path / "a.npz", config).reference(config)
    assert reference.motion.n_frames == 1906 and reference.segment_starts.tolist() == [0]
    assert len(reference.speech.onset_times) == 113
    assert len(clips.select_joints(reference.motion.skeleton, config)[0]) == 25
    raw = bvh.read(recording.motion_path)
    wrists = [raw.skeleton.index(name) for name in config.wrists.joints]
    others = np.setdiff1d(np.arange(83), wrists)
    np.testing.assert_allclose(
        rotation.to_matrix(reference.motion.rotations[:, others]),
        rotation.to_matrix(raw.rotations[:, others]),
        atol=1e-9,
    )
    tests = recordings.test_recordings(config)
    assert len(tests) == 3
    assert recordings.choose_references(names(tests), {clip.name: clip.speaker}, {}, config)[tests[0].name] == (
        clip.name,
    )

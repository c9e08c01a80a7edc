"""What lies beside a recording is used, or named; what a config names is there, or refused with the nearest name."""

import json

import numpy as np
import pytest

from gesturegen.data import clips, recordings
from gesturegen.errors import ConfigError
from gesturegen.pipeline import common, keyword_gestures
from gesturegen.speech import alignment
from tests import tiny
from tests.builders import bursts, chain, refused, settings_for, write_audio, write_clip
from tests.commands import errors, run

SRT = "1\n00:00:00,500 --> 00:00:00,800\nhello\n"
JSON = json.dumps({"words": [{"word": "hello", "start": 0.5, "end": 0.8}]})
FACE = json.dumps({"names": ["jaw"], "frames": []})


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    folder = tmp_path_factory.mktemp("references")
    write_clip(
        folder / "trn", "trn_a", 3.0, (0.4, 0.9, 1.5), motion=tiny.motion(np.random.default_rng(0), 90, chain(4))
    )
    return folder / "trn"


@pytest.fixture
def tests_folder(tmp_path):
    """Tests side by side: one with our TSV."""
    folder = tmp_path / "tests"
    write_audio(folder / "plain.wav", bursts((0.5, 1.2), 2.0))
    (folder / "plain.tsv").write_text("0.5\t0.8\thello\n")
    return folder


def start(reference, tests_folder, *options):
    return run("preprocess", "--references", reference, "--tests", tests_folder, "--work", tests_folder.parent / "work",
               "-j", 1, "--set", "joints=all", "--set", "wrists.enabled=false", *options)  # fmt: skip


def with_clip(folder, name, **files):
    """A test clip with other files beside its sound, by ending."""
    write_audio(folder / f"{name}.wav", bursts((0.5, 1.2), 2.0))
    for ending, content in files.items():
        (folder / f"{name}.{ending}").write_text(content)


def words_of(folder, name):
    """The words of a stored test clip, by the library."""
    with np.load(folder.parent / "work/clips" / f"{name}.npz") as stored:
        return stored["word_texts"].tolist()


def test_transcripts_of_other_kinds_are_used_and_named(reference, tests_folder):
    with_clip(tests_folder, "captions", srt=SRT)
    with_clip(tests_folder, "words", json=JSON)
    result = start(reference, tests_folder)
    assert result.exit_code == 0, result.output
    for name in ("plain", "captions", "words"):
        assert words_of(tests_folder, name) == ["hello"]
    assert "warning: captions: captions.srt: read as SRT\n" in result.output
    assert "warning: words: words.json: read as JSON with words\n" in result.output


def test_of_two_transcripts_the_choice_is_said_and_what_is_none_is_passed_over(reference, tests_folder):
    with_clip(tests_folder, "two", tsv="0.5\t0.8\tyes\n", srt=SRT)
    with_clip(tests_folder, "face", json=FACE, srt=SRT)
    result = start(reference, tests_folder)
    assert words_of(tests_folder, "two") == ["yes"] and words_of(tests_folder, "face") == ["hello"]
    assert "warning: two: two.tsv is read, and not two.srt\n" in result.output
    assert (
        "warning: face: face.json: movements of the face, as BEAT has them, and no transcript, and not used"
        in result.output
    )


def test_times_of_words_are_taken_before_times_of_segments(reference, tests_folder):
    """Whisper writes all its formats side by side."""
    row = "start\tend\ttext\n500\t1800\thello there you\n"
    with_clip(tests_folder, "whisper", tsv=row, json=JSON, srt=SRT, txt="hello there you")
    with_clip(tests_folder, "segments", tsv=row, json='{"words": [', srt=SRT.replace("hello", "hello there"))
    result = start(reference, tests_folder)
    assert words_of(tests_folder, "whisper") == ["hello"] and words_of(tests_folder, "segments") == [
        "hello",
        "there",
        "you",
    ]
    assert "whisper.json is read, and not whisper.tsv, whisper.srt, whisper.txt\n" in result.output
    assert "segments.tsv is read, and not segments.json, segments.srt\n" in result.output


def test_what_many_clips_share_is_told_once(reference, tests_folder):
    for number in range(5):
        with_clip(tests_folder, f"clip{number}", srt=SRT)
    result = start(reference, tests_folder)
    assert result.output.count("read as SRT") == 1
    assert "warning: clip0 and 4 more: clip0.srt: read as SRT\n" in result.output


def test_unused_files_are_named_once_with_their_count(reference, tests_folder):
    for name in ("a.npz", "b.npz", "c.npz", "d.npz", "plain.mp4", "notes.txt", "README.txt", ".hidden"):
        (tests_folder / name).write_text("x")
    result = start(reference, tests_folder)
    assert result.exit_code == 0
    line = f"warning: {tests_folder}: 6 files are not used: 4 .npz (a.npz, b.npz, c.npz, ...), 1 .txt (notes.txt), 1 .mp4 (plain.mp4)"
    assert line in result.output


def test_sound_that_is_not_read_is_a_failed_clip(reference, tests_folder):
    (tests_folder / "only.wma").write_bytes(b"x")
    (tests_folder / "plain.wma").write_bytes(b"x")  # has a WAV as well
    result = start(reference, tests_folder)
    assert result.exit_code == 1
    (line, count) = errors(result)
    assert line.startswith(
        f"error: only: {tests_folder / 'only.wma'}: Windows Media audio is not read; convert it to WAV"
    )
    assert "1 of 3 failed" in count and "1 .wma (plain.wma)" in result.output
    index = json.loads((tests_folder.parent / "work/clips/index.json").read_text())
    assert list(index["failed"]) == ["only"]


def test_a_broken_transcript_fails_its_clip_alone(reference, tests_folder):
    with_clip(tests_folder, "broken", srt="1\nhello\n")
    result = start(reference, tests_folder)
    assert result.exit_code == 1 and "broken.srt:1: no times of a cue" in errors(result)[0]
    assert words_of(tests_folder, "plain") == ["hello"]


def test_folders_named_after_a_kind_hold_transcripts(tmp_path):
    for folder, name in (("wav", "a.wav"), ("textgrid", "a.TextGrid"), ("wav", "b.wav"), ("wav", "b.srt")):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / name).write_bytes(b"x")
    a, b = recordings.list_recordings(tmp_path)
    assert a.transcript_path == tmp_path / "textgrid" / "a.TextGrid" and b.transcript_path == tmp_path / "wav" / "b.srt"
    assert recordings.unused_files(tmp_path) == []


def test_a_text_without_the_extra_says_what_to_install(reference, tests_folder, monkeypatch):
    monkeypatch.setattr(alignment, "_NEEDED", ("pocketsphinx", "no_such_module"))
    with_clip(tests_folder, "text", txt="hello there")
    result = start(reference, tests_folder)
    assert result.exit_code == 0 and words_of(tests_folder, "text") == []
    assert (
        "text.txt: a text without times, so its words are not used; to have it aligned, run: pip install 'gesturegen[align]'"
        in result.output
    )


def test_a_clip_is_made_again_when_another_of_its_transcripts_changes_or_texts_can_be_aligned(tmp_path, monkeypatch):
    with_clip(tmp_path, "a", json=FACE, txt="hello")
    (recording,) = recordings.list_recordings(tmp_path)
    monkeypatch.setattr(alignment, "version", lambda: "")
    before = clips.input_digest(recording)
    (tmp_path / "a.txt").write_text("there")
    after = clips.input_digest(recording)
    monkeypatch.setattr(alignment, "version", lambda: "1")
    assert len({before, after, clips.input_digest(recording)}) == 3


# --- names --------------------------------------------------------------------------------------------------


NAMES = ["take[1]_main-agent", "take1_main-agent", "trn_2023_v0_000_main-agent"]


@pytest.mark.parametrize(
    ("pattern", "found"),
    [
        ("take[1]", NAMES[:1]),
        ("take[1]_main-agent", NAMES[:1]),
        ("take[12]", NAMES[1:2]),
        ("take*", NAMES[:2][::-1]),
        ("trn_2023_v0_000", NAMES[2:]),
        ("Take1", []),
    ],
)
def test_names_are_taken_to_the_letter_first_then_as_globs(pattern, found):
    assert recordings.matching(pattern, NAMES) == sorted(found)
    assert all(recordings.is_listed(name, (pattern,)) for name in found)


MISSING = {
    "blacklist": ("blacklist=[trn_b]", "blacklist: 'trn_b' matches no reference clip; did you mean 'trn_a'?"),
    "exclude": ("exclude=[{clip: 'x*', from: 0, to: 1}]", "exclude: 'x*' matches no reference clip; there are: trn_a"),
    "gesture": ("control={library: x, gestures: [{clip: plane, at: 1, gesture: y}]}", "control.gestures, 1: 'plane' matches no test clip; did you mean 'plain'?"),
    "condition": (
        "control.conditions=[{measure: speed, at_most: 1}, {clip: '?', measure: height, at_most: 1}]",
        "control.conditions, 2: '?' matches no test clip; there are: plain",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("setting", "match"), MISSING.values(), ids=MISSING)
def test_a_name_that_matches_nothing_is_refused_with_the_nearest(reference, tests_folder, setting, match):
    result = start(reference, tests_folder, "--set", "search=global", "--set", setting)
    assert result.exit_code == 1 and f"Error: {match}" in result.output
    assert not list(tests_folder.parent.glob("work/clips/*"))


def test_names_of_later_commands_are_looked_up_in_what_was_read(tmp_path):
    master = "prosody.enabled=true", "method=gesture_master"
    quality = settings_for(tmp_path, *master, "gesture_master.quality.exclude=['trn_x@1.50', '*']")
    with refused(ConfigError, "quality.exclude: 'trn_x' matches no reference clip; did you mean 'trn_a'?"):
        common.require_names(quality, ["trn_a"], ["tst_a"])
    targets = "gesture_master.style={source: targets, targets: [{clip: tst_x, from: 0, to: 1}]}"
    with refused(ConfigError, "style.targets: 'tst_x' matches no test clip; did you mean 'tst_a'?"):
        common.require_names(settings_for(tmp_path, *master, targets), ["trn_a"], ["tst_a"])
    # What another method reads is no matter of this one.
    common.require_names(settings_for(tmp_path, targets), ["trn_a"], ["tst_a"])


def test_a_word_that_no_clip_says_is_named(tmp_path):
    entries = "[{word: Halt, gesture: a}, {word: stopp, gesture: b}, {clip: tst_b, word: halt, gesture: c}]"
    config = settings_for(tmp_path, f"control={{library: x, gestures: {entries}}}")
    assert keyword_gestures.unsaid(config, {"tst_a": {"halt", "stop"}, "tst_b": {"stop"}}) == [
        "gesture 2 (b): the word 'stopp' is said in no test clip; did you mean 'stop'?",
        "gesture 3 (c): the word 'halt' is said in no test clip",
    ]


def test_pinned_names_are_those_of_clips(tmp_path):
    pins = tmp_path / "pins.yaml"
    config = settings_for(tmp_path, f"references={{mode: list, list: '{pins}'}}")
    choose = lambda failed=(): recordings.choose_references(  # noqa: E731
        ["tst_a"], {"trn_a": None}, {}, config, failed=failed
    )
    pins.write_text("tst_a: trn_a\ntst_b: trn_a\n")
    with refused(ConfigError, "'tst_b' is no test clip; did you mean 'tst_a'?", pins):
        choose()
    assert choose(failed=["tst_b"]) == {"tst_a": ("trn_a",)}
    pins.write_text("tst_a: trn_b\n")
    with refused(ConfigError, "'trn_b', pinned to tst_a, is no reference clip .*; did you mean 'trn_a'?", pins):
        choose()

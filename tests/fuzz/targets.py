"""What is fuzzed: every reader of files that users hand in, with good inputs to damage and what must hold of results."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
import soundfile

from gesturegen import inputs
from gesturegen.data import recordings
from gesturegen.motion import bvh, positions
from gesturegen.motion.skeleton import Motion, Skeleton
from gesturegen.settings.loading import load_config
from gesturegen.settings.models import Config
from gesturegen.speech import audio, compressed, transcript, transcripts
from tests.builders import ARM, ARM_ROW, bursts, bvh_text, chain, random_motion

# A keyword list of one word saves reading the one that comes with gesturegen.
_BRIEF = "keywords.words={hey: hey}"
# Letters, as far as YAML is concerned, that no terminal shows: for private use, unassigned, turning the line around.
_NOT_PRINTABLE = ("\ue000", "\ud7fc", "\u202e")
_YAML_TOKENS = (
    ": ", "\n", "  ", "- ", "[", "]", "{", "}", ", ", "'", '"', "#", "|", ">", "&a ", "*a", "<<: ", "!!int ", "!x ", "---\n",
    "...\n", "? ", "%YAML 1.2\n", "~", "null", "true", "no", "010", "1:30", "2020-13-45", ".inf", "-.nan", "1e999", "0x1F", "9" * 30,
    "9" * 4301, "\\U00110000", '"\\ud800"', '"\\n"', "\t", "\x00", "\x1b", "\u2028", "\ufeff", "é", "[" * 60, "- " * 60, "=", "1_0", *_NOT_PRINTABLE,
)  # fmt: skip
_CSV_TOKENS = (
    ",",
    '"',
    "\n",
    "\r",
    '""',
    ";",
    "\t",
    "<<<<<<< a",
    "=======",
    "\x00",
    "\x1b",
    " ",
    "\ufeff",
    "1e999",
    "nan",
    "é",
    *_NOT_PRINTABLE,
)
_BVH_TOKENS = (
    "HIERARCHY", "ROOT a", "JOINT b", "End Site", "OFFSET 0 0 0", "CHANNELS 3 Xrotation Yrotation Zrotation", "CHANNELS ²",
    "{", "}", "MOTION", "Frames: 3", "Frames: 99999999", "Frames:", "Frame Time: 0.03", "Frame Time: 1e-9", "\n", "\r", "\t", "1e200",
    "1e999", "nan", "inf", "1_0", "٣", "-", "<<<<<<<", "\x00", "\x1b", "\u2028", "0 " * 50, *_NOT_PRINTABLE,
)  # fmt: skip
_TSV_TOKENS = (
    "\t",
    "\n",
    "\r",
    "1e308",
    "-1e308",
    "nan",
    "1_0",
    "#",
    "word",
    "two words",
    "<<<<<<<",
    "\x00",
    "\x1b",
    "0",
    "-1",
    *_NOT_PRINTABLE,
)


@dataclass(frozen=True)
class Target:
    """A reader: seeds are inputs that it accepts, tokens what its format is made of; `holds` checks what it returns."""

    seeds: tuple[bytes, ...]
    tokens: tuple[bytes, ...]
    suffix: str
    read: Callable[[Path], Any]
    holds: Callable[[Path, Any], None]
    binary: bool = False


def _text_target(seeds, tokens, suffix, read, holds) -> Target:
    return Target(
        tuple(seed.encode() for seed in seeds), tuple(token.encode() for token in tokens), suffix, read, holds
    )


# --- configs ------------------------------------------------------------------------------------------------


def _config_holds(_: Path, config: Config) -> None:
    again = Config.model_validate_json(config.model_dump_json(by_alias=True))
    assert again == config and again.signature() == config.signature()


def _keywords_hold(path: Path, config: Config) -> None:
    _config_holds(path, config)
    assert all(word == word.lower() and len(word.split()) == 1 for word in config.keywords.words)


def _read_set(path: Path) -> Config:
    """Each line of the file as a `--set`."""
    lines = path.read_bytes().decode("utf-8", "surrogateescape").split("\n")
    return load_config(None, [_BRIEF, *(line for line in lines if line)])


def _read_pins(path: Path) -> dict:
    config = load_config(None, [_BRIEF, "references={mode: list, list: pins}"])
    config = config.model_copy(update={"references": config.references.model_copy(update={"list_file": str(path)})})
    return recordings.choose_references(["test_a", "test_b"], dict.fromkeys(["ref_1", "ref_2"]), {}, config)


def _pins_hold(_: Path, pins: dict) -> None:
    assert set(pins) == {"test_a", "test_b"}
    assert all(names and set(names) <= {"ref_1", "ref_2"} for names in pins.values())


def _read_control(path: Path) -> Config:
    return load_config(None, [_BRIEF, "search=global", f"control.file={path}"])


def _read_corrections(path: Path) -> Config:
    return load_config(None, [_BRIEF, "gesture_master.rhythm.bits=4", f"gesture_master.rhythm.corrections_file={path}"])


def _read_style_targets(path: Path) -> Config:
    return load_config(None, [_BRIEF, f"gesture_master.style={{source: targets, targets_file: {path}}}"])


def _read_metadata(path: Path) -> dict[str, str | None]:
    return {recording.name: recording.speaker for recording in recordings.list_recordings(path.parent)}


def _metadata_holds(_: Path, speakers: dict[str, str | None]) -> None:
    assert set(speakers) == {"a_main-agent", "b"}
    assert all(text is None or (text and text == text.strip()) for text in speakers.values())
    assert not any(inputs.control_character(text or "") for text in speakers.values())


# --- motion -------------------------------------------------------------------------------------------------


def _motion_holds(path: Path, motion: Motion) -> None:
    assert motion.n_frames > 0 and 0.99 <= motion.fps <= 10_001
    assert np.isfinite(motion.rotations).all() and np.abs(motion.positions).max() <= 1e6
    np.testing.assert_allclose(np.linalg.norm(motion.rotations, axis=-1), 1.0, atol=1e-9)
    again = path.with_name("again.bvh")
    bvh.write(again, motion)
    back = bvh.read(again)
    assert motion.skeleton.difference(back.skeleton) is None and back.n_frames == motion.n_frames
    np.testing.assert_allclose(back.positions, motion.positions, atol=1e-5)
    np.testing.assert_allclose(np.abs(np.sum(back.rotations * motion.rotations, axis=-1)), 1.0, atol=1e-6)


def _skeleton_holds(_: Path, skeleton: Skeleton) -> None:
    assert len(set(skeleton.names)) == len(skeleton.names) <= bvh.MOST_JOINTS
    assert np.abs(skeleton.offsets).max() <= 1e6 and not (np.abs(skeleton.end_sites) > 1e6).any()


def _positions_hold(path: Path, found: np.ndarray) -> None:
    assert found.dtype == np.float64 and found.ndim == 3 and found.shape[2] == 3 and found.size
    assert np.abs(found).max() < 1e6
    with np.load(path) as stored:
        np.testing.assert_array_equal(found, stored["positions"].astype(np.float64))


def _npz(**arrays) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def _packed(**arrays) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


# --- speech -------------------------------------------------------------------------------------------------


def _samples_hold(path: Path, found: tuple[np.ndarray, int]) -> None:
    samples, rate = found
    low, high = audio.SAMPLE_RATES
    assert samples.dtype == np.float32 and samples.ndim == 1 and len(samples)
    assert np.isfinite(samples).all() and low <= rate <= high
    try:
        with compressed.overheard(), soundfile.SoundFile(path) as file:
            # Else the header does not tell how many there are, or only guesses.
            told = 0 < file.frames <= audio.MOST_SECONDS * file.samplerate and file.format not in ("MP3", "MPEG")
            if told and file.frames == len(samples):
                np.testing.assert_array_equal(samples, file.read(dtype="float32", always_2d=True).mean(axis=1))
    except soundfile.SoundFileError:
        head = path.read_bytes()[:12]
        # The lengths in the header of a WAV file are mended before libsndfile sees it, where its writer did not know them.
        assert compressed.kind(head) or head[:4] in (b"RIFF", b"RF64"), "neither libsndfile nor PyAV reads it"


def _sound(channels: int = 1, **options) -> bytes:
    file = io.BytesIO()
    samples = np.tile(bursts([0.02], 0.1, 8000)[:, None], channels)
    soundfile.write(file, samples, 8000, **options)
    return file.getvalue()


def _sounds(seeds: tuple[bytes, ...], suffix: str) -> Target:
    tokens = (
        b"RIFF",
        b"WAVE",
        b"fmt ",
        b"data",
        b"ds64",
        b"LIST",
        b"fLaC",
        b"OggS",
        b"OpusHead",
        b"moov",
        b"mdat",
        b"ftypM4A ",
        b"\xff\xfb",
        b"\xff\xf1",
        b"\0\0\0\0",
        b"\xff\xff\xff\xff",
        b"\x7f",
    )
    return Target(seeds, tokens, suffix, audio.read_samples, _samples_hold, binary=True)


def _encoded(container: str, layout: str = "mono") -> bytes:
    """A quarter of a second of AAC, as FFmpeg writes it; of eight channels PyAV used to read a ninth, and crashed."""
    file = io.BytesIO()
    with av.open(file, "w", format=container) as out:
        stream = out.add_stream("aac", rate=16000, layout=layout)
        samples = bursts([0.05], 0.256, 16000)[None].astype(np.float32)
        for start in range(0, samples.shape[1], 1024):
            part = np.repeat(samples[:, start : start + 1024], stream.layout.nb_channels, axis=1)
            frame = av.AudioFrame.from_ndarray(part, "flt", layout)
            frame.sample_rate, frame.pts = 16000, start
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return file.getvalue()


def _words_hold(_: Path, found: tuple) -> None:
    words, notes = found
    assert all(0 <= word.start <= word.end <= 5 for word in words)
    assert all(word.text and word.text == transcript.normalize(word.text) for word in words)
    assert [word.start for word in words] == sorted(word.start for word in words)
    assert all(math.isfinite(word.end) and word.frames(30.0)[1] > word.frames(30.0)[0] for word in words)
    assert not any(inputs.control_character(note) for note in notes)


def _read_words(path: Path) -> tuple:
    return transcripts.read(path, 5.0)


_TEXTGRID = '''File type = "ooTextFile"
Object class = "TextGrid"

xmin = 0
xmax = 5
tiers? <exists>
size = 2
item []:
    item [1]:
        class = "IntervalTier"
        name = "words"
        xmin = 0
        xmax = 5
        intervals: size = 2
        intervals [1]:
            xmin = 0
            xmax = 1.5
            text = "say ""hey"""
        intervals [2]:
            xmin = 1.5
            xmax = 5
            text = "<sil>"
    item [2]:
        class = "TextTier"
        name = "marks"
        xmin = 0
        xmax = 5
        points: size = 1
        points [1]:
            number = 1
            mark = "a"
'''
_CUE_TOKENS = ("-->", "00:00:01,000", "00:60.000", "1:00:00.5", "\n\n", "\n", "<i>", "<00:00:01.000>", "{\\an8}", "[music]", "&#0;", "&#xD800;",
               "7", "\x00", "\u2028", "<" * 50, "[" * 50, *_NOT_PRINTABLE)  # fmt: skip


TARGETS = {
    "config": _text_target(
        (
            "seed: 3\nfps: 30\nblacklist: [a, 'b*']\nexclude:\n- {clip: a, from: 0, to: 1.5}\n",
            "method: gesture_master # comment\nprosody:\n  enabled: true\ncontinuity: {l_pn: 1, lambda_pos: 1e-3}\n"
            'paths:\n  data: "x y"\njoints: all\ngesture_master:\n  upper:\n    delta_t: null\n    delta_quantile: 0.25\n',
        ),
        _YAML_TOKENS, ".yaml", lambda path: load_config(path, [_BRIEF]), _config_holds,
    ),
    "set": _text_target(
        ("seed=3\ncontinuity.l_pn=1\nblacklist=[a, b]", "beam={l_npaths: 3}\nonsets.min_strength=1.0e-3\npaths.data=a=b"),
        ("=", ".", "..", *_YAML_TOKENS), ".txt", _read_set, _config_holds,
    ),
    "keywords": _text_target(
        ("hey: hey\nHello: hello\nno: negation\n'yes': yes\n",), _YAML_TOKENS, ".yaml",
        lambda path: load_config(None, [f"keywords.file={path}"]), _keywords_hold,
    ),
    "control": _text_target(
        (
            "conditions:\n- {clip: 'a*', measure: height, hand: left, at_least: 85%, from: 1, to: 2.5}\n"
            "- {measure: speed, at_most: 9, hard: false, price: 2}\ngestures:\n- {word: hey, gesture: wave}\n",
        ),
        _YAML_TOKENS, ".yaml", _read_control, _config_holds,
    ),
    "references list": _text_target(
        ("test_a: ref_1\ntest_b: [ref_1, ref_2]\n",), _YAML_TOKENS, ".yaml", _read_pins, _pins_hold
    ),
    "corrections": _text_target(
        ("clip,start,bits\na,1.5,0101\nb,2,1111\n",), _CSV_TOKENS, ".csv", _read_corrections, _config_holds
    ),
    "style targets": _text_target(
        ("clip,from,to,speed,radius,height\na,0,1.5,30,,\nb,1,2,,5.5,-3\n",),
        _CSV_TOKENS, ".csv", _read_style_targets, _config_holds,
    ),
    "metadata": _text_target(
        ('prefix,main-agent_id,note\na,1,"x, y"\nb, 2 ,z\n', "\ufeffmain-agent_id,prefix\r\n1,a\r\n1,b\r\n"),
        _CSV_TOKENS, "/metadata.csv", _read_metadata, _metadata_holds,
    ),
    "BVH": _text_target(
        (
            bvh_text(), bvh_text([ARM_ROW, ARM_ROW.replace("50.0", "-1e1")], frame_time="0.0083333"),
            bvh.format_bvh(random_motion(chain(4), 4)),
        ),
        _BVH_TOKENS, ".bvh", bvh.read, _motion_holds,
    ),
    "skeleton": _text_target((ARM + "MOTION\n",), _BVH_TOKENS, ".bvh", bvh.read_skeleton, _skeleton_holds),
    "WAV": _sounds(
        (_sound(format="WAV"), _sound(2, format="WAV", subtype="FLOAT"), _sound(format="RF64"), _sound(3, format="WAVEX")), ".wav"
    ),
    "FLAC": _sounds((_sound(format="FLAC"), _sound(2, format="FLAC", subtype="PCM_24")), ".flac"),
    "OGG": _sounds((_sound(format="OGG"), _sound(2, format="OGG")), ".ogg"),
    "Opus": _sounds((_sound(format="OGG", subtype="OPUS"), _sound(2, format="OGG", subtype="OPUS")), ".opus"),
    "MP3": _sounds((_sound(format="MP3", subtype="MPEG_LAYER_III"), _sound(2, format="MP3", subtype="MPEG_LAYER_III")), ".mp3"),
    "M4A": _sounds((_encoded("ipod"), _encoded("ipod", "7.1")), ".m4a"),
    "AAC": _sounds((_encoded("adts"), _encoded("adts", "7.1")), ".aac"),
    "WebM": _sounds((_encoded("matroska"),), ".webm"),
    "transcript": _text_target(
        ("0.1\t0.4\thello there\n0.5\t0.9\tone\n1.0\t1.2\t#\n", "0 1 hi\r\n1 2 two words\r\n4.9 9.5 é\r\n"),
        _TSV_TOKENS, ".tsv", _read_words, _words_hold,
    ),
    "table": _text_target(
        ('start;end;speaker;text\n0,1;0,4;A;"hello; there"\n0,5;0,9;A;one\n', "100,300,hi\n1000,3000,two words\n4000,4500,é\n",
         "0:00:01.5,0:00:02.25,hello\n0:00:03,0:00:04,you\n"),
        (*_TSV_TOKENS, *_CSV_TOKENS, "start", "end", "duration", "text", "_ms", "00:00:01,5", "\\"), ".csv", _read_words, _words_hold,
    ),
    "TextGrid": _text_target(
        (_TEXTGRID, 'File type = "ooTextFile"\nObject class = "TextGrid"\n\n0\n5\n<exists>\n1\n"IntervalTier"\n"words"\n0\n5\n2\n'
         '0\n1\n""\n1\n1.5\n"hey"\n'),
        ('"', '""', "xmin = ", "xmax = ", "item [1]:", "intervals [1]:", "intervals: size = 9", "text = ", '"TextTier"', '"IntervalTier"',
         "\n", "1e308", "nan", "<exists>", "<absent>", "99999999", "\x00", "\ufeff"),
        ".TextGrid", _read_words, _words_hold,
    ),
    "SRT": _text_target(
        ("1\n00:00:00,100 --> 00:00:00,900\nHello <i>there</i>,\n[laughs] you\n\n2\n00:00:01,000 --> 00:00:02,500\n{\\an8}two &amp; three\n",),
        _CUE_TOKENS, ".srt", _read_words, _words_hold,
    ),
    "WebVTT": _text_target(
        ("WEBVTT - a title\n\nNOTE x\n\n00:00.100 --> 00:00.900 align:start\n<v Ann>Hello there\n\n"
         "00:01.000 --> 00:02.500\nso<00:01.500><c> well</c>\n\n00:02.500 --> 00:02.600\nso well\nthen\n",),
        ("WEBVTT", "NOTE", "STYLE", *_CUE_TOKENS), ".vtt", _read_words, _words_hold,
    ),
    "JSON": _text_target(
        ('{"segments": [{"start": 0, "end": 2, "text": "hi you", "words": [{"word": " hi", "start": 0.1, "end": 0.4, "score": 1}, '
         '{"word": "2014"}, {"word": "you", "start": 1, "end": 1.5}]}], "language": "en"}',
         '{"segments": [{"start": 0.5, "end": 1.25, "text": " hi you"}]}', '{"transcription": [{"offsets": {"from": 100, "to": 900}, "text": "a"}]}',
         '[{"text": "one", "start": 100, "end": 3000}, {"text": "two", "start": 4000, "end": 4500}]'),
        ("{", "}", "[", "]", ",", ":", '"', "null", "true", "NaN", "-Infinity", "1e999", "9" * 400, '"words": []', '"word": 3', '"start": "1"',
         "[" * 2000, '"\\ud800"', "\\u0000", "\x00"),
        ".json", _read_words, _words_hold,
    ),
    "CTM": _text_target(
        (";; x\ninput 1 0.10 0.30 hello 0.9\ninput 1 0.5 0.25 you\nother 1 0 1 no\n",), (*_TSV_TOKENS, ";;", "input 1 "), ".ctm",
        _read_words, _words_hold,
    ),
    "text": _text_target(
        ("Hello there, [laughs] it is 2014.\nAnd so on.\n", "well\r\n"), (*_TSV_TOKENS, "[", "]", "-->", "{", "WEBVTT"), ".txt",
        _read_words, _words_hold,
    ),
    "positions": Target(
        (
            _npz(positions=np.arange(60.0).reshape(5, 4, 3)), _npz(fps=np.array(30), positions=np.ones((2, 3, 3), ">f4")),
            _packed(positions=np.asfortranarray(np.arange(60).reshape(5, 4, 3))),
        ),
        (b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06", b"positions.npy", b"'<f8'", b"'|b1'", b"'<M8'", b"'|O'", b"NaN", b"(9999999999, 4, 3)"),
        ".npz", positions.read, _positions_hold, binary=True,
    ),
}  # fmt: skip

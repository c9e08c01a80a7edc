"""Gestures of a library, shown at a word or a time by every method: their frames, what is around them, refusals."""

import csv
import importlib
import json
import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gesturegen import render
from gesturegen.methods.baseline import search as baseline
from gesturegen.motion import bvh, rotation
from gesturegen.motion.skeleton import Motion
from gesturegen.pipeline import keyword_gestures
from tests import tiny
from tests.builders import chain
from tests.commands import errors, run, succeed, tree
from tests.methods.gesture_master import gesture_builders as gb
from tests.methods.motion_matching.test_matching_database import JOINTS
from tests.test_gesture_master import CUTTING, rewritten, settings, stamps, write_recording

SMALL = settings(
    "joints=all", "wrists.enabled=false", "acoustics.enabled=true", "prosody.enabled=true", "prosody.hop_length=800",
    "prosody.pitch_min=150.0", "references.mode=all", f"motion_matching.joints={list(JOINTS)}",
    "motion_matching.sequence_seconds=1.0", "gesture_master.style.source=none", CUTTING,
)  # fmt: skip
METHODS = {
    "beam": (),
    "global": settings("search=global"),
    "motion_matching": settings("method=motion_matching"),
    "gesture_master": settings("method=gesture_master"),
}
REFERENCES, TESTS = ("trn_a", "trn_b"), ("tst_a", "tst_b")
FRAMES = {"tst_a": 120, "tst_b": 90}
# tst_a says it twice, tst_b once.
SAID = {"tst_a": [(0.5, 0.8, "halt"), (1.1, 1.4, "one"), (2.5, 2.8, "Halt,")], "tst_b": [(1.0, 1.4, "halt")]}
LENGTHS = {"wave": 30, "point": 21, "endless": 400}


def gesture(name: str, frames: int) -> Motion:
    """A gesture of a body that stands somewhere else and faces away."""
    return gb.motion(np.random.default_rng(len(name)), frames, travel=30.0)


@pytest.fixture(scope="module")
def base(tmp_path_factory) -> Path:
    """Recordings in `data`, gestures in `library`, and in `work` clips and what each method searches."""
    folder = tmp_path_factory.mktemp("gestures")
    for seed, (name, seconds) in enumerate(zip(REFERENCES, (6.0, 5.0), strict=True)):
        write_recording(folder / "data", name, seconds, seed)
    for seed, name in enumerate(TESTS):
        write_recording(folder / "data", name, FRAMES[name] / 30, 10 + seed, words=SAID[name])
    for name, frames in LENGTHS.items():
        bvh.write(folder / "library" / f"{name}.bvh", gesture(name, frames))
    bvh.write(folder / "library/foreign.bvh", tiny.motion(np.random.default_rng(0), 30, chain(4)))
    done(folder, "preprocess", "beam")
    for method in METHODS:
        done(folder, "build-graph", method)
    return folder


def command(
    folder: Path, name: str, method: str, *entries: str, work: Path | None = None, options=(), library="library"
):
    """A command, with gestures as a control file would have them."""
    asked = settings(f"control.library={folder / library}", f"control.gestures=[{', '.join(entries)}]")
    places = ("--data", folder / "data", "--work", work or folder / "work", "-j", 1)
    return run(name, *SMALL, *METHODS[method], *places, *(asked if entries else ()), *options)


def done(folder, name, method, *entries, **options):
    result = command(folder, name, method, *entries, **options)
    assert result.exit_code == 0 and errors(result) == [], result.output
    return result


@pytest.fixture
def folder(base, tmp_path) -> Path:
    """The same, to write results into."""
    (tmp_path / "data").symlink_to(base / "data")
    shutil.copytree(base / "library", tmp_path / "library")
    (tmp_path / "work").mkdir()
    for name in ("clips", "graphs"):
        shutil.copytree(base / "work" / name, tmp_path / "work" / name)
    return tmp_path


def trace(folder: Path, name: str) -> dict:
    return json.loads((folder / "work/reenact" / f"{name}.trace.json").read_text())


def shown(folder: Path, name: str) -> list[tuple[str, int, int]]:
    """The gestures of a clip: which, and its first frame and the one after its last."""
    return [
        (piece["keyword"], piece["start_frame"], piece["end_frame"])
        for piece in trace(folder, name)["pieces"]
        if piece["end_kind"] == "gesture" and piece["keyword"]
    ]


def told(result) -> list[str]:
    """The lines of errors, without the one that counts them."""
    assert result.exit_code == 1, result.output
    return [line for line in errors(result) if not line.endswith(" failed")]


def check_pieces(found: dict) -> None:
    """They follow one another over the whole speech, none is empty, and gestures are whole from their first frame."""
    pieces = found["pieces"]
    assert pieces[0]["start_frame"] == 0 and pieces[-1]["end_frame"] == found["n_frames"]
    for one, other in pairwise(pieces):
        assert one["end_frame"] == other["start_frame"]
    starts = {one["clip"]: one["start_node"] for one in found["references"]}
    ends = dict(zip(starts, [*list(starts.values())[1:], np.inf], strict=True))
    for piece in pieces:
        assert piece["nodes"] and piece["target_length"] == piece["end_frame"] - piece["start_frame"] > 0
        name = f"gesture:{piece['keyword']}"
        if piece["end_kind"] == "gesture" and piece["keyword"]:
            first = starts[name]
            assert piece["nodes"] == list(range(first, first + piece["target_length"]))
            assert piece["nodes"][-1] < ends[name]
            assert piece["cost"] == 0 and piece["costs"] is None and piece["fallback"] is None
        else:
            assert max(piece["nodes"]) < min(start for clip, start in starts.items() if clip.startswith("gesture:"))


def check_around(plain: dict, found: dict) -> None:
    """Around the gestures is shown what is shown without them, and no more of it than fits."""
    gestures = [piece for piece in found["pieces"] if piece["end_kind"] == "gesture" and piece["keyword"]]
    for piece in found["pieces"]:
        if piece in gestures:
            continue
        inside = [
            one
            for one in plain["pieces"]
            if one["start_frame"] <= piece["start_frame"] and piece["end_frame"] <= one["end_frame"]
        ]
        (whole,) = inside
        length = len(whole["nodes"])
        pace = (length - 1) / max(whole["target_length"] - 1, 1)
        first = (piece["start_frame"] - whole["start_frame"]) * pace
        last = (piece["end_frame"] - 1 - whole["start_frame"]) * pace
        low, high = int(np.ceil(first - 1e-6)), int(np.floor(last + 1e-6))
        cut = piece["start_frame"] > whole["start_frame"], piece["end_frame"] < whole["end_frame"]
        # One that is cut on both sides is cut a second time, and then shows the first part at a pace of its own.
        stops = {high - 1, high, high + 1} if all(cut) else {high}
        assert piece["nodes"] in [whole["nodes"][low : max(stop, low) + 1] for stop in stops], (whole, piece)
        if not cut[1]:
            assert (piece["end_kind"], piece["keyword"]) == (whole["end_kind"], whole["keyword"])
        else:
            assert (piece["end_kind"], piece["keyword"]) == ("gesture", "")


# --- in every method -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_at_a_time_and_at_a_word(method, folder):
    done(folder, "reenact", method)
    plain = {name: trace(folder, name) for name in TESTS}
    done(folder, "reenact", method, "{word: halt, gesture: point}", "{clip: tst_a, at: 1.3, gesture: wave}")
    assert shown(folder, "tst_a") == [("point", 15, 36), ("wave", 39, 69), ("point", 75, 96)]
    assert shown(folder, "tst_b") == [("point", 30, 51)]
    for name in TESTS:
        found = trace(folder, name)
        check_pieces(found)
        check_around(plain[name], found)
        assert found["notes"] == plain[name]["notes"]
        assert bvh.read(folder / "work/reenact" / f"{name}.bvh").n_frames == FRAMES[name] == found["n_frames"]
        known = [one["clip"] for one in found["references"]]
        assert known[: len(plain[name]["references"])] == [one["clip"] for one in plain[name]["references"]]
        extra = ["gesture:point", "gesture:wave"] if name == "tst_a" else ["gesture:point"]
        assert known[len(plain[name]["references"]) :] == extra
        # The legs of GestureMaster go on.
        assert found["tracks"] == plain[name]["tracks"]


@pytest.mark.parametrize("method", METHODS)
def test_the_gesture_s_own_frames_are_seen(method, folder):
    asked = "{clip: tst_a, at: 1.0, gesture: wave}"
    options = settings("blend.method=crossfade", "blend.l_blend=2")
    done(folder, "reenact", method, asked, options=options)
    motion, own = bvh.read(folder / "work/reenact/tst_a.bvh"), bvh.read(folder / "library/wave.bvh")
    joints = [j for j, name in enumerate(gb.NAMES) if name in gb.UPPER]
    if method != "gesture_master":
        joints = list(range(1, len(gb.NAMES)))
    inner = slice(3, 27)
    apart = rotation.angle_between(motion.rotations[30:60][inner, joints], own.rotations[inner, joints])
    assert np.degrees(apart).max() < 1e-3
    # The body goes on from where it stood, and turns with the gesture from there.
    steps = np.linalg.norm(np.diff(motion.positions[:, 0][:, [0, 2]], axis=0), axis=1)
    recorded = np.linalg.norm(np.diff(own.positions[:, 0][:, [0, 2]], axis=0), axis=1)
    assert steps[28:62].max() < 1.5 * recorded.max(), "the root jumps"


@pytest.mark.slow
def test_lent_fingers_give_way_to_those_of_the_gesture(base, tmp_path):
    """Where a reference was recorded without fingers, GestureMaster shows those of others in a track of their own."""
    shutil.copytree(base / "data", tmp_path / "data")
    shutil.copytree(base / "library", tmp_path / "library")
    for seed, name in enumerate(REFERENCES):
        moved = gb.motion(np.random.default_rng(seed), 150, fingers=name == "trn_b")
        write_recording(tmp_path / "data", name, 5.0, seed, motion=moved)
    for name in ("preprocess", "build-graph", "reenact"):
        done(tmp_path, name, "gesture_master", "{clip: tst_a, at: 1.0, gesture: wave}")
    found = trace(tmp_path, "tst_a")
    assert [set(track["joints"]) >= set(gb.FINGERS) for track in found["tracks"]] == [False, True]
    motion, own = bvh.read(tmp_path / "work/reenact/tst_a.bvh"), bvh.read(tmp_path / "library/wave.bvh")
    fingers = [gb.NAMES.index(name) for name in gb.FINGERS]
    apart = rotation.angle_between(motion.rotations[30:60][9:-9, fingers], own.rotations[9:-9, fingers])
    assert np.degrees(apart).max() < 1e-3
    for name in ("evaluate", "check", "report"):
        done(tmp_path, name, "gesture_master", "{clip: tst_a, at: 1.0, gesture: wave}")
    succeed("inspect", "tst_a", "--work", tmp_path / "work")


@pytest.mark.parametrize("method", METHODS)
def test_one_longer_than_what_is_left_is_cut(method, folder):
    done(folder, "reenact", method, "{clip: tst_b, at: 2.4, gesture: wave}", "{clip: tst_a, at: 0, gesture: endless}")
    assert shown(folder, "tst_b") == [("wave", 72, 90)] and shown(folder, "tst_a") == [("endless", 0, 120)]
    for name in TESTS:
        check_pieces(trace(folder, name))
        assert bvh.read(folder / "work/reenact" / f"{name}.bvh").n_frames == FRAMES[name]
    assert len(trace(folder, "tst_a")["pieces"]) == 1 and trace(folder, "tst_a")["joins"] == []


@pytest.mark.parametrize("method", ["beam", "motion_matching", "gesture_master"])
def test_one_after_the_other(method, folder):
    # The second waits for the end of the first, the third comes right after it, and is at the last frame.
    entries = ["{clip: tst_b, at: 0.5, gesture: wave}", "{clip: tst_b, at: 1.2, gesture: point}"]
    done(folder, "reenact", method, *entries, "{clip: tst_b, at: 2.97, gesture: wave}")
    assert shown(folder, "tst_b") == [("wave", 15, 45), ("point", 45, 66), ("wave", 89, 90)]
    check_pieces(trace(folder, "tst_b"))


@pytest.mark.parametrize("method", ["beam", "motion_matching", "gesture_master"])
def test_one_for_which_the_one_before_leaves_no_time(method, folder):
    done(folder, "reenact", method, "{clip: tst_b, at: 0.5, gesture: endless}", "{clip: tst_b, at: 1.5, gesture: wave}")
    found = trace(folder, "tst_b")
    assert shown(folder, "tst_b") == [("endless", 15, 90)]
    check_pieces(found)
    assert any("wave" in note and "left out" in note for note in found["notes"]), found["notes"]
    assert bvh.read(folder / "work/reenact/tst_b.bvh").n_frames == 90


def test_a_gesture_at_another_rate_lasts_as_long(folder):
    own = gesture("wave", 40)
    bvh.write(folder / "library/fast.bvh", Motion(own.skeleton, own.rotations, own.positions, 60.0))
    done(folder, "reenact", "beam", "{clip: tst_a, at: 1.0, gesture: fast}")
    ((_, start, end),) = shown(folder, "tst_a")
    assert start == 30 and end - start == pytest.approx(20, abs=1)


@pytest.mark.parametrize("seed", range(12))
def test_pieces_of_any_length_are_cut_where_gestures_begin_and_end(seed, tmp_path):
    rng = np.random.default_rng(seed)
    recorded = tiny.reference(tiny.motion(rng, 80, chain(4)))
    entries = [{"at": float(at) / 30, "gesture": "g"} for at in rng.choice(range(0, 150, 16), 4, replace=False)]
    config = tiny.config(control={"library": str(tmp_path), "gestures": tuple(entries)})
    length = int(rng.integers(1, 40))
    bvh.write(tmp_path / "g.bvh", tiny.motion(rng, length, chain(4)))
    library = baseline.build([recorded], config)
    pieces, left = [], 150
    while left:
        count, frames = int(rng.integers(1, 30)), min(int(rng.integers(1, 30)), left)
        start = int(rng.integers(0, 80 - count))
        pieces.append((range(start, start + count), frames))
        left -= frames
    path = tiny.path_of(*pieces)
    placed, frames, shown = keyword_gestures.place(path, library, [recorded], tiny.speech(150), config)
    (track,) = placed.tracks
    assert len(shown) == 2 and frames.n_nodes == 80 + length and frames.clip_names == ("clip", "gesture:g")
    before = {piece.target.start_frame: piece for piece in path.tracks[0].pieces}
    end = 0
    for piece in track.pieces:
        target = piece.target
        assert target.start_frame == end and target.length > 0 and len(piece.nodes) > 0
        end = target.end_frame
        if target.keyword == "g":
            assert piece.nodes.tolist() == list(range(80, 80 + target.length))
            assert target.length == length or target.end_frame == 150
        else:
            start = max(number for number in before if number <= target.start_frame)
            whole = before[start]
            assert target.end_frame <= whole.target.end_frame
            assert set(piece.nodes.tolist()) <= set(whole.nodes.tolist()) and (np.diff(piece.nodes) == 1).all()
            if (target.start_frame, target.end_frame) == (start, whole.target.end_frame):
                assert piece is whole
    assert end == 150
    assert sum(piece.target.keyword == "g" for piece in track.pieces) + len(placed.notes) == 4
    assert render.render(placed, shown, frames, config).n_frames == 150


def test_without_gestures_nothing_changes(tmp_path):
    recorded = tiny.reference(tiny.motion(np.random.default_rng(0), 80))
    asked = ({}, {"gestures": ({"clip": "another", "at": 1.0, "gesture": "g"},), "library": str(tmp_path)})
    for control in asked:
        library, path = baseline.build([recorded], tiny.config()), tiny.path_of(range(50))
        placed, frames, shown = keyword_gestures.place(
            path, library, [recorded], tiny.speech(50), tiny.config(control=control)
        )
        assert frames is library and shown == [recorded] and placed.tracks[0] is path.tracks[0]


# --- commands ------------------------------------------------------------------------------------------------

ASKED = ("{word: halt, gesture: point}", "{clip: tst_a, at: 1.3, gesture: wave}")


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_evaluate_check_report_and_export(method, folder):
    for name in ("reenact", "evaluate", "check", "report"):
        result = done(folder, name, method, *ASKED)
        assert (
            name not in ("check", "report")
            or {"check": "2 clips, all valid", "report": "2 clips to watch, 0 failed"}[name] in result.output
        )
    lines = (folder / "work/evaluate/metrics.csv").read_text().splitlines()
    rows = {row["clip"]: row for row in csv.DictReader(line for line in lines if not line.startswith("#"))}
    assert set(TESTS) <= set(rows)
    succeed("export", folder / "work/reenact", "--format", "npz", "--out", folder / "out", "-j", 1)
    assert np.load(folder / "out/tst_a.npz")["positions"].shape[0] == 120


@pytest.mark.parametrize("method", METHODS)
def test_inspect_names_the_gesture_and_knows_the_graph(method, folder):
    done(folder, "reenact", method, *ASKED)
    result = succeed("inspect", "tst_a", "--work", folder / "work", "--plot", folder / "trace.png")
    assert "gesture:wave" in result.output and "another one now" not in result.output, result.output
    assert (folder / "trace.png").is_file()
    facts = json.loads(succeed("inspect", "tst_a", "--work", folder / "work", "--json").output)
    (wave,) = [piece for piece in facts["pieces"] if piece["keyword"] == "wave"]
    assert [wave[side]["clip"] for side in ("first", "last")] == ["gesture:wave"] * 2
    assert [wave[side]["source_frame"] for side in ("first", "last")] == [0, 29]


def test_a_run_is_the_same_whatever_is_searched_for_together(folder, monkeypatch):
    done(folder, "reenact", "motion_matching", *ASKED)
    before = tree(folder / "work/reenact")
    monkeypatch.setattr(importlib.import_module("gesturegen.pipeline.reenact"), "_TOGETHER", 1)
    done(folder, "reenact", "motion_matching", *ASKED)
    assert tree(folder / "work/reenact") == before


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_workers_change_no_byte(method, folder):
    done(folder, "run", method, *ASKED)
    before = tree(folder / "work")
    shutil.rmtree(folder / "work/reenact")
    done(folder, "run", method, *ASKED, options=("-j", 2))
    assert tree(folder / "work") == before


@pytest.mark.slow
def test_run_sees_a_changed_gesture_and_nothing_else(folder):
    asked = "{clip: tst_a, at: 1.3, gesture: wave}"
    done(folder, "run", "motion_matching", asked)
    before, same = stamps(folder / "work"), tree(folder / "work")
    done(folder, "run", "motion_matching", asked)
    assert rewritten(folder / "work", before) == set() and tree(folder / "work") == same
    bvh.write(folder / "library/point.bvh", gesture("other", 25))  # not asked for
    done(folder, "run", "motion_matching", asked)
    assert rewritten(folder / "work", before) == set()
    bvh.write(folder / "library/wave.bvh", gesture("another", 24))
    done(folder, "run", "motion_matching", asked)
    assert "reenact/tst_a.bvh" in rewritten(folder / "work", before, "reenact")
    assert rewritten(folder / "work", before, "clips", "graphs") == set()
    assert shown(folder, "tst_a") == [("wave", 39, 63)]
    done(folder, "run", "motion_matching")
    assert shown(folder, "tst_a") == []


@pytest.mark.slow
@pytest.mark.parametrize("frames", [10, 50])
def test_evaluate_knows_that_a_gesture_changed(frames, folder):
    asked = ("{clip: tst_a, at: 0.3, gesture: point}", "{clip: tst_a, at: 1.3, gesture: wave}")
    for name in ("point", "wave"):
        done(folder, "reenact", "motion_matching", *asked)
        kept = (folder / f"library/{name}.bvh").read_bytes()
        bvh.write(folder / f"library/{name}.bvh", gesture(name, frames))
        result = command(folder, "evaluate", "motion_matching", *asked)
        if (name, frames) == ("wave", 50):  # the last one, and there is enough of it
            assert result.exit_code == 0
        else:
            (line,) = told(result)
            assert "tst_a: its gestures changed since; run `gesturegen reenact` again" in line
        (folder / f"library/{name}.bvh").write_bytes(kept)


def test_evaluate_needs_the_library(folder):
    done(folder, "reenact", "motion_matching", *ASKED)
    lines = told(command(folder, "evaluate", "motion_matching"))
    assert len(lines) == 2 and all("control.library" in line and ".bvh" in line for line in lines)


@pytest.mark.parametrize("method", METHODS)
def test_every_variant_shows_it(method, folder):
    done(folder, "reenact", method, *ASKED, options=("--variants", "2"))
    second = folder / "work/variants/2/reenact/tst_a.trace.json"
    one, other = trace(folder, "tst_a"), json.loads(second.read_text())
    for found in (one, other):
        check_pieces(found)
        assert [piece["start_frame"] for piece in found["pieces"] if piece["keyword"] == "wave"] == [39]
    assert one["pieces"] != other["pieces"] and other["variant"] == 2


def test_gestures_of_a_control_file(folder):
    done(folder, "reenact", "motion_matching", *ASKED)
    before = {name: trace(folder, name)["pieces"] for name in TESTS}
    (folder / "hands.yaml").write_text("gestures:\n" + "".join(f"- {entry}\n" for entry in ASKED))
    options = settings(f"control.file={folder / 'hands.yaml'}", f"control.library={folder / 'library'}")
    done(folder, "reenact", "motion_matching", options=options)
    assert {name: trace(folder, name)["pieces"] for name in TESTS} == before


# --- refusals ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("{clip: tst_a, at: 1, gesture: wav}", ["no such gesture; did you mean 'wave'?", "wav.bvh"]),
        ("{clip: tst_a, at: 1, gesture: xyzzy}", ["no such gesture; it has: endless, foreign, point, wave"]),
        ("{clip: tst_a, at: 1, gesture: foreign}", ["foreign.bvh: not the skeleton of the references", "retarget"]),
        ("{clip: tst_a, at: 4.5, gesture: wave}", ["gesture 1 (wave): at 4.5 s, the clip ends at 4.00 s"]),
    ],
)
@pytest.mark.parametrize("method", ["beam", "motion_matching", "gesture_master"])
def test_what_cannot_be_shown_is_one_line(method, entry, words, folder):
    (line,) = told(command(folder, "reenact", method, entry))
    assert "tst_a" in line and all(word in line for word in words), line
    assert not (folder / "work/reenact/tst_a.bvh").exists()
    # The other clip goes on.
    assert bvh.read(folder / "work/reenact/tst_b.bvh").n_frames == 90


@pytest.mark.parametrize("library", ["nowhere", "data/trn/main-agent/wav/trn_a.wav", "empty"])
def test_a_missing_folder_is_one_line(library, folder):
    (folder / "empty").mkdir()
    (line,) = told(
        command(folder, "reenact", "motion_matching", "{clip: tst_a, at: 1, gesture: wave}", library=library)
    )
    assert ("it has: no BVH file" if library == "empty" else "is no folder") in line and library in line


def test_no_folder_given_is_one_line(folder):
    options = settings("control.gestures=[{clip: tst_a, at: 1, gesture: wave}]")
    (line,) = told(command(folder, "reenact", "motion_matching", options=options))
    assert "control.library" in line and "wave.bvh" in line


def test_a_damaged_gesture_is_one_line(folder):
    path = folder / "library/wave.bvh"
    path.write_text(path.read_text()[:-500])
    (line,) = told(command(folder, "reenact", "motion_matching", "{clip: tst_a, at: 1, gesture: wave}"))
    assert str(path) in line

"""`method: gesture_master` on bad or scanty input: one clear line, nothing half-written, other clips unharmed."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from gesturegen.methods.gesture_master import building as build_database
from gesturegen.motion import bvh
from gesturegen.stored import arrays as stored_arrays
from tests import test_gesture_master as usual
from tests.builders import make_skeleton, write_audio
from tests.commands import errors, tree
from tests.methods.gesture_master import gesture_builders
from tests.test_gesture_master import RESULT, TESTS, command, commands, database, inspected, parts, settings, trace

BUILD = ("preprocess", "build-graph")


@pytest.fixture(scope="module")
def whole_data(tmp_path_factory) -> Path:
    return usual.write_data(tmp_path_factory.mktemp("small") / "data")


@pytest.fixture(scope="module")
def built(whole_data, tmp_path_factory) -> Path:
    """A work folder with clips, gestures and the database."""
    return commands(BUILD, whole_data, tmp_path_factory.mktemp("small") / "work")


@pytest.fixture
def work(built, tmp_path) -> Path:
    return Path(shutil.copytree(built, tmp_path / "work"))


@pytest.fixture
def data(whole_data, tmp_path) -> Path:
    return Path(shutil.copytree(whole_data, tmp_path / "data"))


def only_error(result) -> str:
    """The one line of what a command refuses, before the count of failures."""
    assert result.exit_code == 1 and "bug" not in result.output, result.output
    found = errors(result)
    if len(found) > 1:
        assert found.pop().endswith("failed")
    assert len(found) == 1, found
    return found[0]


def refused_build(data: Path, work: Path, *options) -> str:
    """Why no database is built; nothing but whole parts is left of it."""
    commands(("preprocess",), data, work, *options)
    line = only_error(command("build-graph", data, work, *options))
    assert not list((work / "graphs").rglob("*.npz")) and not list(work.rglob(".*"))
    for path in work.glob("gestures/*"):
        assert "made_of" in np.load(path)
    result = command("reenact", data, work, *options)
    assert result.exit_code == 1 and len(errors(result)) == len(TESTS) + 1
    assert all("has not been built; run `gesturegen build-graph` first" in line for line in errors(result)[:-1])
    assert not list((work / "reenact").glob("*.bvh"))
    return line


def rewrite(data: Path, name: str, bones=None, seconds: float = 6.0, **options) -> None:
    """The reference anew, on other bones; options as of `gesture_builders.motion`."""
    moved = gesture_builders.motion(np.random.default_rng(5), round(30 * seconds), bones, **options)
    usual.write_recording(data, name, seconds, 5, motion=moved)


# --- skeletons ----------------------------------------------------------------------------------------------


def larger() -> object:
    """The same joints with longer bones."""
    bones = gesture_builders.skeleton()
    return make_skeleton(bones.names, bones.parents, 1.5 * bones.offsets)


@pytest.mark.slow
def test_references_of_two_skeletons(data, tmp_path):
    rewrite(data, "trn_b", larger())
    line = refused_build(data, tmp_path / "work")
    assert "clips trn_a and trn_b cannot share a graph" in line and "choose clips of one skeleton" in line
    # By themselves they will do.
    commands(RESULT[1:], data, tmp_path / "work", *settings("references.mode=per_test_clip"))


@pytest.mark.slow
def test_two_skeletons_are_found_where_their_parts_are_stored(data, tmp_path):
    work = tmp_path / "work"
    rewrite(data, "trn_c", larger())
    (data / "tst/metadata.csv").write_text("prefix,main-agent_id\ntst_a,1\ntst_b,2\n")
    commands(BUILD, data, work, *settings("references.mode=speaker"))
    assert set(parts(work)) == set(usual.REFERENCES)
    shutil.rmtree(work / "graphs")
    line = only_error(command("build-graph", data, work))
    assert "clips trn_a and trn_c cannot share a graph" in line
    assert not list((work / "graphs").rglob("*.npz"))


def test_two_skeletons_are_found_in_every_group_that_has_them(data, tmp_path):
    # trn_b leads the second group, and does not fit the first.
    rewrite(data, "trn_a", larger())
    (tmp_path / "pins.yaml").write_text("tst_a: [trn_a, trn_b]\ntst_b: [trn_b, trn_c]\n")
    options = settings("references.mode=list", f"references.list={tmp_path / 'pins.yaml'}")
    commands(("preprocess",), data, tmp_path / "work", *options)
    line = only_error(command("build-graph", data, tmp_path / "work", *options))
    assert "clips trn_a and trn_b cannot share a graph" in line
    assert len(list((tmp_path / "work/graphs").glob("*.npz"))) == 1


@pytest.mark.slow
def test_a_skeleton_that_is_not_symmetric(data, tmp_path):
    bones = gesture_builders.skeleton()
    offsets = np.array(bones.offsets)
    offsets[bones.names.index("b_l_forearm")] *= 2
    for name in usual.REFERENCES:
        rewrite(data, name, make_skeleton(bones.names, bones.parents, offsets))
    line = refused_build(data, tmp_path / "work")
    assert "is not symmetric (joint 'b_l_" in line
    assert "give gesture_master.joint_pairs, or set gesture_master.mirror=false" in line
    commands(RESULT, data, tmp_path / "work", *settings("gesture_master.mirror=false"))


def test_joint_pairs_of_joints_that_are_not_there(whole_data, work):
    database(work).unlink()
    options = settings("gesture_master.joint_pairs=[[b_l_hand, b_r_hand]]")
    line = only_error(command("build-graph", whole_data, work, *options))
    assert "a mirror pair names joint 'b_l_hand', which the skeleton does not have, nearest is" in line


# --- lists --------------------------------------------------------------------------------------------------


def corrections(folder: Path, *rows: str) -> tuple[str, ...]:
    path = folder / "corrections.csv"
    path.write_text("clip,start,bits\n" + "".join(f"{row}\n" for row in rows))
    return settings(f"gesture_master.rhythm.corrections_file={path}")


def test_a_correction_of_a_start_that_no_clip_has(data, tmp_path):
    line = refused_build(data, tmp_path / "work", *corrections(tmp_path, f"trn_b,0.31,{'01' * 16}"))
    assert "no gesture clip of trn_b starts at 0.31 s; the nearest starts at 0.00" in line


def test_a_pattern_that_matches_no_gesture_clip_is_refused(whole_data, work):
    name = np.load(database(work))["names"].tolist()[0]
    options = settings(f"gesture_master.quality={{include: ['{name}', 'trn_b@?.??'], exclude: ['trn_b@999.99']}}")
    line = only_error(command("build-graph", whole_data, work, *options))
    assert "gesture_master.quality.exclude: 'trn_b@999.99' matches no gesture clip; did you mean 'trn_b@" in line


def test_a_correction_of_no_recording_is_refused(whole_data, built, work, tmp_path):
    result = command("build-graph", whole_data, work, *corrections(tmp_path, f"trn_z,0.0,{'01' * 16}"))
    assert result.exit_code == 1
    assert "rhythm.corrections: 'trn_z' matches no reference clip; did you mean 'trn_c'?" in result.output
    (own,), (before,) = (np.load(database(place))["rhythms"][None] for place in (work, built))
    assert (own == before).all()


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("trn_a,0.0,0101", "bits"),
        (f"trn_a,0.0,{'02' * 16}", "bits"),
        (f"trn_a,soon,{'01' * 16}", "start"),
        (f"trn_a,-1,{'01' * 16}", "start"),
    ],
)
def test_a_bad_row_of_corrections(row, words, whole_data, work, tmp_path):
    before = tree(work)
    options = corrections(tmp_path, f"trn_a,0.0,{'01' * 16}", row)
    line = only_error(command("build-graph", whole_data, work, *options))
    assert f"{tmp_path / 'corrections.csv'}:3: " in line and words in line and tree(work) == before


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("tst_a,5,3,30,,", "`to` must be later than `from`"),
        ("tst_a,0,5,fast,,", "speed: found"),
        ("tst_a,0", "3"),
        ("tst_a,,5,30,,", "from"),
    ],
)
def test_a_bad_row_of_targets(row, words, whole_data, work, tmp_path):
    path, before = tmp_path / "targets.csv", tree(work)
    path.write_text(f"clip,from,to,speed,radius,height\ntst_a,0,5,30,,\n{row}\n")
    options = settings("gesture_master.style.source=targets", f"gesture_master.style.targets_file={path}")
    line = only_error(command("reenact", whole_data, work, *options))
    assert f"{path}:3: " in line and words in line and tree(work) == before


def test_a_list_that_is_not_there(whole_data, work):
    options = settings("gesture_master.style.source=targets", "gesture_master.style.targets_file=none.csv")
    line = only_error(command("reenact", whole_data, work, *options))
    assert "gesture_master.style.targets_file: 'none.csv' does not exist" in line
    line = only_error(command("reenact", whole_data, work, *settings("gesture_master.style.source=targets")))
    assert "needs the key `targets_file`" in line


@pytest.mark.parametrize(
    ("quality", "why"),
    [("exclude=['*']", "trn_a@0.00: excluded"), ("max_speed=1.0", " cm/s, above 1)"), ("max_turn=0.1", "above 0.1")],
)
def test_all_clips_dropped(quality, why, data, tmp_path):
    line = refused_build(data, tmp_path / "work", *settings(f"gesture_master.quality.{quality}"))
    assert "no gesture clip is left of 3 references (" in line and why in line
    assert "give longer references, or change gesture_master.quality" in line


# --- prosody ------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_prosody_that_was_not_measured(data, tmp_path):
    work = tmp_path / "work"
    options = settings("prosody.enabled=false", "gesture_master.style.source=none")
    commands(("preprocess",), data, work, *options)
    line = only_error(command("build-graph", data, work))
    assert "holds no prosody, the config says prosody.enabled: true; run `gesturegen preprocess` again" in line
    assert not list(work.rglob("*-gestures.npz"))
    # `run` mends it.
    commands(("run",), data, work)
    assert tree(work / "clips") == tree(commands(("preprocess",), data, tmp_path / "fresh") / "clips")


def test_predicting_style_without_prosody(whole_data, work):
    before = tree(work)
    for name in (*BUILD, "reenact", "run"):
        line = only_error(command(name, whole_data, work, *settings("prosody.enabled=false")))
        assert "style.source: predict needs prosody.enabled: true" in line and "targets or none" in line
    assert tree(work) == before


# --- stored databases ---------------------------------------------------------------------------------------


def refused_search(data: Path, work: Path, words: str, *options) -> None:
    """Every test is refused with these words, and its earlier result is gone."""
    result = command("reenact", data, work, *options)
    assert result.exit_code == 1 and len(errors(result)) == len(TESTS) + 1, result.output
    for line in errors(result)[:-1]:
        assert words in line and str(database(work)) in line
    assert not list((work / "reenact").glob("*.bvh"))
    rows = json.loads((work / "reenact/manifest.json").read_text())["clips"]
    assert [words in row["error"] for row in rows] == [True, True]


@pytest.mark.parametrize("left", [0, 100, 5000, -30])
def test_a_damaged_database(left, whole_data, built, work):
    commands(("reenact",), whole_data, work)
    database(work).write_bytes(database(work).read_bytes()[:left])
    refused_search(whole_data, work, "damaged")
    commands(("run",), whole_data, work)
    assert tree(work / "graphs") == tree(built / "graphs")


@pytest.mark.slow
def test_a_database_of_another_format(whole_data, built, work):
    arrays = dict(np.load(database(work)))
    stored_arrays.write(database(work), arrays | {"format_version": np.array(99)})
    refused_search(whole_data, work, "format 99, this version reads")
    del arrays["twins"]
    stored_arrays.write(database(work), arrays)
    refused_search(whole_data, work, "no array 'twins' in it")
    commands(("run",), whole_data, work)
    assert tree(work / "graphs") == tree(built / "graphs")


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ("gesture_master.upper.delta_t=3.0", 'gesture_master.upper.delta_t = 8.0, the config says 3.0'),
        ("gesture_master.mirror=false", "gesture_master.mirror = true, the config says false"),
        ("gesture_master.cutting.gap_seconds=0.3", "gap_seconds = 0.2, the config says 0.3"),
    ],
)  # fmt: skip
def test_a_database_of_other_settings(changed, named, whole_data, work):
    refused_search(whole_data, work, named, *settings(changed))


def test_a_database_of_clips_that_changed(data, work):
    path = data / "trn/main-agent/tsv/trn_b.tsv"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[1:]))
    commands(("preprocess",), data, work)
    refused_search(data, work, "its clips were preprocessed again since; run `gesturegen build-graph` again")


def test_a_graph_of_the_other_method_is_no_database(whole_data, work):
    options = settings("method=motion_graph", "blend.method=crossfade")
    commands(("build-graph",), whole_data, work, *options)
    (graph,) = (path for path in (work / "graphs").glob("*.npz") if path != database(work))
    shutil.copy(graph, database(work))
    result = command("reenact", whole_data, work)
    assert result.exit_code == 1 and "bug" not in result.output and len(errors(result)) == 3
    assert all("build-graph" in line for line in errors(result)[:-1])


# --- scanty speeches and references -------------------------------------------------------------------------

SPEECHES = {
    "no_transcript": {"words": None},
    "empty_transcript": {"words": ()},
    "noise": {"words": None, "onsets": ()},
    "empty_noise": {"words": (), "onsets": ()},
}


@pytest.fixture(scope="module")
def scanty(whole_data, built, tmp_path_factory) -> tuple[Path, Path, str]:
    """Data, work folder and output of tests that say little, beside the usual ones."""
    folder = tmp_path_factory.mktemp("scanty")
    data, work = shutil.copytree(whole_data, folder / "data"), shutil.copytree(built, folder / "work")
    for name, options in SPEECHES.items():
        usual.write_recording(data, f"tst_{name}", 4.0, 30, **options)
    write_audio(data / "tst/main-agent/wav/tst_silence.wav", np.zeros(64000))
    write_audio(data / "tst/main-agent/wav/tst_short.wav", np.zeros(1600))
    commands(("preprocess",), data, work)
    result = command("reenact", data, work)
    assert result.exit_code == 0, result.output
    commands(("evaluate", "check"), data, work)
    return data, work, result.output


@pytest.mark.parametrize(
    ("name", "frames", "note"),
    [
        ("no_transcript", 120, "no words, so its onsets and the sound of its voice stand for them"),
        ("empty_transcript", 120, "no words, so its onsets and the sound of its voice stand for them"),
        ("noise", 120, "no words, no onsets and no voice, so all of it is rest"),
        ("empty_noise", 120, "no words, no onsets and no voice, so all of it is rest"),
        ("silence", 120, "no words, no onsets and no voice, so all of it is rest"),
        ("short", 3, "no words, no onsets and no voice, so all of it is rest"),
    ],
)
def test_a_speech_that_says_little(name, frames, note, scanty):
    _, work, output = scanty
    assert f"warning: tst_{name}: {note}" in output
    assert bvh.read(work / f"reenact/tst_{name}.bvh").n_frames == frames
    found = trace(work, f"tst_{name}")
    assert note in found["notes"]
    if note.endswith("rest"):
        assert {piece["end_kind"] for piece in found["pieces"]} == {"rest"}
        # A rest shows a rest.
        stored = np.load(database(work))
        first = np.searchsorted(stored["starts"], [piece["nodes"][0] for piece in found["pieces"]])
        assert stored["rests"][first].all()


def test_the_other_speeches_are_unharmed(scanty, whole_data, work):
    commands(("reenact",), whole_data, work)
    for test in TESTS:
        assert (work / f"reenact/{test}.bvh").read_bytes() == (scanty[1] / f"reenact/{test}.bvh").read_bytes()


def test_a_speech_that_cannot_be_read_harms_no_other(data, work):
    (data / "tst/main-agent/wav/tst_a.wav").write_bytes(b"RIFF")
    result = command("run", data, work)
    assert result.exit_code == 1 and len([line for line in errors(result) if "cut off" in line]) == 1
    assert bvh.read(work / "reenact/tst_b.bvh").n_frames == 120 and not (work / "reenact/tst_a.bvh").exists()


def test_references_without_transcripts(data, tmp_path):
    shutil.rmtree(data / "trn/main-agent/tsv")
    work = commands(RESULT, data, tmp_path / "work")
    facts = inspected(database(work))
    assert facts["gesture_clips"]["gestures"] > 0 and {one["gesture_clips"] > 0 for one in facts["recordings"]} == {
        True
    }


def test_a_silent_reference_is_all_rest(data, tmp_path):
    usual.write_recording(data, "trn_b", 6.0, 1, words=None, onsets=())
    work = commands(RESULT, data, tmp_path / "work")
    clips = [clip for clip in inspected(database(work))["clips"] if clip["name"].startswith("trn_b")]
    assert clips and {clip["kind"] for clip in clips} == {"rest"}


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.1, 0.4])
def test_a_reference_shorter_than_a_clip(seconds, data, tmp_path):
    moved = gesture_builders.motion(np.random.default_rng(0), round(30 * seconds))
    usual.write_recording(data, "trn_b", seconds, 1, motion=moved, words=None, onsets=())
    work = commands(RESULT, data, tmp_path / "work")
    facts = inspected(database(work))
    assert [one["gesture_clips"] > 0 for one in facts["recordings"]] == [True, False, True]
    assert facts["dropped"] == [{"clip": "trn_b@0.00", "reason": f"{seconds:.2f} s long, below 0.5"}]


def test_only_references_shorter_than_a_clip(data, tmp_path):
    for name in usual.REFERENCES:
        moved = gesture_builders.motion(np.random.default_rng(0), 12)
        usual.write_recording(data, name, 0.4, 1, motion=moved, words=None, onsets=())
    line = refused_build(data, tmp_path / "work")
    assert "no gesture clip is left of 3 references" in line and "0.40 s long, below 0.5" in line
    assert "give longer references" in line


def test_an_unreadable_reference_is_left_out(data, tmp_path):
    (data / "trn/main-agent/bvh/trn_b.bvh").write_text("")
    result = command("run", data, tmp_path / "work")
    assert result.exit_code == 1 and ["the file is empty" in line for line in errors(result)[:-1]] == [True]
    names = {one["clip"] for one in inspected(database(tmp_path / "work"))["recordings"]}
    assert names == {"trn_a", "trn_c"} and len(list((tmp_path / "work/reenact").glob("*.bvh"))) == 2


def fingers_move(path: Path) -> float:
    motion = bvh.read(path)
    joints = [motion.skeleton.names.index(name) for name in gesture_builders.FINGERS]
    return float(np.abs(np.diff(motion.rotations[:, joints], axis=0)).max())


@pytest.mark.slow
def test_references_without_fingers_beside_one_with(data, tmp_path):
    for name in ("trn_a", "trn_b"):
        rewrite(data, name, fingers=False)
    work = commands(RESULT, data, tmp_path / "work")
    clips = inspected(database(work))["clips"]
    for clip in clips:
        assert (clip["fingers_of"] is None) == clip["name"].startswith("trn_c")
        assert clip["fingers_of"] is None or clip["fingers_of"]["name"].startswith("trn_c")
    assert all(fingers_move(work / f"reenact/{test}.bvh") > 1e-3 for test in TESTS)
    borrowed = [len(trace(work, test)["tracks"]) for test in TESTS]
    assert max(borrowed) == 2
    options = settings("gesture_master.finger_transfer=false")
    commands(RESULT, data, work, *options)
    assert [len(trace(work, test)["tracks"]) for test in TESTS] == [1, 1]


@pytest.mark.slow
def test_no_fingers_at_all(data, tmp_path):
    for name in usual.REFERENCES:
        rewrite(data, name, fingers=False)
    work = commands(RESULT, data, tmp_path / "work")
    assert inspected(database(work))["clips_with_fingers_of_others"] == 0
    assert all(fingers_move(work / f"reenact/{test}.bvh") < 1e-4 for test in TESTS)


@pytest.mark.parametrize("broken", ["extract", "link"])
def test_a_bug_is_told_once_and_leaves_no_database(broken, whole_data, built, work, monkeypatch):
    database(work).unlink()
    shutil.rmtree(work / "gestures")
    with monkeypatch.context() as patch:
        place = build_database if broken == "extract" else build_database.database
        patch.setattr(place, broken, lambda *arguments: 1 / 0)
        result = command("build-graph", whole_data, work)
    assert result.exit_code == 1 and "bug: multi-" in result.output and "ZeroDivisionError" in result.output
    lines = [line for line in result.output.splitlines() if line.lower().startswith("error: ")]
    assert lines == ["error: 1 of 1 failed"]
    assert not list((work / "graphs").rglob("*.npz"))
    commands(("build-graph",), whole_data, work)
    assert tree(work) == tree(built)


# --- commands out of order ----------------------------------------------------------------------------------


def test_commands_out_of_order(whole_data, work, tmp_path):
    for name in ("build-graph", "reenact"):
        assert "nothing has been preprocessed there" in only_error(command(name, whole_data, tmp_path / "none"))
    assert "nothing has been reenacted there" in only_error(command("evaluate", whole_data, work))

"""`method: gesture_master` from files to files: its commands, what is done again, and what its settings bring."""

import csv
import json
import shutil
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gesturegen.demo import dataset
from gesturegen.methods.gesture_master import building as build_database
from gesturegen.motion import bvh
from gesturegen.settings.loading import configs_folder
from gesturegen.stored import arrays as stored_arrays
from tests import tiny
from tests.builders import chain, write_clip
from tests.commands import errors, run, succeed, tree
from tests.faults.faulty import Fault, run_with
from tests.methods.gesture_master import gesture_builders

PAPER = configs_folder() / "gesture_master_2022.yaml"
CUTTING = "gesture_master.cutting={gap_seconds: 0.2, rest_seconds: 0.6, min_seconds: 0.5, max_seconds: 2.0}"
REFERENCES = ("trn_a", "trn_b", "trn_c")
TESTS = ("tst_a", "tst_b")
RESULT = ("preprocess", "build-graph", "reenact", "check")
STAGES = ("preprocess", "build-graph", "reenact", "evaluate", "pack")


def settings(*pairs: str) -> tuple[str, ...]:
    """Options that set each of `pairs`."""
    return tuple(word for pair in pairs for word in ("--set", pair))


# Clips of 0.5 to 2 s, of recordings of a few seconds; few values of a narrow range of pitch, which are soon measured.
SMALL = (
    "--config",
    PAPER,
    *settings("joints=all", "wrists.enabled=false", CUTTING),
    *settings("prosody.hop_length=800", "prosody.pitch_min=150.0", "prosody.pitch_max=300.0"),
)


def write_recording(data: Path, name: str, seconds: float, seed: int, **options) -> None:
    """A recording of data in GENEA's layout with random words; options as of `write_clip`."""
    rng = np.random.default_rng(seed)
    spoken = gesture_builders.words(rng, round(seconds * 30))
    usual = {"onsets": [start / 30 for _, start, _ in spoken], "words": [(s / 30, e / 30, t) for t, s, e in spoken]}
    if name.startswith("trn"):
        usual["motion"] = gesture_builders.motion(rng, round(seconds * 30))
    else:
        usual["with_motion"] = False
    (data / name[:3] / f"main-agent/tsv/{name}.tsv").unlink(missing_ok=True)
    write_clip(data / name[:3], name, seconds, **usual | options)


def write_data(data: Path) -> Path:
    """Three references of a few seconds and two tests, of one speaker but for `trn_c`."""
    for seed, (name, seconds) in enumerate(zip(REFERENCES, (8.0, 6.0, 7.0), strict=True)):
        write_recording(data, name, seconds, seed)
    for seed, name in enumerate(TESTS):
        write_recording(data, name, 4.0, 10 + seed)
    for split, names in (("trn", REFERENCES), ("tst", TESTS)):
        rows = [f"{name},{1 + name.endswith('c')}\n" for name in names]
        (data / split / "metadata.csv").write_text("prefix,main-agent_id\n" + "".join(rows))
    return data


def command(name: str, data: Path, work: Path, *options):
    return run(name, *SMALL, "--data", data, "--work", work, "-j", 1, *options)


def commands(names: Sequence[str], data: Path, work: Path, *options) -> Path:
    for name in names:
        result = command(name, data, work, *options)
        assert result.exit_code == 0, result.output
    return work


@pytest.fixture(scope="module")
def whole_data(tmp_path_factory) -> Path:
    return write_data(tmp_path_factory.mktemp("small") / "data")


@pytest.fixture(scope="module")
def whole(whole_data, tmp_path_factory) -> Path:
    """The work folder of all commands on it."""
    return commands(STAGES, whole_data, tmp_path_factory.mktemp("small") / "work")


@pytest.fixture
def work(whole, tmp_path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "work"))


@pytest.fixture
def data(whole_data, tmp_path) -> Path:
    """Data that a test may change."""
    return Path(shutil.copytree(whole_data, tmp_path / "data"))


def stamps(work: Path) -> dict[str, int]:
    """When each stored file was written."""
    return {str(path.relative_to(work)): path.stat().st_mtime_ns for path in sorted(work.rglob("*")) if path.is_file()}


def rewritten(work: Path, before: dict[str, int], *folders: str) -> set[str]:
    """Stored clips, gestures, databases and results that are new since `before`."""
    places = folders or ("clips", "gestures", "graphs", "reenact", "evaluate")
    now = stamps(work)
    return {
        name
        for name in now
        if name.split("/")[0] in places
        and now[name] != before.get(name)
        and not name.endswith(("index.json", "manifest.json"))
    }


def parts(work: Path) -> dict[str, Path]:
    """The stored gestures of each recording."""
    return {path.name.split("-")[0]: path for path in sorted((work / "gestures").glob("*.npz"))}


def database(work: Path) -> Path:
    (found,) = (work / "graphs").glob("*-gestures.npz")
    return found


def trace(work: Path, name: str) -> dict:
    return json.loads((work / "reenact" / f"{name}.trace.json").read_text())


def inspected(path: Path) -> dict:
    return json.loads(succeed("inspect", path, "--json").output)


def shown(work: Path) -> list[str]:
    """Names of the gesture clips that the tests show."""
    stored = np.load(database(work))
    names = dict(zip(stored["starts"].tolist(), stored["names"].tolist(), strict=True))
    return [names[piece["nodes"][0]] for test in TESTS for piece in trace(work, test)["pieces"]]


# --- all commands -------------------------------------------------------------------------------------------


def test_a_run_is_the_five_commands(whole_data, whole, tmp_path):
    result = command("run", whole_data, tmp_path / "run")
    assert result.exit_code == 0 and errors(result) == []
    assert tree(tmp_path / "run") == tree(whole)


@pytest.mark.slow
def test_workers_change_no_byte(whole_data, whole, tmp_path):
    for stage in STAGES:
        succeed(stage, *SMALL, "--data", whole_data, "--work", tmp_path / "two", "-j", 2)
    assert tree(tmp_path / "two") == tree(whole)


def test_what_is_stored(whole):
    assert len(list((whole / "gestures").iterdir())) == len(REFERENCES)
    assert [path.name for path in (whole / "graphs").iterdir()] == [database(whole).name]
    stored = np.load(database(whole))
    assert stored["clip_names"].tolist() == [*REFERENCES, *REFERENCES]
    assert stored["mirrored"].tolist() == [False] * 3 + [True] * 3


def test_the_database_does_not_depend_on_the_blocks_of_edges(whole_data, whole, work, monkeypatch):
    database(work).unlink()
    monkeypatch.setattr(build_database, "BLOCK", 5)
    commands(("build-graph",), whole_data, work)
    assert tree(work) == tree(whole)


# --- the demo dataset ---------------------------------------------------------------------------------------

DEMO_TESTS = ("tst_2023_v0_000_main-agent", "tst_2023_v0_001_main-agent")


def demo(name: str, folder: Path, work: Path, *options):
    return succeed(name, "--config", PAPER, "--data", folder / "data", "--work", work, "-j", 1, *options)


@pytest.fixture(scope="module")
def demo_folder(tmp_path_factory) -> Path:
    """Demo recordings in `data`, and what all commands make of them with the paper's values in `work`."""
    folder = tmp_path_factory.mktemp("demo")
    specs = dataset.clip_specs(references=2, tests=2, seed=0, reference_seconds=(20.0, 20.0), test_seconds=(12.0, 12.0))
    for spec in specs:
        dataset.write_clip(folder / "data", spec)
    dataset.write_metadata(folder / "data", specs)
    for stage in STAGES:
        demo(stage, folder, folder / "work")
    return folder


@pytest.fixture
def demo_work(demo_folder, tmp_path) -> Path:
    return Path(shutil.copytree(demo_folder / "work", tmp_path / "demo_work"))


def test_every_clip_is_a_valid_submission_of_the_right_length(demo_folder):
    assert "2 clips, all valid" in demo("check", demo_folder, demo_folder / "work").output
    for name in DEMO_TESTS:
        motion = bvh.read(demo_folder / "work/reenact" / f"{name}.bvh")
        assert (
            motion.n_frames == 360 == trace(demo_folder / "work", name)["n_frames"] and len(motion.skeleton.names) == 83
        )


def test_the_manifest_says_what_was_run(demo_folder):
    manifest = json.loads((demo_folder / "work/reenact/manifest.json").read_text())
    assert (manifest["method"], manifest["search"]) == ("gesture_master", "viterbi")
    assert [row["clip"] for row in manifest["clips"]] == list(DEMO_TESTS)


def test_the_table_has_rhythm_agreement(demo_folder):
    lines = (demo_folder / "work/evaluate/metrics.csv").read_text().splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    names = [name for name in rows[0] if name.startswith("rhythm")]
    assert names, list(rows[0])
    for row in rows[:2]:
        assert all(0.4 < float(row[name]) < 1 for name in names)


@pytest.mark.parametrize("name", DEMO_TESTS)
def test_the_trace_tells_of_both_bodies(name, demo_folder):
    found = trace(demo_folder / "work", name)
    lower = found["tracks"][0]
    assert "body_world" in lower["joints"] or "b_root" in lower["joints"]
    assert "b_r_wrist" not in lower["joints"] and "b_r_foot" in lower["joints"]
    for pieces in (found["pieces"], lower["pieces"]):
        assert pieces[0]["start_frame"] == 0 and pieces[-1]["end_frame"] == found["n_frames"]
        assert all(one["end_frame"] == other["start_frame"] for one, other in pairwise(pieces))
    assert {piece["end_kind"] for piece in found["pieces"]} <= {"clip", "rest"}
    assert set(found["objective"]) == {"upper", "lower"}
    total = sum(piece["cost"] for piece in found["pieces"])
    assert found["objective"]["upper"]["total"] == pytest.approx(total, rel=1e-6)


@pytest.mark.slow
def test_report_beside_the_other_method(demo_folder, demo_work, tmp_path):
    other = Path(shutil.copytree(demo_folder / "work", tmp_path / "other"))
    for stage in ("build-graph", "reenact", "evaluate"):
        demo(stage, demo_folder, other, *settings("method=motion_graph", "blend.method=crossfade"))
    result = demo("report", demo_folder, demo_work, "--compare", f"graph={other}")
    assert "2 clips to watch, 0 failed" in result.output
    assert "graph" in (demo_work / "report.html").read_text()
    # And the other way round.
    options = settings("method=motion_graph", "blend.method=crossfade")
    assert (
        "2 clips to watch, 0 failed"
        in demo("report", demo_folder, other, *options, "--compare", f"master={demo_work}").output
    )


@pytest.mark.slow
def test_export_and_inspect(demo_work, tmp_path):
    succeed("export", demo_work / "reenact", "--format", "csv", "--format", "npz", "--out", tmp_path / "out", "-j", 1)
    assert np.load(tmp_path / "out" / f"{DEMO_TESTS[0]}.npz")["positions"].shape[0] == 360
    plain = succeed("inspect", DEMO_TESTS[0], "--work", demo_work, "--plot", tmp_path / "trace.png")
    assert "pieces" in plain.output and "another one now" not in plain.output and (tmp_path / "trace.png").is_file()
    lines = succeed("inspect", database(demo_work), "--plot", tmp_path / "database.png").output.splitlines()
    assert lines[0].startswith("gesture database: 2 recordings, each also mirrored; 1200 frames (40.0 s at 30 fps)")
    assert (tmp_path / "database.png").is_file()
    facts = inspected(database(demo_work))
    assert facts["gesture_clips"]["total"] == 2 * len(facts["clips"])


def test_pack_is_what_was_reenacted(demo_work):
    for name in DEMO_TESTS:
        packed = demo_work / "submission" / f"{name}.bvh"
        assert packed.read_bytes() == (demo_work / "reenact" / packed.name).read_bytes()
    assert (demo_work / "submission.zip").is_file()


@pytest.mark.slow
def test_render(demo_folder, demo_work):
    (demo_work / "reenact" / f"{DEMO_TESTS[1]}.bvh").unlink()
    result = demo("render", demo_folder, demo_work)
    assert (demo_work / "video" / f"{DEMO_TESTS[0]}.mp4").stat().st_size > 10_000, result.output


def hand_speed(work: Path, test: str) -> float:
    """Mean hand speed of the gesture clips that a test shows, weighted by frames."""
    stored = np.load(database(work))
    pieces = [piece for piece in trace(work, test)["pieces"] if piece["end_kind"] == "clip"]
    clips = np.searchsorted(stored["starts"], [piece["nodes"][0] for piece in pieces])
    return float(np.average(stored["styles"][clips, 0], weights=[len(piece["nodes"]) for piece in pieces]))


@pytest.mark.slow
def test_a_target_moves_the_speed_of_the_hands(demo_folder, demo_work, tmp_path):
    speeds = {}
    for wanted in (1, 400):
        (tmp_path / "targets.csv").write_text(f"clip,from,to,speed,radius,height\ntst_*,0,100,{wanted},,\n")
        options = settings(
            "gesture_master.style.source=targets", f"gesture_master.style.targets_file={tmp_path / 'targets.csv'}",
            "gesture_master.upper.lambda_5=1000",
        )  # fmt: skip
        demo("build-graph", demo_folder, demo_work, *options)
        demo("reenact", demo_folder, demo_work, *options)
        speeds[wanted] = [hand_speed(demo_work, test) for test in DEMO_TESTS]
    assert np.mean(speeds[1]) < 0.9 * np.mean(speeds[400]), speeds
    assert all(slow <= fast for slow, fast in zip(speeds[1], speeds[400], strict=True)), speeds


# --- what is done again -------------------------------------------------------------------------------------


def test_a_lost_database_and_a_lost_part_are_made_again(whole_data, whole, work):
    database(work).unlink()
    parts(work)["trn_b"].unlink()
    before = stamps(work)
    commands(("build-graph",), whole_data, work)
    assert rewritten(work, before) == {f"graphs/{database(work).name}", f"gestures/{parts(work)['trn_b'].name}"}
    assert tree(work) == tree(whole)


def truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-200])


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def of_another_version(path: Path) -> None:
    arrays = dict(np.load(path))
    stored_arrays.write(path, arrays | {"made_of": np.array("0" * 64)})


def of_before_versions(path: Path) -> None:
    arrays = dict(np.load(path))
    del arrays["made_of"]
    stored_arrays.write(path, arrays)


@pytest.mark.parametrize("harm", [truncated, emptied, of_another_version, of_before_versions])
def test_a_part_that_is_not_whole_or_not_current_is_made_again(harm, whole_data, whole, work):
    database(work).unlink()
    harm(parts(work)["trn_c"])
    before = stamps(work)
    commands(("build-graph",), whole_data, work)
    assert rewritten(work, before, "gestures") == {f"gestures/{parts(work)['trn_c'].name}"}
    assert tree(work) == tree(whole)


def interrupted(monkeypatch, data: Path, work: Path, after: int) -> Path:
    """A build that is stopped after some of its blocks of edges; returns where they are."""
    database(work).unlink()
    link, calls = build_database.database.link, []

    def stopped(*arguments):
        calls.append(arguments)
        if len(calls) > after:
            raise KeyboardInterrupt
        return link(*arguments)

    monkeypatch.setattr(build_database, "BLOCK", 5)
    with monkeypatch.context() as patch:
        patch.setattr(build_database.database, "link", stopped)
        assert command("build-graph", data, work).exit_code == 1
    (folder,) = (work / "graphs").glob("*.blocks")
    return folder


def test_an_interrupted_build_goes_on_where_it_stopped(whole_data, whole, work, monkeypatch):
    blocks = interrupted(monkeypatch, whole_data, work, 3)
    assert len(list(blocks.iterdir())) == 3 and not list((work / "graphs").glob("*.npz"))
    linked = []
    link = build_database.database.link
    monkeypatch.setattr(
        build_database.database, "link", lambda *arguments: (linked.append(arguments), link(*arguments))[1]
    )
    before = stamps(work)
    commands(("build-graph",), whole_data, work)
    stored = np.load(database(whole))
    assert len(linked) == 2 * -(-len(stored["starts"]) // 5) - 3
    assert rewritten(work, before, "gestures") == set() and not blocks.exists()
    assert tree(work) == tree(whole)


def test_damaged_blocks_are_made_again(whole_data, whole, work, monkeypatch):
    blocks = interrupted(monkeypatch, whole_data, work, 4)
    for path, harm in zip(sorted(blocks.iterdir()), (truncated, emptied, of_another_version), strict=False):
        harm(path)
    commands(("build-graph",), whole_data, work)
    assert tree(work) == tree(whole)


@pytest.mark.slow
def test_blocks_of_other_settings_are_not_used(whole_data, work, tmp_path, monkeypatch):
    options = settings("gesture_master.upper.delta_t=3.0")
    interrupted(monkeypatch, whole_data, work, 6)
    commands(("build-graph",), whole_data, work, *options)
    fresh = Path(shutil.copytree(work / "clips", tmp_path / "fresh/clips")).parent
    commands(("build-graph",), whole_data, fresh, *options)
    assert tree(work / "graphs") == tree(fresh / "graphs")


def test_blocks_beside_a_whole_database_are_removed(whole_data, whole, work):
    # A build that was killed between storing the database and removing them.
    left = database(work).with_suffix(".blocks")
    left.mkdir()
    (left / "upper-0.npz").write_bytes(b"left over")
    commands(("run",), whole_data, work)
    assert tree(work) == tree(whole) and not left.exists()


def test_run_does_nothing_twice(whole_data, whole, work):
    before = stamps(work)
    commands(("run",), whole_data, work)
    assert rewritten(work, before) == set()
    assert tree(work) == tree(whole)


@pytest.mark.slow
def test_force_does_everything_again(whole_data, whole, work):
    before = stamps(work)
    commands(("run",), whole_data, work, "--force")
    assert rewritten(work, before, "clips", "graphs", "reenact") == {
        name
        for name in before
        if name.split("/")[0] in ("clips", "graphs", "reenact") and not name.endswith(("index.json", "manifest.json"))
    }
    assert tree(work) == tree(whole)


def folders(names: set[str]) -> set[str]:
    return {name.split("/")[0] for name in names}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "redone"),
    [
        ("gesture_master.upper.lambda_6=2.0", {"reenact", "evaluate"}),
        pytest.param("gesture_master.time_scale.lambda_scale=1.0", {"reenact", "evaluate"}, marks=pytest.mark.slow),
        pytest.param("gesture_master.upper.delta_t=3.0", {"graphs", "reenact", "evaluate"}, marks=pytest.mark.slow),
        pytest.param("gesture_master.style.ridge=1.0", {"graphs", "reenact", "evaluate"}, marks=pytest.mark.slow),
        ("gesture_master.cutting.gap_seconds=0.4", {"gestures", "graphs", "reenact", "evaluate"}),
        pytest.param(
            "gesture_master.rhythm.bits=16", {"gestures", "graphs", "reenact", "evaluate"}, marks=pytest.mark.slow
        ),
    ],
)
def test_a_changed_setting_redoes_what_depends_on_it(changed, redone, whole_data, work, tmp_path):
    before = stamps(work)
    commands(("run",), whole_data, work, *settings(changed))
    found = rewritten(work, before)
    assert folders(found) == redone
    # The same as in a folder of its own.
    fresh = Path(shutil.copytree(work / "clips", tmp_path / "fresh/clips")).parent
    commands(("build-graph", "reenact"), whole_data, fresh, *settings(changed))
    assert tree(work / "reenact") == tree(fresh / "reenact") and tree(work / "graphs") == tree(fresh / "graphs")


@pytest.mark.slow
def test_a_changed_recording_redoes_its_own_part_only(data, work, tmp_path):
    before = stamps(work)
    path = data / "trn/main-agent/tsv/trn_b.tsv"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[1:]))
    commands(("run",), data, work)
    found = rewritten(work, before, "clips", "gestures", "graphs")
    assert found == {"clips/trn_b.npz", f"gestures/{parts(work)['trn_b'].name}", f"graphs/{database(work).name}"}
    fresh = commands(("run",), data, tmp_path / "fresh")
    assert tree(work / "graphs") == tree(fresh / "graphs") and tree(work / "gestures") == tree(fresh / "gestures")
    assert tree(work / "reenact") == tree(fresh / "reenact")


def test_a_changed_sound_redoes_its_own_part_only(data, work):
    before = stamps(work)
    for name in ("trn_c", "tst_b"):
        source = data / name[:3] / "main-agent/wav"
        shutil.copy(source / f"{'trn_a' if name == 'trn_c' else 'tst_a'}.wav", source / f"{name}.wav")
    commands(("run",), data, work)
    assert rewritten(work, before, "clips", "gestures") == {
        "clips/trn_c.npz", "clips/tst_b.npz", f"gestures/{parts(work)['trn_c'].name}",
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_killed_build_goes_on_and_ends_the_same(jobs, tmp_path):
    data = tmp_path / "data"
    for seed in range(8):
        write_recording(data, f"trn_{seed}", 25.0, seed)
    write_recording(data, "tst_a", 4.0, 20)
    work, calm, log = tmp_path / "work", tmp_path / "calm", tmp_path / "log"
    commands(("preprocess",), data, work)
    shutil.copytree(work, calm)
    build = ["build-graph", *map(str, (*SMALL, "--data", data, "-j", jobs, "--work"))]
    whole = run_with([*build, str(calm)], calm, log)
    assert whole.code == 0, whole.output
    for _ in range(3):
        # A third of what the recordings need, so that the last one is reached in the third attempt.
        ended = run_with(
            [*build, str(work)], work, log, Fault(("gestures",), whole.changes["gestures"] // 4, "command", 9)
        )
        assert ended.struck and ended.code == -9
    commands(("build-graph",), data, work)
    # What a killed process was writing is left behind under a hidden name.
    hidden = [name for name in tree(work) if Path(name).name.startswith(".")]
    assert {name: value for name, value in tree(work).items() if name not in hidden} == tree(calm)


# --- both methods in one folder -----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["all", "per_test_clip"])
def test_both_methods_share_a_work_folder(mode, whole_data, work, tmp_path):
    options = settings(f"references.mode={mode}")
    build = ("build-graph", "reenact")
    commands(build, whole_data, work, *options)
    first = tree(work)
    graph = (*options, *settings("method=motion_graph", "blend.method=crossfade", "prosody.enabled=false"))
    commands(build, whole_data, work, *graph)
    alone = Path(shutil.copytree(work / "clips", tmp_path / "alone/clips")).parent
    commands(build, whole_data, alone, *graph)
    assert tree(work / "reenact") == tree(alone / "reenact")
    names = {name for name in tree(work / "graphs") if f"graphs/{name}" not in first}
    assert names == set(tree(alone / "graphs")) and not any("-gestures" in name for name in names)
    # The databases are still there, and current.
    commands(("reenact",), whole_data, work, *options)
    now = tree(work)
    assert {name: now[name] for name in first} == first


@pytest.mark.slow
def test_run_may_alternate_between_methods(whole_data, whole, work):
    commands(("run",), whole_data, work, *settings("method=motion_graph", "prosody.enabled=false"))
    before = stamps(work)
    commands(("run",), whole_data, work)
    assert rewritten(work, before, "clips", "gestures", "graphs") == set()
    assert tree(work / "reenact") == tree(whole / "reenact")


# --- references ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "sizes"), [("per_test_clip", {1}), ("k", {2}), ("speaker", {2}), ("all", {3})]
)  # fmt: skip
def test_modes_of_references(mode, sizes, whole_data, work):
    shutil.rmtree(work / "graphs")
    before = stamps(work)
    options = settings(f"references.mode={mode}", "references.k=2")
    commands(("build-graph", "reenact", "evaluate", "check"), whole_data, work, *options)
    assert rewritten(work, before, "gestures") == set()
    assert {len(inspected(path)["recordings"]) for path in (work / "graphs").glob("*.npz")} == sizes
    used = {clip["clip"] for test in TESTS for clip in trace(work, test)["references"]}
    assert used <= set(REFERENCES) and (mode != "speaker" or "trn_c" not in used)


def test_seconds_cut_the_references(whole_data, work):
    # All of trn_a and two seconds of trn_b; mirrored copies do not count.
    options = settings("references.seconds=10")
    shutil.rmtree(work / "graphs")
    commands(("build-graph", "reenact", "evaluate", "check"), whole_data, work, *options)
    facts = inspected(database(work))
    assert [(one["clip"], one["frames"]) for one in facts["recordings"]] == [("trn_a", 240), ("trn_b", 60)]
    assert max(clip["stop_seconds"] for clip in facts["clips"] if clip["name"].startswith("trn_b")) <= 2.0
    assert "-10s-gestures" in database(work).name
    names = {path.name.rsplit("-", 1)[0] for path in (work / "gestures").iterdir()}
    assert names == {*REFERENCES, "trn_b-60f"}, "what is whole is shared with all other lengths"


@pytest.mark.slow
def test_without_mirrored_copies(whole_data, whole, work):
    options = settings("gesture_master.mirror=false")
    commands(("build-graph", "reenact", "evaluate", "check"), whole_data, work, *options)
    facts = inspected(database(work))
    assert not facts["mirrored"] and facts["gesture_clips"]["total"] == len(facts["clips"])
    assert not any(clip["mirrored"] for test in TESTS for clip in trace(work, test)["references"])
    both = inspected(database(whole))
    assert [clip["name"] for clip in facts["clips"]] == [clip["name"] for clip in both["clips"]]


def test_without_style(whole_data, work):
    options = settings("gesture_master.style.source=none", "prosody.enabled=false")
    result = command("build-graph", whole_data, work, *options)
    assert result.exit_code == 0 and "style from prosody" not in result.output
    commands(("reenact", "evaluate"), whole_data, work, *options)
    assert all(piece["costs"]["style"] == 0 for test in TESTS for piece in trace(work, test)["pieces"])
    assert inspected(database(work))["regression"] is None


# --- lists --------------------------------------------------------------------------------------------------


def test_a_correction_is_used(whole_data, whole, work, tmp_path):
    clip = next(clip for clip in inspected(database(whole))["clips"] if clip["name"].startswith("trn_b"))
    bits = "01" * 16
    start = clip["name"].split("@")[1]
    (tmp_path / "corrections.csv").write_text(f"clip,start,bits\ntrn_b,{start},{bits}\n")
    options = settings(f"gesture_master.rhythm.corrections_file={tmp_path / 'corrections.csv'}")
    commands(("build-graph", "reenact"), whole_data, work, *options)
    found = {one["name"]: one["bits"] for one in inspected(database(work))["clips"]}
    expected = {one["name"]: one["bits"] for one in inspected(database(whole))["clips"]}
    assert found == expected | {clip["name"]: bits}


def test_an_excluded_clip_is_shown_nowhere(whole_data, whole, work):
    before = shown(whole)
    named = max(before, key=before.count)
    listed = succeed("inspect", database(whole)).output
    assert f"\n{named} " in listed
    options = settings(f"gesture_master.quality.exclude=['{named}']")
    commands(("build-graph", "reenact"), whole_data, work, *options)
    assert named not in shown(work)
    facts = inspected(database(work))
    assert facts["dropped"] == [{"clip": named, "reason": "excluded"}]
    assert len(facts["clips"]) == len(inspected(database(whole))["clips"]) - 1
    start, stop = next(
        (clip["start_seconds"], clip["stop_seconds"])
        for clip in inspected(database(whole))["clips"]
        if clip["name"] == named
    )
    assert not any(
        clip["name"].startswith(named.split("@")[0]) and start < clip["stop_seconds"] and clip["start_seconds"] < stop
        for clip in facts["clips"]
    )


def test_a_dropped_clip_may_be_included(whole_data, whole, work):
    facts = inspected(database(whole))
    assert facts["dropped"] == []
    speed = settings("gesture_master.quality.max_speed=330")
    result = command("build-graph", whole_data, work, *speed)
    assert result.exit_code == 0
    dropped = [one["clip"] for one in inspected(database(work))["dropped"]]
    assert 1 < len(dropped) < len(facts["clips"])
    assert f"{len(dropped)} clips dropped: {dropped[0]} moves " in result.output
    commands(("build-graph",), whole_data, work, *speed, *settings(f"gesture_master.quality.include=['{dropped[1]}']"))
    assert [one["clip"] for one in inspected(database(work))["dropped"]] == [dropped[0], *dropped[2:]]
    assert dropped[1] in [clip["name"] for clip in inspected(database(work))["clips"]]


# --- variants -----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_variants_differ_and_the_first_is_the_ordinary_result(whole_data, whole, work):
    dear = settings("gesture_master.lambda_variant=100000")
    commands(("reenact",), whole_data, work, *dear)
    alone = tree(work / "reenact")
    result = command("reenact", whole_data, work, "--variants", 3, *dear)
    assert result.exit_code == 0
    assert tree(work / "reenact") == alone
    places = [work, work / "variants/2", work / "variants/3"]
    for test in TESTS:
        assert len({(place / "reenact" / f"{test}.bvh").read_bytes() for place in places}) == 3
        assert [trace(place, test)["variant"] for place in places] == [1, 2, 3]
        first, second = ({piece["nodes"][0] for piece in trace(place, test)["pieces"]} for place in places[:2])
        assert not first & second
        assert trace(work, test)["bvh_sha256"] == trace(whole, test)["bvh_sha256"]
    for place in places[1:]:
        succeed("evaluate", *SMALL, "--data", whole_data, "--work", place, "-j", 1)
        assert "2 clips, all valid" in succeed("check", *SMALL, "--data", whole_data, "--work", place, "-j", 1).output


@pytest.mark.slow
def test_workers_change_no_byte_of_variants(whole_data, work, tmp_path):
    other = Path(shutil.copytree(work, tmp_path / "other"))
    for place, jobs in ((work, 1), (other, 2)):
        assert command("reenact", whole_data, place, "--variants", 3, "-j", jobs).exit_code == 0
    assert tree(work) == tree(other)


def test_the_hint_for_variants_that_show_nothing_new_is_of_the_method(tmp_path):
    data, work = tmp_path / "data", tmp_path / "work"
    write_recording(data, "trn_a", 1.0, 0)
    write_recording(data, "tst_a", 1.0, 1)
    commands(("preprocess", "build-graph"), data, work)
    output = command("reenact", data, work, "--variants", 2).output
    assert "variant 2: shows nothing that earlier variants do not; give longer references" in output
    assert "search=global" not in output


@pytest.mark.slow
@pytest.mark.parametrize(
    "changed",
    [
        ("blend.method=crossfade", "smoothing.enabled=false"),
        ("blend.method=inertialize", "fingers=rest"),
        ("blend.method=least_jerk", "feet.lock=true"),
        ("blend.l_blend=0", "resample=nearest"),
        ("blend.l_blend=40", "root.mode=absolute"),
        ("smoothing.window=31", "smoothing.order=3", "smoothing.limb_order=4"),
        ("gesture_master.transition_frames=3", "gesture_master.rhythm.words=span"),
        ("gesture_master.transition_frames=40", "gesture_master.upper.zeta=0"),
        ("gesture_master.lower.delta_t=null", "gesture_master.lower.delta_quantile=1.0"),
        ("gesture_master.upper.delta_t=null", "gesture_master.upper.delta_quantile=0.0"),
        ("positions.relative_to=world", "gesture_master.quality.enabled=false"),
        ("fps=20",),
        ("fps=60",),
        (
            "exclude=[{clip: trn_a, from: 1, to: 2.5}, {clip: trn_a, from: 2.6, to: 3}, {clip: trn_b, from: 0, to: 5.5}]",
        ),
        ("joints=[b_l_foot, b_r_foot]",),
        ("joints=[b_l_index1]",),
        ("joints=[b_root]",),
    ],
)
def test_any_settings_give_valid_clips(changed, whole_data, tmp_path):
    work = commands((*RESULT, "evaluate"), whole_data, tmp_path / "work", *settings(*changed))
    assert len(list((work / "reenact").glob("*.bvh"))) == len(TESTS)


# --- ablation -----------------------------------------------------------------------------------------------


@pytest.fixture
def plan(tmp_path) -> Path:
    """A plan of both methods, and of databases with and without mirrored copies."""
    text = PAPER.read_text()
    (tmp_path / "plan").mkdir()
    setups = {
        "graph": "method: motion_graph\nblend: {method: crossfade}\n",
        "mirrored": "gesture_master: {mirror: true}\n",
        "plain": "gesture_master: {mirror: false}\n",
        "styleless": "gesture_master: {style: {source: none}}\n",
        "twelve": "references: {seconds: 12}\n",
    }
    (tmp_path / "plan/base.yaml").write_text(text)
    for name, changes in setups.items():
        (tmp_path / f"plan/{name}.yaml").write_text(changes)
    listed = "".join(f"  - plan/{name}.yaml\n" for name in setups)
    (tmp_path / "plan.yaml").write_text(f"base: plan/base.yaml\nseeds: [0]\nsetups:\n{listed}")
    return tmp_path / "plan.yaml"


def ablate(plan: Path, data: Path, work: Path, *options):
    options = ("--data", data, "--work", work, *SMALL[2:], *options)
    return run("ablate", "--config", plan, *options)


@pytest.mark.slow
def test_an_ablation_of_both_methods(plan, whole_data, work, tmp_path):
    clips = tree(work / "clips")
    result = ablate(plan, whole_data, work, "-j", 1)
    assert result.exit_code == 0, result.output
    table = json.loads((work / "ablation/ablation.json").read_text())
    assert sorted(path.name for path in (work / "ablation").iterdir()) == [
        "ablation.csv", "ablation.json", "ablation.md", "ablation.png", "reference_length.json",
    ]  # fmt: skip
    text = json.dumps(table)
    assert all(f'"{name}"' in text for name in ("graph", "mirrored", "plain", "styleless", "twelve"))
    assert tree(work / "clips") == clips


@pytest.mark.slow
def test_an_ablation_that_keeps_is_the_commands(plan, whole_data, whole, work, tmp_path):
    result = ablate(plan, whole_data, work, "-j", 1, "--keep")
    assert result.exit_code == 0, result.output
    folder = work / "ablation"
    found = {name: list((folder / name / "graphs").iterdir()) for name in ("mirrored", "plain", "styleless", "graph")}
    assert all(len(paths) == 1 for paths in found.values())
    (mirrored,), (plain,) = found["mirrored"], found["plain"]
    assert inspected(mirrored)["mirrored"] and not inspected(plain)["mirrored"]
    assert mirrored.read_bytes() == database(whole).read_bytes()
    apart = Path(shutil.copytree(work / "clips", tmp_path / "apart/clips")).parent
    commands(("build-graph", "reenact"), whole_data, apart, *settings("gesture_master.mirror=false"))
    assert plain.read_bytes() == database(apart).read_bytes()
    for test in TESTS:
        assert (folder / "mirrored/0" / f"{test}.bvh").read_bytes() == (whole / "reenact" / f"{test}.bvh").read_bytes()
        assert (folder / "plain/0" / f"{test}.bvh").read_bytes() == (apart / "reenact" / f"{test}.bvh").read_bytes()


@pytest.mark.slow
def test_an_ablation_does_not_depend_on_workers(plan, whole_data, work, tmp_path):
    other = Path(shutil.copytree(work, tmp_path / "other"))
    for place, jobs in ((work, 1), (other, 2)):
        assert ablate(plan, whole_data, place, "-j", jobs, "--keep").exit_code == 0
    timed = ("ablation.csv", "ablation.json", "ablation.md", "ablation.png", "reference_length.json")
    alone, parallel = (
        {name: value for name, value in tree(place).items() if not name.endswith(timed)} for place in (work, other)
    )
    assert alone == parallel


# --- other skeletons ----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("joints", [1, 3])
def test_a_skeleton_without_sides_and_wrists(joints, data, tmp_path):
    rng = np.random.default_rng(0)
    for name, seconds in (("trn_a", 8), ("trn_b", 6), ("trn_c", 7)):
        write_recording(data, name, seconds, 3, motion=gesture_builders.motion(rng, 30 * seconds, chain(joints)))
    if joints == 1:  # which is its own mirror image
        commands(RESULT, data, tmp_path / "work")
        return
    result = command("build-graph", data, commands(("preprocess",), data, tmp_path / "refused"))
    assert result.exit_code == 1 and "is not symmetric" in errors(result)[0]
    work = commands(RESULT, data, tmp_path / "work", *settings("gesture_master.mirror=false"))
    assert [bvh.read(work / "reenact" / f"{test}.bvh").n_frames for test in TESTS] == [120, 120]
    facts = inspected(database(work))
    assert facts["joints"]["compared"] == joints and facts["joints"]["fingers"] == 0


def renamed(name: str) -> str:
    """Names of another capture system."""
    side = {"_l_": "Left", "_r_": "Right"}.get(name[1:4], "")
    return side + name.removeprefix("b_").removeprefix("l_").removeprefix("r_").capitalize()


def test_a_skeleton_of_other_names(data, tmp_path):
    bones = gesture_builders.skeleton([renamed(name) for name in gesture_builders.NAMES])
    rng = np.random.default_rng(0)
    for name, seconds in (("trn_a", 8), ("trn_b", 6), ("trn_c", 7)):
        write_recording(data, name, seconds, 3, motion=gesture_builders.motion(rng, 30 * seconds, bones))
    work = commands(RESULT, data, tmp_path / "work")
    facts = inspected(database(work))
    assert facts["mirrored"] and facts["joints"] == {"compared": 15, "upper": 10, "lower": 5, "fingers": 2}
    assert "LeftFoot" in trace(work, "tst_a")["tracks"][0]["joints"]
    # Without wrists of a known name, the joints farthest out at rest are the hands.
    assert all(clip["speed"] > 10 for clip in facts["clips"])


@pytest.mark.slow
def test_joint_pairs_of_a_skeleton_whose_names_tell_no_sides(data, tmp_path):
    names = [f"part{n}" for n in range(len(gesture_builders.NAMES))]
    bones = gesture_builders.skeleton(names)
    rng = np.random.default_rng(0)
    for name, seconds in (("trn_a", 8), ("trn_b", 6), ("trn_c", 7)):
        write_recording(data, name, seconds, 3, motion=gesture_builders.motion(rng, 30 * seconds, bones))
    result = command("build-graph", data, commands(("preprocess",), data, tmp_path / "refused"))
    assert result.exit_code == 1 and "give gesture_master.joint_pairs" in errors(result)[0]
    pairs = [(1, 3), (2, 4), *((left, left + 4) for left in range(7, 11))]
    listed = ", ".join(f"[part{left}, part{right}]" for left, right in pairs)
    commands(RESULT, data, tmp_path / "work", *settings(f"gesture_master.joint_pairs=[{listed}]"))


def test_hands_that_shake_are_dropped(data, tmp_path):
    write_recording(
        data, "trn_c", 7.0, 3, motion=tiny.motion(np.random.default_rng(0), 210, gesture_builders.skeleton())
    )
    work = commands(("preprocess", "build-graph"), data, tmp_path / "work")
    facts = inspected(database(work))
    assert {one["clip"].split("@")[0] for one in facts["dropped"]} == {"trn_c"}
    assert set(facts["dropped_kinds"]) <= {"jitter", "turns", "moves"}

"""`method: motion_matching` from files to files: its commands, what is done again, and beside other methods."""

import csv
import importlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from gesturegen.demo import dataset
from gesturegen.motion import bvh
from gesturegen.settings.loading import configs_folder
from tests.builders import write_audio
from tests.commands import errors, run, succeed, tree
from tests.methods.motion_matching.test_matching_database import JOINTS
from tests.test_gesture_master import CUTTING, rewritten, settings, stamps, write_recording

PAPER = configs_folder() / "motion_matching_2022.yaml"
REFERENCES = ("trn_a", "trn_b", "trn_c")
TESTS = ("tst_a", "tst_b")
STAGES = ("preprocess", "build-graph", "reenact", "evaluate", "pack")
# The tiny skeleton has one finger a hand.
TINY = settings("joints=all", "wrists.enabled=false", f"motion_matching.joints={list(JOINTS)}")
SMALL = ("--config", PAPER, *TINY, *settings("motion_matching.sequence_seconds=1.0"))
VOICE = settings("acoustics.enabled=true", "prosody.enabled=true", "prosody.hop_length=800", "prosody.pitch_min=150.0")
MASTER = settings("method=gesture_master", CUTTING, "blend.method=overlap", "gesture_master.style.source=none")


def command(name: str, data: Path, work: Path, *options):
    return run(name, *SMALL, "--data", data, "--work", work, "-j", 1, *options)


def commands(names, data: Path, work: Path, *options) -> Path:
    for name in names:
        result = command(name, data, work, *options)
        assert result.exit_code == 0 and errors(result) == [], result.output
    return work


def write_data(data: Path, tests: float = 4.0) -> Path:
    for seed, (name, seconds) in enumerate(zip(REFERENCES, (6.0, 4.0, 5.0), strict=True)):
        write_recording(data, name, seconds, seed)
    for seed, name in enumerate(TESTS):
        write_recording(data, name, tests - seed, 10 + seed)
    return data


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


def trace(work: Path, name: str) -> dict:
    return json.loads((work / "reenact" / f"{name}.trace.json").read_text())


def library(work: Path) -> Path:
    (found,) = (work / "graphs").glob("*-matching.npz")
    return found


def told(result) -> list[str]:
    """The lines of errors, without the one that counts them."""
    assert result.exit_code == 1, result.output
    return [line for line in errors(result) if not line.endswith(" failed")]


def rows(path: Path) -> list[dict]:
    return list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))


# --- all commands --------------------------------------------------------------------------------------------


def test_a_run_is_the_five_commands(whole_data, whole, tmp_path):
    commands(("run",), whole_data, tmp_path / "run")
    assert tree(tmp_path / "run") == tree(whole)


@pytest.mark.slow
def test_workers_change_no_byte(whole_data, whole, tmp_path):
    succeed("run", *SMALL, "--data", whole_data, "--work", tmp_path / "two", "-j", 2)
    assert tree(tmp_path / "two") == tree(whole)


@pytest.mark.parametrize("together", [1, 2])
def test_how_many_clips_are_searched_for_together_changes_no_byte(together, whole_data, whole, work, monkeypatch):
    shutil.rmtree(work / "reenact")
    monkeypatch.setattr(importlib.import_module("gesturegen.pipeline.reenact"), "_TOGETHER", together)
    commands(("reenact",), whole_data, work)
    assert tree(work) == tree(whole)


def test_lengths_steps_and_joins(whole, whole_data):
    for name, frames in zip(TESTS, (120, 90), strict=True):
        found = trace(whole, name)
        assert (found["method"], found["search"], found["n_frames"]) == ("motion_matching", "nearest", frames)
        assert bvh.read(whole / "reenact" / f"{name}.bvh").n_frames == frames
        pieces = found["pieces"]
        assert [piece["start_frame"] for piece in pieces] == list(range(0, frames, 16))
        assert pieces[-1]["end_frame"] == frames and all(len(p["nodes"]) == p["target_length"] for p in pieces)
        assert {piece["end_kind"] for piece in pieces} == {"step"} and found["tracks"] == found["control"] == []
        for join in found["joins"]:
            assert join["natural"] == (join["to_node"] == join["from_node"] + 1) and (
                not join["natural"] or join["distance"] == 0
            )


def test_figures_check_and_pack(whole, whole_data):
    figures = rows(whole / "evaluate/metrics.csv")
    assert {row["clip"] for row in figures} >= set(TESTS)
    assert "2 clips, all valid" in succeed("check", *SMALL, "--data", whole_data, "--work", whole).output
    for name in TESTS:
        assert (whole / f"submission/{name}.bvh").read_bytes() == (whole / f"reenact/{name}.bvh").read_bytes()
    manifest = json.loads((whole / "reenact/manifest.json").read_text())
    assert (manifest["method"], manifest["search"], manifest["n_failed"]) == ("motion_matching", "nearest", 0)


def test_inspect_and_report(whole, work, whole_data, tmp_path):
    result = succeed("inspect", TESTS[0], "--work", work, "--plot", tmp_path / "trace.png")
    assert "8 pieces" in result.output and "another one now" not in result.output, result.output
    assert "not there" not in result.output and (tmp_path / "trace.png").is_file()
    result = succeed("inspect", library(work))
    assert "450 frames" in result.output, result.output
    result = run("inspect", library(work), "--plot", tmp_path / "library.png")
    assert result.exit_code == 1 and "no plot; leave out --plot" in result.output
    assert json.loads(succeed("inspect", library(work), "--json").output)
    assert "2 clips to watch, 0 failed" in command("report", whole_data, work).output


def test_variants(whole_data, whole, work):
    commands(("reenact",), whole_data, work, "--variants", "3")
    folders = [work, work / "variants/2", work / "variants/3"]
    for name in TESTS:
        assert (work / f"reenact/{name}.bvh").read_bytes() == (whole / f"reenact/{name}.bvh").read_bytes()
        shown = [str([piece["nodes"] for piece in trace(folder, name)["pieces"]]) for folder in folders]
        assert len(set(shown)) == 3
    commands(("evaluate",), whole_data, work / "variants/3")


def test_one_reference_for_each_test(whole_data, tmp_path):
    options = settings("references.mode=per_test_clip")
    commands(("run",), whole_data, tmp_path / "work", *options)
    names = {trace(tmp_path / "work", name)["graph"] for name in TESTS}
    assert all(name.endswith("-matching") for name in names)
    assert {path.stem for path in (tmp_path / "work/graphs").iterdir()} == names


# --- a planted case ------------------------------------------------------------------------------------------


def test_a_reference_s_own_sound_brings_its_motion(whole_data, tmp_path):
    import soundfile

    data = tmp_path / "data"
    shutil.copytree(whole_data / "trn", data / "trn")
    samples, rate = soundfile.read(data / "trn/main-agent/wav/trn_b.wav")
    # From frame 2 on: what is shown first follows on the start pose.
    write_audio(data / "tst/main-agent/wav/own.wav", samples[round(rate * 2 / 30) :], rate)
    options = settings("motion_matching.start=given", "motion_matching.start_pose=trn_b@0.0")
    commands(("preprocess", "build-graph", "reenact"), data, tmp_path / "work", *options)
    found = trace(tmp_path / "work", "own")
    (start,) = [one["start_node"] for one in found["references"] if one["clip"] == "trn_b"]
    nodes = np.concatenate([piece["nodes"] for piece in found["pieces"]]) - start
    # As long as a whole step of it is left.
    kept = (120 - 1) // 16 * 16
    assert nodes[:kept].tolist() == list(range(1, kept + 1)), nodes


# --- what is done again --------------------------------------------------------------------------------------


def test_run_does_nothing_twice(whole_data, whole, work):
    before = stamps(work)
    commands(("run",), whole_data, work)
    assert rewritten(work, before) == set() and tree(work) == tree(whole)


@pytest.mark.parametrize(
    ("changed", "redone"),
    [
        ("motion_matching.k=2", {"reenact", "evaluate"}),
        ("motion_matching.pose_values=3", {"graphs", "reenact", "evaluate"}),
        ("acoustics.coefficients=12", {"clips", "graphs", "reenact", "evaluate"}),
    ],
)
def test_a_changed_setting_redoes_what_depends_on_it(changed, redone, whole_data, work):
    before = stamps(work)
    commands(("run",), whole_data, work, *settings(changed))
    assert {name.split("/")[0] for name in rewritten(work, before)} == redone


def test_a_lost_result_is_made_again(whole_data, whole, work):
    (work / "reenact/tst_a.bvh").unlink()
    library(work).unlink()
    before = stamps(work)
    commands(("run",), whole_data, work)
    assert rewritten(work, before, "graphs", "reenact") == {
        f"graphs/{library(work).name}", "reenact/tst_a.bvh", "reenact/tst_a.trace.json"
    }  # fmt: skip
    assert tree(work) == tree(whole)


# --- refusals ------------------------------------------------------------------------------------------------


def test_it_needs_the_sound(whole_data, tmp_path):
    result = command("preprocess", whole_data, tmp_path / "work", *settings("acoustics.enabled=false"))
    (line,) = told(result)
    assert "motion_matching needs acoustics.enabled: true" in line


def test_clips_without_sound_must_be_preprocessed_again(whole_data, tmp_path):
    options = settings("method=motion_graph", "acoustics.enabled=false")
    commands(("preprocess",), whole_data, tmp_path / "work", *options)
    result = command("build-graph", whole_data, tmp_path / "work")
    lines = told(result)
    assert lines and all(
        "holds no acoustics" in line and "run `gesturegen preprocess` again" in line for line in lines
    ), lines


def test_a_missing_joint_is_named(whole_data, work):
    options = settings("motion_matching.joints=[b_l_wrist, b_l_pinky1]")
    result = command("build-graph", whole_data, work, *options)
    (line,) = told(result)
    assert "no joint 'b_l_pinky1'" in line


@pytest.mark.parametrize("pose", ["nobody@1.0", "trn_a"])
def test_a_bad_start_pose_is_one_line_for_each_clip(pose, whole_data, work):
    options = settings("motion_matching.start=given", f"motion_matching.start_pose={pose}")
    lines = told(command("reenact", whole_data, work, *options))
    assert len(lines) == 2 and all(f"start_pose: {pose!r} is no frame" in line for line in lines), lines


def test_references_shorter_than_a_step_are_one_line_for_each_clip(whole_data, tmp_path):
    data = tmp_path / "data"
    shutil.copytree(whole_data / "tst", data / "tst")
    write_recording(data, "trn_a", 0.5, 0)
    result = command("run", data, tmp_path / "work")
    lines = told(result)
    assert len(lines) == 2, result.output
    for name, line in zip(TESTS, lines, strict=True):
        assert name in line and "a stretch of 16 frames" in line and "give longer references" in line


# --- beside other methods ------------------------------------------------------------------------------------

OTHERS = {"motion_matching": (), "gesture_master": MASTER, "motion_graph": settings("method=motion_graph")}


@pytest.mark.slow
def test_three_methods_in_one_work_folder(whole_data, whole, tmp_path):
    work = commands(("preprocess",), whole_data, tmp_path / "work", *VOICE)
    for options in OTHERS.values():
        commands(("build-graph",), whole_data, work, *VOICE, *options)
    assert len(list((work / "graphs").iterdir())) == 3
    for method, options in reversed(OTHERS.items()):
        commands(("reenact", "evaluate", "check"), whole_data, work, *VOICE, *options)
        assert trace(work, "tst_a")["method"] == method
    # The last one shows what it does alone.
    for name in TESTS:
        assert (work / f"reenact/{name}.bvh").read_bytes() == (whole / f"reenact/{name}.bvh").read_bytes()


@pytest.mark.slow
def test_report_beside_another_method(whole_data, work, tmp_path):
    other = Path(shutil.copytree(work, tmp_path / "other"))
    commands(("run",), whole_data, other, *settings("method=motion_graph"))
    assert "2 clips to watch, 0 failed" in command("report", whole_data, work, "--compare", f"graph={other}").output


@pytest.mark.slow
def test_ablate_beside_other_methods(whole_data, work, tmp_path):
    setups = {
        "matching": "method: motion_matching",
        "second": "method: motion_matching\nmotion_matching: {k: 2}",
        "poses": "method: motion_matching\nmotion_matching: {pose_values: 2}",
        "graph": "method: motion_graph",
    }
    for name, text in setups.items():
        (tmp_path / f"{name}.yaml").write_text(text + "\n")
    plan = {"base": str(PAPER), "seeds": [0], "setups": [f"{name}.yaml" for name in setups]}
    (tmp_path / "ablation.yaml").write_text("".join(f"{key}: {json.dumps(value)}\n" for key, value in plan.items()))
    options = (*TINY, *settings("motion_matching.sequence_seconds=1.0"), "--data", whole_data, "--work", work)
    result = succeed("ablate", "--config", tmp_path / "ablation.yaml", *options, "-j", 1, "--keep")
    assert all(name in result.output for name in setups), result.output
    for setup in ("matching", "second"):
        for name in TESTS:
            kept = json.loads((work / f"ablation/{setup}/0/{name}.trace.json").read_text())
            same = [p["nodes"] for p in kept["pieces"]] == [p["nodes"] for p in trace(work, name)["pieces"]]
            assert same == (setup == "matching")


# --- the demo dataset ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_paper_s_values_on_the_demo_data(tmp_path):
    specs = dataset.clip_specs(references=2, tests=2, seed=0, reference_seconds=(30.0, 30.0), test_seconds=(12.0, 12.0))
    for spec in specs:
        dataset.write_clip(tmp_path / "data", spec)
    dataset.write_metadata(tmp_path / "data", specs)
    common = ("--config", PAPER, "--data", tmp_path / "data")
    succeed("run", *common, "--work", tmp_path / "one", "-j", 1)
    succeed("run", *common, "--work", tmp_path / "two", "-j", 2)
    assert tree(tmp_path / "one") == tree(tmp_path / "two")
    assert "2 clips, all valid" in succeed("check", *common, "--work", tmp_path / "one").output
    for spec in specs[2:]:
        assert bvh.read(tmp_path / "one/reenact" / f"{spec.name}.bvh").n_frames == 360
        assert "23 pieces" in succeed("inspect", spec.name, "--work", tmp_path / "one").output

"""`train-refiner` and `refine: true` from files to files: what is written, resumed, refined and refused."""

import importlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gesturegen.motion import bvh, kinematics, rotation
from gesturegen.settings.loading import configs_folder
from gesturegen.stored import arrays
from tests.commands import errors, run, succeed, tree
from tests.faults.faulty import Fault, run_with
from tests.methods.gesture_master import gesture_builders as gb
from tests.methods.motion_matching.test_matching_database import JOINTS
from tests.test_gesture_master import rewritten, settings, stamps, write_recording

# Two of the lower body, which are not refined, and some of the upper one.
MEASURED = ("b_root", "b_l_foot", "b_spine0", "b_l_arm", "b_l_forearm", "b_l_wrist", "b_r_forearm")
REFINED = ("b_spine0", "b_l_arm", "b_l_forearm", "b_l_wrist", "b_r_forearm")
TESTS = {"tst_a": 100, "tst_b": 75}
SMALL = (
    "--config", configs_folder() / "motion_matching_2022.yaml",
    *settings(
        f"joints={list(MEASURED)}", "wrists.enabled=false", f"motion_matching.joints={list(JOINTS)}",
        "motion_matching.sequence_seconds=1.0", "refiner.device=cpu",
    ),
)  # fmt: skip
QUICK = settings("refiner.iterations=4", "refiner.check_every=2", "refiner.batch=4", "refiner.learning_rate=0.01")
REFINE = settings("refine=true")


def arguments(name: str, data: Path, work: Path, *options) -> tuple:
    return (name, *SMALL, *QUICK, "--data", data, "--work", work, "-j", 1, *options)


def done(name: str, data: Path, work: Path, *options):
    result = run(*arguments(name, data, work, *options))
    assert result.exit_code == 0 and errors(result) == [], result.output
    return result


def told(result) -> list[str]:
    """The lines of errors, without the one that counts them."""
    assert result.exit_code == 1, result.output
    return [line for line in errors(result) if not line.endswith(" failed")]


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("refiner") / "data"
    for seed, (name, seconds) in enumerate((("trn_a", 5.0), ("trn_b", 4.0), ("trn_c", 3.0))):
        write_recording(folder, name, seconds, seed)
    for seed, (name, frames) in enumerate(TESTS.items()):
        write_recording(folder, name, frames / 30, 10 + seed)
    return folder


@pytest.fixture(scope="module")
def plain(data, tmp_path_factory) -> Path:
    """A work folder without a refiner."""
    work = tmp_path_factory.mktemp("refiner") / "work"
    for name in ("preprocess", "build-graph", "reenact"):
        done(name, data, work)
    return work


@pytest.fixture
def work(plain, tmp_path) -> Path:
    return Path(shutil.copytree(plain, tmp_path / "work"))


# --- without torch -------------------------------------------------------------------------------------------

SCRIPT = """
import json, sys
from click.testing import CliRunner
from gesturegen.cli import main
results = [CliRunner().invoke(main, arguments) for arguments in json.load(sys.stdin)]
print(json.dumps([[result.exit_code, result.output] for result in results]))
"""


def test_without_torch_all_else_works_and_it_says_what_to_install(data, plain, work, tmp_path):
    (tmp_path / "hidden/torch").mkdir(parents=True)
    (tmp_path / "hidden/torch/__init__.py").write_text("raise ImportError('torch is hidden')\n")
    shutil.rmtree(work / "reenact")
    arrays.write(work / "refiner.pt", {"of": np.array("another machine")})
    wanted = [
        arguments("run", data, work),
        arguments("train-refiner", data, work),
        arguments("reenact", data, work, *REFINE, "--force"),
        arguments("reenact", data, work, "--force"),
    ]
    found = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        input=json.dumps([[str(word) for word in one] for one in wanted]),
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path / "hidden"), *sys.path])},
        capture_output=True, text=True, check=True, timeout=1200,
    )  # fmt: skip
    ran, trained, refined, again = json.loads(found.stdout.splitlines()[-1])
    assert ran[0] == 0 and again[0] == 0, (ran, again)
    assert tree(work / "reenact") == tree(plain / "reenact")
    hint = "torch cannot be used (torch is hidden); run: pip install 'gesturegen[torch]'"
    assert trained[0] == 1 and trained[1].strip() == f"Error: {hint}", trained
    lines = [line for line in refined[1].splitlines() if line.lower().startswith("error: ")]
    assert refined[0] == 1 and "Traceback" not in refined[1], refined[1]
    assert [line for line in lines if hint in line] == lines[: len(TESTS)] and len(lines) == len(TESTS) + 1, lines


# --- training ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def trained(data, plain, tmp_path_factory) -> Path:
    """The same work folder with a refiner, and clips refined by it."""
    pytest.importorskip("torch")
    work = Path(shutil.copytree(plain, tmp_path_factory.mktemp("refiner") / "trained"))
    result = done("train-refiner", data, work)
    assert "4 iterations" in result.output and "reconstruction" in result.output, result.output
    done("reenact", data, work, *REFINE)
    return work


@pytest.fixture
def ready(trained, tmp_path) -> Path:
    return Path(shutil.copytree(trained, tmp_path / "ready"))


def test_what_training_leaves(trained, plain):
    assert {path.name for path in trained.iterdir()} - {path.name for path in plain.iterdir()} == {
        "refiner.pt", "refiner.json"
    }  # fmt: skip
    figures = json.loads((trained / "refiner.json").read_text())
    assert figures["iterations"] == 4 and figures["checks"] == [2, 4] and len(figures["held_out"]) == 2
    # Windows of a second, every third of a second, of 75, 60 and 45 values; twice, for two fakes.
    assert figures["windows"] == 2 * sum((values - 15) // 5 + 1 for values in (75, 60, 45))
    assert set(figures["margin"]) == {"critic", "generator", "change", "windows"}
    assert all(
        np.isfinite(figures[f"{name}_{when}"])
        for name in ("reconstruction", "gradient_norm")
        for when in ("first", "last")
    )
    assert tree(trained / "clips") == tree(plain / "clips") and tree(trained / "graphs") == tree(plain / "graphs")


@pytest.mark.slow
def test_training_again_changes_nothing(data, trained, ready):
    done("train-refiner", data, ready)
    assert (ready / "refiner.pt").read_bytes() == (trained / "refiner.pt").read_bytes()
    assert (ready / "refiner.json").read_bytes() == (trained / "refiner.json").read_bytes()


def same_run(one: Path, other: Path) -> bool:
    """Do two checkpoints hold the same, bit by bit?"""
    import torch

    from tests.refine.test_training import equal

    return equal(*(torch.load(path, map_location="cpu", weights_only=True) for path in (one, other)))


def interrupted(after: int, data: Path, work: Path, monkeypatch) -> None:
    """Training that is stopped after some iterations."""
    refiner = importlib.import_module("gesturegen.pipeline.refiner")
    advance = refiner._advance

    def stopping(bar, iterations, history):
        advance(bar, iterations, history)
        if iterations == after:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(refiner, "_advance", stopping)
        assert run(*arguments("train-refiner", data, work)).exit_code != 0


@pytest.mark.parametrize("after", [pytest.param(1, marks=pytest.mark.slow), 3])
def test_interrupted_training_ends_in_the_same_network(after, data, trained, work, monkeypatch):
    interrupted(after, data, work, monkeypatch)
    # Kept at every second iteration.
    assert (work / "refiner.pt").exists() == (after > 1) and not (work / "refiner.json").exists()
    done("train-refiner", data, work)
    assert same_run(work / "refiner.pt", trained / "refiner.pt")
    assert (work / "refiner.json").read_bytes() == (trained / "refiner.json").read_bytes()
    done("reenact", data, work, *REFINE)
    for name in TESTS:
        assert (work / f"reenact/{name}.bvh").read_bytes() == (trained / f"reenact/{name}.bvh").read_bytes()


@pytest.mark.slow
def test_killed_training_ends_in_the_same_file(data, work, tmp_path):
    pytest.importorskip("torch")
    options = (*settings("refiner.iterations=12"), "--force")
    other = Path(shutil.copytree(work, tmp_path / "other"))
    train = [[str(word) for word in arguments("train-refiner", data, folder, *options)] for folder in (other, work)]
    whole = run_with(train[0], other, tmp_path / "log")
    assert whole.code == 0, whole.output
    # Half of what is written: some checkpoints are, what is told at the end is not.
    ended = run_with(train[1], work, tmp_path / "log", Fault(("refiner",), whole.changes["refiner"] // 2, "command", 9))
    assert ended.struck and ended.code == -9
    assert (work / "refiner.pt").exists() and not (work / "refiner.json").exists()
    done("train-refiner", data, work, *options)
    assert same_run(work / "refiner.pt", other / "refiner.pt")
    assert (work / "refiner.json").read_bytes() == (other / "refiner.json").read_bytes()


@pytest.mark.slow
def test_workers_change_no_byte(data, trained, work):
    pytest.importorskip("torch")
    done("train-refiner", data, work, "-j", 2)
    done("reenact", data, work, *REFINE, "-j", 2)
    assert tree(work) == tree(trained)


@pytest.mark.slow
def test_a_checkpoint_elsewhere(data, trained, work, tmp_path):
    elsewhere = settings(f"refiner.checkpoint={tmp_path / 'kept/mine.pt'}")
    done("train-refiner", data, work, *elsewhere)
    assert not (work / "refiner.pt").exists() and (tmp_path / "kept/mine.json").is_file()
    done("reenact", data, work, *REFINE, *elsewhere)
    for name in TESTS:
        assert bvh.read(work / f"reenact/{name}.bvh").n_frames == TESTS[name]
        assert (work / f"reenact/{name}.bvh").read_bytes() == (trained / f"reenact/{name}.bvh").read_bytes()


def test_another_seed_is_another_run(data, trained, ready):
    (line,) = told(run(*arguments("train-refiner", data, ready, *settings("seed=1"))))
    assert str(ready / "refiner.pt") in line and "delete it" in line
    assert (ready / "refiner.pt").read_bytes() == (trained / "refiner.pt").read_bytes()


@pytest.mark.slow
def test_one_reference(data, work, tmp_path):
    """Nothing of a single reference within a second of what is said is shown, and its last windows are held out."""
    pytest.importorskip("torch")
    single = tmp_path / "single"
    write_recording(single, "trn_a", 8.0, 0)
    shutil.copytree(data / "tst", single / "tst")
    done("preprocess", single, tmp_path / "alone")
    options = settings("refiner.iterations=1", "refiner.check_every=1")
    done("train-refiner", single, tmp_path / "alone", *options)
    figures = json.loads((tmp_path / "alone/refiner.json").read_text())
    assert figures["windows"] == 2 * ((120 - 15) // 5 + 1)


def test_a_network_is_kept_where_too_few_windows_are_held_out_to_tell_whether_sound_counts(data, tmp_path):
    pytest.importorskip("torch")
    short = tmp_path / "short"
    write_recording(short, "trn_a", 3.2, 0)
    shutil.copytree(data / "tst", short / "tst")
    done("preprocess", short, tmp_path / "alone")
    options = settings("refiner.iterations=1")
    result = done("train-refiner", short, tmp_path / "alone", *options)
    assert "1 held-out windows: there is no other audio to give them" in result.output
    assert "not measured" in result.output
    assert json.loads((tmp_path / "alone/refiner.json").read_text())["margin"] == {}


def test_too_little_to_train_on_is_one_line(data, tmp_path):
    pytest.importorskip("torch")
    short = tmp_path / "short"
    write_recording(short, "trn_a", 0.9, 0)
    shutil.copytree(data / "tst", short / "tst")
    done("preprocess", short, tmp_path / "alone")
    (line,) = told(run(*arguments("train-refiner", short, tmp_path / "alone")))
    assert "give longer references" in line


# --- refining ------------------------------------------------------------------------------------------------


def test_only_the_measured_joints_of_the_upper_body_change(plain, trained):
    places = [gb.NAMES.index(name) for name in REFINED]
    others = [joint for joint in range(len(gb.NAMES)) if joint not in places]
    for name, frames in TESTS.items():
        before, after = (bvh.read(work / f"reenact/{name}.bvh") for work in (plain, trained))
        assert before.n_frames == after.n_frames == frames
        turned = np.degrees(rotation.angle_between(before.rotations, after.rotations))
        assert turned[:, others].max() < 1e-4, turned[:, others].max()
        assert (turned[:, places].max(axis=0) > 0.01).all(), turned[:, places].max(axis=0)
        np.testing.assert_array_equal(before.positions, after.positions)
        one, other = (kinematics.joint_positions(motion) for motion in (before, after))
        for joint, parent in enumerate(gb.skeleton().parents):
            if parent >= 0:
                lengths = [np.linalg.norm(where[:, joint] - where[:, parent], axis=1) for where in (one, other)]
                np.testing.assert_allclose(*lengths, atol=1e-6)


def test_the_search_is_the_same(plain, trained):
    for name in TESTS:
        one, other = (json.loads((work / f"reenact/{name}.trace.json").read_text()) for work in (plain, trained))
        assert one["pieces"] == other["pieces"] and one["joins"] == other["joins"]
        assert one["inputs"] != other["inputs"] and one["bvh_sha256"] != other["bvh_sha256"]


def test_refined_clips_are_figures_and_a_submission(data, ready):
    for name in ("evaluate", "check", "pack", "report"):
        done(name, data, ready, *REFINE)
    assert (ready / "submission/tst_a.bvh").read_bytes() == (ready / "reenact/tst_a.bvh").read_bytes()
    succeed("inspect", "tst_a", "--work", ready)


@pytest.mark.slow
def test_run_refines_again_when_the_checkpoint_changes(data, ready):
    pytest.importorskip("torch")
    done("run", data, ready, *REFINE)
    before = stamps(ready)
    done("run", data, ready, *REFINE)
    assert rewritten(ready, before) == set()
    (ready / "refiner.pt").unlink()
    done("train-refiner", data, ready, *settings("seed=1"))
    done("run", data, ready, *REFINE)
    assert rewritten(ready, before, "clips", "graphs") == set()
    assert {f"reenact/{name}.bvh" for name in TESTS} <= rewritten(ready, before, "reenact")


@pytest.mark.slow
def test_other_methods_and_variants_are_refined_as_well(data, ready):
    before = (ready / "reenact/tst_a.bvh").read_bytes()
    done("reenact", data, ready, *REFINE, "--variants", "2")
    assert (ready / "reenact/tst_a.bvh").read_bytes() == before
    assert bvh.read(ready / "variants/2/reenact/tst_a.bvh").n_frames == TESTS["tst_a"]
    options = settings("method=motion_graph")
    done("build-graph", data, ready, *options)
    done("reenact", data, ready, *options)
    plain = bvh.read(ready / "reenact/tst_a.bvh")
    done("reenact", data, ready, *options, *REFINE)
    refined = bvh.read(ready / "reenact/tst_a.bvh")
    turned = np.degrees(rotation.angle_between(plain.rotations, refined.rotations)).max(axis=0)
    assert {gb.NAMES[joint] for joint in np.flatnonzero(turned > 1e-3)} == set(REFINED)


# --- refusals ------------------------------------------------------------------------------------------------


def test_without_a_checkpoint_each_clip_is_one_line(data, work):
    pytest.importorskip("torch")
    lines = told(run(*arguments("reenact", data, work, *REFINE)))
    assert len(lines) == len(TESTS), lines
    assert all("refiner.pt" in line and "train" in line for line in lines), lines


def test_a_checkpoint_of_other_joints_is_one_line_for_each_clip(data, ready):
    options = (*REFINE, *settings(f"joints={list(MEASURED[:-1])}"))
    done("preprocess", data, ready, *options)
    done("build-graph", data, ready, *options)
    lines = told(run(*arguments("reenact", data, ready, *options)))
    assert len(lines) == len(TESTS), lines
    assert all("refiner.pt: trained for another skeleton: 5 joints" in line for line in lines), lines
    (line,) = told(run(*arguments("train-refiner", data, ready, *options)))
    assert "trained for another skeleton" in line


def test_a_damaged_checkpoint_is_one_line_for_each_clip(data, ready):
    (ready / "refiner.pt").write_bytes((ready / "refiner.pt").read_bytes()[:1000])
    lines = told(run(*arguments("reenact", data, ready, *REFINE)))
    assert len(lines) == len(TESTS) and all("refiner.pt: damaged (no checksum" in line for line in lines), lines


def test_a_damaged_checkpoint_is_trained_anew(data, trained, ready):
    damaged = bytearray((ready / "refiner.pt").read_bytes())
    damaged[len(damaged) // 2] ^= 1
    (ready / "refiner.pt").write_bytes(damaged)
    result = done("train-refiner", data, ready)
    assert "its checksum is another one" in result.stderr and "it was made again" in result.stderr, result.stderr
    assert same_run(trained / "refiner.pt", ready / "refiner.pt")


def test_refining_needs_the_sound(data, ready):
    options = (*REFINE, *settings("method=motion_graph", "acoustics.enabled=false"))
    done("build-graph", data, ready, *options)
    lines = told(run(*arguments("reenact", data, ready, *options)))
    assert lines and all("set acoustics.enabled: true" in line for line in lines), lines

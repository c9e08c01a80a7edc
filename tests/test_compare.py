"""`compare`: every measure of every setup in one table, folders for the other commands, and the page."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from gesturegen import evaluation
from gesturegen.experiment.plan import load_plan
from gesturegen.experiment.presets import MACHINE, MACHINE_COLUMNS
from gesturegen.parallel import for_each
from gesturegen.pipeline.search_memory import peak_megabytes
from gesturegen.settings.loading import load_config
from tests import tiny
from tests.builders import chain, write_clip
from tests.commands import run, succeed, tree
from tests.test_ablate import write_plan

TOP = Path(__file__).parent.parent
SETUPS = {
    "best": "search: global\nblend: {method: least_jerk}",
    "stuck": "termination: {fallbacks: false, failure_retries: 20}",
    "pose_only": "method: motion_matching\nmotion_matching: {joints: [j2, j3], use_audio: false}",
    "mismatched": "method: baseline\nbaseline: mismatched",
    "random_stretch": "method: baseline\nbaseline: random_stretch",
}
CLIPS = ("tst_a", "tst_b")
# Every method and baseline is run for them.
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """Two references and two tests with true motion; `north` is a keyword that no reference has."""
    folder = tmp_path_factory.mktemp("data")
    rng = np.random.default_rng(0)
    for name in ("trn_a", "trn_b"):
        words = [(0.5, 0.8, "hello"), (2.1, 2.4, "hello")]
        write_clip(folder / "trn", name, 6.0, (0.4, 0.9, 1.5, 2.2, 3.1, 4.6), words, tiny.motion(rng, 180, chain(4)))
    for name, words in (("tst_a", [(1.1, 1.4, "hello")]), ("tst_b", [(0.6, 0.9, "north")])):
        write_clip(folder / "tst", name, 4.0, (0.5, 1.6), words, tiny.motion(rng, 120, chain(4)))
    return folder


def made_plan(folder: Path, setups=SETUPS, **keys) -> Path:
    folder.mkdir(exist_ok=True)
    # Windows of the Fréchet distance that clips of 4 s can fill.
    (folder / "base.yaml").write_text("acoustics: {enabled: true}\nevaluation: {frechet_windows: [5, 10]}\n")
    return write_plan(folder, setups, base="base.yaml", **keys)


@pytest.fixture(scope="module")
def prepared(recorded, tmp_path_factory):
    """Options of a work folder with clips, and the plan."""
    work, plan = tmp_path_factory.mktemp("work"), made_plan(tmp_path_factory.mktemp("plan"))
    options = ("--data", recorded, "--work", work, "-j", 1)
    succeed("preprocess", "--config", plan.parent / "base.yaml", *options)
    return plan, work


@pytest.fixture(scope="module")
def finished(recorded, prepared):
    plan, work = prepared
    printed = succeed("compare", "--config", plan, "--data", recorded, "--work", work, "-j", 1).output
    return work / "compare", printed


@pytest.fixture(scope="module")
def table(finished) -> dict:
    return json.loads((finished[0] / "compare.json").read_text())


def test_a_row_per_setup_with_every_measure(finished, table, prepared):
    folder, printed = finished
    plan = load_plan(prepared[0])
    measures = [*evaluation.measures(plan.base), *MACHINE_COLUMNS]
    assert [column["key"] for column in table["columns"]] == [measure.key for measure in measures]
    assert list(table["setups"]) == list(SETUPS)
    markdown = (folder / "compare.md").read_text()
    for measure in measures:
        assert measure.heading in printed and measure.heading in markdown
    for name in SETUPS:
        rows = len({measure.block for measure in measures})
        assert len(re.findall(rf"^\| {name} \|", markdown, re.M)) == rows
        assert plan.signature["config_hashes"][name] in printed and plan.signature["config_hashes"][name] in markdown
    assert {key: table["signature"][key] for key in plan.signature} == plan.signature
    for name in ("best", "pose_only", "mismatched", "random_stretch"):
        mean = table["setups"][name]["mean"]
        # These bones have no feet and no wrists, and a stretch without a join has no seam.
        lacking = {key for key, value in mean.items() if value is None}
        known = {"foot_skate", "foot_skate_ratio", "foot_contact_share", "rhythm", "rhythm_by_chance", "pause_speed",
                 "pause_speed_ratio", "seam_jerk_wrists", "wrist_speed_ratio", "still_share", "still_longest",
                 "knees_straight", "knee_snaps", "hands_beat", "hands_beat_z", "seam_auc", "seam_auc_upper",
                 "seam_auc_control", "frechet_velocity_ratio", "frechet_velocity_recording_ratio"}  # fmt: skip
        seams = {"join_distance_mean", "join_distance_max", "seam_jerk"}
        assert lacking <= known | (seams if mean["hard_joins_per_minute"] == 0 else set()), (name, lacking - known)


def test_csv_and_json_agree(finished, table):
    rows = list(csv.DictReader((finished[0] / "compare.csv").read_text().splitlines()))
    assert [(row["setup"], row["seed"]) for row in rows] == [
        (name, label) for name in SETUPS for label in ("0", "3", "mean", "spread")
    ] + [(name, "") for name in table["beside"]]
    assert {"(recording)", "(random stretch)"} <= set(table["beside"])
    for row in rows[: -len(table["beside"])]:
        setup = table["setups"][row["setup"]]
        figures = setup["seeds"].get(row["seed"]) or setup[row["seed"]]
        for key, value in figures.items():
            assert row[key] == "" if value is None else float(row[key]) == value
        assert row["config_hash"] == table["signature"]["config_hashes"][row["setup"]]


def test_one_row_per_setup_seed_and_clip(table):
    found = [(row["setup"], row["seed"], row["clip"]) for row in table["clips"]]
    assert found == [(name, seed, clip) for name in SETUPS for seed in (0, 3) for clip in CLIPS]
    for row in table["clips"]:
        # As in an ablation, a stuck clip has no figures.
        assert row["failure"] or 0 < row["search_seconds"] < 60


def test_failures_are_counted(table):
    assert table["setups"]["stuck"]["mean"]["failure"] >= 1
    assert all(setup["mean"]["failure"] == 0 for name, setup in table["setups"].items() if name != "stuck")


def test_memory_is_measured_at_the_first_seed(table):
    for setup in table["setups"].values():
        first = setup["seeds"]["0"]
        assert 0 < first["search_memory"] < first["peak_memory"] < 4000
        assert setup["mean"]["peak_memory"] == first["peak_memory"] and setup["spread"]["peak_memory"] is None
        assert setup["seeds"]["3"]["peak_memory"] is None


def test_a_fresh_process_is_no_larger_for_what_was_done_before():
    held = np.ones(40_000_000)  # 320 MB in this process
    mine = peak_megabytes()
    assert mine > held.nbytes / 1e6
    made = for_each({"alone": peak_megabytes}, 1, "test", quiet=True, fresh=True)
    assert made.done["alone"] < mine - 150


def test_the_baselines_are_stretches_of_the_whole_length(finished):
    for name in ("mismatched", "random_stretch"):
        for clip in CLIPS:
            trace = json.loads((finished[0] / name / f"reenact/{clip}.trace.json").read_text())
            (piece,) = trace["pieces"]  # 4 s of a reference of 6 s
            first = piece["nodes"][0]
            assert piece["nodes"] == list(range(first, first + 120)) and piece["end_kind"] == "stretch"
            assert trace["n_frames"] == 120 and trace["search"] == name and trace["method"] == "baseline"
            assert "\nFrames: 120\n" in (finished[0] / name / f"reenact/{clip}.bvh").read_text()


def test_a_random_stretch_is_drawn_by_the_seed(recorded, prepared, tmp_path):
    """Other seeds draw other stretches of one same reference."""
    plan, work = prepared
    options = ("--config", plan.parent / "base.yaml", "--data", recorded, "--work", tmp_path, "-j", 1)
    (tmp_path / "clips").symlink_to(work / "clips")
    baseline = ("--set", "method=baseline", "--set", "references.mode=all")
    succeed("build-graph", *options, *baseline)
    shown = []
    for seed in (0, 1):
        succeed("reenact", *options, *baseline, "--set", f"seed={seed}")
        shown.append((tmp_path / "reenact/tst_a.bvh").read_bytes())
    assert shown[0] != shown[1]


@pytest.mark.parametrize("name", ["best", "random_stretch", "stuck"])
def test_the_folders_work_with_evaluate(name, finished, table, recorded, prepared):
    folder = finished[0] / name
    result = run(
        "evaluate", "--config", prepared[0].parent / "base.yaml", "--data", recorded, "--work", folder, "-j", 1
    )
    assert result.exit_code == 0, result.output
    stored = json.loads((folder / "evaluate/summary.json").read_text())
    assert stored["signature"]["config_hash"] == table["signature"]["config_hashes"][name]
    ours = table["setups"][name]["seeds"]["0"]
    for key, value in stored["total"].items():
        assert ours[key] == (None if value is None else pytest.approx(value, rel=1e-3, abs=1e-6)), key


def test_the_folders_work_with_inspect(finished, recorded):
    result = succeed("inspect", "tst_a", "--data", recorded, "--work", finished[0] / "mismatched")
    assert "stretch" in result.output and "baseline/mismatched" in result.output


@pytest.mark.slow
def test_the_folders_work_with_render(finished, recorded, prepared):
    folder = finished[0] / "pose_only"
    base = prepared[0].parent / "base.yaml"
    succeed("render", "--config", base, "--data", recorded, "--work", folder, "--size", "160x120", "-j", 1)
    assert (folder / "video/tst_a.mp4").stat().st_size > 0


def test_the_page_holds_every_motion(finished, table):
    text = (finished[0] / "report.html").read_text()
    found = re.findall(r'<script type="application/json" id="clip-\d+">(.*?)</script>', text)
    stuck = {row["clip"] for row in table["clips"] if row["failure"] and row["seed"] == 0}
    for name, clip in zip(CLIPS, map(json.loads, found), strict=True):
        labels = [motion["label"] for motion in clip["motions"]]
        expected = [setup for setup in SETUPS if setup != "stuck" or name not in stuck]
        assert labels == [expected[0], "truth", *expected[1:]]
        assert clip["notes"] == (["stuck found no path for this clip"] if name in stuck else [])
        assert clip["audio"] is not None and all(motion["frames"] == 120 for motion in clip["motions"])
    for setup in SETUPS:
        assert f"all clips, {setup}" in text
    assert "time and peak memory" in text


def test_the_result_does_not_depend_on_the_number_of_workers(finished, table, recorded, prepared, tmp_path):
    """All but time and memory, which no second run repeats."""
    (tmp_path / "clips").symlink_to(prepared[1] / "clips")
    few = {name: SETUPS[name] for name in ("random_stretch",)}
    plan = made_plan(tmp_path / "plan", few)
    succeed("compare", "--config", plan, "--data", recorded, "--work", tmp_path, "-j", 2, "--quiet")
    other = json.loads((tmp_path / "compare/compare.json").read_text())
    for name in few:
        ours, theirs = (
            {key: digest for key, digest in tree(folder / name).items() if key.startswith(("graphs/", "reenact/"))}
            for folder in (finished[0], tmp_path / "compare")
        )
        assert ours == theirs and len(ours) >= 6
        for part in ("mean", "spread"):
            ours, theirs = (found["setups"][name][part] for found in (table, other))
            assert {key: ours[key] for key in ours.keys() - MACHINE} == {
                key: theirs[key] for key in theirs.keys() - MACHINE
            }


def test_the_plan_has_all_methods_and_the_papers_baselines():
    plan = load_plan(TOP / "configs/compare.yaml")
    assert plan.seeds == (0, 1, 2)
    assert plan.base == load_config(None, ["prosody.enabled=true", "acoustics.enabled=true"])
    assert {name: (config.method, config.search_name) for name, config in plan.setups.items()} == {
        "beam": ("motion_graph", "beam"), "best": ("motion_graph", "global"),
        "gesture_master": ("gesture_master", "viterbi"), "motion_matching": ("motion_matching", "nearest"),
        "pose_only": ("motion_matching", "nearest"), "mismatched": ("baseline", "mismatched"),
        "random_stretch": ("baseline", "random_stretch"),
    }  # fmt: skip
    assert plan.setups["beam"] == plan.base
    assert [name for name, config in plan.setups.items() if not config.motion_matching.use_audio] == ["pose_only"]
    comparison = load_plan(TOP / "configs/comparison.yaml").setups
    for name in ("beam", "best", "gesture_master"):
        acoustics = {"acoustics": plan.base.acoustics}
        assert plan.setups[name] == comparison[name].model_copy(update=acoustics), "those of configs/comparison.yaml"


@pytest.mark.slow
def test_the_whole_plan_on_the_demo_data(tmp_path):
    options = ("--data", tmp_path / "data", "--work", tmp_path / "work", "-j", 2, "--quiet")
    succeed("demo-data", tmp_path / "data", "--references", 1, "--tests", 1, "--quiet")
    truth = ("--set", "data.truth_split=truth")
    succeed("preprocess", "--config", TOP / "configs/compare/base.yaml", *options, *truth)
    succeed("compare", *options, *truth, "--out", tmp_path / "page.html")
    table = json.loads((tmp_path / "work/compare/compare.json").read_text())
    assert list(table["setups"]) == list(load_plan(TOP / "configs/compare.yaml").setups)
    for setup in table["setups"].values():
        assert setup["mean"]["frechet_30"] > 0 and setup["mean"]["syn"] > 0 and setup["mean"]["foot_skate"] > 0
    assert (tmp_path / "page.html").is_file() and not (tmp_path / "work/compare/report.html").exists()

"""Experiments by `ablate`: the plan they read, the figures they form, the table they write, and what they refuse."""

import csv
import json
import math
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from gesturegen import evaluation, submission
from gesturegen.data import clips
from gesturegen.errors import ConfigError
from gesturegen.experiment import causes, figures, reference_length, tables
from gesturegen.experiment.plan import SHARED, load_plan
from gesturegen.experiment.presets import ABLATE, ABLATION_COLUMNS, MACHINE, PAPER, TIME_BLOCK
from gesturegen.methods import libraries
from gesturegen.methods.motion_graph import global_search
from gesturegen.pipeline.experiment import shared_libraries
from gesturegen.settings.loading import load_config
from scripts.check_ablation import broken_guarantees, differences, reproducible
from tests import naive, tiny
from tests.builders import bursts, chain, refused, write_audio, write_clip
from tests.commands import run, tree

TOP = Path(__file__).parent.parent
FAINT = 0.014  # a burst of this size has an onset strength of 4.1; the threshold is 5
SETUPS = {
    "weak_detection": "onsets: {min_strength: 0}",
    "weak_pruning": "continuity:\n  l_pn: 1",
    "weak_initialization": "initialization: random",
    "no_termination_fallback": "termination: {fallbacks: false, failure_retries: 20}",
    "full": "# nothing",
}


def write_plan(folder: Path, setups=SETUPS, files=(), **keys) -> Path:
    """An ablation file with its setup files beside it; files : what it lists in their place."""
    folder.mkdir(exist_ok=True)
    for name, text in setups.items():
        (folder / f"{name}.yaml").write_text(text + "\n")
    listed = [f"{name}.yaml" for name in setups] if files == () else files
    plan = {"seeds": [0, 3], "setups": listed, **keys}
    path = folder / "ablation.yaml"
    path.write_text("".join(f"{key}: {json.dumps(value)}\n" for key, value in plan.items() if value is not None))
    return path


def error_of(*arguments) -> str:
    """The one line that a command refuses with."""
    result = run(*arguments)
    lines = [line for line in result.output.splitlines() if line.startswith("Error: ")]
    assert result.exit_code == 1 and len(lines) == 1 and "Traceback" not in result.output, result.output
    assert lines[0] == result.output.strip()
    return lines[0]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """Three references and two tests with true motion; the references know `hello`, one test also says `north`."""
    folder = tmp_path_factory.mktemp("data")
    rng = np.random.default_rng(0)
    for name in ("trn_a", "trn_b", "trn_c"):
        words = [(0.5, 0.8, "hello"), (2.1, 2.4, "hello")]
        write_clip(folder / "trn", name, 4.0, (0.4, 0.9, 1.5, 2.2, 3.1), words, tiny.motion(rng, 120, chain(4)))
    for name, words in (("tst_a", [(1.1, 1.4, "hello")]), ("tst_b", [(0.6, 0.9, "north")])):
        write_clip(folder / "tst", name, 2.0, (), words, tiny.motion(rng, 60, chain(4)))
        # The faint burst is an onset to the weak detection alone.
        sound = bursts((0.5, 1.6), 2.0) + FAINT * bursts((1.3,), 2.0, floor=0.0)
        write_audio(folder / f"tst/main-agent/wav/{name}.wav", sound)
    return folder


@pytest.fixture(scope="module")
def prepared(recorded, tmp_path_factory) -> Path:
    work = tmp_path_factory.mktemp("work")
    result = run("preprocess", "--data", recorded, "--work", work, "-j", 1)
    assert result.exit_code == 0, result.output
    return work


@pytest.fixture(scope="module")
def finished(recorded, prepared, tmp_path_factory):
    """The ablation of the prepared clips with one worker, and what it printed."""
    plan = write_plan(tmp_path_factory.mktemp("plan"))
    result = run("ablate", "--config", plan, "--data", recorded, "--work", prepared, "-j", 1)
    assert result.exit_code == 0, result.output
    return plan, result.output, {path.name: path.read_bytes() for path in (prepared / "ablation").iterdir()}


@pytest.fixture(scope="module")
def table(finished) -> dict:
    return json.loads(finished[2]["ablation.json"])


# --- what it writes -----------------------------------------------------------------------------------------


def test_it_writes_the_table_in_four_forms_and_nothing_else(finished):
    assert sorted(finished[2]) == ["ablation.csv", "ablation.json", "ablation.md", "ablation.png"]
    assert finished[2]["ablation.png"].startswith(b"\x89PNG")


def test_every_form_has_every_setup_the_papers_row_and_a_signature(finished, table):
    plan, printed, written = finished
    signature = load_plan(plan).signature
    assert {key: table["signature"][key] for key in signature} == signature
    for text in (printed, written["ablation.md"].decode(), written["ablation.csv"].decode()):
        for name in SETUPS:
            assert name in text and signature["config_hashes"][name] in text
        for figure in ("0.61393", "0.022278", "0.06639"):
            assert figure in text
        assert table["signature"]["version"] in text and "51" in text


def test_csv_and_json_agree(finished, table):
    rows = list(csv.DictReader(finished[2]["ablation.csv"].decode().splitlines()))
    assert [(row["setup"], row["seed"]) for row in rows] == [
        (name, label) for name in SETUPS for label in ("0", "3", "mean", "spread", "paper")
    ] + [(name, "") for name in table["beside"]]
    assert list(table["beside"]) == ["(recording)", "(truth)", "(random stretch)"]
    for row in rows[: -len(table["beside"])]:
        setup = table["setups"][row["setup"]]
        figures = setup["seeds"].get(row["seed"]) or setup[row["seed"]]
        for figure in ABLATION_COLUMNS:
            value = figures.get(figure.key)
            assert row[figure.key] == "" if value is None else float(row[figure.key]) == value


def test_one_row_per_setup_seed_and_clip(table):
    found = [(row["setup"], row["seed"], row["clip"]) for row in table["clips"]]
    assert found == [(name, seed, clip) for name in SETUPS for seed in (0, 3) for clip in ("tst_a", "tst_b")]


def test_mean_and_spread_are_those_of_the_runs(table):
    for setup in table["setups"].values():
        for key in ("syn", "div", "retries"):
            values = [run[key] for run in setup["seeds"].values()]
            assert setup["mean"][key] == pytest.approx(np.mean(values))
            assert setup["spread"][key] == pytest.approx(abs(values[0] - values[1]) / math.sqrt(2))


def test_failures_are_counted_and_not_measured(table):
    failed = {(row["setup"], row["clip"]) for row in table["clips"] if row["failure"]}
    assert failed == {("no_termination_fallback", "tst_b")}
    stuck = next(row for row in table["clips"] if row["failure"])
    assert stuck["lacking_keywords"] == ["north"] and stuck["stuck_at"]["keyword"] == "north"
    assert stuck["syn"] is None and stuck["retries"] is None
    setup = table["setups"]["no_termination_fallback"]
    assert setup["mean"]["failure"] == 1 and setup["spread"]["failure"] == 0
    other = next(r for r in table["clips"] if (r["setup"], r["clip"]) == ("no_termination_fallback", "tst_a"))
    assert setup["seeds"]["0"]["syn"] == other["syn"]


def test_the_setups_share_their_references(table):
    for seed in (0, 3):
        for clip in ("tst_a", "tst_b"):
            used = {tuple(r["references"]) for r in table["clips"] if (r["seed"], r["clip"]) == (seed, clip)}
            assert len(used) == 1


def test_the_mechanism_holds(table):
    assert list(broken_guarantees(table)) == []


def without_times(written: dict[str, bytes], printed: str) -> dict:
    """All that an ablation writes and prints but for how long its searches took, which no second run repeats."""
    left = dict(written)
    left["ablation.json"] = reproducible(json.loads(written["ablation.json"]))
    del left["ablation.json"]["checksum"]  # of the search times too
    rows = csv.DictReader(written["ablation.csv"].decode().splitlines())
    left["ablation.csv"] = [{key: cell for key, cell in row.items() if key not in MACHINE} for row in rows]
    title = re.escape(TIME_BLOCK)
    left["ablation.md"], markdown = re.subn(rf"## {title}\n\n(\|.*\n)+", "", written["ablation.md"].decode())
    left["printed"], terminal = re.subn(rf"\[{title}\]\n(.+\n)+", "", printed)
    assert markdown == terminal == 1
    return left


@pytest.mark.slow
def test_bytes_do_not_depend_on_the_number_of_workers_but_for_the_search_time(finished, recorded, prepared):
    result = run("ablate", "--config", finished[0], "--data", recorded, "--work", prepared, "-j", 2)
    assert result.exit_code == 0, result.output
    written = {path.name: path.read_bytes() for path in (prepared / "ablation").iterdir()}
    assert without_times(written, result.output) == without_times(finished[2], finished[1])


def test_the_search_time_is_measured(table):
    for row in table["clips"]:
        assert (row["search_seconds"] is None) == bool(row["failure"])
        assert row["failure"] or 0.0 < row["search_seconds"] < 60.0


def test_keep_leaves_what_reenact_writes_and_the_figures_are_those_of_evaluate(table, recorded, prepared, tmp_path):
    plan = write_plan(tmp_path / "plan", {"full": ""}, seeds=[3])
    options = ("--data", recorded, "--work", prepared, "-j", 1)
    assert run("ablate", "--config", plan, *options, "--keep").exit_code == 0
    kept = tree(prepared / "ablation/full")
    for command in ("build-graph", "reenact", "evaluate"):
        assert run(command, *options, "--set", "seed=3").exit_code == 0
    made = tree(prepared / "reenact")
    for clip in ("tst_a", "tst_b"):
        assert kept[f"3/{clip}.bvh"] == made[f"{clip}.bvh"] and f"3/{clip}.trace.json" in kept
    assert any(name.startswith("graphs/") for name in kept)
    total = json.loads((prepared / "evaluate/summary.json").read_text())["total"]
    for key in ("syn", "bc_distance", "bc_kernel", "div", "held_share", "repeated_share", "utilisation"):
        assert table["setups"]["full"]["seeds"]["3"][key] == pytest.approx(total[key], rel=1e-4), key


def test_without_matplotlib_the_rest_is_written(recorded, prepared, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    plan = write_plan(tmp_path / "plan", {"full": ""}, seeds=[0])
    result = run("ablate", "--config", plan, "--data", recorded, "--work", prepared, "-j", 1)
    assert result.exit_code == 0
    line = next(line for line in result.output.splitlines() if "ablation.png" in line)
    assert "matplotlib" in line and "pip install" in line
    assert sorted(path.name for path in (prepared / "ablation").iterdir() if path.is_file()) == [
        "ablation.csv", "ablation.json", "ablation.md",
    ]  # fmt: skip


def test_without_truth_syn_is_empty(recorded, prepared, tmp_path):
    work = tmp_path / "work"
    silent = tmp_path / "tests"
    for path in (recorded / "tst/main-agent/wav").iterdir():
        silent.mkdir(exist_ok=True)
        (silent / path.name).write_bytes(path.read_bytes())
    options = ("--data", recorded, "--tests", silent, "--work", work, "-j", 1)
    assert run("preprocess", *options).exit_code == 0
    plan = write_plan(tmp_path / "plan", {"full": ""}, seeds=[0])
    result = run("ablate", "--config", plan, *options)
    assert result.exit_code == 0, result.output
    assert json.loads((work / "ablation/ablation.json").read_text())["setups"]["full"]["mean"]["syn"] is None


# --- the objective ------------------------------------------------------------------------------------------


def test_the_objective_is_the_global_searchs_for_every_setup(recorded, prepared, tmp_path):
    """By the base's prices and pauses: those of a setup of its own change nothing."""
    setups = {
        "beam": "",
        "other_prices": "global_search: {lambda_join: 50}",
        "global": "search: global",
    }
    plan = write_plan(tmp_path / "plan", setups, seeds=[0])
    options = ("--data", recorded, "--work", prepared, "-j", 1)
    assert run("ablate", "--config", plan, *options, "--keep").exit_code == 0
    rows = {(r["setup"], r["clip"]): r for r in json.loads((prepared / "ablation/ablation.json").read_text())["clips"]}
    base = load_plan(plan).base
    for clip in ("tst_a", "tst_b"):
        trace = json.loads((prepared / f"ablation/global/0/{clip}.trace.json").read_text())
        assert rows["global", clip]["objective"] == pytest.approx(trace["objective"]["final"]["total"])
        trace = submission.read_trace(prepared / f"ablation/beam/0/{clip}.trace.json")
        graph = libraries.read(prepared / f"ablation/beam/graphs/{trace.graph}.npz")
        speech = clips.load(prepared / f"clips/{clip}.npz", base, with_motion=False).test_speech(base)
        prices = global_search.price_list(graph, speech, base)
        # What each output frame shows, for pieces of the beam are stretched to their targets.
        total = naive.Objective(prices).cost(trace.shown_nodes().tolist())["total"]
        assert rows["beam", clip]["objective"] == pytest.approx(total)
        assert rows["other_prices", clip]["objective"] == pytest.approx(total)
        assert rows["global", clip]["objective"] < total


# --- references cut to a length -----------------------------------------------------------------------------

LENGTHS = {
    f"{name}_{search}": f"references: {{seconds: {seconds}}}\nsearch: {search}"
    for name, seconds in (("2s", 2), ("6s", 6), ("all", "null"))
    for search in ("beam", "global")
}


@pytest.fixture(scope="module")
def by_length(recorded, prepared, tmp_path_factory) -> Path:
    """The work folder of an ablation of reference lengths."""
    work = tmp_path_factory.mktemp("lengths") / "work"
    shutil.copytree(prepared, work)
    folder = tmp_path_factory.mktemp("plan")
    (folder / "base.yaml").write_text("references: {mode: all}\n")
    plan = write_plan(folder, LENGTHS, base="base.yaml", seeds=[0])
    result = run("ablate", "--config", plan, "--data", recorded, "--work", work, "-j", 1, "--keep")
    assert result.exit_code == 0, result.output
    return work


def test_setups_may_cut_their_references(by_length):
    table = json.loads((by_length / "ablation/ablation.json").read_text())
    for row in table["clips"]:
        names, seconds = {"2s": ("a", 2.0), "6s": ("ab", 6.0), "all": ("abc", 12.0)}[row["setup"].split("_")[0]]
        assert row["references"] == [f"trn_{name}" for name in names]
        assert row["reference_seconds"] == pytest.approx(seconds)
    shares = {name: setup["mean"]["utilisation"] for name, setup in table["setups"].items()}
    assert shares["2s_beam"] == pytest.approx(2 / 12) and shares["6s_global"] == pytest.approx(0.5)
    assert shares["all_beam"] == pytest.approx(1.0)


def test_setups_of_one_length_share_their_graph(by_length):
    for length in ("2s", "6s", "all"):
        beam, other = (
            {path.name: path.read_bytes() for path in (by_length / f"ablation/{length}_{search}/graphs").iterdir()}
            for search in ("beam", "global")
        )
        assert beam == other and len(beam) == 1


def test_a_graph_is_built_once_for_all_setups_of_its_settings(recorded, prepared, tmp_path):
    setups = {"beam": "", "global": "search: global", "inertialize": "blend: {method: inertialize}",
              "pruned": "continuity: {l_pn: 1}"}  # fmt: skip
    plan = load_plan(write_plan(tmp_path, setups))
    chosen = {(setup, seed): {"tst_a": ("trn_a",), "tst_b": ("trn_b",)} for setup in setups for seed in plan.seeds}
    groups = shared_libraries(plan, chosen)
    assert groups == {
        (setup, (clip,)): "pruned" if setup == "pruned" else "beam" for setup in setups for clip in ("trn_a", "trn_b")
    }


def test_the_figures_by_reference_length(by_length):
    found = json.loads((by_length / "ablation/reference_length.json").read_text())
    table = json.loads((by_length / "ablation/ablation.json").read_text())
    assert found["signature"] == table["signature"] and list(found["lines"]) == ["beam", "global"]
    for search, points in found["lines"].items():
        assert [point["setup"] for point in points] == [f"{name}_{search}" for name in ("2s", "6s", "all")]
        assert [point["asked_seconds"] for point in points] == [2.0, 6.0, None]
        assert [point["reference_seconds"] for point in points] == pytest.approx([2.0, 6.0, 12.0])
        for point in points:
            rows = [row for row in table["clips"] if row["setup"] == point["setup"]]
            # Two tests of two seconds each.
            total = sum(row["join_distance_sum"] for row in rows)
            assert point["join_distance_per_minute"] == pytest.approx(total * 60.0 / 4.0)
            used = [row["reference_share"] * point["reference_seconds"] for row in rows]
            assert point["used_seconds"] == pytest.approx(np.mean(used))


def test_without_lengths_there_is_no_such_file(finished):
    assert "reference_length.json" not in finished[2]


def test_a_length_without_an_output_has_no_figures():
    stuck = {"setup": "a", "failure": 1, "seconds": 2.0, "reference_seconds": 4.0, "reference_share": math.nan}
    result = figures.Result(ABLATE, ABLATION_COLUMNS, {}, 1, {}, [stuck])
    (point,) = reference_length.table({"a": load_config(None, ["references.seconds=4"])}, result)["lines"]["beam"]
    assert point["reference_seconds"] == 4.0
    assert point["join_distance_per_minute"] is None and point["used_seconds"] is None


def test_two_lines_of_one_search_are_called_after_their_first_setup():
    settings = {
        "a": ["references.seconds=4"],
        "b": ["references.seconds=9"],
        "c": ["references.seconds=4", "blend.method=inertialize"],
        "d": ["references.seconds=4", "search=global"],
    }
    configs = {name: load_config(None, overrides) for name, overrides in settings.items()}
    rows = [{"setup": name, "failure": 1, "seconds": 2.0, "reference_seconds": 4.0} for name in configs]
    result = figures.Result(ABLATE, ABLATION_COLUMNS, {}, 1, {}, rows)
    lines = reference_length.table(configs, result)["lines"]
    assert {name: [p["setup"] for p in points] for name, points in lines.items()} == {
        "a": ["a", "b"], "c": ["c"], "global": ["d"],
    }  # fmt: skip


# --- the figures, by hand -----------------------------------------------------------------------------------


def hand_row(**own) -> dict:
    row = evaluation.failed_row(load_config()) | {"graph": "a", "references": ["a"], "unnatural_edges": 5}
    return row | {"failure": 0} | own


def test_a_runs_figures_by_hand():
    rows = [
        hand_row(syn=1.0, pieces=10, retries=3, max_uses=2, fallback_repeat=1, objective=2.0),
        hand_row(syn=2.0, pieces=20, retries=4, max_uses=7, fallback_repeat=2, objective=5.0),
        hand_row(pieces=math.nan, failure=1, graph="b", references=["b"], unnatural_edges=7),
    ]
    seconds = {"a": 10.0, "b": 20.0, "c": 30.0}
    total = figures.run_figures(rows, [], ABLATION_COLUMNS, load_config(), seconds, 120.0)
    assert total["syn"] == 1.5 and total["pieces"] == 30 and total["retries"] == 7 and total["failure"] == 1
    assert total["max_uses"] == 7 and total["fallback_repeat"] == 3 and total["objective"] == 3.5
    assert total["unnatural_edges"] == 12, "each graph counts once"
    assert total["utilisation"] == pytest.approx(1 / 12), "of the clips that have an output, as `evaluate` has it"
    assert math.isnan(total["div"])


def test_mean_and_spread_by_hand():
    by_seed = {
        seed: {"syn": value, "failure": seed, "held_share": 0.1} for seed, value in ((0, 1.0), (1, 2.0), (2, 6.0))
    }
    by_seed[1]["div"] = 0.5
    setup = figures.over_seeds(by_seed, ABLATION_COLUMNS)
    assert setup.mean["syn"] == 3.0 and setup.spread["syn"] == pytest.approx(math.sqrt(7.0))
    assert setup.mean["failure"] == 1 and setup.spread["failure"] == 1
    assert setup.mean["div"] == 0.5 and math.isnan(setup.spread["div"])
    assert setup.spread["held_share"] == 0.0, "equal figures differ from their mean by its rounding"
    assert math.isnan(setup.mean["bc_kernel"])


@pytest.mark.parametrize(
    ("mean", "spread", "text"),
    [
        (math.nan, math.nan, "-"),
        (0.123456, math.nan, "0.12346"),
        (0.123456, 0.00456, "0.1235 ± 0.0046"),
        (12345.0, 0.0, "12345 ± 0"),
        (2.0, 1.0, "2 ± 1"),
    ],
)
def test_how_a_figure_is_printed(mean, spread, text):
    assert tables.format_spread(mean, spread) == text


def test_what_is_near_a_seam():
    found = np.flatnonzero(causes.near(np.array([3, 30]), 40))
    assert found.tolist() == [*range(11), *range(22, 38)]


def test_the_checker_sees_every_difference():
    table = {"a": {"n": 1, "x": 0.5}, "rows": [{"n": 2}], "version": "1"}
    assert list(differences(table, {**table, "version": "2"})) == []
    other = {"a": {"n": 2, "x": 0.5 * (1 + 1e-7), "new": 0}, "rows": [{"n": 3}], "version": "1"}
    assert [line.split(":")[0] for line in differences(table, other)] == ["a.n", "a.new", "rows[0].n"]
    assert list(differences({"x": 0.5}, {"x": 0.50001}))


# --- the plan -----------------------------------------------------------------------------------------------


def test_the_papers_setups_change_what_the_paper_says():
    plan = load_plan(TOP / "configs/ablation.yaml")
    assert plan.seeds == (0, 1, 2) and set(plan.setups) == set(PAPER)
    full = plan.setups["full"]
    assert full.signature() == plan.base.signature() == load_config().signature()
    changed = {
        "weak_detection": full.onsets.model_copy(update={"min_strength": 0.0}),
        "weak_pruning": full.continuity.model_copy(update={"l_pn": 1}),
        "weak_initialization": "random",
        "no_termination_fallback": full.termination.model_copy(update={"fallbacks": False}),
    }
    places = dict(zip(changed, ("onsets", "continuity", "initialization", "termination"), strict=True))
    for name, value in changed.items():
        assert plan.setups[name] == full.model_copy(update={places[name]: value})
    assert load_plan().signature == plan.signature, "without --config it is the paper's"


def changed_settings(one, other) -> dict:
    """The settings of `other` that are not those of `one`, by key path."""
    ours, theirs = (clips._leaves(config.model_dump(by_alias=True)) for config in (one, other))
    return {key: theirs[key] for key in theirs if ours[key] != theirs[key]}


def test_the_plans_beyond_the_paper():
    plan = load_plan(TOP / "configs/comparison.yaml")
    assert plan.seeds == (0, 1, 2)
    assert plan.base.signature() == load_config(None, ["prosody.enabled=true"]).signature()
    assert {name: (config.search_name, config.blend.method) for name, config in plan.setups.items()} == {
        "beam": ("beam", "crossfade"), "beam_inertialize": ("beam", "inertialize"),
        "global": ("global", "crossfade"), "global_inertialize": ("global", "inertialize"),
        "best": ("global", "least_change"), "gesture_master": ("viterbi", "overlap"),
    }  # fmt: skip
    plan = load_plan(TOP / "configs/gesture_master_ablation.yaml")
    assert plan.base.signature() == load_config(TOP / "configs/gesture_master_2022.yaml").signature()
    full = plan.setups.pop("full")
    assert full == plan.base
    assert {name: changed_settings(full, config) for name, config in plan.setups.items()} == {
        "no_rhythm": {"gesture_master.upper.lambda_6": 0.0}, "no_style": {"gesture_master.style.source": "none"},
        "no_mirroring": {"gesture_master.mirror": False}, "no_smoothing": {"smoothing.enabled": False},
        "strong_rhythm": {"gesture_master.upper.lambda_4": 0.3, "gesture_master.upper.lambda_6": 2.0},
    }  # fmt: skip
    plan = load_plan(TOP / "configs/reference_length.yaml")
    assert plan.base.references.mode == "all" and plan.base.references.seconds is None
    minutes = [(config.references.seconds / 60, config.search_name) for config in plan.setups.values()]
    searches = {
        length: ["beam", "global", *["viterbi"] * (length in (1, 10, 60))] for length in (0.5, 1, 2, 5, 10, 20, 60)
    }
    assert minutes == [(length, search) for length, names in searches.items() for search in names]


def test_base_set_and_setup_are_layered_in_this_order(tmp_path):
    (tmp_path / "mine.yaml").write_text("continuity: {l_pn: 3, l_cn: 4}\nseed: 9\n")
    path = write_plan(tmp_path, {"one": "continuity: {l_pn: 1}", "two": ""}, base="mine.yaml")
    plan = load_plan(path, ["continuity.l_pn=5", "beam.l_npaths=7"])
    one, two = plan.setups["one"], plan.setups["two"]
    assert (one.continuity.l_pn, one.continuity.l_cn, one.beam.l_npaths) == (1, 4, 7)
    assert two.continuity.l_pn == 5


def test_a_setup_may_bring_its_own_keywords(tmp_path):
    (tmp_path / "few.yaml").write_text("hello: hello\n")
    path = write_plan(tmp_path, {"few_words": "keywords: {file: few.yaml}", "full": ""})
    plan = load_plan(path)
    assert plan.setups["few_words"].keywords.words == {"hello": "hello"}
    assert plan.setups["full"].keywords.words == plan.base.keywords.words


def test_all_that_stored_clips_depend_on_is_shared():
    assert {name for name in clips._SETTINGS if name.partition(".")[0] not in SHARED} <= set(SHARED)


BAD_PLANS = {
    "typo in a setup": ({"setups": {"weak": "continuity:\n  l_np: 1"}}, r"weak\.yaml:2: unknown key .*'l_pn'"),
    "wrong type in a setup": (
        {"setups": {"weak": "continuity: {l_pn: many}"}},
        r"weak\.yaml:1: continuity\.l_pn: found",
    ),
    "a setup on other data": ({"setups": {"weak": "blacklist: [a]"}}, r"weak\.yaml:1: blacklist: all setups must"),
    "a setup with its own references": (
        {"setups": {"weak": "references: {seconds: 9, mode: all}"}},
        r"weak\.yaml:1: references\.mode: all setups must",
    ),
    "a setup with other clips": ({"setups": {"weak": "onsets: {hop_length: 9}"}}, "onsets.hop_length: all setups must"),
    "a key that stands twice": ({"setups": {"weak": "resample: nearest\nresample: nearest"}}, r":2: .* stands twice"),
    "no such setup file": ({"files": ["nowhere.yaml"]}, r"ablation\.yaml:2: setups: .*nowhere\.yaml does not exist"),
    "two of one name": ({"files": ["full.yaml", "./full.yaml"]}, "two setups are called full"),
    "unknown key": ({"seed": [1]}, r"ablation\.yaml:3: unknown key 'seed'; did you mean 'seeds'"),
    "no setups": ({"files": []}, "setups: give at least one"),
    "setups missing": ({"files": None}, "there are no setups; add the key `setups`"),
    "wrong seeds": ({"seeds": ["a"]}, r"ablation\.yaml:1: seeds\.0: found \"a\""),
    "a seed twice": ({"seeds": [1, 1]}, "seeds: give at least one, and each once"),
    "no such base": ({"base": "mine.yaml"}, r"ablation\.yaml:3: base: .*mine\.yaml does not exist"),
}


GRID = """\
seeds: [0]
setups:
  - plain: {}
grid:
  name: "{variant}_{references.seconds}"
  axes:
    variant:
      slow: {blend: {l_blend: 9}, search: global}
      beam: {}
    references.seconds: {half: 0.5, all: null}
    seed_of_beam: {usual: {}}
  leave_out: [beam_all]
"""


def test_a_grid_is_every_combination_but_those_left_out(tmp_path):
    (tmp_path / "plan.yaml").write_text(GRID)
    plan = load_plan(tmp_path / "plan.yaml")
    assert list(plan.setups) == ["plain", "slow_half", "slow_all", "beam_half"]
    assert plan.setups["plain"] == plan.base
    assert changed_settings(plan.base, plan.setups["slow_half"]) == {
        "blend.l_blend": 9, "search": "global", "references.seconds": 0.5,
    }  # fmt: skip
    (tmp_path / "plan.yaml").write_text("grid: {axes: {search: [beam, global], continuity.l_pn: [1, 10]}}")
    assert list(load_plan(tmp_path / "plan.yaml").setups) == ["beam_1", "beam_10", "global_1", "global_10"]


BAD_GRIDS = {
    "what setups share": ("references.seconds", "references.k", r":10: references\.k: all setups must share it"),
    "what they share, deeper": ("l_blend: 9}", "l_blend: 9}, seed: 3", r":8: seed: all setups must share it"),
    "what shared settings cannot be": ("0.5", "many", r':10: references\.seconds: found "many"'),
    "a typo": ("l_blend", "l_bend", r":8: unknown key 'blend\.l_bend'; did you mean 'l_blend'"),
    "the same by two axes": (
        "beam: {}",
        "beam: {references: {seconds: 3}}",
        ":4: grid: two axes set references.second",
    ),
    "no such axis": ("{variant}_", "{version}_", ":5: grid.name: no axis 'version'; there are variant, references"),
    "an axis that is not told": ("{variant}_", "", ":4: grid: two setups are called half"),
    "nothing to leave out": ("[beam_all]", "[beam_al]", r":12: grid\.leave_out: .*'beam_al'; did you mean 'beam_all'"),
    "settings without labels": (
        "{usual: {}}",
        "[usual]",
        r":11: grid\.axes\.seed_of_beam: found .*, allowed: settings",
    ),
    "no settings": ("beam: {}", "beam: 3", r":7: grid\.axes\.variant: beam: found 3, allowed: settings"),
    "a name that is no folder's": ("beam: {}", "../beam: {}", r':4: grid: "../beam_half" cannot be the name'),
    "a name that is taken": ("plain", "slow_half", ":4: grid: two setups are called slow_half"),
    "an odd setup": ("plain: {}", "3", ":3: setups: found 3, allowed: the name of a file, or"),
    "too many": ("{half: 0.5, all: null}", str([*range(1, 502)]), ":4: grid: 1,002 combinations, at most 1,000"),
    "a misspelt key": ("leave_out", "leave", r":12: unknown key 'grid\.leave'; did you mean 'leave_out'"),
}


@pytest.mark.parametrize("case", BAD_GRIDS)
def test_a_bad_grid_is_one_line(case, tmp_path):
    old, new, words = BAD_GRIDS[case]
    (tmp_path / "plan.yaml").write_text(GRID.replace(old, new))
    with refused(ConfigError, rf"^{re.escape(str(tmp_path / 'plan.yaml'))}{words}"):
        load_plan(tmp_path / "plan.yaml")


@pytest.mark.parametrize("case", BAD_PLANS)
def test_a_bad_plan_is_one_line(case, tmp_path):
    keys, words = BAD_PLANS[case]
    path = write_plan(tmp_path, **{"setups": {"full": ""}, **keys})
    with refused(ConfigError, words):
        load_plan(path)
    assert error_of("ablate", "--config", path, "--work", tmp_path / "w")


def test_a_seed_is_no_setting(tmp_path):
    with refused(ConfigError, "--set seed=3: a plan has its own seeds"):
        load_plan(write_plan(tmp_path), ["seed=3"])


def test_what_must_run_first(recorded, tmp_path):
    line = error_of("ablate", "--data", recorded, "--work", tmp_path / "w")
    assert "run `gesturegen preprocess` first" in line
    assert "nowhere.yaml" in error_of("ablate", "--config", tmp_path / "nowhere.yaml")


def test_other_data_than_was_preprocessed(recorded, prepared):
    line = error_of("ablate", "--data", recorded, "--work", prepared, "--set", "data.test_split=val")
    assert "data.test_split" in line and "preprocess" in line


def test_a_clip_that_fails_stops_the_table(recorded, prepared, tmp_path):
    work = Path(shutil.copytree(prepared, tmp_path / "work"))
    (work / "clips/tst_a.npz").write_bytes(b"torn")
    shutil.rmtree(work / "ablation", ignore_errors=True)
    (work / "ablation").mkdir()
    for name in ("ablation.md", "ablation.png", "reference_length.json"):
        (work / "ablation" / name).write_text("of an earlier run")
    plan = write_plan(tmp_path / "plan", {"full": ""}, seeds=[0])
    result = run("ablate", "--config", plan, "--data", recorded, "--work", work, "-j", 1)
    assert result.exit_code == 1 and "error: tst_a, seed 0, full: " in result.output and "no table" in result.output
    assert not list((work / "ablation").iterdir())

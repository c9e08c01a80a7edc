"""The commands, end to end on tiny recordings: what they write, what they say, what they refuse."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from gesturegen.motion import bvh
from gesturegen.settings.loading import load_config
from tests import tiny
from tests.builders import bursts, chain, data_folder, write_audio, write_clip
from tests.commands import errors, run, succeed, tree

FILES = (Path(__file__).parent.parent / "docs/files.md").read_text()
COMMANDS = ("preprocess", "build-graph", "reenact", "evaluate")
REFERENCES, TESTS = ("trn_a", "trn_b"), ("tst_a", "tst_b", "tst_c")


def all_commands(data: Path, work: Path, *options):
    return [succeed(command, "--data", data, "--work", work, "-j", 1, *options) for command in COMMANDS]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """A dataset of two references and three tests, 3 s each."""
    folder = tmp_path_factory.mktemp("data")
    rng = np.random.default_rng(0)
    for name in REFERENCES:
        write_clip(folder / "trn", name, 3.0, (0.4, 0.9, 1.5, 2.2), motion=tiny.motion(rng, 90, chain(4)))
    for k, name in enumerate(TESTS):
        write_clip(folder / "tst", name, 2.0 + k / 10, (0.5, 1.1 + k / 10), with_motion=False)
    return folder


@pytest.fixture
def data(recorded, tmp_path) -> Path:
    """A copy of the dataset that a test may damage."""
    return Path(shutil.copytree(recorded, tmp_path / "data"))


@pytest.fixture(scope="module")
def finished(recorded, tmp_path_factory) -> Path:
    """The work folder of a complete run."""
    work = tmp_path_factory.mktemp("work")
    all_commands(recorded, work)
    return work


# --- what a run writes --------------------------------------------------------------------------------------


def test_a_run_writes_everything_it_documents(finished):
    names = set(tree(finished))
    assert {f"clips/{name}.npz" for name in REFERENCES + TESTS} | {"clips/index.json"} <= names
    assert {f"reenact/{name}{suffix}" for name in TESTS for suffix in (".bvh", ".trace.json")} <= names
    assert {"reenact/manifest.json", "evaluate/metrics.csv", "evaluate/summary.json"} <= names
    assert sum(name.startswith("graphs/") for name in names) == 2
    assert not [name for name in names if Path(name).name.startswith(".")]


def test_frames_are_counted_from_the_audio(finished):
    for k, name in enumerate(TESTS):
        assert bvh.read(finished / "reenact" / f"{name}.bvh").n_frames == round((2.0 + k / 10) * 30)


def test_the_output_has_the_reference_hierarchy_to_the_letter(finished, recorded):
    reference = bvh.read(recorded / "trn/main-agent/bvh/trn_a.bvh").skeleton.hierarchy
    assert bvh.read(finished / "reenact/tst_a.bvh").skeleton.hierarchy == reference


def test_the_trace_has_every_documented_field(finished):
    trace = json.loads((finished / "reenact/tst_a.trace.json").read_text())
    documented = re.search(r"trace\.json`\*\*:.*?```text\n(.*?)```", FILES, re.S)[1]
    fields = re.sub(r"\[\{.*?\}\]", "", documented, flags=re.S)
    assert list(trace) == [field.strip() for field in fields.split(",")]
    piece = re.search(r"pieces \[\{(.*?)\}\]", documented, re.S)[1]
    assert list(trace["pieces"][0]) == [field.strip() for field in piece.split(",")]
    join = re.search(r"joins \[\{(.*?)\}\]", documented, re.S)[1]
    assert list(trace["joins"][0]) == [field.strip() for field in join.split(",")]


@pytest.mark.parametrize("kind", ["clips", "graphs"])
def test_the_documents_name_every_array(finished, kind):
    path = next(p for p in sorted((finished / kind).glob("*.npz")) if "trn" in p.name)
    with np.load(path) as stored:
        missing = [name for name in stored if not re.search(rf"`{name}[ `(]", FILES)]
    assert not missing


def test_the_manifest_holds_the_hashes(finished):
    manifest = json.loads((finished / "reenact/manifest.json").read_text())
    present = tree(finished / "reenact")
    for row in manifest["clips"]:
        assert row["error"] is None
        assert row["files"] == {name: present[name] for name in row["files"]} and len(row["files"]) == 2


@pytest.mark.slow
def test_bytes_do_not_depend_on_the_number_of_workers(finished, recorded, tmp_path):
    for command in COMMANDS:
        succeed(command, "--data", recorded, "--work", tmp_path, "-j", 2)
    assert tree(tmp_path) == tree(finished)


@pytest.mark.slow
def test_another_seed_gives_other_bytes(finished, recorded, tmp_path):
    for seed in range(1, 5):  # two references in two orders: some seed deals them otherwise
        all_commands(recorded, tmp_path / str(seed), "--set", f"seed={seed}")
    others = {tree(tmp_path / str(seed))["reenact/tst_a.bvh"] for seed in range(1, 5)}
    assert others - {tree(finished)["reenact/tst_a.bvh"]}


def test_a_clip_does_not_depend_on_the_others(finished, data, tmp_path):
    manifest = json.loads((finished / "reenact/manifest.json").read_text())
    pins = {row["clip"]: row["references"] for row in manifest["clips"] if row["clip"] != "tst_a"}
    for path in (data / "tst/main-agent").rglob("tst_a.*"):
        path.unlink()
    listed = tmp_path / "pins.yaml"
    listed.write_text(json.dumps(pins))
    work = tmp_path / "work"
    all_commands(data, work, "--set", "references.mode=list", "--set", f"references.list={listed}")
    assert tree(work)["reenact/tst_b.bvh"] == tree(finished)["reenact/tst_b.bvh"]


def test_export_bvh_writes_cleaned_references(recorded, tmp_path):
    succeed("preprocess", "--data", recorded, "--work", tmp_path, "--export-bvh", tmp_path / "clean", "-j", 1)
    assert sorted(path.name for path in (tmp_path / "clean").iterdir()) == ["trn_a.bvh", "trn_b.bvh"]
    assert bvh.read(tmp_path / "clean/trn_a.bvh").n_frames == 90


def test_other_folders_side_by_side(recorded, tmp_path):
    for split, kinds in (("trn", ("bvh", "wav")), ("tst", ("wav",))):
        (tmp_path / split).mkdir()
        for kind in kinds:
            for path in (recorded / split / "main-agent" / kind).iterdir():
                shutil.copy(path, tmp_path / split)
    work = tmp_path / "work"
    for command in COMMANDS:
        succeed(command, "--references", tmp_path / "trn", "--tests", tmp_path / "tst", "--work", work, "-j", 1)
    assert (work / "reenact/tst_a.bvh").is_file()


@pytest.mark.parametrize("mode", ["all", "k", "speaker"])
def test_graphs_of_several_clips(mode, data, tmp_path):
    for split, names in (("trn", REFERENCES), ("tst", TESTS)):
        rows = "".join(f"{name},7,fingers_incl,9,finger_incl\n" for name in names)
        header = "prefix, main-agent_id, main-agent_has_fingers, interloctr_id, interloctr_has_fingers\n"
        (data / split / "metadata.csv").write_text(header + rows)
    all_commands(data, tmp_path / "work", "--set", f"references.mode={mode}", "--set", "references.k=2")
    trace = json.loads((tmp_path / "work/reenact/tst_a.trace.json").read_text())
    assert [row["clip"] for row in trace["references"]] == list(REFERENCES)
    assert trace["graph"].startswith("multi-") and [row["start_node"] for row in trace["references"]] == [0, 90]


def test_evaluate_against_the_truth_of_the_split(data, tmp_path):
    for name in TESTS:
        write_clip(data / "tst", name, 2.0, motion=tiny.motion(np.random.default_rng(5), 60, chain(4)))
    all_commands(data, tmp_path / "work")
    total = json.loads((tmp_path / "work/evaluate/summary.json").read_text())["total"]
    assert total["syn"] > 0 and total["hellinger"] > 0 and total["frechet_30"] > 0


def test_measures_against_truth_do_not_depend_on_the_number_of_workers(data, tmp_path):
    rng = np.random.default_rng(5)
    for name in TESTS:
        write_clip(data / "tst", name, 4.0, motion=tiny.motion(rng, 120, chain(4)))
    all_commands(data, tmp_path / "work")
    before = tree(tmp_path / "work/evaluate")
    succeed("evaluate", "--data", data, "--work", tmp_path / "work", "-j", 2)
    assert tree(tmp_path / "work/evaluate") == before


def test_without_truth_the_columns_are_dashes(finished):
    header, *rows = [line.split(",") for line in (finished / "evaluate/metrics.csv").read_text().splitlines()]
    for key in ("syn", "hellinger", "cca", "frechet_30"):
        assert {row[header.index(key)] for row in rows} == {""}
    assert json.loads((finished / "evaluate/summary.json").read_text())["total"]["syn"] is None


def test_evaluate_anybodys_files(finished, recorded, tmp_path):
    truth = recorded / "trn/main-agent/bvh"
    measure = (
        "evaluate",
        "--bvh",
        truth,
        "--truth",
        truth,
        "--audio",
        recorded / "trn/main-agent/wav",
        "--work",
        tmp_path,
    )
    assert "over all clips" in succeed(*measure).output
    for line in (whole := succeed(*measure, "--full").output).splitlines():
        assert len(line) <= 100 or not line.startswith(("clip ", "all ")), line
    assert "[paper]" in whole and "[usage]" in whole
    total = json.loads((tmp_path / "evaluate/summary_files.json").read_text())["total"]
    assert total["syn"] == 0 and total["hellinger"] == 0 and total["seam_jerk"] is None and total["bc_kernel"] > 0


def test_genea_compat_gives_the_published_figures(tmp_path):
    golden = data_folder() / "golden_genea"
    for folder, name in (("gen", "generated"), ("true", "truth")):
        (tmp_path / folder).mkdir()
        shutil.copy(golden / f"{name}.npz", tmp_path / folder / "clip.npz")
    succeed(
        "evaluate", "--genea-compat", "--bvh", tmp_path / "gen", "--truth", tmp_path / "true", "--work", tmp_path / "w"
    )
    total = json.loads((tmp_path / "w/evaluate/summary_files_genea.json").read_text())["total"]
    figures = json.loads((golden / "figures.json").read_text())
    assert total["jerk"] == pytest.approx(figures["generated"]["jerk"], rel=1e-12)
    assert total["acceleration"] == pytest.approx(figures["generated"]["acceleration"], rel=1e-12)
    assert total["hellinger_1"] == pytest.approx(figures["hellinger"]["1"], rel=1e-12)
    assert total["hellinger_0.05"] == pytest.approx(figures["hellinger"]["0.05"], rel=1e-12)


def test_init_writes_a_config_that_loads_and_never_overwrites(tmp_path):
    path = tmp_path / "my.yaml"
    succeed("init", path)
    assert "l_pn: 10" in path.read_text()
    path.write_text("seed: 3\n")
    assert "exists already" in errors(run("init", path))[0]
    assert path.read_text() == "seed: 3\n"
    succeed("init", path, "--force")


def test_suggest_blacklist_says_where_it_went(data, tmp_path):
    result = run("preprocess", "--suggest-blacklist", "--data", data, "--work", tmp_path / "w")
    assert result.exit_code == 2 and "gesturegen doctor DATA --blacklist FILE" in result.output
    assert not (tmp_path / "w").exists()


def test_doctor_names_still_clips_and_excludes_nothing(data, tmp_path):
    still = bvh.read(data / "trn/main-agent/bvh/trn_b.bvh")
    bvh.write(data / "trn/main-agent/bvh/trn_b.bvh", still.take(np.zeros(90, dtype=int)))
    result = succeed("doctor", data, "--work", tmp_path / "w", "--blacklist", tmp_path / "b.yaml", "-j", 1)
    assert any(line.startswith("trn/trn_b: still: near-motionless") for line in result.output.splitlines())
    assert load_config(tmp_path / "b.yaml").blacklist == ("trn_b",)
    assert sorted(path.name for path in (tmp_path / "w").iterdir() if path.suffix) == ["doctor.html"]


def test_quiet_prints_nothing(recorded, tmp_path):
    assert succeed("preprocess", "--data", recorded, "--work", tmp_path, "--quiet", "-j", 1).output == ""


# --- what is refused ----------------------------------------------------------------------------------------


def damage(path: Path, change) -> None:
    path.write_text(change(path.read_text()))


BAD_REFERENCES = {
    "truncated": (lambda text: text[: len(text) // 2], "cut off|channels"),
    "frame count": (lambda text: text.replace("Frames: 90", "Frames: 91"), "91"),
    "absurd frame count": (lambda text: text.replace("Frames: 90", "Frames: 9000000000000"), "9000000000000"),
    "nan": (lambda text: text[: text.rindex(" ")] + " nan\n", "nan"),
    "short row": (lambda text: text[: text.rindex(" ")] + "\n", "14 values|channels"),
    "channel mismatch": (lambda text: text.replace("CHANNELS 3", "CHANNELS 2", 1), "CHANNELS|word"),
    "conflict": (lambda text: text.replace("MOTION", "<<<<<<< ours\nMOTION"), "conflict"),
    "empty": (lambda text: "", "empty"),
    "binary": (lambda text: "\0\1\2" + text, "binary"),
}


@pytest.mark.parametrize("case", BAD_REFERENCES)
def test_a_broken_reference_is_one_line_and_the_rest_is_done(case, data, tmp_path):
    change, words = BAD_REFERENCES[case]
    damage(data / "trn/main-agent/bvh/trn_b.bvh", change)
    work = tmp_path / "work"
    result = run("preprocess", "--data", data, "--work", work, "-j", 1)
    assert result.exit_code == 1
    named = [line for line in errors(result) if "trn_b.bvh" in line]
    assert len(named) == 1 and re.search(words, named[0]), result.output
    assert not (work / "clips/trn_b.npz").exists()
    for command in ("build-graph", "reenact", "evaluate"):
        succeed(command, "--data", data, "--work", work, "-j", 1)
    assert (work / "reenact/tst_a.bvh").is_file()


def test_broken_tests_are_one_line_each_and_the_rest_is_done(data, tmp_path):
    wav, tsv = data / "tst/main-agent/wav", data / "tst/main-agent/tsv"
    (wav / "tst_a.wav").write_bytes((wav / "tst_a.wav").read_bytes()[:4000])
    damage(tsv / "tst_b.tsv", lambda text: text.replace("0.5", "half", 1))
    work = tmp_path / "work"
    result = run("preprocess", "--data", data, "--work", work, "-j", 1)
    assert result.exit_code == 1
    assert [name for name in TESTS for line in errors(result) if name in line] == ["tst_a", "tst_b"]
    succeed("build-graph", "--data", data, "--work", work, "-j", 1)
    result = run("reenact", "--data", data, "--work", work, "-j", 1)
    assert result.exit_code == 1 and ["failed in preprocess" in line for line in errors(result)] == [True, True, False]
    succeed("evaluate", "--data", data, "--work", work, "-j", 1)
    assert json.loads((work / "evaluate/summary.json").read_text())["total"]["failure"] == 0
    rows = json.loads((work / "reenact/manifest.json").read_text())["clips"]
    assert [row["clip"] for row in rows if row["error"]] == ["tst_a", "tst_b"]
    assert sorted(path.name for path in (work / "reenact").glob("*.bvh")) == ["tst_c.bvh"]


def test_a_failed_clip_loses_its_older_results(finished, recorded, tmp_path):
    work = Path(shutil.copytree(finished, tmp_path / "work"))
    stuck = ("--set", "termination.fallbacks=false", "--set", "keywords.words={hello: unheard, there: unheard}")
    for command in ("preprocess", "build-graph"):
        succeed(command, "--data", recorded, "--work", work, "-j", 1, *stuck)
    # The references' keywords are cut out of the graphs by excluding where they are said.
    stuck += ("--set", "exclude=[{clip: 'trn_*', from: 0.4, to: 1.6}]")
    for command in ("preprocess", "build-graph"):
        succeed(command, "--data", recorded, "--work", work, "-j", 1, *stuck)
    result = run("reenact", "--data", recorded, "--work", work, "-j", 1, *stuck)
    assert result.exit_code == 1 and len(errors(result)) == 4
    assert "keyword 'unheard'" in errors(result)[0] and "termination.fallbacks=true" in errors(result)[0]
    assert not list((work / "reenact").glob("*.bvh"))
    trace = json.loads((work / "reenact/tst_a.trace.json").read_text())
    assert trace["failure"]["keyword"] == "unheard"
    succeed("evaluate", "--data", recorded, "--work", work, "-j", 1, *stuck)
    assert json.loads((work / "evaluate/summary.json").read_text())["total"]["failure"] == 3


def test_a_missing_bvh_is_a_warning(data, tmp_path):
    (data / "trn/main-agent/bvh/trn_a.bvh").unlink()
    result = succeed("preprocess", "--data", data, "--work", tmp_path, "-j", 1)
    assert "warning: trn_a: no BVH file" in result.output


def test_mp3_named_wav_is_read_as_what_it_is(data, tmp_path):
    shutil.copy(data_folder() / "speech/tts/tts.mp3", data / "tst/main-agent/wav/tst_a.wav")
    succeed("preprocess", "--data", data, "--work", tmp_path, "-j", 1)


def test_a_compressed_copy_beside_a_wav_is_left_alone(data, tmp_path):
    for kind in ("mp3", "m4a"):
        (data / f"tst/main-agent/wav/tst_a.{kind}").write_bytes(b"never read")
    succeed("preprocess", "--data", data, "--work", tmp_path, "-j", 1)


def test_missing_wav(data, tmp_path):
    (data / "tst/main-agent/wav/tst_a.wav").unlink()
    (data / "trn/main-agent/wav/trn_a.wav").unlink()
    result = run("preprocess", "--data", data, "--work", tmp_path, "-j", 1)
    assert result.exit_code == 1
    assert ["trn_a.wav" in line or "tst_a.wav" in line for line in errors(result)[:2]] == [True, True]


REFUSED = {
    "no reference left": (["--set", "blacklist=['trn_*']"], "no reference is left of 2 after the blacklist"),
    "no such folder": (["--data", "/nowhere/at/all"], "no such folder"),
    "bad config": (["--set", "continuity.lpn=1"], "did you mean 'l_pn'"),
    "out of range": (["--set", "continuity.l_pn=0"], "continuity.l_pn: found 0"),
    "missing config": (["--config", "/nowhere.yaml"], "/nowhere.yaml"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_command_that_cannot_start_says_why(case, data, tmp_path):
    options, words = REFUSED[case]
    result = run("preprocess", "--data", data, "--work", tmp_path / "w", "-j", 1, *options)
    assert result.exit_code == 1 and len(errors(result)) == 1 and words in errors(result)[0]
    assert not (tmp_path / "w").exists()


def test_an_empty_folder(tmp_path):
    (tmp_path / "data/trn").mkdir(parents=True)
    result = run("preprocess", "--data", tmp_path / "data", "--work", tmp_path / "w")
    assert result.exit_code == 1 and "no BVH file in it" in errors(result)[0]


def test_a_folder_that_cannot_be_written(recorded, tmp_path):
    (tmp_path / "file").write_text("")
    result = run("preprocess", "--data", recorded, "--work", tmp_path / "file" / "work", "-j", 1)
    assert result.exit_code == 1 and "cannot be written" in errors(result)[0] and len(errors(result)) == 1


def test_mixed_skeletons_in_one_graph(data, tmp_path):
    other = tiny.motion(np.random.default_rng(1), 90, chain(5))
    bvh.write(data / "trn/main-agent/bvh/trn_b.bvh", other)
    options = ("--data", data, "--work", tmp_path, "-j", 1, "--set", "references.mode=all")
    succeed("preprocess", *options)
    result = run("build-graph", *options)
    assert result.exit_code == 1
    assert "trn_a and trn_b cannot share a graph: 4 joints against 5" in errors(result)[0]


@pytest.mark.parametrize(
    ("command", "before"), [("build-graph", "preprocess"), ("reenact", "preprocess"), ("evaluate", "preprocess")]
)
def test_commands_say_what_must_run_first(command, before, recorded, tmp_path):
    result = run(command, "--data", recorded, "--work", tmp_path)
    assert result.exit_code == 1 and f"gesturegen {before}" in errors(result)[0]


def test_stale_clips_and_graphs_are_not_used(finished, recorded, tmp_path):
    work = Path(shutil.copytree(finished, tmp_path / "work"))
    result = run("build-graph", "--data", recorded, "--work", work, "-j", 1, "--set", "wrists.window=9")
    assert result.exit_code == 1 and "wrists" in errors(result)[0] and "gesturegen preprocess" in errors(result)[0]
    result = run("reenact", "--data", recorded, "--work", work, "-j", 1, "--set", "continuity.l_pn=1")
    assert result.exit_code == 1 and "continuity" in errors(result)[0] and "gesturegen build-graph" in errors(result)[0]


def test_a_graph_of_older_clips_is_not_used(finished, data, tmp_path):
    work = Path(shutil.copytree(finished, tmp_path / "work"))
    path = data / "trn/main-agent/bvh/trn_a.bvh"
    bvh.write(path, bvh.read(path).take(slice(0, 60)))
    succeed("preprocess", "--data", data, "--work", work, "-j", 1)
    result = run("reenact", "--data", data, "--work", work, "-j", 1)
    assert result.exit_code == 1 and "gesturegen build-graph" in errors(result)[0] and "trn_a.npz" in errors(result)[0]


def test_a_damaged_graph_says_so(finished, recorded, tmp_path):
    work = Path(shutil.copytree(finished, tmp_path / "work"))
    path = sorted((work / "graphs").iterdir())[0]
    path.write_bytes(path.read_bytes()[:500])
    result = run("reenact", "--data", recorded, "--work", work, "-j", 1)
    assert result.exit_code == 1 and "damaged" in errors(result)[0] and path.name in errors(result)[0]


def test_a_bug_keeps_its_traceback_and_harms_no_other_clip(finished, recorded, tmp_path, monkeypatch):
    from gesturegen.methods.motion_graph import search as motion_graph

    search = motion_graph.search

    def broken(graph, speech, config, rng, earlier=()):
        return search(graph, None if speech.name == "tst_b" else speech, config, rng, earlier)

    monkeypatch.setattr(motion_graph, "search", broken)
    work = Path(shutil.copytree(finished, tmp_path / "work"))
    result = run("reenact", "--data", recorded, "--work", work, "-j", 1)
    assert result.exit_code == 1 and "Traceback" in result.output and "bug: tst_b" in result.output
    assert not (work / "reenact/tst_b.bvh").exists() and (work / "reenact/tst_c.bvh").is_file()


# --- what simply works --------------------------------------------------------------------------------------


def only_test(data: Path, name: str = "tst_a") -> Path:
    """Leave one test clip; its WAV."""
    for other in TESTS:
        if other != name:
            for path in (data / "tst/main-agent").rglob(f"{other}.*"):
                path.unlink()
    return data / f"tst/main-agent/wav/{name}.wav"


def test_silence_gives_motion(data, tmp_path):
    write_audio(only_test(data), np.zeros(16000 * 2))
    (data / "tst/main-agent/tsv/tst_a.tsv").unlink()
    results = all_commands(data, tmp_path)
    assert bvh.read(tmp_path / "reenact/tst_a.bvh").n_frames == 60
    assert "tst_a: no words, and no voice is heard, so all of it" in results[0].output


@pytest.mark.parametrize("seconds", [0.04, 1.0])
def test_short_speech(seconds, data, tmp_path):
    write_audio(only_test(data), np.random.default_rng(0).normal(size=round(16000 * seconds)) * 0.1)
    all_commands(data, tmp_path)
    assert bvh.read(tmp_path / "reenact/tst_a.bvh").n_frames == round(seconds * 30)


@pytest.mark.slow
def test_twenty_minutes_of_speech(data, tmp_path):
    times = np.cumsum(np.random.default_rng(0).uniform(0.2, 0.9, size=2000))
    write_audio(only_test(data), bursts(times[times < 1199], 1200.0))
    all_commands(data, tmp_path)
    assert bvh.read(tmp_path / "reenact/tst_a.bvh").n_frames == 36000


def test_a_reference_of_one_frame(data, tmp_path):
    for name in REFERENCES:
        path = data / f"trn/main-agent/bvh/{name}.bvh"
        bvh.write(path, bvh.read(path).take([7]))
    results = all_commands(data, tmp_path)
    assert "hold one pose" in results[2].output
    motion = bvh.read(tmp_path / "reenact/tst_a.bvh")
    assert motion.n_frames == 60 and np.ptp(motion.rotations, axis=0).max() < 1e-6


def test_missing_and_empty_transcripts(data, tmp_path):
    for path in (data / "trn/main-agent/tsv").iterdir():
        path.unlink()
    (data / "tst/main-agent/tsv/tst_a.tsv").write_text("")
    results = all_commands(data, tmp_path)
    assert "warning: tst_a: tst_a.tsv: the transcript is empty" in results[0].output


def test_other_rates_and_dialects(data, tmp_path):
    path = data / "trn/main-agent/bvh/trn_a.bvh"
    text = path.read_text().replace("Frame Time: 0.033333", "Frame Time: .0083333").replace("End Site", "End site")
    path.write_bytes(text.rstrip("\n").replace("\n", "\r\n").encode())
    results = all_commands(data, tmp_path, "--set", "references.mode=all")
    assert "trn_a.bvh: 120 fps, resampled to 30" in results[0].output

"""`reenact --variants`: different results of every clip, each a whole one, and none that passes for another run's."""

import json
import re
import shutil
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from gesturegen.methods.motion_graph import search as motion_graph
from gesturegen.path import Path as SearchPath
from gesturegen.pipeline.reenact import share_of_new_frames
from gesturegen.settings.models import Config
from scripts.regenerate_golden import GOLDEN
from tests import tiny
from tests.builders import chain, write_clip
from tests.commands import errors, run, succeed, tree

TESTS = ("tst_a", "tst_b")
SEARCHES = ("beam", "global")


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    rng = np.random.default_rng(0)
    for name in ("trn_a", "trn_b"):
        write_clip(folder / "trn", name, 3.0, (0.4, 0.9, 1.5, 2.2), motion=tiny.motion(rng, 90, chain(4)))
    for name in TESTS:
        write_clip(folder / "tst", name, 2.0, (0.5, 1.1), with_motion=False)
    return folder


@pytest.fixture(scope="module")
def built(data, tmp_path_factory) -> Path:
    """A work folder with clips and graphs."""
    work = tmp_path_factory.mktemp("built")
    for command in ("preprocess", "build-graph"):
        succeed(command, "--data", data, "--work", work, "-j", 1)
    return work


@pytest.fixture
def work(built, tmp_path) -> Path:
    return Path(shutil.copytree(built, tmp_path / "work"))


def reenact(data, work, variants, *options):
    return run("reenact", "--data", data, "--work", work, "-j", 1, "--variants", variants, *options)


def read(work: Path, name: str) -> dict:
    return json.loads((work / "reenact" / name).read_text())


def variant_folders(work: Path) -> list[str]:
    return sorted(path.name for path in work.glob("variants/*"))


# --- what they are ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("search", SEARCHES)
def test_the_first_is_the_ordinary_result_and_workers_change_no_byte(search, data, work, tmp_path):
    options = ("--data", data, "--set", f"search={search}")
    alone, parallel = (Path(shutil.copytree(work, tmp_path / name)) for name in ("alone", "parallel"))
    succeed("reenact", *options, "--work", alone, "-j", 1)
    succeed("reenact", *options, "--work", work, "-j", 1, "--variants", 3)
    succeed("reenact", *options, "--work", parallel, "-j", 2, "--variants", 3)
    assert tree(work / "reenact") == tree(alone / "reenact") and not (alone / "variants").exists()
    assert variant_folders(work) == ["2", "3"]
    assert tree(work) == tree(parallel)


@pytest.mark.parametrize("search", SEARCHES)
def test_an_earlier_variant_does_not_depend_on_how_many_follow(search, data, work):
    reenact(data, work, 2, "--set", f"search={search}")
    second = tree(work / "variants/2")
    reenact(data, work, 3, "--set", f"search={search}")
    assert tree(work / "variants/2") == second


@pytest.fixture(scope="module")
def golden(tmp_path_factory) -> dict[str, list[dict]]:
    """Four traces of the golden speaker by each search, and the lines that were printed."""
    work = tmp_path_factory.mktemp("golden")
    found = {}
    for command in ("preprocess", "build-graph"):
        succeed(command, "--data", GOLDEN, "--work", work, "-j", 1)
    for search in SEARCHES:
        printed = reenact(GOLDEN, work, 4, "--set", f"search={search}").output
        folders = [work, *(work / "variants" / str(variant) for variant in (2, 3, 4))]
        found[search] = [{**read(folder, "tst_tiny.trace.json"), "printed": printed} for folder in folders]
    return found


@pytest.mark.parametrize("search", SEARCHES)
def test_all_variants_differ_and_the_summary_says_how_much(search, golden):
    traces = golden[search]
    for one, other in combinations(traces, 2):
        assert [piece["nodes"] for piece in one["pieces"]] != [piece["nodes"] for piece in other["pieces"]]
        assert one["bvh_sha256"] != other["bvh_sha256"]
    said = re.findall(r"^tst_tiny, variant (\d): .*; (\d+)% of the frames in no earlier", traces[0]["printed"], re.M)
    assert [variant for variant, _ in said] == ["2", "3", "4"]
    if search == "global":
        assert all(int(share) > 20 for _, share in said)


def test_later_variants_of_the_global_search_are_good(golden):
    """What they cost more is less than if every frame showed what the first does."""
    first, *later = (trace["objective"]["first"] for trace in golden["global"])
    n_frames = golden["global"][0]["n_frames"]
    for number, terms in enumerate(later, 1):
        most = first["total"] - first["repeats"] + number * n_frames * Config().global_search.lambda_variant
        assert terms["total"] - terms["repeats"] <= most + 1e-3
        # Other frames are shown for that, and not the same ones at a price.
        assert terms["used"] < 0.5 * number * n_frames


@pytest.mark.parametrize("search", SEARCHES)
def test_trace_and_manifest_say_which_variant_it_is(search, data, work):
    reenact(data, work, 3, "--set", f"search={search}")
    folders = [work, work / "variants/2", work / "variants/3"]
    for variant, folder in enumerate(folders, 1):
        assert read(folder, "manifest.json")["variant"] == variant
        assert {read(folder, f"{name}.trace.json")["variant"] for name in TESTS} == {variant}
    assert len({read(folder, "tst_a.trace.json")["inputs"] for folder in folders}) == 3


def test_the_share_of_new_frames():
    graph = tiny.graph_of_positions(np.random.default_rng(0).normal(size=(80, 1, 3)), segment_starts=(0, 40))
    described = {name: getattr(graph, name) for name in graph.__dataclass_fields__}
    # Two clips of 40 frames, the second of which was cut: its node 60 is frame 120 of its recording.
    frames = np.concatenate([np.arange(40), np.arange(20), np.arange(120, 140)])
    graph = type(graph)(
        **{**described, "clip_names": ("a", "b"), "clip_starts": np.array([0, 40]), "source_frames": frames}
    )
    shown = np.array([0, 0, 39, 59, 20])
    first = np.array([15, 16, 40, 60, 20])  # near, away, another clip (though 39 frames on), away by the cut, same
    assert share_of_new_frames(shown, [first], graph) == 3 / 5
    assert share_of_new_frames(shown, [first, np.array([0, 0, 0, 59, 0])], graph) == 1 / 5
    assert share_of_new_frames(shown, [shown], graph) == 0
    # A mirrored copy has its recording's name: it shows nothing new.
    mirror = type(graph)(**{**described, "clip_names": ("a", "a"), "source_frames": np.tile(np.arange(40), 2)})
    assert share_of_new_frames(shown, [(shown + 40) % 80], replace(mirror, clip_starts=np.array([0, 40]))) == 0


def test_a_variant_that_shows_nothing_new_is_a_warning(tmp_path):
    write_clip(tmp_path / "trn", "trn_a", 1.0, (0.5,), None, tiny.motion(np.random.default_rng(0), 12, chain(4)))
    write_clip(tmp_path / "tst", "tst_a", 1.0, (0.5,), None, with_motion=False)
    work = tmp_path / "work"
    for command in ("preprocess", "build-graph"):
        succeed(command, "--data", tmp_path, "--work", work, "-j", 1)
    result = reenact(tmp_path, work, 2)
    assert result.exit_code == 0
    assert "warning: tst_a, variant 2: shows nothing that earlier variants do not; give longer references" in (
        result.output
    )


def test_fewer_than_one_is_refused(data, work):
    result = reenact(data, work, 0)
    assert result.exit_code == 2 and "--variants" in result.output


# --- each is a whole result ---------------------------------------------------------------------------------


def test_every_command_works_on_a_variant(data, work, tmp_path):
    assert reenact(data, work, 2).exit_code == 0
    second = work / "variants/2"
    # The same motions and traces as the ordinary result of a folder of its own.
    copied = tmp_path / "copied"
    for name in ("clips", "graphs"):
        shutil.copytree(work / name, copied / name)
    shutil.copytree(second / "reenact", copied / "reenact")
    for folder in (second, copied):
        assert "2 clips, all valid" in succeed("check", "--data", data, "--work", folder, "-j", 1).output
        succeed("evaluate", "--data", data, "--work", folder, "-j", 1)
        succeed("pack", "--data", data, "--work", folder, "-j", 1)
        assert "pieces" in succeed("inspect", "tst_a", "--work", folder).output
    for name in ("evaluate", "submission"):
        assert tree(second / name) == tree(copied / name)
    assert tree(work / "clips") == tree(copied / "clips") and tree(work / "graphs") == tree(copied / "graphs")


def test_the_report_shows_variants_side_by_side(data, work):
    assert reenact(data, work, 3).exit_code == 0
    compared = [word for v in (2, 3) for word in ("--compare", f"variant {v}={work / 'variants' / str(v)}")]
    result = succeed("report", "--data", data, "--work", work, "-j", 1, *compared)
    assert "2 clips to watch, 0 failed" in result.output and "warning: tst_a: variant" not in result.output
    page = (work / "report.html").read_text()
    assert "variant 2" in page and "variant 3" in page


def test_nothing_is_reenacted_into_a_variant(data, work):
    reenact(data, work, 2)
    before = tree(work)
    result = reenact(data, work / "variants/2", 1)
    assert result.exit_code == 1 and "holds a variant of" in errors(result)[0] and tree(work) == before


def test_a_work_folder_that_moves_keeps_its_variants(data, work, tmp_path):
    reenact(data, work, 2)
    moved = work.rename(tmp_path / "moved")
    succeed("evaluate", "--data", data, "--work", moved / "variants/2", "-j", 1)


# --- none passes for another run's --------------------------------------------------------------------------


def test_variants_of_an_earlier_reenact_are_removed_and_other_folders_stay(data, work):
    reenact(data, work, 4)
    (work / "variants/mine").mkdir()
    reenact(data, work, 2)
    assert variant_folders(work) == ["2", "mine"]
    succeed("reenact", "--data", data, "--work", work, "-j", 1)
    assert variant_folders(work) == ["mine"]
    (work / "variants/mine").rmdir()
    succeed("reenact", "--data", data, "--work", work, "-j", 1)
    assert not (work / "variants").exists()


def test_variants_that_cannot_be_removed_stop_the_run_and_are_no_results(data, work, tmp_path):
    reenact(data, work, 3)
    (work / "variants/2").rename(tmp_path / "elsewhere")
    (work / "variants/2").symlink_to(tmp_path / "elsewhere")
    result = reenact(data, work, 1, "--set", "seed=5")
    (line,) = errors(result)
    assert result.exit_code == 1 and "variants of an earlier run cannot be removed" in line and "variants/2" in line
    for folder in (tmp_path / "elsewhere", work / "variants/3"):
        assert (folder / "reenact/tst_a.bvh").is_file() and not (folder / "reenact/manifest.json").exists()


def test_run_keeps_variants_while_its_result_is_the_same(data, work):
    reenact(data, work, 2)
    whole = tree(work / "variants")
    (work / "reenact/tst_a.trace.json").write_text("damaged")
    go = ("run", "--data", data, "--work", work, "-j", 1)
    succeed(*go)
    assert tree(work / "variants") == whole
    succeed(*go, "--set", "blend.l_blend=4")
    assert not (work / "variants").exists()


def test_run_with_force_removes_them(data, work):
    reenact(data, work, 2)
    succeed("run", "--data", data, "--work", work, "-j", 1, "--force")
    assert not (work / "variants").exists()


def interrupt(monkeypatch, name: str) -> None:
    """Ctrl-C while the second variant of a clip is searched."""
    search = motion_graph.search

    def stopped(graph, speech, config, rng, earlier=()):
        if speech.name == name and earlier:
            raise KeyboardInterrupt
        return search(graph, speech, config, rng, earlier)

    monkeypatch.setattr(motion_graph, "search", stopped)


def test_an_interrupted_run_leaves_nothing_that_passes_for_a_result(data, work, tmp_path, monkeypatch):
    whole = Path(shutil.copytree(work, tmp_path / "whole"))
    reenact(data, whole, 2)
    reenact(data, work, 3, "--set", "seed=5")
    with monkeypatch.context() as patch:
        interrupt(patch, "tst_b")
        assert reenact(data, work, 2).exit_code == 1
    assert not (work / "variants/3").exists()
    found = set(tree(work / "variants/2/reenact"))
    assert found == {"tst_a.bvh", "tst_a.trace.json"}
    result = run("evaluate", "--data", data, "--work", work / "variants/2", "-j", 1)
    assert result.exit_code == 1 and "nothing has been reenacted there" in errors(result)[0]
    reenact(data, work, 2)
    assert tree(work) == tree(whole)


# --- clips that fail ----------------------------------------------------------------------------------------


def test_a_bug_in_one_variant_removes_the_clip_everywhere_and_harms_no_other(data, work, monkeypatch):
    assert reenact(data, work, 3).exit_code == 0
    before = tree(work)
    search = motion_graph.search

    def broken(graph, speech, config, rng, earlier=()):
        return search(graph, None if speech.name == "tst_b" and len(earlier) == 2 else speech, config, rng, earlier)

    monkeypatch.setattr(motion_graph, "search", broken)
    result = reenact(data, work, 3)
    assert result.exit_code == 1 and "bug: tst_b" in result.output and "error: 1 of 4 failed" in result.output
    for folder in (work, work / "variants/2", work / "variants/3"):
        assert {path.name for path in (folder / "reenact").iterdir()} == {
            "manifest.json", "tst_a.bvh", "tst_a.trace.json",
        }  # fmt: skip
        assert [row["error"] for row in read(folder, "manifest.json")["clips"]] == [None, "a bug of gesturegen"]
    kept = [name for name in before if "tst_a" in name]
    assert {name: tree(work)[name] for name in kept} == {name: before[name] for name in kept}


def test_stuck_clips_are_stuck_in_every_variant(data, tmp_path):
    work = tmp_path / "work"
    stuck = ("--set", "termination.fallbacks=false", "--set", "keywords.words={hello: unheard, there: unheard}")
    stuck += ("--set", "exclude=[{clip: 'trn_*', from: 0.4, to: 1.6}]")
    for command in ("preprocess", "build-graph"):
        succeed(command, "--data", data, "--work", work, "-j", 1, *stuck)
    result = reenact(data, work, 2, *stuck)
    named = [line.split(": ")[1] for line in errors(result)[:-1]]
    assert result.exit_code == 1 and named == ["tst_a", "tst_a, variant 2", "tst_b", "tst_b, variant 2"]
    for folder in (work, work / "variants/2"):
        assert not list((folder / "reenact").glob("*.bvh"))
        assert read(folder, "tst_a.trace.json")["failure"]["keyword"] == "unheard"
        succeed("evaluate", "--data", data, "--work", folder, "-j", 1, *stuck)
        assert json.loads((folder / "evaluate/summary.json").read_text())["total"]["failure"] == 2


def test_a_variant_that_gets_stuck_leaves_the_others(data, work, tmp_path, monkeypatch):
    whole = Path(shutil.copytree(work, tmp_path / "whole"))
    assert reenact(data, whole, 2).exit_code == 0
    search = motion_graph.search
    calls = []

    def second_stuck(graph, speech, config, rng, earlier=()):
        path = search(graph, speech, config, rng, earlier)
        calls.append((speech.name, len(earlier)))
        if len(earlier) == 1 and calls.count((speech.name, 1)) == 1:
            return SearchPath(path.tracks, failure=path.tracks[0].pieces[-1].target)
        return path

    monkeypatch.setattr(motion_graph, "search", second_stuck)
    result = reenact(data, work, 3)
    assert result.exit_code == 1
    assert [line.split(": ")[1] for line in errors(result)[:-1]] == ["tst_a, variant 2", "tst_b, variant 2"]
    assert "error: 2 of 6 failed" in result.output
    assert tree(work / "reenact") == tree(whole / "reenact")
    assert [row["stuck"] for row in read(work / "variants/2", "manifest.json")["clips"]] == [True, True]
    assert "2 clips, all valid" in succeed("check", "--data", data, "--work", work / "variants/3", "-j", 1).output

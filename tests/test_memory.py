"""Whether the work fits into memory: the estimate against real graphs, the number of workers, what is refused."""

import json
import shutil
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from gesturegen.data.index import FORMAT_VERSION, Index, IndexedClip, IndexedTest
from gesturegen.errors import DataError
from gesturegen.methods import libraries
from gesturegen.methods.motion_graph import global_search
from gesturegen.methods.motion_graph import graph as motion_graph
from gesturegen.pipeline import memory
from gesturegen.pipeline.memory import estimate, require_memory, require_memory_for, workers
from gesturegen.settings.loading import load_config
from gesturegen.stored import documents
from tests import tiny
from tests.builders import chain, refused, write_clip
from tests.commands import errors, run, succeed

GB = 1e9


def settings(*overrides):
    return load_config(None, overrides)


def index_of(references: dict[str, float], tests: dict[str, float]) -> Index:
    """As `preprocess` makes it, with clips that last so many seconds."""
    return Index(
        format_version=FORMAT_VERSION,
        settings="{}",
        references={name: IndexedClip(speaker=None, seconds=seconds) for name, seconds in references.items()},
        tests={name: IndexedTest(speaker=None, seconds=seconds, truth=None) for name, seconds in tests.items()},
        training_seconds=sum(references.values()),
        failed={},
    )


def test_workers_by_hand():
    assert workers([3.0, 1.0, 2.0], 8, 6.0) == 3
    assert workers([3.0, 1.0, 2.0], 8, 5.9) == 2, "any two may run at the same time, so the largest two count"
    assert workers([3.0, 1.0, 2.0], 8, 4.9) == 1 and workers([3.0, 1.0, 2.0], 8, 3.0) == 1
    assert workers([3.0, 1.0, 2.0], 8, 2.9) == 0
    assert workers([3.0, 1.0, 2.0], 2, 99.0) == 2 and workers([3.0, 1.0, 2.0], 2, None) == 2
    assert workers([], 4, 1.0) == 0


def test_200_000_frames_fit_into_16_gb_with_either_search_and_one_worker():
    for search in ("beam", "global"):
        config = settings(f"search={search}", "references.mode=all")
        # The longest test of the challenge lasts 77 s; the system takes some of the 16 GB.
        assert estimate(200_000, 77 * 30, config) < 12 * GB
        index = index_of({"a": 200_000 / 30.0}, {"t": 77.0})
        assert require_memory(config, {"t": ("a",)}, index, 1, available=12 * GB) == (1, [])


def test_more_frames_a_longer_speech_and_the_global_search_need_more():
    beam, best = settings(), settings("search=global")
    assert estimate(2000, 900, beam) > estimate(1000, 900, beam) == estimate(1000, 1800, beam)
    assert estimate(1000, 900, best) > estimate(1000, 900, beam)
    assert estimate(100_000, 1800, best) > estimate(100_000, 900, best)
    assert estimate(1000, 900, beam, kept_frames=500) > estimate(1000, 900, beam)


def test_fewer_workers_where_fewer_fit():
    config = settings("references.mode=all")
    index = index_of({"a": 3000.0, "b": 600.0}, {f"t{k}": 60.0 for k in range(8)})
    chosen = dict.fromkeys(index.tests, ("a", "b"))
    need = estimate(108_000, 1800, config)
    assert require_memory(config, chosen, index, 6, available=6 * need) == (6, [])
    jobs, ((what, warning),) = require_memory(config, chosen, index, 6, available=2.5 * need)
    assert jobs == 2 and what == "memory" and "\n" not in warning
    for part in ("2 of 6 workers", "108000 frames", f"{need / GB:.1f} GB", "references.seconds"):
        assert part in warning
    assert require_memory(config, chosen, index, 6, tasks=1, available=1.1 * need) == (6, []), "one task, one worker"


def test_what_does_not_fit_is_refused_in_one_line():
    index = index_of({"a": 3600.0}, {"t": 60.0})
    for config, advice in ((settings(), r"references.seconds\)$"), (settings("search=global"), "or search: beam$")):
        with refused(
            DataError, rf"108000 frames .* needs up to \d\.\d GB, and 0\.3 GB are free; give fewer .*{advice}"
        ):
            require_memory(config, {"t": ("a",)}, index, 4, available=0.3 * GB)


def test_references_are_counted_as_they_are_cut():
    index = index_of({"a": 100.0, "b": 100.0}, {"t": 60.0})
    for seconds, frames in (("null", 6000), ("150", 4500), ("900", 6000)):
        config = settings(f"references.seconds={seconds}")
        assert memory.reference_frames(config, ("a", "b"), index) == frames


def test_a_worker_holds_the_last_graph_until_it_has_read_the_next():
    config = settings()
    index = index_of({"a": 3000.0, "b": 2000.0}, {"t": 60.0, "u": 60.0})
    both, need = {"t": ("a",), "u": ("b",)}, estimate(90_000, 1800, config, kept_frames=60_000)
    assert require_memory(config, both, index, 1, available=1.01 * need) == (1, [])
    with refused(DataError, "90000 frames"):
        require_memory(config, both, index, 1, available=0.99 * need)
    alone = {"t": ("a",), "u": ("a",)}
    assert require_memory(config, alone, index, 1, available=0.99 * need) == (1, [])


def test_the_setups_of_an_ablation_are_counted_together():
    index = index_of({"a": 3000.0}, {"t": 60.0})
    runs = [(settings(f"references.seconds={seconds}"), {"t": ("a",)}) for seconds in (10, 3000)]
    small = sum(estimate(frames, 1800, settings(), kept) for frames, kept in ((300, 90_000), (90_000, 300)))
    assert require_memory_for(runs, index, 2, available=1.01 * small) == (2, [])
    assert require_memory_for(runs, index, 2, available=0.99 * small)[0] == 1


# --- the estimate against what is really taken --------------------------------------------------------------


def test_the_estimate_covers_the_tables_of_the_global_search():
    """What a search takes beside its graph, by numpy's own account."""
    rng = np.random.default_rng(0)
    config, beam = tiny.config(search="global"), tiny.config()
    graph = motion_graph.build([tiny.random_reference(rng, 2000)], config)

    def taken(n_frames: int) -> int:
        graph.prepared.clear()
        tracemalloc.start()
        global_search.search(graph, tiny.speech(n_frames, onsets=range(10, n_frames, 11)), config)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return peak

    taken(30)  # what is compiled or kept at the first call does not count
    for n_frames in (300, 3000):
        foreseen = estimate(2000, n_frames, config) - estimate(2000, n_frames, beam)
        assert 0.3 * foreseen < taken(n_frames) < foreseen


# --- what the machine has -----------------------------------------------------------------------------------


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_the_limit_of_a_control_group_of_version_2(tmp_path):
    root, groups = tmp_path / "cgroup", tmp_path / "groups"
    write(groups, "0::/outer/inner\n")
    write(root / "outer/inner/memory.max", "max\n")
    write(root / "outer/inner/memory.current", "100\n")
    assert memory._group_bytes(root, groups) is None, "no limit"
    write(root / "outer/memory.max", "5000\n")
    write(root / "outer/memory.current", "1500\n")
    write(root / "outer/memory.stat", "anon 900\ninactive_file 400\n")
    assert memory._group_bytes(root, groups) == 5000 - 1500 + 400


def test_the_limit_of_a_control_group_of_version_1(tmp_path):
    root, groups = tmp_path / "cgroup", tmp_path / "groups"
    write(groups, "9:name=systemd:/\n5:cpu,memory:/of/the/host\n0::/\n")
    # Inside a container the group's own files stand at the top.
    write(root / "memory/memory.limit_in_bytes", "8000\n")
    write(root / "memory/memory.usage_in_bytes", "3000\n")
    assert memory._group_bytes(root, groups) == 5000
    write(root / "memory/of/the/host/memory.limit_in_bytes", "2000\n")
    assert memory._group_bytes(root, groups) == 2000


def test_without_control_groups_there_is_no_limit(tmp_path):
    assert memory._group_bytes(tmp_path / "nowhere", tmp_path / "nothing") is None


def test_this_machine_has_some_memory():
    assert memory.available_bytes() > 0.05 * GB


# --- the commands -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """A preprocessed dataset of two references and one test."""
    folder = tmp_path_factory.mktemp("memory")
    rng = np.random.default_rng(0)
    for name in ("trn_a", "trn_b"):
        write_clip(folder / "data/trn", name, 3.0, (0.4, 0.9, 1.5, 2.2), motion=tiny.motion(rng, 90, chain(4)))
    write_clip(folder / "data/tst", "tst_a", 2.0, (0.5, 1.1), motion=tiny.motion(rng, 60, chain(4)))
    options = ("--data", folder / "data", "--work", folder / "work", "-j", 1)
    options += ("--set", "references.mode=all")
    succeed("preprocess", *options)
    return folder / "work", options


def test_building_does_not_begin_where_memory_is_short(prepared, tmp_path):
    work = Path(shutil.copytree(prepared[0], tmp_path / "work"))
    index = json.loads((work / "clips/index.json").read_text())
    index["references"]["trn_b"]["seconds"] = 1e8  # three years
    documents.write(work / "clips/index.json", index)
    data = prepared[0].parent / "data"
    (tmp_path / "plan.yaml").write_text("base: base.yaml\nsetups: [setup.yaml]\n")
    (tmp_path / "base.yaml").write_text("references: {mode: all}\n")
    (tmp_path / "setup.yaml").write_text("search: global\n")
    for command, config in (("build-graph", "base.yaml"), ("ablate", "plan.yaml")):
        result = run(command, "--config", tmp_path / config, "--data", data, "--work", work, "-j", 2)
        (line,) = errors(result)
        assert result.exit_code == 1 and "references of 3000000090 frames in one graph" in line
    assert not (work / "graphs").exists() and not (work / "ablation").exists()


def test_a_cut_graph_has_a_name_of_its_own(prepared):
    work, options = prepared
    succeed("build-graph", *options, "--set", "references.seconds=4.5")
    succeed("build-graph", *options, "--set", "references.seconds=2")
    succeed("build-graph", *options)
    names = sorted(path.name for path in (work / "graphs").iterdir())
    assert names[1:] == ["multi-" + names[0][6:18] + ".npz", "trn_a-2s.npz"] and names[0].endswith("-4.5s.npz")
    nodes = {path.name: libraries.read(path) for path in (work / "graphs").iterdir()}
    assert [nodes[name].n_nodes for name in names] == [135, 180, 60]
    whole, cut = nodes[names[1]], nodes[names[0]]
    assert cut.clip_names == whole.clip_names == ("trn_a", "trn_b")
    np.testing.assert_array_equal(cut.positions, whole.positions[:135])
    inside = whole.key_nodes.frames < 134
    np.testing.assert_array_equal(cut.key_nodes.frames[:-1], whole.key_nodes.frames[inside])
    assert cut.key_nodes.frames[-1] == 134 and cut.segment_starts.tolist() == whole.segment_starts.tolist()

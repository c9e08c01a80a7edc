"""The contract of methods: each of them, and one of the test's own that nothing else knows of, through every command."""

import csv
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gesturegen.frames import ARRAYS, ReferenceFrames, describe, join, positions_of, unfit
from gesturegen.methods import METHODS, libraries
from gesturegen.methods.method import Method
from gesturegen.path import Path as SearchPath
from gesturegen.path import Piece, Target, Track
from gesturegen.stored.arrays import Kind
from tests.commands import errors, run, succeed, tree
from tests.methods.motion_matching.test_matching_database import JOINTS
from tests.test_gesture_master import CUTTING, settings, write_recording


class Cycle(Method):
    """Shows the first second of the references again and again: nothing to be proud of, but a method."""

    name = "cycle"
    suffix = "-cycle"
    settings = ("fps", "joints", "skeleton", "positions", "keywords.words", "pauses", "references.seconds")

    def part(self, reference, config):
        return describe(reference, config), positions_of(reference.motion, config)

    def assemble(self, parts, config):
        return ReferenceFrames(
            positions=np.concatenate([positions for _, positions in parts]), **join([one for one, _ in parts])
        )

    def kind(self):
        return Kind("cycle", "build-graph", ARRAYS, 1, unfit)

    def library_type(self):
        return ReferenceFrames

    def search(self, library, speech, config, rng, earlier=()):
        starts = range(0, speech.n_frames, 30)
        cuts = [Target(start, min(start + 30, speech.n_frames), "cycle") for start in starts]
        return SearchPath((Track(tuple(Piece(cut, np.arange(cut.length), 0.0) for cut in cuts)),))


SMALL = settings(
    "joints=all", "wrists.enabled=false", "acoustics.enabled=true", "prosody.enabled=true", "prosody.hop_length=800",
    "prosody.pitch_min=150.0", "references.mode=all", f"motion_matching.joints={list(JOINTS)}",
    "motion_matching.sequence_seconds=1.0", "gesture_master.style.source=none", CUTTING,
)  # fmt: skip
NAMES = ("tst_a", "tst_b")


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("contract") / "data"
    for seed, name in enumerate(("trn_a", "trn_b", *NAMES)):
        write_recording(folder, name, 6.0 - seed, seed)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cycle", *sorted(METHODS)])
def test_every_command_takes_every_method(data, tmp_path, name, monkeypatch):
    monkeypatch.setitem(METHODS, "cycle", Cycle())
    work, method = tmp_path / "work", METHODS[name]
    options = [*SMALL, "--set", f"method={name}", "--data", data, "--work", work, "-j", 1]
    succeed("preprocess", *options)
    # Another method's library lies beside it, and stays as it is.
    succeed("build-graph", *SMALL, "--data", data, "--work", work, "-j", 1)
    before = tree(work / "graphs")
    succeed("build-graph", *options)
    assert before.items() <= tree(work / "graphs").items()
    for command in ("reenact", "evaluate", "report", "pack", "export"):
        succeed(command, *options)
    (graph,) = {path for path in (work / "graphs").glob("*.npz") if libraries.method_of(path) is method}
    assert graph.stem.endswith(method.suffix) and str(np.load(graph)["method"]) == name
    manifest = json.loads((work / "reenact/manifest.json").read_text())
    assert manifest["method"] == name
    for clip in NAMES:
        trace = json.loads((work / f"reenact/{clip}.trace.json").read_text())
        assert (trace["method"], trace["graph"]) == (name, graph.stem)
        assert trace["search"] == manifest["search"] == method.search_name(method_config(options))
        for target in (work / f"reenact/{clip}.trace.json", graph):
            assert succeed("inspect", target, *options).output
        assert f"{name}/{trace['search']}" in succeed("inspect", clip, *options).output
    with (work / "evaluate/metrics.csv").open() as file:
        assert {row["clip"] for row in csv.DictReader(file)} >= {*NAMES}
    run("check", *options)  # what it says of so short clips is not the method's matter
    succeed("doctor", data, "--out", tmp_path / "doctor.html")
    # A baseline is nothing to recommend.
    assert (name in (tmp_path / "doctor.html").read_text()) == (name != "baseline")


def method_config(options):
    from gesturegen.settings.loading import load_config

    return load_config(None, [text for key, text in pairwise(options) if key == "--set"])


def test_conditions_are_refused_by_a_method_that_cannot_follow_them(data, tmp_path, monkeypatch):
    monkeypatch.setitem(METHODS, "cycle", Cycle())
    condition = "control.conditions=[{measure: height, at_least: 50%}]"
    options = [*SMALL, "--set", "method=cycle", "--set", condition, "--data", data, "--work", tmp_path / "work"]
    result = run("preprocess", *options)
    (line,) = errors(result)
    assert "control of the hands needs search: global or method: motion_matching" in line and result.exit_code != 0


@pytest.mark.slow
def test_ablate_sets_up_any_method(data, tmp_path, monkeypatch):
    monkeypatch.setitem(METHODS, "cycle", Cycle())
    work = tmp_path / "work"
    (tmp_path / "base.yaml").write_text("{}\n")
    for name in ("cycle", "motion_graph"):
        (tmp_path / f"{name}.yaml").write_text(f"method: {name}\n")
    plan = tmp_path / "plan.yaml"
    plan.write_text("base: base.yaml\nseeds: [0]\nsetups: [motion_graph.yaml, cycle.yaml]\n")
    options = [*SMALL, "--data", data, "--work", work, "-j", 1]
    succeed("preprocess", *options)
    succeed("ablate", "--config", plan, *options)
    with (work / "ablation/ablation.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["setup"] for row in rows} >= {"cycle", "motion_graph"}

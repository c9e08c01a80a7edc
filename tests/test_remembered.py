"""A work folder remembers its settings; commands that are told no others take them, and none overwrites in silence."""

import os
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from gesturegen import remembered
from gesturegen.cli import main
from gesturegen.errors import ConfigError
from gesturegen.settings.loading import configs_folder, load_config
from tests.builders import write_dataset

SHIPPED = [name for name, _ in remembered.listing()[remembered.SETTINGS]]


def go(*arguments):
    """A command just as it is typed, unlike `tests.commands.run`."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.mark.parametrize("name", SHIPPED)
def test_what_is_kept_is_read_back(name, tmp_path):
    """Every setting of every shipped config, whatever was overridden, also when data and work folder were moved."""
    folders = {"paths.data": str(tmp_path / "here/data"), "paths.work": str(tmp_path / "here/work")}
    (tmp_path / "here/work").mkdir(parents=True)
    config = load_config(remembered.shipped(name), ("seed=7", "onsets.min_strength=1e-5"), folders)
    remembered.write(config, tmp_path / "here/work")
    (tmp_path / "here").rename(tmp_path / "there")
    again, line = remembered.load(None, (), {"paths.work": str(tmp_path / "there/work")})
    assert again.signature() == config.signature() and str(tmp_path / "there/work") in line
    assert Path(again.paths.data).resolve() == tmp_path / "there/data"


def test_names_of_configs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert remembered.shipped("best") == configs_folder() / "best.yaml"
    Path("best").write_text("seed: 1\n")
    assert remembered.shipped("best") == Path("best")
    with pytest.raises(ConfigError, match=r"bset: neither a file .* those are .*best, casia_go_2023"):
        remembered.shipped("bset")
    shown = go("configs").output
    assert all(f"  {path.stem} " in shown for path in configs_folder().glob("*.yaml"))


@pytest.fixture
def data(tmp_path):
    return write_dataset(tmp_path / "data")


def test_without_a_config_the_recommended_one_is_taken_and_named(data, tmp_path):
    result = go("preprocess", "--data", data, "--work", tmp_path / "work", "-j", 1)
    assert result.exit_code == 0 and result.stderr.splitlines()[0].startswith("settings: best, the recommended ones")
    kept, _ = remembered.load(None, (), {"paths.work": str(tmp_path / "work")})
    assert kept.signature() == load_config(configs_folder() / "best.yaml").signature()
    assert "next: gesturegen build-graph --work" in result.stderr
    quiet = go("preprocess", "--work", tmp_path / "work", "-j", 1, "--quiet")
    assert quiet.exit_code == 0 and quiet.output == ""


def test_results_of_other_settings_are_not_overwritten(data, tmp_path):
    work = tmp_path / "work"
    first = go("run", "--config", "casia_go_2023", "--data", data, "--work", work, "-j", 1)
    assert first.exit_code == 0, first.output
    before = {path: path.read_bytes() for path in work.rglob("*") if path.is_file() and path.name != ".lock"}
    for options, words in (
        (("--set", "seed=3"), r"seed: 3 \(there 0\)"),
        (("--config", "best"), r'search: "global" \(there "beam"\)'),
        (("--data", tmp_path), "paths.data"),
    ):
        for command in ("reenact", "run"):
            result = go(command, "--work", work, "-j", 1, *options)
            assert result.exit_code == 1 and re.search(rf"holds results of other settings: .*{words}", result.stderr)
            assert "--force" in result.stderr and len(result.stderr.splitlines()) <= 2
    # What is measured, and how many workers there are, changes no result.
    assert go("evaluate", "--work", work, "-j", 1, "--set", "evaluation.bc_sigma=0.2").exit_code == 0
    assert all(path.read_bytes() == content for path, content in before.items() if "evaluate" not in path.parts)
    again = go("run", "--work", work, "-j", 1)
    assert again.exit_code == 0 and f"settings: {work / 'config.yaml'}" in again.stderr
    assert go("reenact", "--work", work, "-j", 1, "--set", "seed=3", "--force").exit_code == 0
    assert remembered.load(None, (), {"paths.work": str(work)})[0].seed == 3


def test_folders_of_recordings_are_remembered_wherever_a_command_is_started(data, tmp_path, monkeypatch):
    work = tmp_path / "work"
    folders = ("--references", data / "trn", "--tests", data / "tst")
    assert go("preprocess", "--config", "casia_go_2023", *folders, "--work", work, "-j", 1).exit_code == 0
    for place in (tmp_path, data):
        monkeypatch.chdir(place)
        result = go("build-graph", "--work", os.path.relpath(work, place), "-j", 1)
        assert result.exit_code == 0, result.output
    assert str(tmp_path) not in (work / "clips/index.json").read_text()


def test_damaged_settings_are_named_and_written_anew(data, tmp_path):
    work = tmp_path / "work"
    first = ("preprocess", "--config", "casia_go_2023", "--data", data, "--work", work, "-j", 1)
    assert go(*first).exit_code == 0
    path = work / "config.yaml"
    whole = path.read_bytes()
    for damaged in (whole.replace(b"seed: 0", b"seed: 1"), whole[:-9], b""):
        path.write_bytes(damaged)
        result = go("build-graph", "--work", work)
        assert result.exit_code == 1 and "config.yaml: not as it was written; give the settings" in result.stderr
        result = go(*first)
        assert result.exit_code == 0 and "config.yaml: not as it was written; written anew" in result.stderr
        assert path.read_bytes() == whole


def test_a_refused_command_leaves_nothing_to_remember(tmp_path):
    result = go("preprocess", "--data", tmp_path / "none", "--work", tmp_path / "work")
    assert result.exit_code == 1 and not (tmp_path / "work/config.yaml").exists()

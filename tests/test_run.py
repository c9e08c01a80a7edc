"""`run`, `check` and `pack`: what is redone, what is refused, what is written."""

import json
import os
import shutil
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from gesturegen.motion import bvh, rotation
from gesturegen.motion.skeleton import Motion
from tests.builders import chain, write_audio, write_dataset
from tests.commands import errors, run, succeed, tree


@pytest.fixture
def data(tmp_path) -> Path:
    return write_dataset(tmp_path / "data")


def stamps(work: Path) -> dict[str, int]:
    """When each stored file was written."""
    return {str(path.relative_to(work)): path.stat().st_mtime_ns for path in sorted(work.rglob("*")) if path.is_file()}


def rewritten(work: Path, before: dict[str, int]) -> set[str]:
    """Stored clips, graphs and motions that are new since `before`."""
    suffixes = (".npz", ".bvh", ".trace.json")
    now = stamps(work)
    return {n for n in now if n.endswith(suffixes) and "submission" not in n and now[n] != before.get(n)}


def go(data: Path, work: Path, *options):
    return run("run", "--data", data, "--work", work, "-j", 1, *options)


def test_a_run_is_the_five_commands(data, tmp_path):
    result = go(data, tmp_path / "run")
    assert result.exit_code == 0, result.output
    for command in ("preprocess", "build-graph", "reenact", "evaluate", "pack"):
        succeed(command, "--data", data, "--work", tmp_path / "apart", "-j", 2)
        assert f"== {command}: " in result.output
    assert tree(tmp_path / "run") == tree(tmp_path / "apart")


def test_nothing_is_done_twice_and_force_does_all(data, tmp_path):
    work = tmp_path / "work"
    first = go(data, work)
    before, bytes_before = stamps(work), tree(work)
    again = go(data, work)
    assert again.exit_code == 0 and rewritten(work, before) == set()
    assert stamps(work)["evaluate/summary.json"] == before["evaluate/summary.json"]
    assert again.output == first.output
    assert go(data, work, "--force").exit_code == 0
    assert rewritten(work, before) == {
        n for n in before if n.endswith((".npz", ".bvh", ".trace.json")) and "submission" not in n
    }
    assert tree(work) == bytes_before


def test_a_changed_recording_redoes_what_depends_on_it(data, tmp_path):
    work = tmp_path / "work"
    go(data, work)
    before = stamps(work)
    write_audio(data / "tst/main-agent/wav/tst_b.wav", np.random.default_rng(3).normal(size=48000) * 0.1)
    assert go(data, work).exit_code == 0
    assert rewritten(work, before) == {"clips/tst_b.npz", "reenact/tst_b.bvh", "reenact/tst_b.trace.json"}
    assert bvh.read(work / "submission/tst_b.bvh").n_frames == 90


def test_a_changed_setting_redoes_what_depends_on_it(data, tmp_path):
    work = tmp_path / "work"
    go(data, work)
    before = stamps(work)
    assert go(data, work, "--set", "blend.l_blend=4").exit_code == 0
    assert {n.split("/")[0] for n in rewritten(work, before)} == {"reenact"}
    before = stamps(work)
    assert go(data, work, "--set", "continuity.l_pn=1").exit_code == 0
    assert {n.split("/")[0] for n in rewritten(work, before)} == {"graphs", "reenact"}


def test_an_interrupted_run_goes_on_and_ends_the_same(data, tmp_path):
    work, whole = tmp_path / "work", tmp_path / "whole"
    go(data, whole)
    shutil.copytree(whole, work)
    for name in ("reenact/tst_a.trace.json", "reenact/manifest.json", "evaluate/summary.json", "submission.zip"):
        (work / name).unlink()
    (work / "clips/trn_a.npz").write_bytes(b"half")
    before = stamps(work)
    assert go(data, work).exit_code == 0
    assert tree(work) == tree(whole)
    assert "reenact/tst_b.bvh" not in rewritten(work, before)


def test_a_damaged_result_is_made_again(data, tmp_path):
    work = tmp_path / "work"
    go(data, work)
    whole = tree(work)
    path = work / "reenact/tst_a.bvh"
    path.write_bytes(path.read_bytes()[:-50])
    assert go(data, work).exit_code == 0 and tree(work) == whole


def test_a_failing_clip_is_listed_once_and_stops_only_the_packing(data, tmp_path):
    (data / "tst/main-agent/wav/tst_a.wav").write_bytes(b"RIFF")
    result = go(data, tmp_path / "work")
    assert result.exit_code == 1
    assert len([line for line in errors(result) if "cut off" in line]) == 1
    assert (tmp_path / "work/reenact/tst_b.bvh").is_file() and not (tmp_path / "work/submission.zip").exists()


@pytest.mark.parametrize("split", ["trn", "tst"])
def test_a_dataset_with_a_missing_split(split, data, tmp_path):
    shutil.rmtree(data / split)
    result = go(data, tmp_path / "work")
    assert result.exit_code == 1 and len(errors(result)) == 1
    assert f"{split}: no such folder" in errors(result)[0]


# --- check and pack -----------------------------------------------------------------------------------------


@pytest.fixture
def ran(data, tmp_path) -> Path:
    assert go(data, tmp_path / "work").exit_code == 0
    return tmp_path / "work"


def checked(data, folder, *options):
    return run("check", folder, "--data", data, "-j", 1, *options)


def test_our_output_is_accepted(data, ran):
    result = run("check", "--data", data, "--work", ran, "-j", 1)
    assert result.exit_code == 0 and "2 clips, all valid" in result.output


def shorten(motion):
    return motion.take(slice(0, 59))


def tear(motion):
    rotations = motion.rotations.copy()
    rotations[30, 2] = rotation.multiply(rotations[30, 2], rotation.from_expmap([0.0, 2.5, 0.0]))
    return Motion(motion.skeleton, rotations, motion.positions, motion.fps)


def other_offsets(motion):
    return Motion(
        chain(4, offsets=[[10, 0, 0], [9, 0, 0], [10, 0, 0], [10, 0, 0]]), motion.rotations, motion.positions, 30.0
    )


def faster(motion):
    return Motion(motion.skeleton, motion.rotations, motion.positions, 60.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (shorten, "59 frames, the speech has 60"),
        (tear, "j2 turns"),
        (other_offsets, "joint 'j1' has OFFSET"),
        (faster, "60 fps, expected 30"),
    ],
)
def test_check_names_clip_and_problem(change, words, data, ran):
    path = ran / "submission/tst_a.bvh"
    bvh.write(path, change(bvh.read(path)))
    result = checked(data, ran / "submission")
    assert result.exit_code == 1
    assert [words in line and "tst_a" in line for line in errors(result)[:-1]] == [True]


def test_a_broken_reference_keeps_no_clip_from_the_archive(data, tmp_path):
    (data / "trn/main-agent/bvh/trn_b.bvh").write_text("")
    result = go(data, tmp_path / "work")
    assert result.exit_code == 1
    assert ["trn_b.bvh: the file is empty" in line for line in errors(result)[:-1]] == [True]
    with zipfile.ZipFile(tmp_path / "work/submission.zip") as archive:
        assert len(archive.namelist()) == 2


def test_check_without_any_readable_reference_says_why(data, ran):
    for path in (data / "trn/main-agent/bvh").iterdir():
        path.write_text("")
    (line,) = errors(checked(data, ran / "submission"))
    assert "trn_a.bvh: the file is empty" in line


def test_check_finds_missing_nameless_and_broken_files(data, ran):
    folder = ran / "submission"
    os.rename(folder / "tst_a.bvh", folder / "mine.bvh")
    (folder / "tst_b.bvh").write_text((folder / "tst_b.bvh").read_text().replace("0.033333\n", "0.033333\nnan"))
    lines = errors(checked(data, folder))
    assert ["no test clip has this name" in lines[0], "missing" in lines[1], "nan" in lines[2]] == [True] * 3
    assert "3 of 3 failed" in lines[3]


def test_stillness_is_a_warning_and_strict_an_error(data, ran):
    path = ran / "submission/tst_a.bvh"
    bvh.write(path, bvh.read(path).take([0] * 40 + list(range(20))))
    result = checked(data, ran / "submission")
    assert (
        result.exit_code == 0
        and "warning: tst_a" in result.output
        and "frames 0 to 40: no motion for 1.3 s" in result.output
    )
    assert "no motion for 1.3 s" in errors(checked(data, ran / "submission", "--strict"))[0]


def test_the_archive_holds_the_folder(ran):
    with zipfile.ZipFile(ran / "submission.zip") as archive:
        assert archive.namelist() == ["submission/tst_a.bvh", "submission/tst_b.bvh"]
        for name in archive.namelist():
            assert archive.read(name) == (ran / name).read_bytes() == (ran / "reenact" / Path(name).name).read_bytes()


def test_pack_writes_nothing_when_a_clip_is_invalid(data, ran):
    before = tree(ran / "submission")
    path = ran / "reenact/tst_a.bvh"
    bvh.write(path, shorten(bvh.read(path)))
    result = run("pack", "--data", data, "--work", ran, "-j", 1)
    assert result.exit_code == 1 and "59 frames" in errors(result)[0] and tree(ran / "submission") == before


def test_the_manifest_lists_the_run(ran):
    rows = json.loads((ran / "reenact/manifest.json").read_text())["clips"]
    assert [row["clip"] for row in rows] == ["tst_a", "tst_b"]


def test_a_bug_in_all_references_is_shown(data, tmp_path, monkeypatch):
    def prepare(*_):
        raise ZeroDivisionError("of ours")

    monkeypatch.setattr("gesturegen.data.clips.prepare", prepare)
    result = go(data, tmp_path / "work")
    assert result.exit_code == 1
    assert result.output.count("Traceback") == 1 and "ZeroDivisionError: of ours" in result.output
    assert "bug: trn_a: this is a fault of gesturegen" in result.output
    assert "bug: 3 clips more met with a bug, such as trn_b" in result.output
    assert result.output.splitlines()[-1].startswith("no reference clip could be read")


def test_the_manifest_tells_what_was_written(data, tmp_path, monkeypatch):
    """Its hashes are those of the workers that wrote, whatever somebody else puts there before it is written."""
    from gesturegen import files

    work = tmp_path / "work"
    assert go(data, work).exit_code == 0
    manifest = files.read_json(work / "reenact/manifest.json")
    for row in manifest["clips"]:
        assert list(row["files"]) == [f"{row['clip']}.bvh", f"{row['clip']}.trace.json"]
        assert all(files.sha256(work / "reenact" / name) == digest for name, digest in row["files"].items())

    def for_each(*arguments):
        outcome = real(*arguments)
        (work / "reenact/tst_a.bvh").write_text("another's")
        return outcome

    reenact = sys.modules["gesturegen.pipeline.reenact"]  # the package has a function of that name
    real = reenact.for_each
    monkeypatch.setattr(reenact, "for_each", for_each)
    succeed("reenact", "--data", data, "--work", work, "-j", 1)
    assert files.read_json(work / "reenact/manifest.json") == manifest

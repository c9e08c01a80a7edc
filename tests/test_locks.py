"""One command at a time writes into a folder; what killed ones left there is removed."""

import json
import os
import threading
from contextlib import nullcontext

import pytest

from gesturegen import files, locks
from gesturegen.errors import DataError
from tests.builders import write_dataset
from tests.commands import errors, run, succeed, tree
from tests.faults.processes import await_end, running


def locked(folder, said=None, wait=False):
    return locks.locked([folder], "gesturegen run", wait, (said if said is not None else []).append)


def as_another_process(folder):
    """Take the lock of a folder as if this process did not hold it: a lock belongs to an open file."""
    held = dict(locks._held)
    locks._held.clear()
    try:
        with locked(folder):
            pass
    finally:
        locks._held.update(held)


def test_a_folder_is_locked_once(tmp_path):
    with locked(tmp_path / "work"):
        with pytest.raises(
            DataError, match=rf"work: in use by `gesturegen run` \(process {os.getpid()}, since \d{{4}}-"
        ):
            as_another_process(tmp_path / "work")
        with locked(tmp_path / "work"):  # a command that calls another one
            pass
        as_another_process(tmp_path / "other")
    as_another_process(tmp_path / "work")
    assert tree(tmp_path) == {}


def test_parts_of_a_work_folder_have_its_lock(tmp_path):
    files.write_json(tmp_path / "work/clips/index.json", {})
    with locked(tmp_path / "work/variants/2"), pytest.raises(DataError, match=r"work: in use by"):
        as_another_process(tmp_path / "work")


def test_waiting_takes_the_lock_when_it_is_free(tmp_path):
    said, told = [], threading.Event()

    def say(line):
        said.append(line)
        told.set()

    def wait():
        with locks.locked([tmp_path], "gesturegen pack", True, say):
            files.write_text(tmp_path / "mine", "")

    with locked(tmp_path):
        locks._held.clear()
        waiting = threading.Thread(target=wait, daemon=True)
        waiting.start()
        assert told.wait(60)
        assert not (tmp_path / "mine").exists()
        locks._held[tmp_path.resolve()] = -1
    # The block has let the lock go.
    waiting.join(60)
    assert (tmp_path / "mine").exists() and said[0].endswith("; waiting for its end")


def test_workers_hold_the_lock_of_a_dead_command(tmp_path):
    """The folder is taken by the next command only when the last worker has ended."""
    with running(f"locked_command({str(tmp_path)!r})") as process:
        pids = [int(process.stdout.readline()) for _ in range(2)]
        with pytest.raises(DataError, match=rf"in use by `gesturegen run` \(process {process.pid}, since"):
            as_another_process(tmp_path)
        process.kill()
        process.wait()
        as_another_process(tmp_path)
        await_end(pids)


@pytest.mark.parametrize("when", ["before", "meanwhile"])
def test_what_was_left_half_written_is_removed(tmp_path, when):
    """By a command that was killed before, or by a worker that was killed while the command goes on."""
    work = tmp_path / "work"
    with locked(work) if when == "meanwhile" else nullcontext():
        files.write_text(work / "mine.txt", "mine")
        for place in (work, work / "clips", work / "variants/2/reenact", work / "data"):
            place.mkdir(parents=True, exist_ok=True)
            files._new_temporary(place).close()
    if when == "before":
        assert len(tree(work)) == 5
        with locked(work):
            assert len(tree(work)) == 3  # the lock as well
    left = list(tree(work))
    assert left[1:] == ["mine.txt"] and left[0].startswith("data/")  # not ours to look through


def test_a_file_system_without_locks_is_told_of(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(37, "No locks available")

    monkeypatch.setattr(locks.fcntl, "flock", refuse)
    said = []
    with locked(tmp_path, said):
        files.write_text(tmp_path / "mine", "")
    assert len(said) == 1 and "no locks (No locks available)" in said[0]


def test_commands_that_write_are_refused_and_those_that_read_are_not(tmp_path):
    data, work = write_dataset(tmp_path / "data"), tmp_path / "work"
    with locked(work):
        held = dict(locks._held)
        locks._held.clear()
        for command in (
            "preprocess",
            "build-graph",
            "reenact",
            "evaluate",
            "pack",
            "run",
            "report",
            "render",
            "export",
        ):
            result = run(command, "--data", data, "--work", work, "-j", 1)
            assert result.exit_code == 1 and len(errors(result)) == 1, command
            assert "in use by `gesturegen run`" in result.output
        assert "in use" not in run("check", "--data", data, "--work", work, "-j", 1).output
        assert "in use" not in run("inspect", "clip", "--work", work).output
        locks._held.update(held)


def test_an_index_finds_its_recordings_when_folders_move(tmp_path):
    from gesturegen.pipeline.common import read_index
    from gesturegen.settings.loading import load_config

    data, work = tmp_path / "data", tmp_path / "work"
    succeed("demo-data", data, "--references", 1, "--tests", 1, "--quiet", "-j", 1)
    options = ("--set", "data.truth_split=truth", "--quiet", "-j", 1)
    succeed("preprocess", "--data", data, "--work", work, *options)
    stored = json.loads((work / "clips/index.json").read_text())
    assert str(tmp_path) not in json.dumps(stored)

    def found(data, work):
        config = load_config(None, ("data.truth_split=truth",), {"paths.data": str(data), "paths.work": str(work)})
        (row,) = read_index(config).tests.values()
        return row.audio, row.truth

    before = found("nowhere", work)
    assert all(os.path.isfile(path) for path in before) and all(str(data) in path for path in before)
    together = (tmp_path / "elsewhere/deep").resolve()
    together.mkdir(parents=True)
    data.rename(together / "data")
    work.rename(together / "work")
    assert found("nowhere", together / "work") == tuple(path.replace(str(tmp_path), str(together)) for path in before)
    moved = tmp_path / "moved"
    (together / "data").rename(moved)
    assert all(path.startswith(str(moved)) and os.path.isfile(path) for path in found(moved, together / "work"))

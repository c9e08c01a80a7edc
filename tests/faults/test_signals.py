"""Real commands, stopped in every stage and started again: they end at once, in one line, and go on to the same bytes."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from tests.builders import write_dataset
from tests.commands import succeed, tree
from tests.faults.processes import ENVIRONMENT, PATIENCE, await_end, children, started

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write_dataset(tmp_path_factory.mktemp("signals") / "data")


def run_command(data, work, jobs, *more):
    return (
        "-m",
        "gesturegen",
        "run",
        "--data",
        data,
        "--work",
        work,
        "-j",
        jobs,
        "--quiet",
        "--config",
        "casia_go_2023",
        *more,
    )


def await_file(process, work, pattern):
    """Until a command has the lock of its work folder, and a file of a stage is there."""
    give_up = time.monotonic() + PATIENCE
    while not (_holds_lock(process, work) and any(work.glob(pattern))):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < give_up, pattern
        time.sleep(0.001)


def _holds_lock(process, work):
    try:
        return json.loads((work / ".lock").read_text())["pid"] == process.pid
    except (OSError, ValueError):
        return False


def descendants(pid):
    own = children(pid) if sys.platform == "linux" else []
    return own + [other for child in own for other in descendants(child)]


# What is there when a stage begins, the signal, and the workers.
STAGES = [
    (".lock", signal.SIGHUP, 2),
    ("clips/*.npz", signal.SIGTERM, 2),
    ("clips/index.json", signal.SIGINT, 1),
    ("graphs/*.npz", signal.SIGKILL, 2),
    ("reenact/*.trace.json", signal.SIGTERM, 1),
]


def test_a_run_stopped_in_every_stage_ends_in_the_same_bytes(data, tmp_path):
    whole, work = tmp_path / "whole", tmp_path / "work"
    succeed(*run_command(data, whole, 1)[2:])
    for pattern, number, jobs in STAGES:
        with started(*run_command(data, work, jobs)) as process:
            await_file(process, work, pattern)
            pids = descendants(process.pid)
            process.send_signal(number)
            output, said = process.communicate()
        assert "Traceback" not in said and output == "", said
        if number == signal.SIGKILL:
            assert process.returncode == -number
        else:
            assert process.returncode == 128 + number
            assert said == f"stopped by {number.name}; the same command goes on where it stopped\n"
        await_end(pids)
    with started(*run_command(data, work, 2)) as process:
        assert process.communicate() == ("", "")  # --quiet: not one word
    assert process.returncode == 0
    assert tree(work) == tree(whole)


def test_two_runs_in_one_folder_do_not_mix(data, tmp_path):
    work, other = tmp_path / "work", tmp_path / "other"
    with started(*run_command(data, work, 2)) as first:
        await_file(first, work, ".lock")
        with started(*run_command(data, work, 2, "--set", "seed=9")) as second:
            _, refused = second.communicate()
        assert second.returncode == 1 and refused.count("\n") == 1, refused
        assert f"(process {first.pid}, since " in refused and "in use by `gesturegen run --data" in refused
        with started(*run_command(data, work, 2, "--set", "seed=9", "--wait", "--force")) as second:
            assert second.communicate() == ("", "")
        assert first.wait(PATIENCE) == 0 and second.returncode == 0
    succeed(*run_command(data, other, 1, "--set", "seed=9")[2:])
    assert tree(work) == tree(other)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="SKIPPED: this system has no /dev/full")
@pytest.mark.parametrize("arguments", [("--help",), ("run", "--help"), ("--version",)])
def test_a_full_standard_output_is_one_line(arguments):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "gesturegen", *arguments],
            env=ENVIRONMENT,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode == 1
    assert done.stderr == "error: standard output cannot be written (No space left on device); send it elsewhere\n"


def test_a_closed_pipe_ends_in_silence():
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "-m", "gesturegen", "--help"],
        env=ENVIRONMENT,
        stdout=writing,
        stderr=subprocess.PIPE,
        text=True,
    )
    os.close(writing)
    assert done.stderr == "" and done.returncode == 1


def test_closed_standard_files_are_no_places_for_locks(data, tmp_path):
    """Else what is printed could end up in a file of ours."""
    call = [sys.executable, "-m", "gesturegen", *map(str, run_command(data, tmp_path / "work", 2)[2:])]
    done = subprocess.run(["sh", "-c", '"$@" <&- >&- 2>&-', "sh", *call], env=ENVIRONMENT)
    assert done.returncode == 0 and (tmp_path / "work/submission.zip").is_file()

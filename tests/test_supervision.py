"""Signals end a command and its workers at once, whatever they are doing; a death is explained in one line."""

import os
import signal
import sys

import pytest

from gesturegen import supervision
from tests.faults.processes import await_end, children, running

NEEDS_PROC = pytest.mark.skipif(sys.platform != "linux", reason="SKIPPED: the kernel ends workers on Linux only")


def pids_of(process, count: int) -> list[int]:
    """Of the processes that work, once they do."""
    return [int(process.stdout.readline()) for _ in range(count)]


@pytest.mark.parametrize(("number", "jobs"), [(signal.SIGHUP, 1), (signal.SIGINT, 1), (signal.SIGTERM, 2)])
def test_a_signal_ends_everything_in_one_line(number, jobs):
    with running(f"command({jobs})") as process:
        pids = pids_of(process, jobs)
        process.send_signal(number)
        process.send_signal(number)
        output, said = process.communicate()
        assert (output, said) == ("", f"stopped by {number.name}\n")
        assert process.returncode == 128 + number
        await_end(pids)


@NEEDS_PROC
def test_whoever_is_killed_takes_the_others_along():
    with running("command(2)") as process:
        pids = pids_of(process, 2)
        (child,) = children(process.pid)
        process.kill()
        process.wait()
        await_end([child, *pids])


@NEEDS_PROC
def test_a_command_that_is_killed_is_told_of():
    with running("command(2)") as process:
        pids = pids_of(process, 2)
        (child,) = children(process.pid)
        os.kill(child, signal.SIGKILL)
        _, said = process.communicate()
        assert said.startswith("error: the program was ended by SIGKILL: most likely out of memory")
        assert process.returncode == 128 + signal.SIGKILL
        await_end(pids)


def test_a_crash_names_its_signal_and_clip():
    with running(f"command(1, {int(signal.SIGSEGV)})") as process:
        _, said = process.communicate()
    assert said.startswith("error: the program was ended by SIGSEGV: a crash in compiled code, not for lack of memory")
    assert said.count("\n") == 1 and said.endswith("(at clip clip7)\n")
    assert process.returncode == 128 + signal.SIGSEGV


def test_what_is_likely_of_each_signal():
    told = {name: supervision.describe_death(-getattr(signal, name)) for name in ("SIGKILL", "SIGSEGV", "SIGBUS")}
    assert "out of memory" in told["SIGKILL"] and "not for lack of memory" in told["SIGSEGV"]
    assert "disk" in told["SIGBUS"]
    assert "exit code 3" in supervision.describe_death(3)

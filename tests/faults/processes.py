"""Programs for tests that end processes, and what is left of them."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}
# Longer than any test may take: what sleeps so long ends because it is ended.
FOREVER = 1000
PATIENCE = 120


def sleep_in_compiled_code() -> None:
    """Say which process this is, then hold the interpreter as a compiled loop does: nothing in Python can run."""
    os.write(1, f"{os.getpid()}\n".encode())  # at once: several processes write here
    ctypes.PyDLL(None).sleep(FOREVER)


def die_of(number: int) -> None:
    os.kill(os.getpid(), number)


def die_once_of(number: int, mark: Path) -> str:
    """Die the first time, and return the second time."""
    if not mark.exists():
        mark.write_text("")
        die_of(number)
    return "alive"


def work(jobs: int) -> None:
    """A command that is in compiled code in all of its processes."""
    from gesturegen.parallel import for_each

    for_each({f"clip{n}": sleep_in_compiled_code for n in range(jobs)}, jobs, "test", quiet=True)


def command(jobs: int, number: int | None = None) -> None:
    """The program: `work` under supervision, or dying of a signal."""
    from gesturegen import supervision

    if number is None:
        supervision.supervise(partial(work, jobs))
        return

    def crash() -> None:
        supervision.set_task("clip7")
        die_of(number)

    supervision.supervise(crash)


def locked_command(folder: str) -> None:
    """The program: `work` by two workers that write into a locked folder."""
    from gesturegen import locks, supervision

    def run() -> None:
        with locks.locked([Path(folder)], "gesturegen run", False, print):
            work(2)

    supervision.supervise(run)


@contextmanager
def started(*arguments: object) -> Iterator[subprocess.Popen]:
    """A Python program in a process of its own; killed at the end if it still runs."""
    process = subprocess.Popen(
        [sys.executable, *map(str, arguments)], env=ENVIRONMENT, cwd=ROOT, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=_defaults,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def running(call: str) -> AbstractContextManager[subprocess.Popen]:
    """A program that makes one call of this module."""
    return started("-c", f"from tests.faults import processes; processes.{call}")


def _defaults() -> None:
    """However the tests are run, the program's signals are as in a shell."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{pid}/stat")
    try:  # dead, but not yet waited for by whoever inherited it
        return status.read_text().rpartition(")")[2].split()[0] not in ("Z", "X") if Path("/proc").is_dir() else True
    except OSError:
        return False


def await_end(pids: list[int]) -> None:
    """Fails when one of the processes is still there after a patient while."""
    give_up = time.monotonic() + PATIENCE
    while any(map(is_alive, pids)):
        assert time.monotonic() < give_up, [pid for pid in pids if is_alive(pid)]
        time.sleep(0.01)


def children(pid: int) -> list[int]:
    """The processes that a process has started, on Linux."""
    text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    return [int(word) for word in text.split()]

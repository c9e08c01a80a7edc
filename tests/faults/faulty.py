"""Running commands that are killed at chosen moments, and looking at what they leave."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from tests.commands import tree

TOP = Path(__file__).parent.parent.parent
CALL = "import os; os.environ['FAULT_COMMAND'] = str(os.getpid()); from gesturegen.cli import main; main()"
# Only for what never ends: it is not reached by a slow machine.
PATIENCE = 600


@dataclass(frozen=True)
class Fault:
    """A signal at the change number `number` (from 1) to what a stage writes.

    stages : folders below the work folder; target : `self`, the process that makes the change, or `command`
    """

    stages: tuple[str, ...]
    number: int
    target: str
    signal: int


@dataclass(frozen=True)
class Ended:
    """How a command ended; changes : how many it made to each folder below the work folder."""

    code: int
    output: str
    changes: dict[str, int]
    struck: bool


def start(options: list[str], **popen) -> subprocess.Popen:
    """A command in a process of its own, whose output is kept together."""
    environment = os.environ | {"PYTHONPATH": str(TOP)} | popen.pop("env", {})
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "stdin": subprocess.DEVNULL}
    return subprocess.Popen([sys.executable, "-c", CALL, *options], text=True, env=environment, **streams | popen)


def run_with(options: list[str], work: Path, log: Path, fault: Fault | None = None) -> Ended:
    """Run a command and strike it; nothing of it is alive afterwards."""
    shutil.rmtree(log, ignore_errors=True)
    log.mkdir(parents=True)
    hook = {
        "PYTHONPATH": os.pathsep.join((str(Path(__file__).parent / "hook"), str(TOP))),
        "FAULT_WORK": str(work), "FAULT_LOG": str(log), "FAULT": json.dumps(asdict(fault) if fault else None),
    }  # fmt: skip
    process = start(options, env=hook)
    output, _ = process.communicate(timeout=PATIENCE)
    wait_for_end_of(str(log))
    changes = {path.name: path.stat().st_size for path in log.iterdir()}
    return Ended(process.returncode, output, changes, changes.pop("killed", 0) > 0)


def wait_for_end_of(mark: str) -> None:
    """Wait until no process is left that has `mark` in its environment; AssertionError when one stays."""
    give_up = time.monotonic() + PATIENCE / 10
    while left := _processes_with(mark):
        assert time.monotonic() < give_up, f"still alive: {left}"
        time.sleep(0.02)


def _processes_with(mark: str) -> dict[int, str]:
    found = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit() and int(folder.name) != os.getpid():
            try:
                if mark.encode() in (folder / "environ").read_bytes():
                    found[int(folder.name)] = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()[:200]
            except OSError:
                continue  # it has ended, or is not ours
    return found


def same(work: Path, calm: Path) -> None:
    """Both folders hold the same files with the same bytes, hidden ones as well."""
    found, expected = tree(work), tree(calm)
    differing = sorted(name for name in found | expected if found.get(name) != expected.get(name))
    assert not differing, f"not as after an undisturbed run: {', '.join(differing)}"


def told(ended: Ended) -> list[str]:
    """The lines of a command that was refused or struck; there is never a traceback."""
    assert "Traceback" not in ended.output, ended.output
    return ended.output.splitlines()

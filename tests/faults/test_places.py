"""Folders that cannot be written, a disk that is full, and no home: one line, nothing half-written, and on from there."""

import ctypes
import os
import shutil
import subprocess
import sys

import pytest

from tests.commands import tree
from tests.faults import cases, faulty

pytestmark = pytest.mark.slow
CONFIG = "casia_go_2023"
IS_ROOT = hasattr(os, "geteuid") and os.geteuid() == 0


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return cases.write_data(tmp_path_factory.mktemp("places") / "data")


@pytest.fixture(scope="module")
def calm(data, tmp_path_factory):
    """What an undisturbed run writes."""
    work = tmp_path_factory.mktemp("calm") / "disk" / "work"  # as deep as the others: the index has relative paths
    ended = run(cases.arguments(CONFIG, data, work))
    assert ended == (0, ""), ended
    return work


def run(options, **popen) -> tuple[int, str]:
    process = faulty.start(options, **popen)
    output, _ = process.communicate(timeout=faulty.PATIENCE)
    return process.returncode, output


def bound_by_modes() -> None:
    """Let modes of files hold for root as well: it loses the capability to pass over them."""
    if IS_ROOT:
        libc, drop = ctypes.CDLL(None, use_errno=True), 24  # PR_CAPBSET_DROP
        for capability in (1, 2):  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
            if libc.prctl(drop, capability, 0, 0, 0):
                raise OSError(ctypes.get_errno(), "capabilities cannot be dropped")


def set_modes(folder, folders: int, files: int) -> None:
    for place, _, names in os.walk(folder):
        os.chmod(place, folders)
        for name in names:
            os.chmod(os.path.join(place, name), files)


def refused(ended: tuple[int, str], *parts: str) -> None:
    """One line that says what and where."""
    code, output = ended
    assert code == 1 and output.count("\n") == 1 and all(part in output for part in parts), ended


def test_data_that_cannot_be_written_is_only_read(data, calm, tmp_path):
    shutil.copytree(data, tmp_path / "data")
    before = tree(tmp_path / "data")
    set_modes(tmp_path / "data", 0o555, 0o444)
    try:
        ended = run(cases.arguments(CONFIG, tmp_path / "data", tmp_path / "work"), preexec_fn=bound_by_modes)
        assert ended == (0, ""), ended
        assert tree(tmp_path / "data") == before
    finally:
        set_modes(tmp_path / "data", 0o755, 0o644)


@pytest.mark.parametrize("there", ["nothing", "a whole run"])
def test_a_work_folder_that_cannot_be_written_is_one_line(there, data, calm, tmp_path):
    work = tmp_path / "work"
    if there == "nothing":
        work.mkdir()
    else:
        shutil.copytree(calm, work)
    before = tree(work)
    set_modes(work, 0o555, 0o444)
    try:
        ended = run([*cases.arguments(CONFIG, data, work), "--set", "seed=5"], preexec_fn=bound_by_modes)
        refused(ended, str(work), "cannot be written", "--work")
        assert tree(work) == before
    finally:
        set_modes(work, 0o755, 0o644)


@pytest.fixture
def small_disk(tmp_path):
    """A file system in memory that holds much less than a run writes."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=200k", "none", place], capture_output=True, text=True)
    if mounted.returncode != 0:
        pytest.skip(f"SKIPPED: no small disk can be mounted here ({mounted.stderr.strip()}), so none is filled")
    yield place
    subprocess.run(["umount", place], check=True)


@pytest.mark.skipif(not IS_ROOT, reason="SKIPPED: only root can mount a small disk to fill")
def test_a_full_disk_is_told_and_the_run_goes_on_when_there_is_room(data, calm, small_disk):
    work = small_disk / "work"
    code, output = run(cases.arguments(CONFIG, data, work))
    assert code == 1 and "No space left on device" in output and "Traceback" not in output, output
    assert not [path for path in tree(small_disk) if path not in {f"work/{name}" for name in tree(calm)}], output
    subprocess.run(["mount", "-o", "remount,size=64m", small_disk], check=True)
    assert run(cases.arguments(CONFIG, data, work)) == (0, "")
    faulty.same(work, calm)


@pytest.mark.parametrize("home", [None, "/nowhere"])
def test_no_home_is_needed(home, data, calm, tmp_path):
    work = tmp_path / "disk" / "work"
    environment = {name: value for name, value in os.environ.items() if not name.startswith("XDG_") and name != "HOME"}
    environment["PYTHONPATH"] = str(faulty.TOP)
    process = subprocess.Popen(
        [sys.executable, "-c", faulty.CALL, *cases.arguments(CONFIG, data, work)],
        env=environment | ({} if home is None else {"HOME": home}), cwd="/", text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, preexec_fn=bound_by_modes,
    )  # fmt: skip
    output, _ = process.communicate(timeout=faulty.PATIENCE)
    assert process.returncode == 0 and "Traceback" not in output, output
    faulty.same(work, calm)

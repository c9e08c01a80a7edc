"""A start with nothing compiled, or with a cache that is damaged or cannot be had, ends with the right result."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

import gesturegen
from gesturegen import compiled
from tests.commands import tree

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not compiled.is_switched_on(), reason="NUMBA_DISABLE_JIT is set: nothing is compiled"),
]
PROJECT = Path(gesturegen.__file__).parent.parent
COMPILING = "compiling loops"
# In no passwd file, as with `docker run -u 12345`.
STRANGER = 12345
# A Python that other users can run, too, where ours lies in somebody's home.
SYSTEM = f"/usr/bin/python{sys.version_info.major}.{sys.version_info.minor}"


def can_be_run_by_others(python: str) -> bool:
    """Whether everybody can enter all folders on the way to the program itself."""
    return all(folder.stat().st_mode & 1 for folder in Path(python).resolve().parents)


PYTHON = SYSTEM if not can_be_run_by_others(sys.executable) and os.path.exists(SYSTEM) else sys.executable
PATH = os.pathsep.join([str(PROJECT), sysconfig.get_paths()["purelib"]])
METHODS = ("demo", "best", "gesture_master_2022", "motion_matching_2022")


def begin(*arguments, cache: Path | None, module: str = "gesturegen.cli", stranger=False, **variables):
    """Start gesturegen with `cache` as the user's folder for caches, or without a home."""
    hidden = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", *(["HOME"] if cache is None else []))
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    environment |= {"PYTHONPATH": PATH} | ({"XDG_CACHE_HOME": str(cache)} if cache else {}) | variables
    return subprocess.Popen(
        [PYTHON, "-m", module, *map(str, arguments)],
        cwd="/", env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        **({"user": STRANGER, "group": STRANGER, "extra_groups": []} if stranger else {}),
    )  # fmt: skip


def end(process: subprocess.Popen) -> str:
    """What it printed; it must have ended well."""
    said = process.communicate()[0]
    assert process.returncode == 0, said
    return said


@pytest.fixture(scope="module")
def room() -> Iterator[Path]:
    """A folder that other users can enter, with a small dataset in `data`."""
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder)
        room.chmod(0o755)
        end(begin("demo-data", room / "data", "--references", 1, "--tests", 1, cache=room / "unused"))
        yield room


@pytest.fixture(scope="module")
def cold(room) -> tuple[Path, dict[str, str], list[str]]:
    """Two commands that start at the same time with nothing compiled: the cache, what they made, and what they said."""
    works = [room / "cold1", room / "cold2"]
    both = [begin("preprocess", "--data", room / "data", "--work", w, "-j", 2, cache=room / "cache") for w in works]
    said = [end(process) for process in both]
    made = [tree(work / "clips") for work in works]
    assert made[0] == made[1] and len(made[0]) == 3
    return room / "cache", made[0], said


def preprocess(room: Path, name: str, *, jobs: int = 2, **settings) -> tuple[dict[str, str], str]:
    work = room / name
    work.mkdir()
    if settings.get("stranger"):
        os.chown(work, STRANGER, STRANGER)
    said = end(begin("preprocess", "--data", room / "data", "--work", work, "-j", jobs, **settings))
    return tree(work / "clips"), said


def entries(cache: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(cache.glob("gesturegen/*/*.compiled"))}


def test_one_of_two_processes_compiles_and_nothing_is_compiled_again(room, cold):
    cache, made, said = cold
    assert sum(text.count(COMPILING) for text in said) == 1, said
    before = entries(cache)
    assert preprocess(room, "warm", cache=cache)[0] == made
    assert entries(cache) == before
    assert not list(cache.rglob("*.new"))


def test_a_damaged_cache_is_mended(room, cold):
    cache, made, _ = cold
    damaged = room / "damaged"
    shutil.copytree(cache, damaged)
    sound = entries(cache)
    small = sorted((name for name in sound if not name.startswith("group")), key=lambda name: len(sound[name]))
    first = {name.partition("-")[0]: name for name in small}
    swapped = [next(n for n in sound if n.startswith(f"utils._local{side}-")) for side in ("min", "max")]
    folder = next(damaged.glob("gesturegen/*"))
    (folder / small[0]).write_bytes(sound[small[0]][: len(sound[small[0]]) // 2])
    (folder / small[1]).write_bytes(b"")
    (folder / small[2]).unlink()
    flipped = bytearray(sound[small[3]])
    flipped[len(flipped) // 2] ^= 16
    (folder / small[3]).write_bytes(flipped)
    (folder / first["utils.__peak_pick"]).write_bytes(os.urandom(10_000))
    for one, other in (swapped, swapped[::-1]):
        (folder / one).write_bytes(sound[other])
    found, said = preprocess(room, "mended", cache=damaged)
    assert found == made and COMPILING in said
    assert entries(damaged).keys() >= sound.keys()
    found, said = preprocess(room, "mended again", cache=damaged, jobs=1)
    assert found == made and COMPILING not in said


@pytest.fixture(scope="module")
def stranger(room) -> Path:
    """A folder for the temporary files of a user without a name; whatever is installed is read-only to them."""
    try:
        process = begin("--version", cache=None, stranger=True)
    except PermissionError as error:
        pytest.skip(f"this user cannot start a process of another: {error}")
    said = process.communicate()[0]
    if process.returncode:
        pytest.skip(f"the environment cannot be read by other users: {said}")
    folder = room / "tmp"
    folder.mkdir()
    os.chown(folder, STRANGER, STRANGER)
    return folder


def test_a_user_without_a_name_or_a_home_gets_a_private_cache(room, cold, stranger):
    found, said = preprocess(room, "nameless", cache=None, stranger=True, TMPDIR=str(stranger))
    assert found == cold[1]
    assert said.count(COMPILING) == 1 and "there is no home folder" in said
    private = stranger / f"gesturegen-{STRANGER}"
    assert (private.stat().st_uid, private.stat().st_mode & 0o777) == (STRANGER, 0o700)
    # A home that cannot be written is as good as none, and what was compiled is still there.
    found, said = preprocess(room, "nameless again", cache=Path("/proc"), stranger=True, TMPDIR=str(stranger))
    assert found == cold[1] and COMPILING not in said


def test_what_root_compiled_serves_a_user_who_can_write_nothing(room, cold, stranger):
    if os.geteuid():
        pytest.skip("only root can have compiled for others")
    found, said = preprocess(
        room, "served", cache=cold[0], stranger=True, TMPDIR="/proc", JOBLIB_TEMP_FOLDER=str(stranger)
    )
    assert found == cold[1] and COMPILING not in said


def test_no_cache_at_all(room, cold, stranger):
    found, said = preprocess(room, "nowhere", jobs=1, cache=Path("/proc"), stranger=True, TMPDIR="/proc")
    assert found == cold[1]
    assert said.count(COMPILING) == 1 and "cannot be kept" in said and "/proc" in said


def test_numbas_own_settings_keep_working(room):
    """Another processor is another folder; without compiling there is nothing to prepare."""
    code = "from gesturegen import warm_up; from gesturegen.compiled import store; print(store.folders()[0]); "
    code += "warm_up.prepare(warm_up.GROUPS, quiet=False)"
    for variables, named in (
        ({"NUMBA_CPU_NAME": "generic", "NUMBA_DISABLE_JIT": "1"}, "-generic-"),
        ({}, "gesturegen"),
    ):
        cache = room / f"settings {named}"
        environment = os.environ | {"PYTHONPATH": PATH, "NUMBA_CACHE_DIR": str(cache), "NUMBA_DISABLE_JIT": "1"}
        done = subprocess.run(
            [PYTHON, "-c", code], env=environment | variables, capture_output=True, text=True, check=True
        )
        assert named in done.stdout and str(cache) in done.stdout and COMPILING not in done.stderr
        assert not cache.exists()


def test_the_warm_up_covers_every_loop_of_every_method(room):
    cache = room / "everything"
    assert end(begin(cache=cache, module="gesturegen.warm_up")).count(COMPILING) == 1
    before = entries(cache)
    for path in (PROJECT / "gesturegen").rglob("*_kernels.py"):
        lines = path.read_text().splitlines()
        for number, line in enumerate(lines):
            # What is inlined has no entry of its own.
            if line.startswith("@njit") and 'inline="always"' not in line:
                name = lines[number + 1].partition("(")[0].removeprefix("def ")
                assert any(entry.startswith(f"{path.stem}.{name}-{number + 1}.") for entry in before), (path, name)
    for config in METHODS:
        for command in ("preprocess", "build-graph", "reenact", "evaluate"):
            folders = ("--data", room / "data", "--work", room / "methods" / config)
            path = PROJECT / "configs" / f"{config}.yaml"
            said = end(begin(command, "--config", path, *folders, "-j", 1, cache=cache))
            assert COMPILING not in said
            assert entries(cache) == before, (config, command)

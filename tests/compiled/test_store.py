"""The store of compiled code: what is damaged, foreign or unsafe is never taken, and no failure to write is an error."""

import fcntl
import os
import resource
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numba
import pytest

from gesturegen import compiled
from gesturegen.compiled import hook, store

PAYLOAD = b"compiled code"


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch) -> Path:
    """The folder of entries; nothing that these tests do is seen by others."""
    monkeypatch.setattr(store.config, "CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.setattr(store, "used", set())
    monkeypatch.setattr(store, "_refusals", {})
    return store.folders()[0]


def kept(name: str = "entry") -> list[bytes]:
    return [stored.read() for stored in store.read(name)]


def test_what_is_kept_is_read(cache):
    assert kept() == []
    assert store.keep("entry", PAYLOAD) and kept() == [PAYLOAD]
    assert store.keep("entry", b"other code") and kept() == [b"other code"]
    assert os.listdir(cache) == ["entry.compiled"]


def test_any_damage_is_noticed(cache):
    store.keep("entry", PAYLOAD)
    path = cache / "entry.compiled"
    sound = path.read_bytes()
    damaged = [sound[:length] for length in range(len(sound))] + [sound + b"\0"]
    damaged += [sound[:at] + bytes([sound[at] ^ 1 << at % 8]) + sound[at + 1 :] for at in range(len(sound))]
    for data in damaged:
        path.write_bytes(data)
        assert kept() == [] and not store.is_sound("entry")
    path.write_bytes(sound)
    assert store.is_sound("entry")


@pytest.mark.parametrize(
    "other",
    [("f-2", "stamp", "key"), ("f-1", "other", "key"), ("f-1", "stamp", "other")],
    ids=["name", "source", "key"],
)
def test_an_entry_under_the_name_of_another_is_not_taken(cache, other):
    ours, theirs = hook.Entries("f-1", "stamp"), hook.Entries(*other[:2])
    ours.save("key", "our code")
    theirs.save(other[2], "their code")
    assert (ours.load("key"), theirs.load(other[2])) == ("our code", "their code")
    first, second = (cache / f"{name}.compiled" for name in (ours._entry("key"), theirs._entry(other[2])))
    os.replace(second, first)
    assert ours.load("key") is None and theirs.load(other[2]) is None


@pytest.mark.parametrize("mode", [0o777, 0o775])
def test_a_folder_that_others_can_write_is_neither_read_nor_written(cache, mode):
    store.keep("entry", PAYLOAD)
    cache.chmod(mode)
    assert kept() == []
    assert store.keep("entry", b"elsewhere") and kept() == [b"elsewhere"]
    assert "others may write" in store.refusal()


def test_a_link_in_the_place_of_the_private_folder_is_not_followed(tmp_path, monkeypatch):
    monkeypatch.setattr(store.config, "CACHE_DIR", "/dev/null")
    (tmp_path / "tmp").mkdir()
    (tmp_path / "elsewhere").mkdir()
    store.folders()[1].parent.symlink_to(tmp_path / "elsewhere")
    assert not store.keep("entry", PAYLOAD) and kept() == []
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_the_private_folder_takes_what_the_users_cache_does_not(monkeypatch):
    monkeypatch.setattr(store.config, "CACHE_DIR", "/dev/null")
    assert store.keep("entry", PAYLOAD) and kept() == [PAYLOAD]
    assert "/dev/null" in store.refusal()
    private = store.folders()[1]
    assert [path.stat().st_mode & 0o777 for path in (private.parent, private)] == [0o700, 0o700]


def test_a_full_disk_leaves_nothing_half_written(tmp_path):
    """A limit on the size of files stands for it: the system refuses in the midst of writing."""
    code = "from gesturegen.compiled import store; print(store.keep('entry', bytes(10_000)), store.refusal())"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "TMPDIR": str(tmp_path / "tmp")}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000)),
    )  # fmt: skip
    assert done.stdout.startswith("False") and "File too large" in done.stdout, done
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_where_entries_go(tmp_path, monkeypatch):
    versions = store.folders()[0].name
    assert store.folders()[0] == tmp_path / "cache" / "gesturegen" / versions
    monkeypatch.setattr(store.config, "CACHE_DIR", "")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert store.folders()[0] == tmp_path / ".cache" / "gesturegen" / versions
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert store.folders()[0] == tmp_path / "xdg" / "gesturegen" / versions
    for name in ("gesturegen", "cpython-3", "numba", "llvmlite", "librosa", "numpy"):
        assert name in versions


def test_a_lock_that_is_never_given_back_is_not_waited_for_for_ever(cache):
    with store.alone() as folder:
        assert folder == cache
    with open(cache / "lock", "a") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with store.alone(patience=0.05) as folder:
            assert folder == cache


def test_loops_of_other_programs_stay_where_they_are():
    assert hook.Locator.from_function(kept, __file__) is None


def test_loops_that_a_program_imported_before_us_are_kept_by_us_from_then_on(cache, monkeypatch):
    def double(x):
        return 2 * x

    loop = numba.njit(cache=True)(double)
    assert hook.is_kept_elsewhere(loop) == compiled.is_switched_on()
    double.__module__ = "librosa.made_up"
    module = ModuleType("librosa.made_up")
    module.loop = loop
    monkeypatch.setitem(sys.modules, "librosa.made_up", module)
    compiled.adopt(ModuleType("librosa"))
    assert loop(3) == 6
    assert len(list(cache.glob("*double-*.compiled"))) == compiled.is_switched_on()

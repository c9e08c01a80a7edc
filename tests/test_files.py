import hashlib
import os
import stat
import zipfile

import numpy as np
import pytest

from gesturegen import files
from gesturegen.errors import DataError
from tests.builders import refused


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def fail_halfway(error):
    def fill(file):
        file.write(b"half of the new con")
        raise error

    return fill


@pytest.mark.parametrize("error", (RuntimeError("boom"), KeyboardInterrupt()), ids=["error", "Ctrl-C"])
def test_a_failing_writer_leaves_the_old_file_and_nothing_else(tmp_path, error):
    path = tmp_path / "out.txt"
    path.write_text("old")
    with pytest.raises(type(error)):
        files.write_bytes(path, fail_halfway(error))
    assert path.read_text() == "old"
    assert names(tmp_path) == ["out.txt"]


def test_a_full_disk_is_one_line_and_leaves_the_old_file(tmp_path):
    path = tmp_path / "out.txt"
    path.write_text("old")
    with refused(DataError, r"cannot be written \(No space left on device\)", path):
        files.write_bytes(path, fail_halfway(OSError(28, "No space left on device")))
    assert path.read_text() == "old"
    assert names(tmp_path) == ["out.txt"]


def test_the_old_file_stays_until_the_new_one_is_whole(tmp_path):
    path = tmp_path / "out.txt"
    path.write_text("old")

    def fill(file):
        file.write(b"new")
        file.flush()
        assert path.read_text() == "old"

    files.write_bytes(path, fill)
    assert path.read_text() == "new"


def test_missing_folders_are_made(tmp_path):
    files.write_text(tmp_path / "a" / "b" / "c.txt", "Grüße")
    assert (tmp_path / "a" / "b" / "c.txt").read_bytes() == "Grüße".encode()
    assert names(tmp_path / "a" / "b") == ["c.txt"]


@pytest.mark.skipif(os.name != "posix", reason="permissions as on POSIX systems")
def test_written_files_have_the_usual_permissions(tmp_path):
    (tmp_path / "usual").touch()
    files.write_text(tmp_path / "ours", "text")
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("usual", "ours")]
    assert modes[0] == modes[1]


def test_a_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("not a folder")
    with refused(DataError, "cannot be written .*--work", tmp_path / "file" / "out.txt"):
        files.write_text(tmp_path / "file" / "out.txt", "text")
    assert names(tmp_path) == ["file"]


def test_a_target_that_is_a_folder_is_refused(tmp_path):
    (tmp_path / "out.txt").mkdir()
    with refused(DataError, r"cannot be written \(Is a directory\)", tmp_path / "out.txt"):
        files.write_text(tmp_path / "out.txt", "text")
    assert names(tmp_path) == ["out.txt"]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_an_unwritable_folder_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with refused(DataError, r"cannot be written \(Permission denied\)", tmp_path):
            files.write_text(tmp_path / "out.txt", "text")
    finally:
        tmp_path.chmod(0o700)


def test_json_comes_back(tmp_path):
    value = {"clip": "Grüße", "pieces": [{"cost": 0.1, "fallback": None}], "n": 3}
    files.write_json(tmp_path / "a.json", value)
    assert files.read_json(tmp_path / "a.json") == value
    text = (tmp_path / "a.json").read_bytes().decode("utf-8")
    assert text.endswith("}\n") and "Grüße" in text


@pytest.mark.parametrize("content", (b"", b'{"a": ', b"\xff\xfe\x00", b"text"), ids=["empty", "cut", "binary", "text"])
def test_damaged_json_is_refused(tmp_path, content):
    (tmp_path / "a.json").write_bytes(content)
    with refused(DataError, "not JSON", tmp_path / "a.json"):
        files.read_json(tmp_path / "a.json")


def test_missing_files_are_refused(tmp_path):
    for read in (files.read_json, files.read_arrays):
        with refused(DataError, r"cannot be read \(No such file or directory\)", tmp_path / "none"):
            read(tmp_path / "none")


ARRAYS = {
    "numbers": np.linspace(0, 1, 1000).reshape(10, 100),
    "empty": np.empty((0, 3), dtype=np.float32),
    "words": np.array(["hey", "größer"]),
    "flags": np.array([True, False]),
    "scalar": np.array(3),
}


def test_arrays_come_back(tmp_path):
    files.write_arrays(tmp_path / "a.npz", ARRAYS)
    found = files.read_arrays(tmp_path / "a.npz")
    assert list(found) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


def test_equal_arrays_give_equal_bytes(tmp_path):
    files.write_arrays(tmp_path / "a.npz", ARRAYS)
    files.write_arrays(tmp_path / "b.npz", {name: array.copy() for name, array in ARRAYS.items()})
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    # Nor would a later clock change them.
    with zipfile.ZipFile(tmp_path / "a.npz") as stored:
        assert {entry.date_time for entry in stored.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def damaged(tmp_path, how):
    path = tmp_path / "a.npz"
    files.write_arrays(path, ARRAYS)
    whole = path.read_bytes()
    if how == "flipped":
        at = whole.index(ARRAYS["numbers"].tobytes()[800:840])
        path.write_bytes(whole[:at] + b"\x55" + whole[at + 1 :])
    elif how == "pickled":
        np.savez(path, a=np.array([{"b": 1}], dtype=object))
    elif how == "npy":
        np.save(tmp_path / "b.npy", ARRAYS["numbers"])
        (tmp_path / "b.npy").rename(path)
    else:
        path.write_bytes({"empty": b"", "cut": whole[: len(whole) // 2], "text": b"no arrays here\nnor here"}[how])
    return path


@pytest.mark.parametrize("how", ("empty", "cut", "text", "flipped", "pickled", "npy"))
def test_damaged_arrays_are_refused(tmp_path, how):
    path = damaged(tmp_path, how)
    with refused(DataError, "damaged .*delete it and run the command that writes it", path):
        files.read_arrays(path)


def test_sha256(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    assert files.sha256(tmp_path / "a") == hashlib.sha256(b"abc").hexdigest()
    with refused(DataError, r"cannot be read \(No such file or directory\)", tmp_path / "none"):
        files.sha256(tmp_path / "none")

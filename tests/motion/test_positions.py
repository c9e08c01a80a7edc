"""Joint positions of `.npz` files: what is read, and what is refused in one line."""

import io
import zipfile

import numpy as np
import pytest

from gesturegen.errors import DataError
from gesturegen.motion import positions
from tests.builders import refused

GOOD = np.arange(60.0).reshape(5, 4, 3)


def write(path, **arrays):
    np.savez(path, **arrays)
    return path


@pytest.mark.parametrize("dtype", ("<f8", ">f8", "<f4", ">i4", "u1", "f2"))
@pytest.mark.parametrize("save", (np.savez, np.savez_compressed))
def test_numbers_of_any_kind_are_read(tmp_path, dtype, save):
    save(tmp_path / "a.npz", positions=np.asfortranarray(GOOD.astype(dtype)), other=np.array(["text"]))
    found = positions.read(tmp_path / "a.npz")
    assert found.dtype == np.float64 and found.flags.c_contiguous
    np.testing.assert_array_equal(found, GOOD)


def with_value(value):
    changed = GOOD.copy()
    changed[3, 2, 1] = value
    return changed


REFUSED = {
    "nan": ({"positions": with_value(np.nan)}, "frame 3, joint 2: y is nan, not a position"),
    "infinity": ({"positions": with_value(-np.inf)}, "frame 3, joint 2: y is -inf"),
    "large": ({"positions": with_value(1e300)}, r"frame 3, joint 2: y is 1e\+300"),
    "bools": ({"positions": GOOD > 3}, "`positions` holds bool, expected numbers"),
    "dates": ({"positions": GOOD.astype("M8[s]")}, r"`positions` holds datetime64\[s\]"),
    "durations": ({"positions": GOOD.astype("m8[s]")}, "`positions` holds timedelta64"),
    "texts": ({"positions": GOOD.astype("U9")}, "`positions` holds <U9"),
    "complex": ({"positions": GOOD + 1j}, "`positions` holds complex128"),
    "objects": ({"positions": GOOD.astype(object)}, "`positions` holds object"),
    "long numbers": ({"positions": GOOD.astype(np.longdouble)}, "`positions` holds float128"),
    "two dimensions": ({"positions": GOOD[0]}, r"of shape \(frames, joints, 3\) .* found \(4, 3\)"),
    "rotations": ({"positions": np.zeros((5, 4, 4))}, r"found \(5, 4, 4\)"),
    "no frames": ({"positions": GOOD[:0]}, r"at least one frame .* found \(0, 4, 3\)"),
    "no joints": ({"positions": GOOD[:, :0]}, r"found \(5, 0, 3\)"),
    "too many joints": ({"positions": np.zeros((1, 1001, 3), "u1")}, r"1 to 1000 joints, found \(1, 1001, 3\)"),
    "another name": ({"position": GOOD, "fps": np.array(30)}, r"no array `positions` in it, .* it has: fps, position$"),
}


@pytest.mark.parametrize(("arrays", "match"), REFUSED.values(), ids=REFUSED)
def test_other_arrays_are_refused(tmp_path, arrays, match):
    path = write(tmp_path / "a.npz", **arrays)
    with refused(DataError, match, path):
        positions.read(path)


def test_a_bomb_is_refused_unopened(tmp_path):
    """A few kB that unpack to gigabytes: only the header of the array is read."""
    path = tmp_path / "a.npz"
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "|u1", "fortran_order": False, "shape": (10**7, 100, 3)})
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("positions.npy", header.getvalue() + bytes(1000))
    with refused(DataError, "takes 24,000 MB of memory, over 20 times the file", path):
        positions.read(path)


@pytest.mark.parametrize("length", (-1, 1))
def test_a_length_that_is_not_the_shapes_is_refused(tmp_path, length):
    path = tmp_path / "a.npz"
    whole = io.BytesIO()
    np.save(whole, GOOD)
    data = whole.getvalue() + b"x" if length > 0 else whole.getvalue()[:-1]
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("positions.npy", data)
    with refused(DataError, "not as long as its shape", path):
        positions.read(path)


def test_damaged_files_and_two_of_a_name_are_refused(tmp_path):
    path = write(tmp_path / "a.npz", positions=GOOD)
    data = bytearray(path.read_bytes())
    path.write_bytes(data[:-30])
    with refused(DataError, "damaged or no .npz file", path):
        positions.read(path)
    data[250] ^= 1
    path.write_bytes(data)
    with refused(DataError, "damaged or no .npz file .*CRC", path):
        positions.read(path)
    with zipfile.ZipFile(path, "w") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("positions.npy", b"a")
        archive.writestr("positions.npy", b"b")
    with refused(DataError, "2 array `positions` in it, expected one", path):
        positions.read(path)

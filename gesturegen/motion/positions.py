"""Joint positions made by other systems: the array `positions` of an `.npz` file, and no other of its arrays."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from typing import BinaryIO

import numpy as np

from gesturegen import inputs
from gesturegen.errors import DataError

MOST_BYTES = 2_000_000_000
MOST_JOINTS = 1000
# Compressed zeros unpack without end: the array may be so many times the file's size, and always this large.
_MOST_TIMES = 20
_ALWAYS_ALLOWED = 64_000_000
# No joint is further from the origin, in cm.
_LARGEST_VALUE = 1e6
_NAME = "positions.npy"


def read(path: str | Path) -> np.ndarray:
    """Read world positions `[shape=(T, J, 3)]` float64, cm, of an `.npz` file; T and J are at least 1.

    Raises DataError for a file that has no such array of numbers, and naming the place of one that is not finite.
    """
    with inputs.open_regular(path, most_bytes=MOST_BYTES) as file:
        try:
            positions = _read_array(path, file)
        except DataError:
            raise
        except Exception as error:
            # zipfile, zlib, lzma and numpy each have their own words for a damaged file.
            why = inputs.shown(error) or type(error).__name__
            raise DataError(f"{inputs.shown(path)}: damaged or no .npz file ({why}); write it again") from None
    # NaN is not less either.
    bad = np.argwhere(~(np.abs(positions) < _LARGEST_VALUE))
    if len(bad):
        frame, joint, axis = bad[0]
        raise DataError(
            f"{inputs.shown(path)}: frame {frame}, joint {joint}: {'xyz'[axis]} is {positions[frame, joint, axis]:g}, "
            f"not a position within {_LARGEST_VALUE:g} cm; write it again"
        )
    return positions


def _read_array(path: str | Path, file: BinaryIO) -> np.ndarray:
    """Read the array as it is stored, after a check of its header alone."""
    if file.read(4) != b"PK\x03\x04":
        raise DataError(f"{inputs.shown(path)}: no .npz file; write it with numpy.savez")
    with zipfile.ZipFile(file) as archive:
        members = [member for member in archive.infolist() if member.filename == _NAME]
        if len(members) != 1:
            found = ", ".join(sorted(member.filename.removesuffix(".npy") for member in archive.infolist())[:20])
            raise DataError(
                f"{inputs.shown(path)}: {len(members) or 'no'} array `positions` in it, expected one; it has: "
                f"{inputs.shown(found) or 'nothing'}"
            )
        packed = inputs.size(file)
        with archive.open(members[0]) as stored:
            version = np.lib.format.read_magic(stored)
            read_header = (
                np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            )
            shape, fortran, dtype = read_header(stored)
            if len(shape) != 3 or shape[-1] != 3 or 0 in shape or shape[1] > MOST_JOINTS:
                raise DataError(
                    f"{inputs.shown(path)}: expected an array `positions` of shape (frames, joints, 3) with at least one "
                    f"frame and 1 to {MOST_JOINTS} joints, found {shape}"
                )
            if dtype.kind not in "fiu" or dtype.itemsize > 8:
                raise DataError(f"{inputs.shown(path)}: `positions` holds {dtype}, expected numbers of up to 64 bits")
            count = math.prod(shape)
            if count * 8 > _ALWAYS_ALLOWED + _MOST_TIMES * packed:
                raise DataError(
                    f"{inputs.shown(path)}: `positions` {shape} takes {count * 8 / 1e6:,.0f} MB of memory, "
                    f"over {_MOST_TIMES} times the file; store it uncompressed if it is meant"
                )
            raw = stored.read(count * dtype.itemsize)
            # Reading on to the end of the part is what checks its sum.
            if len(raw) != count * dtype.itemsize or stored.read(1):
                raise DataError(
                    f"{inputs.shown(path)}: `positions` is not as long as its shape {shape} says; write it again"
                )
    array = np.frombuffer(raw, dtype).reshape(shape, order="F" if fortran else "C")
    # Floats of 16 bits and whole numbers are exact in 64; unlike astype of what is too large, this cannot warn.
    with np.errstate(all="ignore"):
        return np.ascontiguousarray(array, dtype=np.float64)

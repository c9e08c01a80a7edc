"""Stored arrays: a table declares what each kind of `.npz` holds, and files are checked against it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from gesturegen import files
from gesturegen.errors import DamagedError
from gesturegen.stored.sealing import checksum, damaged, file_state, seal_archive

# Of any figure in a file: centimetres, seconds, decibels and costs stay far below, and so do their squares' sums.
LARGEST = 1e15
# Values that are looked at together.
_BLOCK = 1 << 22
_LAST_CHARACTER = 0x10FFFF
_SURROGATES = (0xD800, 0xDFFF)

# What is wrong with an array, given the sizes that are known by name; None when nothing is.
Check = Callable[[np.ndarray, Mapping[str, int]], str | None]


@dataclass(frozen=True)
class Array:
    """Declaration of one stored array.

    dtype : `f4`, `f8`, `i4`, `i8`, `bool` or `str`, of this machine's byte order
    shape : sizes by name, the same for all arrays of a file, or as numbers: `N J 3`, `N+1`; nothing for one value
    check : of its values; by default floats are finite
    group : arrays of one group are all there or all missing
    """

    dtype: str
    shape: str = ""
    check: Check | None = None
    group: str = ""


@dataclass(frozen=True)
class Kind:
    """Declaration of a kind of stored file.

    what : what messages call it; command : what writes it; version : what `format_version` must be, None without one
    relations : what is wrong between arrays that by themselves are as they should be
    """

    what: str
    command: str
    arrays: Mapping[str, Array]
    version: int | None = None
    relations: Callable[[Mapping[str, np.ndarray]], str | None] | None = None


# --- checks of values ---------------------------------------------------------------------------------------


def within(low: float, high: float, nan: bool = False) -> Check:
    """Make a check that every value is from `low` to `high` or, where allowed, NaN."""

    def check(array: np.ndarray, _sizes: Mapping[str, int]) -> str | None:
        lowest, highest = (np.fmin, np.fmax) if nan else (np.minimum, np.maximum)
        for block in _blocks(array):
            least, most = lowest.reduce(block), highest.reduce(block)
            if not (low <= least and most <= high) and not (nan and np.isnan(least)):
                return f"holds {least if not low <= least else most}, expected {low:g} to {high:g}"
        return None

    return check


finite = within(-LARGEST, LARGEST)
finite_or_nan = within(-LARGEST, LARGEST, nan=True)
# What a regression makes of hardly any data.
any_size_or_nan = within(-np.finfo(float).max, np.finfo(float).max, nan=True)
not_negative = within(0, LARGEST)


def below(size: str) -> Check:
    """Make a check that every value is a number from 0 to before a size."""
    return lambda array, sizes: within(0, sizes[size] - 1)(array, sizes)


def up_to(size: str) -> Check:
    """Make a check that every value is a number from 0 to a size."""
    return lambda array, sizes: within(0, sizes[size])(array, sizes)


def rising(size: str) -> Check:
    """Make a check that values rise strictly, from 0 on, below a size."""

    return lambda array, sizes: rising_numbers(array, sizes) or below(size)(array, sizes)


def rising_numbers(array: np.ndarray, sizes: Mapping[str, int]) -> str | None:
    """Check that values rise strictly, from 0 on."""
    if not (array[1:] > array[:-1]).all():
        return "does not rise"
    return not_negative(array, sizes)


def starts(size: str) -> Check:
    """Make a check that values begin at 0 and rise strictly, below a size."""

    def check(array: np.ndarray, sizes: Mapping[str, int]) -> str | None:
        if len(array) == 0 or array[0] != 0:
            return "does not begin at 0"
        return rising(size)(array, sizes)

    return check


def pointers(size: str) -> Check:
    """Make a check that values begin at 0, never fall and end at a size."""

    def check(array: np.ndarray, sizes: Mapping[str, int]) -> str | None:
        if array[0] != 0 or array[-1] != sizes[size] or not (array[1:] >= array[:-1]).all():
            return f"does not rise from 0 to {sizes[size]}"
        return None

    return check


def among(*texts: str) -> Check:
    """Make a check that every text is one of the given ones."""

    def check(array: np.ndarray, _sizes: Mapping[str, int]) -> str | None:
        strange = sorted(set(np.unique(array).tolist()) - set(texts))
        return f"holds {strange[0]!r}, expected {', '.join(texts)}" if strange else None

    return check


def _blocks(array: np.ndarray) -> Iterator[np.ndarray]:
    flat = array.ravel(order="K")
    return (flat[start : start + _BLOCK] for start in range(0, len(flat), _BLOCK))


# --- files --------------------------------------------------------------------------------------------------

# Files whose values have been looked at, by what was looked at.
_looked_at: dict[tuple[str, str, tuple[str, ...] | None], tuple[int, ...]] = {}


def write(path: str | Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Store arrays with a checksum, uncompressed: the same arrays give the same bytes."""

    named: dict[str, Any] = dict(arrays)  # else taken for the options of savez

    def fill(file: BinaryIO) -> None:
        np.savez(file, **named)
        seal_archive(file)

    files.write_bytes(path, fill)


def read(
    path: str | Path, kind: Kind, only: Collection[str] | None = None, mapped: bool = False
) -> dict[str, np.ndarray]:
    """Read the arrays of a stored file, or those named in `only`, and check them against the kind's declaration.

    mapped : large ones stay on disk until they are looked at
    Each process looks at each state of a file once. Raises DataError for a file that cannot be read, DamagedError for
    one that is not as it was written, of another version or not as declared.
    """
    path = Path(path)
    checksum(path, kind.command)
    names = None if only is None else {*only, "format_version"}
    found = files.map_arrays(path, only=names) if mapped else files.map_arrays(path, math.inf, only=names)
    looked = str(path), kind.what, None if only is None else tuple(sorted(only))
    state = file_state(path)
    if _looked_at.get(looked) != state:
        _require_version(path, kind, found.get("format_version"))
        if problem := _problem(found, kind, only):
            raise damaged(path, problem, kind.command)
        _looked_at[looked] = state
    return found


def _require_version(path: Path, kind: Kind, version: np.ndarray | None) -> None:
    if kind.version is None:
        return
    if version is None:
        raise damaged(path, "no array 'format_version' in it", kind.command)
    if version.shape != () or version.dtype.kind != "i" or version != kind.version:
        raise DamagedError(
            f"{path}: format {str(version)[:20]}, this version reads {kind.version}; "
            f"run `gesturegen {kind.command}` again"
        )


def _problem(found: Mapping[str, np.ndarray], kind: Kind, only: Collection[str] | None) -> str | None:
    """Say what is wrong with the arrays of a file, the first thing; None when nothing is."""
    if strange := sorted(found.keys() - kind.arrays.keys() - {"format_version"}):
        return f"an array {strange[0][:40]!r}, which no {kind.what} has"
    groups = {kind.arrays[name].group for name in found if name in kind.arrays}
    sizes: dict[str, int] = {}
    for name, declared in kind.arrays.items():
        if name not in found:
            if (only is None or name in only) and declared.group in {"", *groups}:
                return f"no array {name!r} in it"
            continue
        if problem := _misfit(found[name], declared, sizes):
            return f"{name} {problem}"
    for name, array in found.items():
        if name in kind.arrays and (problem := _wrong_value(array, kind.arrays[name], sizes)):
            return f"{name} {problem}"
    return kind.relations(found) if only is None and kind.relations is not None else None


def _misfit(array: np.ndarray, declared: Array, sizes: dict[str, int]) -> str | None:
    """Say what is wrong with dtype and shape; sizes that are new get the value that they have here."""
    native = array.dtype.isnative and (
        array.dtype.kind == "U" if declared.dtype == "str" else array.dtype == np.dtype(declared.dtype)
    )
    if not native:
        return f"is of dtype {array.dtype.str}, expected {declared.dtype}"
    wanted = declared.shape.split()
    if array.ndim != len(wanted):
        return f"has {array.ndim} dimensions, expected {len(wanted)}"
    for size, term in zip(array.shape, wanted, strict=True):
        matched = re.fullmatch(r"(\w+)(\+1)?", term)
        assert matched is not None, f"{term} is no size"
        name, more = matched.groups()
        expected = int(name) if name.isdecimal() else sizes.setdefault(name, size - bool(more))
        if size != expected + bool(more) or expected < 0:
            return f"has shape {array.shape}, expected {declared.shape} with {term} = {expected + bool(more)}"
    return None


def _wrong_value(array: np.ndarray, declared: Array, sizes: Mapping[str, int]) -> str | None:
    if array.size == 0:
        # Nothing to look at, but for what has to begin somewhere.
        return None if declared.check is None or array.ndim != 1 else _of_nothing(array, declared.check, sizes)
    if array.dtype.kind == "U":
        characters = np.ascontiguousarray(array).reshape(-1).view(np.uint32)
        low, high = _SURROGATES
        if characters.size and (
            characters.max() > _LAST_CHARACTER or ((characters >= low) & (characters <= high)).any()
        ):
            return "holds what is no text"
    if array.dtype.kind == "b" and np.ascontiguousarray(array).reshape(-1).view(np.uint8).max() > 1:
        return "holds what is neither true nor false"
    check = declared.check or (finite if array.dtype.kind == "f" else None)
    return None if check is None else check(array, sizes)


def _of_nothing(array: np.ndarray, check: Check, sizes: Mapping[str, int]) -> str | None:
    try:
        return check(array, sizes)
    except IndexError:
        return "is empty"

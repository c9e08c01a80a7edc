"""Files that users hand in: opened without blocking, read up to a size limit, with errors of one line.

A pipe, a socket or a device in place of a file would make `open` wait or a read never end, so only regular files
are opened. Names and numbers are taken from such files through here as well, so that no reader has its own idea
of what a number is.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO

from gesturegen.errors import DataError, GesturegenError, printable

PERMISSIONS = "check the path and its permissions"
# Neither part of a number in a text file nor of a name: they end lines, steer terminals or cannot be encoded.
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\ufeff\ufffe\uffff\ud800-\udfff]")
# float() also reads 1_000, Arabic digits, nan and infinity.
_DECIMAL = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_KINDS = (
    (stat.S_ISDIR, os.strerror(21)),
    (stat.S_ISFIFO, "it is a pipe, not a file"),
    (stat.S_ISSOCK, "it is a socket, not a file"),
)


def shown(value: object) -> str:
    """Format a path or text for an error message: on one line, printable, cut when it is long."""
    text = printable(str(value))
    return text if len(text) <= 500 else f"{text[:240]}...{text[-240:]}"


def control_character(text: str) -> str | None:
    """Return the first character of a text that no name may hold, such as U+000A for a line break, or None."""
    found = _CONTROL.search(text)
    return f"U+{ord(found[0]):04X}" if found else None


def name_problem(path: Path) -> str | None:
    """Say why the name of a file cannot name an output, as that of a clip does; None for a name that can."""
    control = control_character(path.name)
    if control is None:
        return None
    what = "bytes that are not UTF-8" if "\ud800" <= chr(int(control[2:], 16)) <= "\udfff" else control
    return f"{shown(path)}: the name of the file holds {what}; rename it"


def require_usable_name(path: Path) -> None:
    """Raise DataError for a file whose name cannot name an output, as that of a clip does."""
    if (problem := name_problem(path)) is not None:
        raise DataError(problem)


def decimal(text: str) -> float | None:
    """Parse a number in ASCII decimal notation; None for any other text (inf for 1e999)."""
    text = text.strip()
    return float(text) if len(text) <= 400 and _DECIMAL.fullmatch(text) else None


def is_file(path: str | os.PathLike[str]) -> bool:
    """Tell whether there is a regular file; False where the path cannot even be looked up."""
    return _is(path, stat.S_ISREG)


def is_dir(path: str | os.PathLike[str]) -> bool:
    """Tell whether there is a folder; False where the path cannot even be looked up."""
    return _is(path, stat.S_ISDIR)


def _is(path: str | os.PathLike[str], kind: Callable[[int], bool]) -> bool:
    try:
        return kind(os.stat(path).st_mode)
    except (OSError, ValueError):  # ValueError for a null byte or a surrogate in the path
        return False


def size(file: BinaryIO) -> int:
    """Return the size of an open file in bytes."""
    return os.fstat(file.fileno()).st_size


def open_regular(
    path: str | Path, error: type[GesturegenError] = DataError, hint: str = PERMISSIONS, most_bytes: int | None = None
) -> BufferedReader:
    """Open a regular file for reading; raise `error` in one line for a missing file and for anything else.

    hint : what to do when the file cannot be read; most_bytes : a larger file is refused
    """
    try:
        # Looked at before it is opened, for opening some devices does something; and afterwards, for it may have changed.
        _require_regular(os.stat(path).st_mode)
        file = os.fdopen(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)), "rb")
        try:
            state = os.fstat(file.fileno())
            _require_regular(state.st_mode)
            if most_bytes is not None and state.st_size > most_bytes:
                raise error(_too_large(path, state.st_size, most_bytes))
        except BaseException:
            file.close()
            raise
        return file
    except (OSError, ValueError) as problem:
        why = getattr(problem, "strerror", None) or str(problem)
        raise error(f"{shown(path)}: cannot be read ({why}); {hint}") from None


def _require_regular(mode: int) -> None:
    if not stat.S_ISREG(mode):
        raise OSError(None, next((what for is_kind, what in _KINDS if is_kind(mode)), "it is a device, not a file"))


def read_bytes(
    path: str | Path, most_bytes: int, error: type[GesturegenError] = DataError, hint: str = PERMISSIONS
) -> bytes:
    """Read all bytes of a regular file of at most `most_bytes`; raise `error` in one line for anything else."""
    with open_regular(path, error, hint, most_bytes) as file:
        try:
            # One more than allowed: a file may grow while it is read.
            raw = file.read(most_bytes + 1) or b""  # None for a file of the system that would make one wait
        except OSError as problem:
            raise error(f"{shown(path)}: cannot be read ({problem.strerror}); {hint}") from None
    if len(raw) > most_bytes:
        raise error(_too_large(path, len(raw), most_bytes))
    return raw


def _too_large(path: str | Path, size: int, most_bytes: int) -> str:
    return f"{shown(path)}: {size / 1e6:,.1f} MB, more than the {most_bytes / 1e6:,g} MB that are read; give a smaller file"

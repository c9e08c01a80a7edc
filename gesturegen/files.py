"""Atomic writing of files: a reader never sees half a file, and a crash leaves the old one."""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import struct
import tempfile
import zipfile
from collections.abc import Callable, Collection
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from gesturegen import inputs
from gesturegen.errors import DataError

# Names of files that are not yet whole. Without the final name, which may be as long as a name can be.
_TEMPORARY = ".gesturegen-", ".part"


def is_temporary(path: Path) -> bool:
    """Tell whether a file is a temporary one that a killed command left half-written."""
    return path.name.startswith(_TEMPORARY[0]) and path.name.endswith(_TEMPORARY[1])


def write_bytes(path: str | os.PathLike[str], fill: Callable[[BinaryIO], Any]) -> None:
    """Let `fill` write to a temporary file beside `path`, then move it into place.

    The file is on the disk before it has its name, so that not even a power cut leaves half of it.
    Raises DataError when the folder cannot be written or the disk is full.
    """
    path = Path(path)
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with _new_temporary(path.parent) as file:
            temporary = Path(file.name)
            fill(file)
            file.flush()
            temporary.chmod(0o666 & ~_umask())
            os.fsync(file.fileno())
        temporary.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        _remove(temporary)
        raise DataError(
            f"{path}: cannot be written ({error.strerror}); choose a folder that can, with --work"
        ) from None
    except BaseException:
        _remove(temporary)
        raise


def require_writable(folder: str | Path) -> None:
    """Raise DataError when `folder` cannot be written, before the work starts instead of after it."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        with _new_temporary(Path(folder), delete=True):
            pass
    except OSError as error:
        raise DataError(
            f"{folder}: cannot be written ({error.strerror}); choose a folder that can, with --work"
        ) from None


def _new_temporary(folder: Path, delete: bool = False) -> Any:
    return tempfile.NamedTemporaryFile(dir=folder, prefix=_TEMPORARY[0], suffix=_TEMPORARY[1], delete=delete)


def _sync_folder(folder: Path) -> None:
    """Flush the names in a folder to the disk; not every file system can do so."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def copy(source: str | Path, target: str | Path) -> None:
    """Write a copy of a file, all or nothing."""

    def fill(file: BinaryIO) -> None:
        with Path(source).open("rb") as whole:
            shutil.copyfileobj(whole, file)

    write_bytes(target, fill)


def write_text(path: str | Path, text: str) -> str:
    """Write a text file and return the SHA-256 of what was written, in hexadecimal."""
    data = text.encode()
    write_bytes(path, lambda file: file.write(data))
    return hashlib.sha256(data).hexdigest()


def write_json(path: str | Path, value: Any) -> None:
    """Write a value as indented JSON, all or nothing."""
    write_text(path, json.dumps(value, indent=1, ensure_ascii=False) + "\n")


def read_json(path: str | Path) -> Any:
    """Read a JSON file; DataError for one that is missing or is not JSON."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise DataError(f"{path}: not JSON ({error}); delete it and run the command that writes it") from None


def write_arrays(path: str | Path, arrays: dict[str, np.ndarray]) -> None:
    """Write an uncompressed `.npz`: the same arrays give the same bytes."""
    named: dict[str, Any] = dict(arrays)  # else taken for the options of savez
    write_bytes(path, lambda file: np.savez(file, **named))


def read_arrays(path: str | Path, only: Collection[str] | None = None) -> dict[str, np.ndarray]:
    """Read all arrays of an `.npz`, or those named in `only` that it has; DataError if it is missing or damaged."""
    try:
        with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files if only is None or name in only}
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:
        # zipfile, zlib and numpy each have their own word for a damaged file.
        raise DataError(f"{path}: damaged ({error}); delete it and run the command that writes it") from None


def map_arrays(
    path: str | Path, at_least_bytes: float = 1_000_000, only: Collection[str] | None = None
) -> dict[str, np.ndarray]:
    """Map into memory the arrays of an `.npz` that `write_arrays` wrote, or those named in `only` that it has.

    Large ones stay on disk until they are looked at: they are read-only maps of the file, and need not be aligned.
    DataError for a missing or damaged file, and for one that is compressed.
    """
    arrays = {}
    try:
        with Path(path).open("rb") as file, zipfile.ZipFile(file) as stored:
            for member in stored.infolist():
                name = member.filename.removesuffix(".npy")
                if only is not None and name not in only:
                    continue
                if name in arrays:
                    raise ValueError(f"{member.filename} is in it twice")
                shape, fortran, dtype, start = _header(file, member)
                if member.file_size < at_least_bytes:
                    with stored.open(member) as part:
                        arrays[name] = np.lib.format.read_array(part, allow_pickle=False)
                else:
                    mapped = np.memmap(path, dtype, "r", start, shape, "F" if fortran else "C")
                    arrays[name] = np.asarray(mapped)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise DataError(f"{path}: damaged ({reason}); delete it and run the command that writes it") from None
    return arrays


def _header(file: BinaryIO, member: zipfile.ZipInfo) -> tuple[tuple[int, ...], bool, np.dtype, int]:
    """Read shape, order, dtype and place of one array of an `.npz`, which must be as long as they say.

    What a header announces is compared with the length of the file before anything is allocated for it.
    """
    file.seek(member.header_offset)
    local = file.read(30)
    if member.compress_type != zipfile.ZIP_STORED or local[:4] != b"PK\x03\x04":
        raise ValueError(f"{member.filename} is compressed")
    # The lengths of the name and of the extra field, which need not be those of the central directory.
    file.seek(sum(struct.unpack("<HH", local[26:30])), os.SEEK_CUR)
    start = file.tell()
    version = np.lib.format.read_magic(file)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = read_header(file)
    if dtype.hasobject:
        raise ValueError(f"{member.filename} holds Python objects")
    if min(shape, default=0) < 0 or file.tell() - start + math.prod(shape) * dtype.itemsize != member.file_size:
        raise ValueError(f"{member.filename} is not as long as its shape {shape} says")
    if start + member.file_size > os.fstat(file.fileno()).st_size:
        raise ValueError(f"{member.filename} ends beyond the file")
    return shape, fortran, dtype, file.tell()


def sha256(path: str | Path) -> str:
    """Hash the bytes of a file with SHA-256, in hexadecimal; DataError when it cannot be read."""
    try:
        with inputs.open_regular(path, hint="run the command that writes it") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); run the command that writes it") from None


def _remove(path: Path | None) -> None:
    if path is not None:
        path.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask

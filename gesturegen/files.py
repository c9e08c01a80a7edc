"""Writing files all or nothing: a reader never sees half a file, a crash leaves the old one."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from gesturegen.errors import DataError


def write_bytes(path: str | Path, fill: Callable[[BinaryIO], Any]) -> None:
    """Let `fill` write to a temporary file beside `path`, then move it into place.

    Raises DataError when the folder cannot be written or the disk is full.
    """
    path = Path(path)
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
            temporary = Path(file.name)
            fill(file)
        temporary.chmod(0o666 & ~_umask())
        os.replace(temporary, path)
    except OSError as error:
        _remove(temporary)
        raise DataError(
            f"{path}: cannot be written ({error.strerror}); choose a folder that can, with --work"
        ) from None
    except BaseException:
        _remove(temporary)
        raise


def write_text(path: str | Path, text: str) -> None:
    write_bytes(path, lambda file: file.write(text.encode()))


def write_json(path: str | Path, value: Any) -> None:
    write_text(path, json.dumps(value, indent=1, ensure_ascii=False) + "\n")


def read_json(path: str | Path) -> Any:
    """Raises DataError for a file that is missing or is not JSON."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise DataError(f"{path}: not JSON ({error}); delete it and run the command that writes it") from None


def write_arrays(path: str | Path, arrays: dict[str, np.ndarray]) -> None:
    """An uncompressed `.npz`: the same arrays give the same bytes."""
    write_bytes(path, lambda file: np.savez(file, **arrays))


def read_arrays(path: str | Path, only: Collection[str] | None = None) -> dict[str, np.ndarray]:
    """The arrays of an `.npz`, or those named in `only` that it has; DataError for a missing or damaged file."""
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files if only is None or name in only}
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:
        # zipfile, zlib and numpy each have their own word for a damaged file.
        raise DataError(f"{path}: damaged ({error}); delete it and run the command that writes it") from None


def sha256(path: str | Path) -> str:
    """The hash of a file's bytes, in hexadecimal; DataError when it cannot be read."""
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); run the command that writes it") from None


def _remove(path: Path | None) -> None:
    if path is not None:
        path.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask

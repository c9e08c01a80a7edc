"""The store of compiled code: one file an entry, written all or nothing and read only if its checksum is right.

An entry's name and content tell all it was made of, and an entry is a single file that is replaced in one step: any
number of processes may read and write at the same time, and whatever is torn, cut off, flipped or missing is compiled
again. Unpickling runs code, so entries are read only from folders that nobody else can write.
"""

from __future__ import annotations

import hashlib
import io
import os
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import IO, Any, BinaryIO

import llvmlite.binding
from numba.core import config as numba_config

from gesturegen import __version__

# numba makes its attributes at run time.
config: Any = numba_config

_FORMAT = b"gesturegen compiled code 1\n"
_DIGEST_BYTES = hashlib.sha256().digest_size
_ENDING = ".compiled"
# Variables of numba that do not change what is compiled.
_WITHOUT_EFFECT = {"NUMBA_CACHE_DIR", "NUMBA_NUM_THREADS", "NUMBA_DEBUG_CACHE", "NUMBA_CACHE_LOCATOR_CLASSES"}
# Seconds after which a temporary file is one that a killed process left behind.
_LEFT_BEHIND = 3600

# Names of the entries that this process has loaded or saved.
used: set[str] = set()
# Why code could not be kept, by folder, in the words of the operating system.
_refusals: dict[Path, str] = {}


def folders() -> list[Path]:
    """List the folders for compiled code, the best first: the user's cache, then a private temporary folder."""
    temporary = Path(os.environ.get("TMPDIR") or "/tmp").absolute() / f"gesturegen-{os.geteuid()}"
    return [base / _made_of() for base in (cache_folder(), temporary) if base is not None]


def read(name: str) -> Iterator[BinaryIO]:
    """Yield every sound copy of an entry, as an open file in memory."""
    for folder in folders():
        payload = _payload(folder, name)
        if payload is not None:
            yield io.BytesIO(payload)


def is_sound(name: str) -> bool:
    """Tell whether there is a sound copy of an entry."""
    return any(_payload(folder, name) is not None for folder in folders())


def keep(name: str, payload: bytes) -> bool:
    """Write an entry to the first folder that takes it; False, and no error, when none does."""
    used.add(name)
    for folder in folders():
        try:
            _make(folder)
            _replace(folder / f"{name}{_ENDING}", _FORMAT + hashlib.sha256(payload).digest() + payload)
        except OSError as error:
            _refuse(folder, error)
        else:
            return True
    return False


@contextmanager
def alone(patience: float = 300) -> Iterator[Path | None]:
    """Hold the lock of the store, after waiting for other processes; the system frees it when a process dies.

    Yields the folder that entries are written to, None where there is none. The lock saves work and nothing depends on
    it: the block also runs where the file system knows no locks, or when the lock is not given back in `patience`
    seconds, as by a process that was stopped.
    """
    folder = _first_writable()
    with ExitStack() as stack:
        if folder is not None:
            _tidy(folder)
            with suppress(OSError):
                file = stack.enter_context((folder / "lock").open("a"))
                deadline = time.monotonic() + patience
                while not _locked(file) and time.monotonic() < deadline:
                    time.sleep(0.1)
        yield folder


def refusal() -> str:
    """Say in one phrase why the user's cache takes no entries; empty where it takes them."""
    return "; ".join(f"{folder.parent}: {reason}" for folder, reason in _refusals.items())


def _first_writable() -> Path | None:
    for folder in folders():
        try:
            _make(folder)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError as error:
            _refuse(folder, error)
        else:
            return folder
    return None


def _refuse(folder: Path, error: OSError) -> None:
    _refusals[folder] = error.strerror or str(error)


def _locked(file: IO) -> bool:
    import fcntl

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _tidy(folder: Path) -> None:
    """Remove the temporary files that killed processes left in `folder`."""
    for path in folder.glob("*.new"):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > _LEFT_BEHIND:
                path.unlink()


def cache_folder() -> Path | None:
    """Find the cache folder of numba, or of the user; None for a user without a home."""
    if config.CACHE_DIR:
        return Path(config.CACHE_DIR).absolute() / "gesturegen"
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if named.is_absolute():
        return named / "gesturegen"
    home = home_folder()
    return None if home is None else home / ".cache" / "gesturegen"


def home_folder() -> Path | None:
    """Find the home folder of the user; None for a user without one."""
    try:
        home = Path.home()
    except RuntimeError:
        return None
    return home if home.is_absolute() else None


@cache
def _made_of() -> str:
    """Name a folder for all that compiled code depends on beside its source: versions, processor, settings."""
    processor = config.CPU_NAME or llvmlite.binding.get_host_cpu_name()
    settings = [
        llvmlite.binding.get_process_triple(),
        llvmlite.binding.get_host_cpu_features().flatten(),
        str(getattr(config, "USING_SVML", False)),
        *sorted(
            f"{key}={value}"
            for key, value in os.environ.items()
            if key.startswith("NUMBA_") and key not in _WITHOUT_EFFECT
        ),
    ]
    versions = [f"{name}{_version(name)}" for name in ("numba", "llvmlite", "librosa", "numpy")]
    digest = hashlib.sha256("\n".join(settings).encode()).hexdigest()[:8]
    python = f"{sys.implementation.cache_tag}.{sys.version_info.micro}{sys.abiflags}"
    return "-".join([f"gesturegen{__version__}", python, *versions, processor, digest]).replace("/", "_")


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "unknown"


def _payload(folder: Path, name: str) -> bytes | None:
    if not _is_safe(folder.parent) or not _is_safe(folder):
        return None
    try:
        data = (folder / f"{name}{_ENDING}").read_bytes()
    except OSError:
        return None
    head = len(_FORMAT)
    payload = data[head + _DIGEST_BYTES :]
    expected = _FORMAT + hashlib.sha256(payload).digest()
    return payload if data[: head + _DIGEST_BYTES] == expected else None


def _make(folder: Path) -> None:
    """Make `folder`, writable by this user only; OSError where that cannot be, or where others can write to it."""
    folder.parent.parent.mkdir(parents=True, exist_ok=True)
    for path in (folder.parent, folder):
        path.mkdir(mode=0o755 if folder.parent.name == "gesturegen" else 0o700, exist_ok=True)
        if not _is_safe(path):
            raise PermissionError(0, "it belongs to somebody else, or others may write to it")


def _is_safe(folder: Path) -> bool:
    """Tell whether nobody but this user and root can have put something into `folder`."""
    try:
        found = os.lstat(folder)
    except OSError:
        return False
    own = found.st_uid in (os.geteuid(), 0)
    return stat.S_ISDIR(found.st_mode) and own and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _replace(path: Path, data: bytes) -> None:
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f"{path.name[:40]}-", suffix=".new")
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        # Entries of root may serve others, as in an image of a container.
        temporary.chmod(0o644)
        temporary.replace(path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise

"""The lock on a folder that commands write into, and the removal of half-written files of killed commands."""

from __future__ import annotations

import importlib
import json
import os
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import ModuleType

from gesturegen import files, supervision
from gesturegen.errors import DataError

fcntl: ModuleType | None
try:
    fcntl = importlib.import_module("fcntl")
except ImportError:  # pragma: no cover - not a Unix
    fcntl = None

LOCK = ".lock"
# Where the commands write below a work folder: nothing else in it is searched for what killed ones left.
_FOLDERS = ("ablation", "clips", "compare", "evaluate", "export", "gestures", "graphs", "reenact", "submission",
            "variants", "video")  # fmt: skip
# A killed command's workers end within moments; a command started right after it must not fail for that.
_SECONDS_FOR_THE_DYING = 5.0
_PAUSE = 0.05

# Descriptors of the locks that this process holds, by folder.
_held: dict[Path, int] = {}


def held() -> tuple[int, ...]:
    """Return descriptors of the locks of this process; a worker that holds them too keeps the folder locked."""
    return tuple(_held.values())


def locked_folder(folder: Path) -> Path:
    """Return the folder whose lock protects `folder`: the outermost work folder around it, or itself."""
    folder = folder.resolve()
    works = [parent for parent in folder.parents if (parent / "clips" / "index.json").is_file()]
    return works[-1] if works else folder


@contextmanager
def locked(folders: Iterable[Path], command: str, wait: bool, say: Callable[[str], None]) -> Iterator[None]:
    """Hold the locks of all `folders` in the block, in which no other command writes into them.

    wait : for a command that holds one, else DataError tells who it is; say : is told what a user must know. What
    killed commands left half-written is removed. The kernel lets a lock go when this process and its workers are gone.
    """
    with ExitStack() as stack:
        # In one order for all, so that two that wait never wait for each other.
        for folder in sorted({locked_folder(folder) for folder in folders} - _held.keys()):
            stack.enter_context(_locked(folder, command, wait, say))
        yield


@contextmanager
def _locked(folder: Path, command: str, wait: bool, say: Callable[[str], None]) -> Iterator[None]:
    path, new = folder / LOCK, not folder.exists()
    descriptor = _acquire(path, command, wait, say)
    _held[folder] = descriptor
    try:
        remove_unfinished(folder)
        yield
    finally:
        remove_unfinished(folder)  # of workers that were killed, while the command went on
        del _held[folder]
        with suppress(OSError):
            path.unlink()
            if new:  # and still empty, after a command that failed
                folder.rmdir()
        with suppress(OSError):  # at once, even if a worker still has the descriptor
            if fcntl is not None:
                fcntl.flock(descriptor, fcntl.LOCK_UN)
        os.close(descriptor)


def _acquire(path: Path, command: str, wait: bool, say: Callable[[str], None]) -> int:
    """Acquire the lock of a file and return the open descriptor that holds it."""
    said, give_up = False, time.monotonic() + _SECONDS_FOR_THE_DYING
    while True:
        descriptor = _open(path)
        try:
            if _lock(descriptor, path, say):
                if _is_there(descriptor, path):
                    _sign(descriptor, command)
                    return descriptor
                os.close(descriptor)  # its last holder has removed it in the meantime
                continue
        except BaseException:
            os.close(descriptor)
            raise
        holder = _read_holder(descriptor)
        os.close(descriptor)
        ending = _is_gone(holder) and time.monotonic() < give_up
        if not wait and not ending:
            raise DataError(f"{path.parent}: {_describe(holder)}; wait for its end, or give --wait")
        if wait and not said:
            say(f"{path.parent}: {_describe(holder)}; waiting for its end")
            said = True
        time.sleep(_PAUSE)


def _open(path: Path) -> int:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0), 0o666)
    except OSError as error:
        raise DataError(
            f"{path.parent}: cannot be written ({error.strerror}); choose a folder that can, with --work"
        ) from None


def _lock(descriptor: int, path: Path, say: Callable[[str], None]) -> bool:
    """Try to lock an open file and tell whether this process has it; where locks are missing it has, with a warning."""
    try:
        if fcntl is None:
            raise OSError(0, "not on this system")
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        say(
            f"{path.parent}: this file system has no locks ({error.strerror}); "
            "make sure that no other command writes there at the same time"
        )
    return True


def _is_there(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except OSError:
        return False


def _sign(descriptor: int, command: str) -> None:
    """Write into the lock file who holds it, for commands that find it held."""
    holder = {
        "pid": supervision.process_id(),
        "host": socket.gethostname(),
        "command": command,
        "since": time.strftime("%Y-%m-%d %H:%M:%S"),
    }
    with suppress(OSError):  # a full disk: the lock holds all the same
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, json.dumps(holder).encode(), 0)


def _read_holder(descriptor: int) -> dict:
    try:
        holder = json.loads(os.pread(descriptor, 4096, 0))
        return holder if isinstance(holder, dict) else {}
    except (OSError, ValueError):
        return {}


def _is_gone(holder: dict) -> bool:
    """Tell whether the process that took the lock has ended, so that only its workers can still hold it."""
    pid = holder.get("pid")
    if not isinstance(pid, int) or pid <= 0 or holder.get("host") != socket.gethostname():
        return not holder  # it has just been taken and not been signed yet
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    return False


def _describe(holder: dict) -> str:
    if not holder:
        return "another command is writing there"
    host = holder.get("host")
    where = "" if host == socket.gethostname() else f" on {host}"
    gone = ", which has ended, but not all of its workers have" if _is_gone(holder) else ""
    return (
        f"in use by `{holder.get('command')}` (process {holder.get('pid')}{where}, since {holder.get('since')}){gone}"
    )


def remove_unfinished(folder: Path) -> None:
    """Remove the temporary files that killed commands left in a work folder, or in any other folder they wrote."""
    places = [folder]
    for name in _FOLDERS:
        if (folder / name).is_dir() and not (folder / name).is_symlink():
            places += [Path(place) for place, _, _ in os.walk(folder / name)]
    for place in places:
        with suppress(OSError):
            for path in place.iterdir():
                if files.is_temporary(path) and path.is_file() and not path.is_symlink():
                    path.unlink(missing_ok=True)

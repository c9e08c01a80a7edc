"""The supervisor process of a command: it ends the command and its workers on a signal, and says why one died.

Compiled loops cannot be interrupted from Python, so the command runs in a child process. The supervisor only waits for
signals and for the child: whatever the child is doing, all of it ends at once, with one line and no traceback.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress

# Ask for an end. Those that are ignored when the program starts, as by `nohup`, stay ignored.
STOPS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
# How long the watching process waits for the workers of a killed command.
_SECONDS_FOR_WORKERS = 1.5
_PR_SET_PDEATHSIG = 1
_CRASH = "a crash in compiled code, not for lack of memory; try it again, and please report it when it happens again"
_LIKELY = {
    "SIGKILL": "most likely out of memory; use fewer jobs with -j, or give the machine more memory",
    "SIGBUS": "a file that was mapped into memory was cut short or its disk failed; check the disk and try it again",
    "SIGXCPU": "it was over its limit of processor time; raise the limit (ulimit -t)",
} | dict.fromkeys(("SIGSEGV", "SIGABRT", "SIGILL", "SIGFPE", "SIGTRAP", "SIGSYS"), _CRASH)

# Written by the command and read by the process that watches it: what to say of it when it ends early.
_HINT, _TASK = slice(0, 1024), slice(1024, 4096)


class _State:
    """The state that a supervisor and its command share, None where nobody watches.

    page : memory of both; held_open : the writing end of a pipe that the command and all of its workers hold open, so
    that their end can be awaited
    """

    page: mmap.mmap | None = None
    held_open: int | None = None


def supervise(work: Callable[[], None]) -> None:
    """Run `work` in a child process and exit as it did; on a signal end it with all of its workers.

    Exit code: that of the child, or 128 and the number of the signal. Where there is no `fork`, `work` runs here.
    """
    if not hasattr(os, "fork") or _State.page is not None or threading.active_count() > 1:
        work()
        return
    _open_standard_files()
    stops = {number for number in STOPS if signal.getsignal(number) is not signal.SIG_IGN}
    _State.page = mmap.mmap(-1, _TASK.stop)
    reading, writing = os.pipe()
    # Waited for with `sigwait`, which has no moment at which a signal could be missed or raise an exception.
    signal.pthread_sigmask(signal.SIG_BLOCK, stops | {signal.SIGCHLD})
    signal.signal(signal.SIGCHLD, lambda *_: None)  # a signal without a handler is not waited for everywhere
    parent, child = os.getpid(), os.fork()
    if child == 0:
        os.close(reading)
        _State.held_open = writing
        for number in stops | {signal.SIGCHLD}:
            signal.signal(number, signal.SIG_DFL)
        end_with_parent(parent)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, stops | {signal.SIGCHLD})
        work()
        return
    os.close(writing)
    stopped, status = _await(child, stops)
    _await_closing(reading)
    os._exit(_exit_code(stopped, status))


def _open_standard_files() -> None:
    """Replace standard files that are closed, so that no pipe or lock gets their numbers and what is printed."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


def _await(child: int, stops: set[signal.Signals]) -> tuple[int | None, int]:
    """Wait for the child; return the first signal that asked for an end, and how the child ended."""
    stopped = None
    while True:
        number = signal.sigwait(stops | {signal.SIGCHLD})
        if number != signal.SIGCHLD:
            stopped = stopped or number
            with suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return stopped, status


def _await_closing(reading: int) -> None:
    """Wait until every process that holds the other end of the pipe is gone: a lock is free only then."""
    with suppress(OSError):
        select.select([reading], [], [], _SECONDS_FOR_WORKERS)


def _exit_code(stopped: int | None, status: int) -> int:
    """Return the exit code of the whole program; print one line on standard error when a signal ended it."""
    code = os.waitstatus_to_exitcode(status)
    if stopped is None and code >= 0:
        return code
    if stopped is None and -code in STOPS:
        stopped = -code
    hint, task = _read(_HINT), _read(_TASK)
    if stopped is not None:
        line = f"stopped by {signal_name(stopped)}" + (f"; {hint}" if hint else "")
    else:
        line = "error: the program " + describe_death(code) + (f" (at clip {task})" if task else "")
    # After a progress bar, which leaves the cursor in its line.
    text = ("\n" if os.isatty(2) else "") + line + "\n"
    with suppress(OSError):
        os.write(2, text.encode(errors="backslashreplace"))
    return 128 + (stopped or -code)


def describe_death(code: int) -> str:
    """Describe how a process ended, by its exit code as `subprocess` gives it: the signal and its likely cause."""
    if code >= 0:
        return f"ended by itself with exit code {code}; please report this"
    name = signal_name(-code)
    return f"was ended by {name}: {_LIKELY.get(name, 'somebody or something outside ended it; try it again')}"


def signal_name(number: int) -> str:
    """Return the name of a signal, such as `SIGTERM`."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def end_with_parent(parent: int) -> None:
    """Let this process end when `parent`, which started it, ends in whatever way.

    On Linux the kernel sees to it. It acts when the thread that started this process ends. Elsewhere a thread watches,
    which cannot run while a compiled loop holds the interpreter.
    """
    done = False
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            none = ctypes.c_ulong(0)
            done = ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGKILL), none, none, none) == 0
    if os.getppid() != parent:  # it ended before
        os._exit(1)
    if not done:
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.2)
    os._exit(1)


def held_open() -> tuple[int, ...]:
    """Return the file descriptors that every worker must inherit, so that its end can be awaited."""
    return () if _State.held_open is None else (_State.held_open,)


def is_watched() -> bool:
    """Tell whether this process is a command that a supervisor watches over."""
    return _State.held_open is not None


def process_id() -> int:
    """Return the id of the process that the user started, which ends the command when it is ended."""
    return os.getppid() if is_watched() else os.getpid()


def set_hint(text: str) -> None:
    """Set the advice that is printed when this command is stopped."""
    _write(_HINT, text)


def set_task(name: str) -> None:
    """Set the name of the clip that this process works on, to be reported when it crashes."""
    _write(_TASK, name)


def _write(place: slice, text: str) -> None:
    if _State.page is not None:
        size = place.stop - place.start
        _State.page[place] = text.encode(errors="backslashreplace")[: size - 1].ljust(size, b"\0")


def _read(place: slice) -> str:
    assert _State.page is not None, "only a supervisor reads"
    return bytes(_State.page[place]).rstrip(b"\0").decode(errors="replace")

"""Worker processes with one task at a time each, so that a task whose worker dies is known by name.

They are kept for the next tasks, end with the process that started them, and while they work they hold the locks that
it holds: a folder is free only when nobody can write into it any more.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import pickle
import signal
import socket
import subprocess
import sys
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from multiprocessing.connection import Connection, wait
from typing import Any

from gesturegen import supervision, workspace
from gesturegen.errors import DataError

# A worker has one processor: the last digits of sums must not depend on how many there are.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "NUMBA_NUM_THREADS",
               "NUMEXPR_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")  # fmt: skip
_MOST_LOCKS = 16
_MOST_STARTS = 5
_SECONDS_TO_END = 1.0


class Worker:
    """One process, and the connection to it."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            inherited = (theirs.fileno(), *supervision.held_open())
            code = (
                f"import sys; sys.path[:] = {sys.path!r}; from gesturegen import workers; "
                f"workers.serve({theirs.fileno()}, {os.getpid()})"
            )
            try:
                self.process = subprocess.Popen(
                    [sys.executable, *subprocess._args_from_interpreter_flags(), "-c", code],
                    stdin=subprocess.DEVNULL, pass_fds=inherited, env={**dict.fromkeys(_ONE_THREAD, "1"), **os.environ},
                )  # fmt: skip
            except OSError as error:
                ours.close()
                raise DataError(
                    f"a worker process cannot be started ({error.strerror}); use fewer jobs with -j"
                ) from None
        self.socket = ours
        self.connection = Connection(os.dup(ours.fileno()))

    def send(self, task: bytes) -> None:
        """Give it a pickled task; OSError when it is dead."""
        socket.send_fds(self.socket, [b"\0"], list(workspace.held()))
        self.connection.send_bytes(task)

    def receive(self) -> Any:
        """What the task returned; EOFError or OSError when the worker died."""
        return pickle.loads(self.connection.recv_bytes())

    def end(self, at_once: bool = False) -> int:
        """End the process, which may still be at a task only with `at_once`; its exit code."""
        self.connection.close()
        self.socket.close()
        if at_once:
            self.process.kill()
        try:
            return self.process.wait(_SECONDS_TO_END)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()


_idle: list[Worker] = []


def _hire(fresh: bool) -> Worker:
    while _idle and not fresh:
        worker = _idle.pop()
        if worker.process.poll() is None:
            return worker
        worker.end()
    return Worker()


@atexit.register
def dismiss() -> None:
    """End the workers that have nothing to do."""
    while _idle:
        _idle.pop().end()


def run(
    tasks: Mapping[str, Callable[[], tuple[str, Any]]], jobs: int, fresh: bool, say: Callable[[str], None]
) -> Iterator[tuple[str, str, Any]]:
    """Run every task in one of `jobs` workers; yields `(name, kind, value)` as they end.

    tasks : name -> what returns `(kind, value)`. A task whose worker dies is of the kind `errors`, with the signal and
    what is likely; the others go on. One that was killed, as for lack of memory, is tried again at the end, alone.
    fresh : a new process for each task; say : is told what is tried again
    """
    todo, alone = deque(sorted(tasks)), deque()
    busy: dict[Connection, tuple[Worker, str]] = {}
    tried: set[str] = set()
    try:
        while todo or busy or alone:
            while todo and len(busy) < jobs:
                yield from _begin(todo.popleft(), tasks, busy, fresh)
            if not busy and alone:
                dismiss()
                yield from _begin(alone.popleft(), tasks, busy, fresh)
            for connection in wait(list(busy)):
                worker, name = busy.pop(connection)
                try:
                    kind, value = worker.receive()
                except (EOFError, OSError):
                    code = worker.end()
                    if code == -signal.SIGKILL and name not in tried:
                        tried.add(name)
                        alone.append(name)
                        say(
                            f"{name}: its worker was ended by SIGKILL, most likely out of memory; tried again at the end"
                        )
                        continue
                    yield name, "errors", _describe_death(code, name in tried)
                    continue
                if fresh:
                    worker.end()
                else:
                    _idle.append(worker)
                yield name, kind, value
    finally:
        for worker, _ in busy.values():
            worker.end(at_once=True)


def _begin(
    name: str, tasks: Mapping, busy: dict[Connection, tuple[Worker, str]], fresh: bool
) -> Iterator[tuple[str, str, Any]]:
    """Give a task to a worker; yields its end when it cannot be sent."""
    try:
        data = pickle.dumps((os.getcwd(), tasks[name]), pickle.HIGHEST_PROTOCOL)
    except Exception:
        yield name, "bugs", traceback.format_exc()
        return
    for _ in range(_MOST_STARTS):
        worker = _hire(fresh)
        try:
            worker.send(data)
        except OSError:  # died while it had nothing to do, or as it started
            code = worker.end()
            continue
        busy[worker.connection] = worker, name
        return
    yield name, "errors", _describe_death(code, False)


def _describe_death(code: int, again: bool) -> str:
    return f"its worker process {supervision.describe_death(code)}" + (
        "; it was tried twice, the second time with nothing else running" if again else ""
    )


def serve(descriptor: int, parent: int) -> None:
    """What a worker does: take tasks and return what they return, until the process that started it is gone."""
    supervision.end_with_parent(parent)
    for number in supervision.STOPS:  # meant for the whole program: the one that watches over it ends all of it
        signal.signal(number, signal.SIG_IGN)
    taken = socket.socket(fileno=descriptor)
    connection = Connection(os.dup(descriptor))
    with contextlib.suppress(EOFError, OSError):
        while True:
            mark, locks, _, _ = socket.recv_fds(taken, 1, _MOST_LOCKS)
            if not mark:
                return
            data = connection.recv_bytes()
            result = _answer(data)
            del data
            for lock in locks:
                os.close(lock)
            connection.send_bytes(result)


def _answer(data: bytes) -> bytes:
    try:
        folder, task = pickle.loads(data)
        os.chdir(folder)
        return pickle.dumps(task(), pickle.HIGHEST_PROTOCOL)
    except Exception:
        return pickle.dumps(("bugs", traceback.format_exc()))

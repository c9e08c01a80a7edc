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
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from gesturegen import locks, supervision
from gesturegen.errors import DataError

# A worker has one processor: the last digits of sums must not depend on how many there are.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "NUMBA_NUM_THREADS",
               "NUMEXPR_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")  # fmt: skip
_MOST_LOCKS = 16
_MOST_STARTS = 5
_SECONDS_TO_END = 1.0


class Worker:
    """A worker process, and the connection to it."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            inherited = (theirs.fileno(), *supervision.held_open())
            code = (
                f"import sys; sys.path[:] = {sys.path!r}; from gesturegen import workers; "
                f"workers.serve({theirs.fileno()}, {os.getpid()})"
            )
            try:
                flags = subprocess._args_from_interpreter_flags()  # type: ignore[attr-defined] # private, not in typeshed
                self.process = subprocess.Popen(
                    [sys.executable, *flags, "-c", code],
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
        """Send the worker a pickled task; OSError when it is dead."""
        socket.send_fds(self.socket, [b"\0"], list(locks.held()))
        self.connection.send_bytes(task)

    def receive(self) -> Any:
        """Return what the task returned; EOFError or OSError when the worker died."""
        return pickle.loads(self.connection.recv_bytes())

    def end(self) -> int:
        """End the process, which has no task, and return its exit code."""
        self.connection.close()
        self.socket.close()
        try:
            return self.process.wait(_SECONDS_TO_END)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()


# The kernel ends a worker with the thread that started it, so all are started by one that lasts.
_starter = ThreadPoolExecutor(max_workers=1)
_hiring = threading.Lock()
_idle: list[Worker] = []


@atexit.register
def dismiss() -> None:
    """End the workers that have nothing to do."""
    while _idle:
        _idle.pop().end()


class _Crew:
    """The workers for one stage's tasks, one for each thread that asks for an answer."""

    def __init__(self, fresh: bool) -> None:
        self.fresh = fresh
        self.busy: set[Worker] = set()
        self.ended = False

    def answer(self, name: str, task: Callable[[], tuple[str, Any]]) -> tuple[str, str, Any]:
        """Run a task in a worker and return its name, kind and value; kind `dead`, with the exit code, if it died."""
        try:
            data = pickle.dumps((str(Path.cwd()), task), pickle.HIGHEST_PROTOCOL)
        except Exception:
            return name, "bugs", traceback.format_exc()
        for _ in range(_MOST_STARTS):
            worker = self._hire()
            try:
                worker.send(data)
            except OSError:  # died while it had nothing to do, or as it started
                code = self._end(worker)
                continue
            try:
                kind, value = worker.receive()
            except (EOFError, OSError):
                code = self._end(worker)
                break
            if self.fresh:
                self._end(worker)
            else:
                with _hiring:
                    self.busy.discard(worker)
                    _idle.append(worker)
            return name, kind, value
        return name, "dead", code

    def _hire(self) -> Worker:
        with _hiring:
            if self.ended:
                raise RuntimeError("no more tasks are wanted")
            while _idle and not self.fresh:
                worker = _idle.pop()
                if worker.process.poll() is None:
                    break
                worker.end()
            else:
                worker = _starter.submit(Worker).result()
            self.busy.add(worker)
            return worker

    def _end(self, worker: Worker) -> int:
        with _hiring:
            self.busy.discard(worker)
        return worker.end()

    def kill(self) -> None:
        """End the workers that are at a task; no more are hired."""
        with _hiring:
            self.ended = True
            for worker in self.busy:
                worker.process.kill()
            for worker in self.busy:
                worker.process.wait()


def run(
    tasks: Mapping[str, Callable[[], tuple[str, Any]]], jobs: int, fresh: bool, say: Callable[[str], object]
) -> Iterator[tuple[str, str, Any]]:
    """Run every task in one of `jobs` workers; yield `(name, kind, value)` as they end.

    joblib hands out the tasks, to threads that wait for what a worker answers. (Its own worker processes go on when
    their parent is killed, and the death of one ends all tasks without telling whose it was.)

    tasks : name -> what returns `(kind, value)`. A task whose worker dies is of the kind `errors`, with the signal and
    what is likely; the others go on. One that was killed, as for lack of memory, is tried again at the end, alone.
    fresh : a new process for each task; say : is told what is tried again
    """
    import joblib

    crew, killed = _Crew(fresh), []
    parallel = joblib.Parallel(n_jobs=jobs, backend="threading", batch_size=1, return_as="generator_unordered")
    results = parallel(joblib.delayed(crew.answer)(name, tasks[name]) for name in sorted(tasks))
    try:
        for name, kind, value in results:
            if kind != "dead":
                yield name, kind, value
            elif value == -signal.SIGKILL:
                killed.append(name)
                say(f"{name}: its worker was ended by SIGKILL, most likely out of memory; tried again at the end")
            else:
                yield name, "errors", _describe_death(value, False)
        for name in sorted(killed):
            dismiss()
            _, kind, value = crew.answer(name, tasks[name])
            yield (name, "errors", _describe_death(value, True)) if kind == "dead" else (name, kind, value)
    finally:
        crew.kill()
        results.close()


def _describe_death(code: int, again: bool) -> str:
    return f"its worker process {supervision.describe_death(code)}" + (
        "; it was tried twice, the second time with nothing else running" if again else ""
    )


def serve(descriptor: int, parent: int) -> None:
    """Serve as a worker: take tasks and return their results, until the process that started it is gone."""
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

"""Work over clips: one clip's failure harms no other, for any number of workers."""

import os
import signal
from functools import partial

import pytest

from gesturegen.errors import DataError
from gesturegen.parallel import for_each
from tests.faults.processes import die_of, die_once_of


def work(number: int) -> int:
    if number == 2:
        raise DataError("two is broken")
    if number == 3:
        raise ZeroDivisionError("a bug")
    return number * number


@pytest.mark.parametrize("jobs", [1, 2, 9])
def test_outcomes_are_sorted_apart(jobs):
    outcome = for_each({f"clip{n}": partial(work, n) for n in (4, 3, 2, 1)}, jobs, "test", quiet=True)
    assert list(outcome.done.items()) == [("clip1", 1), ("clip4", 16)]
    assert outcome.errors == {"clip2": "two is broken"}
    assert list(outcome.bugs) == ["clip3"] and "ZeroDivisionError: a bug" in outcome.bugs["clip3"]
    assert outcome.failed == 2


def blas_threads() -> set[int]:
    import numpy  # noqa: F401
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_info

    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_task_has_one_thread_for_matrix_products(jobs):
    """Else the last digits of onset strengths, and so the stored bytes, depend on the number of workers."""
    outcome = for_each({"a": blas_threads, "b": blas_threads}, jobs, "test", quiet=True)
    assert outcome.done == {"a": {1}, "b": {1}}


def test_a_worker_that_dies_is_named_and_the_others_go_on(tmp_path, capfd):
    tasks = {f"clip{n}": partial(work, n) for n in (1, 4, 5)}
    tasks |= {
        "crash": partial(die_of, signal.SIGSEGV),
        "memory": partial(die_of, signal.SIGKILL),
        "once": partial(die_once_of, signal.SIGKILL, tmp_path / "mark"),
        "quit": partial(os._exit, 3),
        "unpicklable": partial(work, lambda: None),
        "unreturnable": partial(eval, "lambda: None"),
    }
    outcome = for_each(tasks, 2, "test", quiet=False)
    assert outcome.done == {"clip1": 1, "clip4": 16, "clip5": 25, "once": "alive"}
    assert "SIGSEGV: a crash in compiled code, not for lack of memory" in outcome.errors["crash"]
    assert "SIGKILL: most likely out of memory" in outcome.errors["memory"]
    assert outcome.errors["memory"].endswith("tried twice, the second time with nothing else running")
    assert "exit code 3" in outcome.errors["quit"]
    assert sorted(outcome.bugs) == ["unpicklable", "unreturnable"]
    said = capfd.readouterr().err.splitlines()
    assert len(said) == 2 and all("ended by SIGKILL" in line and "tried again" in line for line in said), said


def test_workers_are_kept_and_fresh_ones_are_not(tmp_path, monkeypatch):
    tasks = {"a": os.getpid, "b": os.getpid}
    first = set(for_each(tasks, 2, "test", quiet=True).done.values())
    assert set(for_each(tasks, 2, "test", quiet=True).done.values()) & first
    assert not set(for_each(tasks, 1, "test", quiet=True, fresh=True).done.values()) & (first | {os.getpid()})
    # The folder of a task is that of its command, wherever the worker was started.
    monkeypatch.chdir(tmp_path)
    assert set(for_each({"a": os.getcwd, "b": os.getcwd}, 2, "test", quiet=True).done.values()) == {os.getcwd()}


def test_nothing_to_do():
    assert for_each({}, 4, "test", quiet=True).failed == 0

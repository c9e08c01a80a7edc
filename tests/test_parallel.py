"""Work over clips: one clip's failure harms no other, for any number of workers."""

from functools import partial

import pytest

from gesturegen.errors import DataError
from gesturegen.parallel import for_each


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


def test_nothing_to_do():
    assert for_each({}, 4, "test", quiet=True).failed == 0

"""Parallel work over clips in worker processes, in which one clip's failure harms no other."""

from __future__ import annotations

import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any

from gesturegen import supervision
from gesturegen.errors import GesturegenError
from gesturegen.inputs import shown
from gesturegen.outcome import Outcome

# What `warm_up` is to compile before the workers of a stage start, by the first word of its label.
_LOOPS = {
    "preprocess": ("speech",),
    "build-graph": ("build",),
    "reenact": ("build", "search"),
    "ablate": ("build", "search"),
    "compare": ("build", "search"),
    "render": ("video",),
}


def default_jobs() -> int:
    """Count the processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def for_each(
    tasks: Mapping[str, Callable[[], Any]], jobs: int, label: str, quiet: bool, fresh: bool = False
) -> Outcome:
    """Run every task, showing clips done, time left and failures so far.

    tasks : clip name -> a function without arguments, which worker processes must be able to unpickle. The outcome is
    the same for any `jobs`. With one job, or one task, everything runs in this process; `fresh` gives every task a
    process of its own instead. A task whose process dies is an error that names the signal; the others go on.
    """
    if groups := _LOOPS.get(label.partition(":")[0]):
        from gesturegen import warm_up

        warm_up.prepare(groups, quiet)
    outcome = Outcome()
    guarded = {name: partial(_guarded, tasks[name]) for name in sorted(tasks)}
    with _stage(label, len(guarded), quiet) as bar:
        if fresh or min(jobs, len(guarded)) > 1:
            from gesturegen import workers

            results = workers.run(guarded, jobs, fresh, lambda line: quiet or bar.write(line, file=sys.stderr))
        else:
            results = _here(guarded)
        for name, kind, value in results:
            getattr(outcome, kind)[name] = value
            bar.failed += kind != "done"
            bar.set_postfix(failed=bar.failed, refresh=False)
            bar.update()
    for kind in ("done", "errors", "bugs"):
        setattr(outcome, kind, dict(sorted(getattr(outcome, kind).items())))
    return outcome


def describe_bugs(bugs: Mapping[str, str]) -> list[str]:
    """Format the traceback of the first bug with a line that says what it is, and count the other clips with one."""
    if not bugs:
        return []
    (clip, trace), *others = sorted(bugs.items())
    more = [f"bug: {len(others)} clips more met with a bug, such as {shown(others[0][0])}"] if others else []
    return [f"{trace}bug: {shown(clip)}: this is a fault of gesturegen; please report the lines above", *more]


def _here(tasks: Mapping[str, Callable[[], tuple[str, Any]]]) -> Iterator[tuple[str, str, Any]]:
    for name, task in tasks.items():
        supervision.set_task(name)
        yield name, *task()
    supervision.set_task("")


class _Shared:
    """The progress bar that all stages share; None outside of `one_display`."""

    bar: Any = None


@contextmanager
def one_display(stages: int, expected: int, quiet: bool) -> Iterator[None]:
    """Show one progress bar for all calls of `for_each` in the block: stage, clips done, time left, failures.

    expected : how many tasks all stages have together, as far as is known before they start
    """
    with _new_bar("", expected, quiet) as bar:
        bar.stage, bar.stages, bar.stage_name = 0, stages, None
        _Shared.bar = bar
        try:
            yield
            bar.total = bar.n
        finally:
            _Shared.bar = None


@contextmanager
def _stage(label: str, total: int, quiet: bool) -> Iterator[Any]:
    """Yield the bar for one call of `for_each`: a new one, or the shared one moved on to the next stage."""
    if _Shared.bar is None:
        with _new_bar(label, total, quiet) as bar:
            yield bar
        return
    bar = _Shared.bar
    # `build-graph: edges` is part of the stage build-graph.
    name = label.partition(":")[0]
    bar.stage += name != bar.stage_name
    bar.stage_name = name
    bar.set_description(f"{bar.stage}/{bar.stages} {label}", refresh=False)
    bar.total = max(bar.total, bar.n + total)
    bar.refresh()
    yield bar


def _new_bar(label: str, total: int, quiet: bool) -> Any:
    from tqdm import tqdm

    # disable=None: no bar where the output is no terminal.
    bar: Any = tqdm(total=total, desc=label, unit="clip", disable=True if quiet else None)
    bar.failed = 0
    bar.set_postfix(failed=0, refresh=False)
    return bar


def _guarded(task: Callable[[], Any]) -> tuple[str, Any]:
    import scipy.linalg  # noqa: F401 - brings a BLAS of its own, which must be there to be limited
    from threadpoolctl import threadpool_limits

    try:
        # The last digits of a matrix product depend on its threads, and those on the number of workers.
        with threadpool_limits(limits=1), warnings.catch_warnings():
            # librosa tells of short windows and empty filters; what matters to a user is in our notes.
            warnings.filterwarnings("ignore", module="librosa")
            return "done", task()
    except GesturegenError as error:
        return "errors", str(error)
    except Exception:
        return "bugs", traceback.format_exc()

"""Clip by clip over worker processes: one clip's failure harms no other."""

from __future__ import annotations

import os
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from gesturegen.errors import DataError, GesturegenError


@dataclass
class Outcome:
    """What became of each clip, by name in sorted order.

    done : results; errors : one line each, the user's to mend; bugs : tracebacks, ours to mend
    """

    done: dict[str, Any] = field(default_factory=dict)
    errors: dict[str, str] = field(default_factory=dict)
    bugs: dict[str, str] = field(default_factory=dict)

    @property
    def failed(self) -> int:
        return len(self.errors) + len(self.bugs)


def default_jobs() -> int:
    """The processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def for_each(tasks: Mapping[str, Callable[[], Any]], jobs: int, label: str, quiet: bool) -> Outcome:
    """Run every task, showing clips done, time left and failures so far.

    tasks : clip name -> a function without arguments, which worker processes must be able to unpickle.
    With one job, or one task, everything runs in this process. The outcome is the same for any `jobs`.
    """
    import joblib
    from tqdm import tqdm

    jobs = min(jobs, len(tasks))
    outcome = Outcome()
    names = sorted(tasks)
    if jobs > 1:
        parallel = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")
        results = parallel(joblib.delayed(_guarded)(name, tasks[name]) for name in names)
    else:
        results = (_guarded(name, tasks[name]) for name in names)
    try:
        # disable=None: no bar where the output is no terminal.
        with tqdm(total=len(names), desc=label, unit="clip", disable=True if quiet else None) as bar:
            bar.set_postfix(failed=0)
            for name, kind, value in results:
                getattr(outcome, kind)[name] = value
                bar.set_postfix(failed=outcome.failed, refresh=False)
                bar.update()
    except joblib.externals.loky.process_executor.TerminatedWorkerError:
        raise DataError("a worker process died, most likely out of memory; use fewer jobs with -j") from None
    for kind in ("done", "errors", "bugs"):
        setattr(outcome, kind, dict(sorted(getattr(outcome, kind).items())))
    return outcome


def _guarded(name: str, task: Callable[[], Any]) -> tuple[str, str, Any]:
    try:
        with warnings.catch_warnings():
            # librosa tells of short windows and empty filters; what matters to a user is in our notes.
            warnings.filterwarnings("ignore", module="librosa")
            return name, "done", task()
    except GesturegenError as error:
        return name, "errors", str(error)
    except Exception:
        return name, "bugs", traceback.format_exc()

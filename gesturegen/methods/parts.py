"""Parts of libraries, each of one recording, which are made in separate tasks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from gesturegen.data.stored_clips import limits, load_reference
from gesturegen.methods import METHODS
from gesturegen.methods.method import Job, Method, Prepared
from gesturegen.settings.models import Config

if TYPE_CHECKING:
    from gesturegen.outcome import Outcome


def in_processes(
    method: Method, jobs: Mapping[str, Job], is_stored: Callable[[Job], bool],
    run: Callable[[Mapping, str], Outcome], label: str,
) -> Prepared:  # fmt: skip
    """Make the parts of libraries of several recordings, each in a task; a single recording is left to `build`."""
    tasks, users = {}, {}
    for name, job in jobs.items():
        if len(job.names) > 1 and not is_stored(job):
            for recording, limit in zip(job.names, limits(job.config, job.names), strict=True):
                title = f"{name}, {recording}"
                tasks[title], users[title] = partial(_part, method.name, job.config, recording, limit), [name]
    if not tasks:
        return Prepared()
    outcome = run(tasks, label)
    errors, bugs = by_library(outcome.errors, users), by_library(outcome.bugs, users)
    parts: dict[str, list[Any]] = {}
    for title in tasks:  # in the order of the recordings
        (name,) = users[title]
        if name not in errors and name not in bugs:
            parts.setdefault(name, []).append(outcome.done[title])
    return Prepared(parts, errors=errors, bugs=bugs)


def _part(method: str, config: Config, recording: str, limit: int | None) -> Any:
    return METHODS[method].part(load_reference(config, recording, limit), config)


def by_library(problems: Mapping[str, str], users: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Group failures by the libraries that need the failed tasks; users : task -> libraries."""
    return {name: problem for title, problem in problems.items() for name in users[title]}

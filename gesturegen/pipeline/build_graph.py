"""The command `build-graph`: build the graphs or databases that methods search from clips (§4.1)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from gesturegen.data.stored_clips import digests
from gesturegen.errors import DamagedError, DataError
from gesturegen.methods import METHODS, libraries
from gesturegen.methods.method import Description, Job
from gesturegen.outcome import Outcome
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import Summary, chosen_references, read_index, require_writable
from gesturegen.pipeline.memory import require_memory
from gesturegen.settings.models import Config
from gesturegen.stored import sealing
from gesturegen.workspace import library_name, library_path, work_path


def build_graphs(config: Config, jobs: int, quiet: bool, reuse: bool = False) -> Summary:
    """Build the library of every group of references that a test clip is given (§4.1).

    reuse : keep stored ones whose clips and settings have not changed
    """
    index = read_index(config)
    chosen = chosen_references(config, index)
    groups = {library_name(config, names): names for names in chosen.values()}
    # Searching needs more than building: better to hear of it now than after the graphs have been built.
    jobs, warnings = require_memory(config, chosen, index, jobs, tasks=len(groups))
    require_writable(work_path(config, "graphs"))
    wanted = {name: Job(config, names, library_path(config, name)) for name, names in groups.items()}
    outcome = build_libraries(wanted, jobs, "build-graph", quiet, reuse)
    summary = Summary(outcome, warnings, written=[work_path(config, "graphs")])
    for name, told in outcome.done.items():
        summary.lines += [f"{name}: {line}" for line in told.lines]
        summary.warnings += [(name, note) for note in told.notes]
    return summary


def build_libraries(wanted: Mapping[str, Job], jobs: int, label: str, quiet: bool, reuse: bool = False) -> Outcome:
    """Build and store libraries, possibly for several methods; the outcome holds their `Description` by name."""
    parts: dict[str, Any] = {}
    notes: dict[str, Any] = {}
    errors: dict[str, str] = {}
    bugs: dict[str, str] = {}

    def is_stored(job: Job) -> bool:
        return reuse and libraries.is_current(job, _digests(job))

    def run(tasks: Mapping, stage: str) -> Outcome:
        return for_each(tasks, jobs, f"{label}: {stage}", quiet) if tasks else Outcome()

    for kind, method in METHODS.items():
        own = {name: job for name, job in wanted.items() if job.config.method == kind}
        prepared = method.prepare(own, is_stored, run)
        parts |= prepared.parts
        notes |= prepared.notes
        errors |= prepared.errors
        bugs |= prepared.bugs
    tasks = {
        name: partial(_build, job, reuse, parts.get(name))
        for name, job in wanted.items()
        if name not in errors and name not in bugs
    }
    built = for_each(tasks, jobs, label, quiet)
    done = {
        name: Description(told.lines, [*notes.get(name, ()), *told.notes], told.unmatched)
        for name, told in built.done.items()
    }
    built.errors |= _unmatched(done, wanted)
    return Outcome(
        {name: told for name, told in done.items() if name not in built.errors},
        dict(sorted({**built.errors, **errors}.items())),
        dict(sorted({**built.bugs, **bugs}.items())),
    )


def _unmatched(done: Mapping[str, Description], wanted: Mapping[str, Job]) -> dict[str, str]:
    """Find, by library, patterns of the config that match nothing in any library built with the same patterns."""
    lacking: dict[tuple[str, str, str], dict[str, str]] = {}
    for name, told in done.items():
        for key, pattern, problem in told.unmatched:
            lacking.setdefault((key, _section_around(key, wanted[name]), pattern), {})[name] = problem
    errors: dict[str, list[str]] = {}
    for (key, settings, _), problems in lacking.items():
        if all(name in problems for name in done if _section_around(key, wanted[name]) == settings):
            name = min(problems)
            errors.setdefault(name, []).append(problems[name])
    return {name: "\n".join(lines) for name, lines in errors.items()}


def _section_around(key: str, job: Job) -> str:
    """Return the JSON of the section of a job's config that a key stands in."""
    return job.config.section_json(key.rpartition(".")[0])


def _digests(job: Job) -> tuple[str, ...]:
    return digests(job.config, job.names)


def _build(job: Job, reuse: bool, prepared: Any) -> Description:
    config, method, clip_digests = job.config, METHODS[job.config.method], _digests(job)
    lost = []
    if reuse:
        try:
            stored = libraries.load(job.path, method, config, clip_digests)
            method.built(job)  # a build may have been killed before it was
            return method.describe(stored, config)
        except DamagedError as error:
            lost = [sealing.remade(error)]
        except DataError:
            pass
    library = method.build(job, prepared)
    libraries.save(job.path, method, library, config, clip_digests)
    method.built(job)
    told = method.describe(library, config)
    return Description(told.lines, [*lost, *told.notes], told.unmatched)

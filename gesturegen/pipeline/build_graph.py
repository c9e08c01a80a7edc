"""`build-graph`: clips to the graphs or databases that methods search (§4.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from gesturegen.config import Config
from gesturegen.errors import DamagedError, DataError
from gesturegen.gestures.database import GestureDatabase
from gesturegen.graph.motion_graph import MotionGraph
from gesturegen.graph.reference_frames import ReferenceFrames
from gesturegen.matching import database as matching
from gesturegen.methods import METHODS
from gesturegen.parallel import Outcome, for_each
from gesturegen.pipeline import build_database
from gesturegen.pipeline.common import (
    Summary,
    chosen_references,
    digests,
    graph_name,
    graph_path,
    limits,
    load_reference,
    load_references,
    read_index,
    require_writable,
    work_path,
)
from gesturegen.pipeline.memory import require_memory
from gesturegen.search import rewards
from gesturegen.stored import sealing

# A lag of beats that stands out by fewer standard deviations may be chance: it is the best of many.
SURE = 3.0


@dataclass(frozen=True)
class Library:
    """What a method is to build: of which references, and where it goes."""

    config: Config
    names: tuple[str, ...]
    path: Path


def build_graphs(config: Config, jobs: int, quiet: bool, reuse: bool = False) -> Summary:
    """Build the graph of every group of references that a test clip is given (§4.1).

    reuse : keep stored graphs whose clips and settings have not changed
    """
    index = read_index(config)
    chosen = chosen_references(config, index)
    groups = {graph_name(config, names): names for names in chosen.values()}
    # Searching needs more than building: better to hear of it now than after the graphs have been built.
    jobs, warnings = require_memory(config, chosen, index, jobs, tasks=len(groups))
    require_writable(work_path(config, "graphs"))
    libraries = {name: Library(config, names, graph_path(config, name)) for name, names in groups.items()}
    outcome = build_libraries(libraries, jobs, "build-graph", quiet, reuse)
    summary = Summary(outcome, warnings, written=[work_path(config, "graphs")])
    for name, done in outcome.done.items():
        summary.lines += [f"{name}: {line}" for line in done["lines"]]
        summary.warnings += [(name, note) for note in done["notes"]]
    return summary


def build_libraries(
    libraries: Mapping[str, Library], jobs: int, label: str, quiet: bool, reuse: bool = False
) -> Outcome:
    """Build and store them all; the result of each is what to say of it: `lines` and `notes`."""
    staged = {name: library for name, library in libraries.items() if library.config.method == "gesture_master"}
    outcome = build_database.prepare(staged, jobs, label, quiet, reuse)
    remade = outcome.done
    parts, broken = _matching_parts(libraries, jobs, label, quiet, reuse)
    outcome = Outcome(errors=outcome.errors | broken.errors, bugs=outcome.bugs | broken.bugs)
    failed = outcome.errors | outcome.bugs
    tasks = {
        name: partial(_build, library, reuse, parts.get(name))
        for name, library in libraries.items()
        if name not in failed
    }
    built = for_each(tasks, jobs, label, quiet)
    for name, done in built.done.items():
        done["notes"] = [*remade.get(name, ()), *done["notes"]]
    built.errors |= _unmatched(built, libraries)
    built.done = {name: done for name, done in built.done.items() if name not in built.errors}
    errors = dict(sorted({**built.errors, **outcome.errors}.items()))
    return Outcome(built.done, errors, dict(sorted({**built.bugs, **outcome.bugs}.items())))


def _unmatched(built: Outcome, libraries: Mapping[str, Library]) -> dict[str, str]:
    """Errors by database, where a pattern of gesture clips matches nothing in any database built with it."""
    lacking: dict[tuple[str, str, str], dict[str, str]] = {}
    users: dict[str, int] = {}
    for name, done in built.done.items():
        quality = libraries[name].config.section_json("gesture_master.quality")
        users[quality] = users.get(quality, 0) + 1
        for key, pattern, problem in done.get("unmatched", ()):
            lacking.setdefault((quality, key, pattern), {})[name] = problem
    errors: dict[str, list[str]] = {}
    for (quality, _, _), problems in lacking.items():
        if len(problems) == users[quality]:
            name = min(problems)
            errors.setdefault(name, []).append(problems[name])
    return {name: "\n".join(lines) for name, lines in errors.items()}


def _matching_parts(
    libraries: Mapping[str, Library], jobs: int, label: str, quiet: bool, reuse: bool
) -> tuple[dict[str, list[matching.Part]], Outcome]:
    """The recordings of matching databases, each in a task of its own, and what failed, by library."""
    tasks, users = {}, {}
    for name, library in libraries.items():
        config = library.config
        if (
            config.method == "motion_matching"
            and len(library.names) > 1
            and not (reuse and build_database.is_current(library))
        ):
            for recording, limit in zip(library.names, limits(config, library.names), strict=True):
                title = f"{name}, {recording}"
                tasks[title], users[title] = partial(_matching_part, config, recording, limit), [name]
    outcome = for_each(tasks, jobs, f"{label}: features", quiet) if tasks else Outcome()
    broken = build_database.failures(outcome, users)
    parts: dict[str, list[matching.Part]] = {}
    for title in tasks:  # in the order of the recordings
        (name,) = users[title]
        if name not in broken.errors and name not in broken.bugs:
            parts.setdefault(name, []).append(outcome.done[title])
    return parts, broken


def _matching_part(config: Config, recording: str, limit: int | None) -> matching.Part:
    return matching.describe_part(load_reference(config, recording, limit), config)


def _build(library: Library, reuse: bool, parts: Sequence[matching.Part] | None) -> dict:
    config, method = library.config, METHODS[library.config.method]
    clip_digests = digests(config, library.names)
    lost = []
    if reuse:
        try:
            stored = method.load(library.path, config, clip_digests)
            build_database.forget_blocks(library.path)  # a build may have been killed before it did
            return _describe(stored, config)
        except DamagedError as error:
            lost = [sealing.remade(error)]
        except DataError:
            pass
    if config.method == "gesture_master":
        found = build_database.assemble(config, library.names, library.path)
    elif parts is not None:
        found = matching.assemble(parts, config)
    else:
        found = method.build(load_references(config, library.names), config)
    method.save(library.path, found, config, clip_digests)
    if config.method == "gesture_master":
        build_database.forget_blocks(library.path)
    told = _describe(found, config)
    return told | {"notes": [*lost, *told["notes"]]}


def _describe(found: ReferenceFrames, config: Config) -> dict:
    if isinstance(found, GestureDatabase):
        return build_database.describe(found, config)
    if not isinstance(found, MotionGraph):
        sequences = f", {len(found.sequence_starts)} sequences" if isinstance(found, matching.MatchingDatabase) else ""
        return {"lines": [f"{found.n_nodes} nodes{sequences}"], "notes": []}
    kinds = ", ".join(f"{int(np.sum(found.key_nodes.kinds == kind))} {kind}" for kind in ("onset", "keyword", "break"))
    line = (
        f"{found.n_nodes} nodes, {int(np.sum(found.natural))} natural and {int(np.sum(~found.natural))} unnatural edges, "
        f"key nodes: {kinds}"
    )
    return {"lines": [line, *_beat_lag(found, config)], "notes": []}


def _beat_lag(graph: MotionGraph, config: Config) -> list[str]:
    """A line on how long after the onsets of a reference its hands stop, if both are known."""
    measured = rewards.measure_beat_lag(graph, config)
    if measured is None:
        return []
    lag, sure = measured
    if sure < SURE:
        return [f"beats of the hands follow the onsets by no lag that stands out (z {sure:.1f})"]
    return [
        f"beats of the hands follow the onsets by {lag:+.2f} s (z {sure:.1f}); used is global_search.beat_lag_seconds "
        f"= {config.global_search.beat_lag_seconds:g}"
    ]

"""The command `run`: all stages in order, doing only what is not yet done or has changed."""

from __future__ import annotations

from collections.abc import Callable

from gesturegen.data import recordings
from gesturegen.errors import GesturegenError
from gesturegen.outcome import Outcome
from gesturegen.parallel import one_display
from gesturegen.pipeline.build_graph import build_graphs
from gesturegen.pipeline.common import Summary
from gesturegen.pipeline.evaluate import evaluate
from gesturegen.pipeline.preprocess import preprocess
from gesturegen.pipeline.reenact import reenact
from gesturegen.pipeline.submit import pack
from gesturegen.settings.models import Config


def run(config: Config, jobs: int, quiet: bool, force: bool = False) -> Summary:
    """Preprocess, build, reenact, evaluate and pack, under one progress display.

    Every stored clip, graph and trace knows what it was made from, so that an interrupted run goes on where
    it stopped and a changed setting or recording redoes just what depends on it; `force` redoes everything.
    A clip that fails in one stage is listed once, and the other clips go on.
    """
    reuse = not force
    stages: list[tuple[str, Callable[[], Summary]]] = [
        ("preprocess", lambda: preprocess(config, jobs, quiet, reuse=reuse)),
        ("build-graph", lambda: build_graphs(config, jobs, quiet, reuse=reuse)),
        ("reenact", lambda: reenact(config, jobs, quiet, reuse=reuse)),
        ("evaluate", lambda: evaluate(config, jobs, quiet, reuse=reuse)),
        ("pack", lambda: pack(config, jobs, quiet)),
    ]
    total = Summary(Outcome())
    with one_display(len(stages), _expected_tasks(config), quiet):
        for name, stage in stages:
            try:
                summary = stage()
            except GesturegenError as error:
                raise type(error)(f"{name}: {error}") from None
            _add(total, name, summary)
    return total


def _expected_tasks(config: Config) -> int:
    """Estimate the number of tasks of all stages: clips, graphs (at most one per test) and the later work on tests."""
    references, tests = len(recordings.reference_recordings(config)), len(recordings.test_recordings(config))
    return references + min(references, tests) + 4 * tests


def _add(total: Summary, stage: str, summary: Summary) -> None:
    outcome, sums = summary.outcome, total.outcome
    failed_before = {key.split(": ", 1)[1] for key in sums.errors}
    sums.errors |= {f"{stage}: {clip}": error for clip, error in outcome.errors.items() if clip not in failed_before}
    sums.bugs |= {f"{stage}: {clip}": trace for clip, trace in outcome.bugs.items()}
    sums.done |= {f"{stage}: {clip}": value for clip, value in outcome.done.items()}
    known = set(total.warnings)
    total.warnings += [warning for warning in summary.warnings if warning not in known]
    total.lines += [f"== {stage}: {len(outcome.done)} done, {outcome.failed} failed", *summary.lines]
    total.written += summary.written

"""The commands `ablate` and `compare`: gesture the same clips in several setups and seeds, for one table."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from gesturegen import __version__, evaluation, files, submission, viewer
from gesturegen.data import clips
from gesturegen.data.index import Index
from gesturegen.data.stored_clips import digests
from gesturegen.errors import DataError
from gesturegen.experiment import causes, figures, plot, reference_length, tables
from gesturegen.experiment.plan import Plan, seeded
from gesturegen.experiment.presets import ABLATE, COMPARE, MEMORY, Preset
from gesturegen.extras import need
from gesturegen.frames import ReferenceFrames
from gesturegen.methods import METHODS, libraries
from gesturegen.methods.method import Job
from gesturegen.metrics.measures import Measure, frechet_measures
from gesturegen.motion.skeleton import Motion
from gesturegen.outcome import Outcome
from gesturegen.parallel import for_each, one_display
from gesturegen.pipeline.build_graph import build_libraries
from gesturegen.pipeline.common import Summary, chosen_references, read_index, require_writable, share
from gesturegen.pipeline.evaluate import (
    add_detectability,
    locate_file,
    measure_beside,
    read_heard,
    recordings,
    reference_skate,
    require_same_joints,
)
from gesturegen.pipeline.experiment_page import write_page
from gesturegen.pipeline.gesturing import Gestured, gesture, read_speech
from gesturegen.pipeline.memory import require_memory_for
from gesturegen.pipeline.search_memory import measure_search
from gesturegen.randomness import generator
from gesturegen.settings.models import Config
from gesturegen.stored import documents
from gesturegen.workspace import clip_path, library_name, work_path

# The setup whose library serves, by setup and group of references.
_Owners = Mapping[tuple[str, tuple[str, ...]], str]
_NOT_OF_STUCK = ("objective", "search_seconds", *causes.KEYS)


@dataclass(frozen=True)
class _Run:
    """One setup at one seed.

    references : of each test clip; libraries : of each group of references, perhaps another setup's
    kept : where BVH and traces go, None for nowhere
    """

    setup: str
    config: Config
    references: Mapping[str, tuple[str, ...]]
    libraries: Mapping[tuple[str, ...], Path]
    kept: Path | None


@dataclass(frozen=True)
class _Ruler:
    """The settings that all setups are measured by, whatever theirs are; keys : of the columns; n_clips : of a run."""

    config: Config
    keys: frozenset[str]
    n_clips: int

    @property
    def pools(self) -> bool:
        return bool(self.keys & figures.POOLED)


def ablate(plan: Plan, jobs: int, quiet: bool, keep: bool = False) -> Summary:
    """Gesture and measure every test clip in every setup with every seed; write the table and the plot.

    keep : also leave libraries, BVH files and traces in `WORK/ablation/<setup>/`; otherwise motion stays in memory
    """
    return experiment(plan, ABLATE, jobs, quiet, keep)


def compare(plan: Plan, jobs: int, quiet: bool, out: Path | None = None) -> Summary:
    """Gesture and measure every test clip in every setup with every seed; write the table and the page.

    out : the page, by default WORK/compare/report.html. WORK/compare/<setup> becomes a work folder with the first
    seed's motions.
    """
    return experiment(plan, COMPARE, jobs, quiet, out=out)


def experiment(
    plan: Plan, preset: Preset, jobs: int, quiet: bool, keep: bool = False, out: Path | None = None
) -> Summary:
    """Gesture and measure every test clip in every setup with every seed; write what the preset asks for.

    keep : also leave libraries, BVH files and traces, where the preset makes no work folders; out : the page
    """
    index = read_index(plan.base)
    chosen = {
        (setup, seed): chosen_references(seeded(config, seed), index)
        for setup, config in plan.setups.items()
        for seed in plan.seeds
    }
    owners = shared_libraries(plan, chosen)
    wanted = [(plan.setups[setup], tests) for (setup, _), tests in chosen.items()]
    jobs, warnings = require_memory_for(wanted, index, jobs)
    folder, page = work_path(plan.base, preset.folder), out
    require_writable(folder)
    if preset.page and page is None:
        page = folder / "report.html"
    if page is not None:
        require_writable(page.parent)
    _remove_earlier(plan, preset, folder, page)
    kept = keep or preset.work_folders
    runs = [
        _Run(
            setup, seeded(plan.setups[setup], seed), tests,
            {names: _library_path(plan, preset, owners[setup, names], names) for names in tests.values()},
            _kept_in(folder / setup, seed, plan, preset) if kept else None,
        )
        for (setup, seed), tests in chosen.items()
    ]  # fmt: skip
    n_tasks = len(set(owners.values())) + len(index.tests) * (len(runs) + preset.page)
    try:
        with one_display(1, n_tasks, quiet):
            made = _build_libraries(plan, preset, owners, jobs, quiet, kept)
            if not made.outcome.failed:
                made = _run_all(plan, preset, runs, index, jobs, quiet, page)
    finally:
        if not kept:
            for name in plan.setups:
                shutil.rmtree(folder / name, ignore_errors=True)
    if kept and made.written:
        made.written += [folder / setup for setup in plan.setups]
    made.warnings += warnings
    made.warnings += [
        (name, f"in no setup, because it failed in preprocess: {error}") for name, error in index.failed.items()
    ]
    return made


def _kept_in(folder: Path, seed: int, plan: Plan, preset: Preset) -> Path | None:
    if not preset.work_folders:
        return folder / str(seed)
    return folder / "reenact" if seed == plan.seeds[0] else None


def _remove_earlier(plan: Plan, preset: Preset, folder: Path, page: Path | None) -> None:
    """Remove the results of an earlier run, which must not pass for this one's, should this one fail."""
    names = [
        *(f"{preset.folder}.{kind}" for kind in ("md", "csv", "json", "png")),
        "reference_length.json",
        "report.html",
    ]
    for path in [*(folder / name for name in names), *([page] if page else [])]:
        path.unlink(missing_ok=True)
    for name in plan.setups:
        shutil.rmtree(folder / name, ignore_errors=True)


# --- libraries ----------------------------------------------------------------------------------------------


def shared_libraries(plan: Plan, chosen: Mapping[tuple[str, int], Mapping[str, tuple[str, ...]]]) -> _Owners:
    """Find for each setup and group of references the setup whose library serves: none depends on the seed."""
    owners: dict[tuple, str] = {}
    found = {}
    for (setup, _), tests in chosen.items():
        config = plan.setups[setup]
        for names in tests.values():
            made_of = config.method, config.section_json(*METHODS[config.method].settings), names
            found[setup, names] = owners.setdefault(made_of, setup)
    return found


def _library_path(plan: Plan, preset: Preset, setup: str, names: Sequence[str]) -> Path:
    config = plan.setups[setup]
    return work_path(config, preset.folder, setup, "graphs", f"{library_name(config, names)}.npz")


def _build_libraries(plan: Plan, preset: Preset, owners: _Owners, jobs: int, quiet: bool, copied: bool) -> Summary:
    """Build each library once; copied : every setup that it serves is given a copy."""
    wanted = {}
    for names, owner in dict.fromkeys((names, owner) for (_, names), owner in owners.items()):
        path = _library_path(plan, preset, owner, names)
        wanted[f"{owner}, {path.stem}"] = Job(plan.setups[owner], names, path)
    summary = Summary(build_libraries(wanted, jobs, f"{preset.command}: graphs", quiet))
    if copied and not summary.outcome.failed:
        for (setup, names), owner in owners.items():
            if setup != owner:
                target = _library_path(plan, preset, setup, names)
                files.copy(_library_path(plan, preset, owner, names), target)
    return summary


# --- all runs -----------------------------------------------------------------------------------------------


def _run_all(
    plan: Plan, preset: Preset, runs: Sequence[_Run], index: Index, jobs: int, quiet: bool, page: Path | None
) -> Summary:
    columns = preset.columns(plan.base)
    ruler = _make_ruler(plan.base, columns, len(index.tests))
    by_seed: dict[str, dict[int, dict[str, float]]] = {setup: {} for setup in plan.setups}
    rows: list[dict] = []
    beside: dict[str, dict[str, float]] = {}
    made = Summary(Outcome())
    # Motions that are pooled are held until their run is summed up; those of all runs would not fit into memory.
    for batch in [[run] for run in runs] if ruler.pools else [runs]:
        tasks = _tasks(batch, ruler, index, with_beside=not beside)
        made = Summary(for_each(tasks, jobs, preset.command, quiet))
        if made.outcome.failed:
            # Rows over different clips would compare nothing.
            made.lines = ["no table was written, because the setups would not be measured on the same clips"]
            return made
        for run in batch:
            done = [made.outcome.done[_title(run, test)] for test in run.references]
            beside = beside or viewer.beside_totals([one["beside"] for one in done if one["beside"] is not None])
            by_seed[run.setup][run.config.seed] = _sum_up(run, done, columns, ruler, index)
            rows += [figures.shown(one["row"], columns) for one in done]
            if preset.work_folders and run.kept is not None:
                made_rows = [one["manifest_row"] for one in done]
                documents.write(run.kept / "manifest.json", submission.manifest(made_rows, run.config))
                share(run.config, run.kept.parent, "clips")
    if ruler.keys & set(MEMORY):
        first = [run for run in runs if run.config.seed == plan.seeds[0]]
        measured = _measure_memory(first, preset, index, jobs, quiet)
        if measured.outcome.failed:
            return measured
        for run in first:
            by_seed[run.setup][run.config.seed] |= measured.outcome.done[run.setup]
    setups = {setup: figures.over_seeds(own, columns) for setup, own in by_seed.items()}
    signature = plan.signature | {"version": __version__}
    result = figures.Result(preset, columns, setups, ruler.n_clips, signature, rows, beside)
    if page is not None:
        folders = {setup: work_path(plan.base, preset.folder, setup) for setup in plan.setups}
        made = write_page(page, result, plan, folders, index, jobs, quiet)
    made.lines = [tables.format_terminal(result), *made.lines]
    _write(result, plan, made)
    if page is not None:
        made.written.append(page)
    return made


def _make_ruler(base: Config, columns: Sequence[Measure], n_clips: int) -> _Ruler:
    """Take the base config, without the Fréchet distances of windows, slow as a search, unless they are shown."""
    keys = frozenset(column.key for column in columns)
    if not keys & {measure.key for measure in frechet_measures(base.evaluation.frechet_windows)}:
        base = base.model_copy(update={"evaluation": base.evaluation.model_copy(update={"frechet_windows": ()})})
    return _Ruler(base, keys, n_clips)


def _title(run: _Run, test: str) -> str:
    # The clip comes first, and tasks run by name: its truth is then read once for all setups.
    return f"{test}, seed {run.config.seed}, {run.setup}"


def _tasks(batch: Sequence[_Run], ruler: _Ruler, index: Index, with_beside: bool) -> dict[str, Callable[[], dict]]:
    """Name the tasks of a batch of runs, one for each run and test clip.

    with_beside : whether to measure what stands beside, which is the same for all runs
    """
    return {
        _title(run, test): partial(
            _run_clip, run, test, ruler, index.tests[test].truth, with_beside and run is batch[0]
        )
        for run in batch
        for test in run.references
    }


def _sum_up(
    run: _Run, done: Sequence[dict], columns: Sequence[Measure], ruler: _Ruler, index: Index
) -> dict[str, float]:  # fmt: skip
    """Compute the figures of a run, and add to its rows those that all clips are needed for."""
    rows = [one["row"] for one in done]
    pairs = [(one["generated"], one["truth"]) for one in done if one["truth"] is not None]
    seconds = figures.durations(index.durations, run.config.references.seconds, run.references)
    with threadpool_limits(limits=1):  # as in the workers, so that the figures depend on no number of threads
        total = figures.run_figures(rows, pairs, columns, ruler.config, seconds, index.training_seconds)
        add_detectability({row["clip"]: row for row in rows}, total, ruler.config)
    return total


def _measure_memory(runs: Sequence[_Run], preset: Preset, index: Index, jobs: int, quiet: bool) -> Summary:
    """Measure for each setup how much memory the search of the longest clip takes."""
    longest = max(sorted(index.tests), key=lambda name: index.tests[name].seconds)
    named = {
        run.setup: partial(measure_search, run.libraries[run.references[longest]], longest, run.config) for run in runs
    }
    # In a process of its own, which no earlier work has made larger.
    return Summary(for_each(named, jobs, f"{preset.command}: memory", quiet, fresh=True))


def _write(result: figures.Result, plan: Plan, made: Summary) -> None:
    preset = result.preset
    folder = work_path(plan.base, preset.folder)
    written = {kind: folder / f"{preset.folder}.{kind}" for kind in ("md", "csv", "json")}
    files.write_text(written["md"], tables.format_markdown(result))
    files.write_text(written["csv"], tables.format_csv(result))
    documents.write(written["json"], tables.json_table(result))
    made.written = [*written.values()]
    if preset.lengths and len({config.references.seconds for config in plan.setups.values()}) > 1:
        made.written.append(folder / "reference_length.json")
        documents.write(made.written[-1], reference_length.table(plan.setups, result))
    if preset.plot:
        picture = folder / f"{preset.folder}.png"
        try:
            need("matplotlib.figure", "video")
        except DataError as error:
            made.warnings.append((picture.name, f"not drawn: {error}"))
            return
        files.write_bytes(picture, partial(plot.draw, result))
        made.written.append(picture)


# --- one clip, in a worker ----------------------------------------------------------------------------------


def _run_clip(run: _Run, test: str, ruler: _Ruler, truth_path: str | None, with_beside: bool) -> dict:
    """Gesture and measure a clip: its row, and evidence for the totals (motion, truth, what stands beside)."""
    made = _gesture(run, test, ruler.config)
    written = {}
    if run.kept is not None:
        written = submission.write_clip(run.kept, test, made.motion, made.trace)
    measured = evaluation.failed_row(ruler.config) | dict.fromkeys(_NOT_OF_STUCK, evaluation.NAN)
    found: dict[str, Any] = {"generated": None, "truth": None, "beside": None, "seams": None}
    if made.motion is not None:
        measured, found = _measure(made, made.motion, test, ruler, truth_path, with_beside)
    about = {"setup": run.setup, "seed": run.config.seed, "clip": test, "references": list(run.references[test])}
    row = about | {"seams": found.pop("seams")} | figures.clip_row(made.trace, made.frames, measured)
    return found | {"row": row, "manifest_row": submission.clip_row(made.trace, written)}


def _gesture(run: _Run, test: str, base: Config) -> Gestured:
    names, config = run.references[test], run.config
    # Loaded anew for every clip, so that the measured time holds all that a search prepares of its library.
    library = libraries.load(run.libraries[names], METHODS[config.method], config)
    # The base's serve all setups: rendering takes their motion alone, and the onsets are in the library.
    sections = ("references", "method", *METHODS[config.method].sections)
    shared = base.model_copy(update={section: getattr(config, section) for section in sections})
    references = _references(shared.model_dump_json(by_alias=True), names, digests(base, names))
    speech = read_speech(test, config)
    _warm_up(library, speech, config)
    return gesture(test, names, library, references, speech, config)


@lru_cache(maxsize=1)
def _references(config_json: str, names: tuple[str, ...], _digests: tuple[str, ...]) -> Sequence[clips.Reference]:
    """Load references; a worker keeps the last ones, since the setups follow one another on the same references."""
    config = Config.model_validate_json(config_json)
    return METHODS[config.method].shown_clips(config, names)


_warm: set[tuple] = set()


def _warm_up(library: ReferenceFrames, speech: clips.Speech, config: Config) -> None:
    """Search two seconds of a speech untimed, once per worker: the first call of a loop compiles it."""
    kind = config.method, config.search_name, config.initialization
    if kind not in _warm:
        short = replace(speech, n_frames=min(speech.n_frames, round(2 * speech.fps)))
        METHODS[config.method].search(replace(library), short, config, generator(config.seed, "warm-up"))
        _warm.add(kind)


def _measure(
    made: Gestured, motion: Motion, test: str, ruler: _Ruler, truth_path: str | None, with_beside: bool
) -> tuple[dict[str, float], dict[str, Any]]:
    """Measure a clip that has a motion: its figures, and evidence for the totals."""
    config, trace, graph = ruler.config, made.trace, made.frames
    generated = evaluation.locate(motion, config)
    truth = None
    if truth_path is not None:
        truth = _truth(truth_path, files.sha256(truth_path), config.model_dump_json(by_alias=True))
        require_same_joints(truth_path, truth, generated)
    heard = read_heard(clip_path(config, test), config)
    skate = reference_skate(config, trace.shown_clips())
    recorded = recordings(config, trace)
    row = evaluation.measure_clip(generated, config, heard, truth, trace, graph, skate, recorded)
    row["search_seconds"] = round(made.seconds, 4)
    if ruler.keys & set(causes.KEYS):
        row |= causes.measure(generated, truth, trace, graph, heard.onset_times, config)
    if "objective" in ruler.keys:
        # By the base's prices and pauses whatever the setup searches by.
        method = METHODS[trace.method]
        row["objective"] = method.objective(graph, made.speech, trace.shown_nodes(), config)
    found: dict[str, Any] = {"generated": None, "truth": None, "beside": None}
    found["seams"] = evaluation.seam_evidence(generated, trace, graph, recorded, ruler.n_clips)
    if with_beside:
        found["beside"] = measure_beside(test, len(generated.world), config, heard, truth, recorded)
    if ruler.pools and truth is not None:  # the curves have served
        found |= {"generated": replace(generated, curves=None), "truth": replace(truth, curves=None)}
    return row, found


@lru_cache(maxsize=1)
def _truth(path: str, _digest: str, config_json: str) -> evaluation.Joints:
    return locate_file(Path(path), Config.model_validate_json(config_json))

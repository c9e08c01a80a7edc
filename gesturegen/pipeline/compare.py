"""`compare`: every method and the baselines over the same clips, in one table and on one page side by side."""

from __future__ import annotations

import csv
import io
import math
import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from gesturegen import __version__, evaluation, files, remembered, submission, viewer
from gesturegen import frames as reference_frames
from gesturegen.ablation.plan import Plan, seeded
from gesturegen.ablation.summary import Setup
from gesturegen.ablation.tables import aligned_blocks, beside_cells, format_spread, markdown_blocks
from gesturegen.data import clips
from gesturegen.data.index import Index, IndexedTest
from gesturegen.errors import DataError, GesturegenError
from gesturegen.manifest import ClipRow, Manifest
from gesturegen.methods import METHODS, libraries
from gesturegen.metrics.measures import Measure
from gesturegen.metrics.usage import training_utilisation
from gesturegen.motion import cleanup, space
from gesturegen.parallel import for_each, one_display
from gesturegen.pipeline.ablate import build_shared_graphs, draw_references, durations, gesture, measure, shared_graphs
from gesturegen.pipeline.common import Summary, read_index, read_manifest, require_writable
from gesturegen.pipeline.evaluate import add_detectability
from gesturegen.pipeline.memory import require_memory_for
from gesturegen.randomness import generator
from gesturegen.report import pack, page
from gesturegen.settings.models import Config
from gesturegen.speech import audio
from gesturegen.stored import documents
from gesturegen.tables import exact, format_figure, json_figures
from gesturegen.workspace import clip_path, library_name, work_path

FOLDER = "compare"
MACHINE_BLOCK = "time and memory, of this machine"
# No second run repeats these.
MACHINE_MEASURES = (
    Measure("search_seconds", "search s per clip", MACHINE_BLOCK),
    Measure("search_memory", "library and search MB", MACHINE_BLOCK),
    Measure("peak_memory", "whole process MB", MACHINE_BLOCK),
)
NOTE = (
    "Totals over the clips, as of `evaluate` with the base config; mean ± standard deviation over seeds. Search time is "
    "that of one clip, without loading and compiling. Memory is the peak of resident memory of a fresh process that "
    "loads a library and searches for the longest clip, at the first seed: the whole process, and what that added to "
    "a process with everything imported, compiled loops included; pages of a mapped library count once looked at."
)


@dataclass(frozen=True, eq=False)
class _Comparison:
    """A whole comparison: the table's rows by setup, and a row of figures for each setup, seed and clip."""

    columns: list[Measure]
    setups: dict[str, Setup]
    clips: list[dict]
    n_clips: int
    signature: dict
    beside: dict


@dataclass(frozen=True)
class _Task:
    """One setup at one seed.

    references : of each test clip; owners : whose graph serves, by references; kept : where BVH and traces go, None
    for nowhere
    """

    setup: str
    config: Config
    references: Mapping[str, tuple[str, ...]]
    owners: Mapping[tuple[str, ...], str]
    kept: Path | None


def compare(plan: Plan, jobs: int, quiet: bool, out: Path | None = None) -> Summary:
    """Gesture and measure every test clip in every setup with every seed; write the table and the page.

    out : the page, by default WORK/compare/report.html. WORK/compare/<setup> becomes a work folder with the first
    seed's motions.
    """
    index = read_index(plan.base)
    chosen = draw_references(plan, index)
    groups = shared_graphs(plan, chosen)
    runs = [(plan.setups[setup], tests) for (setup, _), tests in chosen.items()]
    jobs, warnings = require_memory_for(runs, index, jobs)
    folder = work_path(plan.base, FOLDER)
    require_writable(folder)
    written = [folder / f"compare.{kind}" for kind in ("md", "csv", "json")]
    written.append(folder / "report.html" if out is None else out)
    require_writable(written[-1].parent)
    for path in written:  # of an earlier run, should this one fail
        path.unlink(missing_ok=True)
    for name in plan.setups:
        shutil.rmtree(folder / name, ignore_errors=True)
    tasks = []
    for (setup, seed), references in chosen.items():
        owners = {names: groups[setup, names] for names in references.values()}
        kept = folder / setup / "reenact" if seed == plan.seeds[0] else None
        tasks.append(_Task(setup, seeded(plan.setups[setup], seed), references, owners, kept))
    n_tests = len(index.tests)
    with one_display(4, len(set(groups.values())) + n_tests * (len(tasks) + 1) + len(plan.setups), quiet):
        made = build_shared_graphs(plan, groups, jobs, quiet, True, "compare", FOLDER)
        if not made.outcome.failed:
            made = _compare(plan, tasks, index, jobs, quiet, written)
    made.warnings += warnings
    made.warnings += [
        (name, f"in no setup, because it failed in preprocess: {error}") for name, error in index.failed.items()
    ]
    return made


def _compare(plan: Plan, tasks: Sequence[_Task], index: Index, jobs: int, quiet: bool, written: list[Path]) -> Summary:
    runs: dict[str, dict[int, dict[str, float]]] = {setup: {} for setup in plan.setups}
    rows: list[dict] = []
    beside: dict[str, dict] = {}
    for task in tasks:
        made, total, found = _run(task, plan.base, index, jobs, quiet)
        beside = beside or found
        if made.outcome.failed:
            # Rows over different clips would compare nothing.
            made.lines = ["no table was written, because the setups would not be measured on the same clips"]
            return made
        runs[task.setup][task.config.seed] = total
        rows += made.outcome.done.values()
    first = [task for task in tasks if task.kept is not None]
    measured = _measure_memory(first, index, jobs, quiet)
    if measured.outcome.failed:
        return measured
    for task in first:
        runs[task.setup][task.config.seed] |= measured.outcome.done[task.setup]
    columns = [*evaluation.measures(plan.base), *MACHINE_MEASURES]
    setups = {setup: _over_seeds(by_seed, columns) for setup, by_seed in runs.items()}
    signature = plan.signature | {"version": __version__}
    result = _Comparison(columns, setups, rows, len(index.tests), signature, beside)
    files.write_text(written[0], _format_markdown(result))
    files.write_text(written[1], _format_csv(result))
    documents.write(written[2], _json_table(result))
    shown = _write_page(written[3], result, plan, first, index, jobs, quiet)
    shown.lines = [_format_terminal(result), *shown.lines]
    shown.written = [*written, *(task.kept.parent for task in first)]
    return shown


# --- one setup at one seed ----------------------------------------------------------------------------------


def _run(
    task: _Task, base: Config, index: Index, jobs: int, quiet: bool
) -> tuple[Summary, dict[str, float], dict[str, dict]]:
    """Its rows by clip, its figures in total as `evaluate` forms them, and what stands beside them."""
    named = {
        f"{test}, seed {task.config.seed}, {task.setup}": partial(
            _run_clip, task, test, base, index.tests[test].truth, len(task.references)
        )
        for test in task.references
    }
    outcome = for_each(named, jobs, "compare", quiet)
    made = Summary(outcome)
    if outcome.failed:
        return made, {}, {}
    done = list(outcome.done.values())
    outcome.done = {name: one["row"] for name, one in outcome.done.items()}
    rows = list(outcome.done.values())
    pairs = [(one["generated"], one["truth"]) for one in done if one["truth"] is not None]
    with threadpool_limits(limits=1):  # as in the workers, so that the figures depend on no number of threads
        total = evaluation.totals(rows, [pair[0] for pair in pairs], [pair[1] for pair in pairs], base)
        add_detectability({row["clip"]: row for row in rows}, total, base)
    seconds = durations(task.config, task.references, index)
    rest = max(index.training_seconds - sum(seconds.values()), 0.0)
    moving = [row for row in rows if not row["failure"]]
    used = training_utilisation([task.references[row["clip"]] for row in moving], {**seconds, "": rest})
    for row, share in zip(moving, used.per_clip, strict=True):
        row["utilisation"] = float(share)
    total["utilisation"] = used.overall
    total["search_seconds"] = float(np.mean([row["search_seconds"] for row in rows]))
    if task.kept is not None:
        _complete_folder(task, [one["manifest_row"] for one in done])
    return made, total, viewer.beside_totals([one["beside"] for one in done if one["beside"] is not None])


def _run_clip(task: _Task, test: str, base: Config, truth_path: str | None, n_clips: int) -> dict:
    names = task.references[test]
    made = gesture(task.owners[names], test, names, task.config, base, FOLDER)
    written = {}
    if task.kept is not None:
        written = submission.write_clip(task.kept, test, made.motion, made.trace)
    row, found = evaluation.failed_row(base), None
    if made.motion is not None:
        found = measure(made, test, base, truth_path, n_clips)
        row = found.row
    about = {"setup": task.setup, "seed": task.config.seed, "clip": test, "references": list(names)}
    return {
        "row": about | row | {"search_seconds": round(made.seconds, 4), "seams": found and found.seams},
        "generated": found and replace(found.generated, curves=None),
        "truth": found and found.truth and replace(found.truth, curves=None),
        "beside": found and found.beside(),
        "manifest_row": submission.clip_row(made.trace, written),
    }


def _complete_folder(task: _Task, rows: Sequence[ClipRow]) -> None:
    """Make the folder of a setup a work folder, so that every command works on it: it shares the clips."""
    folder = task.kept.parent
    documents.write(task.kept / "manifest.json", submission.manifest(rows, task.config))
    remembered.write(task.config, folder)
    target = os.path.relpath(work_path(task.config, "clips").resolve(), folder.resolve())
    try:
        (folder / "clips").symlink_to(target, target_is_directory=True)
    except OSError as error:
        raise DataError(
            f"{folder / 'clips'}: cannot be a link to {target} ({error.strerror}); choose a folder that can hold "
            "links, with --work"
        ) from None


def _over_seeds(by_seed: Mapping[int, Mapping[str, float]], columns: Sequence[Measure]) -> Setup:
    """Mean and spread of a setup's runs; NaN where no run has the figure, no spread of fewer than two."""
    mean, spread = {}, {}
    for column in columns:
        values = np.array([run.get(column.key, math.nan) for run in by_seed.values()])
        values = values[np.isfinite(values)]
        mean[column.key] = float(values.mean()) if len(values) else math.nan
        spread[column.key] = math.nan
        if len(values) > 1:  # equal figures differ from their mean by its rounding
            spread[column.key] = float(values.std(ddof=1)) if np.ptp(values) > 0 else 0.0
    runs = {
        seed: {column.key: run.get(column.key, math.nan) for column in columns} for seed, run in by_seed.items()
    }  # fmt: skip
    return Setup(runs, mean, spread)


# --- memory -------------------------------------------------------------------------------------------------


def _measure_memory(tasks: Sequence[_Task], index: Index, jobs: int, quiet: bool) -> Summary:
    """For each setup what memory the search of the longest clip takes."""
    longest = max(sorted(index.tests), key=lambda name: index.tests[name].seconds)
    named = {}
    for task in tasks:
        names = task.references[longest]
        graph = work_path(task.config, FOLDER, task.setup, "graphs", f"{library_name(task.config, names)}.npz")
        named[task.setup] = partial(_search_memory, graph, longest, task.config)
    # In a process of its own, which no earlier work has made larger.
    return Summary(for_each(named, jobs, "compare: memory", quiet, fresh=True))


def _search_memory(graph: Path, test: str, config: Config) -> dict[str, float]:
    with threadpool_limits(limits=1):
        before = _peak_megabytes()
        library = libraries.load(graph, METHODS[config.method], config)
        speech = clips.load(clip_path(config, test), config, with_motion=False).test_speech(config)
        METHODS[config.method].search(library, speech, config, generator(config.seed, test))
        peak = _peak_megabytes()
    return {"search_memory": round(peak - before, 1), "peak_memory": round(peak, 1)}


def _peak_megabytes() -> float:
    """Most resident memory that this process has had, in MB; NaN where that cannot be asked."""
    try:
        # Unlike `ru_maxrss`, which on Linux starts from that of the process that started this one.
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
        import resource

        unit = 1 if sys.platform == "darwin" else 1024
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
    except (OSError, ImportError):
        return math.nan


# --- the table ----------------------------------------------------------------------------------------------


def _cells(result: _Comparison, block: str) -> list[list[str]]:
    """Heading and rows of one block."""
    columns = [column for column in result.columns if column.block == block]
    rows = [["setup", *(column.heading for column in columns)]]
    for name, setup in result.setups.items():
        cells = [format_spread(setup.mean[column.key], setup.spread[column.key]) for column in columns]
        of = [f" of {result.n_clips}" if column.key == "failure" else "" for column in columns]
        rows.append([name, *(cell + end for cell, end in zip(cells, of, strict=True))])
    return rows + beside_cells(result.beside, columns)


def _blocks(result: _Comparison) -> list[str]:
    return list(dict.fromkeys(column.block for column in result.columns))


def _format_terminal(result: _Comparison) -> str:
    blocks = {block: _cells(result, block) for block in _blocks(result)}
    return "\n\n".join([*aligned_blocks(blocks), NOTE, _signature_line(result)])


def _format_markdown(result: _Comparison) -> str:
    blocks = {block: _cells(result, block) for block in _blocks(result)}
    parts = ["# Comparison of methods", *markdown_blocks(blocks), NOTE, f"`{_signature_line(result)}`"]
    return "\n\n".join(parts) + "\n"


def _format_csv(result: _Comparison) -> str:
    """Per setup a row for each seed, `mean` and `spread`; each ends in what produced it."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    keys = [column.key for column in result.columns]
    writer.writerow(["setup", "seed", *keys, "clips", "config_hash", "seeds", "version"])
    seeds = " ".join(map(str, result.signature["seeds"]))
    for name, setup in result.setups.items():
        source = [result.n_clips, result.signature["config_hashes"][name], seeds, result.signature["version"]]
        runs = {**{str(seed): run for seed, run in setup.by_seed.items()}, "mean": setup.mean, "spread": setup.spread}
        for label, figures in runs.items():
            writer.writerow([name, label, *(exact(figures[key]) for key in keys), *source])
    for name, row in result.beside.items():
        cells = [exact(row.get(key)) for key in keys]
        writer.writerow([name, "", *cells, result.n_clips, "", seeds.split()[0], result.signature["version"]])
    return text.getvalue()


def _json_table(result: _Comparison) -> dict:
    """Everything, down to the single clips; None where there is no figure."""
    return {
        "signature": result.signature,
        "n_clips": result.n_clips,
        "columns": [{"key": column.key, "heading": column.heading, "block": column.block} for column in result.columns],
        "setups": {
            name: {
                "mean": json_figures(setup.mean),
                "spread": json_figures(setup.spread),
                "seeds": {str(seed): json_figures(run) for seed, run in setup.by_seed.items()},
            }
            for name, setup in result.setups.items()
        },
        "beside": {name: json_figures(row) for name, row in result.beside.items()},
        "clips": [
            {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in row.items()}
            for row in result.clips
        ],
    }


def _signature_line(result: _Comparison) -> str:
    hashes = "  ".join(f"{name} {digest}" for name, digest in result.signature["config_hashes"].items())
    seeds = ", ".join(map(str, result.signature["seeds"]))
    return f"config hashes: {hashes}  seeds: {seeds}  version: {result.signature['version']}"


# --- the page -----------------------------------------------------------------------------------------------


def _write_page(
    path: Path, result: _Comparison, plan: Plan, tasks: Sequence[_Task], index: Index, jobs: int, quiet: bool
) -> Summary:
    """Every clip with the motions of all setups at the first seed, and this seed's row of each setup."""
    folders = {task.setup: task.kept.parent for task in tasks}
    packed = {name: partial(_pack_clip, name, row, plan.base, folders) for name, row in index.tests.items()}
    outcome = for_each(packed, jobs, "compare: page", quiet)
    done = outcome.done
    failed = outcome.errors | dict.fromkeys(outcome.bugs, "a bug of gesturegen")
    seed = plan.seeds[0]
    manifest = Manifest(
        gesturegen=__version__,
        method="compare",
        search=f"{len(folders)} setups",
        seed=seed,
        config_hash=seeded(plan.base, seed).signature(),
        config={"fps": plan.base.fps},
        clips=[_total_row(setup, read_manifest(folder)) for setup, folder in folders.items()],
    )
    figures = documents.Summary(
        signature={},
        clips={_title(name): json_figures(setup.by_seed[seed]) for name, setup in result.setups.items()},
        total={},
        beside={name: json_figures(row) for name, row in result.beside.items()},
    )
    content = page.Content(
        manifest=manifest,
        figures=figures,
        compared=list(folders),
        notices=[_machine_notice(result)],
        failed=dict(sorted(failed.items())),
        ablation=None,
        clips={name: one["text"] for name, one in done.items()},
        join_scale=max((one["largest_join"] for one in done.values()), default=0.0),
    )
    page.write(path, content, plan.base)
    summary = Summary(outcome)
    summary.warnings = [(name, note) for name, one in done.items() for note in one["notes"]]
    summary.lines = [f"{len(done)} clips to watch, {path.stat().st_size / 1e6:.1f} MB"]
    return summary


def _title(setup: str) -> str:
    return f"all clips, {setup}"


def _total_row(setup: str, manifest: Manifest) -> ClipRow:
    """The row of a setup in the page's table: what its clips that have a motion count together."""
    rows = [row for row in manifest.clips if not row.stuck]
    fallbacks: dict[str, int] = {}
    for row in rows:
        for kind, count in row.fallbacks.items():
            fallbacks[kind] = fallbacks.get(kind, 0) + count
    counts = {key: sum(getattr(row, key) for row in rows) for key in ("n_frames", "pieces", "hard_joins", "retries")}
    return ClipRow(
        clip=_title(setup), references=(), **counts, fallbacks=dict(sorted(fallbacks.items())), stuck=False, error=None,
        files={},
    )  # fmt: skip


def _machine_notice(result: _Comparison) -> str:
    """Time and memory, which are no measures of a motion and so have no column in the page's table."""
    said = []
    for name, setup in result.setups.items():
        seconds, memory = (setup.mean[key] for key in ("search_seconds", "search_memory"))
        said.append(f"{name} {seconds:.3f} s, {format_figure(memory)} MB")
    return "Search of one clip on this machine, time and peak memory with its library: " + "; ".join(said) + "."


def _pack_clip(name: str, indexed: IndexedTest, base: Config, folders: Mapping[str, Path]) -> dict:
    """One clip as the text that goes into the page, and notes on what is not there."""
    notes: list[str] = []
    speech = clips.load(clip_path(base, name), base, with_motion=False).test_speech(base)
    motions = []
    for setup, folder in folders.items():
        if (folder / "reenact" / f"{name}.bvh").is_file():
            motions.append(_pack_motion(name, folder, base, setup))
        else:
            notes.append(f"{setup} found no path for this clip")
    if indexed.truth:
        try:
            truth = cleanup.resample(space.read(Path(indexed.truth), base), base.fps)
            motions.insert(1, pack.pack_motion(truth, base, "truth"))  # among those that are shown at first
        except GesturegenError as error:
            notes.append(f"no true motion: {error}")
    sound = None
    try:
        if indexed.audio:
            sound = pack.pack_audio(*audio.read_samples(indexed.audio))
        else:
            notes.append("no sound: the index of clips names no audio file; run `gesturegen preprocess` again")
    except GesturegenError as error:
        notes.append(f"no sound: {error}")
    packed = pack.pack_clip(speech, base.keywords.words, motions, sound, notes)
    distances = [distance for one in motions if one["trace"] for _, distance, _ in one["trace"]["joins"]]
    return {"text": pack.inert_json(packed), "notes": notes, "largest_join": max(distances, default=0.0)}


def _pack_motion(name: str, folder: Path, base: Config, setup: str) -> dict:
    motion = cleanup.resample(space.read(folder / "reenact" / f"{name}.bvh", base), base.fps)
    trace = submission.read_trace(folder / "reenact" / f"{name}.trace.json")
    stored = reference_frames.read_arrays(folder / "graphs" / f"{trace.graph}.npz", ("source_frames",))
    return pack.pack_motion(motion, base, setup, pack.pack_trace(trace, stored["source_frames"]))

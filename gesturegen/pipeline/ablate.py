"""`ablate`: the same clips through several setups and seeds, in one table (§5.2, Table 2)."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

from gesturegen import __version__, evaluation, files, submission, viewer
from gesturegen.ablation import causes, plot, reference_length, summary, tables
from gesturegen.ablation.plan import Plan, seeded
from gesturegen.data import clips, keynodes
from gesturegen.data.index import Index
from gesturegen.data.stored_clips import digests
from gesturegen.errors import DataError
from gesturegen.extras import need
from gesturegen.frames import ReferenceFrames
from gesturegen.methods import METHODS, libraries
from gesturegen.methods.method import Job
from gesturegen.motion.skeleton import Motion
from gesturegen.parallel import for_each
from gesturegen.path import Path as SearchPath
from gesturegen.pipeline.build_graph import build_libraries
from gesturegen.pipeline.common import Summary, chosen_references, read_index, require_writable
from gesturegen.pipeline.evaluate import (
    add_detectability,
    locate_file,
    measure_beside,
    read_heard,
    recordings,
    reference_skate,
    require_same_joints,
)
from gesturegen.pipeline.memory import require_memory_for
from gesturegen.pipeline.showing import show
from gesturegen.randomness import generator
from gesturegen.settings.models import Config
from gesturegen.stored import documents
from gesturegen.trace import Trace
from gesturegen.workspace import clip_path, library_name, work_path

# The reference clips of each test clip, by setup and seed.
_Chosen = dict[tuple[str, int], dict[str, tuple[str, ...]]]


def ablate(plan: Plan, jobs: int, quiet: bool, keep: bool = False) -> Summary:
    """Gesture and measure every test clip in every setup with every seed; write the table and the plot.

    keep : also leave graphs, BVH files and traces in `ablation/<setup>/`; otherwise motion stays in memory
    """
    index = read_index(plan.base)
    chosen = draw_references(plan, index)
    groups = shared_graphs(plan, chosen)
    runs = [(plan.setups[setup], tests) for (setup, _), tests in chosen.items()]
    jobs, warnings = require_memory_for(runs, index, jobs)
    folder = work_path(plan.base, "ablation")
    require_writable(folder)
    for name in plan.setups:  # what an earlier run kept is not of this one
        shutil.rmtree(folder / name, ignore_errors=True)
    try:
        made = build_shared_graphs(plan, groups, jobs, quiet, keep)
        if not made.outcome.failed:
            made = _run_all(plan, chosen, groups, index, jobs, quiet, keep)
    finally:
        if not keep:
            for name in plan.setups:
                shutil.rmtree(folder / name, ignore_errors=True)
    made.warnings += warnings
    made.warnings += [
        (name, f"in no setup, because it failed in preprocess: {error}") for name, error in index.failed.items()
    ]
    return made


def draw_references(plan: Plan, index: Index) -> _Chosen:
    """The references of each test clip in each setup with each seed.

    The setups share what draws their references, and so the draw; `references.seconds` may cut it shorter.
    """
    return {
        (setup, seed): chosen_references(seeded(config, seed), index)
        for setup, config in plan.setups.items()
        for seed in plan.seeds
    }


def shared_graphs(plan: Plan, chosen: _Chosen) -> dict[tuple[str, tuple[str, ...]], str]:
    """For each setup and group of references the setup whose graph serves: no graph depends on the seed."""
    owners: dict[tuple, str] = {}
    groups = {}
    for (setup, _), tests in chosen.items():
        config = plan.setups[setup]
        for names in tests.values():
            made_of = config.method, config.section_json(*METHODS[config.method].settings), names
            groups[setup, names] = owners.setdefault(made_of, setup)
    return groups


def build_shared_graphs(
    plan: Plan, groups: dict[tuple[str, tuple[str, ...]], str], jobs: int, quiet: bool, keep: bool,
    command: str = "ablate", folder: str = "ablation",
) -> Summary:  # fmt: skip
    """Build each graph once, below a folder of the work folder; `keep` gives every setup that it serves a copy."""
    wanted = {}
    for (setup, names), owner in groups.items():
        if setup == owner:
            path = _graph_path(plan.setups[owner], owner, names, folder)
            wanted[f"{owner}, {path.stem}"] = Job(plan.setups[owner], names, path)
    summary = Summary(build_libraries(wanted, jobs, f"{command}: graphs", quiet))
    if keep and not summary.outcome.failed:
        for (setup, names), owner in groups.items():
            if setup != owner:
                target = _graph_path(plan.setups[setup], setup, names, folder)
                files.copy(_graph_path(plan.setups[owner], owner, names, folder), target)
    return summary


def _graph_path(config: Config, setup: str, names: Sequence[str], folder: str = "ablation") -> Path:
    return work_path(config, folder, setup, "graphs", f"{library_name(config, names)}.npz")


def _run_all(plan: Plan, chosen: _Chosen, groups: dict, index: Index, jobs: int, quiet: bool, keep: bool) -> Summary:
    # The clip comes first in the name, and tasks run by name: its truth is then read once for all setups.
    first = next(iter(chosen))
    tasks = {
        f"{test}, seed {seed}, {setup}": partial(
            _run_clip, setup, groups[setup, names], test, names, seeded(plan.setups[setup], seed), plan.base,
            index.tests[test].truth, keep, len(tests), (setup, seed) == first,
        )
        for (setup, seed), tests in chosen.items()
        for test, names in tests.items()
    }  # fmt: skip
    made = Summary(for_each(tasks, jobs, "ablate", quiet))
    if made.outcome.failed:
        # Rows over different clips would compare nothing.
        made.lines = ["no table was written, because the setups would not be measured on the same clips"]
        return made
    rows = list(made.outcome.done.values())
    order = {setup: place for place, setup in enumerate(plan.setups)}
    rows.sort(key=lambda row: (order[row["setup"]], row["seed"], row["clip"]))
    result = _summarize(plan, chosen, rows, index)
    made.lines = [tables.format_terminal(result)]
    _write(result, plan, made)
    if keep:
        made.written += [work_path(plan.base, "ablation", setup) for setup in plan.setups]
    return made


@lru_cache(maxsize=1)
def _references(config_json: str, names: tuple[str, ...], _digests: tuple[str, ...]) -> Sequence[clips.Reference]:
    """A worker keeps the last ones: the setups follow one another on the same references."""
    config = Config.model_validate_json(config_json)
    return METHODS[config.method].shown_clips(config, names)


@lru_cache(maxsize=1)
def _truth(path: str, _digest: str, config_json: str) -> evaluation.Joints:
    return locate_file(Path(path), Config.model_validate_json(config_json))


@dataclass(frozen=True, eq=False)
class Gestured:
    """What a setup made of a test clip: motion None where the search got stuck, seconds what the search took."""

    path: SearchPath
    trace: Trace
    motion: Motion | None
    graph: ReferenceFrames
    speech: clips.Speech
    seconds: float


def gesture(
    owner: str, test: str, names: tuple[str, ...], config: Config, base: Config, folder: str = "ablation"
) -> Gestured:
    """Search a clip, timed, and render it; the graph is that of the setup `owner`."""
    # Loaded anew for every clip, so that the measured time holds all that a search prepares of its graph.
    graph = libraries.load(_graph_path(config, owner, names, folder), METHODS[config.method], config)
    # The base's serve all setups: rendering takes their motion alone, and the onsets are in the graph.
    sections = ("references", "method", *METHODS[config.method].sections)
    own = {section: getattr(config, section) for section in sections}
    shared = base.model_copy(update=own)
    references = _references(shared.model_dump_json(by_alias=True), names, digests(base, names))
    speech = clips.load(clip_path(config, test), config, with_motion=False).test_speech(config)
    key_nodes = keynodes.of_speech(speech, config.keywords.words)
    _warm_up(graph, speech, config)
    started = time.perf_counter()
    path = METHODS[config.method].search(graph, speech, config, generator(config.seed, test))
    search_seconds = time.perf_counter() - started
    path, frames, motion = show(path, graph, references, speech, config)
    trace = submission.make_trace(path, frames, library_name(config, names), speech, key_nodes, config)
    return Gestured(path, trace, motion, frames, speech, search_seconds)


def _run_clip(
    setup: str, owner: str, test: str, names: tuple[str, ...], config: Config, base: Config, truth_path: str | None,
    keep: bool, n_clips: int, with_beside: bool,
) -> dict:  # fmt: skip
    """The row of a clip; `seams` and `beside` in it are evidence for the totals.

    with_beside : whether to measure what stands beside, which is the same for all setups
    """
    made = gesture(owner, test, names, config, base)
    if keep:
        kept = work_path(config, "ablation", setup, str(config.seed))
        submission.write_clip(kept, test, made.motion, made.trace)
    measured, evidence = None, {"seams": None, "beside": None}
    if made.motion is not None:
        measured, found = _measure(made, test, base, truth_path, n_clips)
        evidence = {"seams": found.seams, "beside": found.beside() if with_beside else None}
        # By the base's prices and pauses whatever the setup searches by: one ruler.
        nodes = made.trace.shown_nodes()
        measured["objective"] = METHODS[config.method].objective(made.graph, made.speech, nodes, base)
        measured["search_seconds"] = round(made.seconds, 4)
    about = {"setup": setup, "seed": config.seed, "clip": test}
    return about | summary.clip_row(made.trace, made.graph, measured) | evidence


_warm: set[tuple] = set()


def _warm_up(graph: ReferenceFrames, speech: clips.Speech, config: Config) -> None:
    """Once per worker, search two seconds of a speech untimed: the first call of a loop compiles it."""
    kind = config.method, config.search_name, config.initialization
    if kind not in _warm:
        short = replace(speech, n_frames=min(speech.n_frames, round(2 * speech.fps)))
        METHODS[config.method].search(replace(graph), short, config, generator(config.seed, "warm-up"))
        _warm.add(kind)


def _measure(
    made: Gestured, test: str, base: Config, truth_path: str | None, n_clips: int
) -> tuple[dict[str, float], Measured]:
    ruler = base.model_copy(update={"evaluation": base.evaluation.model_copy(update={"frechet_windows": ()})})
    found = measure(made, test, ruler, truth_path, n_clips)
    onset_times = read_heard(clip_path(base, test), base).onset_times
    row = found.row | causes.measure(found.generated, found.truth, made.trace, made.graph, onset_times, ruler)
    return row, found


@dataclass(frozen=True, eq=False)
class Measured:
    """The measures of one clip, the joints of its motion and of its truth, and evidence for the totals.

    seams : for `viewer.detect_seams`; beside : measures what stands beside when it is called
    """

    row: dict[str, float]
    generated: evaluation.Joints
    truth: evaluation.Joints | None
    seams: viewer.SeamEvidence
    beside: Callable[[], viewer.Beside]


def measure(made: Gestured, test: str, ruler: Config, truth_path: str | None, n_clips: int) -> Measured:
    """The measures of one clip that has a motion.

    ruler : one config for all setups, also where they hear other onsets; n_clips : of the run
    """
    truth = None
    if truth_path is not None:
        truth = _truth(truth_path, files.sha256(truth_path), ruler.model_dump_json(by_alias=True))
    heard = read_heard(clip_path(ruler, test), ruler)
    generated = evaluation.locate(made.motion, ruler)
    if truth is not None:
        require_same_joints(truth_path, truth, generated)
    skate = reference_skate(ruler, made.trace.shown_clips())
    recorded = recordings(ruler, made.trace)
    return Measured(
        evaluation.measure_clip(generated, ruler, heard, truth, made.trace, made.graph, skate, recorded),
        generated, truth, evaluation.seam_evidence(generated, made.trace, made.graph, recorded, n_clips),
        partial(measure_beside, test, len(generated.world), ruler, heard, truth, recorded),
    )  # fmt: skip


def _summarize(plan: Plan, chosen: _Chosen, rows: list[dict], index: Index) -> summary.Result:
    found = [row.pop("beside") for row in rows]
    beside = viewer.beside_totals([one for one in found if one is not None])
    setups = {}
    for setup, config in plan.setups.items():
        by_seed = {}
        for seed in plan.seeds:
            own = [row for row in rows if row["setup"] == setup and row["seed"] == seed]
            seconds = durations(config, chosen[setup, seed], index)
            by_seed[seed] = summary.run_figures(own, seconds, index.training_seconds)
            add_detectability({row["clip"]: row for row in own}, by_seed[seed], plan.base)
        setups[setup] = summary.over_seeds(by_seed)
    return summary.Result(setups, len(index.tests), plan.signature | {"version": __version__}, rows, beside)


def durations(config: Config, chosen: dict[str, tuple[str, ...]], index: Index) -> dict[str, float]:
    """Seconds of each reference clip, of a cut one only those that are used."""
    whole = index.durations
    if config.references.seconds is None:
        return whole
    used: dict[str, float] = {}
    for names in chosen.values():
        left = config.references.seconds
        for name in names:
            used[name] = max(used.get(name, 0.0), min(whole[name], left))
            left = max(left - whole[name], 0.0)
    return whole | used


def _write(result: summary.Result, plan: Plan, made: Summary) -> None:
    folder = work_path(plan.base, "ablation")
    files.write_text(folder / "ablation.md", tables.format_markdown(result))
    files.write_text(folder / "ablation.csv", tables.format_csv(result))
    documents.write(folder / "ablation.json", tables.json_table(result))
    made.written = [folder / f"ablation.{kind}" for kind in ("md", "csv", "json")]
    lengths = folder / "reference_length.json"
    lengths.unlink(missing_ok=True)  # an older one would not be of this table
    if len({config.references.seconds for config in plan.setups.values()}) > 1:
        documents.write(lengths, reference_length.table(plan.setups, result))
        made.written.append(lengths)
    picture = folder / "ablation.png"
    try:
        need("matplotlib.figure", "video")
    except DataError as error:
        picture.unlink(missing_ok=True)  # an older one would not be of this table
        made.warnings.append(("ablation.png", f"not drawn: {error}"))
        return
    files.write_bytes(picture, partial(plot.draw, result))
    made.written.append(picture)

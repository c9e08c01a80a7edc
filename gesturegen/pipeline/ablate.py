"""`ablate`: the same clips through several setups and seeds, in one table (§5.2, Table 2)."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path

from gesturegen import __version__, clips, evaluation, files, submission
from gesturegen.ablation import causes, plot, summary, tables
from gesturegen.ablation.plan import Plan, seeded
from gesturegen.config import Config, Evaluation
from gesturegen.errors import DataError
from gesturegen.extras import need
from gesturegen.graph import motion_graph
from gesturegen.methods import METHODS
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import (
    Summary,
    chosen_references,
    clip_path,
    digests,
    graph_name,
    load_references,
    read_index,
    require_writable,
    work_path,
)
from gesturegen.pipeline.evaluate import locate_file, read_onset_times, require_same_joints
from gesturegen.pipeline.reenact import gesture


def ablate(plan: Plan, jobs: int, quiet: bool, keep: bool = False) -> Summary:
    """Gesture and measure every test clip in every setup with every seed; write the table and the plot.

    keep : also leave graphs, BVH files and traces in `ablation/<setup>/`; otherwise motion stays in memory
    """
    index = read_index(plan.base)
    # Drawn once per seed from the base config, so that the setups share them.
    chosen = {seed: chosen_references(seeded(plan.base, seed), index) for seed in plan.seeds}
    folder = work_path(plan.base, "ablation")
    require_writable(folder)
    for name in plan.setups:  # what an earlier run kept is not of this one
        shutil.rmtree(folder / name, ignore_errors=True)
    try:
        made = _build_graphs(plan, chosen, jobs, quiet)
        if not made.outcome.failed:
            made = _run_all(plan, chosen, index, jobs, quiet, keep)
    finally:
        if not keep:
            for name in plan.setups:
                shutil.rmtree(folder / name, ignore_errors=True)
    made.warnings += [
        (name, f"in no setup, because it failed in preprocess: {error}") for name, error in index["failed"].items()
    ]
    return made


def _build_graphs(plan: Plan, chosen: dict[int, dict[str, tuple[str, ...]]], jobs: int, quiet: bool) -> Summary:
    """One graph per setup and group of references: no graph depends on the seed."""
    groups = {graph_name(names): names for tests in chosen.values() for names in tests.values()}
    tasks = {
        f"{setup}, {group}": partial(_build_graph, setup, names, config)
        for setup, config in plan.setups.items()
        for group, names in groups.items()
    }
    return Summary(for_each(tasks, jobs, "ablate: graphs", quiet))


def _graph_path(config: Config, setup: str, names: Sequence[str]) -> Path:
    return work_path(config, "ablation", setup, "graphs", f"{graph_name(names)}.npz")


def _build_graph(setup: str, names: tuple[str, ...], config: Config) -> None:
    graph = METHODS[config.method].build(load_references(config, names), config)
    motion_graph.save(_graph_path(config, setup, names), graph, config, digests(config, names))


def _run_all(plan: Plan, chosen: dict, index: dict, jobs: int, quiet: bool, keep: bool) -> Summary:
    # The clip comes first in the name, and tasks run by name: its truth is then read once for all setups.
    tasks = {
        f"{test}, seed {seed}, {setup}": partial(
            _run_clip, setup, test, names, seeded(config, seed), plan.base, index["tests"][test]["truth"], keep
        )
        for seed, tests in chosen.items()
        for test, names in tests.items()
        for setup, config in plan.setups.items()
    }
    made = Summary(for_each(tasks, jobs, "ablate", quiet))
    if made.outcome.failed:
        # Rows over different clips would compare nothing.
        made.lines = ["no table was written, because the setups would not be measured on the same clips"]
        return made
    rows = list(made.outcome.done.values())
    order = {setup: place for place, setup in enumerate(plan.setups)}
    rows.sort(key=lambda row: (order[row["setup"]], row["seed"], row["clip"]))
    result = _summarize(plan, rows, index)
    made.lines = [tables.format_terminal(result)]
    _write(result, plan, made)
    if keep:
        made.written += [work_path(plan.base, "ablation", setup) for setup in plan.setups]
    return made


@lru_cache(maxsize=1)
def _references(config_json: str, names: tuple[str, ...], _digests: tuple[str, ...]) -> list[clips.Reference]:
    """A worker keeps the last ones: the setups follow one another on the same references."""
    return load_references(Config.model_validate_json(config_json), names)


@lru_cache(maxsize=1)
def _truth(path: str, _digest: str, config_json: str) -> evaluation.Joints:
    return locate_file(Path(path), Config.model_validate_json(config_json))


def _run_clip(
    setup: str, test: str, names: tuple[str, ...], config: Config, base: Config, truth_path: str | None, keep: bool
) -> dict:
    graph = motion_graph.load(_graph_path(config, setup, names), config)
    # The base's serve all setups: rendering takes their motion alone, and the onsets are in the graph.
    references = _references(base.model_dump_json(by_alias=True), names, digests(base, names))
    trace, motion = gesture(test, references, graph, config)
    if keep:
        kept = work_path(config, "ablation", setup, str(config.seed))
        submission.write_clip(kept, test, motion, {**trace, "inputs": ""})
    measured = None if motion is None else _measure(motion, trace, graph, test, base, truth_path)
    about = {"setup": setup, "seed": config.seed, "clip": test}
    return about | summary.clip_row(trace, graph, measured)


def _measure(motion, trace: dict, graph, test: str, base: Config, truth_path: str | None) -> dict[str, float]:
    """The measures of one clip, for all setups by the base config: one ruler, also where they hear other onsets."""
    ruler = base.model_copy(update={"evaluation": Evaluation(**base.evaluation.model_dump() | {"frechet_windows": ()})})
    truth = None
    if truth_path is not None:
        truth = _truth(truth_path, files.sha256(truth_path), ruler.model_dump_json(by_alias=True))
    onset_times = read_onset_times(clip_path(base, test), base)
    generated = evaluation.locate(motion, ruler)
    if truth is not None:
        require_same_joints(truth_path, truth, generated)
    measured = evaluation.measure_clip(generated, ruler, onset_times, truth, trace, graph)
    return measured | causes.measure(generated, truth, trace, graph, onset_times, ruler)


def _summarize(plan: Plan, rows: list[dict], index: dict) -> summary.Result:
    seconds = {name: row["seconds"] for name, row in index["references"].items()}
    setups = {}
    for setup in plan.setups:
        by_seed = {}
        for seed in plan.seeds:
            own = [row for row in rows if row["setup"] == setup and row["seed"] == seed]
            by_seed[seed] = summary.run_figures(own, seconds, index["training_seconds"])
        setups[setup] = summary.over_seeds(by_seed)
    return summary.Result(setups, len(index["tests"]), plan.signature | {"version": __version__}, rows)


def _write(result: summary.Result, plan: Plan, made: Summary) -> None:
    folder = work_path(plan.base, "ablation")
    files.write_text(folder / "ablation.md", tables.format_markdown(result))
    files.write_text(folder / "ablation.csv", tables.format_csv(result))
    files.write_json(folder / "ablation.json", tables.json_table(result))
    made.written = [folder / f"ablation.{kind}" for kind in ("md", "csv", "json")]
    picture = folder / "ablation.png"
    try:
        need("matplotlib.figure", "video")
    except DataError as error:
        picture.unlink(missing_ok=True)  # an older one would not be of this table
        made.warnings.append(("ablation.png", f"not drawn: {error}"))
        return
    files.write_bytes(picture, partial(plot.draw, result))
    made.written.append(picture)

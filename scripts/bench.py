"""Measure time and peak memory of each stage, beside the naive implementation in `tests/naive.py`, on one core.

    python scripts/bench.py [--seconds 63 170 427] [--fast-only] [--long 60] [--gestures 190]

Makes a demo reference of each length and a demo test speech in `bench/`, then runs every stage in a process of its
own. Ratios are those of CPU time, which other work on the machine disturbs less. A stage is timed when its loops are
compiled; a global search also when the graph's tables are prepared, which every further test clip finds done and which
is the stage `global tables`. A global search is also given in CPU time for each pair of a frame of the speech and one of
the reference; three prices of joins are timed, without and with the sweeps against repetition, and beside the naive
program where that ends soon: on a few seconds. The naive graph of the 427 s reference takes minutes. `build clips` and
`clips to BVH` of GestureMaster are whole commands, which also load their loops.

`--long MINUTES` puts one graph of so many demo clips of 60 s in place of the references, with a test speech of 77 s.
`--gestures MINUTES` does the same with one database of gesture clips, which GestureMaster searches. Their recordings
are preprocessed once, and kept.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from gesturegen import demo, render
from gesturegen.data import clips, keynodes, recordings
from gesturegen.methods import METHODS, libraries
from gesturegen.methods.gesture_master import database, viterbi
from gesturegen.methods.gesture_master import search as gesture_master
from gesturegen.methods.gesture_master.extraction import BODIES, extract
from gesturegen.methods.motion_graph import global_search
from gesturegen.methods.motion_graph import graph as motion_graph
from gesturegen.motion import bvh
from gesturegen.parallel import default_jobs
from gesturegen.pipeline import Summary, build_graphs, common, preprocess, reenact
from gesturegen.randomness import generator
from gesturegen.settings.loading import configs_folder, load_config
from gesturegen.settings.models import Config
from gesturegen.speech import audio, prosody
from tests import naive

FOLDER = Path("bench")
ONE_CORE = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
BUILD, BUILD_CLIPS = "build graph", "build clips"
STAGES = {
    BUILD: "continuity analysis with both prunings",
    "beam search": "for the whole speech",
    "global tables": "what the first global search of a graph prepares, with 2 s of speech",
    "global search": "the best path for the whole speech by configs/best.yaml, repetition aside",
    "global + sweeps": "the same and the sweeps against repetition",
    "global joins/10": "joins ten times cheaper, repetition aside",
    "global joins/10 + sweeps": "the same and the sweeps",
    "global joins*10": "joins ten times dearer, repetition aside",
    "global joins*10 + sweeps": "the same and the sweeps",
    "global small": "10 s of the reference, 8 s of the speech, repetition aside",
    "global small joins/10": "the same with joins ten times cheaper",
    "global small joins*10": "the same with joins ten times dearer",
    "read reference": "BVH, WAV and TSV to a clip",
    "read test": "WAV and TSV to a speech",
    "render": "resampling, blending, root",
    "write BVH": "the output file",
    "beam to BVH": "one test clip from its files to BVH with the beam search",
    "global to BVH": "the same with the global search",
    "best to BVH": "the same with configs/best.yaml",
}
CLIP_STAGES = {
    BUILD_CLIPS: "the database of all references, from their stored clips to its file",
    "prosody": "loudness and pitch of a minute of the speech",
    "cut clips": "a minute of a reference cut, described and mirrored",
    "clip edges": "transition costs of both bodies, and the edges",
    "clip search": "Viterbi for the whole speech, both bodies",
    "clips to path": "the same from the stored database, mapped into memory, and the speech",
    "clips to BVH": "the same by `reenact`, from hashes of all files to BVH and trace",
}
SMALL = tuple(stage for stage in STAGES if stage.startswith("global small"))
# Searches of the whole reference, whose naive program would take a day.
SEARCHES = ("global search", "global + sweeps", *(stage for stage in STAGES if stage.startswith("global joins")))
NAIVE = (BUILD, "beam search", *SMALL, "clip edges", "clip search")
LONG = (BUILD, "beam search", "global tables", *SEARCHES)
JOIN_FACTORS = {"joins/10": 0.1, "joins*10": 10.0}
LONG_CLIPS = (BUILD_CLIPS, "clip search", "clips to path", "clips to BVH")
SHORT_REFERENCE, SHORT_SPEECH = 300, 240  # frames, which the naive global search can bear
WARM_UP = 60  # frames
WARM_UP_CLIPS = 600  # frames, which hold more than one gesture clip


def settings(folder: Path, stage: str = "") -> Config:
    base = configs_folder() / "best.yaml" if stage.startswith(("best", "global")) else None
    changes = ["global_search.sweeps=0"] if stage in SMALL + SEARCHES and "+ sweeps" not in stage else []
    found = load_config(base, changes, folders={"paths.data": str(folder)})
    factor = next((factor for name, factor in JOIN_FACTORS.items() if name in stage), None)
    if factor is None:
        return found
    own = found.global_search
    prices = {"join_price": factor * own.join_price, "lambda_join": factor * own.lambda_join}
    return found.model_copy(update={"global_search": own.model_copy(update=prices)})


def clip_settings(folder: Path) -> Config:
    folders = {"paths.data": str(folder), "paths.work": str(folder / "work")}
    return load_config(configs_folder() / "gesture_master_2022.yaml", folders=folders)


def references(folder: Path) -> list[clips.Reference]:
    config = settings(folder)
    return [
        clips.prepare(recording, config, with_motion=True).reference(config)
        for recording in recordings.reference_recordings(config)
    ]


def speech(folder: Path) -> clips.Speech:
    config = settings(folder)
    return clips.prepare(recordings.test_recordings(config)[0], config, with_motion=False).test_speech(config)


def short(reference: clips.Reference, n_frames: int) -> clips.Reference:
    n_frames = min(n_frames, reference.motion.n_frames)
    return replace(
        reference,
        motion=reference.motion.take(np.arange(n_frames)),
        source_frames=reference.source_frames[:n_frames],
        segment_starts=reference.segment_starts[reference.segment_starts < n_frames],
    )


def search(graph: motion_graph.MotionGraph, said: clips.Speech, config: Config):
    return METHODS[config.method].search(graph, said, config, generator(config.seed, said.name))


def naive_beam(graph: motion_graph.MotionGraph, said: clips.Speech, config: Config):
    nodes = keynodes.of_speech(said, config.keywords.words)
    rows = list(zip(nodes.frames.tolist(), nodes.kinds.tolist(), nodes.keywords.tolist(), strict=True))
    return naive.search(graph, rows, said.n_frames, config, generator(config.seed, said.name))


def prepare(folder: Path, stage: str, slow: bool) -> tuple[Callable, Callable]:
    """Return a function that compiles a stage's loops and prepares its inputs, and one that runs the stage."""
    config = settings(folder, stage)
    if stage == "read reference":
        return (lambda: references(folder),) * 2
    if stage == "read test":
        return (lambda: speech(folder),) * 2
    if stage == BUILD and not slow:
        recorded = references(folder)
        return (
            lambda: motion_graph.build([short(recorded[0], WARM_UP)], config),
            lambda: motion_graph.build(recorded, config),
        )
    graph = libraries.read(graph_path(folder))
    if stage == BUILD:
        return None, lambda: naive.build(graph.positions, graph.segment_starts, config.continuity)
    said = speech(folder)
    beginning = replace(said, n_frames=WARM_UP)
    if stage == "beam search" and slow:
        return None, lambda: naive_beam(graph, said, config)
    if stage == "global tables":
        return (lambda: search(replace(graph), beginning, config),) * 2
    if stage in SMALL:
        said = replace(said, n_frames=SHORT_SPEECH)
        graph = motion_graph.build([short(references(folder)[0], SHORT_REFERENCE)], config)
        if slow:
            prices = global_search.price_list(graph, said, config)
            return None, lambda: naive.Objective(prices).cheapest()
    if stage in LONG + SMALL:
        return lambda: search(graph, beginning, config), lambda: search(graph, said, config)
    recorded = references(folder)
    if stage == "render":
        path = search(graph, said, config)
        return (lambda: render.render(path, recorded, graph, config),) * 2
    out = folder / "out.bvh"
    if stage == "write BVH":
        motion = render.render(search(graph, said, config), recorded, graph, config)
        return (lambda: bvh.write(out, motion),) * 2
    return (lambda: bvh.write(out, render.render(search(graph, speech(folder), config), recorded, graph, config)),) * 2


def prepare_clips(folder: Path, stage: str, slow: bool) -> tuple[Callable | None, Callable]:
    """Do as `prepare` for the stages of GestureMaster, in a work folder of preprocessed recordings."""
    config = clip_settings(folder)
    if stage == BUILD_CLIPS:
        for name in ("gestures", "graphs"):
            shutil.rmtree(common.work_path(config, name), ignore_errors=True)
        return None, lambda: build_graphs(config, jobs=1, quiet=True)
    if stage == "clips to BVH":
        return None, lambda: reenact(config, jobs=1, quiet=True)
    if stage == "prosody":
        samples, rate = audio.read_samples(recordings.test_recordings(config)[0].audio_path)
        return (
            lambda: prosody.measure(samples[:rate], rate, config.prosody),
            lambda: prosody.measure(samples[: 60 * rate], rate, config.prosody),
        )
    ((test, names),) = common.chosen_references(config, common.read_index(config)).items()
    if stage == "cut clips":
        minute = short(common.load_reference(config, names[0]), 60 * config.fps)
        return lambda: extract(short(minute, WARM_UP_CLIPS), config), lambda: extract(minute, config)
    if stage == "clip edges":
        borders = clip_borders(common.load_references(config, names), config)
        if slow:
            return None, lambda: naive_edges(borders, config)
        few = clip_borders([short(common.load_reference(config, names[0]), WARM_UP_CLIPS)], config)
        return lambda: clip_edges(few, config), lambda: clip_edges(borders, config)
    stored = common.graph_path(config, common.graph_name(config, names))
    said = clips.load(common.clip_path(config, test), config).test_speech(config)
    if stage == "clips to path":
        # Any search looks at all edges once, so that the file is in the system's cache when it is timed.
        beginning = replace(said, n_frames=WARM_UP)
        return (
            lambda: search(libraries.read(stored), beginning, config),
            lambda: search(libraries.read(stored), said, config),
        )
    problems = clip_problems(libraries.read(stored), said, config)
    if slow:
        return None, lambda: [naive_clips(*problem) for problem in problems]
    return (lambda: [viterbi.search(*problem) for problem in problems],) * 2


def clip_borders(recorded: Sequence[clips.Reference], config: Config) -> dict:
    parts = [extract(reference, config) for reference in recorded]
    return {body: database.all_borders(parts, body, config) for body in BODIES}


def clip_edges(borders: dict, config: Config):
    for body in BODIES:
        database.link(borders[body], body, database.threshold(borders[body], body, config), config)


def naive_edges(borders: dict, config: Config):
    for body in BODIES:
        own = getattr(config.gesture_master, body)
        np.nonzero(naive.transition_costs(*borders[body], own.lambda_1, own.lambda_2) < own.delta_t)


def clip_problems(found: database.GestureDatabase, said: clips.Speech, config: Config) -> list[tuple]:
    """Collect the inputs of the Viterbi search for each body."""
    asked = config.gesture_master
    terms = gesture_master.data_terms(found, said, gesture_master.segments(said, config), config)
    problems = []
    for body in BODIES:
        own = getattr(asked, body)
        data = own.lambda_3 * (own.lambda_5 * terms["style"] + own.lambda_6 * terms["rhythm"]) + terms["scale"]
        data += asked.lambda_kind * terms["kind"] * (body == "upper")
        edges = viterbi.InEdges(*(getattr(found, f"{body}_{key}") for key in ("indptr", "sources", "costs")))
        problems.append((data, edges, own.zeta, asked.lambda_reuse, found.twins, own.lambda_4))
    return problems


def naive_clips(data: np.ndarray, edges: viterbi.InEdges, *prices):
    destinations = np.repeat(np.arange(data.shape[1]), np.diff(edges.indptr))
    pairs = zip(edges.sources.tolist(), destinations.tolist(), strict=True)
    naive.viterbi(data, dict(zip(pairs, edges.costs.tolist(), strict=True)), *prices)


def measure(folder: Path, stage: str, slow: bool) -> dict:
    """Measure seconds and peak megabytes of one stage, in this process."""
    warm_up, run = (prepare_clips if stage in CLIP_STAGES else prepare)(folder, stage, slow)
    if warm_up is not None:
        warm_up()
    start, started = time.perf_counter(), time.process_time()
    result = run()
    figures = {"seconds": time.perf_counter() - start, "cpu": time.process_time() - started}
    figures["megabytes"] = peak_megabytes()
    if stage in SEARCHES:
        figures["pairs"] = libraries.read(graph_path(folder)).n_nodes * speech(folder).n_frames
    if isinstance(result, Summary):
        require_success(result)
    if stage == BUILD and not slow:
        libraries.save(graph_path(folder), METHODS["motion_graph"], result, settings(folder))
    return figures


def require_success(summary: Summary) -> None:
    """Exit when a command failed, so that a failure does not pass for a fast run."""
    if summary.outcome.failed:
        raise SystemExit("\n".join([*summary.outcome.errors.values(), *summary.outcome.bugs.values()]))


def peak_megabytes() -> float:
    status = Path("/proc/self/status")
    if status.is_file():
        return int(next(line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM"))) / 1024
    # Elsewhere than on Linux; there it would count the process that started this one.
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def in_a_process(folder: Path, stage: str, slow: bool = False) -> dict:
    command = [sys.executable, __file__, "--measure", str(folder), stage, "naive" if slow else "fast"]
    result = subprocess.run(command, env=os.environ | ONE_CORE, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(result.stdout)


def graph_path(folder: Path) -> Path:
    return folder / "graph.npz"


def make_data(folder: Path, count: int, seconds: float, test_seconds: float) -> Path:
    """Make demo data in a folder, all or nothing."""
    if not folder.is_dir():
        unfinished = folder.with_name(f"{folder.name}.unfinished")
        lengths = {"reference_seconds": (seconds, seconds), "test_seconds": (test_seconds, test_seconds)}
        for spec in demo.clip_specs(references=count, tests=1, seed=0, **lengths):
            demo.write_clip(unfinished, spec)
        unfinished.rename(folder)
    return folder


def make_work(folder: Path) -> Path:
    """Preprocess the recordings of a folder, with prosody, all or nothing."""
    work = folder / "work"
    if not work.is_dir():
        unfinished = folder / "work.unfinished"
        config = load_config(
            overrides=["prosody.enabled=true"], folders={"paths.data": str(folder), "paths.work": str(unfinished)}
        )
        require_success(preprocess(config, default_jobs(), quiet=True))
        unfinished.rename(work)
    return folder


def describe(folder: Path, stage: str) -> str:
    if stage == BUILD:
        graph = libraries.read(graph_path(folder))
        edges = f"{int(np.sum(~graph.natural))} unnatural edges, {graph_path(folder).stat().st_size / 1e6:.0f} MB"
        return f"{graph.n_nodes} frames of {len(graph.joint_names)} joints, {edges}"
    (path,) = (folder / "work" / "graphs").glob("*.npz")
    found = libraries.read(path)
    own = int(np.sum(found.twins >= np.arange(len(found.twins))))
    edges = f"{len(found.upper_sources)} and {len(found.lower_sources)} edges, {path.stat().st_size / 1e6:.0f} MB"
    return f"{len(found.starts)} gesture clips, {own} of them not mirrored, {edges}"


def show(title: str, folder: Path, stages: Sequence[str], fast_only: bool) -> None:
    # The first stage leaves the graph that the others load.
    for stage in stages:
        fast = in_a_process(folder, stage)
        if stage == stages[0]:
            click.echo(f"\n{title}: {describe(folder, stage)}")
            click.echo(f"{'stage, compiled':26}{'ours s':>10}{'CPU s':>10}{'naive s':>10}{'ratio':>8}{'ours MB':>10}"
                       f"{'naive MB':>10}   what it is; searches with the graph's tables prepared")  # fmt: skip
        line = f"{stage:26}{fast['seconds']:10.3f}{fast['cpu']:10.3f}"
        if stage in NAIVE and not fast_only:
            slow = in_a_process(folder, stage, slow=True)
            line += f"{slow['seconds']:10.2f}{slow['cpu'] / fast['cpu']:8.0f}"
            line += f"{fast['megabytes']:10.0f}{slow['megabytes']:10.0f}"
        else:
            line += f"{'-':>10}{'-':>8}{fast['megabytes']:10.0f}{'-':>10}"
        line += f"   {(STAGES | CLIP_STAGES)[stage]}"
        if "pairs" in fast:
            line += f"; {1e9 * fast['cpu'] / fast['pairs']:.1f} ns for each frame of both"
        click.echo(line)


@click.command()
@click.option(
    "--seconds", multiple=True, type=float, default=(63.0, 170.0, 427.0), show_default=True, help="Reference lengths."
)
@click.option("--fast-only", is_flag=True, help="Leave out the naive implementation.")
@click.option("--long", "minutes", type=click.IntRange(min=1), help="One graph of so many minutes instead.")
@click.option("--gestures", type=click.IntRange(min=1), help="One gesture database of so many minutes instead.")
@click.option("--measure", "one", nargs=3, hidden=True)
def main(
    seconds: tuple[float, ...], fast_only: bool, minutes: int | None, gestures: int | None,
    one: tuple[str, str, str] | None,
) -> None:  # fmt: skip
    """Measure time and peak memory of each stage, beside a naive implementation, on one core."""
    if one:
        folder, stage, kind = one
        click.echo(json.dumps(measure(Path(folder), stage, kind == "naive")))
        return
    if minutes or gestures:
        for count, stages in ((minutes, LONG), (gestures, LONG_CLIPS)):
            if count:
                folder = make_data(FOLDER / f"{count}min", count, 60.0, 77.0)
                folder = make_work(folder) if stages is LONG_CLIPS else folder
                show(f"{count} references of 60 s, test speech of 77 s", folder, stages, fast_only=True)
        return
    for length in seconds:
        folder = make_data(FOLDER / f"{length:g}s", 1, length, 64.0)
        for stages in (list(STAGES), list(CLIP_STAGES)):
            folder = make_work(folder) if stages[0] == BUILD_CLIPS else folder
            show(f"reference of {length:g} s, test speech of 64 s", folder, stages, fast_only)


if __name__ == "__main__":
    main()

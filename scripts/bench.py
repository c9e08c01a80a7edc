"""Time and peak memory of each stage, beside the obvious implementation in `tests/naive.py`, on one core.

    python scripts/bench.py [--seconds 63 170 427] [--fast-only] [--long 60]

Makes a demo reference of each length and a demo test speech in `bench/`, then runs every stage in a process of its
own. A stage is timed when its loops are compiled; a global search also when the graph's tables are prepared, which
every further test clip finds done and which is the stage `global tables`. The naive graph of the 427 s reference
takes minutes.

`--long MINUTES` puts one graph of so many demo clips of 60 s in place of the references, with a test speech of 77 s.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from gesturegen import clips, demo, keynodes, recordings, render
from gesturegen.config import Config, configs_folder, load_config
from gesturegen.graph import motion_graph, neighbours
from gesturegen.methods import METHODS
from gesturegen.motion import bvh
from gesturegen.randomness import generator
from gesturegen.search import termination
from tests import naive

FOLDER = Path("bench")
ONE_CORE = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}
BUILD = "build graph"
STAGES = {
    BUILD: "continuity analysis with both prunings, and the index",
    "index": "of it, the nearest frames of every frame",
    "beam search": "for the whole speech",
    "global tables": "what the first global search of a graph prepares, with 2 s of speech",
    "global search": "the best path for the whole speech, repetition aside",
    "global + sweeps": "the same and the sweeps against repetition",
    "global, small": "3 s of the reference, 4 s of the speech, repetition aside",
    "read reference": "BVH, WAV and TSV to a clip",
    "read test": "WAV and TSV to a speech",
    "render": "resampling, blending, root",
    "write BVH": "the output file",
    "beam to BVH": "one test clip from its files to BVH with the beam search",
    "global to BVH": "the same with the global search",
    "best to BVH": "the same with configs/best.yaml",
}
NAIVE = (BUILD, "index", "beam search", "global, small")
LONG = (BUILD, "index", "beam search", "global tables", "global search", "global + sweeps")
SHORT_REFERENCE, SHORT_SPEECH = 90, 120  # frames, which the naive global search can bear
WARM_UP = 60  # frames


def settings(folder: Path, stage: str = "") -> Config:
    base = configs_folder() / "best.yaml" if stage.startswith("best") else None
    changes = ["search=global"] if stage.startswith("global") else []
    if stage in ("global search", "global, small"):
        changes.append("global_search.sweeps=0")
    return load_config(base, changes, folders={"paths.data": str(folder)})


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
    return replace(
        reference,
        motion=reference.motion.take(np.arange(n_frames)),
        source_frames=reference.source_frames[:n_frames],
        segment_starts=reference.segment_starts[reference.segment_starts < n_frames],
    )


def search(graph: motion_graph.MotionGraph, said: clips.Speech, config: Config):
    return METHODS[config.method].search(graph, said, config, generator(config.seed, said.name))


def targets(said: clips.Speech, config: Config):
    return termination.targets(keynodes.of_speech(said, config.keywords.words), said.n_frames)


def naive_beam(graph: motion_graph.MotionGraph, said: clips.Speech, config: Config):
    nodes = keynodes.of_speech(said, config.keywords.words)
    rows = list(zip(nodes.frames.tolist(), nodes.kinds.tolist(), nodes.keywords.tolist(), strict=True))
    return naive.search(graph, rows, said.n_frames, config, generator(config.seed, said.name))


def naive_nearest(graph: motion_graph.MotionGraph, config: Config):
    poses, velocities = naive.poses_and_velocities(graph.positions, graph.segment_starts)
    for node in range(graph.n_nodes):
        distances = naive.distances_from(node, poses, velocities, config.continuity)
        distances[node] = np.inf
        np.argsort(distances, kind="stable")[: neighbours.COUNT]


def prepare(folder: Path, stage: str, slow: bool) -> tuple[Callable, Callable]:
    """What compiles a stage's loops and prepares what others have prepared for it, and the stage itself."""
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
    graph = motion_graph.load(graph_path(folder))
    if stage == BUILD:
        return None, lambda: naive.build(graph.positions, graph.segment_starts, config.continuity)
    if stage == "index":
        if slow:
            return None, lambda: naive_nearest(graph, config)
        poses, speeds = graph.poses, graph.velocities
        return (
            lambda: neighbours.nearest(poses[:WARM_UP], speeds[:WARM_UP], config.continuity),
            lambda: neighbours.nearest(poses, speeds, config.continuity),
        )
    said = speech(folder)
    beginning = replace(said, n_frames=WARM_UP)
    if stage == "beam search" and slow:
        return None, lambda: naive_beam(graph, said, config)
    if stage == "global tables":
        return (lambda: search(replace(graph), beginning, config),) * 2
    if stage == "global, small":
        said = replace(said, n_frames=SHORT_SPEECH)
        graph = motion_graph.build([short(references(folder)[0], SHORT_REFERENCE)], config)
        if slow:
            speaking = keynodes.speaking(said, config.pauses)
            return None, lambda: naive.Objective(graph, targets(said, config), speaking, config).cheapest()
    if stage in LONG or stage == "global, small":
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


def measure(folder: Path, stage: str, slow: bool) -> dict:
    """Seconds and peak megabytes of one stage, in this process."""
    warm_up, run = prepare(folder, stage, slow)
    if warm_up is not None:
        warm_up()
    start = time.perf_counter()
    result = run()
    figures = {"seconds": time.perf_counter() - start, "megabytes": peak_megabytes()}
    if stage == BUILD and not slow:
        motion_graph.save(graph_path(folder), result, settings(folder))
    return figures


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
    """Demo data in a folder, whole or not at all."""
    if not folder.is_dir():
        unfinished = folder.with_name(f"{folder.name}.unfinished")
        lengths = {"reference_seconds": (seconds, seconds), "test_seconds": (test_seconds, test_seconds)}
        for spec in demo.clip_specs(references=count, tests=1, seed=0, **lengths):
            demo.write_clip(unfinished, spec)
        unfinished.rename(folder)
    return folder


def show(title: str, folder: Path, stages: Sequence[str], fast_only: bool) -> None:
    # The first stage leaves the graph that the others load.
    for stage in stages:
        fast = in_a_process(folder, stage)
        if stage == BUILD:
            graph = motion_graph.load(graph_path(folder))
            click.echo(f"\n{title}: {graph.n_nodes} frames of {len(graph.joint_names)} joints, "
                       f"{int(np.sum(~graph.natural))} unnatural edges, "
                       f"{graph_path(folder).stat().st_size / 1e6:.0f} MB")  # fmt: skip
            click.echo(f"{'stage, compiled':16}{'ours s':>10}{'naive s':>10}{'ratio':>8}{'ours MB':>10}"
                       f"{'naive MB':>10}   what it is; searches with the graph's tables prepared")  # fmt: skip
        line = f"{stage:16}{fast['seconds']:10.3f}"
        if stage in NAIVE and not fast_only:
            slow = in_a_process(folder, stage, slow=True)
            line += f"{slow['seconds']:10.2f}{slow['seconds'] / fast['seconds']:8.0f}"
            line += f"{fast['megabytes']:10.0f}{slow['megabytes']:10.0f}"
        else:
            line += f"{'-':>10}{'-':>8}{fast['megabytes']:10.0f}{'-':>10}"
        click.echo(f"{line}   {STAGES[stage]}")


@click.command()
@click.option(
    "--seconds", multiple=True, type=float, default=(63.0, 170.0, 427.0), show_default=True, help="Reference lengths."
)
@click.option("--fast-only", is_flag=True, help="Leave out the naive implementation.")
@click.option("--long", "minutes", type=click.IntRange(min=1), help="One graph of so many minutes instead.")
@click.option("--measure", "one", nargs=3, hidden=True)
def main(seconds: tuple[float, ...], fast_only: bool, minutes: int | None, one: tuple[str, str, str] | None) -> None:
    """Time and peak memory of each stage, beside the obvious implementation, on one core."""
    if one:
        folder, stage, kind = one
        click.echo(json.dumps(measure(Path(folder), stage, kind == "naive")))
        return
    if minutes:
        folder = make_data(FOLDER / f"{minutes}min", minutes, 60.0, 77.0)
        show(f"{minutes} references of 60 s, test speech of 77 s", folder, LONG, fast_only=True)
        return
    for length in seconds:
        folder = make_data(FOLDER / f"{length:g}s", 1, length, 64.0)
        show(f"reference of {length:g} s, test speech of 64 s", folder, list(STAGES), fast_only)


if __name__ == "__main__":
    main()

"""Time and peak memory of each stage, beside the obvious implementation in `tests/naive.py`, on one core.

    python scripts/bench.py [--seconds 63 427] [--fast-only]

Makes a demo reference of each length and a demo test speech in `bench/`, then runs every stage in a process
of its own: once to load and compile, once measured. The naive graph of the 427 s reference takes minutes.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import click
import numpy as np

from gesturegen import clips, demo, recordings, render
from gesturegen.config import Config, load_config
from gesturegen.graph import continuity, motion_graph
from gesturegen.methods import METHODS
from gesturegen.motion import bvh
from gesturegen.randomness import generator
from tests import naive

FOLDER = Path("bench")
ONE_CORE = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}
# Stage -> (what it is, whether the naive code has it)
STAGES = {
    "read reference": "BVH, WAV and TSV to a clip",
    "build graph": "continuity analysis with both prunings",
    "read test": "WAV and TSV to a speech",
    "search": "beam search for the whole speech",
    "render": "resampling, blending, root",
    "write BVH": "the output file",
    "files to BVH": "one test clip, all of the above but the reference's own stages",
}
NAIVE = ("build graph", "search")


def settings(folder: Path) -> Config:
    return load_config(None, folders={"paths.data": str(folder)})


def reference(folder: Path) -> clips.Reference:
    config = settings(folder)
    return clips.prepare(recordings.reference_recordings(config)[0], config, with_motion=True).reference(config)


def speech(folder: Path) -> clips.Speech:
    config = settings(folder)
    return clips.prepare(recordings.test_recordings(config)[0], config, with_motion=False).test_speech(config)


def naive_search(graph, test, config, rng):
    from gesturegen.keynodes import of_speech

    nodes = of_speech(test, config.keywords.words)
    rows = list(zip(nodes.frames.tolist(), nodes.kinds.tolist(), nodes.keywords.tolist(), strict=True))
    return naive.search(graph, rows, test.n_frames, config, rng)


def prepare(folder: Path, stage: str, slow: bool):
    """Everything a stage needs beforehand; returns the stage itself, to be timed."""
    config = settings(folder)
    if stage == "read reference":
        return partial(reference, folder)
    if stage == "read test":
        return partial(speech, folder)
    recorded = reference(folder)
    if stage == "build graph" and not slow:
        return partial(motion_graph.build, [recorded], config)
    graph = motion_graph.build([recorded], config)
    if stage == "build graph":
        return partial(naive.build, graph.positions, graph.segment_starts, config.continuity)
    test = speech(folder)
    rng = partial(generator, config.seed, test.name)
    search = METHODS[config.method].search
    if stage == "search":
        return (
            (lambda: naive_search(graph, test, config, rng())) if slow else lambda: search(graph, test, config, rng())
        )
    path = search(graph, test, config, rng())
    if stage == "render":
        return partial(render.render, path, [recorded], graph, config)
    motion = render.render(path, [recorded], graph, config)
    out = folder / "out.bvh"
    if stage == "write BVH":
        return partial(bvh.write, out, motion)

    def everything():
        said = speech(folder)
        bvh.write(out, render.render(search(graph, said, config, rng()), [recorded], graph, config))

    return everything


def measure(folder: Path, stage: str, slow: bool) -> dict:
    """Seconds and peak megabytes of one stage, in this process."""
    warm_up = prepare(folder, stage, slow=False)
    warm_up()
    run = prepare(folder, stage, slow)
    start = time.perf_counter()
    run()
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"seconds": seconds, "megabytes": peak}


def in_a_process(folder: Path, stage: str, slow: bool) -> dict:
    command = [sys.executable, __file__, "--measure", str(folder), stage, "naive" if slow else "fast"]
    result = subprocess.run(command, env=os.environ | ONE_CORE, capture_output=True, text=True, check=True)
    return json.loads(result.stdout)


def make_data(seconds: float) -> Path:
    folder = FOLDER / f"{seconds:g}s"
    if not (folder / "tst").is_dir():
        lengths = {"reference_seconds": (seconds, seconds), "test_seconds": (64.0, 64.0)}
        for spec in demo.clip_specs(references=1, tests=1, seed=0, **lengths):
            demo.write_clip(folder, spec)
    return folder


def show(seconds: float, folder: Path, fast_only: bool) -> None:
    recorded = reference(folder)
    config = settings(folder)
    graph = motion_graph.build([recorded], config)
    poses = continuity.flatten(graph.positions)
    click.echo(f"\nreference of {seconds:g} s: {graph.n_nodes} frames of {poses.shape[1] // 3} joints, "
               f"{int(np.sum(~graph.natural))} unnatural edges; test speech of 64 s")  # fmt: skip
    click.echo(f"{'stage':16}{'ours s':>10}{'naive s':>10}{'ratio':>8}{'ours MB':>10}{'naive MB':>10}   what it is")
    for stage, what in STAGES.items():
        fast = in_a_process(folder, stage, slow=False)
        line = f"{stage:16}{fast['seconds']:10.3f}"
        if stage in NAIVE and not fast_only:
            slow = in_a_process(folder, stage, slow=True)
            line += f"{slow['seconds']:10.2f}{slow['seconds'] / fast['seconds']:8.0f}"
            line += f"{fast['megabytes']:10.0f}{slow['megabytes']:10.0f}"
        else:
            line += f"{'-':>10}{'-':>8}{fast['megabytes']:10.0f}{'-':>10}"
        click.echo(f"{line}   {what}")


@click.command()
@click.option(
    "--seconds", multiple=True, type=float, default=(63.0, 427.0), show_default=True, help="Reference lengths."
)
@click.option("--fast-only", is_flag=True, help="Leave out the naive implementation.")
@click.option("--measure", "one", nargs=3, hidden=True)
def main(seconds: tuple[float, ...], fast_only: bool, one: tuple[str, str, str] | None) -> None:
    """Time and peak memory of each stage, beside the obvious implementation, on one core."""
    if one:
        folder, stage, kind = one
        click.echo(json.dumps(measure(Path(folder), stage, kind == "naive")))
        return
    for length in seconds:
        show(length, make_data(length), fast_only)


if __name__ == "__main__":
    main()

"""`reenact`: graphs and speeches to motion (§4.2)."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import lru_cache, partial

from gesturegen import __version__, clips, files, keynodes, render, submission
from gesturegen.config import Config
from gesturegen.graph import motion_graph
from gesturegen.methods import METHODS
from gesturegen.motion.skeleton import Motion
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import (
    Summary,
    chosen_references,
    clip_path,
    digests,
    graph_name,
    graph_path,
    load_references,
    read_index,
    require_writable,
    work_path,
)
from gesturegen.randomness import generator


def reenact(config: Config, jobs: int, quiet: bool, reuse: bool = False) -> Summary:
    """Search and render every test clip; write BVH, trace and manifest (§4.2).

    reuse : keep written clips whose graph, speech and settings have not changed
    """
    index = read_index(config)
    chosen = chosen_references(config, index)
    folder = work_path(config, "reenact")
    require_writable(folder)
    outcome = for_each(
        {test: partial(_reenact_clip, test, names, config, reuse) for test, names in chosen.items()},
        jobs,
        "reenact",
        quiet,
    )
    rows = [done["row"] for done in outcome.done.values()]
    outcome.errors |= {name: f"failed in preprocess: {error}" for name, error in index["failed"].items()}
    for name, error in (outcome.errors | dict.fromkeys(outcome.bugs, "a bug of gesturegen")).items():
        submission.remove_clip(folder, name)
        rows.append({"clip": name, "references": list(chosen.get(name, ())), "stuck": False, "error": error})
    files.write_json(folder / "manifest.json", submission.manifest(rows, config, folder))
    summary = Summary(outcome, written=[folder])
    summary.warnings = [(name, note) for name, done in outcome.done.items() for note in done["notes"]]
    for row in rows:
        if row["stuck"]:
            del outcome.done[row["clip"]]
            outcome.errors[row["clip"]] = row["error"]
    summary.lines = [_describe_row(done["row"]) for done in outcome.done.values()]
    return summary


@lru_cache(maxsize=1)
def _library(
    config_json: str, names: tuple[str, ...], clip_digests: tuple[str, ...], _graph_digest: str
) -> tuple[list[clips.Reference], motion_graph.MotionGraph]:
    """References and graph; a worker keeps the last ones, since test clips often share them."""
    config = Config.model_validate_json(config_json)
    graph = motion_graph.load(graph_path(config, graph_name(names)), config, clip_digests)
    return load_references(config, names), graph


def _reenact_clip(test: str, names: tuple[str, ...], config: Config, reuse: bool) -> dict:
    folder = work_path(config, "reenact")
    stored_graph = graph_path(config, graph_name(names))
    clip_digests = digests(config, names)
    graph_digest = files.sha256(stored_graph) if stored_graph.is_file() else ""
    made_of = (__version__, config.signature(), test, *clip_digests, graph_digest, *digests(config, [test]))
    inputs = hashlib.sha256("\n".join(made_of).encode()).hexdigest()
    trace = submission.read_trace_if_current(folder, test, inputs) if reuse else None
    if trace is None:
        references, graph = _library(config.model_dump_json(by_alias=True), names, clip_digests, graph_digest)
        trace, motion = gesture(test, references, graph, config)
        submission.write_clip(folder, test, motion, {**trace, "inputs": inputs})
    return {"row": submission.clip_row(trace), "notes": trace["notes"]}


def gesture(
    test: str, references: Sequence[clips.Reference], graph: motion_graph.MotionGraph, config: Config
) -> tuple[dict, Motion | None]:
    """The trace of one test clip and its motion, None where the search got stuck."""
    speech = clips.load(clip_path(config, test), config, with_motion=False).test_speech(config)
    key_nodes = keynodes.of_speech(speech, config.keywords.words)
    path = METHODS[config.method].search(graph, speech, config, generator(config.seed, test))
    trace = submission.make_trace(path, graph, graph_name(graph.clip_names), speech, key_nodes, config)
    return trace, render.render(path, references, graph, config) if path.failure is None else None


def _describe_row(row: dict) -> str:
    fallbacks = ", ".join(f"{count} {kind}" for kind, count in row["fallbacks"].items()) or "none"
    return (
        f"{row['clip']}: {row['n_frames']} frames, {row['pieces']} pieces, {row['hard_joins']} hard joins, "
        f"{row['retries']} retries, fallbacks: {fallbacks}"
    )

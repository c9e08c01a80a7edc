"""`reenact`: graphs and speeches to motion (§4.2)."""

from __future__ import annotations

from functools import lru_cache, partial
from pathlib import Path

from gesturegen import clips, files, keynodes, render, submission
from gesturegen.config import Config
from gesturegen.graph import motion_graph
from gesturegen.methods import METHODS
from gesturegen.motion import bvh
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


def reenact(config: Config, jobs: int, quiet: bool) -> Summary:
    """Search and render every test clip; write BVH, trace and manifest (§4.2)."""
    index = read_index(config)
    chosen = chosen_references(config, index)
    folder = work_path(config, "reenact")
    require_writable(folder)
    outcome = for_each(
        {test: partial(_reenact_clip, test, names, config) for test, names in chosen.items()}, jobs, "reenact", quiet
    )
    rows = [done["row"] for done in outcome.done.values()]
    outcome.errors |= {name: f"failed in preprocess: {error}" for name, error in index["failed"].items()}
    for name, error in (outcome.errors | dict.fromkeys(outcome.bugs, "a bug of gesturegen")).items():
        _remove_results(folder, name)
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


def _reenact_clip(test: str, names: tuple[str, ...], config: Config) -> dict:
    folder = work_path(config, "reenact")
    stored_graph = graph_path(config, graph_name(names))
    graph_digest = files.sha256(stored_graph) if stored_graph.is_file() else ""
    references, graph = _library(config.model_dump_json(by_alias=True), names, digests(config, names), graph_digest)
    speech = clips.load(clip_path(config, test), config, with_motion=False).test_speech(config)
    key_nodes = keynodes.of_speech(speech, config.keywords.words)
    path = METHODS[config.method].search(graph, speech, config, generator(config.seed, test))
    trace = submission.make_trace(path, graph, graph_name(names), speech, key_nodes, config)
    if path.failure is None:
        bvh.write(folder / f"{test}.bvh", render.render(path, references, graph, config))
    else:
        _remove_results(folder, test)
    files.write_text(folder / f"{test}.trace.json", submission.format_trace(trace))
    lacking = sorted(set(key_nodes.keywords.tolist()) - set(graph.key_nodes.keywords.tolist()))
    row = submission.clip_row(trace)
    notes = []
    if lacking and config.termination.fallbacks:
        notes.append(f"keywords that its references lack, so those pieces end at onsets: {', '.join(lacking)}")
    repeats = row["fallbacks"].get("repeat", 0)
    if repeats:
        notes.append(f"{repeats} of {row['pieces']} pieces hold one pose, because no path fits; give longer references")
    return {"row": row, "notes": notes}


def _remove_results(folder: Path, name: str) -> None:
    """Results of an earlier run must not pass for this one's."""
    for suffix in (".bvh", ".trace.json"):
        (folder / f"{name}{suffix}").unlink(missing_ok=True)


def _describe_row(row: dict) -> str:
    fallbacks = ", ".join(f"{count} {kind}" for kind, count in row["fallbacks"].items()) or "none"
    return (
        f"{row['clip']}: {row['n_frames']} frames, {row['pieces']} pieces, {row['hard_joins']} hard joins, "
        f"{row['retries']} retries, fallbacks: {fallbacks}"
    )

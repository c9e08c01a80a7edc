"""The command `inspect`: describe one graph, gesture database, trace or BVH file."""

from __future__ import annotations

import json
from difflib import get_close_matches
from functools import partial
from pathlib import Path

from gesturegen import files, submission
from gesturegen.errors import DataError
from gesturegen.extras import need
from gesturegen.frames import ReferenceFrames
from gesturegen.inspection import plots, skeletons, traces
from gesturegen.methods import libraries
from gesturegen.outcome import Outcome
from gesturegen.pipeline.common import Summary
from gesturegen.settings.models import Config
from gesturegen.trace import Trace
from gesturegen.workspace import library_name, library_path, work_path

_TRACE = ".trace.json"


def inspect(config: Config, target: str, plot: Path | None = None, as_json: bool = False) -> Summary:
    """Describe a BVH file, a graph or database (`.npz`), a trace (`.trace.json`) or the clip of that name in the work folder.

    A name that stands for both is the test clip's trace. plot : a PNG to write
    """
    if plot is not None:
        need("matplotlib", "video")
    path = _find(config, target)
    warnings = []
    if path.suffix.lower() == ".bvh":
        if plot is not None:
            raise DataError(f"{path}: of this there is no plot; leave out --plot, or use `gesturegen render`")
        facts = skeletons.describe_skeleton(path, config)
        lines = skeletons.skeleton_lines(facts)
        warnings = [(path.stem, note) for note in facts["notes"]]
    elif path.suffix == ".npz":
        method = libraries.method_of(path)
        found = method.inspect(libraries.load(path, method))
        facts, lines = found.facts, list(found.lines)
        if found.draw is not None:
            draw = partial(found.draw, path.stem)
        elif plot is not None:
            raise DataError(f"{path}: of this there is no plot; leave out --plot")
    else:
        trace = submission.read_trace(path)
        library, lack = _library_of(config, path, trace)
        described = traces.describe_trace(trace, library)
        if lack:
            warnings.append((trace.clip, lack))
        facts, lines = described.model_dump(), traces.trace_lines(described)
        draw = partial(plots.plot_trace, trace)
    printed = [json.dumps(facts, indent=1, ensure_ascii=False)] if as_json else lines
    summary = Summary(Outcome(), warnings, lines=printed)
    if plot is not None:
        files.write_bytes(plot, draw)
        # What is printed must stay one JSON document.
        summary.written = [] if as_json else [plot]
    return summary


def _find(config: Config, target: str) -> Path:
    path = Path(target)
    if path.is_file():
        if path.suffix.lower() not in (".npz", ".bvh") and not path.name.endswith(".json"):
            raise DataError(
                f"{path}: neither a graph or database (.npz), a trace ({_TRACE}) nor a BVH file; give one of these"
            )
        return path
    # The clip of a name has a graph of that name, or what the configured method names otherwise.
    graphs_of = (target, library_name(config, [target]))
    for place in (work_path(config, "reenact", target + _TRACE), *(library_path(config, name) for name in graphs_of)):
        if place.is_file():
            return place
    known = [p.name.removesuffix(_TRACE) for p in sorted(work_path(config, "reenact").glob(f"*{_TRACE}"))]
    known += [p.stem for p in sorted(work_path(config, "graphs").glob("*.npz"))]
    longer = [name for name in known if name.startswith(target)]
    near = longer or get_close_matches(target, known, n=1, cutoff=0.3)
    hint = f"nearest is {near[0]}" if near else "run `gesturegen reenact` first"
    raise DataError(f"{target}: no such file, and no trace or graph of that name in {config.paths.work}; {hint}")


def _library_of(config: Config, path: Path, trace: Trace) -> tuple[ReferenceFrames | None, str]:
    """Read the library of a trace, of its run or else of the work folder; None, and what is lacking, without one."""
    name = trace.graph
    places = (path.resolve().parent.parent / "graphs" / f"{name}.npz", library_path(config, name))
    found = next((place for place in places if place.is_file()), None)
    library = None if found is None else libraries.read(found)
    if library is not None and traces.is_of(trace, library):
        return library, ""
    lack = "not there" if library is None else "another one now"
    return None, f"its graph {name} is {lack}, so source frames count from the start of each kept clip"

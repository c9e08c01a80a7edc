"""`inspect`: the figures of one graph or one trace."""

from __future__ import annotations

import json
from difflib import get_close_matches
from pathlib import Path

from gesturegen import files
from gesturegen.config import Config
from gesturegen.errors import DataError
from gesturegen.extras import need
from gesturegen.graph import motion_graph
from gesturegen.inspection import graphs, plots, traces
from gesturegen.parallel import Outcome
from gesturegen.pipeline.common import Summary, graph_path, work_path

_TRACE = ".trace.json"


def inspect(config: Config, target: str, plot: Path | None = None, as_json: bool = False) -> Summary:
    """Describe a graph (`.npz`), a trace (`.trace.json`) or the clip of that name in the work folder.

    A name that stands for both is the test clip's trace. plot : a PNG to write
    """
    if plot is not None:
        need("matplotlib", "video")
    path = _find(config, target)
    if path.suffix == ".npz":
        graph = _load_graph(path)
        facts = graphs.describe_graph(graph)
        lines = graphs.graph_lines(facts)
        draw = lambda file: plots.plot_graph(graph, path.stem, file)  # noqa: E731
    else:
        trace = files.read_json(path)
        stored = None
        try:
            stored = _graph_of(config, path, trace)
            facts = traces.describe_trace(trace, stored and _load_graph(stored))
        except (KeyError, TypeError, IndexError) as error:
            raise DataError(
                f"{path}: no trace of gesturegen ({error!r} is missing); run `gesturegen reenact`"
            ) from None
        lines = traces.trace_lines(facts)
        draw = lambda file: plots.plot_trace(trace, file)  # noqa: E731
    summary = Summary(Outcome(), lines=[json.dumps(facts, indent=1, ensure_ascii=False)] if as_json else lines)
    if path.suffix == ".json" and stored is None:
        note = f"its graph {trace['graph']} is not there, so source frames count from the start of each kept clip"
        summary.warnings.append((trace["clip"], note))
    if plot is not None:
        files.write_bytes(plot, draw)
        # What is printed must stay one JSON document.
        summary.written = [] if as_json else [plot]
    return summary


def _find(config: Config, target: str) -> Path:
    path = Path(target)
    if path.is_file():
        if path.suffix != ".npz" and not path.name.endswith(".json"):
            raise DataError(f"{path}: neither a graph (.npz) nor a trace ({_TRACE}); give one of these")
        return path
    for place in (work_path(config, "reenact", target + _TRACE), graph_path(config, target)):
        if place.is_file():
            return place
    known = [p.name.removesuffix(_TRACE) for p in sorted(work_path(config, "reenact").glob(f"*{_TRACE}"))]
    known += [p.stem for p in sorted(work_path(config, "graphs").glob("*.npz"))]
    near = get_close_matches(target, known, n=1, cutoff=0.3)
    hint = f"nearest is {near[0]}" if near else "run `gesturegen reenact` first"
    raise DataError(f"{target}: no such file, and no trace or graph of that name in {config.paths.work}; {hint}")


def _load_graph(path: Path) -> motion_graph.MotionGraph:
    if not files.read_arrays(path, only=("indptr",)):
        raise DataError(f"{path}: a clip or other arrays, not a graph; graphs are in the folder `graphs`")
    return motion_graph.load(path)


def _graph_of(config: Config, path: Path, trace: dict) -> Path | None:
    """The graph that a trace was found in: of the run it lies in, else of the work folder."""
    places = (path.resolve().parent.parent / "graphs" / f"{trace['graph']}.npz", graph_path(config, trace["graph"]))
    return next((place for place in places if place.is_file()), None)

"""`build-graph`: clips to graphs (§4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from gesturegen.config import Config
from gesturegen.graph import motion_graph
from gesturegen.methods import METHODS
from gesturegen.parallel import for_each
from gesturegen.pipeline.common import (
    Summary,
    chosen_references,
    digests,
    graph_name,
    graph_path,
    load_references,
    read_index,
    require_writable,
    work_path,
)
from gesturegen.pipeline.memory import require_memory


def build_graphs(config: Config, jobs: int, quiet: bool, reuse: bool = False) -> Summary:
    """Build the graph of every group of references that a test clip is given (§4.1).

    reuse : keep stored graphs whose clips and settings have not changed
    """
    index = read_index(config)
    chosen = chosen_references(config, index)
    groups = {graph_name(names, config.references.seconds): names for names in chosen.values()}
    # Searching needs more than building: better to hear of it now than after the graphs have been built.
    jobs, warnings = require_memory(config, chosen, index, jobs, tasks=len(groups))
    require_writable(work_path(config, "graphs"))
    outcome = for_each(
        {name: partial(_build_graph, names, config, reuse) for name, names in groups.items()},
        jobs,
        "build-graph",
        quiet,
    )
    summary = Summary(outcome, warnings, written=[work_path(config, "graphs")])
    summary.lines = [f"{name}: {line}" for name, line in outcome.done.items()]
    return summary


def _build_graph(names: Sequence[str], config: Config, reuse: bool) -> str:
    path = graph_path(config, graph_name(names, config.references.seconds))
    clip_digests = digests(config, names)
    graph = motion_graph.load_if_current(path, config, clip_digests) if reuse else None
    if graph is None:
        graph = METHODS[config.method].build(load_references(config, names), config)
        motion_graph.save(path, graph, config, clip_digests)
    kinds = ", ".join(f"{int(np.sum(graph.key_nodes.kinds == kind))} {kind}" for kind in ("onset", "keyword", "break"))
    return (
        f"{graph.n_nodes} nodes, {int(np.sum(graph.natural))} natural and {int(np.sum(~graph.natural))} unnatural edges, "
        f"key nodes: {kinds}"
    )

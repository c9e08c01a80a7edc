"""The figures of an experiment: of a clip, of a run (one setup at one seed), then mean and spread over seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gesturegen import evaluation, viewer
from gesturegen.evaluation import Joints
from gesturegen.experiment.presets import Preset
from gesturegen.frames import ReferenceFrames
from gesturegen.metrics.measures import Measure
from gesturegen.metrics.usage import training_utilisation
from gesturegen.settings.models import Config
from gesturegen.trace import Trace

NAN = float("nan")
# Measures of all motions of a run together, beside the Fréchet distances of windows, which go with them.
POOLED = {"hellinger", "cca"}
_FALLBACKS = tuple(f"fallback_{kind}" for kind in ("keyword", "discard", "repeat", "kind", "edge", "scale"))
_COUNTS = ("pieces", "natural_joins", "retries", *_FALLBACKS)
# What is told of every clip, whatever the columns.
_FACTS = (
    "setup", "seed", "clip", "references", "graph", "failure", "stuck_at", "unnatural_edges", "seconds",
    "reference_seconds", "lacking_keywords", *_COUNTS, *viewer.KEYS,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Setup:
    """One row of the table: by seed, and mean and spread (sample standard deviation) over the seeds."""

    by_seed: dict[int, dict[str, float]]
    mean: dict[str, float]
    spread: dict[str, float]


@dataclass(frozen=True, eq=False)
class Result:
    """A whole experiment.

    columns : of the table; setups : by name, in order; n_clips : test clips of each run
    signature : what produced it; clips : one row per setup, seed and clip
    beside : rows of what the setups are to be compared with (`viewer.beside_totals`)
    """

    preset: Preset
    columns: Sequence[Measure]
    setups: dict[str, Setup]
    n_clips: int
    signature: dict
    clips: list[dict] = field(default_factory=list)
    beside: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def clip_row(trace: Trace, graph: ReferenceFrames, measured: Mapping[str, float]) -> dict:
    """Gather what is known of one clip of a run.

    measured : its figures, `evaluation.failed_row` for a stuck clip

    What a stuck clip did until it got stuck is left out: it would count hundreds of vain retries, and fewer
    pieces than there are.
    """
    graph_keywords = set(graph.key_nodes.keywords.tolist())
    row = {
        "graph": trace.graph,
        "stuck_at": trace.failure and trace.failure.model_dump(),
        "unnatural_edges": graph.n_unnatural_edges,
        "seconds": trace.seconds,
        "reference_seconds": graph.n_nodes / graph.fps,
        # A key node at frame 0 ends no piece.
        "lacking_keywords": sorted(
            {node.keyword for node in trace.key_nodes if 0 < node.frame < trace.n_frames}
            - graph_keywords - {""}
        ),
    }  # fmt: skip
    if measured["failure"]:
        return row | dict(measured) | dict.fromkeys(_COUNTS, NAN)
    kinds = [f"fallback_{piece.fallback}" for piece in trace.pieces]
    return row | dict(measured) | {
        "pieces": len(trace.pieces),
        "natural_joins": sum(join.natural for join in trace.joins),
        "retries": trace.n_retries,
        **{kind: kinds.count(kind) for kind in _FALLBACKS},
    }  # fmt: skip


def shown(row: Mapping, columns: Sequence[Measure]) -> dict:
    """Choose what of a clip's row is written: facts, and the figures that the table has columns for."""
    keys = dict.fromkeys((*_FACTS, *(column.key for column in columns)))
    return {key: row[key] for key in keys if key in row}


def run_figures(
    rows: Sequence[dict], pairs: Sequence[tuple[Joints, Joints]], columns: Sequence[Measure], config: Config,
    seconds: Mapping[str, float], training_seconds: float,
) -> dict[str, float]:  # fmt: skip
    """Sum up one run as `evaluate` does, and what that does not know as the columns say.

    rows : of all its clips; those that have an output are given their `utilisation`
    pairs : motions and their truths, where any column pools them
    seconds : duration of each reference clip; training_seconds : of the whole set
    """
    total = evaluation.totals(rows, [motion for motion, _ in pairs], [truth for _, truth in pairs], config)
    for column in columns:
        if column.key not in total:
            total[column.key] = column.sum_up([row.get(column.key, NAN) for row in rows])
    total["unnatural_edges"] = float(sum({row["graph"]: row["unnatural_edges"] for row in rows}.values()))
    moving = [row for row in rows if not row["failure"]]
    rest = max(training_seconds - sum(seconds.values()), 0.0)
    used = training_utilisation([row["references"] for row in moving], {**seconds, "": rest})
    for row, share in zip(moving, used.per_clip, strict=True):
        row["utilisation"] = float(share)
    total["utilisation"] = used.overall
    return total


def over_seeds(by_seed: Mapping[int, Mapping[str, float]], columns: Sequence[Measure]) -> Setup:
    """Form mean and spread of a setup's runs; NaN where no run has the figure, no spread of fewer than two."""
    keys = [column.key for column in columns]
    runs = {seed: {key: run.get(key, NAN) for key in keys} for seed, run in by_seed.items()}
    mean, spread = dict.fromkeys(keys, NAN), dict.fromkeys(keys, NAN)
    for key in keys:
        values = np.array([run[key] for run in runs.values() if np.isfinite(run[key])])
        if len(values):
            mean[key] = float(values.mean())
        if len(values) > 1:  # equal figures differ from their mean by its rounding
            spread[key] = float(values.std(ddof=1)) if np.ptp(values) > 0 else 0.0
    return Setup(runs, mean, spread)


def durations(whole: Mapping[str, float], limit: float | None, chosen: Mapping[str, Sequence[str]]) -> dict[str, float]:
    """Tell how many seconds of each reference clip count, of a cut one only those that are used.

    whole : seconds of every clip; limit : `references.seconds`; chosen : the references of each test clip, in order
    """
    if limit is None:
        return dict(whole)
    used: dict[str, float] = {}
    for names in chosen.values():
        left = limit
        for name in names:
            used[name] = max(used.get(name, 0.0), min(whole[name], left))
            left = max(left - whole[name], 0.0)
    return dict(whole) | used

"""The figures of an ablation: of a run (one setup, one seed), then mean and spread over seeds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gesturegen import evaluation, viewer
from gesturegen.ablation import causes
from gesturegen.frames import ReferenceFrames
from gesturegen.metrics.measures import VIEWER_BLOCKS, Measure
from gesturegen.metrics.usage import training_utilisation
from gesturegen.settings.models import Config, Evaluation
from gesturegen.trace import Trace

NAN = float("nan")
PAPER_BLOCK, BEHIND_BLOCK, CAUSES_BLOCK = "Table 2", "what stands behind it", "why rows differ"
SEAMS_BLOCK, TIME_BLOCK = "seams and objective", "search time, of this machine"
BLOCKS = (PAPER_BLOCK, SEAMS_BLOCK, *VIEWER_BLOCKS, BEHIND_BLOCK, CAUSES_BLOCK, TIME_BLOCK)
# Without the Fréchet distances of windows, which take as long as a search.
RULER = Config(evaluation=Evaluation(frechet_windows=()))
FIGURES = (
    Measure("syn", "Syn cm/f ↓", PAPER_BLOCK),
    Measure("bc_distance", "BC dist s ↓", PAPER_BLOCK),
    Measure("bc_kernel", "BC kernel ↑", PAPER_BLOCK),
    Measure("div", "Div ↑", PAPER_BLOCK),
    Measure("failure", "#Failure", PAPER_BLOCK),
    Measure("hard_joins_per_minute", "hard joins/min", SEAMS_BLOCK),
    Measure("join_distance_mean", "join d mean", SEAMS_BLOCK),
    Measure("join_distance_sum", "join d sum ↓", SEAMS_BLOCK),
    Measure("seam_jerk", "seam jerk ↓", SEAMS_BLOCK),
    Measure("seam_jerk_wrists", "on wrists ↓", SEAMS_BLOCK),
    Measure("wrist_speed_ratio", "wrist speed / source", SEAMS_BLOCK),
    Measure("foot_skate_ratio", "foot skate / reference's", SEAMS_BLOCK),
    Measure("key_node_share", "key nodes met ↑", SEAMS_BLOCK),
    Measure("reference_share", "reference used ↑", SEAMS_BLOCK),
    Measure("max_uses", "max uses ↓", SEAMS_BLOCK),
    Measure("rhythm", "rhythm agreement ↑", SEAMS_BLOCK),
    Measure("rhythm_by_chance", "by chance", SEAMS_BLOCK),
    Measure("pause_share", "pauses from pauses ↑", SEAMS_BLOCK),
    Measure("pause_speed_ratio", "wrists in pauses / reference's", SEAMS_BLOCK),
    Measure("objective", "objective ↓", SEAMS_BLOCK),
    *(measure for measure in evaluation.measures(RULER) if measure.block in VIEWER_BLOCKS),
    Measure("held_share", "held frames", BEHIND_BLOCK),
    Measure("repeated_share", "re-used frames", BEHIND_BLOCK),
    Measure("fallback_keyword", "keyword fallback", BEHIND_BLOCK),
    Measure("fallback_discard", "discard", BEHIND_BLOCK),
    Measure("fallback_repeat", "repeat", BEHIND_BLOCK),
    Measure("fallback_kind", "rest for gesture", BEHIND_BLOCK),
    Measure("fallback_edge", "no edge", BEHIND_BLOCK),
    Measure("fallback_scale", "out of time scale", BEHIND_BLOCK),
    Measure("retries", "retries", BEHIND_BLOCK),
    Measure("pieces", "pieces", BEHIND_BLOCK),
    Measure("natural_joins", "natural joins", BEHIND_BLOCK),
    Measure("unnatural_edges", "unnatural edges", BEHIND_BLOCK),
    Measure("utilisation", "of training set", BEHIND_BLOCK),
    Measure("seams_per_minute", "seams/min", CAUSES_BLOCK),
    Measure("syn_at_seams", "Syn at seams", CAUSES_BLOCK),
    Measure("syn_elsewhere", "Syn elsewhere", CAUSES_BLOCK),
    Measure("div_at_seams", "Div at seams", CAUSES_BLOCK),
    Measure("div_elsewhere", "Div elsewhere", CAUSES_BLOCK),
    Measure("beats_per_second", "motion beats/s", CAUSES_BLOCK),
    Measure("bc_by_chance", "BC kernel by chance", CAUSES_BLOCK),
    Measure("search_seconds", "s per clip", TIME_BLOCK),
)
# The one figure that no second run repeats.
MEASURED_TIME = "search_seconds"
FALLBACKS = ("keyword", "discard", "repeat", "kind", "edge", "scale")
# Sums and maxima over the clips of a run; the others are means over its clips that have an output.
_SUMS = {"failure", *(f"fallback_{kind}" for kind in FALLBACKS), "retries", "pieces", "natural_joins"}
_MAXIMA = {"max_uses", "still_longest"}

# Table 2 as printed, on 70 clips. Its one BC fits neither of our two measures (README).
PAPER_CLIPS = 70
PAPER = {
    "weak_detection": {"syn": 0.61393, "bc": 0.021577, "div": 0.06101, "failure": 0},
    "weak_pruning": {"syn": 0.57947, "bc": 0.022278, "div": 0.05795, "failure": 0},
    "weak_initialization": {"syn": 0.58290, "bc": 0.021982, "div": 0.06639, "failure": 0},
    "no_termination_fallback": {"syn": NAN, "bc": NAN, "div": NAN, "failure": 51},
    "full": {"syn": 0.57866, "bc": 0.022087, "div": 0.07461, "failure": 0},
}


@dataclass(frozen=True, eq=False)
class Setup:
    """One row of the table: by seed, and mean and spread (sample standard deviation) over the seeds."""

    by_seed: dict[int, dict[str, float]]
    mean: dict[str, float]
    spread: dict[str, float]


@dataclass(frozen=True, eq=False)
class Result:
    """A whole ablation.

    setups : by name, in order; n_clips : test clips of each run
    signature : what produced it; clips : one row per setup, seed and clip
    beside : rows of what the setups are to be compared with (`viewer.beside_totals`)
    """

    setups: dict[str, Setup]
    n_clips: int
    signature: dict
    clips: list[dict] = field(default_factory=list)
    beside: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def clip_row(trace: Trace, graph: ReferenceFrames, measured: Mapping[str, float] | None) -> dict:
    """The figures of one clip of a run.

    measured : of its motion, by `evaluation.measure_clip` and `causes.measure`, the `objective` of its path and the
    `search_seconds` it took; None for a stuck clip.

    What a stuck clip did until it got stuck is left out: it would count hundreds of vain retries, and fewer
    pieces than there are.
    """
    row = {
        "references": [reference.clip for reference in trace.references],
        "graph": trace.graph,
        "failure": int(measured is None),
        "stuck_at": trace.failure and trace.failure.model_dump(),
        "unnatural_edges": graph.n_unnatural_edges,
        "seconds": trace.seconds,
        "reference_seconds": graph.n_nodes / graph.fps,
    }
    graph_keywords = set(graph.key_nodes.keywords.tolist())
    # A key node at frame 0 ends no piece.
    row["lacking_keywords"] = sorted(
        {node.keyword for node in trace.key_nodes if 0 < node.frame < trace.n_frames}
        - graph_keywords - {""}
    )  # fmt: skip
    if measured is None:
        return row | {figure.key: NAN for figure in FIGURES if figure.key not in (*row, "utilisation")}
    shown = [
        "syn", "bc_distance", "bc_kernel", "div", "held_share", "repeated_share", *causes.KEYS, MEASURED_TIME,
        *(figure.key for figure in FIGURES if figure.block in (SEAMS_BLOCK, *VIEWER_BLOCKS)), *viewer.KEYS,
    ]  # fmt: skip
    return row | {
        **{key: measured[key] for key in shown},
        "pieces": len(trace.pieces),
        "natural_joins": sum(join.natural for join in trace.joins),
        "retries": trace.n_retries,
        **{f"fallback_{kind}": sum(p.fallback == kind for p in trace.pieces) for kind in FALLBACKS},
    }


def run_figures(rows: Sequence[Mapping], seconds: Mapping[str, float], training_seconds: float) -> dict[str, float]:
    """The figures of one run.

    rows : of all its clips; seconds : duration of each reference clip; training_seconds : of the whole set
    """
    figures = {}
    for figure in FIGURES:
        values = np.array([row.get(figure.key, NAN) for row in rows], dtype=float)
        values = values[np.isfinite(values)]
        how = np.sum if figure.key in _SUMS else np.max if figure.key in _MAXIMA else np.mean
        figures[figure.key] = float(how(values)) if len(values) else NAN
    figures |= viewer.pooled_alignment([row for row in rows if "a2m_deviation" in row])
    figures["unnatural_edges"] = float(sum({row["graph"]: row["unnatural_edges"] for row in rows}.values()))
    rest = max(training_seconds - sum(seconds.values()), 0.0)
    references = [row["references"] for row in rows]
    figures["utilisation"] = training_utilisation(references, {**seconds, "": rest}).overall
    return figures


def over_seeds(by_seed: Mapping[int, Mapping[str, float]]) -> Setup:
    """Mean and spread of a setup's runs; NaN where no run has the figure, no spread of fewer than two."""
    mean, spread = {}, {}
    for figure in FIGURES:
        values = [run[figure.key] for run in by_seed.values() if not math.isnan(run[figure.key])]
        mean[figure.key] = float(np.mean(values)) if values else NAN
        spread[figure.key] = NAN
        if len(values) > 1:  # equal figures differ from their mean by its rounding
            spread[figure.key] = float(np.std(values, ddof=1)) if np.ptp(values) > 0 else 0.0
    return Setup({seed: dict(run) for seed, run in by_seed.items()}, mean, spread)

"""The presets of an experiment, `ablate` and `compare`: what each measures and writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from gesturegen.metrics.measures import VIEWER_BLOCKS, Measure, measures
from gesturegen.settings.models import Config

PAPER_BLOCK, BEHIND_BLOCK, CAUSES_BLOCK = "Table 2", "what stands behind it", "why rows differ"
SEAMS_BLOCK, TIME_BLOCK = "seams and objective", "search time, of this machine"
MACHINE_BLOCK = "time and memory, of this machine"
ABLATION_COLUMNS = (
    Measure("syn", "Syn cm/f ↓", PAPER_BLOCK),
    Measure("bc_distance", "BC dist s ↓", PAPER_BLOCK),
    Measure("bc_kernel", "BC kernel ↑", PAPER_BLOCK),
    Measure("div", "Div ↑", PAPER_BLOCK),
    Measure("failure", "#Failure", PAPER_BLOCK, "sum"),
    Measure("hard_joins_per_minute", "hard joins/min", SEAMS_BLOCK),
    Measure("join_distance_mean", "join d mean", SEAMS_BLOCK),
    Measure("join_distance_sum", "join d sum ↓", SEAMS_BLOCK),
    Measure("seam_jerk", "seam jerk ↓", SEAMS_BLOCK),
    Measure("seam_jerk_wrists", "on wrists ↓", SEAMS_BLOCK),
    Measure("wrist_speed_ratio", "wrist speed / source", SEAMS_BLOCK),
    Measure("foot_skate_ratio", "foot skate / reference's", SEAMS_BLOCK),
    Measure("key_node_share", "key nodes met ↑", SEAMS_BLOCK),
    Measure("reference_share", "reference used ↑", SEAMS_BLOCK),
    Measure("max_uses", "max uses ↓", SEAMS_BLOCK, "maximum"),
    Measure("rhythm", "rhythm agreement ↑", SEAMS_BLOCK),
    Measure("rhythm_by_chance", "by chance", SEAMS_BLOCK),
    Measure("pause_share", "pauses from pauses ↑", SEAMS_BLOCK),
    Measure("pause_speed_ratio", "wrists in pauses / reference's", SEAMS_BLOCK),
    Measure("objective", "objective ↓", SEAMS_BLOCK),
    # Without the Fréchet distances of windows, which take as long as a search.
    *(measure for measure in measures(()) if measure.block in VIEWER_BLOCKS),
    Measure("held_share", "held frames", BEHIND_BLOCK),
    Measure("repeated_share", "re-used frames", BEHIND_BLOCK),
    Measure("fallback_keyword", "keyword fallback", BEHIND_BLOCK, "sum"),
    Measure("fallback_discard", "discard", BEHIND_BLOCK, "sum"),
    Measure("fallback_repeat", "repeat", BEHIND_BLOCK, "sum"),
    Measure("fallback_kind", "rest for gesture", BEHIND_BLOCK, "sum"),
    Measure("fallback_edge", "no edge", BEHIND_BLOCK, "sum"),
    Measure("fallback_scale", "out of time scale", BEHIND_BLOCK, "sum"),
    Measure("retries", "retries", BEHIND_BLOCK, "sum"),
    Measure("pieces", "pieces", BEHIND_BLOCK, "sum"),
    Measure("natural_joins", "natural joins", BEHIND_BLOCK, "sum"),
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
MEMORY = ("search_memory", "peak_memory")
MACHINE_COLUMNS = (
    Measure("search_seconds", "search s per clip", MACHINE_BLOCK),
    Measure("search_memory", "library and search MB", MACHINE_BLOCK),
    Measure("peak_memory", "whole process MB", MACHINE_BLOCK),
)
# What no second run repeats.
MACHINE = {measure.key for measure in MACHINE_COLUMNS}

# Table 2 as printed, on 70 clips. Its one BC fits neither of our two measures (docs/measures.md).
PAPER_CLIPS = 70
PAPER = {
    "weak_detection": {"syn": 0.61393, "bc": 0.021577, "div": 0.06101, "failure": 0},
    "weak_pruning": {"syn": 0.57947, "bc": 0.022278, "div": 0.05795, "failure": 0},
    "weak_initialization": {"syn": 0.58290, "bc": 0.021982, "div": 0.06639, "failure": 0},
    "no_termination_fallback": {"syn": float("nan"), "bc": float("nan"), "div": float("nan"), "failure": 51},
    "full": {"syn": 0.57866, "bc": 0.022087, "div": 0.07461, "failure": 0},
}


@dataclass(frozen=True)
class Preset:
    """A kind of experiment: its name, what it measures, and what it writes beside its table.

    command, folder : its command; the folder of its files, and their name
    columns : of its table, by the base config; only what they show is measured
    printed : by setup, the figures that a publication prints for it
    work_folders : the motions of the first seed become a work folder for each setup; else they are kept when asked for
    page, plot, lengths : all motions side by side; bars; figures by length of the references where setups differ in it
    """

    command: str
    folder: str
    title: str
    note: str
    columns: Callable[[Config], Sequence[Measure]]
    printed: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    work_folders: bool = False
    page: bool = False
    plot: bool = False
    lengths: bool = False


ABLATE = Preset(
    command="ablate",
    folder="ablation",
    title="Ablation (§5.2, Table 2)",
    note="mean ± standard deviation over seeds; counts are per seed, over all clips; a setup with failures is measured on "
    "the clips that have an output. The objective is the global search's, by the base config's prices for every setup. "
    "paper: Table 2 as printed, on 70 clips of GENEA 2023; its BC fits neither of ours.",
    columns=lambda _base: ABLATION_COLUMNS,
    printed=PAPER,
    plot=True,
    lengths=True,
)
COMPARE = Preset(
    command="compare",
    folder="compare",
    title="Comparison of methods",
    note="Totals over the clips, as of `evaluate` with the base config; mean ± standard deviation over seeds. Search time "
    "is that of one clip, without loading and compiling. Memory is the peak of resident memory of a fresh process that "
    "loads a library and searches for the longest clip, at the first seed: the whole process, and what that added to "
    "a process with everything imported, compiled loops included; pages of a mapped library count once looked at.",
    columns=lambda base: (*measures(base.evaluation.frechet_windows), *MACHINE_COLUMNS),
    work_folders=True,
    page=True,
)

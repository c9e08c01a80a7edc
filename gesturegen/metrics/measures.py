"""All measures in one table: the key of each in files, its heading, its block, and what stands for several clips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class Measure:
    """A column of the table: its key in files, its heading, and the block it is printed in.

    total : what stands for several clips, of their figures; measures of distributions are pooled instead
    """

    key: str
    heading: str
    block: str
    total: Literal["mean", "sum", "maximum"] = "mean"

    def sum_up(self, values: Sequence[float]) -> float:
        """Form the total of the figures of several clips; NaN where no clip has one."""
        found = np.array(values, dtype=np.float64)
        found = found[np.isfinite(found)]
        how = {"mean": np.mean, "sum": np.sum, "maximum": np.max}[self.total]
        return float(how(found)) if len(found) else float("nan")


VIEWER_BLOCK, DETECTION_BLOCK = "what a viewer complains of", "joins found by a classifier"
ALIGNMENT_BLOCK = "alignment with onsets, nearer to recorded motion is better"
FRECHET_BLOCK = "Fréchet distance over that of random stretches, 1 is as good"
VIEWER_BLOCKS = (VIEWER_BLOCK, DETECTION_BLOCK, ALIGNMENT_BLOCK, FRECHET_BLOCK)
MEASURES = (
    Measure("syn", "Syn cm/f ↓", "paper"),
    Measure("bc_distance", "BC dist s ↓", "paper"),
    Measure("bc_kernel", "BC kernel ↑", "paper"),
    Measure("rhythm", "rhythm agreement ↑", "paper"),
    Measure("rhythm_by_chance", "by chance", "paper"),
    Measure("div", "Div ↑", "paper"),
    Measure("failure", "#Failure", "paper", "sum"),
    Measure("jerk", "jerk cm/s³", "genea"),
    Measure("acceleration", "accel cm/s²", "genea"),
    Measure("hellinger", "Hellinger ↓", "genea"),
    Measure("cca", "CCA ↑", "genea"),
    Measure("hard_joins_per_minute", "hard joins/min", "seams"),
    Measure("join_distance_mean", "join d mean", "seams"),
    Measure("join_distance_max", "join d max", "seams", "maximum"),
    Measure("join_distance_sum", "join d sum ↓", "seams"),
    Measure("seam_jerk", "seam jerk ↓", "seams"),
    Measure("seam_jerk_wrists", "on wrists ↓", "seams"),
    Measure("wrist_speed_ratio", "wrist speed / source", "seams"),
    Measure("stay_seconds", "mean stay s", VIEWER_BLOCK),
    Measure("stutters_per_minute", "stutters/min ↓", VIEWER_BLOCK),
    Measure("again_share", "shown again ↓", VIEWER_BLOCK),
    Measure("still_share", "hands still", VIEWER_BLOCK),
    Measure("still_longest", "longest s", VIEWER_BLOCK, "maximum"),
    Measure("knees_straight", "knees straight", VIEWER_BLOCK),
    Measure("knee_snaps", "knee snaps/min ↓", VIEWER_BLOCK),
    Measure("seam_auc", "joins found, AUC ↓", DETECTION_BLOCK),
    Measure("seam_auc_upper", "by the upper body ↓", DETECTION_BLOCK),
    Measure("seam_auc_control", "control", DETECTION_BLOCK),
    Measure("a2m", "a2m - chance", ALIGNMENT_BLOCK),
    Measure("a2m_z", "a2m z", ALIGNMENT_BLOCK),
    Measure("hands_beat", "hands' minima - chance", ALIGNMENT_BLOCK),
    Measure("hands_beat_z", "hands z", ALIGNMENT_BLOCK),
    Measure("angle_beat", "angle change - chance", ALIGNMENT_BLOCK),
    Measure("angle_beat_z", "angle z", ALIGNMENT_BLOCK),
    Measure("foot_skate", "foot skate cm/s", "feet and pauses"),
    Measure("foot_skate_ratio", "/ reference's", "feet and pauses"),
    Measure("foot_contact_share", "contact", "feet and pauses"),
    Measure("pause_share", "pauses from pauses ↑", "feet and pauses"),
    Measure("pause_speed", "wrists in pauses cm/s", "feet and pauses"),
    Measure("pause_speed_ratio", "/ in reference's", "feet and pauses"),
    Measure("key_node_share", "key nodes met", "usage"),
    Measure("reference_share", "reference used", "usage"),
    Measure("max_uses", "max uses", "usage", "maximum"),
    Measure("repeated_share", "re-used frames", "usage"),
    Measure("held_share", "held frames", "usage"),
    Measure("utilisation", "of training set", "usage"),
)
COMPAT_MEASURES = (
    Measure("jerk", "jerk", "genea-compat"),
    Measure("acceleration", "acceleration", "genea-compat"),
    Measure("hellinger_1", "Hellinger, width 1", "genea-compat"),
    Measure("hellinger_0.05", "Hellinger, width 0.05", "genea-compat"),
)


def frechet_measures(windows: Sequence[int]) -> list[Measure]:
    return [Measure(f"frechet_{n}", f"Fréchet {n} cm² ↓", "genea") for n in windows]


def _frechet_ratios(windows: Sequence[int]) -> list[Measure]:
    return [
        *(Measure(f"frechet_{n}_ratio", f"Fréchet {n} / stretch's ↓", FRECHET_BLOCK) for n in windows),
        Measure("frechet_velocity_ratio", "velocity / stretch's ↓", FRECHET_BLOCK),
        Measure("frechet_velocity_recording_ratio", "velocity, to the recording / stretch's ↓", FRECHET_BLOCK),
    ]


def measures(windows: Sequence[int]) -> list[Measure]:
    """All columns, in order of printing."""
    listed = [*MEASURES, *_frechet_ratios(windows)]
    after = next(place for place, measure in enumerate(listed) if measure.key == "cca")
    return [*listed[:after], *frechet_measures(windows), *listed[after:]]


BY_KEY = {measure.key: measure for measure in MEASURES}

"""Figures, from traces and motions, that explain why the rows of an experiment's table differ.

A *seam* is a hard join or an unnatural edge inside a path: a place where the motion leaves its recording. What
lies within `REACH` frames of one is *at a seam*: a cross-fade reaches that far (`blend.l_blend`).
"""

from __future__ import annotations

import numpy as np

from gesturegen import evaluation
from gesturegen.frames import ReferenceFrames
from gesturegen.metrics import beats, diversity
from gesturegen.settings.models import Config
from gesturegen.trace import Trace

REACH = 8
# Evenly spread shifts of the onsets around the clip: beat consistency without any relation to the speech.
_SHIFTS = 40
KEYS = (
    "seams_per_minute", "syn_at_seams", "syn_elsewhere", "div_at_seams", "div_elsewhere", "beats_per_second",
    "bc_by_chance",
)  # fmt: skip


def measure(
    generated: evaluation.Joints, truth: evaluation.Joints | None, trace: Trace, graph: ReferenceFrames,
    onset_times: np.ndarray, config: Config,
) -> dict[str, float]:  # fmt: skip
    """Measure the figures of `KEYS` for one clip; NaN where the clip has no evidence for one."""
    seams = evaluation.seam_frames(trace, graph)
    seconds = trace.seconds
    settings = config.evaluation
    angles, speeds = diversity.turning_angles(generated.world)
    fast = (speeds[:-1] >= settings.div_speed_floor) & (speeds[1:] >= settings.div_speed_floor)
    turns = fast & (angles > np.radians(settings.div_min_angle))
    seam = near(seams, trace.n_frames)
    row = dict.fromkeys(KEYS, float("nan")) | {
        "seams_per_minute": 60.0 * len(seams) / seconds,
        # Row k of the angles is the turn at frame k + 1, of the speeds the way to it.
        "div_at_seams": _mean(turns[seam[1:-1]]),
        "div_elsewhere": _mean(turns[~seam[1:-1]]),
    }
    if truth is not None:
        true_speeds = np.linalg.norm(np.diff(truth.world, axis=0), axis=-1)
        shared = min(len(speeds), len(true_speeds))
        misfit, at_seam = np.abs(speeds[:shared] - true_speeds[:shared]), seam[1 : shared + 1]
        row |= {"syn_at_seams": _mean(misfit[at_seam]), "syn_elsewhere": _mean(misfit[~at_seam])}
    if generated.parents is not None:
        rates = beats.angle_change_rate(generated.world, generated.parents, fps=generated.fps)
        times = beats.motion_beats(rates, fps=generated.fps)
        row["beats_per_second"] = len(times) / seconds
        shifts = seconds * np.arange(1, _SHIFTS + 1) / (_SHIFTS + 1)
        row["bc_by_chance"] = _mean(
            [
                beats.beat_kernel(np.sort((onset_times + shift) % seconds), times, sigma_seconds=settings.bc_sigma)
                for shift in shifts
            ]
        )
    return row


def near(seams: np.ndarray, n_frames: int) -> np.ndarray:
    """Mark the frames within `REACH` of a seam, bool `[shape=(n_frames,)]`; the frame of a seam is the first after it."""
    found = np.zeros(n_frames, dtype=bool)
    for seam in seams:
        found[max(seam - REACH, 0) : seam + REACH] = True
    return found


def _mean(values) -> float:
    return float(np.mean(values)) if len(values) else float("nan")

"""The measures of the paper's §5.2 and of this project, computed for one clip and summed up for all clips of a run.

`metrics/` holds the pure functions; here their inputs are gathered from a motion, its audio, its truth and
its trace. A measure that lacks one of these is NaN.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from gesturegen import viewer
from gesturegen.control import hands
from gesturegen.control.measures import UNITS
from gesturegen.control.schedule import Demand, Measures, achieved
from gesturegen.data.clips import select_joints
from gesturegen.frames import ReferenceFrames
from gesturegen.joints import hand_names, settings_for
from gesturegen.metrics import (
    beats,
    diversity,
    feet,
    frechet,
    genea,
    pauses,
    seams,
    smoothness,
    stays,
    synchrony,
    usage,
)
from gesturegen.metrics import measures as table
from gesturegen.metrics.measures import Measure
from gesturegen.motion import kinematics, space
from gesturegen.motion.skeleton import Motion
from gesturegen.settings.models import Config
from gesturegen.speech import cutting, rhythm
from gesturegen.trace import Trace

NAN = float("nan")


def measures(config: Config) -> list[Measure]:
    """List all measures that the tables show, in order of printing."""
    return table.measures(config.evaluation.frechet_windows)


@dataclass(frozen=True, eq=False)
class Joints:
    """The joint positions of a motion, with what the measures need to know of its skeleton.

    world : [shape=(T, K, 3)], selected joints, cm; relative : the same seen from the pelvis, as distances are
    feet : [shape=(T, F, 3)], world; parents : [shape=(K,)], among the selected joints, None where unknown
    wrists : places of the wrist joints among the selected ones; names : of the selected joints, where they are known; hands : of left and right, by role
    curves : what a viewer's measures look at, None where only positions are known
    notes : what was taken for granted of the file
    """

    world: np.ndarray
    relative: np.ndarray
    feet: np.ndarray
    parents: np.ndarray | None
    wrists: list[int]
    fps: float
    names: tuple[str, ...] = ()
    hands: tuple[str, ...] = ()
    curves: viewer.Curves | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Heard:
    """The onsets, words and pauses of a speech, as far as they are known.

    onset_times : [shape=(K,)], seconds; words : starts and ends in seconds (onsets where a speech has none), None
    where only the sound is known; paused : bool [shape=(T,)], frames in its pauses, None likewise
    """

    onset_times: np.ndarray
    words: Sequence[tuple[float, float]] | None = None
    paused: np.ndarray | None = None

    def onset_frames(self, fps: float) -> np.ndarray:
        """Round the onsets to frames, int `[shape=(K,)]`, ascending, each once."""
        return np.unique(np.round(self.onset_times * fps).astype(int))


def locate(motion: Motion, config: Config) -> Joints:
    """Compute by forward kinematics the positions of all joints that the measures look at."""
    skeleton = motion.skeleton
    config = settings_for(skeleton, config)
    joints, _ = select_joints(skeleton, config)
    pelvis = skeleton.pelvis(config.positions.root_joint)
    names = [skeleton.names[j] for j in joints]
    foot_joints = [skeleton.names.index(name) for name in config.feet.joints if name in skeleton.names]
    parents = beats.selected_parents(skeleton.parents, joints)
    return Joints(
        world=kinematics.joint_positions(motion, joints),
        relative=config.positions.scale
        * kinematics.relative_positions(motion, joints, pelvis, config.positions.relative_to),
        feet=kinematics.joint_positions(motion, foot_joints) if foot_joints else np.empty((motion.n_frames, 0, 3)),
        parents=parents,
        wrists=[names.index(name) for name in config.wrists.joints if name in names],
        fps=motion.fps,
        names=tuple(names),
        hands=hand_names(skeleton, config),
        curves=viewer.curves_of(motion, names, joints, parents, config),
        notes=tuple(space.notes(skeleton, config)),
    )


def from_positions(positions: np.ndarray, config: Config) -> Joints:
    """Wrap bare joint positions `[shape=(T, K, 3)]`, such as other systems store; nothing else is known of them."""
    root = positions[:, :1]
    nothing = np.empty((len(positions), 0, 3))
    return Joints(positions, positions - root, nothing, None, [], float(config.fps))


def measure_clip(
    generated: Joints,
    config: Config,
    heard: Heard | None = None,
    truth: Joints | None = None,
    trace: Trace | None = None,
    graph: ReferenceFrames | None = None,
    reference_skate: float = NAN,
    recorded: Sequence[viewer.Recorded] = (),
) -> dict[str, float]:
    """Compute all measures of one clip; NaN for those that lack their inputs or need the other clips of the run.

    trace and graph : of a clip that gesturegen made; reference_skate : foot skate of its references, cm/s
    recorded : the references of which anything is shown
    """
    settings, fps = config.evaluation, generated.fps
    row = {measure.key: NAN for measure in measures(config)}
    row |= {
        "failure": 0,
        "div": diversity.direction_change_share(
            generated.world, min_angle_degrees=settings.div_min_angle, speed_floor=settings.div_speed_floor
        ),
        "jerk": smoothness.mean_jerk(generated.world, fps=fps),
        "acceleration": smoothness.mean_acceleration(generated.world, fps=fps),
    }
    if generated.feet.shape[1]:
        skate = foot_skate(generated)
        row |= {
            "foot_skate": skate.speed,
            "foot_skate_ratio": _ratio(skate.speed, reference_skate),
            "foot_contact_share": skate.contact_share,
        }
    onset_frames, paused = (heard.onset_frames(fps), heard.paused) if heard is not None else (None, None)
    statue = False
    if generated.curves is not None:
        row |= viewer.measure(generated.curves, config, onset_frames, paused)
        statue = viewer.stands_still(generated.curves, config)
    if heard is not None and generated.parents is not None and not statue:
        rates = beats.angle_change_rate(generated.world, generated.parents, fps=fps)
        times = beats.motion_beats(rates, fps=fps)
        row["bc_distance"] = beats.beat_distance(heard.onset_times, times)
        row["bc_kernel"] = beats.beat_kernel(heard.onset_times, times, sigma_seconds=settings.bc_sigma)
    if heard is not None and heard.words is not None and generated.wrists and not statue:
        row |= _measure_rhythm(generated, heard.words, config)
    if truth is not None:
        row["syn"] = synchrony.synchrony(generated.world, truth.world)
        row["cca"] = genea.canonical_correlation(generated.relative, truth.relative)
        row["hellinger"] = genea.hellinger_distance(_histogram(generated, config), _histogram(truth, config))
        row |= _frechet([generated], [truth], config)
    if trace is not None and graph is not None:
        row |= _measure_trace(generated, trace, graph, config)
        true = None if truth is None else (truth.relative, truth.curves)
        made = (generated.relative, generated.curves)
        row |= viewer.frechet_ratios(made, true, graph, recorded, config, trace.clip)
    return row


def seam_evidence(
    generated: Joints, trace: Trace, graph: ReferenceFrames, recorded: Sequence[viewer.Recorded], n_clips: int
) -> viewer.SeamEvidence:
    """Collect the frames of a clip near its joins and far from them, for `viewer.detect_seams` over a whole run."""
    by_name = {one.name: one for one in recorded}
    shown = [(by_name[name], mirrored) if name in by_name else None for name, mirrored in graph.clips]
    assert generated.curves is not None  # who has a trace has a motion, not bare positions
    return viewer.seam_evidence(
        generated.curves, seam_frames(trace, graph), trace.shown_nodes(), graph.clip_starts, shown, n_clips
    )


def _measure_rhythm(generated: Joints, words: Sequence[tuple[float, float]], config: Config) -> dict[str, float]:
    """Compare the rhythm of words and hands in 32 bits (GestureMaster §3.2), over all clips of the speech but rests.

    By chance: the same with the bits of the motion turned round within their clip, over all turns.
    """
    settings, fps = config.rhythm, generated.fps
    speeds = rhythm.hand_speeds(generated.relative[:, generated.wrists], fps, settings.smoothing_seconds)
    cuts = [cut for cut in cutting.cut(words, len(speeds), fps, config.cutting) if not cut.rest]
    if not cuts:
        return {}
    said = np.array([rhythm.of_words(words, cut.start / fps, cut.end / fps, settings) for cut in cuts])
    moved = np.array([rhythm.of_motion(speeds[cut.start : cut.end], settings) for cut in cuts])
    turned = [rhythm.agreement(said, np.roll(moved, turn, axis=1)) for turn in range(1, settings.bits)]
    return {"rhythm": rhythm.agreement(said, moved), "rhythm_by_chance": float(np.mean(turned))}


def foot_skate(joints: Joints) -> feet.FootSkate:
    """Measure the foot skate of a motion."""
    return feet.foot_skate(joints.feet, range(joints.feet.shape[1]), fps=joints.fps)


def failed_row(config: Config) -> dict[str, float]:
    """Return the row of a clip without output: a failure, and NaN for every measure."""
    return {measure.key: NAN for measure in measures(config)} | {"failure": 1}


def totals(
    rows: Sequence[Mapping[str, float]], generated: Sequence[Joints], truths: Sequence[Joints], config: Config
) -> dict[str, float]:
    """Sum up each measure over all clips: pooled where the measure compares distributions, else the mean.

    generated, truths : the clips that have a truth, in the same order.
    """
    total = {}
    for measure in measures(config):
        total[measure.key] = measure.sum_up([row[measure.key] for row in rows])
    total |= viewer.pooled_alignment([row for row in rows if "a2m_deviation" in row])
    if truths:
        pairs = list(zip(generated, truths, strict=True))
        total["hellinger"] = genea.hellinger_distance(
            reduce(np.add, [_histogram(motion, config) for motion in generated]),
            reduce(np.add, [_histogram(motion, config) for motion in truths]),
        )
        total |= _frechet(generated, truths, config)
        cut = [(a.relative[: len(b.relative)], b.relative[: len(a.relative)]) for a, b in pairs]
        total["cca"] = genea.canonical_correlation(
            np.concatenate([a for a, _ in cut]), np.concatenate([b for _, b in cut])
        )
    return total


def _histogram(joints: Joints, config: Config) -> np.ndarray:
    return genea.speed_histogram(joints.world, fps=joints.fps, bin_width=config.evaluation.hellinger_bin_width)


def _frechet(generated: Sequence[Joints], truths: Sequence[Joints], config: Config) -> dict[str, float]:
    sides = [[joints.relative for joints in side] for side in (generated, truths)]
    return {
        f"frechet_{window}": frechet.window_frechet_distance(*sides, window_frames=window)
        for window in config.evaluation.frechet_windows
    }


def _measure_trace(generated: Joints, trace: Trace, graph: ReferenceFrames, config: Config) -> dict[str, float]:
    shown = trace.shown_nodes()
    joins = seams.join_statistics(
        [join.distance for join in trace.joins],
        [join.natural for join in trace.joins],
        n_frames=trace.n_frames,
        fps=trace.fps,
    )
    use = usage.reference_use(shown, graph.n_nodes)
    settings, seam_places = config.evaluation, seam_frames(trace, graph)
    stay = stays.stays(
        shown, seam_places, graph.clip_starts, fps=trace.fps, stutter_frames=settings.stutter_frames,
        same_frames=settings.same_frames, again_seconds=settings.again_seconds,
    )  # fmt: skip
    frames = np.array([node.frame for node in trace.key_nodes], dtype=int)

    def jerk(joints: list[int] | None) -> float:
        if joints == []:
            return NAN
        return seams.seam_jerk(
            generated.relative, seam_places, shown, graph.positions, graph.segment_starts,
            fps=generated.fps, radius=settings.seam_radius, joints=joints,
        ).ratio  # fmt: skip

    return {
        "stay_seconds": stay.mean_seconds,
        "stutters_per_minute": stay.stutters_per_minute,
        "again_share": stay.again_share,
        "hard_joins_per_minute": joins.hard_per_minute,
        "join_distance_mean": joins.mean_distance,
        "join_distance_max": joins.max_distance,
        "join_distance_sum": joins.sum_distance,
        "seam_jerk": jerk(None),
        "seam_jerk_wrists": jerk(generated.wrists),
        **_measure_wrists(generated, trace, graph, shown),
        "key_node_share": usage.key_node_share(frames, shown, graph.any_stop),
        "reference_share": use.used_share,
        "max_uses": use.max_uses,
        "repeated_share": use.reused_share,
        "held_share": use.held_share,
    }


def _measure_wrists(generated: Joints, trace: Trace, graph: ReferenceFrames, shown: np.ndarray) -> dict[str, float]:
    """Compare the speeds of the wrists with those of the same reference frames and of the reference's pauses."""
    paused = np.zeros(len(shown), dtype=bool)
    for start, end in trace.pauses:
        paused[start:end] = True
    moving, recorded = generated.relative[:, generated.wrists], graph.positions[:, generated.wrists]
    everywhere = np.ones(len(shown), dtype=bool)
    in_pauses = pauses.mean_speed(moving, paused, fps=generated.fps)
    return {
        "wrist_speed_ratio": _ratio(
            pauses.mean_speed(moving, everywhere, fps=generated.fps),
            pauses.source_speed(recorded, shown, graph.segment_starts, fps=generated.fps),
        ),
        "pause_share": pauses.pause_share(paused, shown, graph.speaking),
        "pause_speed": in_pauses,
        "pause_speed_ratio": _ratio(
            in_pauses, pauses.mean_speed(recorded, ~graph.speaking, graph.segment_starts, fps=generated.fps)
        ),
    }


def _ratio(value: float, other: float) -> float:
    return value / other if other > 0 else NAN


def mean_foot_skate(skates: Sequence[tuple[feet.FootSkate, int]]) -> float:
    """Average the foot skate of several motions, each with its number of frames; cm/s, NaN if no foot is in contact."""
    weights = [skate.contact_share * frames for skate, frames in skates if np.isfinite(skate.speed)]
    speeds = [skate.speed for skate, _ in skates if np.isfinite(skate.speed)]
    return float(np.average(speeds, weights=weights)) if sum(weights) > 0 else NAN


def seam_frames(trace: Trace, graph: ReferenceFrames) -> np.ndarray:
    """Find the output frames `[shape=(K,)]` at which the right side of a hard join or of an unnatural edge starts."""
    frames = [join.frame for join in trace.joins if not join.natural]
    for piece in trace.pieces:
        nodes = np.asarray(piece.nodes)
        unnatural = np.flatnonzero((nodes[1:] != graph.successors[nodes[:-1]]) & (nodes[1:] != nodes[:-1])) + 1
        if len(nodes) > 1:
            # Node k stands at frame k (L - 1) / (n - 1) of the resampled piece.
            places = unnatural * (piece.target_length - 1) / (len(nodes) - 1)
            frames += (piece.start_frame + np.ceil(places - 1e-9).astype(int)).tolist()
    return np.unique(np.array(frames, dtype=int))


def genea_compat(
    generated: Mapping[str, Joints], truths: Mapping[str, Joints]
) -> tuple[dict[str, dict[str, float]], dict[str, float]]:
    """Compute rows and total by the conventions of the published GENEA scripts (`metrics/genea.py`)."""
    rows: dict[str, dict[str, float]] = {}
    pooled: dict[str, dict[str, np.ndarray]] = {"generated": {}, "truth": {}}
    for name, joints in generated.items():
        own = genea.genea_compat(joints.world, fps=joints.fps)
        row = {"jerk": own.jerk, "acceleration": own.acceleration, "hellinger_1": NAN, "hellinger_0.05": NAN}
        if name in truths:
            true = genea.genea_compat(truths[name].world, fps=truths[name].fps)
            row["hellinger_1"] = genea.hellinger_distance(own.histogram, true.histogram)
            row["hellinger_0.05"] = genea.hellinger_distance(own.fine_histogram, true.fine_histogram)
            for side, figures in (("generated", own), ("truth", true)):
                for width, histogram in (("1", figures.histogram), ("0.05", figures.fine_histogram)):
                    before = pooled[side].get(width)
                    pooled[side][width] = histogram if before is None else before + histogram
        rows[name] = row
    total = {
        key: float(np.mean([row[key] for row in rows.values()])) if rows else NAN for key in ("jerk", "acceleration")
    }
    for width in ("1", "0.05"):
        total[f"hellinger_{width}"] = (
            genea.hellinger_distance(pooled["generated"][width], pooled["truth"][width])
            if width in pooled["generated"]
            else NAN
        )
    return rows, total


# --- what was achieved of control ---------------------------------------------------------------------------

# Of `control_cells`: the columns of the paper's table 2 (Habibie et al. 2022), then ours.
CONTROL_HEADINGS = ("measure", "hand", "when", "asked", "mean", "deviation", "inside", "reference")


def demands_of(trace: Trace) -> tuple[Demand, ...]:
    """Rebuild the demands on the hands from a trace; none where the trace holds none."""
    return tuple(
        Demand(
            place=one.place,
            measure=one.measure,
            hand=one.hand,
            low=-math.inf if one.low is None else one.low,
            high=math.inf if one.high is None else one.high,
            start_frame=one.start_frame,
            end_frame=one.end_frame,
            hard=one.hard,
            price=one.price,
            scale=one.scale,
        )
        for one in trace.control
    )


def hand_curves(joints: Joints, config: Config) -> Measures:
    """Compute every measure of the hands in every frame of a motion, as it is computed for the nodes of a library."""
    return hands.of_positions(joints.relative, joints.names, (0,), joints.fps, config.hands, joints.hands)


def measure_control(demands: Sequence[Demand], shown: Measures, recorded: Measures, fps: float) -> list[dict[str, Any]]:
    """Measure what was achieved of each demand, ready for JSON: `Achieved` with its times in seconds.

    shown, recorded : the measures in the frames of the output and in the nodes of the references
    """
    rows = [one.row() for one in achieved(demands, shown, recorded)]
    return [row | {"from": row["start_frame"] / fps, "to": row["end_frame"] / fps} for row in rows]


def control_cells(row: Mapping) -> list[str]:
    """Format one row of `measure_control` as text, a cell for each of `CONTROL_HEADINGS`."""
    unit = UNITS[row["measure"]]
    bounds = [
        f"{words} {row[name]:.1f} {unit}"
        for name, words in (("at_least", "at least"), ("at_most", "at most"))
        if row[name] is not None
    ]
    return [
        row["measure"], row["hand"], f"{row['from']:.2f}-{row['to']:.2f} s",
        " and ".join(bounds) + ("" if row["hard"] else " (soft)"), f"{row['mean']:.1f}", f"{row['deviation']:.1f}",
        f"{row['inside']:.0%}", f"{row['reference_mean']:.1f} ± {row['reference_deviation']:.1f}",
    ]  # fmt: skip

"""Measures of what viewers complain of in a motion (still hands, knees, beats, visible joins), without truth or trace.

`evaluation` puts these together with the others; the same measures are taken of the recording itself, of the truth,
of random stretches of the recording and of a statue, which stand beside every figure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from gesturegen.frames import ReferenceFrames
from gesturegen.joints import settings_for
from gesturegen.metrics import alignment, beats, detectability, frechet, knees, stillness
from gesturegen.metrics.measures import BY_KEY
from gesturegen.motion import kinematics, mirror
from gesturegen.motion.feet import leg_of
from gesturegen.motion.skeleton import Motion
from gesturegen.randomness import generator
from gesturegen.settings.models import Config

NAN = float("nan")
# Of each reading of alignment: `_deviation` is in no table, but forms the z of several clips.
READINGS = ("a2m", "hands_beat", "angle_beat")
MOTION_KEYS = ("still_share", "still_longest", "knees_straight", "knee_snaps")
KEYS = (*MOTION_KEYS, *(f"{reading}{end}" for reading in READINGS for end in ("", "_z", "_deviation")))
RECORDING, TRUTH, STRETCH, STATUE = "(recording)", "(truth)", "(random stretch)", "(statue)"
# Stretches of a recording that is hardly longer than the clip would all be the same: so much of it at most.
_LONGEST_SHARE = 0.5
# Stretches of source that the forest of the control leaves out in turn.
_SOURCE_FOLDS = 5


@dataclass(frozen=True, eq=False)
class Curves:
    """The curves of a motion that the measures are computed from, frame by frame; arrays are `[shape=(T, ...)]`.

    hand_speeds : of each hand, seen from the pelvis and its heading, cm/s; joint_speeds : of all joints, likewise
    knee_angles, knee_accelerations : degrees and degrees/s^2
    velocities : of hands and head, relative to the pelvis, cm/s
    joint_beats, hand_beats, angle_beats : bool, motion beats of the three readings, a column for each list
    seam_positions : float32, world, of the joints by which joins are looked for, cm; seam_names : theirs
    """

    hand_speeds: np.ndarray
    joint_speeds: np.ndarray
    knee_angles: np.ndarray
    knee_accelerations: np.ndarray
    velocities: np.ndarray
    joint_beats: np.ndarray
    hand_beats: np.ndarray
    angle_beats: np.ndarray
    seam_positions: np.ndarray
    seam_names: tuple[str, ...]
    fps: float

    @property
    def n_frames(self) -> int:
        """Count the frames of the motion."""
        return len(self.hand_speeds)

    def take(self, frames: np.ndarray) -> Curves:
        """Select the curves at given frames, with the speeds that were recorded there."""
        arrays = [field.name for field in fields(self) if field.type == "np.ndarray"]
        return replace(self, **{name: getattr(self, name)[frames] for name in arrays})

    def held(self, n_frames: int) -> Curves:
        """Return the curves of a statue in the pose of the middle frame."""
        statue = self.take(np.full(n_frames, self.n_frames // 2))
        moving = ("hand_speeds", "joint_speeds", "knee_accelerations", "velocities", *_BEATS)
        still: dict[str, Any] = {name: np.zeros_like(getattr(statue, name)) for name in moving}
        return replace(statue, **still)


def joined(parts: Sequence[Curves]) -> Curves:
    """Concatenate the curves of several motions; no speed is measured from one to the next."""
    arrays = [field.name for field in fields(Curves) if field.type == "np.ndarray"]
    values: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays}
    return replace(parts[0], **values)


_BEATS = ("joint_beats", "hand_beats", "angle_beats")


def curves_of(
    motion: Motion, names: Sequence[str], joints: Sequence[int], parents: np.ndarray, config: Config
) -> Curves:
    """Compute the curves of a motion; names, joints, parents : of the joints that distances are measured on."""
    skeleton, fps = motion.skeleton, motion.fps
    config = settings_for(skeleton, config)
    pelvis = skeleton.pelvis(config.positions.root_joint)
    seen = kinematics.relative_positions(motion, list(joints), pelvis, "root_heading")
    relative = kinematics.relative_positions(motion, list(joints), pelvis, "root")
    hands = [names.index(name) for name in (config.control.left, config.control.right) if name in names]
    hands = hands or [names.index(name) for name in config.wrists.joints if name in names]
    head = detectability.joint_groups(names)["head"]
    chosen = [names.index(name) for name in config.evaluation.alignment_joints if name in names]
    speeds = alignment.speeds(relative)
    joint_beats = alignment.speed_minima(speeds[:, chosen or range(len(names))])
    hand_beats = (
        alignment.speed_minima(speeds[:, hands].mean(axis=1, keepdims=True), order=alignment.HANDS_ORDER)
        if hands
        else []
    )
    rates = beats.angle_change_rate(kinematics.joint_positions(motion, list(joints)), parents, fps=fps)
    angle_beats = np.round(beats.motion_beats(rates, fps=fps) * fps).astype(int)
    angles = knees.knee_angles(_legs(motion, config))
    marked = [name for name in config.evaluation.seam_joints if name in skeleton.names]
    places = [skeleton.names.index(name) for name in marked]
    return Curves(
        hand_speeds=stillness.hand_speeds(seen[:, hands], fps=fps),
        joint_speeds=stillness.hand_speeds(seen, fps=fps).max(axis=1, keepdims=True, initial=0.0),
        knee_angles=angles,
        knee_accelerations=knees.knee_accelerations(angles, fps=fps),
        velocities=_velocities(relative[:, [*hands, *head]], fps),
        joint_beats=_marks(joint_beats, motion.n_frames),
        hand_beats=_marks(hand_beats, motion.n_frames),
        angle_beats=_marks([angle_beats], motion.n_frames),
        seam_positions=(kinematics.joint_positions(motion, places) if places else np.empty((motion.n_frames, 0, 3))).astype(np.float32),
        seam_names=tuple(marked),
        fps=fps,
    )  # fmt: skip


def _legs(motion: Motion, config: Config) -> np.ndarray:
    """Compute the positions of hip, knee and ankle of each leg `[shape=(T, L, 3, 3)]`."""
    feet = [motion.skeleton.names.index(name) for name in config.feet.joints if name in motion.skeleton.names]
    legs = [leg for foot in feet if (leg := leg_of(motion.skeleton, foot)) is not None]
    if not legs:
        return np.empty((motion.n_frames, 0, 3, 3))
    places = [joint for leg in legs for joint in (leg.hip, leg.knee, leg.ankle)]
    return kinematics.joint_positions(motion, places).reshape(motion.n_frames, len(legs), 3, 3)


def _velocities(positions: np.ndarray, fps: float) -> np.ndarray:
    steps = np.diff(positions, axis=0, prepend=positions[:1]) * fps
    if len(steps) > 1:
        steps[0] = steps[1]
    return steps.reshape(len(steps), -1)


def _marks(lists: Sequence[np.ndarray], n_frames: int) -> np.ndarray:
    """Convert lists of frames to columns of bool `[shape=(n_frames, L)]`."""
    marks = np.zeros((n_frames, len(lists)), dtype=bool)
    for column, frames in enumerate(lists):
        marks[frames, column] = True
    return marks


# --- measures -----------------------------------------------------------------------------------------------


def nothing() -> dict[str, float]:
    return dict.fromkeys(KEYS, NAN)


def stands_still(curves: Curves, config: Config) -> bool:
    """Tell whether the hands, or all joints where hands are unknown, are still for over half of the clip."""
    limits = {"speed": config.evaluation.still_speed, "seconds": config.evaluation.still_seconds}
    speeds = curves.hand_speeds if curves.hand_speeds.shape[1] else curves.joint_speeds
    return stillness.is_statue(speeds, fps=curves.fps, **limits)


def measure(
    curves: Curves, config: Config, onset_frames: np.ndarray | None = None, paused: np.ndarray | None = None
) -> dict[str, float]:
    """Measure still hands, knees and the alignment with the speech of a motion.

    onset_frames : of its speech, None where that is unknown; paused : bool, pauses of the speech, of any length
    """
    settings, fps, n_frames = config.evaluation, curves.fps, curves.n_frames
    if paused is not None:
        paused = np.pad(paused[:n_frames], (0, max(n_frames - len(paused), 0)), constant_values=True)
    still = stillness.stillness(
        curves.hand_speeds, paused, fps=fps, speed=settings.still_speed, seconds=settings.still_seconds
    )
    legs = knees.knees(
        curves.knee_angles, curves.knee_accelerations, fps=fps, straight_degrees=settings.knee_straight_degrees,
        snap_acceleration=settings.knee_snap_acceleration,
    )  # fmt: skip
    row = nothing() | dict(zip(MOTION_KEYS, (*still, *legs), strict=True))
    if onset_frames is None or stands_still(curves, config):
        return row
    for reading, marks, sigma in zip(
        READINGS, (getattr(curves, name) for name in _BEATS),
        (alignment.MINIMA_SIGMA, alignment.MINIMA_SIGMA, settings.bc_sigma), strict=True,
    ):  # fmt: skip
        lists = [np.flatnonzero(column) for column in marks.T]
        row |= _reading(reading, alignment.surplus(onset_frames, lists, n_frames, fps=fps, sigma_seconds=sigma))
    return row


def _reading(reading: str, found: alignment.Surplus) -> dict[str, float]:
    return {reading: found.surplus, f"{reading}_z": found.z, f"{reading}_deviation": found.deviation}


def pooled_alignment(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Pool surplus and z of several clips, each reading by `alignment.together`; rows as of `measure`."""
    found: dict[str, float] = {}
    for reading in READINGS:
        clips = [alignment.Surplus(row[reading], row[f"{reading}_deviation"], row[f"{reading}_z"]) for row in rows]
        pooled = alignment.together(clips)
        found |= {reading: pooled.surplus, f"{reading}_z": pooled.z}
    return found


def total(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Sum up the figures of several clips: all of `KEYS` but the deviations."""
    return _means(rows) | pooled_alignment(rows)


def _means(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    keys = [key for key in KEYS if not key.endswith("_deviation")]
    return {key: BY_KEY[key].sum_up([row[key] for row in rows]) for key in keys}


# --- what stands beside -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Recorded:
    """A reference recording: its curves, and their measures with its own speech."""

    name: str
    curves: Curves
    row: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Beside:
    """The figures that one clip is compared with.

    recordings : measures of each reference that is shown, with its own speech, by name; truth : of the truth, where
    there is one; stretches : of random stretches of the recordings under the clip's speech; statue : of one held pose
    """

    recordings: Mapping[str, Mapping[str, float]]
    truth: Mapping[str, float] | None
    stretches: Sequence[Mapping[str, float]]
    statue: Mapping[str, float] | None


def beside(
    n_frames: int, recorded: Sequence[Recorded], truth: Curves | None, config: Config, name: str,
    onset_frames: np.ndarray | None, paused: np.ndarray | None,
) -> Beside:  # fmt: skip
    """Measure the recordings, the truth, random stretches and a statue as a clip is measured.

    A stretch that reaches the end of its recording goes on at its start, so that there are different ones of a short
    recording; no speed and no angle is measured across.
    """
    drawn, statue = [], None
    for number in range(config.evaluation.stretches if recorded else 0):
        rng = generator(config.seed, f"{name} stretch {number}")
        curves = recorded[int(rng.integers(len(recorded)))].curves
        frames = (int(rng.integers(curves.n_frames)) + np.arange(n_frames)) % curves.n_frames
        drawn.append(measure(curves.take(frames), config, onset_frames, paused))
    if recorded:
        statue = measure(recorded[0].curves.held(n_frames), config, onset_frames, paused)
    true = None if truth is None else measure(truth, config, onset_frames, paused)
    return Beside({one.name: one.row for one in recorded}, true, drawn, statue)


def beside_totals(found: Sequence[Beside]) -> dict[str, dict[str, float]]:
    """Sum up what the total of a run is compared with; each recording counts once, however many clips show it."""
    recordings = {name: row for one in found for name, row in sorted(one.recordings.items())}
    by_draw = [total(rows) for rows in zip(*(one.stretches for one in found if one.stretches), strict=True)]
    rows = {
        RECORDING: total(list(recordings.values())),
        TRUTH: total([one.truth for one in found if one.truth is not None]),
        STRETCH: _means(by_draw),
        STATUE: total([one.statue for one in found if one.statue is not None]),
    }
    return {name: row for name, row in rows.items() if any(np.isfinite(value) for value in row.values())}


def velocity_ratio(
    curves: Curves | None, truth: Curves | None, recorded: Sequence[Recorded], config: Config, name: str
) -> float:
    """Divide the Fréchet distance of wrist and head velocities by that of random stretches of recordings as long.

    To the truth; without one to the recordings themselves, then of parts of the clip as long as half of a recording at
    most, since a stretch that is nearly all of it is at no distance. NaN where nothing is known of hands and head.
    """
    # A recording of one frame has no stretch.
    sources = [one.curves.velocities for one in recorded if one.curves.velocities.shape[1] and one.curves.n_frames > 1]
    if not sources or curves is None:
        return NAN
    aim = np.concatenate(sources) if truth is None else truth.velocities
    if aim.shape[1] != curves.velocities.shape[1]:
        return NAN
    ours: list[float] = []
    floor: list[float] = []
    for number in range(config.evaluation.stretches):
        rng = generator(config.seed, f"{name} velocity {number}")
        source = sources[int(rng.integers(len(sources)))]
        longest = len(source) if truth is not None else max(2, int(len(source) * _LONGEST_SHARE))
        length = min(curves.n_frames, longest)
        for values, distances in ((curves.velocities, ours), (source, floor)):
            distances.append(frechet.frechet_distance(_stretch(values, length, rng), aim))
    return _ratio(float(np.mean(ours)), float(np.mean(floor)))


def frechet_ratios(
    generated: tuple[np.ndarray, Curves | None], truth: tuple[np.ndarray, Curves | None] | None,
    graph: ReferenceFrames, recorded: Sequence[Recorded], config: Config, name: str,
) -> dict[str, float]:  # fmt: skip
    """Divide all Fréchet distances of a clip by those of random stretches of its references.

    generated, truth : positions as distances are measured on, and curves; recorded : of the references that are shown
    """
    row = {"frechet_velocity_recording_ratio": velocity_ratio(generated[1], None, recorded, config, name)}
    if truth is None:
        return row
    if truth[1] is not None:
        row["frechet_velocity_ratio"] = velocity_ratio(generated[1], truth[1], recorded, config, name)
    shown, ends = {one.name for one in recorded}, [*graph.clip_starts[1:], graph.n_nodes]
    sources = [
        graph.positions[start:end]
        for (clip, mirrored), start, end in zip(graph.clips, graph.clip_starts, ends, strict=True)
        if clip in shown and not mirrored
    ]
    ratios = window_ratios(generated[0], truth[0], sources, config.evaluation.frechet_windows, config, name)
    return row | {f"frechet_{window}_ratio": ratio for window, ratio in ratios.items()}


def window_ratios(
    generated: np.ndarray, truth: np.ndarray, sources: Sequence[np.ndarray], windows: Sequence[int], config: Config,
    name: str,
) -> dict[int, float]:  # fmt: skip
    """Divide the Fréchet distances of windows to the truth by those of random stretches of recordings as long.

    generated, truth, sources : relative positions `[shape=(T, J, 3)]`; the ratio by window
    """
    found = {}
    for window in windows:
        floor = []
        for number in range(config.evaluation.stretches if sources else 0):
            rng = generator(config.seed, f"{name} window {number}")
            source = sources[int(rng.integers(len(sources)))]
            stretch = _stretch(source, min(len(generated), len(source)), rng)
            floor.append(frechet.window_frechet_distance(stretch, truth, window_frames=window))
        own = frechet.window_frechet_distance(generated, truth, window_frames=window)
        found[window] = _ratio(own, float(np.mean(floor))) if floor else NAN
    return found


def _stretch(values: np.ndarray, length: int, rng: np.random.Generator) -> np.ndarray:
    start = int(rng.integers(len(values) - length + 1))
    return values[start : start + length]


def _ratio(value: float, other: float) -> float:
    return value / other if other > 0 else NAN


# --- seams --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class SeamEvidence:
    """The frames of a clip near seams and far from them that a random forest learns from; arrays `[shape=(K, ...)]`.

    features, control : of the output, and of the shown frames in the untouched recording (NaN where unknown)
    is_seam : bool; source : str, the stretch of the recording that is shown; n_seams : of the clip
    """

    features: np.ndarray
    control: np.ndarray
    is_seam: np.ndarray
    source: np.ndarray
    n_seams: int
    joints: tuple[str, ...]


def seam_evidence(
    curves: Curves, seam_frames: np.ndarray, shown: np.ndarray, clip_starts: np.ndarray,
    recorded: Sequence[tuple[Recorded, bool] | None], n_clips: int,
) -> SeamEvidence:  # fmt: skip
    """Collect the frames near seams and far from them that a random forest is to tell apart in one clip.

    shown : int [shape=(T,)], the node at each output frame; recorded : of each clip of the references, and whether
    it is a mirrored copy; None for one that no frame shows or whose recording is unknown
    n_clips : clips of the run: of many, each gives a part of what the forest is taught
    """
    used, is_seam = detectability.label_frames(curves.n_frames, seam_frames)
    limit = max(1, -(-detectability.MAX_FRAMES_OF_A_KIND // n_clips))
    frames = np.sort(np.concatenate([detectability.thinned(np.flatnonzero(used & (is_seam == kind)), limit) for kind in (False, True)]))  # fmt: skip
    features = detectability.kinematic_features(curves.seam_positions)[frames]
    control = np.full(features.shape, np.nan, dtype=np.float32)
    source = np.full(len(frames), "", dtype=object)
    clips = np.searchsorted(clip_starts, shown[frames], side="right") - 1
    partners = mirror.partners(curves.seam_names)
    for clip in np.unique(clips):
        if recorded[clip] is None:
            continue
        one, mirrored = recorded[clip]
        own = clips == clip
        places = shown[frames[own]] - int(clip_starts[clip])
        untouched = detectability.kinematic_features(one.curves.seam_positions)
        control[own] = (untouched[:, partners] if mirrored else untouched)[places]
        source[own] = [f"{one.name}:{fold}" for fold in places * _SOURCE_FOLDS // one.curves.n_frames]
    return SeamEvidence(features, control, is_seam[frames], source.astype(str), len(seam_frames), curves.seam_names)


def detect_seams(
    evidence: Mapping[str, SeamEvidence], config: Config
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Measure how well random forests detect joins: in the whole run, and by the same forests in each clip.

    The control leaves out stretches of the recordings in place of clips: clips show the same joins of the same frames
    again, and a forest that has seen one knows the next by heart.
    """
    keys = ("seam_auc", "seam_auc_upper", "seam_auc_control")
    by_clip = {name: dict.fromkeys(keys, NAN) for name in evidence}
    parts = [one for one in evidence.values() if one.joints]
    if sum(one.n_seams for one in parts) < config.evaluation.seam_min_joins:
        return dict.fromkeys(keys, NAN), by_clip
    names = [name for name, one in evidence.items() if one.joints]
    clip = np.repeat(np.arange(len(parts)), [len(one.is_seam) for one in parts])
    is_seam = np.concatenate([one.is_seam for one in parts])
    features = np.concatenate([one.features for one in parts])
    groups = detectability.joint_groups(parts[0].joints)
    upper = [joint for joint in groups["all"] if joint not in (*groups["root"], *groups["feet"])]
    found = {}
    for key, shown, folds in (
        ("seam_auc", features, clip),
        ("seam_auc_upper", features[:, upper], clip),
        ("seam_auc_control", np.concatenate([one.control for one in parts]), np.concatenate([one.source for one in parts])),
    ):  # fmt: skip
        scores = detectability.held_out_scores(shown, is_seam, folds, seed=config.seed)
        found[key] = detectability.auc_over_folds(scores.scores, scores.is_seam, scores.folds)
        for number, name in enumerate(names):
            own = clip[scores.rows] == number
            by_clip[name][key] = detectability.auc_over_folds(
                scores.scores[own], scores.is_seam[own], scores.folds[own]
            )
    return found, by_clip

"""Extraction of the gesture clips of one recording, with all that a database needs to know of them (§3).

Everything comes in copies: the recording itself and, with `mirror`, the recording seen in a mirror.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from gesturegen import pose_distance
from gesturegen.data.clips import Reference, select_joints
from gesturegen.data.recordings import is_listed
from gesturegen.errors import DataError
from gesturegen.frames import positions_of
from gesturegen.joints import fingers as fingers_of
from gesturegen.joints import roles_of, settings_for
from gesturegen.methods.gesture_master import fingers, quality, style
from gesturegen.methods.gesture_master.settings import GestureMaster
from gesturegen.methods.gesture_master.transitions import Borders
from gesturegen.motion import body, kinematics, mirror, roles, rotation
from gesturegen.motion.skeleton import Motion, Skeleton, read_only
from gesturegen.settings.models import Config
from gesturegen.speech import cutting, rhythm
from gesturegen.speech.cutting import spoken

# Centimetres per metre: transition costs are in metres and radians, which gives the paper's delta_T = 8 a meaning.
_METRE = 100.0
BODIES = ("upper", "lower")
# Of the size of the skeleton, by which joints may be off their mirrored partners at rest.
_MOST_ASYMMETRY = 0.05


@dataclass(frozen=True, eq=False)
class Gestures:
    """The G gesture clips of a recording of T frames, in M copies.

    positions : float32 [shape=(M, T, J, 3)], as used for distances
    starts, stops : int [shape=(G,)], frames [start, stop); names : of the clips, `recording@seconds`
    rests : bool [shape=(G,)], clips of silence; rhythms : bool [shape=(G, bits)]
    styles : float [shape=(M, G, 3)], cm/s, cm, cm; features : float [shape=(G, P)], of the voice, NaN where unknown
    upper_ends, upper_starts, lower_ends, lower_starts : transitional frames, float32 [shape=(M, G, D)],
        positions in metres and quaternions in one row (`as_borders`); upper_joints, lower_joints : int [shape=(2,)],
        how many positions and rotations a frame of them has
    has_fingers : bool, whether the recording has finger motion; poses : float32 [shape=(M, G, D)], to find others'
    upper_names, lower_names, finger_names : str, the joints of the skeleton that they are
    dropped : names and reasons of the clips left out, str [shape=(K, 2)]
    thresholds : float [shape=(len(cutting.THRESHOLDS), 2)], clips and their seconds by gap threshold
    notes : what a user should know
    """

    positions: np.ndarray
    starts: np.ndarray
    stops: np.ndarray
    names: np.ndarray
    rests: np.ndarray
    rhythms: np.ndarray
    styles: np.ndarray
    features: np.ndarray
    upper_ends: np.ndarray
    upper_starts: np.ndarray
    lower_ends: np.ndarray
    lower_starts: np.ndarray
    upper_joints: np.ndarray
    lower_joints: np.ndarray
    has_fingers: np.ndarray
    poses: np.ndarray
    upper_names: np.ndarray
    lower_names: np.ndarray
    finger_names: np.ndarray
    dropped: np.ndarray
    thresholds: np.ndarray
    notes: np.ndarray

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, read_only(getattr(self, field.name)))

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all fields by name, as they are stored."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def mirrored(reference: Reference, config: Config) -> Reference:
    """Mirror the motion of a recording left to right; its speech stays.

    Raises DataError for a skeleton that would come out distorted.
    """
    skeleton = reference.motion.skeleton
    partners = mirror.partners(skeleton.names, config.gesture_master.joint_pairs)
    found = roles_of(skeleton, config)
    # Names that tell no sides: the roles do.
    for left, right in ((found[f"left_{part}"], found[f"right_{part}"]) for part in roles.LIMBS):
        if min(left, right) >= 0 and partners[left] == left and partners[right] == right:
            partners[[left, right]] = right, left
    rest = body.rest_positions(skeleton)
    away = np.linalg.norm(rest - rest[0] - (rest[partners] - rest[0]) * [-1.0, 1.0, 1.0], axis=1)
    # Helpers such as GENEA's `p_l_delt` move nothing, wherever they are.
    away[[not skeleton.children(j) and partners[j] == j for j in range(len(away))]] = 0.0
    size = np.ptp(rest, axis=0).max()
    motion: Motion | None
    if away.max() <= _MOST_ASYMMETRY * size:
        motion = mirror.mirror(reference.motion, partners)
    elif (motion := _mirrored_places(reference.motion, partners, config)) is None:
        raise DataError(
            f"clip {reference.name}: the skeleton at rest is not symmetric (joint {skeleton.names[int(away.argmax())]!r}), "
            "so mirrored copies would be wrong; give gesture_master.joint_pairs, or set gesture_master.mirror=false"
        )
    return Reference(
        reference.name, motion, reference.speech, reference.source_frames, reference.segment_starts,
    )  # fmt: skip


def _mirrored_places(motion: Motion, partners: np.ndarray, config: Config) -> Motion | None:
    """Mirror the motion of a body whose joints have rotated axes at rest; None where its bones do not allow it."""
    found = roles_of(motion.skeleton, config)
    if not found.is_body:
        return None
    made = mirror.mirror_places(motion, partners)
    joints = list(found.body)
    wanted = kinematics.joint_positions(motion, partners[joints].tolist()) * [-1.0, 1.0, 1.0]
    off = np.linalg.norm(kinematics.joint_positions(made, joints) - wanted, axis=-1).max()
    return made if off <= _MOST_ASYMMETRY * roles.body_height(motion.skeleton, found) else None


def clip_name(recording: str, frame: int, fps: float) -> str:
    """Return the name of the gesture clip that starts at `frame` of a recording."""
    return f"{recording}@{frame / fps:.2f}"


def extract(reference: Reference, config: Config) -> Gestures:
    """Cut a recording into gesture clips, leave out bad ones and describe the others.

    Raises DataError for a correction of a clip that does not exist.
    """
    settings, fps = config.gesture_master, reference.motion.fps
    copies = [reference, mirrored(reference, config)] if settings.mirror else [reference]
    bodies = [_Body(copy.motion, config) for copy in copies]
    segments = _Segments(reference, bodies[0], config)
    kept, dropped = [], []
    for clip in segments.cuts:
        name = clip_name(reference.name, int(reference.source_frames[clip.start]), fps)
        reason = quality.keep(name, segments.judge(clip), settings.quality)
        if reason is None:
            kept.append((name, clip))
        else:
            dropped.append((name, reason))
    starts = np.array([clip.start for _, clip in kept], dtype=np.int64)
    stops = np.array([clip.end for _, clip in kept], dtype=np.int64)
    rhythms = [rhythm.of_motion(segments.speeds[clip.start : clip.end], settings.rhythm) for _, clip in kept]
    borders = {
        f"{which}_{side}": np.stack([own.borders(which, frames, starts, segments, settings) for own in bodies])
        for which in BODIES
        for side, frames in (("ends", stops), ("starts", starts))
    }
    return Gestures(
        positions=np.stack([positions_of(copy.motion, config) for copy in copies]),
        starts=starts,
        stops=stops,
        names=np.array([name for name, _ in kept], dtype=str),
        rests=np.array([clip.rest for _, clip in kept], dtype=bool),
        rhythms=_corrected(np.array(rhythms, dtype=bool).reshape(-1, settings.rhythm.bits), starts, reference, config),
        styles=np.stack([own.styles(starts, stops) for own in bodies]),
        features=_features(reference, starts, stops),
        **borders,
        **{f"{which}_joints": bodies[0].counts(which) for which in BODIES},
        has_fingers=np.array(bodies[0].has_fingers),
        poses=np.stack([own.poses(starts, stops) for own in bodies]),
        **{f"{part}_names": np.array(joints, dtype=str) for part, joints in bodies[0].joint_names.items()},
        dropped=np.array(dropped, dtype=str).reshape(-1, 2),
        thresholds=segments.thresholds,
        notes=np.array(bodies[0].notes, dtype=str),
    )


def _corrected(rhythms: np.ndarray, starts: np.ndarray, reference: Reference, config: Config) -> np.ndarray:
    """Replace measured rhythm signatures by those that the user gave."""
    fps = reference.motion.fps
    seconds = reference.source_frames[starts] / fps
    for correction in config.gesture_master.rhythm.corrections or ():
        if not is_listed(reference.name, (correction.clip,)):
            continue
        # Names of clips have two decimals.
        near = np.abs(seconds - correction.start) <= 0.5 / fps + 0.005
        if not near.any():
            nearest = [
                f"; the nearest starts at {seconds[k]:.2f}" for k in np.argsort(np.abs(seconds - correction.start))
            ]
            raise DataError(
                f"gesture_master.rhythm.corrections: no gesture clip of {reference.name} starts at {correction.start:g} s"
                f"{''.join(nearest[:1])}; `gesturegen inspect` lists them"
            )
        rhythms[near] = rhythm.from_text(correction.bits)
    return rhythms


def _features(reference: Reference, starts: np.ndarray, stops: np.ndarray) -> np.ndarray:
    contour, frames, fps = reference.speech.prosody, reference.source_frames, reference.motion.fps
    if contour is None:
        return np.full((len(starts), len(style.FEATURES)), np.nan)
    words = np.array([word.start for word in reference.speech.words])
    rows = [
        style.features(contour, words, frames[start] / fps, (frames[stop - 1] + 1) / fps)
        for start, stop in zip(starts, stops, strict=True)
    ]
    return np.array(rows).reshape(-1, len(style.FEATURES))


class _Segments:
    """The uninterrupted stretches of a recording, each of which is cut and judged by itself."""

    def __init__(self, reference: Reference, own: _Body, config: Config):
        self.fps, self.settings = reference.motion.fps, config.gesture_master
        self.starts = reference.segment_starts
        self.ends = pose_distance.segment_ends(self.starts, reference.motion.n_frames)
        self.speeds = np.zeros(reference.motion.n_frames)
        self.cuts: list[cutting.Cut] = []
        self.thresholds = np.zeros((len(cutting.THRESHOLDS), 2))
        self._evidence = []
        words = np.array(spoken(reference.speech.words, reference.speech.onset_times, reference.speech.voice)).reshape(
            -1, 2
        )
        for start, last in zip(self.starts.tolist(), self.ends.tolist(), strict=True):
            here = slice(start, last + 1)
            speeds = rhythm.hand_speeds(own.hands[here], self.fps, self.settings.rhythm.smoothing_seconds)
            self.speeds[here] = speeds
            within = words - reference.source_frames[start] / self.fps
            stretch = (within.tolist(), len(speeds), self.fps, self.settings.cutting)
            self.cuts += [
                cutting.Cut(clip.start + start, clip.end + start, clip.rest) for clip in cutting.cut(*stretch, speeds)
            ]
            self.thresholds += cutting.threshold_row(*stretch, cutting.THRESHOLDS, speeds)
            self._evidence.append(quality.evidence(own.local[here], own.selected[here], self.fps))

    def of(self, frames: np.ndarray) -> np.ndarray:
        """Find the segment that each of `frames` lies in."""
        return np.searchsorted(self.starts, frames, side="right") - 1

    def judge(self, clip: cutting.Cut) -> str | None:
        """Say why a clip should not be used; None for a good one."""
        shortest = self.settings.cutting.min_seconds
        # What is left of a segment may be too short to be merged with anything.
        if clip.end - clip.start < shortest * self.fps - 0.5:
            return f"{(clip.end - clip.start) / self.fps:.2f} s long, below {shortest:g}"
        segment = int(self.of(np.asarray(clip.start)))
        start = int(self.starts[segment])
        return quality.judge(
            self._evidence[segment], clip.start - start, clip.end - start, self.fps, self.settings.quality
        )


class _Body:
    """The features that compare gesture clips frame by frame: of the upper body, the lower body and the hands."""

    def __init__(self, motion: Motion, config: Config):
        skeleton = motion.skeleton
        config = settings_for(skeleton, config)
        scale = config.positions.scale
        self.fps, self.notes = motion.fps, []
        pelvis = skeleton.pelvis(config.positions.root_joint)
        chosen, _ = select_joints(skeleton, config)
        halves = body.split(skeleton, pelvis)
        upper, lower = ([j for j in chosen if j in half] for half in (halves.upper, halves.lower))
        turns, places = (values[:, 0] for values in kinematics.world_transforms(motion, [pelvis]))
        centred = kinematics.joint_positions(motion, chosen) - places[:, None]
        # The upper body is joined to the lower one at the pelvis, so it is seen from there, tilt and all.
        upright = scale * rotation.rotate(rotation.inverse(turns)[:, None], centred)
        ahead = rotation.about_y(-rotation.heading(turns))
        facing = scale * rotation.rotate(ahead[:, None], centred)
        places_of = [chosen.index(j) for j in upper], [chosen.index(j) for j in lower]
        self.positions = {"upper": upright[:, places_of[0]], "lower": facing[:, places_of[1]]}
        tilt = rotation.multiply(ahead, turns)[:, None]
        legs = motion.rotations[:, [j for j in lower if j != pelvis]]
        self.rotations = {"upper": motion.rotations[:, upper], "lower": np.concatenate([tilt, legs], axis=1)}
        self.local, self.selected = motion.rotations[:, chosen], scale * centred
        hands = _hands(skeleton, config.wrists.joints, halves)
        if not set(config.wrists.joints) & set(skeleton.names):
            named = ", ".join(skeleton.names[j] for j in hands) or "none"
            self.notes.append(
                f"the skeleton has none of the wrist joints (wrists.joints); hands are taken to be: {named}"
            )
        seen = kinematics.relative_positions(motion, hands, pelvis, "root_heading") * scale
        self.hands = seen.reshape(motion.n_frames, len(hands), 3)
        # A right hand by its role; else, at rest the body faces along z, and its right is where x is negative.
        found = roles_of(skeleton, config)
        known = {found[f"{side}_wrist"]: side for side in ("left", "right")}
        self.right = [
            k for k, j in enumerate(hands)
            if (known[j] == "right" if j in known else body.rest_positions(skeleton)[j, 0] < 0)
        ]  # fmt: skip
        finger_joints = fingers_of(skeleton, config)
        self.has_fingers = fingers.has_fingers(motion.rotations[:, finger_joints])
        self.joint_names = {
            name: [skeleton.names[j] for j in joints]
            for name, joints in (("upper", halves.upper), ("lower", halves.lower), ("finger", finger_joints))
        }

    def styles(self, starts: np.ndarray, stops: np.ndarray) -> np.ndarray:
        """Compute the style signatures of clips, float `[shape=(G, 3)]`."""
        rows = [
            style.signature(self.hands[start:stop], self.right, self.fps)
            for start, stop in zip(starts, stops, strict=True)
        ]
        return np.array(rows).reshape(-1, len(style.VALUES))

    def poses(self, starts: np.ndarray, stops: np.ndarray) -> np.ndarray:
        """Sample the poses of clips by which fingers of others are found, float32 `[shape=(G, D)]`."""
        upper = self.positions["upper"]
        rows = [fingers.describe_poses(upper[start:stop]) for start, stop in zip(starts, stops, strict=True)]
        width = fingers.describe_poses(upper[:1]).size  # also where there is no clip
        return np.array(rows, dtype=np.float32).reshape(len(starts), width)

    def counts(self, which: str) -> np.ndarray:
        return np.array([self.positions[which].shape[1], self.rotations[which].shape[1]])

    def borders(
        self, which: str, frames: np.ndarray, starts: np.ndarray, segments: _Segments, settings: GestureMaster
    ) -> np.ndarray:
        """Extract the transitional frames around the borders `frames` of the clips from `starts`, one row each.

        Half of them lie before the border and half after it, so that a clip and the one recorded after it have
        the same: playing on costs nothing. Beyond its segment a clip has its first or last frame.
        """
        count = settings.transition_frames
        around = frames[:, None] + np.arange(-(count // 2), count - count // 2)
        own = segments.of(starts)
        around = np.clip(around, segments.starts[own][:, None], segments.ends[own][:, None])
        places = self.positions[which][around] / _METRE
        flat = (
            [values.reshape(len(frames), -1) for values in (places, self.rotations[which][around])]
            if len(frames)
            else []
        )
        width = count * int(self.counts(which) @ [3, 4])
        return np.concatenate(flat, axis=1).astype(np.float32) if flat else np.zeros((0, width), dtype=np.float32)


def as_borders(rows: np.ndarray, joints: Sequence[int], transition_frames: int) -> Borders:
    """Split rows of transitional frames `[shape=(C, D)]` into positions and rotations."""
    positions, rotations = joints
    split = transition_frames * 3 * int(positions)
    return Borders(
        rows[:, :split].reshape(len(rows), transition_frames, int(positions), 3),
        rows[:, split:].reshape(len(rows), transition_frames, int(rotations), 4),
    )


def _hands(skeleton: Skeleton, wrists: Sequence[str], halves: body.Body) -> list[int]:
    """Select the outermost of the wrist joints; without any, the joints farthest out to both sides at rest."""
    named = [skeleton.names.index(name) for name in wrists if name in skeleton.names]
    if named:
        return sorted(j for j in named if not set(skeleton.descendants(j)) & set(named))
    if not len(halves.limbs):
        return []
    across = body.rest_positions(skeleton)[halves.limbs, 0]
    return sorted({int(halves.limbs[np.argmin(across)]), int(halves.limbs[np.argmax(across)])})

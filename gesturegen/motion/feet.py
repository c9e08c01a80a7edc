"""Foot contacts, and foot locking: legs are bent so that feet which bear weight do not slide.

The cleaning of foot skate by inverse kinematics is that of Kovar, Schreiner and Gleicher (2002), with the two
bones of a leg solved in closed form; how an offset builds up and goes is ours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gesturegen.motion import kinematics, roles, rotation
from gesturegen.motion.skeleton import Motion, Skeleton
from gesturegen.settings.models import Feet

FLOOR_PERCENTILE = 5.0
CONTACT_HEIGHT = 2.5
# Joints nearer than this are one place, and a leg is never stretched quite straight.
_SAME_PLACE, _REACH = 1e-3, 0.9999
# Sine of the angle below which the axis of a bent knee is rounding.
_STRAIGHT = 1e-6
# Radians, of a knee that is locked out in standing: every leg may be stretched so far.
_STANDING_BEND = np.radians(10.0)
# Heights of a step by which every leg may become shorter than it mostly is.
_STEPPING_ROOM = 2.0
# Frames, of the filter that takes the corners off an offset.
_SMOOTHING = 1.0


def contacts(
    positions: np.ndarray, *, height: float = CONTACT_HEIGHT, floor_percentile: float = FLOOR_PERCENTILE
) -> np.ndarray:
    """Tell which feet are near the floor.

    positions : float [shape=(T, F, 3)], world positions of the foot joints, cm, y up
    height : cm above the foot's floor up to which it is in contact
    floor_percentile : percentile of a foot's height that is its floor
    Returns bool [shape=(T, F)].
    """
    heights = np.asarray(positions, dtype=np.float64)[..., 1]
    if not heights.size:
        return np.zeros(heights.shape, dtype=bool)
    return heights <= np.percentile(heights, floor_percentile, axis=0) + height


@dataclass(frozen=True)
class Leg:
    """The numbers of the hip, knee and ankle joints of a leg, no two of which lie at the same place."""

    hip: int
    knee: int
    ankle: int


def leg_of(skeleton: Skeleton, foot: int) -> Leg | None:
    """Find the leg above a foot joint; None where the skeleton has no two bones there.

    The ankle is the highest joint at the foot's own place: skeletons have twist joints. Where the foot is recognised as
    an ankle, knee and hip are those of its leg: twist joints may also lie along a bone.
    """
    chain = [foot]
    for _bone in range(3):
        joint = chain[-1]
        while np.linalg.norm(skeleton.offsets[joint]) < _SAME_PLACE and skeleton.parents[joint] >= 0:
            joint = int(skeleton.parents[joint])
        chain[-1] = joint
        chain.append(int(skeleton.parents[joint]))
        if chain[-1] < 0:
            return None
    ankle, knee, hip, _parent = chain
    found = roles.recognise(skeleton)
    for side in roles.SIDES:
        if foot == found[f"{side}_ankle"]:
            return Leg(found[f"{side}_hip"], found[f"{side}_knee"], ankle)
    return Leg(hip, knee, ankle)


def lock(
    motion: Motion, recorded: Motion, recorded_contacts: np.ndarray, jumps: np.ndarray, pelvis: int, settings: Feet
) -> Motion:
    """Hold the feet of a motion where they bear weight.

    recorded : the frames as they were recorded, one for each of `motion`
    recorded_contacts : bool `[shape=(T, F)]`, whether the foot bore weight there, for the configured feet
    jumps : bool `[shape=(T,)]`, frames that do not follow in the recording on the one before

    While a foot is near the floor it moves as it did in the recording, if it bore weight there too, else not
    at all. The offset to where the motion has it fades once the foot is up; where it grows too large before, the
    foot makes a step.
    """
    names = motion.skeleton.names
    feet = [names.index(name) for name in settings.joints if name in names]
    if not feet or motion.n_frames < 2:
        return motion
    legs = {place: leg for place, foot in enumerate(feet) if (leg := leg_of(motion.skeleton, foot)) is not None}
    if not legs:
        return motion
    near = contacts(kinematics.joint_positions(motion, feet))
    turns = _turns(motion, recorded, pelvis)
    held, missing = [], []
    for place, leg in legs.items():
        held.append(near[1:, place] & near[:-1, place])
        bore = recorded_contacts[1:, place] & recorded_contacts[:-1, place] & ~jumps[1:]
        ways = _turned(_ground_steps(recorded, leg.ankle), turns[1:])
        missing.append(np.where(bore[:, None], ways, 0.0) - _ground_steps(motion, leg.ankle))
    offsets = _offsets(np.stack(held, axis=1), np.stack(missing, axis=1), motion.fps, settings)
    rotations = motion.rotations.copy()
    for place, leg in enumerate(legs.values()):
        _bend(rotations, motion, leg, offsets[:, place], _leg_range(recorded, leg, settings))
    return replace(motion, rotations=rotations)


def _turns(motion: Motion, recorded: Motion, pelvis: int) -> np.ndarray:
    """Compute how far the motion's heading is turned from the recording's, radians `[shape=(T,)]`."""
    here, there = (kinematics.world_transforms(m, [pelvis])[0][:, 0] for m in (motion, recorded))
    return rotation.heading(rotation.multiply(here, rotation.inverse(there)))


def _ground_steps(motion: Motion, joint: int) -> np.ndarray:
    """Compute how a joint moves over the floor from frame to frame, x and z `[shape=(T - 1, 2)]`."""
    return np.diff(kinematics.joint_positions(motion, [joint])[:, 0, [0, 2]], axis=0)


def _turned(steps: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Turn steps over the floor `[shape=(T, 2)]` about the vertical by radians `[shape=(T,)]`."""
    cosine, sine = np.cos(turns), np.sin(turns)
    return np.column_stack([cosine * steps[:, 0] + sine * steps[:, 1], cosine * steps[:, 1] - sine * steps[:, 0]])


def _offsets(held: np.ndarray, missing: np.ndarray, fps: float, settings: Feet) -> np.ndarray:
    """Compute how far the feet are to be moved in each frame: over the floor and up `[shape=(T, F, 3)]`.

    held : bool `[shape=(T - 1, F)]`, steps that are made on the floor
    missing : `[shape=(T - 1, F, 2)]`, by how much they fall short, over the floor
    """
    fading = 0.5 ** (1.0 / (settings.release_half_life * fps))
    length = max(2, round(settings.step_seconds * fps))
    through = np.arange(1, length + 1) / length
    # Over the floor only while the foot is well up.
    over = np.clip((through - 0.25) / 0.5, 0.0, 1.0)
    left = 1.0 - over * over * (3.0 - 2.0 * over)
    lifted = settings.step_height * np.sin(np.pi * through) ** 2
    offsets = np.zeros((len(held) + 1, held.shape[1], 3))
    stepping, place, origin = -1, 0, np.zeros(2)  # one foot at a time
    for frame in range(1, len(offsets)):
        before = offsets[frame - 1, :, :2]
        offset = np.where(held[frame - 1][:, None], before + missing[frame - 1], fading * before)
        farthest = int(np.argmax(np.linalg.norm(offset, axis=1)))
        if stepping < 0 and held[frame - 1, farthest] and np.linalg.norm(offset[farthest]) > settings.max_offset:
            stepping, place, origin = farthest, 0, offset[farthest]
        if stepping >= 0:
            offset[stepping] = left[place] * origin
            offsets[frame, stepping, 2] = lifted[place]
            place += 1
            if place == length:
                stepping = -1
        offsets[frame, :, :2] = offset
    return gaussian_filter1d(offsets, _SMOOTHING, axis=0, mode="nearest")


def _leg_lengths(motion: Motion, leg: Leg) -> np.ndarray:
    """Compute the distances from hip to ankle `[shape=(T,)]`."""
    places = kinematics.joint_positions(motion, [leg.hip, leg.ankle])
    return np.linalg.norm(places[:, 1] - places[:, 0], axis=1)


def _leg_range(recorded: Motion, leg: Leg, settings: Feet) -> tuple[float, float]:
    """Compute the least and greatest length of a leg: as in the recording, or as in any stepping or standing leg."""
    places = kinematics.joint_positions(recorded.take(slice(0, 1)), [leg.hip, leg.knee, leg.ankle])[0]
    thigh, shin = (float(np.linalg.norm(end - start)) for start, end in pairwise(places))
    standing = np.sqrt(thigh**2 + shin**2 + 2.0 * thigh * shin * np.cos(_STANDING_BEND))
    lengths = _leg_lengths(recorded, leg)
    stepping = float(np.median(lengths)) - _STEPPING_ROOM * settings.step_height
    return min(float(lengths.min()), stepping), max(float(lengths.max()), float(standing))


def _stretched(length: np.ndarray, wanted: np.ndarray, longest: float) -> np.ndarray:
    """Limit the wanted lengths of a leg to the longest: the nearer they come to it, the more slowly they grow.

    A leg near its full length turns its knee by many degrees for a millimetre: reached at full pace, it snaps.
    Slowed only over the last 3 mm it still does, eight times as often on the real sample.
    """
    more, room = np.maximum(wanted - length, 0.0), np.maximum(longest - length, 0.0)
    slowed = room * -np.expm1(-more / np.maximum(room, 1e-12))
    return np.where(wanted > length, length + slowed, wanted)


def _shortened(length: np.ndarray, wanted: np.ndarray, shortest: float) -> np.ndarray:
    """Limit the wanted lengths of a leg to the shortest: a step must not become a crouch.

    A bent knee turns evenly with its leg's length, so that only the last part of the way is slowed.
    """
    less, room = np.maximum(length - wanted, 0.0), np.maximum(length - shortest, 1e-12)
    return np.where(wanted < length, length - less / (1.0 + (less / room) ** 4) ** 0.25, wanted)


def _bend(rotations: np.ndarray, motion: Motion, leg: Leg, offsets: np.ndarray, leg_range: tuple[float, float]) -> None:
    """Bend one leg, in place, so that its ankle moves by x, z and up `[shape=(T, 3)]`; the foot keeps its direction.

    leg_range : the shortest and the longest that the leg may become; a goal beyond these is pointed at
    """
    joints = [leg.hip, leg.knee, leg.ankle]
    around = [j for joint in joints for j in (int(motion.skeleton.parents[joint]), joint)]
    world, places = kinematics.world_transforms(motion, around)
    hip, knee, ankle = places[:, 1], places[:, 3], places[:, 5]
    goal = ankle + offsets[:, [0, 2, 1]]
    thigh, shin = knee - hip, ankle - knee
    long, short = np.linalg.norm(thigh, axis=1), np.linalg.norm(shin, axis=1)
    length, wanted = np.linalg.norm(ankle - hip, axis=1), np.linalg.norm(goal - hip, axis=1)
    wanted = _shortened(length, _stretched(length, wanted, leg_range[1]), leg_range[0])
    reach = np.clip(wanted, np.abs(long - short) / _REACH, (long + short) * _REACH)
    # The knee, about the axis it is bent on already: the angle that brings the ankle to the goal's distance.
    axis = np.cross(thigh, shin)
    bent = np.arctan2(np.linalg.norm(axis, axis=1), np.sum(thigh * shin, axis=1))
    bend = np.arccos(np.clip((reach**2 - long**2 - short**2) / (2.0 * long * short), -1.0, 1.0))
    size = np.linalg.norm(axis, axis=1, keepdims=True)
    # A straight leg has no such axis: then the body's own from right to left.
    sideways = rotation.rotate(world[:, 0], np.array([1.0, 0.0, 0.0]))
    axis = np.where(size > _STRAIGHT * (long * short)[:, None], axis / np.maximum(size, 1e-300), sideways)
    at_knee = rotation.from_expmap(axis * (bend - bent)[:, None])
    # Then the whole leg, the shortest way towards the goal.
    at_hip = rotation.between(thigh + rotation.rotate(at_knee, shin), goal - hip)
    # What lies between two of the joints turns with the upper one.
    below_hip, below_knee = at_hip, rotation.multiply(at_hip, at_knee)
    for joint, above, orientation in (
        (leg.hip, world[:, 0], rotation.multiply(below_hip, world[:, 1])),
        (leg.knee, rotation.multiply(below_hip, world[:, 2]), rotation.multiply(below_knee, world[:, 3])),
        (leg.ankle, rotation.multiply(below_knee, world[:, 4]), world[:, 5]),
    ):
        rotations[:, joint] = rotation.multiply(rotation.inverse(above), orientation)

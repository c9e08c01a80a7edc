"""Recordings that should not be references: near-motionless takes and tracking glitches (§3).

The paper blacklists 19 training clips by hand for "poor quality of the hand tracking and some significant
flickering on the body"; these are the figures that a person would look at first. Nothing is excluded here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gesturegen.motion import kinematics, rotation
from gesturegen.motion.skeleton import Motion
from gesturegen.runs import runs

# A speaker's wrists move 10 to 40 cm/s on average; below this the take is of somebody listening.
MOTIONLESS_WRIST_SPEED = 2.0
# Recorded bodies always tremble; a body that is exactly still has lost its tracking.
FROZEN_SECONDS = 1.0
FROZEN_SPEED = 0.01
# No joint of a talking person turns faster: 45 degrees a frame at 30 fps.
GLITCH_DEGREES_PER_SECOND = 1350.0
# No joint of a talking person travels faster: the wrists reach some 400 cm/s in wide gestures.
GLITCH_JOINT_SPEED = 900.0
# Glitches closer than this belong to one range, and ranges are widened by half of it.
GLITCH_GAP_SECONDS = 1.0
# With more than this share of the clip in glitching ranges, the clip is not worth mending.
GLITCHING_SHARE = 0.2


@dataclass(frozen=True)
class Finding:
    """A reason to leave out a clip (`start` is None) or a range of it, in seconds."""

    reason: str
    start: float | None = None
    end: float | None = None

    def describe(self, clip: str) -> str:
        """Format one line with the YAML that would exclude the clip or the range."""
        if self.start is None:
            return f"{clip}: {self.reason}   -> blacklist: [{clip}]"
        return f"{clip}: {self.reason}   -> exclude: [{{clip: {clip}, from: {self.start:.2f}, to: {self.end:.2f}}}]"


def screen(motion: Motion, joints: Sequence[int], wrist_names: Sequence[str]) -> list[Finding]:
    """List the faults of a recording in order of time; empty for a good one."""
    if motion.n_frames < 2:
        return [Finding("a single frame")]
    positions = kinematics.joint_positions(motion, list(joints))
    speeds = np.linalg.norm(np.diff(positions, axis=0), axis=-1) * motion.fps
    names = [motion.skeleton.names[j] for j in joints]
    return (
        _motionless(speeds, names, wrist_names) + _frozen(speeds, motion.fps) + _glitches(motion, joints, names, speeds)
    )


def _motionless(speeds: np.ndarray, names: list[str], wrist_names: Sequence[str]) -> list[Finding]:
    """Report a recording in which the wrists hardly move."""
    wrists = [k for k, name in enumerate(names) if name in wrist_names] or list(range(len(names)))
    mean = float(speeds[:, wrists].mean())
    if mean < MOTIONLESS_WRIST_SPEED:
        return [Finding(f"near-motionless: mean wrist speed {mean:.2f} cm/s is below {MOTIONLESS_WRIST_SPEED:g}")]
    return []


def _frozen(speeds: np.ndarray, fps: float) -> list[Finding]:
    """Report stretches in which no joint moves."""
    found = []
    for start, end in runs(speeds.max(axis=1) < FROZEN_SPEED).tolist():
        if end - start >= FROZEN_SECONDS * fps:
            seconds = (end - start) / fps
            found.append(Finding(f"frozen: no joint moves for {seconds:.1f} s", start / fps, (end + 1) / fps))
    return found


def _glitches(motion: Motion, joints: Sequence[int], names: list[str], speeds: np.ndarray) -> list[Finding]:
    """Report jumps of joints that no body makes, or the whole recording where they are spread over it."""
    fps = motion.fps
    local = motion.rotations[:, list(joints)]
    turns = np.degrees(rotation.angle_between(local[:-1], local[1:])) * fps
    bad = (turns > GLITCH_DEGREES_PER_SECOND) | (speeds > GLITCH_JOINT_SPEED)
    frames = np.flatnonzero(bad.any(axis=1))
    if len(frames) == 0:
        return []
    groups = np.split(frames, np.flatnonzero(np.diff(frames) > GLITCH_GAP_SECONDS * fps) + 1)
    found, covered = [], 0.0
    for group in groups:
        margin = GLITCH_GAP_SECONDS / 2
        start, end = max(group[0] / fps - margin, 0.0), min((group[-1] + 1) / fps + margin, motion.n_frames / fps)
        covered += end - start
        found.append(Finding(_worst(group, names, turns, speeds), start, end))
    if covered > GLITCHING_SHARE * motion.n_frames / fps:
        reason = (
            f"glitching: {len(frames)} frames with jumps, spread over {covered:.0f} of {motion.n_frames / fps:.0f} s"
        )
        return [Finding(f"{reason}; the worst: {_worst(frames, names, turns, speeds)}")]
    return found


def _worst(frames: np.ndarray, names: list[str], turns: np.ndarray, speeds: np.ndarray) -> str:
    """Describe the largest jump among `frames`, each figure relative to its bound."""
    severity = np.maximum(turns[frames] / GLITCH_DEGREES_PER_SECOND, speeds[frames] / GLITCH_JOINT_SPEED)
    row, joint = np.unravel_index(np.argmax(severity), severity.shape)
    frame = int(frames[row])
    turn, speed = turns[frame, joint], speeds[frame, joint]
    if turn / GLITCH_DEGREES_PER_SECOND >= speed / GLITCH_JOINT_SPEED:
        figure = f"turns {turn:.0f} degrees/s, above {GLITCH_DEGREES_PER_SECOND:g}"
    else:
        figure = f"moves {speed:.0f} cm/s, above {GLITCH_JOINT_SPEED:g}"
    return f"glitch: {names[joint]} {figure}, between frames {frame} and {frame + 1}"

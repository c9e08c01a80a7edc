"""Cleaning recorded motion before it becomes a reference (§3): frame rate, wrists, tracking jumps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import savgol_filter

from gesturegen.motion import rotation
from gesturegen.motion.skeleton import Motion
from gesturegen.settings.models import Wrists

_FRAMES_AT_ONCE = 2000


def resample(motion: Motion, fps: float) -> Motion:
    """Resample a motion to `fps`, rotations by SLERP, positions linearly, inside its first and last frame."""
    if motion.fps == fps:
        return motion
    last = motion.n_frames - 1
    count = int(np.floor(last * fps / motion.fps + 1e-6)) + 1
    times = np.minimum(np.arange(count) * (motion.fps / fps), last)
    return replace(interpolate(motion, times), fps=fps)


def interpolate(motion: Motion, times: np.ndarray) -> Motion:
    """Interpolate poses at fractional frame numbers `times` `[shape=(n,)]`, 0 to T - 1."""
    low = np.minimum(np.floor(times).astype(int), motion.n_frames - 1)
    high = np.minimum(low + 1, motion.n_frames - 1)
    joints = len(motion.skeleton.names)
    rotations, positions = np.empty((len(times), joints, 4)), np.empty((len(times), joints, 3))
    # Mixing needs several times the memory of what it gives.
    for start in range(0, len(times), _FRAMES_AT_ONCE):
        part = slice(start, start + _FRAMES_AT_ONCE)
        mixed = mix(motion.take(low[part]), motion.take(high[part]), times[part] - low[part])
        rotations[part], positions[part] = mixed.rotations, mixed.positions
    # A frame that lies on one of the file is that one, and keeps its angles.
    written = np.where((times == low)[:, None, None], motion.written_angles[low], np.nan)
    return replace(motion, rotations=rotations, positions=positions, written_angles=written)


def mix(left: Motion, right: Motion, amounts: np.ndarray) -> Motion:
    """Interpolate between two motions frame by frame: `left` at amount 0, `right` at amount 1 `[shape=(T,)]`."""
    weights = amounts[:, None]
    rotations = rotation.slerp(left.rotations, right.rotations, weights)
    weights = weights[..., None]
    return replace(left, rotations=rotations, positions=(1.0 - weights) * left.positions + weights * right.positions)


def clean_wrists(motion: Motion, segment_starts: np.ndarray, settings: Wrists) -> tuple[Motion, list[str]]:
    """Lock yaw and pitch of the wrist joints and filter their roll (§3); also returns notes on what was not done.

    Angles are intrinsic in `settings.axes`, roll (about the joint's own length) first. Yaw and pitch are
    locked to their circular median over the clip; roll is unwrapped and passed through a Savitzky-Golay
    filter inside each segment. A segment shorter than the window is left unfiltered.
    """
    if not settings.enabled:
        return motion, []
    names = motion.skeleton.names
    notes = []
    missing = [name for name in settings.joints if name not in names]
    if missing and len(missing) == len(settings.joints):
        return motion, ["the skeleton has none of the wrist joints, so no wrist is cleaned (wrists.joints)"]
    if missing:
        notes.append(f"the skeleton has no wrist joint {', '.join(missing)}, which is not cleaned (wrists.joints)")
    rotations = motion.rotations.copy()
    ends = np.append(segment_starts[1:], motion.n_frames)
    short = int(np.sum(ends - segment_starts < settings.window))
    if short:
        notes.append(
            f"{short} segment(s) shorter than {settings.window} frames: their wrists are locked but not filtered"
        )
    for joint in (names.index(name) for name in settings.joints if name in names):
        angles = rotation.to_euler(settings.axes, rotations[:, joint])
        angles[:, 1] = circular_median(angles[:, 1])
        angles[:, 2] = circular_median(angles[:, 2])
        for start, end in zip(segment_starts, ends, strict=True):
            if end - start >= settings.window:
                roll = np.unwrap(angles[start:end, 0])
                angles[start:end, 0] = savgol_filter(roll, settings.window, settings.order)
        rotations[:, joint] = rotation.from_euler(settings.axes, angles)
    return replace(motion, rotations=rotations), notes


def circular_median(angles: np.ndarray) -> float:
    """Compute the median of `angles` `[shape=(n,)]` in radians, taken around their circular mean.

    Equal to the ordinary median wherever the angles lie within a half circle.
    """
    mean = np.arctan2(np.sin(angles).mean(), np.cos(angles).mean())
    return float(mean + np.median(rotation.wrap_angle(angles - mean)))


def tracking_jumps(positions: np.ndarray, fps: float, max_joint_speed: float | None) -> np.ndarray:
    """Find frames `[shape=(K,)]` before a tracking jump: a step with a joint faster than `max_joint_speed`.

    positions : `[shape=(T, J, 3)]` in world units; max_joint_speed : units per second, None for no check.
    """
    if max_joint_speed is None or len(positions) < 2:
        return np.empty(0, dtype=int)
    speeds = np.linalg.norm(np.diff(positions, axis=0), axis=-1) * fps
    return np.flatnonzero(speeds.max(axis=1) > max_joint_speed)

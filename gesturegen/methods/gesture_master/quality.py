"""Quality checks of gesture clips: jitter, wrong rotations and lost tracking.

GestureMaster, §3.1: "We manually remove gesture clips with low quality such as motions with jitter or wrong
rotations." Here figures are compared with limits, and lists of names overrule them.

Conventions
- A wrong rotation shows as a joint that turns or travels faster than a body does.
- Jitter is what a smoothing filter takes away: the distance of a joint from its Savitzky-Golay smoothed way.
  The filter follows fast gestures (order 4; with order 2 lively waving leaves it by 1.3 cm instead of 0.2), and
  the distance is the median over a second, so that one hard stop, as of a punch, is no jitter.
- On recorded speech at 30 fps the figure is 0.03 cm at most. White noise of 1 degree on a forearm gives 0.2 to
  0.4 cm, of 2 degrees on an upper arm 0.5 to 1.3. The feet of people who run give 0.2 to 0.3, those who walk 0.1.
- A tremble that moves no selected joint, such as a twist of the wrist, is not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import savgol_filter

from gesturegen.methods.gesture_master.settings import Quality
from gesturegen.motion import rotation
from gesturegen.motion.screening import FROZEN_SPEED
from gesturegen.motion.skeleton import read_only

# In frames: what this filter leaves over at 30 fps is faster than 8 Hz, and no gesture is.
SMOOTHING_WINDOW = 7
SMOOTHING_ORDER = 4
# A tremble of at least half of this is found; a single hard stop is not taken for one.
JITTER_SECONDS = 1.0


@dataclass(frozen=True, eq=False)
class Evidence:
    """Measures that tell bad clips from good ones, for every frame of an uninterrupted stretch.

    turns : float [shape=(T,)], the largest turn of a joint from the frame before, degrees/s
    speeds : float [shape=(T,)], the largest speed of a joint from the frame before, cm/s
    jitter : float [shape=(T,)], how far the joint that trembles most leaves its smoothed way around the frame, cm
    still : bool [shape=(T,)], no joint moves from the frame before

    The first frame has none before it: its turn and speed are 0, and it is not still.
    """

    turns: np.ndarray
    speeds: np.ndarray
    jitter: np.ndarray
    still: np.ndarray

    def __post_init__(self) -> None:
        for name in ("turns", "speeds", "jitter", "still"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


def evidence(rotations: np.ndarray, positions: np.ndarray, fps: float) -> Evidence:
    """Measure the evidence of an uninterrupted stretch.

    rotations : float [shape=(T, K, 4)], local rotations of the selected joints
    positions : float [shape=(T, J, 3)], their positions relative to the pelvis, cm
    """
    positions = np.asarray(positions, dtype=np.float64)
    n_frames = len(positions)
    turns, speeds, still = np.zeros(n_frames), np.zeros(n_frames), np.zeros(n_frames, dtype=bool)
    if n_frames > 1:
        angles = rotation.angle_between(rotations[:-1], rotations[1:])
        turns[1:] = np.degrees(angles.max(axis=1, initial=0.0)) * fps
        speeds[1:] = np.linalg.norm(np.diff(positions, axis=0), axis=-1).max(axis=1, initial=0.0) * fps
        still[1:] = speeds[1:] < FROZEN_SPEED
    return Evidence(turns, speeds, _jitter(positions, fps), still)


def _jitter(positions: np.ndarray, fps: float) -> np.ndarray:
    """Compute each joint's distance from its smoothed way, as a moving median; return the largest per frame.

    The median is over `JITTER_SECONDS`.

    positions : float [shape=(T, J, 3)], cm
    Returns float64 [shape=(T,)], cm; 0 where the stretch is too short for the filter.
    """
    n_frames = len(positions)
    if n_frames < SMOOTHING_WINDOW:
        return np.zeros(n_frames)
    smoothed = savgol_filter(positions, SMOOTHING_WINDOW, SMOOTHING_ORDER, axis=0)
    margin = SMOOTHING_WINDOW // 2
    # The first and last frames have no full window, and a curve that ends on them follows any tremble.
    leaving = np.linalg.norm(positions - smoothed, axis=-1)[margin : n_frames - margin]
    window = min(2 * round(JITTER_SECONDS * fps / 2) + 1, len(leaving) - (len(leaving) + 1) % 2)
    medians = median_filter(leaving, size=(window, 1))
    half = window // 2
    jitter = medians[half : len(leaving) - half].max(axis=1, initial=0.0)  # full windows only
    return np.pad(jitter, (margin + half, n_frames - len(jitter) - margin - half), mode="edge")


def judge(evidence: Evidence, start: int, end: int, fps: float, settings: Quality) -> str | None:
    """Say why the clip of the frames `start` to `end` - 1 should not be used; None for a good one.

    Of several reasons the one that exceeds its limit most, as a ratio, is named, with its figure.
    """
    if not 0 <= start < end <= len(evidence.turns):
        raise ValueError(f"no clip from frame {start} to {end} in a stretch of {len(evidence.turns)}")
    inside = slice(start + 1, end)  # the step onto the first frame is not in the clip
    turn = float(evidence.turns[inside].max(initial=0.0))
    speed = float(evidence.speeds[inside].max(initial=0.0))
    jitter = float(_inner(evidence.jitter[start:end]).max())
    frozen = _longest_run(evidence.still[inside]) / fps
    reasons = []
    if turn > settings.max_turn:
        reasons.append((turn / settings.max_turn, f"turns {turn:.0f} degrees/s, above {settings.max_turn:g}"))
    if speed > settings.max_speed:
        reasons.append((speed / settings.max_speed, f"moves {speed:.0f} cm/s, above {settings.max_speed:g}"))
    if jitter > settings.max_jitter:
        reasons.append((jitter / settings.max_jitter, f"jitter {jitter:.3g} cm, above {settings.max_jitter:g}"))
    if frozen >= settings.frozen_seconds - 1e-9:
        reasons.append((frozen / settings.frozen_seconds, f"frozen for {frozen:.1f} s"))
    return max(reasons, key=lambda reason: reason[0])[1] if reasons else None


def _inner(jitter: np.ndarray) -> np.ndarray:
    """Cut off the ends, where most of the second around a frame, widened by the filter, may lie outside the clip."""
    margin = min(SMOOTHING_WINDOW // 2, (len(jitter) - 1) // 2)
    return jitter[margin : len(jitter) - margin]


def _longest_run(flags: np.ndarray) -> int:
    ends = np.flatnonzero(np.concatenate([[True], ~flags, [True]]))
    return int(np.diff(ends).max()) - 1


def keep(name: str, reason: str | None, settings: Quality) -> str | None:
    """Say why the clip called `name`, such as `trn_000@12.30`, is left out after the user's lists; None to use it.

    reason : of `judge`
    """
    if _is_listed(name, settings.exclude):
        return "excluded"
    if not settings.enabled or _is_listed(name, settings.include):
        return None
    return reason


def _is_listed(name: str, patterns: Sequence[str]) -> bool:
    return any(name == pattern or fnmatchcase(name, pattern) for pattern in patterns)

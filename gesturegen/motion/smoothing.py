"""Smoothing of a finished motion after GestureMaster (Zhou et al. 2022, §4.2).

The filter fits a polynomial around every frame: Savitzky and Golay, Smoothing and differentiation of data by
simplified least squares procedures, Analytical Chemistry 1964.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import savgol_filter

from gesturegen.motion.skeleton import Motion
from gesturegen.settings.models import Smoothing

# Length of a filtered quaternion below which its direction is chance.
_NO_DIRECTION = 1e-6


def savitzky_golay(motion: Motion, limbs: np.ndarray, settings: Smoothing) -> Motion:
    """Smooth the rotations and travelling positions of a motion over time.

    limbs : int `[shape=(K,)]`, joints filtered with `settings.limb_order`; `settings.order` holds for the rest
    Quaternions are filtered by component and brought back to length one. Joints that never turn and
    coordinates that never change stay to the bit, as does a motion shorter than the window.
    """
    if motion.n_frames < settings.window:
        return motion
    rotations = _one_hemisphere(motion.rotations)
    turning = np.ptp(rotations, axis=0).max(axis=-1) > 0
    in_limbs = np.zeros(len(turning), dtype=bool)
    in_limbs[limbs] = True
    for joints, order in ((turning & in_limbs, settings.limb_order), (turning & ~in_limbs, settings.order)):
        rotations[:, joints] = _filtered_rotations(rotations[:, joints], settings.window, order)
    positions = np.array(motion.positions, dtype=np.float64)
    travelling = np.ptp(positions, axis=0) > 0
    positions[:, travelling] = _filtered(positions[:, travelling], settings.window, settings.order)
    return replace(motion, rotations=rotations, positions=positions)


def _one_hemisphere(quaternions: np.ndarray) -> np.ndarray:
    """Choose each frame's sign of the quaternions `[shape=(T, J, 4)]` nearest to the frame before.

    q and -q are one rotation; where a file changes between them, a filter would average them to nothing.
    """
    dots = np.sum(quaternions[1:] * quaternions[:-1], axis=-1, keepdims=True)
    signs = np.cumprod(np.where(dots < 0, -1.0, 1.0), axis=0)
    return np.concatenate([quaternions[:1], signs * quaternions[1:]])


def _filtered_rotations(rotations: np.ndarray, window: int, order: int) -> np.ndarray:
    """Filter quaternions by component and bring them back to length one."""
    smooth = _filtered(rotations, window, order)
    length = np.linalg.norm(smooth, axis=-1, keepdims=True)
    # A spin of whole turns within the window cancels out: such a frame stays as it is.
    return np.where(length > _NO_DIRECTION, smooth / np.maximum(length, _NO_DIRECTION), rotations)


def _filtered(values: np.ndarray, window: int, order: int) -> np.ndarray:
    """Filter values along the first axis; half a window at either end is read off the polynomial there."""
    return savgol_filter(values, window, order, axis=0, mode="interp") if values.size else values

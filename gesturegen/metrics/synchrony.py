"""Does the generated motion move as fast as the recorded one at the same moment? Syn.

Source: §5.2, Table 2 ("the differences between velocity magnitudes of the generated and ground truth gestures
at each frame"), after Xu et al. 2022.

Conventions
- Velocity is the difference of neighbouring frames: cm per frame, not per second, so a figure is only
  comparable between motions of one frame rate.
- Magnitudes are norms over x, y, z of a joint, as the paper words it. Xu et al.'s released code takes
  absolute differences coordinate by coordinate instead; its figures are smaller.
- Lower is better, but only as a check against wild or frozen motion: the same words can be said with other
  gestures (§5.2 warns of this too).
"""

from __future__ import annotations

import numpy as np

from gesturegen.metrics.smoothness import difference_norms


def synchrony(generated: np.ndarray, truth: np.ndarray) -> float:
    """Compute Syn: mean over frames and joints of | ||v_generated|| - ||v_truth|| |.

        Syn = 1 / ((T - 1) J) * sum over t, j of | ||p_tj - p_(t-1)j|| - ||q_tj - q_(t-1)j|| |

    generated, truth : float [shape=(T, J, 3)] and [shape=(U, J, 3)], cm, the same joints in the same order
        and the same frame rate; the longer one is cut to the length of the shorter
    Returns cm per frame, 0 or more; NaN where the common length is under 2 frames or there is no joint.
    Raises ValueError when the joints differ in number.
    """
    poses = np.shape(generated)[1:], np.shape(truth)[1:]
    if poses[0] != poses[1]:
        raise ValueError(f"poses have shapes {poses[0]} and {poses[1]}, expected the same")
    common = min(len(generated), len(truth))
    differences = np.abs(_speeds(generated, common) - _speeds(truth, common))
    return float(differences.mean()) if differences.size else float("nan")


def mean_speed(positions: np.ndarray) -> float:
    """Compute the mean over frames and joints of ||v||: Syn against a statue.

    positions : float [shape=(T, J, 3)], cm
    Returns cm per frame; NaN where T < 2 or there is no joint. A Syn near the mean speed of the truth says no
    more than that the generated motion stands still.
    """
    speeds = _speeds(positions, len(positions))
    return float(speeds.mean()) if speeds.size else float("nan")


def _speeds(positions: np.ndarray, n_frames: int) -> np.ndarray:
    """Compute the speed of every joint from frame to frame."""
    return difference_norms(np.asarray(positions)[:n_frames], 1)

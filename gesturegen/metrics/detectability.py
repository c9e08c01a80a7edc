"""Can a classifier tell where stretches of the reference meet? Seam detectability: 0.5 is chance, 1 is always.

Ours. Seam jerk looks at one figure; a viewer sees whatever differs. A random forest (scikit-learn) is shown speeds,
accelerations and jerks around frames near a join and around frames far from any, and must tell the two apart on clips
that it has not seen.

Conventions
- A seam is named by the output frame at which its right side starts. Frames at most `near` frames from one are seams,
  frames at least `far` frames from all of them are elsewhere, those between are not looked at.
- The n-th difference of a joint at frame t is that of frames t - 1, t for speed, t - 1 to t + 1 for acceleration and
  t - 2 to t + 1 for jerk, so that each is centred within half a frame of the seam; its norm is taken to the logarithm.
  At the ends of a clip the nearest frame's counts.
- Each frame has these, their maximum and their mean over the frames around it.
- The forest is trained on all clips but one and asked about that one; with more clips than `MAX_FOLDS` on all but a
  group of them, and with a single clip on all but a third of it. Large inputs are thinned, evenly and alike for both
  kinds, so that the time does not grow with the number of clips.
- AUC is the chance that a frame at a seam gets a higher score than one elsewhere. It is formed of the frames left out,
  each ranked within its fold, since scores of two forests do not compare, and averaged over folds by their pairs.
- The control is the same with the shown frames' features in the untouched recording: where joins are made is no
  accident, and what it gives over 0.5 is no fault of the joins. It has to leave out stretches of the recording in
  place of clips: clips show the same joins of the same frames again, and a forest knows these by heart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.stats import rankdata

from gesturegen.metrics.smoothness import difference_norms

NEAR_FRAMES, FAR_FRAMES, AROUND_FRAMES = 2, 11, 4
N_TREES, MAX_FOLDS, MAX_FRAMES_OF_A_KIND = 40, 5, 1000
# What the logarithm of a joint that stands still is taken of, cm per frame ** order.
_FLOOR = 1e-4
# Frames of the difference of each order that come after the frame it is given to.
_AHEAD = {1: 0, 2: 1, 3: 1}
_STATISTICS = 3


class HeldOut(NamedTuple):
    """Scores of held-out frames, with their true labels, their folds, and their rows in the input."""

    scores: np.ndarray
    is_seam: np.ndarray
    folds: np.ndarray
    rows: np.ndarray


def kinematic_features(positions: np.ndarray, *, around: int = AROUND_FRAMES) -> np.ndarray:
    """Compute log speed, acceleration and jerk of every joint and frame, with their maximum and mean around it.

    positions : float [shape=(T, J, 3)], world positions, cm; around : frames to either side
    Returns float32 [shape=(T, J, 3, 3)]: by joint, order of the difference, and value, maximum, mean; NaN in clips
    of under 4 frames.
    """
    n_frames, n_joints = np.shape(positions)[:2]
    found = np.full((n_frames, n_joints, len(_AHEAD), _STATISTICS), np.nan, dtype=np.float32)
    if n_frames < 4:
        return found
    for place, (order, ahead) in enumerate(_AHEAD.items()):
        norms = np.log(np.maximum(difference_norms(positions, order), _FLOOR))
        values = np.pad(norms, [(order - ahead, ahead), (0, 0)], mode="edge")
        found[:, :, place, 0] = values
        found[:, :, place, 1] = maximum_filter1d(values, 2 * around + 1, axis=0, mode="nearest")
        found[:, :, place, 2] = uniform_filter1d(values, 2 * around + 1, axis=0, mode="nearest")
    return found


def label_frames(
    n_frames: int, seam_frames: ArrayLike, *, near: int = NEAR_FRAMES, far: int = FAR_FRAMES
) -> tuple[np.ndarray, np.ndarray]:
    """Select the frames to classify, and label those at a seam: two bool arrays `[shape=(n_frames,)]`."""
    seams = np.sort(np.asarray(seam_frames, dtype=np.int64))
    if not len(seams):
        return np.ones(n_frames, dtype=bool), np.zeros(n_frames, dtype=bool)
    frames = np.arange(n_frames)
    after = np.searchsorted(seams, frames)
    distance = np.minimum(
        np.abs(frames - seams[np.maximum(after - 1, 0)]), np.abs(seams[np.minimum(after, len(seams) - 1)] - frames)
    )
    return (distance <= near) | (distance >= far), distance <= near


def seam_auc(features: ArrayLike, is_seam: ArrayLike, clip_of_frame: ArrayLike, *, seed: int = 0) -> float:
    """Compute how well a random forest tells the frames at seams of unseen clips: 0.5 is chance, 1 always.

    features : float [shape=(N, ...)], one row per frame that is looked at, in order of time within each clip
    is_seam : bool [shape=(N,)]; clip_of_frame : int [shape=(N,)], equal for the frames of one clip
    Returns the AUC; NaN where no fold has frames of both kinds to learn from and to be asked about.
    """
    is_seam, clip_of_frame = np.asarray(is_seam, dtype=bool), np.asarray(clip_of_frame)
    found = held_out_scores(features, is_seam, clip_of_frame, seed=seed)
    return auc_over_folds(found.scores, found.is_seam, found.folds)


def held_out_scores(features: ArrayLike, is_seam: np.ndarray, clip_of_frame: np.ndarray, *, seed: int = 0) -> HeldOut:
    """Score each frame by a forest that has not seen its clip; arguments as of `seam_auc`."""
    from sklearn.ensemble import RandomForestClassifier

    values = np.asarray(features, dtype=np.float32).reshape(len(is_seam), -1)
    usable = np.isfinite(values).all(axis=1)
    kept = [thinned(np.flatnonzero(usable & (is_seam == kind)), MAX_FRAMES_OF_A_KIND) for kind in (False, True)]
    rows = np.sort(np.concatenate(kept))
    values, is_seam, folds = values[rows], is_seam[rows], _folds(clip_of_frame[rows])
    scores = np.full(len(rows), np.nan)
    for fold in np.unique(folds):
        asked, taught = folds == fold, folds != fold
        if len(np.unique(is_seam[asked])) < 2 or len(np.unique(is_seam[taught])) < 2:
            continue
        forest = RandomForestClassifier(
            N_TREES, min_samples_leaf=3, class_weight="balanced", n_jobs=1, random_state=seed
        )
        scores[asked] = forest.fit(values[taught], is_seam[taught]).predict_proba(values[asked])[:, 1]
    found = np.isfinite(scores)
    return HeldOut(scores[found], is_seam[found], folds[found], rows[found])


def auc_over_folds(scores: np.ndarray, is_seam: np.ndarray, folds: np.ndarray) -> float:
    """Compute the chance that a frame at a seam scores higher than another of its fold, ties half; NaN for no pair."""
    wins = pairs = 0.0
    for fold in np.unique(folds):
        own = folds == fold
        n_seams = int(is_seam[own].sum())
        own_pairs = n_seams * (int(own.sum()) - n_seams)
        ranks = rankdata(scores[own])
        wins += ranks[is_seam[own]].sum() - n_seams * (n_seams + 1) / 2 if own_pairs else 0.0
        pairs += own_pairs
    return float(wins / pairs) if pairs else float("nan")


def group_aucs(
    features: np.ndarray, is_seam: ArrayLike, clip_of_frame: ArrayLike, groups: Mapping[str, Sequence[int]],
    *, seed: int = 0,
) -> dict[str, float]:  # fmt: skip
    """Compute the AUC of `seam_auc` by some joints alone, to see which of them give the seams away.

    features : [shape=(N, J, ...)], as of `kinematic_features`; groups : places among the J joints, by name
    """
    return {
        name: seam_auc(features[:, list(joints)], is_seam, clip_of_frame, seed=seed) if len(joints) else float("nan")
        for name, joints in groups.items()
    }


def jerk_at_seams_less_elsewhere(features: ArrayLike, is_seam: ArrayLike) -> np.ndarray:
    """Compute the mean log jerk of each joint at seams less that elsewhere `[shape=(J,)]`.

    Under 0 the seams are too smooth, over 0 too rough.

    features : [shape=(N, J, 3, 3)], as of `kinematic_features`; NaN where either kind has no frame
    """
    jerk, is_seam = np.asarray(features, dtype=np.float64)[:, :, 2, 0], np.asarray(is_seam, dtype=bool)
    if is_seam.all() or not is_seam.any():
        return np.full(jerk.shape[1], np.nan)
    return jerk[is_seam].mean(axis=0) - jerk[~is_seam].mean(axis=0)


def joint_groups(names: Sequence[str]) -> dict[str, list[int]]:
    """Group joints by words in their names: parts of the body, `all` of them, the pelvis as `root`.

    Returns the places of the joints in `names`, by group.
    """
    words = {
        "wrists": ("wrist", "hand"),
        "head": ("head",),
        "feet": ("foot", "ankle"),
        "root": ("root", "pelvis", "hips"),
    }
    groups = {
        group: [place for place, name in enumerate(names) if any(part in name.lower() for part in parts)]
        for group, parts in words.items()
    }
    return {"all": list(range(len(names))), **groups}


def thinned(frames: np.ndarray, limit: int) -> np.ndarray:
    """Take at most `limit` frames, evenly spaced."""
    return frames if len(frames) <= limit else frames[np.linspace(0, len(frames) - 1, limit).astype(int)]


def _folds(clips: np.ndarray) -> np.ndarray:
    """Assign each frame to a fold: its clip, a group of clips where there are many, a third where there is one clip."""
    _, numbers = np.unique(clips, return_inverse=True)
    n_clips = int(numbers.max()) + 1 if len(numbers) else 0
    if n_clips == 1:
        return np.arange(len(numbers)) * 3 // len(numbers)
    return numbers % MAX_FOLDS

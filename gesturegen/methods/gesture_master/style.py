"""The style signature of a gesture clip, and its prediction from the voice (GestureMaster §3.3).

The signature is the mean hand speed, radius and height of a clip, defined as in StyleGestures (Alexanderson
et al. 2020). The paper obtains the wanted signature from a network trained on the audio; here a ridge
regression on prosody predicts it. What that is worth is measured on recordings left out of the training, and
a value predicted no better than by its mean gets the mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gesturegen.methods.gesture_master.settings import Style
from gesturegen.motion.skeleton import read_only
from gesturegen.speech.prosody import Contour

VALUES = ("speed", "radius", "height")
FEATURES = (
    "energy_mean",
    "energy_std",
    "energy_change",
    "energy_rise",
    "pitch_mean",
    "pitch_std",
    "pitch_change",
    "pitch_rise",
    "voiced_share",
    "speech_rate",
)
# Fewer clips than this say nothing about what goes with what.
_FEWEST_CLIPS = 3
# Standard deviations from the mean of the references up to which a feature of a voice counts.
_FARTHEST = 3.0
# A spread below this share of the size of the values is rounding.
_ROUNDING = 1e-9
# A value at exactly the end of a stretch lies outside it, whatever the rounding of the end.
_SLACK = 1e-6


def signature(wrists: np.ndarray, right: Sequence[int], fps: float) -> np.ndarray:
    """Compute the mean hand speed (cm/s), radius (cm) and height (cm) of a clip, float `[shape=(3,)]`.

        speed  = mean over t of the sum over hands of ||p(t) - p(t - 1)|| * fps
        radius = mean over t of the sum over hands of sqrt(x^2 + z^2)
        height = mean over t and over the right hands of y

    wrists : float [shape=(T, H, 3)], cm, seen from the hips, y up
    right : which of the H joints belong to the right hand; all are taken when there is none
    fps : frames per second
    The speed of a single frame is 0, and so is everything without hands.
    Raises ValueError for a clip without frames.
    """
    wrists = np.asarray(wrists, dtype=np.float64)
    if wrists.ndim != 3 or wrists.shape[2] != 3 or len(wrists) == 0:
        raise ValueError(f"wrists have shape {wrists.shape}, expected (T, H, 3) with at least one frame")
    if wrists.shape[1] == 0:
        return np.zeros(len(VALUES))
    steps = np.linalg.norm(np.diff(wrists, axis=0), axis=-1).sum(axis=1)
    radii = np.hypot(wrists[..., 0], wrists[..., 2]).sum(axis=1)
    heights = wrists[:, list(right), 1] if len(right) else wrists[..., 1]
    return np.array([steps.mean() * fps if len(steps) else 0.0, radii.mean(), heights.mean()])


def features(contour: Contour, word_starts: np.ndarray, start: float, end: float) -> np.ndarray:
    """Compute prosody features from `start` to before `end` seconds, float `[shape=(P,)]` in the order of FEATURES.

    `_mean` and `_std` are over the stretch, in dB and semitones; `_change` is the mean absolute change from
    value to value, per second; `_rise` is the mean of the second half minus that of the first. Pitch is taken
    over voiced values only. `voiced_share` is 0 to 1, `speech_rate` is words starting per second.

    word_starts : float [shape=(W,)], seconds, in any order
    NaN where undefined: pitch where nothing is voiced, changes of a single value. A stretch that holds no
    value takes the one nearest to its middle.
    """
    first = int(np.ceil(start * contour.rate - _SLACK))
    stop = int(np.ceil(end * contour.rate - _SLACK))
    first, stop = max(first, 0), min(stop, len(contour.energy))
    if stop <= first:
        middle = round((start + end) / 2 * contour.rate)
        first = min(max(middle, 0), len(contour.energy) - 1)
        stop = first + 1
    pitch = contour.pitch[first:stop]
    starts = np.asarray(word_starts, dtype=np.float64)
    words = np.count_nonzero((starts >= start) & (starts < end))
    return np.array(
        [
            *_course(contour.energy[first:stop], contour.rate),
            *_course(pitch, contour.rate),
            np.isfinite(pitch).mean(),
            words / (end - start) if end > start else np.nan,
        ]
    )


def _course(values: np.ndarray, rate: float) -> tuple[float, float, float, float]:
    """Compute mean, standard deviation, change per second and rise of `values`, leaving out NaN."""
    change = np.abs(np.diff(values)) * rate
    half = len(values) // 2
    rise = _mean(values[len(values) - half :]) - _mean(values[:half])
    known = values[np.isfinite(values)]
    return _mean(known), float(known.std()) if len(known) else np.nan, _mean(change), rise


def _mean(values: np.ndarray) -> float:
    """Compute the mean without NaN; NaN where nothing is left."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else np.nan


@dataclass(frozen=True, eq=False)
class Regression:
    """A linear prediction of style values from z-scored features, and how good it is on unseen recordings.

    feature_means, feature_scales : float [shape=(P,)], in the units of the features
    coefficients : float [shape=(P, 3)], per standard deviation of the feature; 0 for a value that is not
        predicted better than by its mean
    intercepts : float [shape=(3,)], the mean style of the clips
    r2 : float [shape=(3,)], cross-validated share of the variance that is predicted
    n_clips : how many clips it was learned from
    """

    feature_means: np.ndarray
    feature_scales: np.ndarray
    coefficients: np.ndarray
    intercepts: np.ndarray
    r2: np.ndarray
    n_clips: int

    def __post_init__(self) -> None:
        for name in ("feature_means", "feature_scales", "coefficients", "intercepts", "r2"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        # A number read from an .npz file is an array.
        object.__setattr__(self, "n_clips", int(self.n_clips))


def predict(regression: Regression, features: np.ndarray) -> np.ndarray:
    """Predict style values `[shape=(K, 3)]` for `features` `[shape=(K, P)]`; a NaN feature counts as the mean."""
    scaled = _scale(features, regression.feature_means, regression.feature_scales)
    # A voice unlike all of those learned from, by its level alone perhaps, must not ask for what no hand does.
    return np.clip(scaled, -_FARTHEST, _FARTHEST) @ regression.coefficients + regression.intercepts


def fit(features: np.ndarray, styles: np.ndarray, groups: np.ndarray, settings: Style) -> Regression:
    """Fit the ridge regression of style on prosody, cross-validated by recording.

    features : float [shape=(C, P)], NaN where undefined
    styles : float [shape=(C, 3)]
    groups : int [shape=(C,)], which recording each clip is from; the clips of one recording in order of time
    A value with an R2 of 0 or less is predicted by its mean; fewer than 3 clips give an R2 of 0.
    Raises ValueError when the shapes do not fit.
    """
    features = np.asarray(features, dtype=np.float64)
    styles = np.asarray(styles, dtype=np.float64)
    groups = np.asarray(groups)
    clips, values = len(features), len(VALUES)
    if features.ndim != 2 or clips == 0 or styles.shape != (clips, values) or groups.shape != (clips,):
        raise ValueError(
            f"features {features.shape}, styles {styles.shape} and groups {groups.shape} do not fit together"
        )
    r2 = np.zeros(values)
    if clips >= _FEWEST_CLIPS:
        r2 = _cross_validate(features, styles, groups, settings)
    means, scales = _scaling(features)
    coefficients, intercepts = np.zeros((features.shape[1], values)), styles.mean(axis=0)
    better = r2 > 0
    if better.any():
        learned = _ridge(_scale(features, means, scales), styles, settings.ridge)
        coefficients[:, better], intercepts[better] = learned[0][:, better], learned[1][better]
    return Regression(means, scales, coefficients, intercepts, r2, clips)


def describe(regression: Regression) -> str:
    """Describe in one line what the regression learned and how well it predicts."""
    none = not (regression.r2 > 0).any()
    parts = []
    for name, r2 in zip(VALUES, regression.r2, strict=True):
        # Adding 0 turns -0.00 into 0.00.
        part = f"{name} {round(float(r2), 2) + 0.0:.2f}"
        parts.append(part if none or r2 > 0 else f"{part} (no better than the mean, which is taken)")
    verdict = " (none better than the mean, which is taken)" if none else ""
    return (
        f"style from prosody over {regression.n_clips} clip{'s' * (regression.n_clips != 1)}, "
        f"cross-validated R2: {', '.join(parts)}{verdict}"
    )


def distances(wanted: np.ndarray, styles: np.ndarray, means: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """Compute the L2 distances of z-scored values between wanted and existing styles, float `[shape=(K, C)]`.

    wanted : float [shape=(K, 3)]; NaN leaves a value out, a row of NaN is at distance 0 from every clip
    styles : float [shape=(C, 3)]
    means, scales : float [shape=(3,)]; a scale of 0 (all clips alike) leaves a value out as well
    """
    scales = np.asarray(scales, dtype=np.float64)
    usable = scales > 0
    divisors = np.where(usable, scales, 1.0)
    differences = ((np.asarray(wanted) - means) / divisors)[:, None] - ((np.asarray(styles) - means) / divisors)[None]
    differences = np.where(usable & np.isfinite(differences), differences, 0.0)
    return np.sqrt((differences**2).sum(axis=-1))


# --- regression ---------------------------------------------------------------------------------------------


def _cross_validate(features: np.ndarray, styles: np.ndarray, groups: np.ndarray, settings: Style) -> np.ndarray:
    """Compute R2 of each value on clips left out, float `[shape=(3,)]`; the mean of the training clips has 0."""
    errors, spread = np.zeros(styles.shape[1]), np.zeros(styles.shape[1])
    for test in _folds(features, groups, settings.folds):
        train = np.setdiff1d(np.arange(len(features)), test)
        # Filling and scaling with what the training clips know keeps the test clips unseen.
        means, scales = _scaling(features[train])
        coefficients, intercepts = _ridge(_scale(features[train], means, scales), styles[train], settings.ridge)
        predicted = _scale(features[test], means, scales) @ coefficients + intercepts
        errors += ((styles[test] - predicted) ** 2).sum(axis=0)
        spread += ((styles[test] - styles[train].mean(axis=0)) ** 2).sum(axis=0)
    smallest = len(styles) * (_ROUNDING * np.abs(styles).max(axis=0)) ** 2
    known = spread > smallest
    return np.where(known, 1 - errors / np.where(known, spread, 1.0), 0.0)


def _folds(features: np.ndarray, groups: np.ndarray, folds: int) -> list[np.ndarray]:
    """Group the clips to be left out together: whole recordings or, with one recording, stretches of time.

    Clips with the same features are copies of one another (the mirrored ones) and never come apart.
    """
    from sklearn.model_selection import GroupKFold

    recordings = len(np.unique(groups))
    if recordings > 1:
        splits = GroupKFold(n_splits=min(folds, recordings)).split(features, groups=groups)
        return [test for _, test in splits]
    # NaN is not equal to itself; no feature is infinite.
    comparable = np.where(np.isnan(features), np.inf, features)
    _, first, same = np.unique(comparable, axis=0, return_index=True, return_inverse=True)
    if len(first) < 2:
        return []
    parts = np.array_split(np.sort(first), min(folds, len(first)))
    return [np.flatnonzero(np.isin(first[same.ravel()], part)) for part in parts]


def _ridge(features: np.ndarray, styles: np.ndarray, strength: float) -> tuple[np.ndarray, np.ndarray]:
    """Fit coefficients `[shape=(P, 3)]` and intercepts `[shape=(3,)]` of the ridge regression on scaled features."""
    from sklearn.linear_model import Ridge

    model = Ridge(alpha=strength, solver="cholesky").fit(features, styles)
    return model.coef_.T, model.intercept_


def _scaling(features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute mean and standard deviation of each feature without NaN; a constant feature gets the deviation 1."""
    known = np.isfinite(features)
    counts = np.maximum(known.sum(axis=0), 1)
    means = np.where(known, features, 0.0).sum(axis=0) / counts
    deviations = np.where(known, features - means, 0.0)
    scales = np.sqrt((deviations**2).sum(axis=0) / counts)
    return means, np.where(scales > _ROUNDING * np.maximum(np.abs(means), 1.0), scales, 1.0)


def _scale(features: np.ndarray, means: np.ndarray, scales: np.ndarray) -> np.ndarray:
    scaled = (np.asarray(features, dtype=np.float64) - means) / scales
    return np.where(np.isfinite(scaled), scaled, 0.0)

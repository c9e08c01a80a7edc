"""Style signatures, speech features, the regression between them and the distances."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gesturegen.methods.gesture_master.settings import Style
from gesturegen.methods.gesture_master.style import (
    FEATURES,
    VALUES,
    Regression,
    describe,
    distances,
    features,
    fit,
    predict,
    signature,
)
from gesturegen.speech.prosody import Contour
from tests.builders import SMALL

DEFAULTS = Style()
NONE = np.zeros(0)


# --- signatures ---------------------------------------------------------------------------------------------


def test_a_signature_by_hand():
    left = [[3.0, 10.0, 4.0], [3.0, 10.0, 4.0], [3.0, 13.0, 4.0]]  # radius 5, steps 0 and 3
    right = [[0.0, -2.0, 1.0], [4.0, -2.0, 1.0], [4.0, 1.0, 1.0]]  # steps 4 and 3
    wrists = np.stack([left, right], axis=1)
    radius = 5 + (1 + 2 * math.sqrt(17)) / 3
    np.testing.assert_allclose(signature(wrists, [1], 30.0), [(4 + 6) / 2 * 30, radius, -1.0])
    np.testing.assert_allclose(signature(wrists, [0], 30.0)[2], 11.0)
    np.testing.assert_allclose(signature(wrists, [], 30.0)[2], 5.0)


def test_a_signature_of_little():
    np.testing.assert_allclose(signature(np.array([[[3.0, 7.0, 4.0]]]), [0], 30.0), [0.0, 5.0, 7.0])
    assert signature(np.zeros((5, 0, 3)), [], 30.0).tolist() == [0.0, 0.0, 0.0]
    with pytest.raises(ValueError, match="at least one frame"):
        signature(np.zeros((0, 2, 3)), [], 30.0)
    with pytest.raises(ValueError, match="wrists have shape"):
        signature(np.zeros((5, 3)), [], 30.0)


@SMALL
@given(st.integers(0, 1000), st.integers(1, 8), st.integers(1, 3))
def test_a_signature_against_loops_and_under_mirroring(seed, frames, hands):
    wrists = np.random.default_rng(seed).normal(scale=20.0, size=(frames, hands, 3))
    speed = radius = height = 0.0
    for t in range(frames):
        for h in range(hands):
            x, y, z = wrists[t, h]
            radius += math.sqrt(x * x + z * z) / frames
            height += y / frames * (h == 0)
            if t:
                speed += math.dist(wrists[t, h], wrists[t - 1, h]) * 25 / (frames - 1)
    np.testing.assert_allclose(signature(wrists, [0], 25.0), [speed, radius, height], atol=1e-9)
    np.testing.assert_allclose(signature(wrists * [-1, 1, 1], [0], 25.0), [speed, radius, height], atol=1e-9)
    np.testing.assert_allclose(signature(wrists[::-1], [0], 50.0), [2 * speed, radius, height], atol=1e-9)


# --- features -----------------------------------------------------------------------------------------------


def named(contour, starts=NONE, start=0.0, end=1.0):
    values = features(contour, starts, start, end)
    assert values.shape == (len(FEATURES),)
    return dict(zip(FEATURES, values.tolist(), strict=True))


def test_features_by_hand():
    nan = math.nan
    contour = Contour(
        np.array([-90.0, -30.0, -20.0, -20.0, -10.0, -90.0]), np.array([nan, 80.0, 82.0, nan, 85.0, 99.0]), 4.0
    )
    found = named(contour, np.array([0.0, 0.25, 0.8, 1.2, 1.25]), 0.25, 1.25)
    expected = {
        "energy_mean": -20.0,
        "energy_std": math.sqrt(50),
        "energy_change": 20 / 3 * 4,
        "energy_rise": 10.0,
        "pitch_mean": 247 / 3,
        "pitch_std": np.std([80, 82, 85]),
        "pitch_change": 2 * 4,  # the values around the unvoiced one are no neighbours
        "pitch_rise": 85.0 - 81.0,
        "voiced_share": 0.75,
        "speech_rate": 3.0,  # the word at the end belongs to the next stretch
    }
    assert found == pytest.approx(expected)


def test_features_without_a_voice_are_unknown():
    found = named(Contour(np.full(25, -80.0), np.full(25, np.nan), 25.0))
    assert all(math.isnan(found[name]) for name in FEATURES if name.startswith("pitch"))
    assert [found[name] for name in ("energy_mean", "energy_std", "energy_change", "energy_rise")] == [-80, 0, 0, 0]
    assert found["voiced_share"] == found["speech_rate"] == 0.0


@pytest.mark.parametrize(
    ("start", "end", "nearest"),
    [(0.30, 0.34, 1), (0.30, 0.45, 2), (0.6, 0.6, 2), (1.1, 1.2, 3), (7.0, 9.0, 3), (-2.0, -1.0, 0)],
)
def test_a_stretch_without_a_value_takes_the_nearest(start, end, nearest):
    contour = Contour(np.array([-40.0, -30.0, -20.0, -10.0]), np.array([70.0, 71.0, 72.0, 73.0]), 4.0)
    found = named(contour, NONE, start, end)
    assert (found["energy_mean"], found["pitch_mean"]) == (contour.energy[nearest], contour.pitch[nearest])
    assert found["energy_std"] == found["pitch_std"] == 0.0
    assert all(math.isnan(found[f"{what}_{how}"]) for what in ("energy", "pitch") for how in ("change", "rise"))
    assert math.isnan(found["speech_rate"]) == (end <= start)


def test_the_end_of_a_stretch_is_outside_it_whatever_its_rounding():
    energy = np.zeros(100)
    energy[14] = 100.0
    contour = Contour(energy, np.full(100, 70.0), 25.0)
    assert 0.56 * 25 > 14  # by rounding
    assert named(contour, end=0.56)["energy_mean"] == 0.0
    assert named(contour, start=0.56)["energy_mean"] > 0.0


@SMALL
@given(
    arrays(float, 20, elements=st.floats(-80, 0)),
    arrays(float, 20, elements=st.floats(70, 110) | st.just(math.nan)),
    st.floats(0, 2.5),
    st.floats(0, 2.5),
)
def test_features_are_finite_or_nan_and_within_range(energy, pitch, one, other):
    start, end = min(one, other), max(one, other)
    found = named(Contour(energy, pitch, 10.0), np.arange(0, 2, 0.3), start, end)
    assert not any(map(math.isinf, found.values()))
    assert energy.min() - 1e-9 <= found["energy_mean"] <= energy.max() + 1e-9
    assert 0 <= found["voiced_share"] <= 1
    assert math.isnan(found["pitch_mean"]) == (found["voiced_share"] == 0)
    assert not found["energy_std"] < 0 and not found["energy_change"] < 0 and not found["pitch_change"] < 0


# --- regression ---------------------------------------------------------------------------------------------

WEIGHTS = np.array([[40.0, 0.0, 1.0], [-20.0, 3.0, 0.0], [0.0, 5.0, 2.0], [0.0, 0.0, -4.0]])
CENTRE = np.array([120.0, 60.0, 15.0])


def planted(clips=120, recordings=6, noise=0.1, seed=0):
    """Features on their own scales, the styles that follow from them, and the recordings."""
    rng = np.random.default_rng(seed)
    hidden = rng.normal(size=(clips, 4))
    styles = CENTRE + hidden @ WEIGHTS + noise * rng.normal(size=(clips, 3)) * np.abs(WEIGHTS).sum(axis=0)
    given = hidden * [5.0, 0.01, 100.0, 1.0] + [-30.0, 0.5, 1000.0, 80.0]
    return given, styles, np.arange(clips) * recordings // clips


@pytest.mark.parametrize("recordings", (1, 2, 6, 120))
def test_a_planted_relation_is_found_and_predicted(recordings):
    given, styles, groups = planted(recordings=recordings)
    found = fit(given, styles, groups, DEFAULTS)
    assert found.n_clips == 120 and (found.r2 > 0.8).all() and (found.r2 <= 1).all()
    fresh, wanted, _ = planted(noise=0.0, seed=1)
    errors = predict(found, fresh) - wanted
    assert (1 - errors.var(axis=0) / wanted.var(axis=0) > 0.9).all()
    np.testing.assert_allclose(predict(found, given.mean(axis=0)[None])[0], styles.mean(axis=0))


def test_noise_is_no_better_than_the_mean_which_is_taken():
    r2 = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        given, styles = rng.normal(size=(60, 8)), rng.normal(size=(60, 3)) + CENTRE
        found = fit(given, styles, np.arange(60) // 10, DEFAULTS)
        lost = found.r2 <= 0
        assert (found.coefficients[:, lost] == 0).all()
        expected = np.tile(styles.mean(axis=0), (60, 1))
        np.testing.assert_array_equal(predict(found, given)[:, lost], expected[:, lost])
        r2.append(found.r2)
    # Single values may be above 0 by chance.
    assert np.mean(r2) < -0.05 and np.mean(np.array(r2) <= 0) > 0.7 and np.max(r2) < 0.2


def test_each_value_is_judged_by_itself():
    given, styles, groups = planted()
    # The sign alternates within each recording: nothing in the features knows it.
    styles[:, 1] = 20.0 * (-1) ** np.arange(120) + np.random.default_rng(0).normal(size=120)
    found = fit(given, styles, groups, DEFAULTS)
    assert found.r2[0] > 0.8 and found.r2[1] <= 0 and found.r2[2] > 0.8
    predicted = predict(found, given)
    assert np.ptp(predicted[:, 1]) == 0 and (np.ptp(predicted, axis=0)[[0, 2]] > 0).all()


def test_a_constant_of_a_recording_is_not_learned():
    # Each recording has its own loudness and its own speed, which have nothing to do with each other; a
    # regression that has seen clips of the same recording takes one for the other. So it is with the topics of
    # a single recording, unless it is cut into stretches of time.
    recordings, one = np.repeat(np.arange(5), 20), np.zeros(100, dtype=int)
    by_recording, by_time, mixed = [], [], []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        given = rng.normal(size=(5, 8))[recordings] + 0.05 * rng.normal(size=(100, 8))
        styles = rng.normal(scale=10.0, size=(5, 3))[recordings] + rng.normal(size=(100, 3))
        order = rng.permutation(100)
        by_recording.append(fit(given[order], styles[order], recordings[order], DEFAULTS).r2)
        by_time.append(fit(given, styles, one, DEFAULTS).r2)
        mixed.append(fit(given[order], styles[order], one, DEFAULTS).r2)
    assert np.median(by_recording) < 0 and np.median(mixed) > 0.8
    np.testing.assert_allclose(by_time, by_recording)


@pytest.mark.parametrize("after", (True, False), ids=("after the others", "beside their originals"))
def test_mirrored_copies_do_not_help(after):
    rng = np.random.default_rng(0)
    given, styles = rng.normal(size=(20, 10)), rng.normal(size=(20, 3))
    given[3, 2] = np.nan
    doubled = np.tile(np.arange(20), 2) if after else np.repeat(np.arange(20), 2)
    settings = Style(ridge=0.1)
    once = fit(given, styles, np.zeros(20, dtype=int), settings)
    # Twice the clips with twice the ridge is the same regression.
    twice = fit(given[doubled], styles[doubled], np.zeros(40, dtype=int), Style(ridge=0.2))
    np.testing.assert_allclose(twice.r2, once.r2, atol=1e-9)
    assert (once.r2 < 0).all()


def test_r2_against_a_leave_one_out_by_hand():
    given, styles, _ = planted(clips=9)
    found = fit(given, styles, np.arange(9), Style(folds=9))
    errors, spread = np.zeros(3), np.zeros(3)
    for k in range(9):
        rest = np.delete(np.arange(9), k)
        mean, scale, centre = given[rest].mean(axis=0), given[rest].std(axis=0), styles[rest].mean(axis=0)
        scaled = (given[rest] - mean) / scale
        weights = np.linalg.solve(scaled.T @ scaled + 10.0 * np.eye(4), scaled.T @ (styles[rest] - centre))
        errors += (styles[k] - centre - (given[k] - mean) / scale @ weights) ** 2
        spread += (styles[k] - centre) ** 2
    np.testing.assert_allclose(found.r2, 1 - errors / spread)


@pytest.mark.parametrize("clips", (1, 2))
def test_too_few_clips_give_the_mean(clips):
    given, styles, _ = planted(clips=clips)
    found = fit(given, styles, np.zeros(clips, dtype=int), DEFAULTS)
    assert found.r2.tolist() == [0, 0, 0] and found.n_clips == clips
    np.testing.assert_allclose(predict(found, given + 3), np.tile(styles.mean(axis=0), (clips, 1)))


@pytest.mark.parametrize("groups", ([0, 0, 0], [0, 0, 1], [0, 1, 2]))
def test_three_clips_can_be_fitted(groups):
    given, styles, _ = planted(clips=3)
    assert np.isfinite(fit(given, styles, groups, DEFAULTS).r2).all()


def test_unknown_features_count_as_the_mean():
    given, styles, groups = planted()
    holes = given.copy()
    holes[::7, 0] = np.nan
    found = fit(holes, styles, groups, DEFAULTS)
    assert (found.r2 > 0.5).all()
    np.testing.assert_allclose(found.feature_means[0], np.nanmean(holes[:, 0]))
    np.testing.assert_allclose(found.feature_scales[0], np.nanstd(holes[:, 0]))
    unknown = np.full((2, 4), np.nan)
    unknown[1, 1] = found.feature_means[1] + found.feature_scales[1]
    predicted = predict(found, unknown)
    np.testing.assert_allclose(predicted[0], styles.mean(axis=0))
    np.testing.assert_allclose(predicted[1] - predicted[0], found.coefficients[1])


def test_features_that_say_nothing_are_left_out():
    given, styles, groups = planted()
    level, never, once = np.full(120, 0.1), np.full(120, np.nan), np.full(120, np.nan)
    once[5] = 3.0
    plain = fit(given, styles, groups, DEFAULTS)
    found = fit(np.column_stack([given, level, never, once]), styles, groups, DEFAULTS)
    np.testing.assert_allclose(found.r2, plain.r2)
    np.testing.assert_allclose(found.coefficients[4:], 0.0, atol=1e-9)
    assert np.isfinite(found.feature_means).all() and (found.feature_scales > 0).all()


def test_styles_that_do_not_vary_have_no_r2():
    given, styles, groups = planted()
    styles[:, 2] = 0.1
    found = fit(given, styles, groups, DEFAULTS)
    assert found.r2[2] == 0 and found.r2[0] > 0.8
    np.testing.assert_allclose(predict(found, given)[:, 2], 0.1)


def test_only_unknown_features_give_the_mean():
    _, styles, groups = planted()
    for recordings in (groups, groups * 0):
        found = fit(np.full((120, 4), np.nan), styles, recordings, DEFAULTS)
        np.testing.assert_allclose(found.r2, 0.0, atol=1e-12)
        np.testing.assert_allclose(predict(found, np.ones((1, 4))), styles.mean(axis=0)[None])


def test_the_same_clips_give_the_same_numbers_and_stay_as_they_are():
    given, styles, groups = planted()
    kept = given.copy(), styles.copy()
    first, second = fit(given, styles, groups, DEFAULTS), fit(given, styles, groups.tolist(), DEFAULTS)
    for name in ("feature_means", "feature_scales", "coefficients", "intercepts", "r2"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()
        with pytest.raises(ValueError, match="read-only"):
            getattr(first, name)[0] = 0.0
    np.testing.assert_array_equal(given, kept[0])
    np.testing.assert_array_equal(styles, kept[1])


def test_a_regression_survives_a_file(tmp_path):
    given, styles, groups = planted()
    found = fit(given, styles, groups, DEFAULTS)
    np.savez(tmp_path / "style.npz", **vars(found))
    with np.load(tmp_path / "style.npz") as file:
        again = Regression(**file)
    assert again.n_clips == 120 and describe(again) == describe(found)
    np.testing.assert_array_equal(predict(again, given), predict(found, given))


def test_shapes_that_do_not_fit_are_refused():
    given, styles, groups = planted()
    for wrong in ((given[:-1], styles, groups), (given, styles[:, :2], groups), (given, styles, groups[:5])):
        with pytest.raises(ValueError, match="do not fit together"):
            fit(*wrong, DEFAULTS)
    with pytest.raises(ValueError, match="do not fit together"):
        fit(given[:0], styles[:0], groups[:0], DEFAULTS)


@pytest.mark.parametrize(
    ("r2", "clips", "expected"),
    [
        (
            (0.214, 0.05, -0.02),
            412,
            "412 clips, cross-validated R2: speed 0.21, radius 0.05, "
            "height -0.02 (no better than the mean, which is taken)",
        ),
        (
            (-0.001, 0.4, 0.5),
            30,
            "30 clips, cross-validated R2: speed 0.00 (no better than the mean, which is taken), "
            "radius 0.40, height 0.50",
        ),
        (
            (0.0, 0.0, -1.5),
            1,
            "1 clip, cross-validated R2: speed 0.00, radius 0.00, height -1.50 "
            "(none better than the mean, which is taken)",
        ),
        ((0.9, 0.8, 0.7), 9, "9 clips, cross-validated R2: speed 0.90, radius 0.80, height 0.70"),
    ],
)
def test_a_regression_is_described_in_one_line(r2, clips, expected):
    regression = Regression(np.zeros(2), np.ones(2), np.zeros((2, 3)), np.zeros(3), np.array(r2), clips)
    assert describe(regression) == f"style from prosody over {expected}"


# --- distances ----------------------------------------------------------------------------------------------

wanted_values = st.floats(-50, 50) | st.just(math.nan)


@SMALL
@given(
    arrays(float, (3, 3), elements=wanted_values),
    arrays(float, (4, 3), elements=st.floats(-50, 50)),
    arrays(float, 3, elements=st.floats(-20, 20)),
    arrays(float, 3, elements=st.floats(0.1, 30) | st.just(0.0)),
)
def test_distances_against_loops(wanted, styles, means, scales):
    found = distances(wanted, styles, means, scales)
    assert found.shape == (3, 4)
    for k in range(3):
        for c in range(4):
            total = 0.0
            for v in range(3):
                if scales[v] > 0 and not math.isnan(wanted[k, v]):
                    total += ((wanted[k, v] - means[v]) / scales[v] - (styles[c, v] - means[v]) / scales[v]) ** 2
            assert found[k, c] == pytest.approx(math.sqrt(total))


def test_distances_leave_out_what_is_not_wanted():
    styles = np.array([[100.0, 50.0, 10.0], [130.0, 50.0, 14.0]])
    wanted = np.array([[100.0, 50.0, 10.0], [math.nan, math.nan, 14.0], [math.nan] * 3])
    found = distances(wanted, styles, styles.mean(axis=0), np.array([10.0, 5.0, 1.0]))
    np.testing.assert_allclose(found, [[0.0, 5.0], [4.0, 0.0], [0.0, 0.0]])
    assert distances(np.zeros((0, 3)), styles, np.zeros(3), np.ones(3)).shape == (0, 2)


def test_names_fit_the_numbers():
    assert len(VALUES) == 3 and len(set(FEATURES)) == len(FEATURES)

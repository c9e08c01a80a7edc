"""Features of motion matching on numbers that name their place and time."""

import numpy as np
import pytest

from gesturegen.methods.motion_matching.features import Scaling, apply, audio_features, pose_features, sequences
from gesturegen.methods.motion_matching.settings import MotionMatching
from gesturegen.speech.acoustics import Acoustics

DEFAULTS = MotionMatching()


def numbered(n, width=2):
    """Value k is (k, 1000 + k, ...)."""
    return Acoustics(np.arange(n)[:, None] + 1000 * np.arange(width), 15.0)


def seen(frames):
    """Positions whose first coordinate is the number of the frame."""
    positions = np.zeros((frames, 2, 3), dtype=np.float32)
    positions[:] = np.arange(frames)[:, None, None] + np.array([[0, 0.1, 0.2], [0.3, 0.4, 0.5]])
    return positions


def test_the_sound_is_seen_every_second_value_for_a_second():
    features = audio_features(numbered(100), np.array([0.0, 2.0]), DEFAULTS)
    assert features.shape == (2, 16) and features.dtype == np.float32
    assert features[0, ::2].tolist() == [0, 2, 4, 6, 8, 10, 12, 14]
    assert features[1, ::2].tolist() == [30, 32, 34, 36, 38, 40, 42, 44]
    assert features[1, 1::2].tolist() == [1030, 1032, 1034, 1036, 1038, 1040, 1042, 1044]


def test_the_nearest_value_counts_and_half_way_the_later_one():
    settings = MotionMatching(audio_values=2)
    times = np.array([0.4, 0.6, 1.4, 3.6]) / 15
    assert audio_features(numbered(20), times, settings)[:, ::2].tolist() == [[0, 2], [1, 3], [1, 3], [4, 6]]
    # Frames at 30 frames a second: every other one is half-way between two values.
    features = audio_features(numbered(2000, 1), np.arange(3000) / 30, settings)
    assert features[:, 0].tolist() == [(frame + 1) // 2 for frame in range(3000)]
    assert features[:, 1].tolist() == [min((frame + 1) // 2 + 2, 1999) for frame in range(3000)]


def test_past_the_end_the_last_value_stays():
    features = audio_features(numbered(10), np.array([0.4, 5.0, -1.0]), DEFAULTS)
    assert features[0, ::2].tolist() == [6, 8, 9, 9, 9, 9, 9, 9]
    assert features[1, ::2].tolist() == [9] * 8
    assert features[2, ::2].tolist() == [0, 0, 0, 0, 0, 0, 0, 0]
    assert audio_features(numbered(10, 14), np.empty(0), DEFAULTS).shape == (0, 112)


@pytest.mark.parametrize(
    "fps, offsets", [(15, [0, 1, 2, 3]), (30, [0, 2, 4, 6]), (25, [0, 2, 3, 5]), (20, [0, 1, 3, 4])]
)
def test_the_pose_is_seen_four_times_every_fifteenth_of_a_second(fps, offsets):
    positions = seen(30)
    features = pose_features(positions, np.array([0]), fps, DEFAULTS)
    assert features.shape == (30, 24) and features.dtype == np.float32
    np.testing.assert_array_equal(features[10], positions[[10 + offset for offset in offsets]].ravel())


def test_poses_do_not_look_past_the_end_of_their_segment():
    features = pose_features(seen(12), np.array([0, 5, 6]), 30, DEFAULTS)
    assert features[:, ::6].tolist() == [
        [0, 2, 4, 4], [1, 3, 4, 4], [2, 4, 4, 4], [3, 4, 4, 4], [4, 4, 4, 4],
        [5, 5, 5, 5],
        [6, 8, 10, 11], [7, 9, 11, 11], [8, 10, 11, 11], [9, 11, 11, 11], [10, 11, 11, 11], [11, 11, 11, 11],
    ]  # fmt: skip


def test_segments_are_cut_into_sequences_and_a_tail():
    def cut(starts, n_frames, fps=30, settings=DEFAULTS):
        first, last = sequences(np.array(starts, dtype=np.int64), n_frames, fps, settings)
        assert first.dtype.kind == last.dtype.kind == "i"
        return list(zip(first.tolist(), last.tolist(), strict=True))

    assert cut([0], 128) == [(0, 128)]
    assert cut([0, 300], 556) == [(0, 128), (128, 256), (256, 300), (300, 428), (428, 556)]
    assert cut([0, 1], 130) == [(0, 1), (1, 129), (129, 130)]
    assert cut([0], 70, fps=15) == [(0, 64), (64, 70)]
    assert cut([0], 5, settings=MotionMatching(sequence_seconds=0.05)) == [(0, 2), (2, 4), (4, 5)]
    assert cut([0], 2, settings=MotionMatching(sequence_seconds=0.001)) == [(0, 1), (1, 2)]


def test_scaled_features_have_mean_0_and_deviation_1():
    features = (np.random.default_rng(1).normal(size=(500, 3)) * [1, 100, 1e-3] + [5, -100, 0]).astype(np.float32)
    scaling = Scaling.of(features)
    scores = apply(scaling, features)
    assert scores.dtype == np.float32 and scores.shape == features.shape
    np.testing.assert_allclose(scores.mean(axis=0), 0, atol=1e-5)
    np.testing.assert_allclose(scores.std(axis=0), 1, atol=1e-5)
    other = np.array([[5.0, 0.0, 1.0]], dtype=np.float32)
    np.testing.assert_allclose(apply(scaling, other), (other - scaling.means) / scaling.scales, rtol=1e-6)
    np.testing.assert_allclose(apply(scaling, scaling.means[None]), 0, atol=1e-6)


def test_many_rows_are_scaled_as_few_are():
    features = np.random.default_rng(2).normal(size=(150_000, 2)).astype(np.float32)
    scaling = Scaling.of(features)
    np.testing.assert_allclose(scaling.scales, features.astype(float).std(axis=0), rtol=1e-12)
    np.testing.assert_array_equal(apply(scaling, features)[-5:], apply(scaling, features[-5:]))


def test_constant_features_score_0_everywhere():
    features = np.ones((100, 3), dtype=np.float32)
    features[:, 1] = 0.1
    features[:, 2] = 40 + np.arange(100) % 2 * np.spacing(np.float32(40))  # nothing but rounding
    scaling = Scaling.of(features)
    assert scaling.scales.tolist() == [0, 0, 0]
    assert not apply(scaling, features).any() and not apply(scaling, np.full((4, 3), 7.0)).any()
    alone = Scaling.of(features[:1])
    assert not apply(alone, features[:1]).any()
    assert apply(alone, features[:0]).shape == (0, 3)


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="no features"):
        Scaling.of(np.empty((0, 3)))
    with pytest.raises(ValueError, match="fit"):
        Scaling(np.zeros(2), np.zeros(3))
    with pytest.raises(ValueError, match="fit"):
        apply(Scaling(np.zeros(2), np.ones(2)), np.zeros((4, 3)))

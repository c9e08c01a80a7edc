"""Rhythm signatures by hand and against plain restatements."""

import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from threadpoolctl import threadpool_limits

from gesturegen.settings.speech import Rhythm
from gesturegen.speech.rhythm import agreement, from_text, hamming, hand_speeds, of_motion, of_words, to_text
from tests.builders import SMALL

FOUR = Rhythm(bits=4)
FOUR_SPANS = Rhythm(bits=4, words="span")
FULL = Rhythm()


# --- speeds of the hands ------------------------------------------------------------------------------------


def moving(*tracks):
    """Wrists `[shape=(T, H, 3)]` that move along X only, one list of positions per hand."""
    wrists = np.zeros((len(tracks[0]), len(tracks), 3))
    wrists[:, :, 0] = np.transpose(tracks)
    return wrists


def test_the_speed_is_the_way_per_second_and_the_first_frame_copies_the_second():
    assert hand_speeds(moving([0.0, 1.0, 4.0, 2.0]), 10.0, 0.0).tolist() == [10.0, 10.0, 30.0, 20.0]


def test_the_faster_hand_counts_frame_by_frame():
    wrists = moving([0.0, 1.0, 1.0, 1.0], [0.0, 0.0, 3.0, 2.0])
    assert hand_speeds(wrists, 1.0, 0.0).tolist() == [1.0, 1.0, 3.0, 1.0]


def test_the_way_is_measured_in_space():
    wrists = np.zeros((2, 1, 3))
    wrists[1, 0] = 2.0, 3.0, 6.0
    assert hand_speeds(wrists, 30.0, 0.0) == pytest.approx([210.0, 210.0])


def test_smoothing_is_a_gaussian_over_repeated_ends():
    positions = np.random.default_rng(0).normal(size=30).cumsum()
    rough = hand_speeds(moving(positions), 20.0, 0.0)
    # Sigma is two frames; scipy cuts the kernel off at four sigma.
    weights = np.array([math.exp(-(k**2) / 8) for k in range(-8, 9)])
    padded = np.concatenate([[rough[0]] * 8, rough, [rough[-1]] * 8])
    expected = [weights @ padded[t : t + 17] / weights.sum() for t in range(30)]
    assert hand_speeds(moving(positions), 20.0, 0.1) == pytest.approx(expected)


def test_steady_hands_keep_their_speed_through_the_smoothing():
    assert hand_speeds(moving(np.arange(40.0)), 30.0, 0.1) == pytest.approx(np.full(40, 30.0))


@pytest.mark.parametrize("shape", [(0, 2, 3), (1, 2, 3), (5, 0, 3), (1, 0, 3)])
def test_without_a_step_or_a_hand_there_is_no_speed(shape):
    speeds = hand_speeds(np.ones(shape), 30.0, 0.1)
    assert speeds.dtype == float and speeds.tolist() == [0.0] * shape[0]


# --- words --------------------------------------------------------------------------------------------------


def test_a_bit_where_a_word_starts():
    bits = of_words([(2.1, 4.9), (4.2, 4.3)], 2.0, 6.0, FOUR)
    assert bits.dtype == bool and to_text(bits) == "1010"


def test_a_bit_wherever_a_word_is():
    assert to_text(of_words([(2.1, 4.9)], 2.0, 6.0, FOUR_SPANS)) == "1110"


def test_silence_has_no_bits():
    assert to_text(of_words([], 0.0, 1.0, FULL)) == to_text(of_words([(5.0, 6.0)], 0.0, 1.0, FULL)) == "0" * 32


def test_a_word_on_a_border_belongs_to_the_later_bit():
    assert to_text(of_words([(1.0, 2.0)], 0.0, 4.0, FOUR)) == "0100"
    assert to_text(of_words([(1.0, 2.0)], 0.0, 4.0, FOUR_SPANS)) == "0100"


def test_a_word_at_the_start_is_inside_and_one_at_the_end_is_not():
    for settings in (FOUR, FOUR_SPANS):
        assert to_text(of_words([(2.0, 2.5)], 2.0, 6.0, settings)) == "1000"
        assert to_text(of_words([(6.0, 6.5)], 2.0, 6.0, settings)) == "0000"


def test_borders_are_exact_whatever_their_rounding():
    # 0.1 + 0.2 and 0.3 are the same border, a hair apart.
    for settings in (Rhythm(bits=10), Rhythm(bits=10, words="span")):
        for time_ in (0.1 + 0.2, 3 * 0.1, 0.3, 0.3 - 1e-12):
            assert to_text(of_words([(time_, time_)], 0.0, 1.0, settings)) == "0001000000"
            assert to_text(of_words([(0.2, time_)], 0.0, 1.0, settings)) == "0010000000"
    assert to_text(of_words([(2 - 1e-12, 2.5)], 2.0, 6.0, FOUR)) == "1000"
    assert to_text(of_words([(6 - 1e-12, 6.5)], 2.0, 6.0, FOUR)) == "0000"


def test_a_word_that_began_before_the_clip_has_no_start_but_a_span():
    assert to_text(of_words([(1.0, 3.5)], 2.0, 6.0, FOUR)) == "0000"
    assert to_text(of_words([(1.0, 3.5)], 2.0, 6.0, FOUR_SPANS)) == "1100"
    assert to_text(of_words([(1.0, 9.0)], 2.0, 6.0, FOUR_SPANS)) == "1111"
    assert to_text(of_words([(1.0, 2.0)], 2.0, 6.0, FOUR_SPANS)) == "0000"


def test_an_instant_has_a_bit():
    assert to_text(of_words([(3.5, 3.5), (5.0, 5.0)], 2.0, 6.0, FOUR_SPANS)) == "0101"


def test_a_clip_without_length_has_no_rhythm():
    with pytest.raises(ValueError, match="no rhythm"):
        of_words([], 2.0, 2.0, FOUR)


@SMALL
@given(st.integers(0, 10**6), st.integers(2, 40))
def test_words_equal_a_plain_restatement(seed, n_bits):
    rng = np.random.default_rng(seed)
    # Bits are ten ticks long, so that no border is a matter of rounding.
    words = [(start, start + int(rng.choice([0, 1, 8, 50]))) for start in rng.integers(-50, 10 * n_bits + 50, 12)]
    expected_starts, expected_spans = [], []
    for bit in range(n_bits):
        first, after = 10 * bit, 10 * bit + 10
        expected_starts.append(any(first <= start < after for start, _ in words))
        overlapped = any(start < after and end > first for start, end in words)
        expected_spans.append(expected_starts[-1] or overlapped)
    clip = [(7.0 + start / 30, 7.0 + end / 30) for start, end in words], 7.0, 7.0 + 10 * n_bits / 30
    starts, spans = of_words(*clip, Rhythm(bits=n_bits)), of_words(*clip, Rhythm(bits=n_bits, words="span"))
    assert starts.tolist() == expected_starts and spans.tolist() == expected_spans
    assert not (starts & ~spans).any()


# --- motion -------------------------------------------------------------------------------------------------


def test_a_bit_where_the_speed_is_lowest():
    bits = of_motion(np.array([5, 3, 4, 5, 6, 5, 2, 1.0]), FOUR)
    assert bits.dtype == bool and to_text(bits) == "1000"
    assert to_text(of_motion(np.array([5, 6, 4, 5, 6, 5, 2, 3.0]), FOUR)) == "0101"


def test_frame_k_of_n_is_in_bit_k_times_bits_over_n():
    for minimum in range(1, 9):
        speeds = np.ones(10)
        speeds[minimum] = 0.0
        assert to_text(of_motion(speeds, FOUR)).index("1") == minimum * 4 // 10


def test_the_first_and_the_last_frame_are_no_minima():
    assert to_text(of_motion(np.array([0, 1, 2, 1, 0.0]), FOUR)) == "0000"


def test_a_level_minimum_counts_once_at_its_middle():
    assert to_text(of_motion(np.array([5, 5, 1, 1, 1, 1, 5, 5.0]), FOUR)) == "0100"
    assert to_text(of_motion(np.array([5, 1, 1, 1, 1, 1, 5, 5.0]), FOUR)) == "0100"
    # Level down to the last frame is no minimum.
    assert to_text(of_motion(np.array([5, 5, 1, 1, 1, 1, 1, 1.0]), FOUR)) == "0000"


@pytest.mark.parametrize("n", [0, 1, 2, 30])
def test_hands_at_rest_have_no_bits(n):
    assert to_text(of_motion(np.zeros(n), FULL)) == "0" * 32


def test_clips_of_fewer_frames_than_bits():
    assert to_text(of_motion(np.array([2, 1, 2.0]), Rhythm(bits=6))) == "001000"


@SMALL
@given(st.integers(0, 10**6), st.integers(1, 60), st.integers(2, 40))
def test_motion_equals_a_plain_restatement(seed, n, n_bits):
    speeds = np.random.default_rng(seed).integers(0, 4, n).astype(float)
    expected, first = [False] * n_bits, 0
    for k in range(1, n + 1):
        if k == n or speeds[k] != speeds[first]:
            if first > 0 and k < n and speeds[first - 1] > speeds[first] < speeds[k]:
                expected[(first + k - 1) // 2 * n_bits // n] = True
            first = k
    assert of_motion(speeds, Rhythm(bits=n_bits)).tolist() == expected


# --- distances ----------------------------------------------------------------------------------------------


@SMALL
@given(st.integers(0, 10**6), st.sampled_from([(), (3,), (2, 0), (2, 3)]))
def test_hamming_equals_counting(seed, leading):
    rng = np.random.default_rng(seed)
    a_rows, b_rows, n_bits = rng.integers(0, 6, 3)
    a, b = rng.random((*leading, a_rows, n_bits)) < 0.5, rng.random((b_rows, n_bits)) < 0.5
    distances = hamming(a, b)
    assert distances.dtype == np.int64 and distances.shape == (*leading, a_rows, b_rows)
    for index in np.ndindex(distances.shape):
        assert distances[index] == sum(x != y for x, y in zip(a[index[:-1]], b[index[-1]], strict=True))


def test_hamming_is_a_distance():
    rng = np.random.default_rng(0)
    a, b = rng.random((7, 32)) < 0.5, rng.random((5, 32)) < 0.5
    assert np.array_equal(hamming(a, b), hamming(b, a).T)
    assert not hamming(a, a).diagonal().any() and (hamming(a, ~a).diagonal() == 32).all()
    assert (hamming(a, b)[:, None, :] <= hamming(a, a)[:, :, None] + hamming(a, b)[None]).all()


def test_many_signatures_take_little_time():
    rng = np.random.default_rng(0)
    a, b = rng.random((6000, 32)) < 0.5, rng.random((100, 32)) < 0.5
    with threadpool_limits(limits=1):
        start = time.thread_time()  # of this thread alone: however busy the machine is
        assert hamming(a, b).shape == (6000, 100)
        seconds = time.thread_time() - start
    print(f"{seconds:.2f} s")
    assert seconds < 5.0


def test_agreement_is_the_mean_share_of_equal_bits():
    speech, motion = np.array([[1, 1, 0, 0], [1, 0, 0, 0]], dtype=bool), np.array([[1, 0, 0, 1], [1, 0, 0, 0]], bool)
    assert agreement(speech, motion) == agreement(motion, speech) == 0.75
    assert agreement(speech, speech) == 1.0 and agreement(speech, ~speech) == 0.0
    assert agreement(speech, motion) == 1 - hamming(speech, motion).diagonal().mean() / 4


def test_no_signature_has_no_agreement():
    assert math.isnan(agreement(np.zeros((0, 32), bool), np.zeros((0, 32), bool)))


def test_signatures_that_are_not_parallel_are_refused():
    with pytest.raises(ValueError, match="not parallel"):
        agreement(np.zeros((2, 32), bool), np.zeros((3, 32), bool))


@SMALL
@given(st.text("01", max_size=40))
def test_texts_and_signatures_are_the_same(text):
    bits = from_text(text)
    assert bits.dtype == bool and bits.shape == (len(text),) and to_text(bits) == text
    assert [int(bit) for bit in bits] == [int(character) for character in text]


@pytest.mark.parametrize("text", ["012", "0 1", "１０", "-1"])
def test_other_texts_are_no_signatures(text):
    with pytest.raises(ValueError, match="no signature"):
        from_text(text)

"""Cutting by hand-made speeches of ten frames per second, and what holds for every speech."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gesturegen.settings.speech import Cutting
from gesturegen.speech.cutting import THRESHOLDS, Cut, cut, threshold_row
from tests.builders import SMALL

FPS = 10.0
# Too small and too large to matter.
ANY_LENGTH = {"min_seconds": 0.1, "max_seconds": 1000.0}


def lengths(words, n_frames, fps=FPS, speeds=None, **settings):
    """Lengths of the clips in frames, as text: `8 r20 12` is a clip, a rest and a clip."""
    cuts = cut(words, n_frames, fps, Cutting(**settings), speeds)
    assert [piece.start for piece in cuts] == [0, *(piece.end for piece in cuts)][: len(cuts)]
    assert not cuts or cuts[-1].end == n_frames
    return " ".join(("r" if piece.rest else "") + str(piece.end - piece.start) for piece in cuts)


# --- gaps and rests -----------------------------------------------------------------------------------------


def test_a_gap_is_cut_at_its_middle():
    assert lengths([(0.0, 2.0), (2.6, 5.0)], 50) == "23 27"


def test_a_clip_is_a_range_of_frames():
    assert cut([(0.0, 2.0), (5.0, 7.0)], 70, FPS, Cutting()) == [
        Cut(0, 20, False),
        Cut(20, 50, True),
        Cut(50, 70, False),
    ]


def test_words_without_gaps_are_one_clip():
    assert lengths([(0.0, 1.0), (1.0, 2.5), (2.5, 4.0)], 40) == "40"


def test_one_word_is_one_clip():
    assert lengths([(0.5, 2.5)], 30) == "30"


@pytest.mark.parametrize("n_frames", [1, 5, 30])
def test_a_speech_without_words_is_a_rest_however_short(n_frames):
    assert lengths([], n_frames) == f"r{n_frames}"


def test_no_frames_are_no_clips():
    assert cut([], 0, FPS, Cutting()) == cut([(0.0, 1.0)], 0, FPS, Cutting(), np.zeros(0)) == []


def test_a_gap_of_exactly_the_limit_is_no_cut():
    assert lengths([(0.0, 2.0), (2.4, 5.0)], 50) == "50"
    assert lengths([(0.0, 2.0), (2.41, 5.0)], 50) == "22 28"


def test_a_gap_of_exactly_the_rest_limit_is_no_rest():
    assert lengths([(0.0, 2.0), (3.0, 5.0)], 50) == "25 25"
    assert lengths([(0.0, 2.0), (3.1, 5.0)], 50) == "20 r11 19"


@pytest.mark.parametrize("limit", [0.1, 0.3, 0.7, 1.1])
@pytest.mark.parametrize("fps", [10.0, 29.97, 30.0, 120.0])
def test_the_limits_are_exact_whatever_their_rounding(limit, fps):
    for start in (1.1, 2.3, 3.3):
        words = [(0.0, start), (start + limit, 6.0)]
        n_frames = round(6 * fps)
        assert len(cut(words, n_frames, fps, Cutting(gap_seconds=limit, rest_seconds=5.0))) == 1
        assert len(cut(words, n_frames, fps, Cutting(gap_seconds=limit - 0.001, rest_seconds=5.0))) == 2
        assert len(cut(words, n_frames, fps, Cutting(gap_seconds=0.0, rest_seconds=limit, min_seconds=0.05))) == 2


def test_a_time_a_hair_below_its_frame_is_in_it():
    # 4.1 * 30 is 122.999...
    assert lengths([(0.0, 4.1), (6.0, 8.0)], 240, fps=30.0) == "123 r57 60"


def test_gaps_are_measured_in_time_and_not_in_frames():
    # Both gaps touch three borders of frames.
    assert lengths([(0.0, 2.09), (2.41, 5.0)], 50, gap_seconds=0.35) == "50"
    assert lengths([(0.0, 2.01), (2.39, 5.0)], 50, gap_seconds=0.35) == "22 28"


def test_rests_at_the_beginning_and_at_the_end():
    assert lengths([(1.5, 4.0)], 60) == "r15 25 r20"


def test_short_silences_at_the_ends_belong_to_the_clip_beside_them():
    assert lengths([(0.8, 2.0), (2.6, 4.0)], 50) == "23 27"
    assert lengths([(1.0, 2.0), (2.6, 4.0)], 50) == "23 27"


def test_a_rest_limit_below_the_gap_limit_comes_first():
    assert lengths([(0.0, 2.0), (3.5, 5.0)], 50, gap_seconds=3.0) == "20 r15 15"


def test_without_a_gap_limit_every_gap_is_cut():
    assert lengths([(0.0, 2.0), (2.1, 4.0), (4.0, 6.0)], 60, gap_seconds=0.0) == "20 40"


def test_overlapping_words_leave_no_gap():
    assert lengths([(0.0, 4.0), (1.0, 1.5), (3.5, 6.0)], 60) == "60"
    # The gap begins after the word that ends last.
    assert lengths([(0.0, 3.0), (1.0, 1.5), (3.6, 6.0)], 60) == "33 27"


def test_words_outside_the_frames_do_not_count():
    assert lengths([(-3.0, -1.0), (-1.0, 0.0), (2.0, 4.0), (6.0, 7.0), (8.0, 9.0)], 60) == "r20 20 r20"
    assert lengths([(-2.0, -1.0), (9.0, 9.5)], 60) == "r60"


def test_words_across_the_ends_are_clipped():
    assert lengths([(-2.0, 1.5), (4.0, 9.0)], 60) == "15 r25 20"


def test_an_instant_is_a_word():
    assert lengths([(0.0, 2.0), (2.3, 2.3), (2.6, 5.0)], 50) == "50"
    assert lengths([(3.0, 3.0)], 60) == "r25 10 r25"
    assert lengths([(0.0, 0.0)], 60) == "10 r50"
    # An instant at the very end is outside, as a word that starts there.
    assert lengths([(6.0, 6.0)], 60) == "r60"


# --- short clips --------------------------------------------------------------------------------------------


def test_a_short_clip_joins_the_neighbour_across_the_narrower_gap():
    assert lengths([(0.0, 2.0), (2.5, 2.8), (3.4, 6.0)], 60) == "31 29"
    assert lengths([(0.0, 2.0), (2.6, 2.9), (3.4, 6.0)], 60) == "23 37"


def test_between_equal_gaps_a_short_clip_joins_the_left_neighbour():
    assert lengths([(0.0, 2.0), (2.5, 2.8), (3.3, 6.0)], 60) == "30 30"
    # At 30 frames per second these 0.6 and 0.6 seconds differ by rounding, to the right one's advantage.
    assert lengths([(0.0, 2.6), (3.2, 3.5), (4.1, 7.0)], 210, fps=30.0) == "114 96"


def test_a_short_clip_joins_its_only_neighbour():
    assert lengths([(0.0, 0.5), (1.0, 3.0)], 30) == "30"
    assert lengths([(0.0, 2.0), (2.5, 3.0)], 30) == "30"
    assert lengths([(0.0, 2.0), (2.5, 2.8), (5.0, 7.0)], 70) == "28 r22 20"


def test_short_clips_join_until_they_are_long_enough():
    # 0 to 0.65 and 0.65 to 1.3 are joined; what follows is long enough.
    assert lengths([(0.0, 0.4), (0.9, 1.0), (1.6, 4.0)], 40) == "13 27"
    assert lengths([(0.0, 0.1), (0.6, 0.7), (1.2, 1.3)], 14) == "14"


def test_joined_short_clips_know_the_gap_on_either_side():
    # Gaps of 0.6, 0.5 and 0.55 seconds: the two words in the middle are joined first.
    words = [(0.0, 4.0), (4.6, 4.7), (5.2, 5.3), (5.85, 10.0)]
    assert lengths(words, 100, min_seconds=2.0) == "43 57"


def test_a_clip_of_exactly_the_minimum_stays():
    assert lengths([(0.0, 0.7), (1.3, 3.0)], 30) == "10 20"


def test_a_lone_word_between_rests_grows_evenly():
    assert lengths([(3.0, 3.4)], 70) == "r27 10 r33"
    # Seven frames are missing; the odd one comes from the left.
    assert lengths([(3.0, 3.3)], 70) == "r26 10 r34"


def test_a_lone_word_takes_no_more_than_a_rest_can_spare():
    assert lengths([(1.2, 1.6)], 70) == "r10 10 r50"
    assert lengths([(5.4, 5.8)], 70) == "r50 10 r10"
    assert lengths([(1.3, 1.7)], 30) == "r10 10 r10"


def test_a_lone_word_at_an_end_grows_into_its_only_rest():
    assert lengths([(0.0, 0.4)], 70) == "10 r60"
    assert lengths([(6.6, 7.0)], 70) == "r60 10"


def test_a_lone_word_takes_the_shorter_rest_where_both_have_too_little_to_spare():
    assert lengths([(1.2, 1.4)], 27) == "14 r13"
    assert lengths([(1.3, 1.5)], 27) == "r13 14"
    assert lengths([(1.2, 1.4)], 26) == "14 r12"
    assert lengths([(0.0, 0.2)], 15) == "15"


def test_a_rest_that_becomes_a_clip_is_a_neighbour():
    # The word at 4.3 takes the rest after it; so the word at 5.6 has a clip on its left, which it joins.
    words = [(0.0, 3.0), (4.3, 4.4), (5.6, 5.7), (6.9, 9.0)]
    assert lengths(words, 90) == "30 r13 14 r12 21"
    # Both words take the rest before them.
    words = [(0.0, 3.0), (4.2, 4.3), (5.5, 5.6), (6.8, 9.0)]
    assert lengths(words, 90) == "30 13 13 r12 22"


def test_a_rest_serves_the_words_on_both_sides_in_turn():
    # The first word leaves 14 of 18 frames, of which the second can have four, and six from its other side.
    assert lengths([(0.0, 0.6), (2.4, 2.4), (6.4, 8.0)], 80) == "10 r10 10 r34 16"


def test_the_whole_speech_stays_however_short():
    assert lengths([(0.1, 0.2)], 3) == "3"
    assert lengths([(0.0, 0.1), (0.6, 0.7)], 9) == "9"


def test_a_short_rest_goes_to_the_shorter_clip_beside_it():
    assert lengths([(0.0, 2.0), (2.7, 5.0)], 50, rest_seconds=0.5) == "27 23"
    assert lengths([(0.0, 3.0), (3.7, 5.0)], 50, rest_seconds=0.5) == "30 20"
    assert lengths([(0.0, 2.0), (2.7, 4.7)], 47, rest_seconds=0.5) == "27 20"


def test_a_short_rest_at_an_end_goes_to_its_only_neighbour():
    assert lengths([(0.7, 3.0)], 30, rest_seconds=0.5) == "30"
    assert lengths([(0.0, 2.3)], 30, rest_seconds=0.5) == "30"


def test_a_short_clip_between_short_rests_joins_across_the_narrower_one():
    # The word takes both rests, 0.4 and 0.5 seconds, and is still too short.
    assert lengths([(0.0, 3.0), (3.4, 3.4), (3.9, 7.0)], 70, rest_seconds=0.3) == "39 31"
    assert lengths([(0.0, 3.0), (3.5, 3.5), (3.9, 7.0)], 70, rest_seconds=0.3) == "30 40"


def test_a_short_clip_between_short_rests_may_be_long_enough_with_them():
    assert lengths([(0.0, 3.0), (3.6, 3.7), (4.4, 7.0)], 70, rest_seconds=0.5) == "30 14 26"


# --- long clips ---------------------------------------------------------------------------------------------


def test_a_long_clip_is_cut_at_its_widest_gap():
    assert lengths([(0.0, 3.0), (3.4, 7.0), (7.2, 12.0)], 120) == "32 88"
    assert lengths([(0.0, 3.0), (3.2, 7.0), (7.4, 12.0)], 120) == "72 48"


def test_a_clip_of_exactly_the_maximum_stays():
    assert lengths([(0.0, 3.0), (3.4, 10.0)], 100) == "100"
    assert lengths([(0.0, 3.0), (3.4, 10.1)], 101) == "32 69"


def test_of_equally_wide_gaps_the_one_nearest_to_the_middle_is_cut_then_the_left():
    assert lengths([(0.0, 2.0), (2.4, 5.0), (5.4, 8.0), (8.4, 12.0)], 120) == "52 68"
    # The middles are 4.2 and 7.8, as far from 6.0 either way.
    assert lengths([(0.0, 4.0), (4.4, 7.6), (8.0, 12.0)], 120) == "42 78"
    # At 30 frames per second these 0.4 and 0.4 seconds differ by rounding.
    assert lengths([(0.0, 3.4), (3.8, 8.2), (8.6, 12.0)], 360, fps=30.0) == "108 252"


def test_a_gap_too_near_to_an_end_is_not_cut():
    assert lengths([(0.0, 0.6), (1.0, 6.0), (6.2, 11.4), (11.6, 12.0)], 120) == "61 59"
    # Its middle leaves exactly the minimum.
    assert lengths([(0.0, 0.8), (1.2, 6.0), (6.2, 12.0)], 110) == "10 100"


def test_cutting_goes_on_until_no_clip_is_too_long():
    words = [(0.0, 2.0), (2.4, 10.0), (10.2, 14.0), (14.1, 25.0)]
    assert lengths(words, 250) == "22 79 39 55 55"


def test_a_silence_at_an_end_is_no_gap_between_words():
    assert lengths([(1.0, 6.0), (6.1, 11.5)], 120, min_seconds=0.1) == "60 60"
    assert lengths([(1.0, 11.5)], 130, min_seconds=0.1, rest_seconds=2.0) == "65 65"


def test_without_a_gap_a_long_clip_is_cut_before_its_slowest_frame():
    speeds = np.full(120, 5.0)
    speeds[[40, 80]] = 1.0, 2.0
    assert lengths([(0.0, 12.0)], 120, speeds=speeds) == "40 80"
    # Slower frames less than a second from an end do not count.
    speeds[[9, 111]] = 0.0
    assert lengths([(0.0, 12.0)], 120, speeds=speeds) == "40 80"
    speeds[110] = 0.0
    assert lengths([(0.0, 12.0)], 120, speeds=speeds) == "40 70 10"


def test_the_first_and_the_last_slow_frame_that_leave_enough():
    speeds = np.full(110, 5.0)
    speeds[10] = 1.0
    assert lengths([(0.0, 11.0)], 110, speeds=speeds) == "10 100"
    assert lengths([(0.0, 11.0)], 110, speeds=speeds[::-1]) == "99 11"
    assert lengths([(0.0, 11.0)], 110, speeds=np.roll(speeds, 90)) == "100 10"


def test_of_equally_slow_frames_the_one_nearest_to_the_middle_is_cut_then_the_left():
    assert lengths([(0.0, 12.0)], 120, speeds=np.zeros(120)) == "60 60"
    speeds = np.full(120, 5.0)
    speeds[[50, 70]] = 0.0
    assert lengths([(0.0, 12.0)], 120, speeds=speeds) == "50 70"
    speeds[69] = 0.0
    assert lengths([(0.0, 12.0)], 120, speeds=speeds) == "69 51"


def test_a_gap_comes_before_the_slowest_frame():
    speeds = np.full(120, 5.0)
    speeds[60] = 0.0
    assert lengths([(0.0, 3.0), (3.2, 12.0)], 120, speeds=speeds) == "31 89"


def test_without_gaps_and_speeds_the_parts_are_equal():
    assert lengths([(0.0, 12.1)], 121) == "60 61"
    # Halves of halves would be four.
    assert lengths([(0.0, 25.0)], 250) == "83 83 84"


def test_long_rests_are_cut_into_equal_parts():
    assert lengths([], 250) == "r83 r83 r84"
    assert lengths([(11.0, 13.0)], 140) == "r55 r55 30"
    assert lengths([(12.0, 14.0)], 260) == "r60 r60 20 r60 r60"
    assert lengths([(0.0, 2.0), (27.0, 29.0)], 290) == "20 r83 r83 r84 20"


def test_long_rests_are_cut_before_their_slowest_frame():
    speeds = np.full(150, 5.0)
    speeds[30] = 0.0
    assert lengths([(12.0, 15.0)], 150, speeds=speeds) == "r30 r90 30"
    assert lengths([(0.0, 1.0), (12.0, 15.0)], 150, speeds=speeds) == "10 r20 r90 30"


def test_what_is_cut_is_not_joined_again():
    # Parts of barely the minimum lie beside each other.
    words = [(0.0, 2.1), (2.6, 3.7), (4.2, 6.0)]
    assert lengths(words, 60, min_seconds=1.0, max_seconds=2.0) == "11 12 16 10 11"


def test_a_maximum_that_is_twice_the_minimum_only_before_rounding():
    # At 29.97 frames per second a clip has 30 frames at least and 59 at most.
    assert lengths([(0.0, 2.0)], 59, fps=29.97, max_seconds=2.0) == "59"
    assert lengths([(0.0, 2.1)], 60, fps=29.97, max_seconds=2.0) == "30 30"
    # At 4.9 half a second is 3 frames and a second 4, of which 5 cannot be cut in two.
    assert lengths([(0.0, 2.0)], 5, fps=4.9, min_seconds=0.5, max_seconds=1.0) == "5"
    assert lengths([(0.0, 2.0)], 6, fps=4.9, min_seconds=0.5, max_seconds=1.0) == "3 3"


def test_speeds_of_another_length_are_refused():
    with pytest.raises(ValueError, match="do not fit 50 frames"):
        cut([(0.0, 5.0)], 50, FPS, Cutting(), np.zeros(49))


# --- the table of thresholds --------------------------------------------------------------------------------


def test_a_row_of_thresholds_by_hand():
    words = [(0.0, 2.0), (2.3, 5.0), (5.6, 8.0), (10.0, 12.0)]
    rows = threshold_row(words, 120, FPS, Cutting(), (0.2, 0.4, 0.6))
    assert rows.dtype == float and rows.tolist() == [[4, 10.0], [3, 10.0], [2, 10.0]]


def test_thresholds_of_silence_are_zero():
    assert threshold_row([], 50, FPS, Cutting()).tolist() == [[0, 0]] * len(THRESHOLDS)
    assert threshold_row([], 50, FPS, Cutting(), ()).shape == (0, 2)


def test_thresholds_know_the_speeds():
    speeds = np.full(250, 5.0)
    speeds[10:240:10] = 0.0
    assert threshold_row([(0.0, 25.0)], 250, FPS, Cutting(), (0.4,), speeds)[0, 0] > 3
    assert threshold_row([(0.0, 25.0)], 250, FPS, Cutting(), (0.4,))[0, 0] == 3


# --- every speech -------------------------------------------------------------------------------------------


def random_speech(seed):
    """Words on a raster finer than the frames, some overlapping, of no length or outside; settings; speeds."""
    rng = np.random.default_rng(seed)
    n_frames = int(rng.integers(1, 400))
    count = int(rng.integers(0, 30))
    starts = np.sort(rng.integers(-20, 2 * n_frames + 20, count)) / 20
    ends = starts + rng.choice([0.0, 0.05, 0.3, 0.5, 2.0], count)
    minimum = float(rng.choice([0.05, 0.33, 1.0, 2.0]))
    settings = Cutting(
        gap_seconds=float(rng.choice([0.0, 0.2, 0.4, 1.5])),
        rest_seconds=float(rng.choice([0.1, 0.5, 1.0, 3.0])),
        min_seconds=minimum,
        max_seconds=minimum * float(rng.choice([2.0, 2.5, 10.0])),
    )
    speeds = [None, np.zeros(n_frames), rng.random(n_frames), rng.integers(0, 3, n_frames) / 2][seed % 4]
    return list(zip(starts.tolist(), ends.tolist(), strict=True)), n_frames, settings, speeds


SEEDS = range(12)


@SMALL
@given(st.integers(0, 10**6), st.sampled_from([7.3, 10.0, 29.97]))
def test_the_clips_cover_every_frame_once_and_have_allowed_lengths(seed, fps):
    for seed_ in range(seed, seed + len(SEEDS)):
        words, n_frames, settings, speeds = random_speech(seed_)
        cuts = cut(words, n_frames, fps, settings, speeds)
        assert [frame for piece in cuts for frame in range(piece.start, piece.end)] == list(range(n_frames))
        shortest = int(np.ceil(settings.min_seconds * fps - 1e-6))
        longest = max(int(np.floor(settings.max_seconds * fps + 1e-6)), 2 * shortest - 1)
        assert all(1 <= piece.end - piece.start <= longest for piece in cuts)
        # Only a speech that is too short itself is too short a clip.
        if n_frames < shortest:
            assert len(cuts) == 1
        else:
            assert all(piece.end - piece.start >= shortest for piece in cuts)


@SMALL
@given(st.integers(0, 10**6))
def test_an_instant_at_the_start_of_a_word_changes_nothing(seed):
    for seed_ in range(seed, seed + len(SEEDS)):
        words, n_frames, settings, speeds = random_speech(seed_)
        rng = np.random.default_rng(seed_)
        doubled = []
        for start, end in words:
            doubled += [[(start, end)], [(start, start), (start, end)], [(start, end), (start, start)]][rng.integers(3)]
        assert cut(doubled, n_frames, FPS, settings, speeds) == cut(words, n_frames, FPS, settings, speeds)


@SMALL
@given(st.integers(0, 10**6))
def test_without_limits_of_length_equals_runs_of_silent_frames(seed):
    rng = np.random.default_rng(seed)
    for _ in SEEDS:
        n_frames, gap, rest = int(rng.integers(1, 60)), int(rng.integers(0, 6)), int(rng.integers(1, 9))
        starts = np.sort(rng.integers(0, n_frames, rng.integers(0, 6)))
        spans = [(start, min(start + int(rng.integers(1, 5)), n_frames)) for start in starts.tolist()]
        heard = [any(start <= frame < end for start, end in spans) for frame in range(n_frames)]
        borders, frame = {0, n_frames}, 0
        while frame < n_frames:
            end = frame
            while end < n_frames and not heard[end]:
                end += 1
            if end - frame > rest:
                borders |= {frame, end}
            elif end - frame > gap and frame > 0 and end < n_frames:
                borders.add((frame + end) // 2)
            frame = end + 1
        words = [(start / FPS, end / FPS) for start, end in spans]
        cuts = cut(words, n_frames, FPS, Cutting(gap_seconds=gap / FPS, rest_seconds=rest / FPS, **ANY_LENGTH))
        assert [piece.start for piece in cuts] == sorted(borders)[:-1]
        for piece in cuts:
            assert piece.rest == (not any(heard[piece.start : piece.end])) or not spans


@SMALL
@given(st.integers(0, 10**6))
def test_rests_hold_no_word(seed):
    for seed_ in range(seed, seed + len(SEEDS)):
        words, n_frames, settings, speeds = random_speech(seed_)
        for piece in cut(words, n_frames, FPS, settings, speeds):
            # Words and rests are on a raster finer than the frames, so they may share one at the ends.
            inside = [word for word in words if word[0] * FPS < piece.end - 1 and word[1] * FPS > piece.start + 1]
            assert not (piece.rest and inside)


def test_ten_thousand_words_take_little_time():
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.exponential(0.15, 20_000))
    words = list(zip(times[::2].tolist(), times[1::2].tolist(), strict=True))
    n_frames = int(30 * times[-1]) + 1
    start = time.thread_time()  # of this thread alone: however busy the machine is
    cuts = cut(words, n_frames, 30.0, Cutting(), rng.random(n_frames))
    print(f"{time.thread_time() - start:.2f} s")
    assert len(cuts) > 300 and time.thread_time() - start < 10.0


def test_a_long_talk_without_gaps_takes_little_time():
    # A speed that only rises makes every cut the most lopsided one.
    start = time.thread_time()
    cuts = cut([(0.0, 1000.0)], 30_000, 30.0, Cutting(), np.arange(30_000.0))
    print(f"{time.thread_time() - start:.2f} s")
    assert len(cuts) == 991 and time.thread_time() - start < 10.0

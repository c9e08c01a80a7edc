"""Key nodes of speeches and references, and their features."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.data.keynodes import KeyNodes, of_reference, of_speech
from gesturegen.methods.motion_graph import start_nodes
from gesturegen.methods.motion_graph.settings import Features
from tests import naive, tiny

THREE = Features(l_feat=3, w_full=(1.0, 0.5, 0.5))
PRINTED = Features(l_feat=3, w_full=(1.0, 0.5, 0.5), align="as_printed")


def rows(nodes):
    return [tuple(row) for row in zip(nodes.frames.tolist(), nodes.kinds, nodes.keywords, strict=True)]


def still(frames):
    return tiny.motion(np.random.default_rng(0), frames)


def test_keyword_goes_over_onset_and_onset_over_break():
    reference = tiny.reference(still(10), onsets=[2, 4, 9], words=[("hi", 4, 6), ("one", 6, 7)], segment_starts=[0, 7])
    assert rows(of_reference(reference, tiny.WORDS)) == [
        (2, "onset", ""), (4, "keyword", "greeting"), (6, "keyword", "counting"), (9, "onset", ""),
    ]  # fmt: skip


def test_every_segment_ends_in_a_break():
    reference = tiny.reference(still(10), segment_starts=[0, 3, 4])
    assert rows(of_reference(reference, tiny.WORDS)) == [(2, "break", ""), (3, "break", ""), (9, "break", "")]


def test_a_reference_of_one_frame_has_a_break():
    assert rows(of_reference(tiny.reference(still(1)), tiny.WORDS)) == [(0, "break", "")]


def test_a_run_of_one_keyword_marks_its_first_frame():
    speech = tiny.speech(30, words=[("hi", 3, 6), ("hello", 6, 9), ("one", 9, 12), ("um", 12, 13), ("one", 13, 15)])
    assert rows(of_speech(speech, tiny.WORDS)) == [
        (3, "keyword", "greeting"), (9, "keyword", "counting"), (13, "keyword", "counting"),
    ]  # fmt: skip


def test_a_test_speech_has_no_breaks():
    speech = tiny.speech(20, onsets=[0, 5, 25], words=[("hello", 8, 9), ("what", 12, 14)])
    assert rows(of_speech(speech, tiny.WORDS)) == [(0, "onset", ""), (5, "onset", ""), (8, "keyword", "greeting")]
    assert rows(of_speech(tiny.speech(20), tiny.WORDS)) == []


def test_onsets_that_round_to_one_frame_count_once():
    speech = tiny.speech(20)
    object.__setattr__(speech, "onset_times", np.array([0.099, 0.101, 0.3]))
    assert rows(of_speech(speech, tiny.WORDS)) == [(3, "onset", ""), (9, "onset", "")]


def test_excluded_frames_lose_their_key_nodes_and_shift_the_rest():
    # Frames 5 to 9 are excluded: the recording's frame 12 is the motion's frame 7.
    kept = [*range(5), *range(10, 15)]
    words = [("hi", 7, 9), ("one", 13, 14)]
    reference = tiny.reference(still(10), [2, 5, 9, 10, 12], words, segment_starts=[0, 5], source_frames=kept)
    assert rows(of_reference(reference, tiny.WORDS)) == [
        (2, "onset", ""), (4, "break", ""), (5, "onset", ""), (7, "onset", ""), (8, "keyword", "counting"),
        (9, "break", ""),
    ]  # fmt: skip


def test_columns_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match="as many kinds and keywords as frames"):
        KeyNodes(np.array([1, 2]), np.array(["onset"]), np.array([""]))


# --- features -----------------------------------------------------------------------------------------------


def features(frames, boundaries, start, end, rules):
    count = len(frames)
    found = start_nodes.features(
        np.array(frames), np.array(boundaries), np.full(count, start), np.full(count, end), rules
    )
    return found.tolist()


def test_features_are_the_lengths_of_the_following_pieces():
    boundaries = [3, 5, 9, 16, 20]
    assert features([3, 5, 9, 16, 20], boundaries, 0, 20, THREE) == [
        [2, 4, 7], [4, 7, 4], [7, 4, 0], [4, 0, 0], [0, 0, 0],
    ]  # fmt: skip


def test_printed_features_start_one_piece_earlier():
    boundaries = [3, 5, 9, 16, 20]
    assert features([3, 5, 9, 16, 20], boundaries, 0, 20, PRINTED) == [
        [3, 2, 4], [2, 4, 7], [4, 7, 4], [7, 4, 0], [4, 0, 0],
    ]  # fmt: skip


def test_features_stay_inside_their_segment():
    boundaries = [3, 9, 12, 15, 30]
    assert features([12, 15], boundaries, 10, 20, THREE) == [[3, 5, 0], [5, 0, 0]]
    # The first node of a segment follows its start, not the key node of the segment before.
    assert features([12, 15], boundaries, 10, 20, PRINTED) == [[2, 3, 5], [3, 5, 0]]
    assert features([10], [9, 10, 12], 10, 20, PRINTED) == [[0, 2, 8]]


def test_the_start_and_end_of_the_test_speech_count():
    nodes = tiny.key_nodes([(4, "onset"), (10, "onset")])
    assert start_nodes.speech_features(nodes, np.array([0, 4, 10]), 25, THREE).tolist() == [
        [4, 6, 15], [6, 15, 0], [15, 0, 0],
    ]  # fmt: skip
    assert start_nodes.speech_features(nodes, np.array([0, 4]), 25, PRINTED).tolist() == [[0, 4, 6], [4, 6, 15]]
    assert start_nodes.speech_features(tiny.key_nodes([]), np.array([0]), 25, THREE).tolist() == [[25, 0, 0]]


@settings(deadline=None, derandomize=True, max_examples=150)
@given(
    seed=st.integers(0, 10_000), length=st.integers(1, 60), count=st.integers(0, 25), l_feat=st.integers(1, 12),
    align=st.sampled_from(["following", "as_printed"]),
)  # fmt: skip
def test_features_equal_the_naive_ones(seed, length, count, l_feat, align):
    rng = np.random.default_rng(seed)
    start = int(rng.integers(0, 20))
    end = start + length
    inside = np.unique([*rng.integers(start, end + 1, size=count), end])
    boundaries = np.unique([*inside, start - 1, end + 4]) if start else inside
    rules = Features(l_feat=l_feat, w_full=(1.0,) * l_feat, align=align)
    expected = [naive.feature(int(frame), boundaries.tolist(), start, end, rules) for frame in inside]
    assert features(inside, boundaries, start, end, rules) == expected

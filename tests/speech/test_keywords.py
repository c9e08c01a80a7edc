import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gesturegen.speech.keywords import keyword_frames
from gesturegen.speech.transcript import Word
from tests.builders import SMALL

WORDS = {"hey": "hey", "hi": "hey", "one": "one", "two": "two"}


def found(words, n_frames=100, fps=10.0):
    """(frame, keyword) pairs for words given as (text, first frame, end frame)."""
    frames, keywords = keyword_frames([Word(text, a / fps, b / fps) for text, a, b in words], WORDS, n_frames, fps)
    assert len(frames) == len(keywords)
    return list(zip(frames.tolist(), keywords.tolist(), strict=True))


def test_a_keyword_marks_its_first_frame():
    assert found([("so", 0, 5), ("hey", 5, 12), ("you", 12, 20)]) == [(5, "hey")]


def test_frame_0_can_be_a_keyword():
    assert found([("one", 0, 3)]) == [(0, "one")]


def test_adjacent_repeats_are_one_run():
    assert found([("hey", 5, 8), ("hey", 8, 12)]) == [(5, "hey")]


def test_repeats_with_a_gap_are_two_runs():
    assert found([("hey", 5, 8), ("hey", 9, 12)]) == [(5, "hey"), (9, "hey")]


def test_repeats_with_another_word_between_are_two_runs():
    assert found([("hey", 5, 8), ("you", 8, 9), ("hey", 9, 12)]) == [(5, "hey"), (9, "hey")]


def test_spellings_share_a_keyword_and_a_run():
    assert found([("hi", 5, 8), ("hey", 8, 12), ("hi", 20, 22)]) == [(5, "hey"), (20, "hey")]


def test_adjacent_keywords_are_two_runs():
    assert found([("one", 5, 8), ("two", 8, 12)]) == [(5, "one"), (8, "two")]


def test_where_words_overlap_the_later_one_counts():
    assert found([("one", 5, 12), ("two", 8, 15)]) == [(5, "one"), (8, "two")]
    assert found([("one", 5, 12), ("so", 5, 12)]) == []
    assert found([("one", 5, 12), ("so", 7, 9)]) == [(5, "one"), (9, "one")]


def test_a_word_of_no_length_covers_one_frame():
    assert found([("one", 5, 5)]) == [(5, "one")]
    assert found([("one", 5, 5), ("one", 6, 6)]) == [(5, "one")]
    assert found([("one", 5, 6), ("one", 7, 8)]) == [(5, "one"), (7, "one")]


@pytest.mark.parametrize(("start", "end", "expected"), [(99, 100, [(99, "one")]), (99, 300, [(99, "one")])])
def test_a_word_at_the_very_end(start, end, expected):
    assert found([("one", start, end)]) == expected


@pytest.mark.parametrize("start", (100, 101, 500))
def test_words_past_the_end_mark_nothing(start):
    assert found([("one", start, start + 5)]) == []


def test_no_words_and_no_keywords():
    assert found([]) == []
    assert found([("so", 1, 4), ("called", 4, 9)]) == []


def test_one_frame():
    assert found([("one", 0, 9)], n_frames=1) == [(0, "one")]


@SMALL
@given(
    st.lists(st.tuples(st.sampled_from(["hey", "hi", "one", "so"]), st.integers(0, 40), st.integers(0, 9)), max_size=8)
)
def test_runs_are_what_painting_frame_by_frame_gives(cells):
    words = [(text, start, start + length) for text, start, length in sorted(cells, key=lambda cell: cell[1])]
    painted = [""] * 40
    for text, start, end in words:
        for frame in range(start, max(end, start + 1)):
            if frame < 40:
                painted[frame] = WORDS.get(text, "")
    expected = [(n, k) for n, k in enumerate(painted) if k and (n == 0 or painted[n - 1] != k)]
    assert found(words, n_frames=40) == expected


def test_keywords_are_text_when_there_are_none():
    frames, keywords = keyword_frames([], WORDS, 10, 30.0)
    assert keywords.dtype.kind == "U" and np.issubdtype(frames.dtype, np.integer)

"""Pauses of a speech, by hand and against an obvious restatement."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.data import keynodes
from gesturegen.methods.gesture_master.extraction import spoken
from gesturegen.methods.motion_graph.graph import phrase_nodes
from gesturegen.runs import runs
from gesturegen.settings.speech import Pauses, Phrases
from gesturegen.speech.pauses import phrase_ends, speaking_frames
from gesturegen.speech.transcript import Word
from tests import naive, tiny


def marks(n_frames, words=(), onsets=(), fps=10.0, limit=0.5):
    """Words as (first frame, end frame); the result as a string, `.` in pauses and `S` elsewhere."""
    spoken = [Word("so", start / fps, end / fps) for start, end in words]
    states = speaking_frames(spoken, np.array(onsets, dtype=int), n_frames, fps, limit)
    assert states.dtype == bool and states.shape == (n_frames,)
    return "".join("S" if state else "." for state in states)


def test_a_speech_without_words_and_onsets_is_one_pause():
    assert marks(6) == "......"


def test_a_short_speech_without_words_is_no_pause():
    # Five frames are exactly half a second.
    assert marks(5) == "SSSSS"


def test_a_gap_of_exactly_the_limit_is_no_pause():
    assert marks(9, [(0, 2), (7, 9)]) == "SSSSSSSSS"
    assert marks(10, [(0, 2), (8, 10)]) == "SS......SS"


@pytest.mark.parametrize(("fps", "limit"), [(30.0, 0.7), (30.0, 1.1), (29.97, 1.0), (10.0, 0.3), (120.0, 0.35)])
def test_the_limit_is_exact_whatever_its_rounding(fps, limit):
    frames = int(np.floor(limit * fps + 1e-6))
    assert marks(frames + 2, onsets=[0, frames + 1], fps=fps, limit=limit) == "S" * (frames + 2)
    assert marks(frames + 3, onsets=[0, frames + 2], fps=fps, limit=limit) == "S" + "." * (frames + 1) + "S"


def test_pauses_at_the_beginning_and_at_the_end_count():
    assert marks(14, [(6, 8)]) == "......SS......"
    assert marks(12, [(5, 7)]) == "SSSSSSSSSSSS"


def test_an_onset_alone_ends_a_pause():
    assert marks(13, onsets=[6]) == "......S......"
    assert marks(11, onsets=[5]) == "SSSSSSSSSSS"


def test_an_onset_at_the_first_and_the_last_frame():
    assert marks(8, onsets=[0, 7]) == "S......S"


def test_short_gaps_do_not_add_up():
    assert marks(11, [(5, 6)]) == "S" * 11
    assert marks(12, onsets=[3, 8], limit=0.3) == "SSSS....SSSS"


def test_without_a_limit_every_silent_frame_is_a_pause():
    assert marks(7, [(1, 3)], [5], limit=0.0) == ".SS..S."


def test_a_word_of_no_length_is_heard_for_a_frame():
    assert marks(13, [(6, 6)]) == "......S......"


def test_words_may_overlap_and_come_in_any_order():
    assert marks(14, [(10, 14), (0, 4), (2, 4)]) == "SSSS......SSSS"


def test_words_after_the_end_are_not_heard():
    assert marks(8, [(8, 12), (20, 30)]) == "........"
    assert marks(8, [(6, 30)]) == "......SS"


def test_words_before_the_beginning_are_not_heard():
    assert marks(8, [(-3, 2)]) == "SS......"
    assert marks(8, [(-3, 0)]) == "........"
    assert marks(8, [(-5, -3)]) == "........"


@settings(deadline=None, derandomize=True, max_examples=300)
@given(seed=st.integers(0, 10_000), limit=st.sampled_from([0.0, 0.1, 0.25, 0.3, 0.5, 2.0]))
def test_equals_a_count_of_silent_frames(seed, limit):
    rng = np.random.default_rng(seed)
    n_frames = int(rng.integers(1, 40))
    words = [
        (start, start + int(rng.integers(0, 5))) for start in rng.integers(0, n_frames, rng.integers(0, 4)).tolist()
    ]
    onsets = rng.integers(0, n_frames, rng.integers(0, 3)).tolist()
    heard = {frame for start, end in words for frame in range(start, max(end, start + 1))} | set(onsets)
    assert marks(n_frames, words, onsets, limit=limit) == naive.pauses(heard, n_frames, 10 * limit)


def test_the_frames_of_a_reference_are_judged_in_its_recording():
    # Silence from frame 2 to 20, of which the frames 5 to 14 are not to be used.
    kept = [*range(5), *range(15, 22)]
    moved = tiny.motion(np.random.default_rng(0), len(kept))
    reference = tiny.reference(moved, [20], [("so", 0, 2)], (0, 5), kept)
    states = keynodes.reference_speaking(reference, Pauses(min_seconds=0.5))
    # Frame 21 follows the onset by too little for a pause.
    assert states.tolist() == [frame < 2 or frame >= 20 for frame in kept]
    assert keynodes.reference_speaking(reference, Pauses(min_seconds=0.6)).all()
    assert keynodes.speaking(reference.speech, Pauses()).tolist() == [f < 2 or f >= 20 for f in range(22)]


def ends_of_phrases(*words, gap=0.2):
    return phrase_ends([Word("a", *times) for times in words], Phrases(min_gap_seconds=gap)).tolist()


def test_a_phrase_ends_where_no_word_follows_soon():
    assert ends_of_phrases() == []
    assert ends_of_phrases((0.0, 1.0)) == [1.0], "the last word ends one"
    assert ends_of_phrases((0.0, 1.0), (1.1, 2.0), (2.5, 3.0)) == [2.0, 3.0]
    assert ends_of_phrases((2.5, 3.0), (0.0, 1.0), (1.1, 2.0)) == [2.0, 3.0]
    assert ends_of_phrases((0.0, 1.0), (1.2, 2.0), gap=0.2) == [2.0], "a gap of exactly the limit ends none"
    # A longer word of another speaker goes on over both.
    assert ends_of_phrases((0.0, 4.0), (1.0, 2.0), (3.0, 3.5), (6.0, 7.0)) == [4.0, 7.0]


def test_the_ends_of_phrases_of_a_reference_are_nodes_that_may_be_used():
    kept = [*range(5), *range(15, 40)]
    words = [("so", 0, 3), ("cut", 8, 12), ("on", 20, 25), ("end", 33, 36)]
    reference = tiny.reference(tiny.motion(np.random.default_rng(0), len(kept)), (), words, (0, 5), kept)
    assert phrase_nodes(reference, Phrases(min_gap_seconds=0.1)).tolist() == [3, 15, 26]


# --- what is heard in place of words, and beside them -------------------------------------------------------

HEARD = np.array([(0.5, 1.0), (1.1, 2.0), (4.0, 4.02)])


def test_a_voice_is_no_pause():
    found = speaking_frames([], np.zeros(0, dtype=int), 150, 30.0, 0.5, HEARD)
    assert runs(~found).tolist() == [[60, 120], [121, 150]]  # half a second before the first is no longer than that
    word = [Word("a", 2.0, 2.5)]
    assert runs(~speaking_frames(word, np.zeros(0, dtype=int), 150, 30.0, 0.5, HEARD)).tolist() == [
        [75, 120],
        [121, 150],
    ]


def test_phrases_of_a_voice_end_where_it_stops_unless_there_are_words():
    settings = Phrases(min_gap_seconds=0.2)
    np.testing.assert_allclose(phrase_ends([], settings, HEARD), [2.0, 4.02])
    np.testing.assert_allclose(phrase_ends([Word("a", 0.0, 3.0)], settings, HEARD), [3.0])


def test_words_of_a_voice_begin_at_its_onsets():
    heard = spoken([], np.array([0.7, 1.1, 3.0]), HEARD)
    assert heard == [(0.5, 0.7), (0.7, 1.0), (1.1, 2.0), (3.0, 3.0), (4.0, 4.02)]
    assert spoken([Word("a", 0.0, 3.0)], np.array([0.7]), HEARD) == [(0.0, 3.0)]
    assert spoken([], np.array([0.7])) == [(0.7, 0.7)]

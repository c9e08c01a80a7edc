"""Where keyword gestures are shown."""

import pytest

from gesturegen.control.gestures import Placement, placements
from gesturegen.errors import DataError
from gesturegen.settings.control import Control
from tests import tiny
from tests.builders import refused

# Ten seconds; (word, first frame, end frame) at 30 frames per second.
WORDS = [("no", 30, 36), ("stop", 60, 75), ("don't", 90, 99), ("stop", 150, 160)]


def place(*entries, words=WORDS, clip="tst_001", frames=300):
    control = Control.model_validate({"gestures": entries}, strict=False)
    shown, notes = placements(control, tiny.speech(frames, words=words, name=clip))
    assert all(isinstance(placement, Placement) for placement in shown)
    return [(round(placement.time, 6), placement.gesture) for placement in shown], notes


def test_a_gesture_at_every_start_of_its_word():
    assert place({"word": "stop", "gesture": "palm"}) == ([(2, "palm"), (5, "palm")], [])


@pytest.mark.parametrize("word", ["STOP", "Stop!", "'stop'"])
def test_words_are_compared_as_transcripts_have_them(word):
    assert len(place({"word": word, "gesture": "palm"})[0]) == 2


def test_an_apostrophe_may_be_typeset():
    assert place({"word": "Don’t", "gesture": "shake"}) == ([(3, "shake")], [])


def test_a_part_of_a_word_is_not_the_word():
    assert place({"word": "sto", "gesture": "palm"}) == ([], [])


def test_a_gesture_at_a_time():
    assert place({"at": 0, "gesture": "wave"}, {"at": 9.9, "gesture": "bow"}) == ([(0, "wave"), (9.9, "bow")], [])


def test_gestures_come_in_order_of_time():
    entries = [{"at": 7, "gesture": "bow"}, {"word": "stop", "gesture": "palm"}, {"word": "no", "gesture": "shake"}]
    assert place(*entries)[0] == [(1, "shake"), (2, "palm"), (5, "palm"), (7, "bow")]


def test_only_the_entries_of_the_clip_count():
    entries = [
        {"clip": name, "at": n, "gesture": name} for n, name in enumerate(["tst_001", "tst_002", "tst_*", "trn*", "*"])
    ]
    assert [gesture for _, gesture in place(*entries)[0]] == ["tst_001", "tst_*", "*"]
    assert [gesture for _, gesture in place(*entries, clip="tst_001_main-agent")[0]] == ["tst_001", "tst_*", "*"]


def test_a_word_that_is_never_said_is_noted_where_the_clip_is_named():
    assert place({"word": "yes", "gesture": "nod"}, {"clip": "tst_0*", "word": "yes", "gesture": "nod"}) == ([], [])
    assert place({"word": "no", "gesture": "shake"}, {"clip": "tst_001", "word": "Yes", "gesture": "nod"}) == (
        [(1, "shake")],
        ["gesture 2 (nod): the word 'Yes' is never said"],
    )
    assert place({"word": "no", "gesture": "shake"}, words=[]) == ([], [])


def test_gestures_that_are_too_close_are_left_out_with_a_note():
    entries = [{"at": 1.3, "gesture": "bow"}, {"word": "no", "gesture": "shake"}, {"at": 1.6, "gesture": "wave"}]
    # The wave is far enough from the shake, which alone is shown before it.
    assert place(*entries) == (
        [(1, "shake"), (1.6, "wave")],
        ["gesture bow at 1.30 s comes less than 0.5 s after shake at 1.00 s, so it is left out"],
    )


def test_half_a_second_is_far_enough():
    for frame in range(0, 250, 7):
        entries = [{"at": frame / 30, "gesture": "a"}, {"at": (frame + 15) / 30, "gesture": "b"}]
        assert len(place(*entries)[0]) == 2


def test_of_two_gestures_at_one_time_the_first_of_the_file_is_shown():
    entries = [{"word": "no", "gesture": "shake"}, {"at": 1, "gesture": "bow"}]
    shown, notes = place(*entries)
    assert shown == [(1, "shake")] and len(notes) == 1
    assert place(*entries[::-1])[0] == [(1, "bow")]


def test_a_gesture_past_the_end_of_its_clip_is_refused():
    with refused(DataError, r"^clip tst_001: gesture 2 \(wave\): at 10 s, the clip ends at 10\.00 s$"):
        place({"word": "no", "gesture": "shake"}, {"clip": "tst_001", "at": 10, "gesture": "wave"})


def test_every_gesture_past_the_end_gets_its_own_line():
    with pytest.raises(DataError) as caught:
        place(*({"clip": "tst_001", "at": at, "gesture": "wave"} for at in (11, 3, 12)))
    assert [line[:24] for line in str(caught.value).splitlines()] == [
        "clip tst_001: gesture 1 ",
        "clip tst_001: gesture 3 ",
    ]


def test_a_gesture_past_the_end_of_a_clip_that_a_glob_matches_is_noted():
    assert place({"at": 12.5, "gesture": "wave"}, {"at": 1, "gesture": "bow"}) == (
        [(1, "bow")],
        ["gesture 1 (wave): at 12.5 s, the clip ends at 10.00 s, so it is left out"],
    )


def test_without_entries_nothing_is_shown():
    assert place() == ([], [])

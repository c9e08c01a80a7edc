import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gesturegen.errors import DataError
from gesturegen.speech import transcript, transcripts
from gesturegen.speech.transcript import Word
from tests.builders import SMALL, data_folder, literally, refused


@pytest.fixture
def read(tmp_path):
    def read(content, duration=10.0):
        path = tmp_path / "clip.tsv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return transcripts.read(path, duration)

    return read


def texts(words):
    return [word.text for word in words]


@pytest.mark.parametrize(
    ("written", "bare"),
    [
        ("Hello,", "hello"),
        ("YES!", "yes"),
        ("Yeah#.", "yeah"),
        ("###", ""),
        ("#", ""),
        ("(?)", ""),
        ("...", ""),
        ("--", ""),
        ("_", ""),
        ("Don't", "don't"),
        ("don\N{RIGHT SINGLE QUOTATION MARK}t", "don't"),
        ("'cause", "cause"),
        ('"quoted"', "quoted"),
        ("well-known;", "well-known"),
        ("wait-", "wait"),
        ("Café.", "café"),
        ("2,000", "2000"),
    ],
)
def test_words_are_bare(written, bare):
    assert transcript.normalize(written) == bare


def test_plain_lines(read):
    words, notes = read("0\t0.2\tSo,\n0.2\t0.6\tHello!\n6.928\t7\tyes\n")
    assert words == (Word("so", 0.0, 0.2), Word("hello", 0.2, 0.6), Word("yes", 6.928, 7.0))
    assert notes == []


def test_a_cell_with_several_words_is_split_evenly(read):
    words, _ = read("1.0\t2.2\tone, two three\n")
    assert texts(words) == ["one", "two", "three"]
    for word, start, end in zip(words, (1.0, 1.4, 1.8), (1.4, 1.8, 2.2), strict=True):
        assert (word.start, word.end) == (pytest.approx(start), pytest.approx(end))


def test_laughter_and_marks_take_no_share_of_a_cell(read):
    words, notes = read("1\t2\t### hey (?) you #\n3\t4\t###\n")
    assert words == (Word("hey", 1.0, 1.5), Word("you", 1.5, 2.0))
    assert notes == []


@pytest.mark.parametrize(
    ("start", "end", "frames"),
    [
        (0.0, 0.2, (0, 6)),
        (0.3, 0.6, (9, 18)),  # 0.3 * 30 is 8.999...
        (0.1, 0.1, (3, 4)),
        (0.101, 0.102, (3, 4)),
        (1 / 3, 0.5, (10, 15)),
        (0.0333, 0.0667, (0, 2)),
        (60.928, 61.0, (1827, 1830)),
    ],
)
def test_frames_of_a_word(start, end, frames):
    assert Word("a", start, end).frames(30.0) == frames


@SMALL
@given(st.integers(0, 100_000), st.integers(1, 500), st.sampled_from([24.0, 30.0, 60.0]))
def test_times_on_the_grid_hit_their_frame(frame, length, fps):
    word = Word("a", frame / fps, (frame + length) / fps)
    assert word.frames(fps) == (frame, frame + length)
    rounded = Word("a", round(frame / fps, 9), round((frame + length) / fps, 9))
    assert rounded.frames(fps) == (frame, frame + length)


# --- what works, with a note --------------------------------------------------------------------------------


@pytest.mark.parametrize("content", ("", "\n \r\n\n"))
def test_an_empty_file_has_no_words_and_is_noted(read, content):
    words, notes = read(content)
    assert words == () and len(notes) == 1
    assert notes[0].startswith("clip.tsv: ") and "empty" in notes[0]


def test_unsorted_words_are_sorted_and_counted(read):
    words, notes = read("3\t3.5\tc\n1\t1.5\ta\n2\t2.5\tb\n")
    assert texts(words) == ["a", "b", "c"]
    assert notes == ["clip.tsv: words out of order, sorted: 2"]


def test_overlapping_words_stay_and_are_counted(read):
    words, notes = read("1\t2\ta\n1.5\t2.5\tb\n2.5\t3\tc\n")
    assert texts(words) == ["a", "b", "c"]
    assert notes == ["clip.tsv: words that overlap the next one: 1"]


def test_words_outside_the_audio_are_dropped_and_counted(read):
    words, notes = read("-2\t-1\ta\n-1\t0\tb\n1\t2\tc\n10\t11\td\n12\t13\te f\n")
    assert texts(words) == ["c"]
    assert notes == ["clip.tsv: words outside the audio, dropped: 5"]


def test_words_across_the_ends_are_clipped_and_counted(read):
    words, notes = read("-0.5\t0.5\ta\n9.5\t10.5\tb\n")
    assert words == (Word("a", 0.0, 0.5), Word("b", 9.5, 10.0))
    assert notes == ["clip.tsv: words that reach beyond the audio, clipped: 2"]


def test_words_that_end_before_they_start_are_dropped_and_counted(read):
    words, notes = read("2\t1\ta\n3\t4\tb\n6\t5\tc d\n")
    assert texts(words) == ["b"]
    assert notes == ["clip.tsv: words that end before they start, dropped: 3"]


def test_a_word_without_length_stays(read):
    words, notes = read("0\t0\ta\n2\t2\tb\n")
    assert words == (Word("a", 0.0, 0.0), Word("b", 2.0, 2.0)) and notes == []


def test_latin_1_is_read_and_noted(read):
    words, notes = read("0\t1\tcafé\n".encode("latin-1"))
    assert texts(words) == ["café"]
    assert notes == ["clip.tsv: not UTF-8, read as Latin-1"]


@pytest.mark.parametrize("mark", (b"\x85", b"\x91", b"\x93", b"\x96"), ids=["ellipsis", "quote", "quotes", "dash"])
def test_windows_punctuation_is_no_line_break(read, mark):
    words, _ = read(b"0\t1\twell" + mark + b" yes\n1\t2\tno\n")
    assert texts(words) == ["well", "yes", "no"]


@pytest.mark.parametrize("mark", ("\N{LINE SEPARATOR}", "\N{NEXT LINE}", "\x0c", "\x1c"))
def test_only_newlines_end_a_line(read, mark):
    words, _ = read(f"0\t1\twell{mark}yes\n1\t2\tno\n")
    assert texts(words)[-1] == "no"


def test_crlf_and_a_byte_order_mark_and_no_final_newline(read):
    words, notes = read(b"\xef\xbb\xbf0\t1\tone\r\n1\t2\ttwo")
    assert texts(words) == ["one", "two"] and notes == []


def test_space_separated_columns(read):
    words, notes = read("0.13 0.43 Nice\n0.43  0.54   to\n 1 2 meet you all\n")
    assert texts(words) == ["nice", "to", "meet", "you", "all"] and notes == []


def test_an_empty_cell_is_no_word(read):
    assert read("0\t1\t\n1\t2\t \n")[0] == ()


# --- what is refused ----------------------------------------------------------------------------------------

BROKEN = {
    "a time without end": ("0\t1\ta\n0\t1e308\tb\n", 2, "column 2 is '1e308', not a time in seconds"),
    "a time with an underscore": ("1_0\t11\ta\n", 1, "column 1 is '1_0', not a time in seconds"),
    "an Arabic time": ("٣\t4\ta\n", 1, "column 1 is '٣', not a time in seconds"),
    "letters for the start": ("0\t1\ta\nx\t2\tb\n", 2, "column 1 is 'x', not a time in seconds"),
    "letters for the end": ("0\t1\ta\n1\ttwo\tb\n", 2, "column 2 is 'two', not a time in seconds"),
    "a header without ends": ("start\ttext\n0\ta\n", 1, "the header has no column for the end; found start, text"),
    "a header without texts": ("start\tend\n0\t1\n", 1, "the header has no column for the text"),
    "two units": ("start_ms\tend_s\ttext\n0\t1\ta\n", 1, "the header has two units of time"),
    "a header of other names": ("a\tb\tc\n0\t1\ta\n", 1, "column 1 is 'a', not a time"),
    "nan": ("0\tnan\ta\n", 1, "column 2 is 'nan'"),
    "infinity": ("0\tinf\ta\n", 1, "column 2 is 'inf'"),
    "an empty time": ("\t1\ta\n", 1, "column 1 is ''"),
    "frames of video": ("00:00:01:12\t00:00:02:00\ta\n", 1, "column 1 is '00:00:01:12'"),
    "one column": ("0\t1\ta\n1\n", 2, "1 columns in .*; expected start<TAB>end<TAB>text"),
    "four columns": ("0\t1\ta\tb\n", 1, "4 columns in"),
    "text first": ("hello\t0\t1\n", 1, "column 1 is 'hello'"),
    "commas for points and between": ("0,1,0,2,hello\n", 1, "'0,1,0,2,hello'"),
    "spaces and no text": ("0.1 0.2\n", 1, "2 columns in"),
    "blank lines before": ("\n\nx\t2\tb\n", 3, "column 1 is 'x'"),
    "conflict": ("<<<<<<< HEAD\n0\t1\ta\n", 1, "merge conflict marker"),
    "middle of a conflict": ("0\t1\ta\n=======\n0\t1\ta\n", 2, "merge conflict marker"),
}


def test_an_lfs_pointer_is_called_one(read, tmp_path):
    with refused(DataError, "Git LFS pointer", tmp_path / "clip.tsv"):
        read("version https://git-lfs.github.com/spec/v1\noid sha256:1\nsize 1\n")


@pytest.mark.parametrize(("content", "line", "match"), BROKEN.values(), ids=BROKEN)
def test_broken_transcripts_are_refused_with_their_line(read, tmp_path, content, line, match):
    with refused(DataError, literally(tmp_path / "clip.tsv", line) + ".*" + match):
        read(content)


def test_binary_is_refused(read, tmp_path):
    with refused(DataError, "binary data, not a transcript", tmp_path / "clip.tsv"):
        read(b"0\t1\ta\x00\n")


def test_a_missing_file_is_named(tmp_path):
    with refused(DataError, r"cannot be read \(No such file", tmp_path / "none.tsv"):
        transcripts.read(tmp_path / "none.tsv", 1.0)


# --- any cells ----------------------------------------------------------------------------------------------

TIMES = st.floats(-5, 15, allow_nan=False).map(lambda t: round(t, 3))
CELLS = st.lists(st.tuples(TIMES, TIMES, st.sampled_from(["a", "B!", "one two", "###", "x # y z"])), max_size=8)
COUNT = {"a": 1, "B!": 1, "one two": 2, "###": 0, "x # y z": 3}


@SMALL
@given(CELLS)
def test_every_word_is_kept_in_order_inside_the_audio_or_counted(tmp_path_factory, cells):
    path = tmp_path_factory.mktemp("tsv") / "clip.tsv"
    path.write_text("".join(f"{start}\t{end}\t{text}\n" for start, end, text in cells))
    words, notes = transcripts.read(path, 10.0)
    dropped = sum(int(count) for note in notes for count in re.findall(r"dropped: (\d+)", note))
    assert len(words) + dropped == sum(COUNT[text] for _, _, text in cells)
    assert all(0 <= word.start <= word.end <= 10 and word.start < 10 for word in words)
    assert [word.start for word in words] == sorted(word.start for word in words)


# --- real files ---------------------------------------------------------------------------------------------


def test_real_transcripts_are_read():
    folder = data_folder()
    for path in sorted(folder.glob("genea_*/*/main-agent/tsv/*.tsv")):
        words, notes = transcripts.read(path, 70.0)
        assert len(words) > 40, path
        assert all(word.text and math.isfinite(word.end) for word in words)
        assert not [note for note in notes if "dropped" in note], path


def test_the_real_space_separated_transcript_is_read():
    words, notes = transcripts.read(data_folder() / "speech" / "tts" / "tts_align_process.tsv", 9.264)
    assert texts(words)[:5] == ["nice", "to", "meet", "you", "all"] and notes == []

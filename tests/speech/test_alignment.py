"""Forced alignment of texts: pronunciations, and times on real speech beside those of others."""

import numpy as np
import pytest

from gesturegen.errors import DataError
from gesturegen.speech import alignment, audio, pronunciation, transcripts
from gesturegen.speech.transcript import syllables
from tests.builders import bursts, data_folder, refused, write_audio
from tests.commands import run, succeed

DICTIONARY = {
    "twenty": "T W EH N T IY", "three": "TH R IY", "two": "T UW", "thousand": "TH AW Z AH N D", "and": "AE N D",
    "style": "S T AY L", "gesture": "JH EH S CH ER", "percent": "P ER S EH N T", "third": "TH ER D", "fifty": "F IH F T IY",
    "john": "JH AA N",
}  # fmt: skip


@pytest.mark.parametrize(
    ("word", "ways", "guessed"),
    [
        ("Gesture,", ["JH EH S CH ER"], False),
        ("StyleGesture&", ["S T AY L JH EH S CH ER AE N D"], False),
        ("gesture-style", ["JH EH S CH ER S T AY L"], False),
        ("TTS", ["T IY T IY EH S"], False),
        ("John's", ["JH AA N Z"], False),
        ("3rd", ["TH ER D"], False),
        ("50%", ["F IH F T IY P ER S EH N T"], False),
        ("yknow", ["Y K N OW"], True),
        ("chase", ["CH EY S"], True),
        ("###", [], False),
        ("\u4f60\u597d", [], False),
    ],
)
def test_words_that_no_dictionary_has_are_pronounced(word, ways, guessed):
    pytest.importorskip("inflect")
    found = pronunciation.pronounce(word, DICTIONARY.get)
    assert found == (ways, guessed)


def test_a_year_may_be_a_quantity():
    pytest.importorskip("inflect")
    ways, _ = pronunciation.pronounce("2023", DICTIONARY.get)
    assert "T W EH N T IY T W EH N T IY TH R IY" in ways and len(ways) == 2


@pytest.mark.parametrize(
    ("word", "count"),
    [("a", 1), ("please", 1), ("banana", 3), ("table", 2), ("café", 2), ("hmm", 1), ("the", 1), ("2014", 4)],
)
def test_syllables(word, count):
    assert syllables(word) == count


def real(name):
    folder = data_folder() / "speech/mfa"
    samples, rate = audio.read_samples(folder / f"{name}.wav")
    words, _ = transcripts.read(folder / f"{name}.TextGrid", len(samples) / rate)
    return samples, rate, words


@pytest.mark.slow
def test_real_speech_is_aligned_to_a_tenth_of_a_second():
    pytest.importorskip("pocketsphinx")
    samples, rate, words = real("acoustic_corpus")
    found = alignment.align([word.text for word in words], samples, rate, "a.txt")
    assert [cell.text for cell in found.cells] == [word.text for word in words]
    errors = np.abs([cell.start - word.start for cell, word in zip(found.cells, words, strict=True)])
    assert np.median(errors) <= 0.02 and np.mean(errors <= 0.1) > 0.9
    assert found.by_rule == ("yknow",) and not found.spread
    assert found.described() == "; pronounced by rule: yknow"


@pytest.mark.slow
def test_long_speech_is_aligned_in_pieces():
    pytest.importorskip("pocketsphinx")
    samples, rate, words = real("acoustic_corpus")
    seconds = len(samples) / rate
    assert 4 * seconds > alignment._LONG_SECONDS
    found = alignment.align([word.text for word in words] * 4, np.tile(samples, 4), rate, "a.txt")
    starts = [word.start + seconds * copy for copy in range(4) for word in words]
    errors = np.abs([cell.start - start for cell, start in zip(found.cells, starts, strict=True)])
    assert np.median(errors) <= 0.02 and np.mean(errors <= 0.1) > 0.9
    assert [cell.start for cell in found.cells] == sorted(cell.start for cell in found.cells)


@pytest.mark.slow
def test_words_that_cannot_be_pronounced_are_spread_and_named():
    pytest.importorskip("pocketsphinx")
    samples, rate, words = real("acoustic_corpus")
    texts = [word.text for word in words]
    found = alignment.align([*texts[:3], "\u4f60\u597d", *texts[4:]], samples, rate, "a.txt")
    assert found.spread == ("\u4f60\u597d",) and len(found.cells) == len(texts)
    assert found.cells[2].end <= found.cells[3].start <= found.cells[3].end <= found.cells[4].start


@pytest.mark.slow
@pytest.mark.parametrize("copies", [3, 300], ids=["after all beams", "at once"])
def test_a_text_of_something_else_is_refused(tmp_path, copies):
    pytest.importorskip("pocketsphinx")
    write_audio(tmp_path / "a.wav", bursts((0.5, 1.2), 2.0))
    (tmp_path / "a.txt").write_text("Far too many words for two seconds of sound, " * copies)
    result = run("align", tmp_path, "-j", 1)
    assert result.exit_code == 1 and f"a.txt: its {9 * copies} words cannot be found in 2.0 s of sound" in result.output
    assert not (tmp_path / "a.tsv").exists()


@pytest.mark.slow
def test_align_writes_what_preprocess_finds_by_itself(tmp_path):
    pytest.importorskip("pocketsphinx")
    speech = data_folder() / "speech/tts"
    for name in ("tts.wav", "tts.txt"):
        (tmp_path / name).write_bytes((speech / name).read_bytes())
    samples, rate = audio.read_samples(tmp_path / "tts.wav")
    on_the_fly, notes = transcripts.read(tmp_path / "tts.txt", len(samples) / rate, (samples, rate))
    assert notes == ["tts.txt: a text without times, aligned with the sound; pronounced by rule: genea"]
    result = succeed("align", tmp_path / "tts.wav", "-j", 1)
    assert "tts: 22 words; pronounced by rule: genea" in result.output
    written, notes = transcripts.read(tmp_path / "tts.tsv", len(samples) / rate)
    assert written == on_the_fly and notes == []
    assert "\t2023\n" in (tmp_path / "tts.tsv").read_text()  # as it was written, though said "twenty twenty three"
    before = (tmp_path / "tts.tsv").read_bytes()
    again = run("align", tmp_path, "-j", 1)
    assert "tts.tsv is there already; --force writes over it" in again.output
    succeed("align", tmp_path, "-j", 1, "--force")
    assert (tmp_path / "tts.tsv").read_bytes() == before


@pytest.mark.slow
def test_transcribe_warns_of_its_quality(tmp_path):
    pytest.importorskip("pocketsphinx")
    folder = data_folder() / "speech/tts"
    result = succeed("transcribe", folder / "tts.wav", "--output", tmp_path, "-j", 1)
    assert "every third word is wrong" in result.output
    words, _ = transcripts.read(tmp_path / "tts.tsv", 10.0)
    assert {"nice", "to", "this", "is"} & {word.text for word in words}


def test_align_says_what_to_do_about_what_it_cannot_use(tmp_path):
    pytest.importorskip("pocketsphinx")
    with refused(DataError, "no word in it; write down what is said"):
        (tmp_path / "a.txt").write_text("[laughs]")
        transcripts.align(tmp_path / "a.txt", np.zeros(16000, np.float32), 16000)
    with refused(DataError, "has times already"):
        (tmp_path / "a.txt").write_text("0.1\t0.2\thello\n")
        transcripts.align(tmp_path / "a.txt", np.zeros(16000, np.float32), 16000)
    assert "no text beside a sound; expected a.txt beside a.wav" in run("align", tmp_path).output
    assert "no such file or folder" in run("align", tmp_path / "none").output

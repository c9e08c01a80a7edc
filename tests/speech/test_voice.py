"""Voice activity on speech whose words are known, on silence, noise, tones and their like."""

import numpy as np
import pytest

from gesturegen.demo import speech as demo_speech
from gesturegen.demo.speaker import speaker
from gesturegen.demo.voice import synthesize
from gesturegen.settings.speech import Pauses
from gesturegen.settings.speech import Voice as Settings
from gesturegen.speech import voice
from gesturegen.speech.transcript import Word
from gesturegen.speech.voice import Voice

DEFAULTS = Settings()
RATE = voice.WINDOWS_PER_SECOND


def covered(spans, seconds):
    """The windows that spans cover, bool."""
    times = (np.arange(int(seconds * RATE)) + 0.5) / RATE
    return np.any([(times >= start) & (times < end) for start, end in spans] or [times < 0], axis=0)


@pytest.mark.parametrize("gain", (1.0, 0.02))
def test_demo_speech_is_heard_where_its_words_are(gain):
    """It is made of voiced syllables, and no recording that the network has learned."""
    rng, who = np.random.default_rng(3), speaker(1, 0)
    script = demo_speech.write_script(rng, who, 30.0)
    samples = gain * synthesize(rng, who, script)
    said = covered([(word.start, word.end) for word in script.words], 30.0)
    found = voice.measure(samples, 16000).speaking(DEFAULTS)[: len(said)]
    assert (found & said).sum() > 0.9 * said.sum()
    assert (found & said).sum() > 0.9 * found.sum()
    again = voice.measure(samples, 16000).speaking(DEFAULTS)[: len(said)]
    np.testing.assert_array_equal(found, again)


def noise(seconds, height, seed=0):
    return (height * np.random.default_rng(seed).standard_normal(round(seconds * 16000))).astype(np.float32)


@pytest.mark.parametrize("samples", (noise(3, 0.1), noise(3, 1e-4), np.zeros(48000), np.zeros(0), noise(0.01, 0.1)))
def test_noise_and_silence_are_no_speech(samples):
    found = voice.measure(samples, 16000)
    assert len(found.probabilities) == int(np.ceil(len(samples) / 512))
    assert not found.speaking(DEFAULTS).any()


def test_a_sound_in_which_no_voice_is_known_is_decided_by_its_loudness():
    """Tones are no speech to the network, but no silence either."""
    times = np.arange(16000 * 8) / 16000
    tone = np.where((times > 2) & (times < 6), 0.2 * np.sin(2 * np.pi * 1500 * times), 0) + noise(8, 1e-4)
    found = voice.measure(tone, 16000)
    assert not found.is_known(DEFAULTS)
    (span,) = voice.spans(found.speaking(DEFAULTS))
    np.testing.assert_allclose(span, (2, 6), atol=0.05)


def windows(*stretches):
    """A `Voice` of (seconds, probability, level)."""
    rows = [np.tile(row, (round(seconds * RATE), 1)) for seconds, *row in stretches]
    probabilities, levels = np.concatenate(rows).T
    return Voice(probabilities, levels)


# A word at 1 to 2 s, and loud speech without one at 4 to 5 s, and the faint speech of somebody else at 7 to 8 s.
SAID = windows((1, 0, -70), (1, 1, -20), (2, 0, -70), (1, 1, -24), (2, 0, -70), (1, 1, -45), (1, 0, -70))
WORD = (Word("hello", 1.0, 2.0),)


@pytest.mark.parametrize(
    ("words", "pauses", "expected"),
    [
        ((), "without_words", [(1, 2), (4, 5), (7, 8)]),
        ((), "always", [(1, 2), (4, 5), (7, 8)]),
        (WORD, "without_words", []),
        (WORD, "always", [(4, 5)]),
    ],
)
def test_what_is_heard_beside_the_words(words, pauses, expected):
    found = voice.beside_words(SAID, words, DEFAULTS, Pauses(voice=pauses))
    np.testing.assert_allclose(found, np.reshape(expected, (-1, 2)), atol=0.1)


def test_ends_of_words_that_ring_on_are_not_missed_speech():
    ringing = windows((1, 0, -70), (1.4, 1, -20), (2, 0, -70))
    assert not len(voice.beside_words(ringing, WORD, DEFAULTS, Pauses(voice="always")))


def test_speech_is_what_is_heard_and_what_is_written():
    found = voice.voiced(SAID, (Word("faint", 2.5, 3.0), Word("late", 8.9, 9.5)), DEFAULTS)
    expected = [(1, 2), (2.5, 3), (4, 5), (7, 8), (8.9, 9.5)]
    np.testing.assert_allclose(found, expected, atol=0.1)
    np.testing.assert_allclose(voice.voiced(None, WORD, DEFAULTS), [(1, 2)], atol=0.05)


def test_gaps_and_blips_below_the_limit_are_none():
    found = windows((1, 1, -20), (0.064, 0, -20), (1, 1, -20), (1, 0, -70), (0.064, 1, -20), (1, 0, -70))
    np.testing.assert_allclose(voice.spans(found.speaking(DEFAULTS)), [(0, 2.06)], atol=0.02)
    assert len(voice.spans(found.speaking(Settings(smoothing_seconds=0.0)))) == 3

"""Loudness and pitch against sounds whose loudness and pitch are known."""

import math
import warnings

import numpy as np
import pytest

from gesturegen.settings.speech import Prosody
from gesturegen.speech.prosody import Contour, measure

DEFAULTS = Prosody()


def semitones(hertz):
    return 12 * np.log2(hertz)


def tone(hertz, seconds, rate=16000, harmonics=5):
    """A voice-like sum of harmonics; `hertz` is a number or a function of the time in seconds."""
    times = np.arange(round(seconds * rate)) / rate
    pitch = hertz(times) if callable(hertz) else np.full(len(times), float(hertz))
    phase = 2 * np.pi * np.cumsum(pitch) / rate
    return sum(0.1 / k * np.sin(k * phase) for k in range(1, harmonics + 1)).astype(np.float32)


def times_of(contour):
    return np.arange(len(contour.pitch)) / contour.rate


@pytest.mark.parametrize("rate", (8000, 16000, 44100))
def test_the_pitch_of_a_glide_is_found(rate):
    def glide(times):
        return 120 * 2 ** (times / 2)

    contour = measure(tone(glide, 2.0, rate), rate, DEFAULTS)
    times = times_of(contour)
    # The window reaches over the ends of the sound there.
    inside = (times > 0.1) & (times < 1.9)
    np.testing.assert_allclose(contour.pitch[inside], semitones(glide(times[inside])), atol=0.3)


@pytest.mark.parametrize("hertz", (75.0, 131.0, 220.0, 440.0))
def test_the_pitch_of_a_steady_tone_is_found(hertz):
    contour = measure(tone(hertz, 1.0), 16000, DEFAULTS)
    np.testing.assert_allclose(contour.pitch[3:-3], semitones(hertz), atol=0.15)


def test_pitch_does_not_depend_on_loudness():
    sound = tone(150, 1.0)
    np.testing.assert_array_equal(measure(sound, 16000, DEFAULTS).pitch, measure(sound / 16, 16000, DEFAULTS).pitch)


def test_the_energy_of_a_sine_is_its_rms_in_decibels():
    sound = 0.5 * np.sin(2 * np.pi * 200 * np.arange(16000) / 16000)
    contour = measure(sound, 16000, DEFAULTS)
    np.testing.assert_allclose(contour.energy[3:-3], 20 * math.log10(0.5 / math.sqrt(2)), atol=0.1)
    quieter = measure(sound / 10, 16000, DEFAULTS)
    np.testing.assert_allclose(quieter.energy[3:-3], contour.energy[3:-3] - 20, atol=1e-3)


def test_there_is_a_value_every_hop():
    contour = measure(tone(150, 2.0), 16000, DEFAULTS)
    assert contour.rate == 25.0
    assert contour.energy.shape == contour.pitch.shape == (51,)
    assert contour.energy.dtype == contour.pitch.dtype == np.float64
    # A sound that sets in after one second is heard at value 25.
    late = np.concatenate([np.zeros(16000), tone(150, 1.0)])
    energy = measure(late, 16000, DEFAULTS).energy
    assert (energy[:23] == -80).all() and (energy[25:50] > -25).all()


def test_a_gap_is_unvoiced():
    sound = tone(150, 2.0)
    sound[12000:20000] = 0.0
    contour = measure(sound, 16000, DEFAULTS)
    times = times_of(contour)
    assert np.isnan(contour.pitch[(times > 0.85) & (times < 1.15)]).all()
    assert np.isfinite(contour.pitch[(times > 0.1) & (times < 0.65)]).all()
    assert np.isfinite(contour.pitch[(times > 1.35) & (times < 1.9)]).all()
    assert (contour.energy[(times > 0.85) & (times < 1.15)] == -80).all()


def test_noise_is_unvoiced():
    noise = 0.1 * np.random.default_rng(0).standard_normal(16000)
    contour = measure(noise, 16000, DEFAULTS)
    assert np.isfinite(contour.pitch).mean() < 0.1
    assert (contour.energy > -30).all()


@pytest.mark.parametrize("sound", (np.zeros(16000), np.full(16000, 0.25), np.zeros(1)), ids=("zeros", "level", "one"))
def test_sound_without_a_voice_has_no_pitch_and_raises_no_warning(sound):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        contour = measure(sound, 16000, DEFAULTS)
    assert np.isnan(contour.pitch).all()
    assert np.isfinite(contour.energy).all() and (contour.energy >= -80).all()
    if not sound.any():
        assert (contour.energy == -80).all()


@pytest.mark.parametrize("count", (1, 2, 100, 1023, 1024, 1025, 2049))
@pytest.mark.parametrize("rate", (8000, 22050))
def test_audio_shorter_than_the_window_works_without_a_warning(count, rate):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        contour = measure(tone(200, 1.0, rate)[:count], rate, DEFAULTS)
    assert len(contour.energy) == len(contour.pitch) > 0
    assert np.isfinite(contour.energy).all()


@pytest.mark.parametrize(
    "settings",
    (
        Prosody(hop_length=3200),
        Prosody(hop_length=20),
        Prosody(pitch_min=20),
        Prosody(pitch_min=140, pitch_max=170),
        Prosody(sample_rate=4000, pitch_max=400),
        Prosody(sample_rate=22050, hop_length=512),
    ),
    ids=("long hop", "short hop", "deep", "narrow", "low rate", "high rate"),
)
def test_other_settings_find_the_pitch_without_a_warning(settings):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        contour = measure(tone(150, 1.0), 16000, settings)
    assert contour.rate == settings.sample_rate / settings.hop_length
    times = times_of(contour)
    inside = (times > 0.2) & (times < 0.8)
    assert inside.any()
    np.testing.assert_allclose(contour.pitch[inside], semitones(150), atol=0.3)


def test_the_same_sound_gives_the_same_numbers():
    sound = tone(lambda times: 150 + 30 * np.sin(9 * times), 1.0)
    kept = sound.copy()
    first, second = measure(sound, 16000, DEFAULTS), measure(sound, 16000, DEFAULTS)
    assert first.energy.tobytes() == second.energy.tobytes() and first.pitch.tobytes() == second.pitch.tobytes()
    np.testing.assert_array_equal(sound, kept)


def test_a_contour_cannot_be_written_to_and_must_fit_together():
    contour = Contour(np.zeros(3), np.zeros(3), 25.0)
    for values in (contour.energy, contour.pitch):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0
    for energy, pitch in ((3, 2), (0, 0)):
        with pytest.raises(ValueError, match="do not fit"):
            Contour(np.zeros(energy), np.zeros(pitch), 25.0)

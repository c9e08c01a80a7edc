"""MFCC and log mean energy against sounds whose energy and spectrum are known."""

import warnings

import numpy as np
import pytest
import scipy.fft

from gesturegen.settings.speech import Acoustics as Settings
from gesturegen.speech.acoustics import Acoustics, measure

DEFAULTS = Settings()


def sine(hertz, seconds, rate=22050, height=0.5):
    return (height * np.sin(2 * np.pi * hertz * np.arange(round(seconds * rate)) / rate)).astype(np.float32)


@pytest.mark.parametrize("rate", (16000, 22050, 44100))
def test_there_are_fourteen_values_fifteen_times_a_second(rate):
    acoustics = measure(sine(200, 2.0, rate), rate, DEFAULTS)
    assert acoustics.values.shape == (31, 14) and acoustics.values.dtype == np.float32 and acoustics.rate == 15.0
    assert not acoustics.values.flags.writeable
    other = measure(sine(200, 2.0, rate), rate, Settings(sample_rate=16000, rate=20, coefficients=5))
    assert other.values.shape == (41, 6) and other.rate == 20.0


def test_energy_is_the_logarithm_of_the_mean_square():
    energy = measure(sine(200, 1.0), 22050, DEFAULTS).values[:, -1]
    # A sine's mean square is half the square of its height; the window reaches over the ends of the sound.
    np.testing.assert_allclose(energy[1:-1], np.log(0.5**2 / 2), atol=0.02)
    quieter = measure(sine(200, 1.0, height=0.05), 22050, DEFAULTS).values[:, -1]
    np.testing.assert_allclose(quieter, energy - np.log(100), atol=1e-4)


def test_a_value_is_that_of_its_time():
    samples = np.zeros(22050 * 2, dtype=np.float32)
    samples[22050 : 22050 + 40] = 1.0  # at 1 s, which is value 15
    values = measure(samples, 22050, DEFAULTS).values
    assert values[:, -1].argmax() == 15
    # Neighbours are 1470 samples away and see 1024: nothing of it.
    np.testing.assert_allclose(np.delete(values[:, -1], 15), np.log(1e-10), rtol=1e-6)


def test_coefficients_are_the_cosine_transform_of_the_mel_decibels():
    import librosa

    samples = np.random.default_rng(0).normal(size=22050).astype(np.float32) * 0.1
    values = measure(samples, 22050, DEFAULTS).values
    mel = librosa.feature.melspectrogram(y=samples, sr=22050, n_fft=2048, hop_length=1470)
    decibels = 10 * np.log10(np.maximum(mel, 1e-10))
    decibels = np.maximum(decibels, decibels.max() - 80)
    wanted = scipy.fft.dct(decibels, axis=0, norm="ortho")[:13].T
    np.testing.assert_allclose(values[:, :13], wanted, rtol=1e-4, atol=1e-3)


def test_coefficients_tell_a_low_sound_from_a_high_one():
    low, high = (measure(sine(hertz, 1.0), 22050, DEFAULTS).values[5] for hertz in (200, 5000))
    assert low[1] > 0 > high[1] and low[-1] == pytest.approx(high[-1], abs=0.02)


@pytest.mark.parametrize("length", (0, 1, 100, 2047, 2048, 22050))
def test_silent_and_short_audio_is_finite(length):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for samples in (np.zeros(length), np.full(length, 0.1)):
            values = measure(samples, 22050, DEFAULTS).values
            assert np.isfinite(values).all() and len(values) == 1 + max(length, 2048) // 1470
    silent = measure(np.zeros(length), 22050, DEFAULTS).values
    np.testing.assert_allclose(silent[:, -1], np.log(1e-10), rtol=1e-6)
    np.testing.assert_array_equal(silent, np.repeat(silent[:1], len(silent), axis=0))


def test_values_of_another_shape_are_refused():
    for shape in ((3,), (0, 14), (3, 0), (1, 2, 3)):
        with pytest.raises(ValueError, match="shape"):
            Acoustics(np.zeros(shape), 15.0)

"""The demo speakers' voice: source-filter synthesis of a script, vectorised.

A harmonic source follows the pitch contour; one bank of formant filters per vowel is gated by the syllables;
consonants are bursts and noise at syllable starts; a noise floor lies under it all.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import oaconvolve, sosfilt

from gesturegen.demo.speaker import Speaker
from gesturegen.demo.speech import Script, Syllable, consonants_and_vowel

SAMPLE_RATE = 16000

# First three formants in Hz; "n" is the murmur of nasals and liquids. After Peterson and Barney 1952.
_FORMANTS = {
    "a": (710, 1400, 2500),
    "e": (530, 1840, 2480),
    "i": (330, 2250, 2950),
    "o": (570, 900, 2410),
    "u": (340, 980, 2240),
    "n": (260, 1200, 2200),
}
_UPPER_FORMANTS = (3400, 4300, 5300, 6300)  # the same for all vowels
_BANDWIDTHS = (80.0, 110.0, 160.0, 250.0, 350.0, 450.0, 550.0)
_PULSE_POWER = 400  # sharpness of the glottal pulses
_STOPS = set("ptkbdgcqx")
_FRICATIVES = set("fsvzhj")
_VOICE_LEVEL = 0.23
_FLOOR_LEVEL = 2.2e-3
_ROOM_LEVEL = 0.015
_ROOM_SECONDS = 0.08


def synthesize(rng: np.random.Generator, speaker: Speaker, script: Script) -> np.ndarray:
    """Synthesize a whole script: samples at SAMPLE_RATE `[shape=(round(seconds * SAMPLE_RATE),)]`, within -1 to 1."""
    n = round(script.seconds * SAMPLE_RATE)
    gates = {vowel: np.zeros(n) for vowel in _FORMANTS}
    noise_gates = {"burst": np.zeros(n), "hiss": np.zeros(n), "breath": np.zeros(n)}
    for word in script.words:
        if not word.syllables:
            _add_laughter(rng, gates, noise_gates, word.start, word.end)
        for syllable in word.syllables:
            _add_syllable(rng, gates, noise_gates, syllable)
    source = _source(rng, speaker, script, n)
    samples = np.zeros(n)
    for vowel, gate in gates.items():
        if gate.any():
            samples += sosfilt(_formant_filter(_FORMANTS[vowel], speaker.tract), source * gate)
    samples *= _VOICE_LEVEL
    noise = rng.standard_normal(n)
    samples += sosfilt(_high_pass(), noise * noise_gates["hiss"]) * 0.05
    samples += noise * noise_gates["burst"] * 0.12
    samples += sosfilt(_formant_filter(_FORMANTS["a"], speaker.tract), noise * noise_gates["breath"]) * 0.01
    samples = oaconvolve(samples, _room(rng))[:n]
    samples += _FLOOR_LEVEL * rng.standard_normal(n)
    return np.clip(samples, -0.98, 0.98)


def _room(rng: np.random.Generator) -> np.ndarray:
    """Make the impulse response of a small room: the direct sound, then a decaying tail.

    Without it the gaps between syllables would be silent, and every syllable a far stronger onset than in
    a recorded voice.
    """
    tail = rng.standard_normal(round(0.35 * SAMPLE_RATE)) * _ROOM_LEVEL
    tail *= np.exp(-np.arange(len(tail)) / (_ROOM_SECONDS * SAMPLE_RATE))
    tail[: round(0.004 * SAMPLE_RATE)] = 0.0
    tail[0] = 1.0
    return tail


def _source(rng: np.random.Generator, speaker: Speaker, script: Script, n: int) -> np.ndarray:
    """Make a pulse train whose pitch falls over every phrase and rises on stress, with a little vibrato."""
    times = np.arange(0.0, n / SAMPLE_RATE + 0.01, 0.01)
    pitch = np.full(len(times), speaker.pitch)
    for start, end in script.phrases:
        inside = (times >= start) & (times <= end)
        pitch[inside] *= np.interp(times[inside], [start, end], [1.14, 0.84])
    for word in script.words:
        for s in word.syllables:
            if s.stress:
                near = (times > s.start - 0.2) & (times < s.end + 0.2)
                centre = 0.5 * (s.vowel_start + s.end)
                pitch[near] *= 1.0 + 0.24 * s.stress * np.exp(-(((times[near] - centre) / 0.09) ** 2))
    drift = np.convolve(rng.standard_normal(len(times)), np.hanning(21) / 10.0, mode="same")
    pitch *= 1.0 + 0.02 * drift
    phase = np.cumsum(np.interp(np.arange(n) / SAMPLE_RATE, times, pitch)) / SAMPLE_RATE
    # Bounded pulses, less their mean: a cosine to the power p has about the root of p harmonics before it fades.
    return np.cos(np.pi * phase) ** _PULSE_POWER - np.sqrt(2.0 / (np.pi * _PULSE_POWER))


def _add_syllable(
    rng: np.random.Generator, gates: dict[str, np.ndarray], noise_gates: dict[str, np.ndarray], syllable: Syllable
) -> None:
    """Open the gates of one syllable: consonants before the vowel, the vowel, consonants after it."""
    before, vowel, after = consonants_and_vowel(syllable)
    level = 0.4 + 0.7 * syllable.stress
    start, middle, end = syllable.start, syllable.vowel_start, syllable.end
    # A stop closes the mouth before it bursts; its silence makes the onset that follows.
    attack = 0.012 if set(before) & _STOPS or not before else 0.03
    _gate(gates[vowel], middle - 0.3 * attack, end - (0.04 if after else 0.015), attack, 0.04, level)
    if set(before) & _STOPS:
        _gate(noise_gates["burst"], middle - 0.022, middle + 0.004, 0.002, 0.012, level * rng.uniform(0.7, 1.2))
    elif set(before) & _FRICATIVES:
        _gate(noise_gates["hiss"], start, middle + 0.01, 0.02, 0.02, level * rng.uniform(0.7, 1.3))
    elif before:
        _gate(gates["n"], start, middle + 0.01, 0.02, 0.02, 0.35 * level)
    if set(after) & _FRICATIVES:
        _gate(noise_gates["hiss"], end - 0.07, end, 0.03, 0.02, 0.4 * level)
    elif after and not set(after) & _STOPS:
        _gate(gates["n"], end - 0.05, end, 0.02, 0.02, 0.3 * level)


def _add_laughter(
    rng: np.random.Generator, gates: dict[str, np.ndarray], noise_gates: dict[str, np.ndarray], start: float, end: float
) -> None:
    """Add a row of breathy voiced bursts about five a second, fading."""
    beats = np.arange(start, end - 0.08, rng.uniform(0.16, 0.22))
    for beat, level in zip(beats, np.linspace(0.9, 0.3, len(beats)), strict=True):
        _gate(gates["a"], beat, beat + 0.09, 0.015, 0.05, level)
        _gate(noise_gates["breath"], beat - 0.02, beat + 0.13, 0.02, 0.05, 6.0 * level)


def _gate(target: np.ndarray, start: float, end: float, attack: float, release: float, level: float) -> None:
    """Raise `target` to `level` from `start` to `end` seconds, with raised-cosine flanks."""
    first, last = round(start * SAMPLE_RATE), round(end * SAMPLE_RATE)
    first, last = max(first, 0), min(last, len(target))
    if last <= first:
        return
    t = np.arange(last - first)
    rise = np.minimum((t + 1) / (attack * SAMPLE_RATE), 1.0)
    fall = np.minimum((last - first - t) / (release * SAMPLE_RATE), 1.0)
    shape = 0.5 - 0.5 * np.cos(np.pi * np.minimum(rise, fall))
    target[first:last] = np.maximum(target[first:last], level * shape)


def _formant_filter(formants: tuple[int, ...], tract: float) -> np.ndarray:
    """Design second-order sections of a cascade of resonators with gain 1 at 0 Hz (Klatt 1980)."""
    sections = []
    for frequency, bandwidth in zip((*formants, *_UPPER_FORMANTS), _BANDWIDTHS, strict=True):
        radius = np.exp(-np.pi * bandwidth / SAMPLE_RATE)
        cosine = 2.0 * radius * np.cos(2.0 * np.pi * frequency * tract / SAMPLE_RATE)
        sections.append([1.0 - cosine + radius**2, 0.0, 0.0, 1.0, -cosine, radius**2])
    return np.array(sections)


def _high_pass() -> np.ndarray:
    """Emphasise the band around 5 kHz by one zero and a resonance: the hiss of s and f."""
    radius, cosine = 0.75, np.cos(2.0 * np.pi * 5000.0 / SAMPLE_RATE)
    return np.array([[1.0, -1.0, 0.0, 1.0, -2.0 * radius * cosine, radius**2]])

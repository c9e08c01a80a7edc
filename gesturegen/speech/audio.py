"""Audio files and their onsets (§4.1.1).

The question answered: at which times does the voice set in, and how strongly? Onset strength is librosa's
spectral flux on the whole clip, never on crops; a peak's strength is read at the peak, its time is the
backtracked one. The threshold is applied later, so that it can change without reading the audio again.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from gesturegen import inputs
from gesturegen.compiled import load_librosa
from gesturegen.errors import DataError
from gesturegen.motion.skeleton import read_only
from gesturegen.settings.speech import Onsets
from gesturegen.speech import compressed
from gesturegen.speech.channels import Mixer

if TYPE_CHECKING:
    import soundfile

LOSSLESS = (".wav", ".flac")
# Of a clip that has one of those as well these are taken for copies, as tools leave them beside.
COPIES = (".mp3", ".m4a", ".aac", ".opus", ".oga")
EXTENSIONS = (*LOSSLESS, ".ogg", *COPIES)
_READABLE = {"WAV", "WAVEX", "RF64", "FLAC", "OGG", "MP3", "MPEG"}
# Their lengths are guessed from a first part, or not announced at all.
_GUESSED = {"MP3", "MPEG"}
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
_UNKNOWN_LENGTHS = (range(0x7FFF0000, 0x80000101), range(0xFFFF0000, 0x100000000))
# librosa's analysis window; shorter audio is padded with silence to this length.
_SHORTEST_ANALYSIS = 2048
# How far from the speech a peak may lie and still be of it.
_VOICE_SLACK_SECONDS = 0.1


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

    def __post_init__(self) -> None:
        for name in ("times", "strengths", "near_mute"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def threshold(self, settings: Onsets, voiced: np.ndarray) -> float:
        """Return the least strength of an onset: `min_strength`, or as fits the recording (`per_second`).

        With `per_second` it is such that there are so many peaks per second of speech, of those in the speech.
        voiced : seconds `[shape=(S, 2)]` in which somebody speaks; without any, `min_strength` holds
        """
        if settings.per_second is None:
            return settings.min_strength
        return self.threshold_for(settings.per_second, voiced, settings.min_strength)

    def threshold_for(self, per_second: float, voiced: np.ndarray, otherwise: float) -> float:
        """Compute the strength that `per_second` peaks per second of speech exceed; `otherwise` without speech."""
        count = round(per_second * voiced_seconds(voiced))
        strengths = np.sort(self.strengths[self._within(voiced) & ~self.near_mute])[::-1]
        if count == 0 or not len(strengths):
            return otherwise
        return float(strengths[min(count, len(strengths)) - 1])

    def rate(self, min_strength: float, muted_max_share: float, voiced: np.ndarray) -> float:
        """Compute the number of onsets per second of speech; NaN without speech."""
        onsets = self.are_onsets(min_strength, muted_max_share) & self._within(voiced)
        return onsets.sum() / seconds if (seconds := voiced_seconds(voiced)) > 0 else np.nan

    def _within(self, voiced: np.ndarray) -> np.ndarray:
        """Tell which peaks lie in the speech; backtracked times are a little before the voice."""
        marks = np.asarray(voiced, dtype=np.float64).reshape(-1, 2)
        after = np.searchsorted(marks[:, 0], self.times + _VOICE_SLACK_SECONDS, side="right") - 1
        ends = np.append(marks[:, 1], -np.inf)
        return (after >= 0) & (self.times <= ends[after] + _VOICE_SLACK_SECONDS)

    def are_onsets(self, min_strength: float, muted_max_share: float) -> np.ndarray:
        """Tell which peaks are onsets, bool `[shape=(K,)]`: at least `min_strength` strong, and no pop around a mute.

        If pops would be more than `muted_max_share` of the onsets, the recording is gated or synthetic,
        not censored, and none is dropped.
        """
        strong = self.strengths >= min_strength
        pops = strong & self.near_mute
        if pops.sum() <= muted_max_share * strong.sum():
            strong &= ~self.near_mute
        return strong

    def select(self, min_strength: float, muted_max_share: float) -> np.ndarray:
        """List the times in seconds of the peaks that are onsets (`are_onsets`)."""
        return self.times[self.are_onsets(min_strength, muted_max_share)]


@dataclass(frozen=True, eq=False)
class Sound:
    """Mono samples float32 `[shape=(n,)]` at `rate` Hz, and what is odd about the file, one line each."""

    samples: np.ndarray
    rate: int
    notes: tuple[str, ...] = ()


def read_samples(path: str | Path) -> tuple[np.ndarray, int]:
    """Read the mean of all channels `[shape=(n,)]` float32 and the sample rate in Hz of a sound file, as by `read`."""
    sound = read(path)
    return sound.samples, sound.rate


def read(path: str | Path, channel: str | int = "mix") -> Sound:
    """Read one channel, or the mean of all, of a WAV, FLAC, Ogg (Vorbis, Opus), MP3, M4A or AAC file.

    What a file is is told by its first bytes, whatever it is called. channel : `mix`, `left`, `right` or a number from 1.
    Raises DataError, saying what the file is, for anything else, for a truncated or empty file and for samples that
    are not finite.
    """
    import soundfile

    path = Path(path)
    with inputs.open_regular(path, most_bytes=MOST_BYTES) as opened:
        try:
            size = inputs.size(opened)
            mended = _refuse_cut_off(path, opened, size)
            # Without its buffer, which would not know where libsndfile leaves off.
            plain = io.FileIO(opened.fileno(), closefd=False)
            plain.seek(0)
            foreign = compressed.kind(plain.read(12))
            plain.seek(0)
            try:
                source = _Mended(opened, mended) if mended else opened.fileno()
                # libmpg123, in libsndfile, says on standard error alone that it leaves something out.
                with compressed.overheard() if foreign else nullcontext() as heard:
                    with _sequential(soundfile)(source, closefd=False) as file:
                        _check_format(path, file.format, file.samplerate, file.channels)
                        announced = file.frames / file.samplerate if file.format in _GUESSED else None
                        sound = _read_sound(path, file, size, channel)
            except soundfile.SoundFileError:
                if foreign is None:
                    raise
            else:
                if announced and compressed.counts_its_frames(plain):
                    compressed.refuse_cut_off(path, len(sound.samples) / sound.rate, announced)
                return replace(sound, notes=(*sound.notes, *compressed.notes(inputs.shown(path.name), heard or [])))
            plain.seek(0)
            decoder = compressed.Decoder(path, plain, foreign)
            _check_format(path, None, decoder.rate, decoder.n_channels)
            return _gather(path, decoder.blocks(), decoder.rate, decoder.n_channels, size, channel)
        except OSError as error:
            raise DataError(f"{inputs.shown(path)}: cannot be read ({error.strerror}); {inputs.PERMISSIONS}") from None
        except soundfile.SoundFileError as error:
            reason = inputs.shown(getattr(error, "error_string", error)).removeprefix("Error : ").rstrip(".")
            raise DataError(
                f"{inputs.shown(path)}: damaged, cut off or no audio file ({reason}); copy it again or convert it to WAV"
            ) from None


class _Mended:
    """An open file in which some bytes are replaced: libsndfile takes the lengths in a header to the letter."""

    def __init__(self, file: BinaryIO, changes: Mapping[int, bytes]):
        self._file, self._changes = file, changes

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def readinto(self, buffer: memoryview | bytearray) -> int:
        start, data = self._file.tell(), bytearray(self._file.read(len(buffer)))
        for at, new in self._changes.items():
            for place, byte in enumerate(new, at - start):
                if 0 <= place < len(data):
                    data[place] = byte
        buffer[: len(data)] = data
        return len(data)

    def read(self, count: int = -1) -> bytes:
        buffer = bytearray(count)
        return bytes(buffer[: self.readinto(buffer)])

    def write(self, _: bytes) -> int:
        raise OSError("only read")


def _sequential(soundfile: Any) -> type:
    """Make a subclass of soundfile's reader that never seeks, which would fail in FLAC of unknown length."""

    class Sequential(soundfile.SoundFile):
        def seekable(self) -> bool:
            return False

    return Sequential


def _check_format(path: Path, kind: str | None, rate: int, channels: int) -> None:
    """Raise DataError for a format that is not read, and for header figures that no recording has."""
    low, high = SAMPLE_RATES
    if kind is not None and kind not in _READABLE:
        raise DataError(f"{inputs.shown(path)}: this is {kind}, which cannot be used; convert it to WAV")
    if not low <= rate <= high:
        raise DataError(
            f"{inputs.shown(path)}: a sample rate of {rate:,} Hz, expected {low:,} to {high:,}; "
            "the header is wrong; export the audio again"
        )
    if not 0 < channels <= MOST_CHANNELS:
        raise DataError(
            f"{inputs.shown(path)}: {channels} channels, at most {MOST_CHANNELS} are read; export the speaker's alone"
        )


def _read_sound(path: Path, file: soundfile.SoundFile, size: int, channel: str | int) -> Sound:
    """Read by libsndfile, in blocks so that no announced length is trusted."""
    # No recording is as long as a stream's encoder says that cannot know.
    known = file.format not in _GUESSED and 0 < file.frames <= MOST_SECONDS * file.samplerate
    known &= file.frames < _UNKNOWN_FRAMES and not any(file.frames in marks for marks in _UNKNOWN_LENGTHS)
    announced = file.frames if known else None

    def blocks() -> Iterator[np.ndarray]:
        while len(block := file.read(max(_BLOCK // file.channels, 1), dtype="float32", always_2d=True)):
            yield block

    return _gather(path, blocks(), file.samplerate, file.channels, size, channel, announced)


def _gather(
    path: Path, blocks: Iterable[np.ndarray], rate: int, n_channels: int, size: int, channel: str | int,
    announced: int | None = None,
) -> Sound:  # fmt: skip
    """Collect one channel of blocks `[shape=(n, channels)]`.

    announced : number of samples that there should be, None for unknown
    """
    most = min(MOST_SECONDS * rate, (_ALWAYS_ALLOWED + _MOST_TIMES * size) // 4)
    mixer = Mixer(inputs.shown(path), n_channels, rate, channel)
    kept, count = [], 0
    for block in blocks:
        if block.shape[1] != n_channels:
            raise DataError(
                f"{inputs.shown(path)}: damaged: {n_channels} channels become {block.shape[1]} at {count / rate:.3f} s; copy it again"
            )
        # NaN is not less either.
        bad = np.flatnonzero(~(np.abs(block).max(axis=1) < _LARGEST_SAMPLE))
        if len(bad):
            raise DataError(
                f"{inputs.shown(path)}: the sample at {(count + bad[0]) / rate:.3f} s is not a finite number "
                f"below {_LARGEST_SAMPLE:.2g}; export the audio again"
            )
        kept.append(mixer.add(block))
        count += len(block)
        if count > most:
            raise DataError(
                f"{inputs.shown(path)}: over {most / rate:,.0f} s of audio in {size / 1e6:,.1f} MB; at most "
                f"{MOST_SECONDS / 3600:g} hours are read, and less of what is nearly all silence; cut it into parts"
            )
    if count == 0:
        raise DataError(f"{inputs.shown(path)}: holds no audio (0 s); record or copy it again")
    if announced is not None and count < announced:
        raise DataError(f"{inputs.shown(path)}: the file is cut off: {count} of {announced} samples; copy it again")
    return Sound(np.concatenate(kept), rate, tuple(mixer.notes(inputs.shown(path.name))))


def voiced_seconds(voiced: np.ndarray) -> float:
    """Sum the lengths of spans `[shape=(S, 2)]`, seconds."""
    return float(np.sum(voiced[:, 1] - voiced[:, 0]))


def detect_onset_peaks(samples: np.ndarray, rate: int, settings: Onsets) -> OnsetPeaks:
    """Detect onset peaks of mono `samples` `[shape=(n,)]` at `rate` Hz.

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
    """Find the last local minimum of `strength` at or before each peak, or frame 0, as librosa.onset.onset_backtrack.

    librosa's own takes five seconds to compile.
    """
    lowest = np.flatnonzero((strength[1:-1] <= strength[:-2]) & (strength[1:-1] < strength[2:])) + 1
    lowest = np.append(0, lowest)
    return lowest[np.searchsorted(lowest, peaks, side="right") - 1]


def _mute_edges(samples: np.ndarray, rate: int, settings: Onsets) -> np.ndarray:
    """Find the times in seconds where runs of exact zeros as long as a censored name begin and end."""
    silent = np.concatenate([[False], samples == 0, [False]]).astype(np.int8)
    change = np.diff(silent)
    starts, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    seconds = (ends - starts) / rate
    muted = (seconds >= settings.muted_min_seconds) & (seconds <= settings.muted_max_seconds)
    return np.sort(np.concatenate([starts[muted], ends[muted]])) / rate


def _distance_to_nearest(times: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """Compute the distance from each time to the nearest mark; infinite without marks."""
    if len(marks) == 0:
        return np.full(len(times), np.inf)
    after = np.searchsorted(marks, times)
    left = np.abs(times - marks[np.maximum(after - 1, 0)])
    right = np.abs(times - marks[np.minimum(after, len(marks) - 1)])
    return np.minimum(left, right)


def _refuse_cut_off(path: Path, file: BinaryIO, size: int) -> dict[int, bytes]:
    """Compare what a file announces with what is there; libsndfile reads the rest of a cut file in silence.

    The bytes that its header should have, by their place, where its writer could not know the length.
    """
    head = file.read(12)
    if size == 0:
        raise DataError(f"{inputs.shown(path)}: the file is empty; copy it again from its source")
    if head.startswith(b"version http"):
        raise DataError(f"{inputs.shown(path)}: a Git LFS pointer, not the file itself; run `git lfs pull`")
    if head[:4] in (b"RIFF", b"RF64"):
        return _check_chunks(path, file, size, head)
    if head[:4] == b"OggS":
        _check_last_page(path, file, size)
    return {}


def _check_chunks(path: Path, file: BinaryIO, size: int, head: bytes) -> dict[int, bytes]:
    """Check that a WAV file has one data chunk, as long as announced.

    `ds64` holds the length where 32 bits are too few. Returns the same as `_refuse_cut_off`.
    """
    if len(head) == 12 and head[8:] != b"WAVE":
        kind = head[8:].decode("latin-1")
        raise DataError(f"{inputs.shown(path)}: a RIFF file of type {kind!r}, not WAV; convert its sound to WAV")
    large, heard, mended = None, False, {}
    for _ in range(_MOST_CHUNKS):
        chunk = file.read(8)
        # After the audio anything may stand; before it, the file is cut off.
        if len(chunk) < 8:
            break
        name, length = chunk[:4], struct.unpack("<I", chunk[4:])[0]
        if name == b"data" and heard:
            raise DataError(f"{inputs.shown(path)}: a second data chunk; only one can be meant; export the audio again")
        if name == b"data":
            start, heard = file.tell(), True
            held = size - start
            if held > 0 and _is_unknown(length, large, size, head):
                length, large = held, None
                mended = {0: b"RIFF" + struct.pack("<I", size - 8), start - 4: struct.pack("<I", held)}
            announced = length if large is None else large
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
    return mended


def _is_unknown(length: int, large: int | None, size: int, head: bytes) -> bool:
    """Tell whether the length of a data chunk is a mark of a writer that did not know it, or was killed before.

    A length of 0 with audio behind it is one of these, unless the whole file is as long as the header says: then that
    is other data. large : what `ds64` says, None without
    """
    if large is not None:
        return large == 0 or large >= _UNKNOWN_FRAMES
    if any(length in marks for marks in _UNKNOWN_LENGTHS):
        return True
    return length == 0 and struct.unpack("<I", head[4:8])[0] + 8 not in (size, size + 1)


def _check_last_page(path: Path, file: BinaryIO, size: int) -> None:
    """Check that the last page of an Ogg file is marked as the last, and is whole.

    A page has at most 65,307 bytes.
    """
    file.seek(max(size - 65_307, 0))
    tail = file.read()
    page = tail[max(tail.rfind(b"OggS"), 0) :]
    # Flags are in byte 5; byte 26 counts the segments, whose lengths follow.
    whole = len(page) > 26 and len(page) >= 27 + page[26] + sum(page[27 : 27 + page[26]])
    if not whole or not page[5] & 0x04:
        raise DataError(f"{inputs.shown(path)}: the file is cut off: its last page is not whole; copy it again")

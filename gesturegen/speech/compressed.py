"""Sound that libsndfile does not read, through PyAV: M4A, AAC, and MP3 where libsndfile is old.

PyAV is what the extra `video` installs; without it such a file is refused in one line that says so.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Literal

import numpy as np

from gesturegen import extras, inputs
from gesturegen.errors import DataError

# Of a length that the file announces: two frames of MP3; encoders pad their last frame.
_SLACK_SECONDS = 0.15
# The clocks of containers are coarse.
_CONTAINER_SHARE, _CONTAINER_SLACK_SECONDS = 0.98, 0.5
# Of a frame; no recorder changes them midway.
_SETTINGS = {
    "the sample rate": lambda frame: frame.sample_rate,
    "the number of channels": lambda frame: frame.layout.nb_channels,
    "the channel layout": lambda frame: frame.layout.name,
    "the sample format": lambda frame: frame.format.name,
}
_MOST_LINES = 1000
_END = "\0 end"
_one_listens = threading.Lock()


@dataclass(frozen=True)
class Format:
    """A format that PyAV reads: its name in messages, FFmpeg's name of it, and how its files begin."""

    name: str
    demuxer: str
    begins: Callable[[bytes], bool]


# The first that fits counts: AAC and MP3 both begin with eleven set bits.
FORMATS = (
    Format("M4A (AAC)", "mov", lambda head: head[4:8] == b"ftyp"),
    Format("Matroska or WebM", "matroska", lambda head: head[:4] == b"\x1a\x45\xdf\xa3"),
    Format("AAC", "aac", lambda head: len(head) > 1 and head[0] == 0xFF and head[1] & 0xF6 == 0xF0),
    Format(
        "MP3", "mp3",
        lambda head: head[:3] == b"ID3" or (len(head) > 1 and head[0] == 0xFF and head[1] & 0xE0 == 0xE0),
    ),
)  # fmt: skip
# Only what is in the file itself: no playlist, no other file, no network, none of FFmpeg's many other formats.
_OPTIONS = {"protocol_whitelist": "pipe", "format_whitelist": ",".join(entry.demuxer for entry in FORMATS)}


def kind(head: bytes) -> str | None:
    """Detect the format of a file by its first 12 bytes, if PyAV is to read it; None for any other."""
    return next((entry.name for entry in FORMATS if entry.begins(head)), None)


def counts_its_frames(file: BinaryIO) -> bool:
    """Tell whether an MP3 file says how long it is; else its length is guessed from its size.

    By a Xing header (`Info` where the bit rate is constant), which stands in the place of the first frame's sound.
    """
    file.seek(0)
    tag = file.read(10)
    # The length of an ID3 tag has seven bits of each byte.
    start = 10 + sum(byte << shift for byte, shift in zip(tag[6:], (21, 14, 7, 0), strict=False))
    file.seek(start if tag[:3] == b"ID3" else 0)
    first = file.read(80)
    at = max(first.find(b"Xing"), first.find(b"Info"))
    # Of the four bytes of flags the last bit says that the number of frames follows.
    return at >= 0 and bool(sum(first[at + 7 : at + 8]) & 1)


@contextmanager
def overheard() -> Iterator[list[str]]:
    """Take what libmpg123 writes to standard error meanwhile, past Python; the list, filled at the end, is of what it lost.

    At most 1,000 lines are kept. Nothing of it is shown. Where standard error is closed nothing is heard.
    """
    lost: list[str] = []
    with _one_listens:
        try:
            shown = os.dup(2)
        except OSError:
            yield lost
            return
        reading, writing = os.pipe()
        listener = threading.Thread(target=_listen, args=(reading, lost), daemon=True)
        listener.start()
        os.dup2(writing, 2)
        os.close(writing)
        try:
            yield lost
        finally:
            # Not the end of the pipe, which a process that was started meanwhile may hold open.
            os.write(2, f"\n{_END}\n".encode())
            os.dup2(shown, 2)
            os.close(shown)
            listener.join()


def _listen(reading: int, lost: list[str]) -> None:
    with open(reading, encoding="utf-8", errors="replace") as lines:
        for line in iter(lambda: lines.readline(1000), f"{_END}\n"):
            # Others are of what follows the sound, or say the same once more.
            if ("error: " in line or line.startswith("Note: Skipped")) and len(lost) < _MOST_LINES:
                lost.append(line.rpartition("error: ")[2].removeprefix("Note: ").strip().rstrip("."))


def notes(name: str, lost: list[str]) -> tuple[str, ...]:
    """One line where the decoder lost anything (`overheard`) of a file of this name."""
    if not lost:
        return ()
    return (
        f"{name}: damaged in {'over ' if len(lost) == _MOST_LINES else ''}{len(lost):,} place{'s' * (len(lost) > 1)} (the "
        f"first: {inputs.shown(lost[0])}); sound is missing there, and what follows may come too early; copy it again",
    )


def refuse_cut_off(
    path: Path, seconds: float, announced: float, least_share: float = 1.0, slack: float = _SLACK_SECONDS
) -> None:
    """Raise a DataError where there are clearly fewer seconds than announced."""
    if seconds < least_share * announced - slack:
        raise DataError(
            f"{inputs.shown(path)}: the file is cut off or damaged: {seconds:.1f} of {announced:.1f} s; copy it again, or convert it to WAV if that is all"
        )


class Decoder:
    """The first sound stream of an open file: `rate`, `n_channels`, and its samples in blocks."""

    def __init__(self, path: Path, file: BinaryIO, what: str):
        self.path, self.what = path, what
        try:
            self._av = extras.need("av", "video")
        except DataError as error:
            raise DataError(
                f"{inputs.shown(path)}: this is {what}, which needs PyAV: {error}; or convert it to WAV"
            ) from None
        with self._one_line():
            self._container = self._av.open(file, "r", options=_OPTIONS)
            if not self._container.streams.audio:
                raise DataError(f"{inputs.shown(path)}: {what} without any sound in it; give the file with the speech")
            stream = self._container.streams.audio[0]
            duration, base = stream.duration, stream.time_base
            self.announced_seconds = float(duration * base) if duration and base and duration > 0 else None
            self._frames = self._container.decode(stream)
            # Headers may say something else than what then comes, or nothing.
            first = next(self._frames, None)
            if first is None:
                raise DataError(f"{inputs.shown(path)}: holds no audio (0 s); record or copy it again")
            self._first: Any = first
            self.rate, self.n_channels = int(first.sample_rate), first.layout.nb_channels

    def blocks(self) -> Iterator[np.ndarray]:
        """Yield blocks `[shape=(n, channels)]` float32; raises DataError for a damaged or cut-off file."""
        count = 0
        with self._one_line():
            # One plane for all channels: of eight and more, PyAV reads planes that are not there.
            resampler = self._av.AudioResampler(format="flt", layout=self._first.layout, rate=self.rate)
            for frame in chain([self._first], self._frames):
                self._refuse_change(frame, count)
                for part in resampler.resample(frame):
                    block = np.frombuffer(part.planes[0], np.float32, part.samples * self.n_channels)
                    count += part.samples
                    yield block.reshape(-1, self.n_channels).copy()
        if self.announced_seconds:
            refuse_cut_off(
                self.path, count / self.rate, self.announced_seconds, _CONTAINER_SHARE, _CONTAINER_SLACK_SECONDS
            )

    def _refuse_change(self, frame: Any, count: int) -> None:
        """Refuse a frame unlike the first one with a DataError."""
        for what, of in _SETTINGS.items():
            was, becomes = of(self._first), of(frame)
            if was != becomes:
                raise DataError(
                    f"{inputs.shown(self.path)}: damaged: {what} changes from {was} to {becomes} at "
                    f"{count / self.rate:.3f} s; copy it again or convert it to WAV"
                )

    def _one_line(self) -> _OneLine:
        """Return a context in which errors of FFmpeg become one line."""
        return _OneLine(self)


class _OneLine:
    """A context in which errors of FFmpeg become one line."""

    def __init__(self, decoder: Decoder):
        self.decoder = decoder

    def __enter__(self) -> _OneLine:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> Literal[False]:
        if isinstance(error, (DataError, GeneratorExit)) or not isinstance(error, Exception):
            return False
        reason = inputs.shown(getattr(error, "strerror", None) or error)[:200]
        raise DataError(
            f"{inputs.shown(self.decoder.path)}: damaged or cut off, or no {self.decoder.what} ({reason}); copy it again or convert it to WAV"
        ) from None

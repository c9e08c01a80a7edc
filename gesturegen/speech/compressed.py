"""Sound that libsndfile does not read, through PyAV: M4A, AAC, and MP3 where libsndfile is old.

PyAV is what the extra `video` installs; without it such a file is refused in one line that says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Literal

import numpy as np

from gesturegen import extras, inputs
from gesturegen.errors import DataError

# Of a duration that the container announces; encoders pad their last frame, and clocks are coarse.
_LEAST_SHARE, _SLACK_SECONDS = 0.98, 0.5


def kind(head: bytes) -> str | None:
    """Detect the format of a file by its first 12 bytes, if PyAV is to read it; None for any other."""
    if head[4:8] == b"ftyp":
        return "M4A (AAC)"
    if head[:4] == b"\x1a\x45\xdf\xa3":
        return "Matroska or WebM"
    if len(head) > 1 and head[0] == 0xFF and head[1] & 0xF6 == 0xF0:
        return "AAC"
    if head[:3] == b"ID3" or (len(head) > 1 and head[0] == 0xFF and head[1] & 0xE0 == 0xE0):
        return "MP3"
    return None


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
            # Only what is in the file itself: no playlist, no other file, no network.
            self._container = self._av.open(file, "r", options={"protocol_whitelist": "pipe"})
            if not self._container.streams.audio:
                raise DataError(f"{inputs.shown(path)}: {what} without any sound in it; give the file with the speech")
            self._stream = self._container.streams.audio[0]
            self.rate, self.n_channels = int(self._stream.rate or 0), int(self._stream.codec_context.channels or 0)
            duration, base = self._stream.duration, self._stream.time_base
            self.announced_seconds = float(duration * base) if duration and base and duration > 0 else None

    def blocks(self) -> Iterator[np.ndarray]:
        """Yield blocks `[shape=(n, channels)]` float32; raises DataError for a damaged or cut-off file."""
        count = 0
        with self._one_line():
            resampler = self._av.AudioResampler(format="fltp", layout=self._stream.layout, rate=self.rate)
            for frame in self._container.decode(self._stream):
                for part in resampler.resample(frame):
                    count += part.samples
                    yield part.to_ndarray().T
        if self.announced_seconds and count / self.rate < _LEAST_SHARE * self.announced_seconds - _SLACK_SECONDS:
            raise DataError(
                f"{inputs.shown(self.path)}: the file is cut off: {count / self.rate:.1f} of {self.announced_seconds:.1f} s; copy it again"
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

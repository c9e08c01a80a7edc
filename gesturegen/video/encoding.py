"""Encoding of pictures and sound as an MP4 file."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from types import ModuleType
from typing import Any, BinaryIO

import numpy as np

from gesturegen.errors import DataError
from gesturegen.extras import need
from gesturegen.video._kernels import to_yuv420

_CODECS = {
    # A coarse search is enough for flat colours. B-frames would save a quarter of the bytes, but with them
    # libx264 does not write the same bytes twice.
    "libx264": {"preset": "veryfast", "crf": "24", "x264-params": "bframes=0:trellis=0:subme=1:me=dia"},
    "libopenh264": {"b": "1500000"},
    "mpeg4": {"b": "2500000"},
}
# One rate for all: players differ in what else they accept, and the frames of AAC are short at it.
_AUDIO_RATE = 48000


def write_mp4(
    file: BinaryIO, pictures: Iterable[np.ndarray], fps: float, samples: np.ndarray | None = None, rate: int = 0
) -> None:
    """Encode pictures `[shape=(H, W, 3)]` uint8 of one even size, and mono `samples` `[shape=(n,)]` at `rate` Hz.

    Sound that outlasts the pictures is cut off. The same input gives the same bytes on one version of PyAV,
    whatever the machine: one thread encodes.
    """
    av = need("av", "video")
    pictures = iter(pictures)
    first = next(pictures)
    exact = Fraction(fps).limit_denominator(1001)
    with av.open(file, "w", format="mp4") as container:
        name = _codec(av)
        video = container.add_stream(name, rate=exact, options=_CODECS[name])
        video.height, video.width = first.shape[:2]
        video.pix_fmt = "yuv420p"
        video.codec_context.thread_count = 1
        video.codec_context.time_base = 1 / exact
        sound = None
        if samples is not None:
            sound = container.add_stream("aac", rate=_AUDIO_RATE, layout="mono", options={"b": "96000"})
            sound.codec_context.thread_count = 1
        planes = np.empty((first.shape[0] * 3 // 2, first.shape[1]), dtype=np.uint8)
        for count, picture in enumerate(_chain(first, pictures)):
            to_yuv420(picture, planes)
            frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
            frame.pts, frame.time_base = count, 1 / exact
            container.mux(video.encode(frame))
            if sound is not None and samples is not None:
                # Sound goes in beside its pictures, or a player would have to jump in the file.
                start, stop = (min(round(k / fps * rate), len(samples)) for k in (count, count + 1))
                _mux_sound(av, container, sound, samples[start:stop], start, rate)
        container.mux(video.encode(None))
        if sound is not None:
            container.mux(sound.encode(None))


def _mux_sound(av: ModuleType, container: Any, sound: Any, samples: np.ndarray, start: int, rate: int) -> None:
    """Encode the samples that belong to one picture."""
    if not len(samples):
        return
    frame = av.AudioFrame.from_ndarray(np.ascontiguousarray(samples[None], dtype=np.float32), "fltp", "mono")
    frame.sample_rate, frame.pts, frame.time_base = rate, start, Fraction(1, rate)
    container.mux(sound.encode(frame))


def _codec(av: ModuleType) -> str:
    """Name the best video codec that the installed PyAV can write."""
    for name in _CODECS:
        try:
            av.Codec(name, "w")
            return name
        except ValueError:  # PyAV's errors for unknown codecs are ValueErrors
            continue
    raise DataError("the installed PyAV writes neither H.264 nor MPEG-4; run: pip install --force-reinstall av")


def _chain(first: np.ndarray, rest: Iterable[np.ndarray]) -> Iterable[np.ndarray]:
    """Yield one picture, then the others."""
    yield first
    yield from rest

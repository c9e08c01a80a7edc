"""Compact audio of a speech for a web page: Ogg Vorbis with the same bytes every time, and peaks to draw."""

from __future__ import annotations

import io
import struct
import zlib
from math import gcd

import numpy as np

PEAKS_PER_SECOND = 100
# Speech has little above 12 kHz, and half the samples are half the file.
_MAX_RATE = 24_000
_SERIAL = b"gest"
_REVERSED_BITS = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def vorbis(samples: np.ndarray, rate: int) -> bytes:
    """Encode mono `samples` `[shape=(n,)]` as an Ogg Vorbis file of at most 24 kHz."""
    import soundfile

    if rate > _MAX_RATE:
        from scipy.signal import resample_poly

        common = gcd(rate, _MAX_RATE)
        samples, rate = resample_poly(samples, _MAX_RATE // common, rate // common), _MAX_RATE
    file = io.BytesIO()
    with soundfile.SoundFile(file, "w", rate, 1, format="OGG", subtype="VORBIS") as sound:
        # libsndfile's encoder puts a block on the stack: a long one overflows it.
        for start in range(0, len(samples), rate):
            sound.write(np.clip(samples[start : start + rate], -1.0, 1.0))
    return with_serial(file.getvalue(), _SERIAL)


def with_serial(ogg: bytes, serial: bytes) -> bytes:
    """Replace the serial number of an Ogg stream, which libsndfile draws by the clock."""
    pages, start = [], 0
    while start < len(ogg):
        segments = ogg[start + 26]
        end = start + 27 + segments + sum(ogg[start + 27 : start + 27 + segments])
        # Bytes 14 to 17 are the serial number, 22 to 25 the checksum, taken with itself as zero.
        head, body = ogg[start : start + 14] + serial + ogg[start + 18 : start + 22], ogg[start + 26 : end]
        pages.append(head + struct.pack("<I", _checksum(head + bytes(4) + body)) + body)
        start = end
    return b"".join(pages)


def _checksum(page: bytes) -> int:
    """Compute Ogg's CRC-32: zlib's with all bits the other way round, starting at 0 and not inverted."""
    mirrored = zlib.crc32(page.translate(_REVERSED_BITS), 0xFFFFFFFF) ^ 0xFFFFFFFF
    return int(f"{mirrored:032b}"[::-1], 2)


def peaks(samples: np.ndarray, rate: int) -> np.ndarray:
    """Compute the loudest sample of each hundredth of a second, uint8 `[shape=(n,)]`, the clip's loudest being 255."""
    n_peaks = max(1, int(np.ceil(len(samples) * PEAKS_PER_SECOND / rate)))
    edges = np.minimum(np.arange(n_peaks) * rate // PEAKS_PER_SECOND, max(len(samples) - 1, 0))
    loudest = np.maximum.reduceat(np.abs(samples), edges) if len(samples) else np.zeros(n_peaks)
    return np.round(255 * loudest / max(float(loudest.max()), 1e-9)).astype(np.uint8)

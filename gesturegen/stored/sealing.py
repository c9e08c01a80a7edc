"""The checksum of a stored file: of all its bytes, so that a flipped bit anywhere is noticed on reading.

Archives (`.npz`, `.pt`) carry it as the comment at their end, which other programs pass over; JSON files as their last
entry.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
import struct
import zlib
from pathlib import Path
from typing import BinaryIO

from gesturegen.errors import DamagedError, DataError

_PNG = b"\x89PNG\r\n\x1a\n"
_MARK = b"gesturegen sha256 "
_HEX = re.compile(rb"[0-9a-f]{64}")
_COMMENT_BYTES = len(_MARK) + 64
_LAST_ENTRY = re.compile(rb',\n "checksum": "([0-9a-f]{64})"\n}\n\Z')
_MISSING = "no checksum: cut off, or written by an older gesturegen or another program"

# By path, the state of the file and its checksum, when it was last read whole: large files are hashed once.
_known: dict[str, tuple[tuple[int, ...], str]] = {}


def seal_archive(file: BinaryIO) -> None:
    """Append to a finished zip archive, open for reading and writing, the checksum of all its bytes as its comment."""
    file.seek(-2, os.SEEK_END)
    file.write(struct.pack("<H", _COMMENT_BYTES))
    file.seek(0)
    digest = hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type] # BinaryIO lacks readinto
    file.seek(0, os.SEEK_END)
    file.write(_MARK + digest.encode())


def sealed_text(text: str) -> str:
    """Add the checksum of a JSON object's text, which ends in a line of its own, to it as the last entry."""
    if not text.endswith("\n}\n"):
        raise ValueError("the text of an object must end in a line with its bracket")
    return f'{text[:-3]},\n "checksum": "{hashlib.sha256(text.encode()).hexdigest()}"\n}}\n'


def unsealed_text(path: str | Path, data: bytes, command: str) -> bytes:
    """Return the text that `sealed_text` was given; DamagedError for a missing or wrong checksum."""
    found = _LAST_ENTRY.search(data[-100:])
    if found is None:
        raise damaged(path, _MISSING, command)
    text = data[: len(data) - len(found[0])] + b"\n}\n"
    if hashlib.sha256(text).hexdigest().encode() != found[1]:
        raise damaged(path, "its checksum is another one", command)
    return text


def checksum(path: str | Path, command: str) -> str:
    """Read the checksum that a sealed archive carries, and verify that it is that of its bytes.

    Each process reads each state of a file once. Raises DataError for a file that cannot be read, DamagedError for one
    without a checksum or with another one. command : what makes it again
    """
    path = Path(path)
    try:
        state = file_state(path)
        before, digest = _known.get(str(path), (None, ""))
        if before != state:
            with path.open("rb") as file:
                digest = _checked_digest(file, path, command)
            _known[str(path)] = state, digest
        return digest
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); run the command that writes it") from None


def file_state(path: Path) -> tuple[int, ...]:
    """Return properties of a file that change when it is written; OSError where there is none."""
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise OSError(0, "not a file")
    return found.st_dev, found.st_ino, found.st_mtime_ns, found.st_ctime_ns, found.st_size


def _checked_digest(file: BinaryIO, path: Path, command: str) -> str:
    size = file.seek(0, os.SEEK_END)
    start = max(size - _COMMENT_BYTES, 0)
    file.seek(start)
    comment = file.read()
    if not comment.startswith(_MARK) or not _HEX.fullmatch(comment, len(_MARK)):
        raise damaged(path, _MISSING, command)
    file.seek(0)
    digest = hashlib.sha256()
    while part := file.read(min(1 << 20, start - file.tell())):
        digest.update(part)
    if digest.hexdigest().encode() != comment[len(_MARK) :]:
        raise damaged(path, "its checksum is another one", command)
    return digest.hexdigest()


def read_png(path: str | Path, command: str) -> bytes:
    """Read the bytes of a PNG file, whose parts have checksums of their own; DamagedError when one is wrong."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); run `gesturegen {command}` again") from None
    place, kind = len(_PNG), b""
    while data.startswith(_PNG) and kind != b"IEND" and place + 12 <= len(data):
        length = int.from_bytes(data[place : place + 4])
        part, end = data[place + 4 : place + 8 + length], place + 12 + length
        if zlib.crc32(part) != int.from_bytes(data[end - 4 : end]):
            break
        kind, place = part[:4], end
    if kind != b"IEND" or place != len(data):
        raise damaged(path, "its checksums are others", command)
    return data


def damaged(path: str | Path, reason: str, command: str) -> DamagedError:
    """Create the error about a damaged file, which names the command that makes it again."""
    return DamagedError(f"{path}: damaged ({reason}); run `gesturegen {command}` again")


def remade(error: DamagedError) -> str:
    """Describe a damaged file that was not used but made again."""
    return str(error).rpartition("; ")[0] + "; it was made again"

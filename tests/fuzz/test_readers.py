"""Damaged and made-up inputs end in one line or in a result that holds; none takes 5 s or ten times its size.

200 inputs for each reader in `make test`; `make fuzz` sets GESTUREGEN_FUZZ_EXAMPLES to 20,000 each way and looks at the
processor time as well. Inputs have numbers, and the last one stays in the test's folder, also when it crashes.
"""

from __future__ import annotations

import os
import random
import re
import resource
import signal
import struct
from collections.abc import Callable
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest

from gesturegen.errors import GesturegenError
from tests.fuzz.targets import TARGETS, Target

EXAMPLES = int(os.environ.get("GESTUREGEN_FUZZ_EXAMPLES", "0"))
# Of each of the two ways.
COUNT = EXAMPLES or 100
SECONDS = 5
# Of memory, beside ten times the input: what libraries take when they are first used.
SLACK = 64_000_000


@contextmanager
def _processor_time():
    """Fail where the block takes more than 5 s of this process, however busy the machine is."""

    def stop(*_):
        raise AssertionError(f"took more than {SECONDS} s")

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def try_to_read(target: Target, path: Path, data: bytes) -> bool:
    """Whether the input is accepted; AssertionError for anything but a result that holds or one-line errors."""
    path.write_bytes(data)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        with _processor_time() if EXAMPLES else nullcontext():
            found = target.read(path)
    except GesturegenError as error:
        lines = str(error).split("\n")
        assert all(line.isprintable() and 10 < len(line) < 3000 for line in lines), lines
        # Each of several mistakes names its place.
        assert all(str(path) in line or "--set" in line for line in lines), lines
        return False
    finally:
        grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
        assert grown <= 10 * len(data) + SLACK, f"{grown / 1e6:.0f} MB for {len(data)} bytes"
    target.holds(path, found)
    return True


def place(target: Target, folder: Path) -> Path:
    """The file that is written over and over, and what must lie beside it."""
    if not target.suffix.startswith("/"):
        return folder / f"input{target.suffix}"
    for name in ("a_main-agent.wav", "b.wav"):
        (folder / name).touch()
    return folder / target.suffix[1:]


# --- damaged inputs -----------------------------------------------------------------------------------------

_NUMBERS = (0, 1, 2, 127, 128, 255, 256, 32767, 65535, 2**31 - 1, 2**31, 2**32 - 1)
_WRITTEN = (b"0", b"-1", b"3", b"1e3", b"0.5", b"1e-300", b"1e300", b"99999999999", b"007", b"1_0", b"nan")


def _damage(data: bytearray, target: Target, rng: random.Random) -> None:
    """Change a stretch of an input: drop, repeat, move, replace by a token or by part of a good input, cut."""
    at, length = rng.randrange(len(data) + 1), min(int(2 ** rng.uniform(0, 8)), len(data))
    other = rng.choice(target.seeds)
    start = rng.randrange(len(other) + 1)
    new = rng.choice(
        (b"", data[at : at + length] * rng.choice((2, 3, 30)), other[start : start + length], rng.choice(target.tokens))
    )
    data[at : at + rng.choice((0, length, len(new)))] = new
    if rng.random() < 0.05:
        del data[at:]


def _damage_bytes(data: bytearray, _: Target, rng: random.Random) -> None:
    """Flip a bit, or write a number such as lengths are."""
    at = rng.randrange(len(data) + 1)
    if rng.random() < 0.5:
        data[at : at + 1] = bytes([rng.randrange(256)])
    else:
        form = rng.choice(("<I", ">I", "<Q", "<H", "B"))
        number = struct.pack(form, rng.choice(_NUMBERS) % 256 ** struct.calcsize(form))
        data[at : at + len(number)] = number


def _damage_text(data: bytearray, _: Target, rng: random.Random) -> None:
    """Change a letter or a number, or drop, repeat or move a line."""
    lines = bytes(data).splitlines(keepends=True) or [b"\n"]
    one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    numbers = list(re.finditer(rb"[0-9.]+", data))
    kind = rng.randrange(5)
    if kind < 2 and numbers:
        found = rng.choice(numbers)
        data[found.start() : found.end()] = rng.choice((*_WRITTEN, b"%d" % rng.randrange(100)))
    elif kind == 2:
        at = rng.randrange(len(data) + 1)
        data[at : at + 1] = bytes([rng.randrange(32, 127)])
    else:
        line = lines.pop(one) if kind == 3 else lines[one]
        data[:] = b"".join([*lines[:other], *([line] if rng.random() < 0.7 else []), *lines[other:]])


def damaged(target: Target, number: int) -> bytes:
    """The input of that number: a good one, changed in one to four places."""
    rng = random.Random(number)
    data = bytearray(rng.choice(target.seeds))
    ways = (_damage, _damage_bytes, _damage_bytes) if target.binary else (_damage, _damage_text, _damage_text)
    for _ in range(rng.choice((1, 1, 2, 4))):
        way = _damage_bytes if rng.random() < 0.03 else rng.choice(ways)
        way(data, target, rng)
    return bytes(data)


# --- made-up inputs -----------------------------------------------------------------------------------------

# ASCII, Latin, anything, halves of pairs, and beyond two bytes.
_LETTERS = ((32, 127), (0, 256), (0, 0x10000), (0xD800, 0xE000), (0x10000, 0x110000))


def _text(rng: random.Random) -> bytes:
    letters = (chr(rng.randrange(*rng.choice(_LETTERS))) for _ in range(rng.randrange(10)))
    return "".join(letters).encode("utf-8", "surrogatepass")


def _pieces(target: Target, rng: random.Random, most: int) -> bytes:
    """Lines of good inputs, tokens, text and bytes in any order."""
    found = []
    for _ in range(rng.randrange(most + 1)):
        kind = rng.randrange(4)
        if kind == 0:
            found.append(rng.choice(rng.choice(target.seeds).splitlines(keepends=True)))
        elif kind == 1:
            found.append(rng.choice(target.tokens))
        else:
            found.append(_text(rng) if kind == 2 else rng.randbytes(rng.randrange(9)))
    return b"".join(found)


def made_up(target: Target, number: int) -> bytes:
    """The input of that number: pieces in any order, or between the two ends of a good input."""
    rng = random.Random(f"made up {number}")
    if rng.random() < 0.5:
        return _pieces(target, rng, rng.choice((2, 5, 20)))
    seed = rng.choice(target.seeds)
    start, end = rng.randrange(len(seed) + 1), rng.randrange(len(seed) + 1)
    return seed[:start] + _pieces(target, rng, 3) + seed[end:]


# --- tests --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TARGETS)
def test_good_inputs_are_accepted(name, tmp_path):
    target = TARGETS[name]
    for seed in target.seeds:
        assert try_to_read(target, place(target, tmp_path), seed)


@pytest.mark.parametrize("way", (damaged, made_up))
@pytest.mark.parametrize("name", TARGETS)
def test_inputs_end_in_one_line_or_hold(name, way, tmp_path, capfd):
    target = TARGETS[name]
    path = place(target, tmp_path)
    accepted = sum(_try_number(target, path, way, number) for number in range(COUNT))
    assert capfd.readouterr().err == "", "a library wrote past the one line"
    print(f"{name}: {accepted} of {COUNT} {way.__name__} inputs accepted")
    assert accepted < COUNT


def _try_number(target: Target, path: Path, way: Callable[[Target, int], bytes], number: int) -> bool:
    try:
        return try_to_read(target, path, way(target, number))
    except BaseException as error:
        error.add_note(f"{way.__name__} input {number}, {path}")
        raise

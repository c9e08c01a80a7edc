"""BVH files: read in any dialect in the wild, refused when broken, written as the challenge demands.

Conventions: rotation order is read per joint from CHANNELS and is intrinsic; a position channel replaces
the joint's OFFSET; Euler angles and degrees exist only here.
"""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Iterator, Sequence
from decimal import Decimal
from pathlib import Path
from typing import BinaryIO

import numpy as np

from gesturegen import inputs
from gesturegen.errors import DataError
from gesturegen.files import write_bytes
from gesturegen.motion import axes, euler, rotation
from gesturegen.motion.skeleton import Motion, Skeleton

_AXES = {"x": 0, "y": 1, "z": 2}
_CHANNEL_NAMES = {f"{axis}{kind}".lower(): f"{axis}{kind}" for axis in "XYZ" for kind in ("position", "rotation")}
MOST_BYTES = 2_000_000_000
# Characters of the hierarchy; ten times as many as in one of its lines.
MOST_HEADER = 1_000_000
# A body with hands and face has a few hundred joints, on a few dozen levels.
MOST_JOINTS = 1000
MOST_LEVELS = 200
# Joints without channels take no room in a file: what a motion takes in memory may be so many times the file's size.
_BYTES_OF_A_POSE = 56
_MOST_TIMES = 20
_ALWAYS_ALLOWED = 64_000_000
# A recording has less than this many centimetres or degrees; more means a broken exporter.
_LARGEST_VALUE = 1e6
# Seconds. No recording is slower than one frame a second or faster than 10,000.
_FRAME_TIMES = (1e-4, 1.0)
_FRAMES_AT_ONCE = 500


def read(path: str | Path) -> Motion:
    """Read a BVH file at its own frame rate.

    The rate is a whole number where the printed digits of the frame time allow it: `.0083333` is 120 fps, `0.0166833`
    is 59.94. Numbers are the file's own, whatever its unit and axes (see `space.read`).
    Raises DataError with the line for anything that is not a complete, finite BVH file.
    """
    path = Path(path)
    header, body, body_line = _split(path, _read_text(path))
    skeleton = _Hierarchy(path, header).parse()
    frame_time, values = _read_frames(path, body, body_line, skeleton)
    return _to_motion(skeleton, values, frames_per_second(frame_time))


def read_skeleton(path: str | Path) -> Skeleton:
    """Read the skeleton of a BVH file, without its frames."""
    path = Path(path)
    return _Hierarchy(path, _split(path, _read_text(path, header_only=True))[0]).parse()


def write(path: str | Path, motion: Motion) -> str:
    """Write `motion` in the hierarchy and channel order of its skeleton, six decimals, all or nothing.

    Returns the hash of the file.
    """
    digest = hashlib.sha256()

    def fill(file: BinaryIO) -> None:
        for text in _blocks(motion):
            data = text.encode()
            digest.update(data)
            file.write(data)

    write_bytes(path, fill)
    return digest.hexdigest()


def format_bvh(motion: Motion) -> str:
    """Format a motion as the text of a BVH file."""
    return "".join(_blocks(motion))


def _blocks(motion: Motion) -> Iterator[str]:
    """Yield the text of a file, some hundred frames at a time: text takes much more memory than numbers."""
    values = _to_channels(motion)
    constant = np.ptp(values, axis=0) == 0
    # Most columns never change (the non-root positions of GENEA files): format them once.
    row = " ".join(f"{value:.6f}" if fixed else "%.6f" for value, fixed in zip(values[0], constant, strict=True))
    yield f"{motion.skeleton.hierarchy}MOTION\nFrames: {motion.n_frames}\nFrame Time: {1.0 / motion.fps:.6f}\n"
    for start in range(0, motion.n_frames, _FRAMES_AT_ONCE):
        block = values[start : start + _FRAMES_AT_ONCE, ~constant].tolist()
        yield "".join(f"{row % tuple(frame)}\n" for frame in block)


def hierarchy_text(
    names: Sequence[str],
    parents: Sequence[int],
    offsets: np.ndarray,
    end_sites: np.ndarray,
    channels: Sequence[tuple[str, ...]],
) -> str:
    """Format the HIERARCHY section of a skeleton that was not read from a file."""
    lines = ["HIERARCHY"]

    def triple(vector: np.ndarray) -> str:
        return " ".join(f"{value:.6f}" for value in vector)

    def add(joint: int, depth: int) -> None:
        tab = "\t" * depth
        lines.append(f"{tab}{'ROOT' if depth == 0 else 'JOINT'} {names[joint]}")
        lines.append(f"{tab}{{")
        lines.append(f"{tab}\tOFFSET {triple(offsets[joint])}")
        lines.append(f"{tab}\tCHANNELS {len(channels[joint])} {' '.join(channels[joint])}")
        for child in (j for j, parent in enumerate(parents) if parent == joint):
            add(child, depth + 1)
        if not np.isnan(end_sites[joint]).any():
            lines.extend(
                [f"{tab}\tEnd Site", f"{tab}\t{{", f"{tab}\t\tOFFSET {triple(end_sites[joint])}", f"{tab}\t}}"]
            )
        lines.append(f"{tab}}}")

    add(0, 0)
    return "\n".join(lines) + "\n"


def _read_text(path: Path, header_only: bool = False) -> str:
    """Read the text of a file, up to its MOTION line where only the hierarchy is wanted."""
    if header_only:
        with inputs.open_regular(path, most_bytes=MOST_BYTES) as file:
            lines = []
            for line in file:
                lines.append(line)
                if line.strip() == b"MOTION":
                    break
            raw = b"".join(lines)
    else:
        raw = inputs.read_bytes(path, MOST_BYTES)
    if not raw.strip():
        raise DataError(f"{inputs.shown(path)}: the file is empty; copy it again from its source")
    if b"\0" in raw:
        raise DataError(f"{inputs.shown(path)}: binary data, not a BVH text file; check that it was exported as BVH")
    if raw.startswith(b"version https://git-lfs"):
        raise DataError(f"{inputs.shown(path)}: a Git LFS pointer, not the file itself; run `git lfs pull`")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _split(path: Path, text: str) -> tuple[list[str], str, int]:
    """Split a file into hierarchy lines, the text after the line MOTION, and the line number of that text."""
    for marker in ("<<<<<<<", ">>>>>>>"):
        # The plain look first: a multi-line pattern over a long file takes a second.
        found = re.search(rf"^{marker}", text, re.MULTILINE) if marker in text else None
        if found:
            line = text.count("\n", 0, found.start()) + 1
            raise DataError(
                f"{inputs.shown(path)}:{line}: merge conflict marker {marker!r}; resolve the conflict first"
            )
    found = re.search(r"^[ \t]*MOTION[ \t]*\r?$", text, re.MULTILINE)
    if not found:
        start = text.lstrip()[:9]
        why = "the file is cut off inside its hierarchy" if start == "HIERARCHY" else f"it starts with {start!r}"
        raise DataError(f"{inputs.shown(path)}: no MOTION section ({why}); a BVH file has HIERARCHY, then MOTION")
    header = _lines(text[: found.start()])
    if found.start() > MOST_HEADER or max(map(len, header), default=0) > MOST_HEADER // 10:
        raise DataError(
            f"{inputs.shown(path)}: a hierarchy of {found.start():,} characters, more than any body has; export it again"
        )
    return header, text[found.end() :].lstrip("\r").removeprefix("\n"), text.count("\n", 0, found.end()) + 2


def _lines(text: str) -> list[str]:
    """Split a text into lines as editors count them.

    str.splitlines() also splits at characters that a joint name may hold.
    """
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return lines[:-1] if lines[-1] == "" else lines


class _Hierarchy:
    """A line-by-line reader of the HIERARCHY section; braces may share a line with what they open."""

    def __init__(self, path: Path, lines: list[str]):
        self.path, self.lines = path, lines
        self.names: list[str] = []
        self.parents: list[int] = []
        self.offsets: list[list[float]] = []
        self.end_sites: list[list[float]] = []
        self.channels: list[tuple[str, ...]] = []
        self.with_channels: set[int] = set()
        self.ended: set[int] = set()  # joints that have an End Site

    def fail(self, line: int, message: str) -> DataError:
        """Return the error for a line of the file."""
        return DataError(f"{inputs.shown(self.path)}:{line}: {message}")

    def parse(self) -> Skeleton:
        """Read all lines to a skeleton; raises DataError for the first line that is broken."""
        stack: list[int | None] = []  # joint numbers; None inside an End Site
        pending: int | str | None = "none"  # what the next brace opens
        offset_seen: set[int] = set()
        started = False
        number = 0
        for number, line in enumerate(self.lines, 1):
            words = line.replace("{", " { ").replace("}", " } ").split()
            if not words:
                continue
            if not started:
                if words != ["HIERARCHY"]:
                    raise self.fail(
                        number, f"found {line.strip()[:40]!r} where HIERARCHY was expected; is this a BVH file?"
                    )
                started = True
                continue
            while words:
                word, keyword = words[0], words[0].upper()
                if word == "{":
                    if isinstance(pending, str):
                        raise self.fail(number, "a brace opens that belongs to no joint; check the hierarchy")
                    if len(stack) == MOST_LEVELS:
                        raise self.fail(number, f"more than {MOST_LEVELS} levels of joints; export the motion again")
                    stack.append(pending)
                    pending = "none"
                    words = words[1:]
                elif word == "}":
                    if not stack:
                        raise self.fail(number, "one closing brace too many; check the hierarchy")
                    stack.pop()
                    words = words[1:]
                elif keyword in ("ROOT", "JOINT"):
                    name, words = self._until_brace(words[1:])
                    pending = self._add_joint(number, keyword, name, stack)
                elif keyword == "END":
                    _, words = self._until_brace(words[1:])
                    if not stack or stack[-1] is None:
                        raise self.fail(number, "an End Site outside any joint; check the hierarchy")
                    if stack[-1] in self.ended:
                        raise self.fail(number, f"a second End Site of joint {self.names[stack[-1]]!r}; keep one")
                    self.ended.add(stack[-1])
                    pending = None
                elif keyword == "OFFSET":
                    self._set_offset(number, words[1:4], stack, offset_seen)
                    words = words[4:]
                elif keyword == "CHANNELS":
                    words = self._set_channels(number, words[1:], stack)
                else:
                    raise self.fail(
                        number,
                        f"unknown word {inputs.shown(word[:40])!r} in the hierarchy; expected JOINT, OFFSET, CHANNELS or End Site",
                    )
        if stack or pending != "none" or not self.names:
            raise self.fail(number, "the hierarchy ends before its braces close; the file is cut off or damaged")
        for joint, name in enumerate(self.names):
            if joint not in offset_seen:
                raise self.fail(number, f"joint {name!r} has no OFFSET")
        return Skeleton(
            tuple(self.names),
            np.array(self.parents),
            np.array(self.offsets),
            np.array(self.end_sites),
            tuple(self.channels),
            "\n".join(self.lines) + "\n",
        )

    @staticmethod
    def _until_brace(words: list[str]) -> tuple[str, list[str]]:
        """Split words at the first opening brace: the text before it, and the words from it on."""
        end = words.index("{") if "{" in words else len(words)
        return " ".join(words[:end]), words[end:]

    def _add_joint(self, number: int, keyword: str, name: str, stack: list[int | None]) -> int:
        """Add a joint below the innermost open one and return its number."""
        if not name:
            raise self.fail(number, f"{keyword} without a name")
        if not name.isprintable() and re.search("[\x00-\x1f\x7f]", name):
            raise self.fail(number, f"the joint name {inputs.shown(name[:40])!r} holds a control character; rename it")
        if len(name) > 200:
            raise self.fail(number, f"the joint name {inputs.shown(name[:40])!r}... is longer than 200 characters")
        if len(self.names) == MOST_JOINTS:
            raise self.fail(number, f"more than {MOST_JOINTS} joints; export the motion of one body")
        if name in self.names:
            raise self.fail(number, f"joint name {name!r} stands twice; rename one of the joints")
        if keyword == "ROOT" and self.names:
            raise self.fail(number, f"a second ROOT {name!r}; only one skeleton per file can be read")
        parent = -1
        if keyword == "JOINT":
            if not stack or stack[-1] is None:
                raise self.fail(number, f"JOINT {name!r} stands outside any joint; check the braces")
            parent = stack[-1]
        self.names.append(name)
        self.parents.append(parent)
        self.offsets.append([0.0, 0.0, 0.0])
        self.end_sites.append([np.nan] * 3)
        self.channels.append(())
        return len(self.names) - 1

    def _set_offset(self, number: int, words: list[str], stack: list, offset_seen: set[int]) -> None:
        """Set the OFFSET of the innermost open joint or End Site."""
        if not self.names or not stack:
            raise self.fail(number, "OFFSET outside any joint; check the braces")
        offset = [value for word in words if (value := inputs.decimal(word)) is not None]
        if len(offset) != 3 or np.abs(offset).max() > _LARGEST_VALUE:
            found = inputs.shown(" ".join(words)[:60])
            raise self.fail(number, f"OFFSET needs three numbers of at most {_LARGEST_VALUE:g}, found {found!r}")
        if stack[-1] is None:
            self.end_sites[stack[-2]] = offset
        elif stack[-1] in offset_seen:
            raise self.fail(number, f"a second OFFSET of joint {self.names[stack[-1]]!r}; keep one")
        else:
            self.offsets[stack[-1]] = offset
            offset_seen.add(stack[-1])

    def _set_channels(self, number: int, words: list[str], stack: list[int | None]) -> list[str]:
        """Set the channels of the innermost open joint and return the words that follow."""
        if not stack or stack[-1] is None:
            raise self.fail(number, "CHANNELS outside any joint; check the braces")
        if not words or not re.fullmatch("[0-9]{1,3}", words[0]):
            raise self.fail(number, f"CHANNELS needs a count, found {' '.join(words[:1])[:40]!r}")
        if stack[-1] in self.with_channels:
            raise self.fail(number, f"a second CHANNELS of joint {self.names[stack[-1]]!r}; keep one")
        self.with_channels.add(stack[-1])
        count = int(words[0])
        names = words[1 : 1 + count]
        unknown = [name for name in names if name.lower() not in _CHANNEL_NAMES]
        if len(names) < count or unknown:
            what = f"unknown channel {unknown[0][:40]!r}" if unknown else f"{len(names)} names"
            raise self.fail(
                number,
                f"CHANNELS announces {count} channels, found {what}; allowed are {' '.join(_CHANNEL_NAMES.values())}",
            )
        channels = tuple(_CHANNEL_NAMES[name.lower()] for name in names)
        rotations = "".join(name[0] for name in channels if name.endswith("rotation"))
        if len(set(channels)) < count or len(rotations) == 2:
            raise self.fail(
                number, f"CHANNELS {' '.join(channels)} cannot be read: each channel once, and 0, 1 or 3 rotations"
            )
        self.channels[stack[-1]] = channels
        return words[1 + count :]


def _read_frames(path: Path, body: str, line: int, skeleton: Skeleton) -> tuple[str, np.ndarray]:
    """Read the frame time in seconds, as it is printed, and the channel values `[shape=(T, n_channels)]`."""
    declared, frame_line, frame_time, rows, first_line = _frames_and_time(path, body, line)
    count = sum(1 for row in _lines(rows) if row.strip())
    width = skeleton.n_channels
    needed = count * len(skeleton.names) * _BYTES_OF_A_POSE
    if needed > _ALWAYS_ALLOWED + _MOST_TIMES * len(body):
        raise DataError(
            f"{inputs.shown(path)}: {len(skeleton.names)} joints in {count:,} frames take {needed / 1e6:,.0f} MB of memory, "
            f"over {_MOST_TIMES} times the file: nearly all are without channels; export them with channels, or not at all"
        )
    try:
        values = (
            np.loadtxt(io.StringIO(rows), dtype=np.float64, ndmin=2, comments=None) if count else np.empty((0, width))
        )
        fine = values.shape == (count, width) and np.isfinite(values).all()
    except ValueError:
        fine = False
    if not fine:
        _find_bad_row(path, rows, first_line, skeleton, declared)
    if count != declared:
        what = "the file is cut off" if count < declared else "the count is wrong or two files were joined"
        raise DataError(
            f"{inputs.shown(path)}:{frame_line}: `Frames: {declared}` but {count} rows of values follow; {what}"
        )
    large = np.argwhere(np.abs(values) > _LARGEST_VALUE)
    if len(large):
        row, column = large[0]
        raise DataError(
            f"{inputs.shown(path)}: frame {row}, {_column_name(skeleton, column)}: {values[row, column]:g} is not a plausible value; "
            "export the motion again"
        )
    return frame_time, values


def _frames_and_time(path: Path, body: str, line: int) -> tuple[int, int, str, str, int]:
    """Read the lines `Frames` and `Frame Time` of a MOTION section.

    Returns `Frames` and its line number, `Frame Time` in seconds as text, the text of the rows below and the number of
    their first line.
    """
    found, place, number = [], 0, line
    for words in (["FRAMES"], ["FRAME", "TIME"]):
        own, text = number, ""
        while not text.strip() and place < len(body):
            end = body.find("\n", place) % (len(body) + 1)  # -1 for none is the end of the text
            own, text = number, body[place : min(end, place + 1000)]
            place, number = end + 1, number + 1
        cells = text.replace(":", " : ", 1).split()
        value = [cell for cell in cells[len(words) :] if cell != ":"]
        if [cell.upper() for cell in cells[: len(words)]] != words or len(value) > 1:
            raise DataError(
                f"{inputs.shown(path)}:{line}: expected `Frames: N` and `Frame Time: seconds` after MOTION; "
                "the file is cut off or damaged"
            )
        found.append((inputs.shown("".join(value)[:30]), "".join(value), own))
    (shown, frames, frame_line), (shown_time, time, time_line) = found
    if not re.fullmatch("[0-9]{1,15}", frames) or int(frames) == 0:
        raise DataError(f"{inputs.shown(path)}:{frame_line}: `Frames: {shown}` is not a number of frames of at least 1")
    frame_time = inputs.decimal(time)
    if frame_time is None or not _FRAME_TIMES[0] <= frame_time <= _FRAME_TIMES[1]:
        low, high = _FRAME_TIMES
        raise DataError(
            f"{inputs.shown(path)}:{time_line}: `Frame Time: {shown_time}` is not a time between {low:g} and {high:g} s"
        )
    return int(frames), frame_line, time, body[place:], number


def _find_bad_row(path: Path, rows: str, first_line: int, skeleton: Skeleton, declared: int) -> None:
    """Raise DataError for the first row that is short, long or holds something that is no finite number."""
    width = skeleton.n_channels
    lines = _lines(rows)
    filled = [number for number, row in enumerate(lines) if row.strip()]
    for number in filled:
        words = lines[number].split()
        where = f"{inputs.shown(path)}:{first_line + number}"
        bad = next(
            (
                column
                for column, word in enumerate(words[:width])
                if (value := inputs.decimal(word)) is None or not np.isfinite(value)
            ),
            None,
        )
        if bad is not None and not (number == filled[-1] and len(words) < width and bad == len(words) - 1):
            raise DataError(
                f"{where}: column {bad + 1} ({_column_name(skeleton, bad)}) is {words[bad][:30]!r}, not a finite number"
            )
        if len(words) != width:
            cut = number == filled[-1] and len(filled) <= declared and len(words) < width
            what = "the file is cut off" if cut else "every row needs one value per channel"
            raise DataError(f"{where}: {len(words)} values where the hierarchy has {width} channels; {what}")
    raise DataError(f"{inputs.shown(path)}: the frames cannot be read as numbers; the file is damaged")


def _column_name(skeleton: Skeleton, column: int) -> str:
    """Name the joint and the channel of a column of values."""
    names = [
        f"{joint} {channel}"
        for joint, channels in zip(skeleton.names, skeleton.channels, strict=True)
        for channel in channels
    ]
    return names[column]


# Rates that recordings are made at: of several whole numbers that a frame time of few digits may stand for.
_CUSTOMARY_RATES = (24, 25, 30, 48, 50, 60, 72, 90, 100, 120, 144, 180, 200, 240)


def frames_per_second(frame_time: str) -> float:
    """Compute the rate that a printed frame time in seconds stands for.

    A whole number whose period, rounded or cut off to as many digits (or to the precision of 32 bits), is what is
    printed, where there is just one, or just one customary one; else what the digits say. So 0.0333 is 30, and
    0.0333667 is 29.97.
    """
    printed = float(frame_time)
    unit = 10.0 ** int(Decimal(frame_time).as_tuple().exponent)

    def stands_for(rate: int) -> bool:
        off = 1.0 / rate - printed
        return -0.5 * unit <= off * (1 + 1e-9) < unit * (1 - 1e-9) or abs(off) <= 1e-6 * printed

    if abs(printed * round(1.0 / printed) - 1.0) < 1e-9:
        return float(round(1.0 / printed))
    low, high = 1.0 / (printed + unit), 1.0 / max(printed - unit, _FRAME_TIMES[0])
    rates = [rate for rate in range(max(int(low), 1), min(int(high) + 2, 10_001)) if stands_for(rate)]
    customary = [rate for rate in rates if rate in _CUSTOMARY_RATES]
    found = rates if len(rates) == 1 else customary
    return float(found[0]) if len(found) == 1 else 1.0 / printed


def _rotation_order(channels: tuple[str, ...]) -> str:
    """Return the order of a joint's rotation channels, such as `ZXY`."""
    return "".join(name[0] for name in channels if name.endswith("rotation"))


def _columns(skeleton: Skeleton) -> Iterator[tuple[int, list[tuple[int, int]], list[int], str]]:
    """Yield per joint its number, position columns [(column, axis)], rotation columns and rotation order."""
    column = 0
    for joint, channels in enumerate(skeleton.channels):
        positions = [
            (column + k, _AXES[name[0].lower()]) for k, name in enumerate(channels) if name.endswith("position")
        ]
        rotations = [column + k for k, name in enumerate(channels) if name.endswith("rotation")]
        yield joint, positions, rotations, _rotation_order(channels)
        column += len(channels)


def _to_motion(skeleton: Skeleton, values: np.ndarray, fps: float) -> Motion:
    """Convert channel values `[shape=(T, n_channels)]` to a motion."""
    frames, joints = len(values), len(skeleton.names)
    rotations = np.tile(rotation.IDENTITY, (frames, joints, 1))
    positions = np.tile(skeleton.offsets, (frames, 1, 1))
    by_order: dict[str, tuple[list[int], list[list[int]]]] = {}
    for joint, position_columns, rotation_columns, order in _columns(skeleton):
        for column, axis in position_columns:
            positions[:, joint, axis] = values[:, column]
        if order:
            joints_of, columns_of = by_order.setdefault(order, ([], []))
            joints_of.append(joint)
            columns_of.append(rotation_columns)
    still = np.ptp(values, axis=0) == 0
    for order, (joints_of, columns_of) in by_order.items():
        turning, columns = np.array(joints_of), np.array(columns_of)
        # A third of GENEA's joints never turn: convert their one pose once.
        constant = still[columns].all(axis=1)
        rotations[:, turning[constant]] = rotation.from_euler(order, np.radians(values[:1][:, columns[constant]]))
        rotations[:, turning[~constant]] = rotation.from_euler(order, np.radians(values[:, columns[~constant]]))
    return Motion(skeleton, rotations, positions, fps, *_written_angles(skeleton, values))


def _written_angles(skeleton: Skeleton, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Collect the angles that a file writes otherwise than conversion from rotations would give them (`Motion`)."""
    joints, angles = [], []
    for joint, _, columns, _ in _columns(skeleton):
        if columns:
            own = values[:, columns]
            largest = np.abs(own).max(axis=0)
            # The middle angle of three, and the first of one, as conversion gives them.
            plain = (largest <= 180.0).all() and (len(columns) == 1 or largest[1] < 90.0 - 1e-3)
            if not plain or (np.abs(np.diff(own, axis=0)) > euler.CERTAIN).any():
                joints.append(joint)
                angles.append(np.pad(own, [(0, 0), (0, 3 - len(columns))]))
    return np.array(joints, dtype=np.int64), np.stack(angles, axis=1) if joints else np.zeros((len(values), 0, 3))


def _to_channels(motion: Motion) -> np.ndarray:
    """Convert a motion to channel values; a joint with one rotation channel keeps that axis's share.

    Returns float `[shape=(T, n_channels)]`.

    Angles are those nearest to the frame before, and a source's own where its frames are taken over (`euler`).
    """
    motion = axes.to_file(motion)
    skeleton = motion.skeleton
    written = {joint: place for place, joint in enumerate(motion.written_joints.tolist())}
    values = np.zeros((motion.n_frames, skeleton.n_channels))
    by_order: dict[str, tuple[list[int], list[list[int]]]] = {}
    for joint, position_columns, rotation_columns, order in _columns(skeleton):
        for column, axis in position_columns:
            values[:, column] = motion.positions[:, joint, axis]
        if order:
            full = order if len(order) == 3 else order + "".join(axis for axis in "XYZ" if axis not in order)
            joints_of, columns_of = by_order.setdefault(full, ([], []))
            joints_of.append(joint)
            columns_of.append(rotation_columns)
    for order, (joints_of, columns_of) in by_order.items():
        rotations = motion.rotations[:, joints_of]
        angles = np.degrees(rotation.to_euler(order, rotations))
        for k, (joint, columns) in enumerate(zip(joints_of, columns_of, strict=True)):
            own = motion.written_angles[:, written[joint]] if joint in written else None
            angles[:, k] = euler.continuous(order, angles[:, k], rotations[:, k], own, one_axis=len(columns) == 1)
            values[:, columns] = angles[:, k, : len(columns)]
    # "-0.000000" in one frame and "0.000000" in the next would be a difference without a meaning.
    return np.round(values, 6) + 0.0

"""The check, before work starts, that it fits into memory."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from gesturegen.data.index import Index
from gesturegen.errors import DataError
from gesturegen.methods import METHODS
from gesturegen.settings.models import Config


def estimate(reference_frames: int, test_frames: int, config: Config, kept_frames: int = 0) -> float:
    """Estimate the bytes that a worker needs at most for a library and a test speech of so many frames.

    kept_frames : of another library, which a worker holds until the next one has been read
    """
    return METHODS[config.method].bytes_needed(reference_frames, test_frames, config, kept_frames)


def workers(needs: Sequence[float], jobs: int, available: float | None) -> int:
    """Count how many of `jobs` workers fit, at most one per task, 0 where not even one does.

    needs : bytes of each task; available : bytes, None where that is unknown
    """
    jobs = min(jobs, len(needs))
    if available is None:
        return jobs
    # Whatever runs at the same time is no more than the largest.
    largest = sorted(needs, reverse=True)[:jobs]
    return next((count for count in range(jobs, 0, -1) if sum(largest[:count]) <= available), 0)


def require_memory(
    config: Config,
    chosen: Mapping[str, Sequence[str]],
    index: Index,
    jobs: int,
    tasks: int | None = None,
    available: float | None = None,
) -> tuple[int, list[tuple[str, str]]]:
    """Compute the number of workers that fit into memory, and warn where these are fewer than `jobs`.

    chosen : the reference clips of each test clip; index : of `preprocess`; tasks : how many run, by default one
    for each test clip; available : bytes, by default what this machine has

    Raises DataError when not even one worker fits.
    """
    return require_memory_for([(config, chosen)], index, jobs, tasks, available)


def require_memory_for(
    runs: Sequence[tuple[Config, Mapping[str, Sequence[str]]]],
    index: Index,
    jobs: int,
    tasks: int | None = None,
    available: float | None = None,
) -> tuple[int, list[tuple[str, str]]]:
    """Do as `require_memory` for several runs, whose tasks run side by side."""
    available = available_bytes() if available is None else available
    groups = {
        (run, test): (tuple(names), config.references.seconds)
        for run, (config, chosen) in enumerate(runs)
        for test, names in chosen.items()
    }
    frames = {groups[run, test]: reference_frames(runs[run][0], groups[run, test][0], index) for run, test in groups}
    *_, second, largest = sorted([0, *frames.values()]) if frames else (0, 0)
    sizes = {}
    for (run, test), group in groups.items():
        config, own = runs[run][0], frames[group]
        test_frames = round(index.tests[test].seconds * config.fps)
        sizes[run, test] = estimate(own, test_frames, config, second if own == largest else largest), own
    needs = sorted((need for need, _ in sizes.values()), reverse=True)[:tasks]
    found = workers(needs, jobs, available)
    wanted = min(jobs, len(needs))
    if found == wanted:
        return jobs, []
    assert available is not None  # where it is unknown, all of them run
    need, most_frames = max(sizes.values())
    gigabytes = f"{need / 1e9:.1f} GB, and {available / 1e9:.1f} GB are free"
    if found == 0:
        raise DataError(
            f"references of {most_frames} frames in one graph: a worker needs up to {gigabytes}; give fewer references "
            "(references.mode, references.seconds)" + _or_thriftier(runs)
        )
    return found, [
        (
            "memory",
            f"{found} of {wanted} workers run, because with references of {most_frames} frames in one graph each needs "
            f"up to {gigabytes}; fewer references (references.mode, references.seconds) allow more",
        )
    ]


def _or_thriftier(runs: Sequence[tuple[Config, Mapping]]) -> str:
    settings = dict.fromkeys(METHODS[config.method].thrift(config) for config, _ in runs)
    return "".join(f", or {setting}" for setting in settings if setting)


def reference_frames(config: Config, names: Sequence[str], index: Index) -> int:
    """Compute the number of frames in the graph of some reference clips, by their lengths in the index."""
    seconds = sum(index.references[name].seconds for name in names)
    if config.references.seconds is not None:
        seconds = min(seconds, config.references.seconds)
    return round(seconds * config.fps)


def available_bytes() -> float | None:
    """Find how much memory this process can still have, by the system and its control group; None where unknown."""
    found = [amount for amount in (_system_bytes(), _group_bytes()) if amount is not None]
    return min(found, default=None)


def _system_bytes() -> float | None:
    for line in _lines(Path("/proc/meminfo")):
        if line.startswith("MemAvailable:"):
            return 1024.0 * int(line.split()[1])
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):
        return None


def _group_bytes(root: Path = Path("/sys/fs/cgroup"), groups: Path = Path("/proc/self/cgroup")) -> float | None:
    """Compute what the limits of our control group and of its parents leave; None where there is no limit."""
    left = []
    for line in _lines(groups):
        _, _, entry = line.partition(":")
        controllers, _, path = entry.partition(":")
        if controllers and "memory" not in controllers.split(","):
            continue
        # Version 2 has one tree and no controllers named; version 1 one of its own for memory.
        base, limit, usage = (
            (root, "memory.max", "memory.current")
            if not controllers
            else (root / "memory", "memory.limit_in_bytes", "memory.usage_in_bytes")
        )
        place = base / path.lstrip("/")
        # In a container the path may be the host's: then the limit stands at the top.
        for folder in [place, *place.parents]:
            most, used = (_number(folder / name) for name in (limit, usage))
            if most is not None:
                left.append(most - (used or 0.0) + _reclaimable(folder))
            if folder == base:
                break
    return min(left, default=None)


def _reclaimable(folder: Path) -> float:
    """Read how many bytes of a group are file cache, which is given up when memory is needed."""
    names = ("inactive_file", "total_inactive_file")
    found = [float(line.split()[1]) for line in _lines(folder / "memory.stat") if line.split(" ")[0] in names]
    return max(found, default=0.0)


def _number(path: Path) -> float | None:
    text = next(iter(_lines(path)), "")
    return float(text) if text.isdigit() else None


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text().splitlines()
    except OSError:
        return []

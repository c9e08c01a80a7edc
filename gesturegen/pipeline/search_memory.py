"""The measurement of the memory that a search takes, in a separate process."""

from __future__ import annotations

import math
import sys
from pathlib import Path

from threadpoolctl import threadpool_limits

from gesturegen.methods import METHODS, libraries
from gesturegen.pipeline.gesturing import read_speech, search
from gesturegen.settings.models import Config


def measure_search(library_path: Path, test: str, config: Config) -> dict[str, float]:
    """Measure the peak memory in MB of loading a library and searching for a test clip, and the growth it caused."""
    with threadpool_limits(limits=1):
        before = peak_megabytes()
        library = libraries.load(library_path, METHODS[config.method], config)
        search(test, library, read_speech(test, config), config)
        peak = peak_megabytes()
    return {"search_memory": round(peak - before, 1), "peak_memory": round(peak, 1)}


def peak_megabytes() -> float:
    """Return the peak resident memory of this process, in MB; NaN where that cannot be asked."""
    try:
        # Unlike `ru_maxrss`, which on Linux starts from that of the process that started this one.
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
        import resource

        unit = 1 if sys.platform == "darwin" else 1024
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
    except (OSError, ImportError):
        return math.nan

"""Check that memory stays flat over many clips, and below a limit for a long speech with each method.

    python scripts/check_memory.py [--clips 300] [--minutes 20] [--only PART ...]

Two parts, `many` and `long`, on demo data in a temporary folder:

`many` : one reference and 300 test clips of 10 s, stage by stage with two workers. The largest process of the last
    third of a stage may be at most 5 % and 20 MB larger than that of its first third. Thirds are of the CPU time that
    a stage took, which does not depend on what else the machine does.
`long` : one test speech of 20 minutes through all stages with each recommended config: at most 2 GB in any process.

Prints a line per measurement; exits with 1 when a limit is passed.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile

from gesturegen import demo

LIMIT = 2e9  # bytes of a process
GROWTH, MARGIN = 1.05, 20e6
STAGES = ("preprocess", "build-graph", "reenact", "evaluate")
CONFIGS = ("casia_go_2023", "best", "gesture_master_2022", "motion_matching_2022")
# A few minutes of reference have hardly a transition below delta_T = 8.
OPTIONS = {"gesture_master_2022": ("gesture_master.upper.delta_t=null", "gesture_master.upper.delta_quantile=0.25")}
PAUSE = 0.05  # seconds between two looks at the processes
TICKS, PAGE = os.sysconf("SC_CLK_TCK"), os.sysconf("SC_PAGE_SIZE")
CONFIG_FOLDER = Path(__file__).parent.parent / "configs"


@dataclass(frozen=True)
class Sample:
    """CPU seconds that all processes of a command have used so far, and bytes of the largest one."""

    cpu: float
    largest: float


@dataclass(frozen=True)
class Measured:
    """Bytes of the largest process at its peak, and what was seen on the way there."""

    peak: float
    samples: Sequence[Sample]

    def thirds(self) -> tuple[float, float]:
        """The largest process of the first third and of the last one, by CPU time."""
        end = self.samples[-1].cpu
        first = [sample.largest for sample in self.samples if sample.cpu <= end / 3]
        last = [sample.largest for sample in self.samples if sample.cpu >= end * 2 / 3]
        return max(first), max(last)


def measure(command: Sequence[str]) -> Measured:
    """Run a command in a session of its own; SystemExit when it fails."""
    with tempfile.TemporaryFile("w+") as told:
        process = subprocess.Popen(command, stdout=told, stderr=subprocess.STDOUT, start_new_session=True)
        samples, ended = [], threading.Event()
        watch = threading.Thread(target=_watch, args=(process.pid, samples, ended))
        watch.start()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        ended.set()
        watch.join()
        if process.returncode != 0:
            told.seek(0)
            raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}\n{told.read()}")
    # Of this process and of its workers, which it has waited for.
    return Measured(1024.0 * usage.ru_maxrss, samples)


def _watch(session: int, samples: list[Sample], ended: threading.Event) -> None:
    ticks: dict[str, int] = {}
    while not ended.wait(PAUSE):
        largest = 0
        for number in filter(str.isdigit, os.listdir("/proc")):
            try:
                fields = Path("/proc", number, "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue  # it has ended
            if int(fields[3]) == session:
                ticks[number] = int(fields[11]) + int(fields[12])
                largest = max(largest, int(fields[21]) * PAGE)
        if largest:
            samples.append(Sample(sum(ticks.values()) / TICKS, largest))


def gesturegen(command: str, config: str, data: Path, work: Path, jobs: int) -> list[str]:
    options = [word for pair in OPTIONS.get(config, ()) for word in ("--set", pair)]
    call = [sys.executable, "-c", "from gesturegen.cli import main; main()", command, *options]
    return [
        *call, "--config", str(CONFIG_FOLDER / f"{config}.yaml"), "--data", str(data), "--work", str(work),
        "-j", str(jobs), "--quiet",
    ]  # fmt: skip


def many_clips(folder: Path, count: int) -> list[str]:
    """What grew while many clips went through each stage."""
    data, faults = folder / "data", []
    for spec in demo.clip_specs(references=1, tests=1, seed=1, reference_seconds=(30, 30), test_seconds=(10, 10)):
        demo.write_clip(data, spec)
    for kind in ("wav", "tsv"):
        (first,) = (data / "tst/main-agent" / kind).iterdir()
        for number in range(1, count):
            shutil.copy(first, first.with_stem(f"tst_{number:03d}"))
    for stage in STAGES:
        found = measure(gesturegen(stage, CONFIGS[0], data, folder / "work", jobs=2))
        first, last = found.thirds()
        print(
            f"{count} clips, {stage}: {first / 1e6:.0f} MB in the first third, {last / 1e6:.0f} MB in the last",
            flush=True,
        )
        if last > GROWTH * first + MARGIN:
            faults.append(
                f"{stage}: {first / 1e6:.0f} MB in the first third of {count} clips, {last / 1e6:.0f} MB in the last"
            )
    return faults


def long_speech(folder: Path, minutes: int) -> list[str]:
    """Which config takes too much memory for a long speech."""
    data, faults = folder / "data", []
    for spec in demo.clip_specs(references=3, tests=1, seed=1, reference_seconds=(60, 60), test_seconds=(60, 60)):
        demo.write_clip(data, spec)
    repeat_speech(data / "tst/main-agent", minutes)
    for config in CONFIGS:
        peaks = {stage: measure(gesturegen(stage, config, data, folder / config, jobs=1)).peak for stage in STAGES}
        told = ", ".join(f"{stage} {peak / 1e6:.0f} MB" for stage, peak in peaks.items())
        print(f"{minutes} minutes, {config}: {told}", flush=True)
        faults += [
            f"{config}, {stage}: {peak / 1e6:.0f} MB for a speech of {minutes} minutes, allowed are {LIMIT / 1e6:.0f} MB"
            for stage, peak in peaks.items()
            if peak > LIMIT
        ]
    return faults


def repeat_speech(folder: Path, times: int) -> None:
    """Make the only speech of a folder so many times as long, its words as well."""
    (sound,), (transcript,) = (folder / "wav").iterdir(), (folder / "tsv").iterdir()
    samples, rate = soundfile.read(sound)
    soundfile.write(sound, np.tile(samples, times), rate)
    rows = [line.split("\t") for line in transcript.read_text().splitlines()]
    shifts = [len(samples) / rate * number for number in range(times)]
    transcript.write_text(
        "".join(f"{float(row[0]) + s:.3f}\t{float(row[1]) + s:.3f}\t{row[2]}\n" for s in shifts for row in rows)
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and compare; 1 when a limit is passed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=int, default=300)
    parser.add_argument("--minutes", type=int, default=20)
    parser.add_argument("--only", nargs="+", choices=("many", "long"), default=("many", "long"))
    asked = parser.parse_args(arguments)
    parts = {"many": lambda folder: many_clips(folder, asked.clips), "long": lambda f: long_speech(f, asked.minutes)}
    faults = []
    for name in asked.only:
        with tempfile.TemporaryDirectory() as folder:
            faults += parts[name](Path(folder))
    for fault in faults:
        print(f"FAILED: {fault}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())

"""Check that memory stays flat over many clips, and below a limit for a long speech with each method.

    python scripts/check_memory.py [--clips 300] [--minutes 20] [--only PART ...]

Two parts, `many` and `long`, on demo data in a temporary folder:

`many` : one reference and 300 test clips of 10 s, stage by stage with two workers. The largest process of a stage may
    be at most 5 % and 20 MB larger than with 100 clips.
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
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import soundfile

from gesturegen import demo

LIMIT = 2e9  # bytes of a process
FEWER = 3  # times
GROWTH, MARGIN = 1.05, 20e6
STAGES = ("preprocess", "build-graph", "reenact", "evaluate")
CONFIGS = ("casia_go_2023", "best", "gesture_master_2022", "motion_matching_2022")
# A few minutes of reference have hardly a transition below delta_T = 8.
OPTIONS = {"gesture_master_2022": ("gesture_master.upper.delta_t=null", "gesture_master.upper.delta_quantile=0.25")}
CONFIG_FOLDER = Path(__file__).parent.parent / "configs"


def measure(command: Sequence[str]) -> float:
    """Run a command; return the bytes of its largest process at its peak. SystemExit when it fails."""
    with tempfile.TemporaryFile("w+") as told:
        process = subprocess.Popen(command, stdout=told, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            told.seek(0)
            raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}\n{told.read()}")
    return 1024.0 * usage.ru_maxrss  # of this process and of its workers, which it has waited for


def gesturegen(command: str, config: str, data: Path, work: Path, jobs: int) -> list[str]:
    options = [word for pair in OPTIONS.get(config, ()) for word in ("--set", pair)]
    call = [sys.executable, "-c", "from gesturegen.cli import main; main()", command, *options]
    return [
        *call, "--config", str(CONFIG_FOLDER / f"{config}.yaml"), "--data", str(data), "--work", str(work),
        "-j", str(jobs), "--quiet",
    ]  # fmt: skip


def many_clips(folder: Path, count: int) -> list[str]:
    """Report the stages whose memory grew while many clips went through."""
    few, many = (_peaks(folder / str(number), number) for number in (count // FEWER, count))
    faults = []
    for stage in STAGES:
        told = (
            f"{stage}: {few[stage] / 1e6:.0f} MB with {count // FEWER} clips, {many[stage] / 1e6:.0f} MB with {count}"
        )
        print(told, flush=True)
        if many[stage] > GROWTH * few[stage] + MARGIN:
            faults.append(told)
    return faults


def _peaks(folder: Path, count: int) -> dict[str, float]:
    """Measure the bytes of the largest process of each stage for so many test clips."""
    data = folder / "data"
    for spec in demo.clip_specs(references=1, tests=1, seed=1, reference_seconds=(30, 30), test_seconds=(10, 10)):
        demo.write_clip(data, spec)
    for kind in ("wav", "tsv"):
        (first,) = (data / "tst/main-agent" / kind).iterdir()
        for number in range(1, count):
            shutil.copy(first, first.with_stem(f"tst_{number:03d}"))
    return {stage: measure(gesturegen(stage, CONFIGS[0], data, folder / "work", jobs=2)) for stage in STAGES}


def long_speech(folder: Path, minutes: int) -> list[str]:
    """Report the configs that take too much memory for a long speech."""
    data, faults = folder / "data", []
    for spec in demo.clip_specs(references=3, tests=1, seed=1, reference_seconds=(60, 60), test_seconds=(60, 60)):
        demo.write_clip(data, spec)
    repeat_speech(data / "tst/main-agent", minutes)
    for config in CONFIGS:
        peaks = {stage: measure(gesturegen(stage, config, data, folder / config, jobs=1)) for stage in STAGES}
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
    """Measure and compare; return 1 when a limit is passed."""
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

"""Make the golden files of `tests/test_golden.py` anew, loudly.

    python scripts/regenerate_golden.py --yes

Run it only when the behaviour is meant to change; then read the diff of `tests/golden/expected` line by line.
`--inputs` also makes the recordings themselves anew.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from click.testing import CliRunner

from gesturegen.cli import main
from gesturegen.motion import cleanup
from tests import tiny
from tests.builders import bursts, chain, write_audio, write_clip

GOLDEN = Path(__file__).parent.parent / "tests" / "golden"
KEPT = ("reenact/tst_tiny.trace.json", "reenact/tst_tiny.bvh", "evaluate/metrics.csv")


def make_inputs(folder: Path) -> None:
    """Make recordings of one tiny speaker: 8 s of smooth motion of a four-joint arm, a 4 s test, at 8 kHz."""
    for split in ("trn", "tst"):
        shutil.rmtree(folder / split, ignore_errors=True)
    rng = np.random.default_rng(2023)
    coarse = tiny.motion(rng, 41, chain(4))
    motion = cleanup.interpolate(coarse, np.linspace(0.0, 40.0, 240))
    times = np.cumsum(rng.uniform(0.25, 0.7, size=30))
    words = [(float(t), float(t) + 0.2, "hello" if k % 5 == 2 else "word") for k, t in enumerate(times[times < 7.5])]
    write_clip(folder / "trn", "trn_tiny", 8.0, words=words, motion=motion)
    write_audio(folder / "trn/main-agent/wav/trn_tiny.wav", bursts(times[times < 7.8], 8.0, 8000), 8000)
    write_clip(folder / "tst", "tst_tiny", 4.0, words=[(1.3, 1.6, "Hello,"), (2.5, 2.8, "north")], with_motion=False)
    write_audio(folder / "tst/main-agent/wav/tst_tiny.wav", bursts((0.3, 0.8, 1.3, 1.9, 2.5, 3.3), 4.0, 8000), 8000)


def run_commands(work: Path) -> None:
    for command in ("preprocess", "build-graph", "reenact", "evaluate"):
        result = CliRunner().invoke(
            main, [command, "--config", "casia_go_2023", "--data", str(GOLDEN), "--work", str(work), "-j", "1"]
        )
        assert result.exit_code == 0, result.output


def regenerate(inputs: bool) -> None:
    if inputs:
        make_inputs(GOLDEN)
    with tempfile.TemporaryDirectory() as work:
        run_commands(Path(work))
        for name in KEPT:
            target = GOLDEN / "expected" / Path(name).name
            target.parent.mkdir(exist_ok=True)
            shutil.copy(Path(work) / name, target)
            print(f"WRITTEN ANEW: {target}")
    print("The golden files are new. Whatever they said before is no longer tested. Read their diff.")


if __name__ == "__main__":
    if "--yes" not in sys.argv:
        sys.exit("This overwrites what the tests expect. Add --yes if the behaviour is meant to change.")
    regenerate("--inputs" in sys.argv)

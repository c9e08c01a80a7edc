"""Start `preprocess -j 2` again and again with nothing compiled, each time followed by a start that finds everything.

    python scripts/cold_starts.py 30

The environment whose Python runs this must have gesturegen installed. All starts must end well, with the same bytes,
and the warm ones must compile nothing. Prints one line, and ends with exit code 1 when a start failed.
"""

import hashlib
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

COMPILING = "compiling loops"


def gesturegen(cache: Path, *arguments: object) -> tuple[int, str]:
    """Run a command; return its exit code (-N where signal N ended it) and everything that was printed."""
    environment = {name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "PYTHONPATH")}
    done = subprocess.run(
        [sys.executable, "-m", "gesturegen.cli", *map(str, arguments)],
        cwd="/", env=environment | {"XDG_CACHE_HOME": str(cache)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout + done.stderr


def digest(folder: Path) -> str:
    paths = sorted(path for path in folder.glob("*.npz"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest() if paths else "nothing"


def start(folder: Path, cache: Path, is_cold: bool) -> tuple[str, str]:
    """Run one start; return the digest of what it wrote, and what is wrong with it."""
    work = folder / cache.name / ("cold" if is_cold else "warm")
    code, said = gesturegen(cache, "preprocess", "--data", folder / "data", "--work", work, "-j", 2)
    wrong = "" if code == 0 else f"exit code {code}: {said}"
    if (COMPILING in said) != is_cold:
        wrong += f"{'did not say that it compiles' if is_cold else 'compiled again'}: {said}"
    return digest(work / "clips"), wrong


def main() -> None:
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    failures, seconds, digests = 0, [], set()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        code, said = gesturegen(folder / "first", "demo-data", folder / "data", "--references", 1, "--tests", 1)
        if code:
            sys.exit(said)
        for k in range(number):
            began = time.monotonic()
            for is_cold in (True, False):
                made, wrong = start(folder, folder / f"cache{k}", is_cold)
                digests.add(made)
                failures += bool(wrong)
                if wrong:
                    print(f"start {k + 1}, {'cold' if is_cold else 'warm'}: {wrong}", file=sys.stderr)
            seconds.append(time.monotonic() - began)
    failures += len(digests) - 1
    print(f"{number} cold starts, each followed by a warm one, {failures} failures, {sum(seconds) / number:.0f} s each")
    sys.exit(failures > 0)


if __name__ == "__main__":
    main()

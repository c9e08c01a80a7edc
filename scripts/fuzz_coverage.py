"""Fuzz the readers by coverage with atheris, where it is installed (`pip install atheris`): `make fuzz`.

    python scripts/fuzz_coverage.py [--runs 20000] [READER ...]

Each reader runs in a process of its own, which ends with the first input that gives anything but a result that holds
or one-line errors; libFuzzer writes that input to the current folder and says its name.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import subprocess
import sys
import tempfile
from pathlib import Path


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("readers", nargs="*", metavar="READER")
    parser.add_argument("--runs", type=int, default=int(os.environ.get("GESTUREGEN_FUZZ_EXAMPLES", "20000")))
    parser.add_argument("--alone", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if importlib.util.find_spec("atheris") is None:
        print("atheris is not installed, so nothing is fuzzed by coverage")
        return 0
    if arguments.alone:
        fuzz(arguments.alone, arguments.runs)
        return 0
    from tests.fuzz.targets import TARGETS

    failed = []
    for name in arguments.readers or TARGETS:
        command = [sys.executable, __file__, "--runs", str(arguments.runs), "--alone", name]
        status = subprocess.run(command, check=False).returncode
        print(f"{name}: {'held' if status == 0 else 'FAILED'} in {arguments.runs} runs", flush=True)
        failed += [name] if status else []
    return 1 if failed else 0


def fuzz(name: str, runs: int) -> None:
    """Fuzz one reader; the process ends here."""
    import atheris

    with atheris.instrument_imports(include=["gesturegen", "yaml"]):
        from tests.fuzz.targets import TARGETS
        from tests.fuzz.test_readers import place, try_to_read
    target = TARGETS[name]
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    corpus = folder / "corpus"
    corpus.mkdir()
    for number, seed in enumerate(target.seeds):
        (corpus / str(number)).write_bytes(seed)
    words = folder / "words"
    lines = ("".join(f"\\x{byte:02x}" for byte in token) for token in target.tokens if len(token) < 60)
    words.write_text("".join(f'"{line}"\n' for line in lines))
    path = place(target, folder)
    options = [f"-runs={runs}", "-max_len=4096", "-timeout=5", "-rss_limit_mb=2048", "-verbosity=0", f"-dict={words}"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], lambda data: try_to_read(target, path, data))
    atheris.Fuzz()


if __name__ == "__main__":
    sys.exit(main())

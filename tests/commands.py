"""Running the command line in tests, and reading what it said and wrote."""

import hashlib
from pathlib import Path

from click.testing import CliRunner

from gesturegen.cli import main

# They take settings.
WITH_SETTINGS = {
    "preprocess", "build-graph", "reenact", "evaluate", "run", "pack", "check", "report", "render", "inspect", "export",
    "train-refiner",
}  # fmt: skip


def run(*arguments):
    """Run a command; without `--config` with the paper's settings, whatever results of other settings there are."""
    words = [str(argument) for argument in arguments]
    if words[0] in WITH_SETTINGS and "--config" not in words:
        words[1:1] = ["--config", "casia_go_2023"]
    result = CliRunner().invoke(main, words)
    if "holds results of other settings" in result.output:
        result = CliRunner().invoke(main, [*words, "--force"])
    return result


def succeed(*arguments):
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    return result


def errors(result) -> list[str]:
    """The lines that tell of errors; there is never a traceback."""
    assert "Traceback" not in result.output, result.output
    return [line for line in result.output.splitlines() if line.lower().startswith("error: ")]


def tree(folder: Path) -> dict[str, str]:
    """Every file below a folder with the hash of its bytes."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}

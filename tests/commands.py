"""Running the command line in tests, and reading what it said and wrote."""

import hashlib
from pathlib import Path

from click.testing import CliRunner

from gesturegen.cli import main


def run(*arguments):
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


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

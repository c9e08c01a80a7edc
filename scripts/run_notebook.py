"""Run every cell of a notebook in a folder of its own, and print what the cells print.

    python scripts/run_notebook.py examples/gesturegen.ipynb [--keep OUT.ipynb]

The notebook itself stays as it is, without outputs; `--keep` writes it with them. Exit code 1 when a cell fails, or shows no
picture where it plots.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("notebook", type=Path)
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    notebook = nbformat.read(given.notebook, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": folder}})
        try:
            client.execute()
        except CellExecutionError as error:
            raise SystemExit(f"{given.notebook}: a cell failed\n{error}") from None
        written = sorted(str(path.relative_to(folder)) for path in Path(folder).glob("*") if path.is_file())
    pictures = 0
    for number, cell in enumerate(notebook.cells, 1):
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            pictures += "image/png" in data
            text = output.get("text", data.get("text/plain", ""))
            print(f"[{number}] {text.strip()}")
    if given.keep:
        nbformat.write(notebook, given.keep)
    if any("pyplot" in cell.source for cell in notebook.cells) and not pictures:
        raise SystemExit(f"{given.notebook}: nothing was plotted")
    print(f"{given.notebook}: {len(notebook.cells)} cells, {pictures} pictures, files: {', '.join(written) or 'none'}")


if __name__ == "__main__":
    main()

"""Strict CSV: every column is known, every row is complete, and every row knows its line."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path

from gesturegen import inputs
from gesturegen.errors import ConfigError, GesturegenError

MOST_BYTES = 1_000_000


def read_rows(
    path: str | Path, columns: Mapping[str, bool], hint: str, others: bool = False,
    error: type[GesturegenError] = ConfigError,
) -> list[tuple[int, dict[str, str]]]:  # fmt: skip
    """Read the rows of a CSV file with their line numbers; raise `error` with the line for missing or malformed parts.

    columns : names of all columns and whether their cells must be filled; they may stand in any order
    hint : what to do when the file cannot be read
    others : whether there may be further columns, which are passed over
    Texts come without the spaces around them, and hold no line break or control character. Blank lines are skipped.
    """
    table = _Table(inputs.shown(path), columns, others, error)
    reader = csv.reader(io.StringIO(_read_text(path, hint, error), newline=""), strict=True)
    try:
        for cells in reader:
            table.add(reader.line_num, [cell.strip() for cell in cells])
    except csv.Error as problem:
        raise error(f"{table.path}:{reader.line_num}: not valid CSV ({problem}); check the quotes") from None
    if table.names is None:
        raise error(f"{table.path}: the file is empty; expected a header line with the columns {_listed(columns)}")
    return table.rows


class _Table:
    """The rows read so far; names : of the columns, None before the header."""

    def __init__(self, path: str, columns: Mapping[str, bool], others: bool, error: type[GesturegenError]):
        self.path, self.columns, self.others, self.error = path, columns, others, error
        self.names: list[str] | None = None
        self.rows: list[tuple[int, dict[str, str]]] = []

    def add(self, line: int, texts: list[str]) -> None:
        """Add a row, the first of which is the header; raise the error of a malformed one."""
        if texts in ([], [""]):
            return
        where = f"{self.path}:{line}"
        if texts[0].startswith(("<<<<<<<", ">>>>>>>", "=======")):
            raise self.error(f"{where}: merge conflict marker; resolve the conflict first")
        if self.names is None:
            _check_header(where, texts, self.columns, self.others, self.error)
            self.names = texts
            return
        for text in texts:
            if (control := inputs.control_character(text)) is not None:
                raise self.error(
                    f"{where}: a cell holds a line break or control character ({control}) after {inputs.shown(text[:20])!r}; "
                    "remove it, or check the quotes"
                )
        if len(texts) != len(self.names):
            raise self.error(
                f"{where}: found {len(texts)} cells, expected {len(self.names)} ({_listed(self.names)}); "
                "a text with commas needs quotes"
            )
        row = {name: text for name, text in zip(self.names, texts, strict=True) if name in self.columns}
        empty = [name for name in self.columns if self.columns[name] and not row[name]]
        if empty:
            raise self.error(f"{where}: column {empty[0]!r} is empty; fill it or delete the line")
        self.rows.append((line, row))


def _check_header(
    where: str, names: list[str], columns: Mapping[str, bool], others: bool, error: type[GesturegenError]
) -> None:
    missing = [name for name in columns if name not in names]
    for name in names:
        if name in columns and names.count(name) > 1:
            raise error(f"{where}: column {name!r} stands twice; keep one")
        if name not in columns and not others:
            unknown = name[:60]
            near = get_close_matches(unknown, columns, n=1, cutoff=0.6)
            if near:
                raise error(f"{where}: unknown column {unknown!r}; did you mean {near[0]!r}?")
            if not missing:
                raise error(f"{where}: unknown column {unknown!r}; expected {_listed(columns)}")
    if missing:
        found = ",".join(names)[:60]
        raise error(
            f"{where}: column {missing[0]!r} is missing; found the header {found!r}, expected the columns {_listed(columns)}, separated by commas"
        )


def _listed(names: Iterable[str]) -> str:
    return inputs.shown(", ".join(names))


def _read_text(path: str | Path, hint: str, error: type[GesturegenError]) -> str:
    raw = inputs.read_bytes(path, MOST_BYTES, error, hint)
    if b"\0" in raw:
        raise error(f"{inputs.shown(path)}: binary data, not a CSV file; export the table as CSV in UTF-8")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        line = raw.count(b"\n", 0, problem.start) + 1
        raise error(
            f"{inputs.shown(path)}:{line}: not a text file in UTF-8; export the table as CSV in UTF-8"
        ) from None

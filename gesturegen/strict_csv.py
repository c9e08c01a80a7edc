"""CSV without its traps: every column is known, every row is complete, and every row knows its line."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path

from gesturegen.errors import ConfigError


def read_rows(path: str | Path, columns: Mapping[str, bool], hint: str) -> list[tuple[int, dict[str, str]]]:
    """The rows of a CSV file with their line numbers; ConfigError with the line for what is missing or malformed.

    columns : names of all columns and whether their cells must be filled; they may stand in any order
    hint : what to do when the file cannot be read
    Texts come without the spaces around them. Blank lines are skipped. A row over several lines (a quoted line
    break) has the number of its last one.
    """
    reader = csv.reader(io.StringIO(_read_text(path, hint), newline=""), strict=True)
    names: list[str] | None = None
    rows = []
    try:
        for cells in reader:
            texts = [cell.strip() for cell in cells]
            if texts in ([], [""]):
                continue
            where = f"{path}:{reader.line_num}"
            if names is None:
                _check_header(where, texts, columns)
                names = texts
                continue
            if len(texts) != len(names):
                raise ConfigError(
                    f"{where}: found {len(texts)} cells, expected {len(names)} ({_listed(names)}); a text with commas needs quotes"
                )
            row = dict(zip(names, texts, strict=True))
            empty = [name for name in names if columns[name] and not row[name]]
            if empty:
                raise ConfigError(f"{where}: column {empty[0]!r} is empty; fill it or delete the line")
            rows.append((reader.line_num, row))
    except csv.Error as error:
        raise ConfigError(f"{path}:{reader.line_num}: not valid CSV ({error}); check the quotes") from None
    if names is None:
        raise ConfigError(f"{path}: the file is empty; expected a header line with the columns {_listed(columns)}")
    return rows


def _check_header(where: str, names: list[str], columns: Mapping[str, bool]) -> None:
    missing = [name for name in columns if name not in names]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"{where}: column {name!r} stands twice; keep one")
        if name not in columns:
            near = get_close_matches(name, columns, n=1, cutoff=0.6)
            if near:
                raise ConfigError(f"{where}: unknown column {name!r}; did you mean {near[0]!r}?")
            if not missing:
                raise ConfigError(f"{where}: unknown column {name!r}; expected {_listed(columns)}")
    if missing:
        found = ",".join(names)[:60]
        raise ConfigError(
            f"{where}: column {missing[0]!r} is missing; found the header {found!r}, expected the columns {_listed(columns)}, separated by commas"
        )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names)


def _read_text(path: str | Path, hint: str) -> str:
    try:
        raw = Path(path).read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); {hint}") from None
    if b"\0" in raw:
        raise ConfigError(f"{path}: binary data, not a CSV file; export the table as CSV in UTF-8")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ConfigError(f"{path}:{line}: not a text file in UTF-8; export the table as CSV in UTF-8") from None

"""Text helpers for descriptions: counted nouns and aligned columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def count(number: int, noun: str) -> str:
    """Format a number with its noun, in the plural where it is not 1."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def align(rows: Sequence[Sequence[str]], figures: Iterable[int]) -> list[str]:
    """Align columns to the width of their widest cell, one line a row; those numbered in `figures` to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    right = set(figures)
    return [
        "  ".join(f"{cell:>{width}}" if k in right else f"{cell:<{width}}" for k, (cell, width) in cells).rstrip()
        for cells in (list(enumerate(zip(row, widths, strict=True))) for row in rows)
    ]

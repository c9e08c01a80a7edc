"""Runs of marked frames."""

from __future__ import annotations

import numpy as np


def runs(marked: np.ndarray) -> np.ndarray:
    """Find first frame and end of every run of True in `marked` `[shape=(n,)]`, int `[shape=(K, 2)]`."""
    edges = np.diff(np.concatenate([[False], marked, [False]]).astype(np.int8))
    return np.column_stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)])

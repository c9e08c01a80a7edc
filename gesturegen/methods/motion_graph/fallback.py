"""Fallbacks of a piece that finds no path (A.1.1): it gives up first its keyword, then stop nodes one by one."""

from __future__ import annotations

import numpy as np

from gesturegen.methods.motion_graph.graph import MotionGraph
from gesturegen.methods.motion_graph.settings import Termination


class StopNodes:
    """The stop nodes of one piece, attempt by attempt; attempt 0 is no retry.

    Retries up to `keyword_retries` keep the keyword, later ones fall back on onset nodes and segment ends;
    from `discard_after_retries` on each retry drops a share of the stop nodes left, at random, never the last.
    """

    def __init__(self, graph: MotionGraph, keyword: str, settings: Termination, rng: np.random.Generator):
        self.settings, self.rng = settings, rng
        self.rhythmic = graph.stop_nodes(None)
        self.keyword = keyword
        self.stops = graph.stop_nodes(keyword) if keyword else self.rhythmic.copy()
        self.fallback: str | None = None

    @property
    def last_retry(self) -> int:
        """Return the number of the last retry."""
        return self.settings.max_retries if self.settings.fallbacks else self.settings.failure_retries

    def for_attempt(self, retry: int) -> np.ndarray:
        """Return the stop nodes of an attempt, bool `[shape=(N,)]`; call it once for each attempt, in order."""
        if not self.settings.fallbacks:
            return self.stops
        if self.keyword and retry == self.settings.keyword_retries + 1:
            self.stops, self.fallback = self.rhythmic.copy(), "keyword"
        if retry > self.settings.discard_after_retries:
            self._discard()
        return self.stops

    def _discard(self) -> None:
        left = np.flatnonzero(self.stops)
        drop = min(max(1, int(len(left) * self.settings.discard_share)), len(left) - 1)
        if drop > 0:
            self.stops[self.rng.choice(left, size=drop, replace=False)] = False
            self.fallback = "discard"

"""Cutting a motion or a speech into gesture clips and rests, at the gaps between its words (§3.1).

The paper cuts where the time between two words is larger than 0.4 seconds. It does not say what becomes of
long silences, nor how its clips come to last from 1 to "more than 10 seconds"; rests, `min_seconds` and
`max_seconds` are our answer.

Conventions
- Gaps are measured in time, not in whole frames; a cut at time t is a cut before frame floor(t * fps).
- `min_seconds` is rounded up to whole frames, `max_seconds` down, but never below what can be cut in two.
- Short clips are dealt with first, from left to right, then long ones; no part of a long clip gets too short.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gesturegen.settings.speech import Cutting
from gesturegen.speech.transcript import Word

THRESHOLDS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)

# A gap of exactly the limit, in frames, is no cut, and gaps that differ by less are equally wide.
_FRAME_SLACK = 1e-6


@dataclass(frozen=True)
class Cut:
    """The frames from `start` up to, not including, `end`; `rest` where nothing is said."""

    start: int
    end: int
    rest: bool


@dataclass
class _Piece:
    """A clip in the making; `gap` is the silence in frames before its first word, or the length of a rest."""

    start: int
    end: int
    rest: bool
    gap: float

    @property
    def length(self) -> int:
        """Length in frames."""
        return self.end - self.start


@dataclass(frozen=True)
class _Gaps:
    """Stretches without a word, in order: before the first of K words, between two words, after the last.

    starts, ends : float [shape=(K + 1,)], in frames; an end at or before its start is no gap
    """

    starts: np.ndarray
    ends: np.ndarray

    @property
    def widths(self) -> np.ndarray:
        """Widths of the gaps in frames."""
        return self.ends - self.starts

    @property
    def middles(self) -> np.ndarray:
        """Frames in the middle of the gaps."""
        return _frames((self.starts + self.ends) / 2)


def cut(
    words: Sequence[tuple[float, float]],
    n_frames: int,
    fps: float,
    settings: Cutting,
    speeds: np.ndarray | None = None,
) -> list[Cut]:
    """Cut the frames 0 to `n_frames` into clips and rests, in order, each frame once.

    words : start and end in seconds from frame 0, in order of start. They may overlap, have no length (an
        instant) or stick out of the frames (what is outside does not count).
    speeds : float [shape=(n_frames,)], of the wrists; None for a speech without motion
    No clip is shorter than `min_seconds`, unless it is the only one, and none is longer than `max_seconds`.

    1. A gap (also before the first and after the last word) of over `rest_seconds` is a rest; without any word
       all is rest. A gap between words of over `gap_seconds` is cut at its middle.
    2. A rest shorter than `min_seconds` goes to the shorter clip beside it. A clip shorter than `min_seconds`
       is joined with the clip across the narrower gap. Between rests it grows at their expense, evenly, as far
       as they keep `min_seconds`; where they have too little it is joined with the shorter of them.
    3. A clip longer than `max_seconds` is cut at the middle of its widest gap between words, again and again;
       where it has none, before its slowest frame; without speeds into equal parts. A rest has no gaps.

    Of equals the left one is taken; in 3. the one nearest to the clip's middle, then the left one.
    Raises ValueError when there are not as many speeds as frames.
    """
    if speeds is not None and np.shape(speeds) != (n_frames,):
        raise ValueError(f"speeds {np.shape(speeds)} do not fit {n_frames} frames")
    if n_frames <= 0:
        return []
    min_frames = max(int(np.ceil(settings.min_seconds * fps - _FRAME_SLACK)), 1)
    # Anything longer can be cut into two parts that are not too short.
    max_frames = max(int(np.floor(settings.max_seconds * fps + _FRAME_SLACK)), 2 * min_frames - 1)
    gaps = _find_gaps(words, n_frames, fps)
    pieces = _cut_at_gaps(gaps, n_frames, settings.gap_seconds * fps, settings.rest_seconds * fps)
    pieces = _give_away_short_rests(pieces, min_frames)
    pieces = _lengthen(pieces, min_frames)
    return _shorten(pieces, gaps, speeds, min_frames, max_frames)


def threshold_row(
    words: Sequence[tuple[float, float]],
    n_frames: int,
    fps: float,
    settings: Cutting,
    thresholds: Sequence[float] = THRESHOLDS,
    speeds: np.ndarray | None = None,
) -> np.ndarray:
    """Count, for each `gap_seconds` of `thresholds`, the gesture clips and sum their length in seconds.

    Rests are not counted; the other arguments are those of `cut`. Returns float [shape=(K, 2)]. Rows of many
    recordings add up to the mean length per threshold, by which the paper chose 0.4 seconds (§3.1).
    """
    rows = np.zeros((len(thresholds), 2))
    for row, threshold in zip(rows, thresholds, strict=True):
        cuts = cut(words, n_frames, fps, settings.model_copy(update={"gap_seconds": threshold}), speeds)
        lengths = [piece.end - piece.start for piece in cuts if not piece.rest]
        row[:] = len(lengths), sum(lengths) / fps
    return rows


def _frames(times: np.ndarray) -> np.ndarray:
    """Round times, counted in frames, down to the frames in which they fall."""
    return np.floor(times + _FRAME_SLACK).astype(np.int64)


def _find_gaps(words: Sequence[tuple[float, float]], n_frames: int, fps: float) -> _Gaps:
    """Find the gaps between words, in frames."""
    times = np.asarray(words, dtype=np.float64).reshape(-1, 2) * fps
    # As in `transcript.read`: an instant at frame 0 is inside, a word that ends there is not.
    outside = (times[:, 0] > n_frames - _FRAME_SLACK) | ((times[:, 0] < -_FRAME_SLACK) & (times[:, 1] < _FRAME_SLACK))
    starts, ends = times[~outside].clip(0, n_frames).T
    # Of overlapping words the later one need not be the one that ends last.
    ends = np.maximum.accumulate(np.maximum(starts, ends))
    return _Gaps(np.append(0.0, ends), np.append(starts, float(n_frames)))


def _cut_at_gaps(gaps: _Gaps, n_frames: int, gap_limit: float, rest_limit: float) -> list[_Piece]:
    """Cut at wide gaps into rests and, between them, clips, which may be too short (even empty) or too long."""
    if len(gaps.widths) == 1:
        return [_Piece(0, n_frames, True, float(n_frames))]
    widths, last = gaps.widths, len(gaps.widths) - 1
    starts, ends, middles = _frames(gaps.starts), _frames(gaps.ends), gaps.middles
    rests = widths > rest_limit + _FRAME_SLACK
    cuts = widths > gap_limit + _FRAME_SLACK
    cuts[[0, last]] = False
    pieces: list[_Piece] = []
    start, gap_before = 0, float(widths[0])
    for k in np.flatnonzero(rests | cuts).tolist():
        end, next_start = (int(starts[k]), int(ends[k])) if rests[k] else (int(middles[k]), int(middles[k]))
        gap = float(widths[k])
        if k > 0:
            pieces.append(_Piece(start, end, False, gap_before))
        if rests[k]:
            pieces.append(_Piece(end, next_start, True, gap))
        start, gap_before = next_start, gap
    if not rests[last]:
        pieces.append(_Piece(start, n_frames, False, gap_before))
    return pieces


def _give_away_short_rests(pieces: list[_Piece], min_frames: int) -> list[_Piece]:
    """Give every rest that is too short to the shorter clip beside it (two rests are never neighbours)."""
    kept: list[_Piece] = []
    for k, piece in enumerate(pieces):
        left = kept[-1] if kept else None
        right = pieces[k + 1] if k + 1 < len(pieces) else None
        if not piece.rest or piece.length >= min_frames or (left is None and right is None):
            kept.append(piece)
        elif left is not None and (right is None or left.length <= right.length):
            left.end = piece.end
        elif right is not None:
            right.start = piece.start
    return kept


def _lengthen(pieces: list[_Piece], min_frames: int) -> list[_Piece]:
    """Join clips that are too short with a neighbour, or let them grow; all rests are long enough already."""
    done: list[_Piece] = []
    waiting = pieces[::-1]
    while waiting:
        piece = waiting.pop()
        left = done[-1] if done else None
        right = waiting[-1] if waiting else None
        if piece.rest or piece.length >= min_frames or (left is None and right is None):
            done.append(piece)
            continue
        clip_left = left is not None and not left.rest
        clip_right = right is not None and not right.rest
        if clip_left or clip_right:
            nearer = right is not None and clip_right and right.gap < piece.gap - _FRAME_SLACK
            to_left = clip_left and not nearer
        elif _grow(piece, left, right, min_frames):
            done.append(piece)
            continue
        else:
            to_left = left is not None and (right is None or left.length <= right.length)
        if left is not None and to_left:
            left.end, left.rest = piece.end, False
        elif right is not None:
            # The joined clip waits, since two short clips may still be too short.
            right.start, right.rest, right.gap = piece.start, False, piece.gap
    return done


def _grow(piece: _Piece, left: _Piece | None, right: _Piece | None, min_frames: int) -> bool:
    """Extend a piece to `min_frames` by what its rests can spare; False, and no change, if that is too little."""
    missing = min_frames - piece.length
    spare_left = left.length - min_frames if left is not None else 0
    spare_right = right.length - min_frames if right is not None else 0
    if spare_left + spare_right < missing:
        return False
    from_right = min(spare_right, missing // 2)
    from_left = min(spare_left, missing - from_right)
    from_right = missing - from_left
    if left is not None:
        piece.start -= from_left
        left.end = piece.start
    if right is not None:
        piece.end += from_right
        right.start = piece.end
    return True


def _shorten(
    pieces: list[_Piece], gaps: _Gaps, speeds: np.ndarray | None, min_frames: int, max_frames: int
) -> list[Cut]:
    """Cut clips that are too long, at gaps, else at slow frames, else into equal parts."""
    between_words = np.flatnonzero(gaps.widths > _FRAME_SLACK)
    between_words = between_words[(between_words > 0) & (between_words < len(gaps.widths) - 1)]
    widths, middles = gaps.widths[between_words], gaps.middles[between_words]
    cuts: list[Cut] = []
    for piece in pieces:
        waiting = [(piece.start, piece.end)]
        while waiting:
            start, end = waiting.pop()
            if end - start <= max_frames:
                cuts.append(Cut(start, end, piece.rest))
                continue
            # Cuts before this first and this last frame leave parts that are long enough.
            first, last = start + min_frames, end - min_frames
            inside = slice(*np.searchsorted(middles, [first, last + 1]))
            if not piece.rest and inside.start < inside.stop:
                marks = [_best(middles[inside], -widths[inside], _FRAME_SLACK, start + end)]
            elif speeds is not None:
                marks = [_best(np.arange(first, last + 1), speeds[first : last + 1], 0.0, start + end)]
            else:
                n_parts = math.ceil((end - start) / max_frames)
                marks = [start + (end - start) * k // n_parts for k in range(1, n_parts)]
            bounds = [start, *marks, end]
            waiting += list(itertools.pairwise(bounds))[::-1]
    return cuts


def _best(frames: np.ndarray, costs: np.ndarray, slack: float, twice_middle: int) -> int:
    """Find the frame of the lowest cost; of equals the one nearest to the middle, then the first."""
    lowest = frames[costs <= costs.min() + slack]
    return int(lowest[np.argmin(np.abs(2 * lowest - twice_middle))])


def spoken(
    words: Sequence[Word], onset_times: np.ndarray, voice: np.ndarray | None = None
) -> list[tuple[float, float]]:
    """Return the times of words; without any, onsets and voice activity stand in, since a transcript is optional.

    voice : seconds `[shape=(S, 2)]` in which somebody is heard to speak; each onset within starts a word
    """
    if words:
        return [(word.start, word.end) for word in words]
    onsets = np.asarray(onset_times, dtype=np.float64)
    found: list[tuple[float, float]] = []
    left = np.ones(len(onsets), dtype=bool)
    for start, end in [] if voice is None else voice.tolist():
        inside = (onsets >= start) & (onsets < end)
        left &= ~inside
        found += itertools.pairwise([*np.unique([start, *onsets[inside]]).tolist(), end])
    return sorted([*found, *((time, time) for time in onsets[left].tolist())])

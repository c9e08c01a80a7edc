"""k-NN motion matching (Habibie et al. 2022, §3.1.2 and §3.1.3): the choice of the next piece of motion.

At every step each sequence of the database offers the node nearest to the pose shown last; what these offer is
ranked by pose and by sound, and the lowest sum of ranks is shown. All test clips take a step together: the
distances are one matrix product in float32, whose error is bounded and added as slack, and what may be nearest is
confirmed in float64. The choices are therefore exactly the definition's, whatever the block size, the number of
clips, of threads or the machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from gesturegen.methods.motion_matching import _kernels as _nearest_kernels
from gesturegen.methods.motion_matching.settings import MotionMatching
from gesturegen.motion.skeleton import read_only

# Pairs of a test clip and a node compared at once, 4 bytes each; the nodes' features are to stay in the cache.
BLOCK_PAIRS = 1_000_000
# Nodes at once where there are few clips.
_BLOCK_NODES = 65536
# Squares of larger values would leave the range of float32.
_LARGEST = 1e15
_SINGLE = float(np.finfo(np.float32).eps) / 2
_DOUBLE = float(np.finfo(np.float64).eps) / 2
_TINY = float(np.finfo(np.float32).tiny)


@dataclass(frozen=True, eq=False)
class Candidates:
    """The nodes of the database: N frames in order, in M sequences. The arrays may be read-only and mapped.

    pose : float32 [shape=(N, P)], audio : float32 [shape=(N, A)], z-scores of the features of each node
    starts, stops : int [shape=(M,)], first nodes of the sequences and nodes after their last, in order
    valid : bool [shape=(N,)], nodes followed by as many nodes of the same segment as a step shows
    """

    pose: np.ndarray
    audio: np.ndarray
    starts: np.ndarray
    stops: np.ndarray
    valid: np.ndarray

    def __post_init__(self) -> None:
        types = {"starts": np.int64, "stops": np.int64, "valid": np.bool_}
        for field in fields(self):
            array = np.require(getattr(self, field.name), types.get(field.name, np.float32), "C")
            object.__setattr__(self, field.name, read_only(np.asarray(array)))
        n_nodes, starts, stops = len(self.valid), self.starts, self.stops
        if self.pose.ndim != 2 or self.audio.ndim != 2 or self.valid.shape != (n_nodes,):
            raise ValueError("features are (N, P) and (N, A), valid is (N,)")
        if not len(self.pose) == len(self.audio) == n_nodes:
            raise ValueError(f"{len(self.pose)} poses, {len(self.audio)} sounds and {n_nodes} nodes")
        if starts.ndim != 1 or starts.shape != stops.shape:
            raise ValueError(f"starts {starts.shape} and stops {stops.shape} do not fit together")
        bounds = np.stack([starts, stops], axis=1).ravel()
        if (stops <= starts).any() or (np.diff(bounds) < 0).any() or (bounds < 0).any() or (bounds > n_nodes).any():
            raise ValueError("sequences must be stretches of nodes, one after the other")
        _check_scores(self.pose)
        _check_scores(self.audio)

    @cached_property
    def pose_squares(self) -> np.ndarray:
        """Compute the squared lengths of the pose features, float64 `[shape=(N,)]`."""
        return _nearest_kernels.squares(self.pose)


@dataclass(frozen=True, eq=False)
class Found:
    """The motion found for one test clip, in K steps, and the reasons for its choice.

    nodes : int [shape=(K * step,)], shown one after the other
    matched : int [shape=(K,)], the node j of each step that was matched to the last pose; j + 1 is shown first
    sequences : int [shape=(K,)], the sequences of these
    pose_ranks, audio_ranks : int [shape=(K,)], from 0; pose_distances, audio_distances : float [shape=(K,)]
    failed : the step for which no node was left, which ends the path before it; None where there was none
    """

    nodes: np.ndarray
    matched: np.ndarray
    sequences: np.ndarray
    pose_ranks: np.ndarray
    audio_ranks: np.ndarray
    pose_distances: np.ndarray
    audio_distances: np.ndarray
    failed: int | None


def search(
    candidates: Candidates,
    audio: Sequence[np.ndarray],
    first_poses: np.ndarray,
    step: int,
    settings: MotionMatching,
    allowed: Sequence[Sequence[np.ndarray | None] | np.ndarray | None] | None = None,
    prices: Sequence[Sequence[np.ndarray | None] | np.ndarray | None] | None = None,
    block_pairs: int = BLOCK_PAIRS,
) -> list[Found]:
    """Find the motion for each of B test clips, of K_b steps of `step` nodes.

    audio : per clip `[shape=(K_b, A)]`, z-scores of the features of its sound at the times of the steps
    first_poses : `[shape=(B, P)]`, the pose features before the first step
    allowed : per clip None or, per step, None or bool `[shape=(N,)]`; looked up at both ends of what is shown
    prices : per clip None or, per step, None or float `[shape=(N,)]`, likewise

    At each step, with the pose feature q of the node shown last and the feature f of the test sound:

    1. Every sequence offers one node j, valid and with j + 1 and j + step allowed: the one whose pose is nearest to
       q or, by `preselect: audio`, the one with the least cosine distance of the sound at j + 1 to f. Of equally
       near ones it is the lowest, and a sequence without any offers none.
    2. The C nodes offered are ranked from 0 by pose distance and by cosine distance, equals by their sequence.
    3. The cost of each is pose rank + audio rank + (price[j + 1] + price[j + step]) * C: a price of 1 at one end
       weighs as much as all of one ranking. Without `use_audio` the audio rank is left out.
    4. Shown are j + 1 to j + step of the cheapest or, by `k`, of the k-th cheapest, of the last where there are
       fewer; equals go by pose rank.
    """
    clips = [_checked(feature, (len(feature), candidates.audio.shape[1])) for feature in audio]
    poses = _checked(first_poses, (len(clips), candidates.pose.shape[1])).copy()
    for given in (allowed, prices):
        if given is not None and len(given) != len(clips):
            raise ValueError(f"masks or prices of {len(given)} clips for {len(clips)}")
    if step < 1 or candidates.valid[-step:].any():
        raise ValueError("a node is valid only where so many nodes follow as a step shows")
    by_angle = settings.preselect == "audio"
    offers = (_ByAngle if by_angle else _ByDistance)(candidates)
    rows: list[list[tuple]] = [[] for _ in clips]
    failed: list[int | None] = [None] * len(clips)
    for number in range(max(map(len, clips), default=0)):
        going = [b for b, clip in enumerate(clips) if number < len(clip) and failed[b] is None]
        if not going:
            break
        sounds = np.stack([clips[b][number] for b in going])
        masks = [_of_step(allowed, b, number, candidates, bool) for b in going]
        nodes, apart = offers.of(sounds if by_angle else poses[going], masks, step, block_pairs)
        for row, b in enumerate(going):
            sequences = np.flatnonzero(nodes[row] >= 0)
            if len(sequences) == 0:
                failed[b] = number
                continue
            offered = nodes[row, sequences]
            if by_angle:
                sound = apart[row, sequences]
                pose = _distances(candidates.pose, offered, poses[b], False)
            else:
                pose = apart[row, sequences]
                sound = _distances(candidates.audio, offered + 1, sounds[row], True)
            pose_ranks, audio_ranks = _ranks(pose), _ranks(sound)
            costs = pose_ranks + audio_ranks if settings.use_audio else pose_ranks
            price = _of_step(prices, b, number, candidates, float)
            if price is not None:
                costs = costs + (price[offered + 1] + price[offered + step]) * len(offered)
                if not np.isfinite(costs).all():
                    raise ValueError("prices must be finite")
            best = _kth(costs, pose_ranks, settings.k)
            rows[b].append(
                (offered[best], sequences[best], pose_ranks[best], audio_ranks[best], pose[best], sound[best])
            )
            poses[b] = candidates.pose[offered[best] + step]
    return [_found(steps, failure, step) for steps, failure in zip(rows, failed, strict=True)]


class _Offers:
    """Search of the nearest node of every sequence to each query.

    features : float32 [shape=(N, D)]; those of node j are in the row j + shift
    """

    by_angle: bool
    shift: int

    def __init__(self, candidates: Candidates, features: np.ndarray):
        self.candidates = candidates
        self.features = features
        # Added to a score, it leaves that of a valid node as it is.
        self.bars = np.where(candidates.valid, np.float32(0.0), np.float32(-np.inf))

    def of(
        self, queries: np.ndarray, masks: list[np.ndarray | None], step: int, block_pairs: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find nodes, -1 for none, and distances float64, of B queries `[shape=(B, D)]`, both `[shape=(B, M)]`."""
        starts, stops = self.candidates.starts, self.candidates.stops
        nodes = np.full((len(queries), len(starts)), -1, dtype=np.int64)
        apart = np.full(nodes.shape, np.inf)
        if nodes.size == 0:
            return nodes, apart
        of_queries, exact = _nearest_kernels.squares(queries), queries.astype(np.float64)
        directions, slacks = self._prepared(queries, of_queries)
        n_nodes = len(self.features) - self.shift  # the last one has none after it and is never valid
        size = min(max(block_pairs // len(queries), 1), _BLOCK_NODES)
        for low in range(0, n_nodes, size):
            block = slice(low, min(low + size, n_nodes))
            scores = directions @ self.features[block.start + self.shift : block.stop + self.shift].T
            self._finish(scores, block)
            for score, mask in zip(scores, masks, strict=True):
                if mask is not None:
                    _close(score, mask, low, step)
            first, last = np.searchsorted(stops, low, "right"), np.searchsorted(starts, block.stop, "left")
            _nearest_kernels.confirm(
                scores, low, first, last, starts, stops, slacks, self.features, self.shift, exact, of_queries,
                self.by_angle, nodes, apart,
            )  # fmt: skip
        return nodes, apart

    def _prepared(self, queries: np.ndarray, of_queries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute the factors of the features `[shape=(B, D)]`, and the slack of scores `[shape=(B, M)]`.

        of_queries : `[shape=(B,)]`, squared lengths of the queries
        """
        raise NotImplementedError

    def _finish(self, scores: np.ndarray, block: slice) -> None:
        """Convert products to scores, in place, -inf for nodes that are not valid."""
        raise NotImplementedError


class _ByDistance(_Offers):
    """Offers by Euclidean distance of the pose: a . q - |a|^2 / 2 is the higher the nearer a is to q."""

    by_angle = False
    shift = 0

    def __init__(self, candidates: Candidates):
        super().__init__(candidates, candidates.pose)
        squares = candidates.pose_squares
        self.bars -= (0.5 * squares).astype(np.float32)
        largest = _nearest_kernels.largest(squares, candidates.starts, candidates.stops, candidates.valid)
        self.lengths = np.sqrt(largest)

    def _prepared(self, queries: np.ndarray, of_queries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # Of a score: rounding a dot product of D terms in any order, the half square and their sum, each relative to
        # the lengths in the sequence, and terms below float32's range. Of two, doubled. The float64 distances that
        # decide are rounded too, relative to themselves.
        terms = queries.shape[1] + 8
        lengths, query = self.lengths, np.sqrt(of_queries)[:, None]
        slacks = 4.0 * terms * (_SINGLE * lengths * (query + lengths) + _TINY)
        slacks += 8.0 * terms * _DOUBLE * np.square(query + lengths)
        return queries, slacks

    def _finish(self, scores: np.ndarray, block: slice) -> None:
        scores += self.bars[block]


class _ByAngle(_Offers):
    """Offers by cosine distance of the sound one node later: a . f / |a| is the higher the nearer a is to f."""

    by_angle = True
    shift = 1

    def __init__(self, candidates: Candidates):
        super().__init__(candidates, candidates.audio)
        self.factors = _inverse_lengths(_nearest_kernels.squares(candidates.audio)).astype(np.float32)

    def _prepared(self, queries: np.ndarray, of_queries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        directions = (queries * _inverse_lengths(of_queries)[:, None]).astype(np.float32)
        # Rounding the direction, a dot product of D terms in any order, the factor and their product, relative to
        # lengths of 1; doubled for two scores, and once more for float64 and terms below float32's range.
        slack = 4.0 * (queries.shape[1] + 8) * _SINGLE
        return directions, np.full((len(queries), len(self.candidates.starts)), slack)

    def _finish(self, scores: np.ndarray, block: slice) -> None:
        scores *= self.factors[block.start + 1 : block.stop + 1]
        scores += self.bars[block]


def _inverse_lengths(squares: np.ndarray) -> np.ndarray:
    """Compute 1 / length of vectors from their squared lengths, 0 for a zero vector."""
    return np.divide(1.0, np.sqrt(squares), out=np.zeros(len(squares)), where=squares >= _nearest_kernels.SMALLEST)


def _close(scores: np.ndarray, mask: np.ndarray, low: int, step: int) -> None:
    """Set scores of the nodes from `low` on that may not be shown to -inf; nodes without a window have it already."""
    last = mask[low + step : low + step + len(scores)]
    scores = scores[: len(last)]
    scores[~(mask[low + 1 : low + 1 + len(last)] & last)] = -np.inf


def _distances(features: np.ndarray, rows: np.ndarray, query: np.ndarray, by_angle: bool) -> np.ndarray:
    of_query = _nearest_kernels.squares(query[None])[0]
    return _nearest_kernels.distances(features, rows, query.astype(np.float64), of_query, by_angle)


def _ranks(distances: np.ndarray) -> np.ndarray:
    """Rank the distances in ascending order, from 0; equals in their order."""
    ranks = np.empty(len(distances), dtype=np.int64)
    ranks[np.argsort(distances, kind="stable")] = np.arange(len(distances))
    return ranks


def _kth(costs: np.ndarray, pose_ranks: np.ndarray, k: int) -> int:
    """Find the k-th by (cost, pose rank) from 1, the last one where there are fewer."""
    place = min(k, len(costs)) - 1
    near = np.flatnonzero(costs <= np.partition(costs, place)[place])
    return near[np.lexsort((pose_ranks[near], costs[near]))[place]]


def _of_step(
    given: Sequence[Sequence[np.ndarray | None] | np.ndarray | None] | None, clip: int, step: int,
    candidates: Candidates, kind: type,
) -> np.ndarray | None:  # fmt: skip
    """Return the mask or the prices of one step of a clip, `[shape=(N,)]`; None for none."""
    of_clip = None if given is None else given[clip]
    values = None if of_clip is None else of_clip[step]
    if values is None:
        return None
    values = np.asarray(values)
    if values.shape != candidates.valid.shape or (kind is bool and values.dtype != bool):
        raise ValueError(f"step {step} of clip {clip}: {values.dtype} {values.shape} for {len(candidates.valid)} nodes")
    return values if kind is bool else values.astype(np.float64, copy=False)


def _found(steps: list[tuple], failed: int | None, step: int) -> Found:
    matched, sequences, pose_ranks, audio_ranks = (
        np.array([row[column] for row in steps], dtype=np.int64) for column in range(4)
    )
    pose_distances, audio_distances = (np.array([row[column] for row in steps], dtype=float) for column in (4, 5))
    nodes = (matched[:, None] + np.arange(1, step + 1)).ravel()
    return Found(nodes, matched, sequences, pose_ranks, audio_ranks, pose_distances, audio_distances, failed)


def _checked(features: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    features = np.require(features, np.float32, "C")
    if features.shape != shape:
        raise ValueError(f"features have shape {features.shape}, expected {shape}")
    _check_scores(features)
    return features


def _check_scores(features: np.ndarray) -> None:
    # Of NaN neither comparison holds.
    if features.size and not (features.min() >= -_LARGEST and features.max() <= _LARGEST):
        raise ValueError(f"features must be z-scores: finite, and none beyond {_LARGEST:g}")

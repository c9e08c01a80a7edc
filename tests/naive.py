"""The graph, the search and the cross-fade restated in the obvious way, to compare the fast code with.

Explicit lists, sets and loops; every sum runs left to right, as in the compiled loops. The benchmark
takes its reference times from here.
"""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np

# --- graph (§4.1.2) -----------------------------------------------------------------------------------------


def segments(segment_starts, n_frames: int) -> list[tuple[int, int]]:
    """First and last frame of the segment of every frame."""
    bounds = [*map(int, segment_starts), n_frames]
    return [(a, b - 1) for a, b in itertools.pairwise(bounds) for _ in range(a, b)]


def poses_and_velocities(positions, segment_starts):
    poses = np.asarray(positions).astype(np.float64).reshape(len(positions), -1)
    velocities = np.zeros_like(poses)
    for frame, (start, end) in enumerate(segments(segment_starts, len(poses))):
        if frame > start:
            velocities[frame] = poses[frame] - poses[frame - 1]
        elif end > start:
            velocities[frame] = poses[frame + 1] - poses[frame]
    return poses, velocities


def distances_from(left: int, poses, velocities, settings, rights=slice(None)) -> np.ndarray:
    """d(left, r) for the frames r of `rights`, every frame by default."""
    # A cumulative sum adds from left to right; np.sum and np.linalg.norm do not.
    apart = np.cumsum((poses[left] - poses[rights]) ** 2, axis=1)[:, -1]
    turned = np.cumsum((velocities[left] - velocities[rights]) ** 2, axis=1)[:, -1]
    return settings.lambda_pos * np.sqrt(apart) + settings.lambda_vel * np.sqrt(turned)


def thresholds(positions, segment_starts, settings) -> list[float]:
    poses, velocities = poses_and_velocities(positions, segment_starts)
    limits = []
    for left, (_, end) in enumerate(segments(segment_starts, len(poses))):
        last = min(left + settings.l_cn, end)
        total = 0.0
        for distance in distances_from(left, poses, velocities, settings, slice(left + 1, last + 1)).tolist():
            total += distance
        limits.append(total / (last - left) if last > left else math.nan)
    return limits


def candidates(positions, segment_starts, settings) -> list[tuple[int, int, float]]:
    """All (left, right, distance) with the distance below the left's threshold, in order."""
    poses, velocities = poses_and_velocities(positions, segment_starts)
    limits = thresholds(positions, segment_starts, settings)
    found = []
    for left, (_, end) in enumerate(segments(segment_starts, len(poses))):
        if left == end:
            continue
        distances = distances_from(left, poses, velocities, settings)
        for right in np.flatnonzero(distances < limits[left]).tolist():
            if right not in (left, left + 1):
                found.append((left, right, float(distances[right])))
    return found


def thin_runs(rows, segment_starts, n_frames: int, l_pn: int):
    """Pruning 1: of each run of consecutive rights, the first of every block of `l_pn`."""
    segment = segments(segment_starts, n_frames)
    kept, run = [], []
    for row in rows:
        left, right, _ = row
        if run and run[-1][0] == left and run[-1][1] + 1 == right and segment[run[-1][1]] == segment[right]:
            run.append(row)
        else:
            run = [row]
        if (len(run) - 1) % l_pn == 0:
            kept.append(row)
    return kept


def build(positions, segment_starts, settings) -> dict[tuple[int, int], float]:
    """All edges, natural ones too, and their weights."""
    n_frames = len(positions)
    segment = segments(segment_starts, n_frames)
    edges = {(frame, frame + 1): 0.0 for frame in range(n_frames) if frame < segment[frame][1]}
    rows = thin_runs(candidates(positions, segment_starts, settings), segment_starts, n_frames, settings.l_pn)
    for left in sorted({row[0] for row in rows}):
        mine = [row for row in rows if row[0] == left]
        new = [row for row in mine if not _near_an_edge(left, row[1], edges, segment, settings.l_pn)]
        edges |= {(left, right): weight for _, right, weight in new}
    return edges


def _near_an_edge(left: int, right: int, edges, segment, l_pn: int) -> bool:
    """Pruning 2: whether an edge leads from near one of the frames to near the other."""

    def around(frame):
        start, end = segment[frame]
        return range(max(start, frame - l_pn), min(end, frame + l_pn) + 1)

    return any((a, b) in edges or (b, a) in edges for a in around(left) for b in around(right))


def edges_of(graph) -> dict[tuple[int, int], float]:
    """The edges of a `MotionGraph` as a dictionary."""
    return {
        (node, int(graph.indices[e])): float(graph.weights[e])
        for node in range(graph.n_nodes)
        for e in range(graph.indptr[node], graph.indptr[node + 1])
    }


# --- features (§4.2.3) --------------------------------------------------------------------------------------


def feature(frame: int, boundaries, start: int, end: int, settings) -> list[int]:
    """Lengths of the natural pieces after `frame` in the segment from `start` to the boundary `end`."""
    marks = [frame, *sorted({b for b in boundaries if frame < b < end} | ({end} if frame < end else set()))]
    if settings.align == "as_printed":
        marks.insert(0, max([b for b in boundaries if start <= b < frame], default=start))
    lengths = [after - before for before, after in itertools.pairwise(marks)]
    return (lengths + [0] * settings.l_feat)[: settings.l_feat]


def feature_distance(test, other, occurrences: int, settings) -> float:
    gap = np.array(settings.w_full) * (np.array(test, dtype=float) - np.array(other, dtype=float))
    full = float(np.linalg.norm(gap[None], axis=1)[0])
    first = abs(1.0 - other[0] / (test[0] if test[0] else 1.0))
    return settings.lambda_full * full + settings.lambda_first * first + settings.lambda_occ * occurrences


# --- beam search (§4.2.1) -----------------------------------------------------------------------------------


def children_of(graph) -> list[list[tuple[int, float]]]:
    children: list[list[tuple[int, float]]] = [[] for _ in range(graph.n_nodes)]
    for (left, right), weight in edges_of(graph).items():
        children[left].append((right, weight))
    return children


def is_terminated(nodes, stops, target: int) -> bool:
    return bool(stops[nodes[-1]]) and len(nodes) >= (1 if target == 1 else 2)


def is_accepted(nodes, stops, target: int, settings) -> bool:
    low, high = (Fraction(str(ratio)) * target for ratio in (settings.min_ratio, settings.max_ratio))
    return is_terminated(nodes, stops, target) and low <= len(nodes) <= high


def cost_of(total: float, length: int, target: int, settings) -> float:
    return settings.lambda_w * total + settings.lambda_len * abs(1.0 - length / target)


def beam(children, stops, starts, target: int, settings, natural_start: int = -1):
    """The cheapest accepted path and its cost, (None, inf) without one. A path is (nodes, sum of weights)."""

    def rank(path):
        nodes, total = path
        return cost_of(total, len(nodes), target, settings), nodes[0] != natural_start, nodes

    longest = math.floor(Fraction(str(settings.max_ratio)) * target)
    paths = sorted([((int(start),), 0.0) for start in starts], key=rank)[: settings.l_npaths]
    for _ in range(longest - 1):
        if not paths or all(is_accepted(nodes, stops, target, settings) for nodes, _ in paths):
            break
        watched = []
        for nodes, total in paths:
            if is_terminated(nodes, stops, target):
                watched.append((nodes, total))
            else:
                watched += [((*nodes, child), total + weight) for child, weight in children[nodes[-1]]]
        paths = sorted(watched, key=rank)[: settings.l_npaths]
    accepted = [path for path in paths if is_accepted(path[0], stops, target, settings)]
    if not accepted:
        return None, math.inf
    best = min(accepted, key=rank)
    return best[0], rank(best)[0]


def all_accepted(children, stops, starts, target: int, settings):
    """Every accepted path from `starts`, by exhaustive enumeration: (nodes, sum of weights)."""
    longest = math.floor(Fraction(str(settings.max_ratio)) * target)
    found = []

    def walk(nodes, total):
        if is_accepted(nodes, stops, target, settings):
            found.append((nodes, total))
        if not is_terminated(nodes, stops, target) and len(nodes) < longest:
            for child, weight in children[nodes[-1]]:
                walk((*nodes, child), total + weight)

    for start in starts:
        walk((int(start),), 0.0)
    return found


# --- the whole search (§4.2, appendix A) --------------------------------------------------------------------


def pieces_of(key_rows, n_frames: int) -> list[tuple[int, int, str]]:
    """(start, end, keyword) of the test speech cut at its key nodes `(frame, kind, keyword)` and its end."""
    pieces, start = [], 0
    for frame, kind, keyword in key_rows:
        if frame > 0:
            pieces.append((start, frame, keyword if kind == "keyword" else ""))
            start = frame
    return [*pieces, (start, n_frames, "")]


def stop_nodes(graph, keyword: str) -> list[bool]:
    rows = list(zip(graph.key_nodes.frames.tolist(), graph.key_nodes.kinds, graph.key_nodes.keywords, strict=True))
    if keyword:
        wanted = {frame for frame, kind, word in rows if kind == "keyword" and word == keyword}
    else:
        wanted = {frame for frame, kind, _ in rows if kind == "onset"}
        wanted |= {end for _, end in segments(graph.segment_starts, graph.n_nodes)}
    return [node in wanted for node in range(graph.n_nodes)]


def search(graph, key_rows, n_frames: int, config, rng) -> tuple[list[tuple], bool]:
    """Pieces (start, end, nodes, cost, retries, fallback) of a test speech, and whether it failed."""
    children, segment = children_of(graph), segments(graph.segment_starts, graph.n_nodes)
    key_frames = graph.key_nodes.frames.tolist()
    features = [feature(frame, key_frames, *segment[frame], config.features) for frame in key_frames]
    test_frames = [row[0] for row in key_rows]
    occurrences = dict.fromkeys(key_frames, 0)
    done: list[tuple] = []
    for start, end, keyword in pieces_of(key_rows, n_frames):
        test = feature(start, test_frames, 0, n_frames, config.features)
        cost_by_frame = {
            frame: feature_distance(test, other, occurrences[frame], config.features)
            for frame, other in zip(key_frames, features, strict=True)
        }
        ranking = sorted(key_frames, key=lambda frame: (cost_by_frame[frame], frame))
        last = done[-1][2][-1] if done else None
        found = _search_piece(graph, children, segment, ranking, last, end - start, keyword, config, rng)
        if found is None:
            return done, True
        nodes, _, _, fallback = found
        if fallback != "repeat":
            for node in set(nodes) & set(key_frames):
                occurrences[node] += 1
        done.append((start, end, *found))
    return done, False


def _search_piece(graph, children, segment, ranking, last, target: int, keyword: str, config, rng):
    rules, beam_settings = config.termination, config.beam
    stops = stop_nodes(graph, keyword)
    ranks = list(ranking) if config.initialization == "feature" else []
    fallback = None
    attempts = rules.max_retries if rules.fallbacks else rules.failure_retries
    for retry in range(attempts + 1):
        if rules.fallbacks and keyword and retry == rules.keyword_retries + 1:
            stops, fallback = stop_nodes(graph, ""), "keyword"
        if rules.fallbacks and retry > rules.discard_after_retries:
            left = [node for node in range(graph.n_nodes) if stops[node]]
            drop = min(max(1, len(left) // 10), len(left) - 1)
            if drop > 0:
                for node in rng.choice(np.array(left), size=drop, replace=False):
                    stops[node] = False
                fallback = "discard"
        if retry == 0 and last is not None and children[last]:
            natural = last + 1 if last < segment[last][1] else last
            starts = [child for child, _ in children[last]]
        else:
            natural, count = -1, beam_settings.l_npaths
            if len(ranks) >= count:
                starts, ranks = ranks[:count], ranks[count:]
            else:
                ranks = []
                starts = rng.choice(graph.n_nodes, size=min(count, graph.n_nodes), replace=False).tolist()
        nodes, cost = beam(children, stops, starts, target, beam_settings, natural)
        if nodes is not None:
            return nodes, cost, retry, fallback
    if not rules.fallbacks:
        return None
    held = ranking[0] if last is None else last
    return (held,) * target, 0.0, attempts, "repeat"


# --- cross-fade (§4.2.4, corrected) -------------------------------------------------------------------------


def slerp(a, b, weight: float) -> np.ndarray:
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    cosine = sum(x * y for x, y in zip(a.tolist(), b.tolist(), strict=True))
    if cosine < 0:
        b, cosine = -b, -cosine
    angle = math.acos(min(cosine, 1.0))
    if angle < 1e-6:
        mixed = (1 - weight) * a + weight * b
    else:
        mixed = (math.sin((1 - weight) * angle) * a + math.sin(weight * angle) * b) / math.sin(angle)
    return mixed / math.sqrt(sum(x * x for x in mixed.tolist()))


def crossfade(rotations, positions, seams, l_blend: int):
    """Linear cross-fade of the seams (first frames of right sides) in order; returns new arrays."""
    rotations, positions = np.array(rotations), np.array(positions)
    for number, seam in enumerate(seams):
        right_end = seams[number + 1] if number + 1 < len(seams) else len(rotations)
        left_frames = list(range(max(0, seam - l_blend), seam))
        right_frames = list(range(seam, min(right_end, seam + l_blend)))
        # The left path held at its last frame, the right path held at its first.
        left_path = left_frames + [seam - 1] * len(right_frames)
        right_path = [seam] * len(left_frames) + right_frames
        before, count = (rotations.copy(), positions.copy()), len(left_path)
        for i, frame in enumerate(left_frames + right_frames):
            weight = (i + 1) / (count + 1)
            left, right = left_path[i], right_path[i]
            positions[frame] = (1 - weight) * before[1][left] + weight * before[1][right]
            for joint in range(rotations.shape[1]):
                rotations[frame, joint] = slerp(before[0][left, joint], before[0][right, joint], weight)
    return rotations, positions


# --- pauses and the global search ---------------------------------------------------------------------------


def pauses(heard, n_frames: int, limit: float) -> str:
    """`S` for each frame, `.` for those in a run of over `limit` frames that are not in `heard`."""
    states = ""
    for frame in range(n_frames):
        run = [frame] if frame not in heard else []
        while run and run[0] - 1 not in heard and run[0] > 0:
            run.insert(0, run[0] - 1)
        while run and run[-1] + 1 not in heard and run[-1] < n_frames - 1:
            run.append(run[-1] + 1)
        states += "." if len(run) > limit + 1e-6 else "S"
    return states


class Objective:
    """What the paths of a graph through consecutive targets of a test speech cost (see `search/objective.py`).

    A path is a list of nodes for every target. Prices come as (term, cost) rows, nothing is looked up but the
    graph's positions, segments, edges, key nodes and states.

    control : the price of a frame that shows a node, and that of one that holds it, as functions of (frame, node)
    """

    def __init__(self, graph, targets, speaking, config, control=None):
        self.control = control
        self.settings, self.targets, self.speaking = config.global_search, targets, speaking
        self.n_nodes = graph.n_nodes
        self.resting = {node for node in range(graph.n_nodes) if not graph.speaking[node]}
        self.last = [end for _, end in segments(graph.segment_starts, graph.n_nodes)]
        # Natural edges cost nothing whatever the graph says, and are there in any case.
        self.edges = {pair: weight for pair, weight in edges_of(graph).items() if pair[1] != self.onwards(pair[0])}
        self.children = [[] for _ in range(graph.n_nodes)]
        for left, right in sorted(self.edges):
            self.children[left].append(right)
        for node in range(graph.n_nodes):
            self.children[node] += [node] if self.onwards(node) == node else [node, node + 1]
        key = graph.key_nodes
        self.rows = set(zip(key.frames.tolist(), key.kinds.tolist(), key.keywords.tolist(), strict=True))
        self.key_nodes = set(self.last) | {node for node, _, _ in self.rows}
        poses, velocities = poses_and_velocities(graph.positions, graph.segment_starts)
        self.distances = [
            distances_from(node, poses, velocities, config.continuity).tolist() for node in range(graph.n_nodes)
        ]

    def onwards(self, node: int) -> int:
        return node + 1 if node < self.last[node] else node

    def counts(self, target) -> range:
        """How many nodes a piece may have."""
        ratios = self.settings.min_ratio, self.settings.max_ratio
        low, high = (Fraction(str(ratio)) * target.length for ratio in ratios)
        slack = self.settings.slack_frames
        shortest = max(1, min(math.ceil(low), target.length - slack))
        return range(shortest, max(math.floor(high), target.length + slack) + 1)

    def speaks(self, target, k: int) -> bool:
        return bool(self.speaking[self.frame(target, k)])

    def held(self, node: int, frame: int) -> list[tuple[str, float]]:
        resting = node in self.resting and not self.speaking[frame]
        rows = [("held", self.settings.lambda_rest if resting else self.settings.lambda_hold)]
        if self.control is not None:
            shown, held = (price(frame, node) for price in self.control)
            rows.append(("control", max(held - shown, 0.0)))
        return rows

    def frame(self, target, k: int) -> int:
        return target.start_frame + min(k, target.length - 1)

    def shown(self, target, k: int, node: int):
        rows = [("state", self.settings.lambda_state)] if self.speaks(target, k) == (node in self.resting) else []
        return rows if self.control is None else [*rows, ("control", self.control[0](self.frame(target, k), node))]

    def step(self, target, k: int, node: int, other: int):
        """From the k-th node of a piece to the next."""
        if other == node:
            return self.held(node, self.frame(target, k + 1))
        rows = []
        if other != self.onwards(node):
            rows.append(("edges", self.settings.lambda_w * self.edges[node, other]))
        if node in self.key_nodes and self.speaks(target, k):
            rows.append(("passed", self.settings.lambda_pass))
        return rows

    def end(self, target, count: int, node: int):
        """Of a piece of `count` nodes that ends at `node`."""
        rows = [("length", self.settings.lambda_len * abs(1.0 - count / target.length))]
        if target.end_kind == "cut":
            return rows
        meets = target.keyword != "" and (node, "keyword", target.keyword) in self.rows
        if not meets and node != self.last[node] and (node, "onset", "") not in self.rows:
            rows.append(("end", self.settings.lambda_end))
        if target.keyword and not meets:
            rows.append(("keyword", self.settings.lambda_keyword))
        return rows

    def join(self, node: int, other: int, frame: int):
        """From the last node of a piece to the first of the next, which begins at `frame`."""
        rows = [("joins", self.settings.lambda_join * self.distances[self.onwards(node)][other])]
        return rows + (self.held(node, frame) if other == node == self.last[node] else [])

    def cost(self, path, used=None, entering=None, before: int = -1, after: int = -1) -> dict[str, float]:
        """A complete path's cost by term, and `total`, their sum.

        used : a price of every frame that shows a node; entering : of coming to it, once in a piece that holds it
        before, after : nodes shown before and after the targets, of which the joins count; -1 for none
        """
        rows = []
        shown = [before]
        for target, nodes in zip(self.targets, path, strict=True):
            if shown[-1] >= 0:
                rows += self.join(shown[-1], nodes[0], target.start_frame)
            for k, node in enumerate(nodes):
                rows.append(("used", 0.0 if used is None else used[node]))
                rows.append(("entering", 0.0 if entering is None or (k and node == shown[-1]) else entering[node]))
                shown.append(node)
                rows += self.shown(target, k, node)
                if k + 1 < len(nodes):
                    rows += self.step(target, k, node, nodes[k + 1])
            rows += self.end(target, len(nodes), nodes[-1])
        if after >= 0:
            rows += self.join(shown[-1], after, self.targets[-1].end_frame)
        stays = [node for nodes in path for node, _ in itertools.groupby(nodes)]
        for one, other in itertools.combinations(stays, 2):
            rows += [("repeats", self.settings.lambda_repeat)] if one == other else []
        names = "edges", "length", "passed", "state", "held", "end", "keyword", "joins", "repeats", "used", "entering"
        names += ("control",) if self.control is not None else ()
        terms = {name: float(sum(price for term, price in rows if term == name)) for name in names}
        return terms | {"total": sum(terms.values())}

    def all_paths(self):
        """Every path there is."""

        def pieces(target, nodes):
            if len(nodes) in self.counts(target):
                yield nodes
            if len(nodes) < self.counts(target)[-1]:
                for child in self.children[nodes[-1]]:
                    yield from pieces(target, [*nodes, child])

        choices = [
            [nodes for start in range(self.n_nodes) for nodes in pieces(target, [start])] for target in self.targets
        ]
        return itertools.product(*choices)

    def cheapest(self, used=None, entering=None, before: int = -1, after: int = -1) -> float:
        """The least `cost` without repeats, frame by frame from the start: the cheapest way to every node."""

        def price(rows):
            return sum(cost for _, cost in rows)

        def coming(node, last=None):
            return 0.0 if entering is None or node == last else float(entering[node])

        def showing(node):
            return 0.0 if used is None else float(used[node])

        lasts = {before: 0.0}
        for target in self.targets:
            ways = {
                node: min(
                    cost + coming(node) + (price(self.join(last, node, target.start_frame)) if last >= 0 else 0.0)
                    for last, cost in lasts.items()
                )
                for node in range(self.n_nodes)
            }
            lasts = {}
            for k in range(self.counts(target)[-1]):
                ways = {node: cost + showing(node) + price(self.shown(target, k, node)) for node, cost in ways.items()}
                if k + 1 in self.counts(target):
                    for node, cost in ways.items():
                        lasts[node] = min(lasts.get(node, math.inf), cost + price(self.end(target, k + 1, node)))
                further = {}
                for node, cost in ways.items():
                    for child in self.children[node]:
                        way = cost + price(self.step(target, k, node, child)) + coming(child, node)
                        further[child] = min(further.get(child, math.inf), way)
                ways = further
        if after >= 0:
            frame = self.targets[-1].end_frame
            lasts = {node: cost + price(self.join(node, after, frame)) for node, cost in lasts.items()}
        return min(lasts.values())


# --- gesture clips (GestureMaster §4.1, §4.2) ----------------------------------------------------------------


def transition_costs(ends, starts, lambda_1: float, lambda_2: float) -> np.ndarray:
    """T(p, q) for all sources p (rows) and destinations q (columns)."""
    from gesturegen.motion import rotation

    costs = np.zeros((len(ends.positions), len(starts.positions)))
    for p, q in np.ndindex(costs.shape):
        apart = ends.positions[p].astype(np.float64) - starts.positions[q].astype(np.float64)
        distances = np.linalg.norm(apart, axis=-1)
        angles = rotation.angle_between(ends.rotations[p].astype(np.float64), starts.rotations[q].astype(np.float64))
        costs[p, q] = lambda_1 * distances.sum() + lambda_2 * angles.sum()
    return costs


def clip_step(p: int, q: int, before: float, edges, missing: float, reuse: float, twins, weight: float) -> float:
    """What was paid up to clip p, and to come from it to q; edges: costs by (p, q)."""
    return before + (reuse if q in (p, twins[p]) else 0.0) + weight * edges.get((p, q), missing)


def clips_cost(choice, data, edges, missing: float, reuse: float, twins, weight: float) -> float:
    total = data[0][choice[0]]
    for segment, (p, q) in enumerate(itertools.pairwise(choice), 1):
        total = clip_step(p, q, total, edges, missing, reuse, twins, weight) + data[segment][q]
    return total


def viterbi(data, edges, missing: float, reuse: float, twins, weight: float) -> tuple[list[int], float]:
    """The cheapest clips and their cost; of equally cheap predecessors and last clips the lowest."""
    clips = range(len(data[0]))
    ways = [(data[0][q], [q]) for q in clips]
    for row in data[1:]:
        further = []
        for q in clips:
            costs = [clip_step(p, q, ways[p][0], edges, missing, reuse, twins, weight) for p in clips]
            best = costs.index(min(costs))
            further.append((costs[best] + row[q], [*ways[best][1], q]))
        ways = further
    totals = [total for total, _ in ways]
    return ways[totals.index(min(totals))][1], min(totals)


# --- k-NN motion matching (Habibie et al. 2022, §3.1) ---------------------------------------------------------


def euclidean_distance(left, right) -> float:
    steps = np.asarray(left, dtype=np.float64) - np.asarray(right, dtype=np.float64)
    return math.sqrt(np.cumsum(steps * steps)[-1]) if len(steps) else 0.0


def cosine_distance(left, right) -> float:
    """1 - cos, at least 0, and 1 where one of them is (all but) zero."""
    left, right = np.asarray(left, dtype=np.float64), np.asarray(right, dtype=np.float64)
    if len(left) == 0:
        return 1.0
    product, of_left, of_right = (float(np.cumsum(terms)[-1]) for terms in (left * right, left**2, right**2))
    if of_left < 1e-30 or of_right < 1e-30:
        return 1.0
    return max(1.0 - product / math.sqrt(of_left * of_right), 0.0)


def match(base, clip, first_pose, step: int, settings, allowed=None, prices=None):
    """For one clip: per step (j, sequence, pose rank, audio rank, pose distance, audio distance), and where it failed.

    base : pose, audio, starts, stops, valid; allowed, prices : None or one array or None per step
    """
    pose = first_pose
    steps = []
    for number, sound in enumerate(clip):
        mask = None if allowed is None else allowed[number]
        price = None if prices is None else prices[number]
        offered = []
        for sequence, (start, stop) in enumerate(zip(base.starts.tolist(), base.stops.tolist(), strict=True)):
            best = None
            for j in range(start, stop):
                if not base.valid[j] or (mask is not None and not (mask[j + 1] and mask[j + step])):
                    continue
                if settings.preselect == "pose":
                    apart = euclidean_distance(base.pose[j], pose)
                else:
                    apart = cosine_distance(base.audio[j + 1], sound)
                if best is None or apart < best[0]:
                    best = apart, j
            if best is not None:
                j = best[1]
                apart = euclidean_distance(base.pose[j], pose), cosine_distance(base.audio[j + 1], sound)
                offered.append((sequence, j, *apart))
        if not offered:
            return steps, number
        by_pose = sorted(offered, key=lambda one: (one[2], one[0]))
        by_audio = sorted(offered, key=lambda one: (one[3], one[0]))
        ways = []
        for one in offered:
            ranks = by_pose.index(one), by_audio.index(one)
            cost = ranks[0] + ranks[1] if settings.use_audio else ranks[0]
            if price is not None:
                cost = cost + (price[one[1] + 1] + price[one[1] + step]) * len(offered)
            ways.append((cost, ranks[0], ranks[1], one))
        _, pose_rank, audio_rank, (sequence, j, *apart) = sorted(ways)[min(settings.k, len(ways)) - 1]
        steps.append((j, sequence, pose_rank, audio_rank, *apart))
        pose = base.pose[j + step]
    return steps, None

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
    """What paths of a graph for a speech cost, of `PriceList`s fields (see `search/objective.py`), and the rules they keep.

    A path is a list of nodes, one for each frame. Nothing is looked up but positions, segments, pauses and rewards.

    control : the price of a frame that shows a node, and that of one that holds it, as functions of (frame, node)
    marks : rows (frame, first node, node after the last) that cost `lambda_repeat` each
    before, after : of the frames [first, last) only, the nodes that are shown before and after them; -1 for none
    gates : the nodes that joins lead from and to; None for all
    """

    def __init__(
        self, prices, control=None, marks=(), first: int = 0, last=None, before: int = -1, after: int = -1, gates=None
    ):
        graph, self.rewards, self.marks, self.control = prices.graph, prices.rewards, marks, control
        self.settings, self.fps, self.used = prices.config.global_search, graph.fps, prices.used
        self.speaking, self.resting = list(prices.speaking), [not spoken for spoken in graph.speaking]
        self.first, self.last = first, len(self.speaking) if last is None else last
        self.before, self.after, self.n_nodes = before, after, graph.n_nodes
        bounds = segments(graph.segment_starts, graph.n_nodes)
        self.segment = [start for start, _ in bounds]
        self.ends = {end for _, end in bounds}
        self.gates = set(range(graph.n_nodes)) if gates is None else set(gates) | self.ends
        self.shortest = max(1, round(self.settings.min_stay_seconds * graph.fps))
        self.stutter = round(self.settings.stutter_seconds * graph.fps)
        poses, velocities = poses_and_velocities(graph.positions, graph.segment_starts)
        self.distances = np.array(
            [distances_from(node, poses, velocities, prices.config.continuity) for node in range(graph.n_nodes)]
        )

    # --- the rules

    def onwards(self, node: int) -> int:
        return node if node in self.ends else node + 1

    def is_join(self, node: int, other: int) -> bool:
        return other not in (node, self.onwards(node))

    def may_join(self, node: int, other: int) -> bool:
        stutters = self.segment[node] == self.segment[other] and abs(other - node - 1) <= self.stutter
        return self.is_join(node, other) and not stutters and {node, other} <= self.gates

    def next_nodes(self, node: int, age: int) -> list[int]:
        """What may follow a node whose stay has lasted for `age` frames."""
        if age < self.shortest and node not in self.ends:
            return [node + 1]
        joins = [other for other in range(self.n_nodes) if self.may_join(node, other)]
        return sorted({node, self.onwards(node), *joins})

    def all_paths(self):
        """Every path that keeps the rules; a stay that the window cuts off must go on as it may."""

        def onwards(nodes, age):
            if len(nodes) == self.last - self.first:
                if self.after < 0 or not nodes or self.after in self.next_nodes(nodes[-1], age):
                    yield nodes
                return
            last = nodes[-1] if nodes else self.before
            for node in range(self.n_nodes) if last < 0 else self.next_nodes(last, age):
                yield from onwards([*nodes, node], 1 if last < 0 or self.is_join(last, node) else age + 1)

        return onwards([], self.shortest)

    def keeps_the_rules(self, nodes) -> bool:
        age = self.shortest
        for last, node in itertools.pairwise([self.before, *nodes, self.after]):
            if last >= 0 and node >= 0:
                if node not in self.next_nodes(last, age):
                    return False
                age = 1 if self.is_join(last, node) else age + 1
            elif node >= 0:
                age = 1
        return True

    # --- the prices

    def earned(self, frame: int, node: int) -> list[tuple[str, float]]:
        return [(reward.name, -float(reward.gain[frame] * reward.worth[node])) for reward in self.rewards]

    def shown(self, frame: int, node: int) -> list[tuple[str, float]]:
        """Of a frame that shows a node, earnings aside."""
        rows = [("used", float(self.used[node]))]
        if bool(self.speaking[frame]) == self.resting[node]:
            rows.append(("state", self.settings.lambda_state))
        if self.control is not None:
            rows.append(("control", self.control[0](frame, node)))
        marked = sum(row == frame and low <= node < high for row, low, high in self.marks)
        return [*rows, ("marks", marked * self.settings.lambda_repeat)]

    def held(self, frame: int, node: int) -> list[tuple[str, float]]:
        """What a frame costs more that holds the node of the frame before."""
        resting = self.resting[node] and not self.speaking[frame]
        rows = [("held", self.settings.lambda_rest if resting else self.settings.lambda_hold)]
        if self.control is not None:
            shown, held = (price(frame, node) for price in self.control)
            rows.append(("control", max(held - shown, 0.0)))
        return rows

    def join(self, node: int, other: int) -> list[tuple[str, float]]:
        distance = self.distances[self.onwards(node)][other]
        return [("price", self.settings.join_price), ("distance", self.settings.lambda_join * distance)]

    def step(self, frame: int, last: int, node: int) -> list[tuple[str, float]]:
        """Of coming in a frame from one node to the next; what is held earns nothing."""
        if node == last:
            return self.held(frame, node)
        return self.earned(frame, node) + (self.join(last, node) if self.is_join(last, node) else [])

    def cost(self, nodes) -> dict[str, float]:
        """A path's cost by term, and `total`, their sum; how it goes on to `after` counts."""
        rows = [] if self.before >= 0 else self.earned(self.first, nodes[0])
        for frame, (last, node) in enumerate(itertools.pairwise([self.before, *nodes]), self.first):
            rows += self.shown(frame, node) + (self.step(frame, last, node) if last >= 0 else [])
        if self.after >= 0:
            rows += self.step(self.last, nodes[-1], self.after)
        rows += [("repeats", self.settings.lambda_repeat)] * sum(self.repeated(nodes))
        terms: dict[str, float] = {}
        for name, price in rows:
            terms[name] = terms.get(name, 0.0) + price
        return {name: price for name, price in terms.items() if price} | {"total": sum(terms.values())}

    def repeated(self, nodes) -> list[bool]:
        """Whether another stay showed a node within 3 of a frame's less than `repeat_seconds` before."""
        joins = [self.is_join(last, node) for last, node in itertools.pairwise(nodes)]
        stays = list(itertools.accumulate(joins, initial=0))
        return [
            any(
                stays[earlier] != stays[frame] and abs(nodes[earlier] - node) <= 3
                and frame - earlier < self.settings.repeat_seconds * self.fps - 1e-9
                for earlier in range(frame)
            )
            for frame, node in enumerate(nodes)
        ]  # fmt: skip

    # --- the cheapest path, repeats aside

    def cheapest(self) -> float:
        """Backwards over frames: what remains to be paid by node and age of its stay, from the shortest stay on alike."""
        nodes, ages = range(self.n_nodes), self.shortest
        joins = np.full((self.n_nodes, self.n_nodes), np.inf)
        for node, other in itertools.product(nodes, nodes):
            if self.may_join(node, other):
                joins[node, other] = self.total(self.join(node, other))
        remains = np.zeros((self.n_nodes, ages))
        if self.after >= 0:
            for node, age in itertools.product(nodes, range(ages)):
                may = self.after in self.next_nodes(node, age + 1)
                remains[node, age] = self.total(self.step(self.last, node, self.after)) if may else np.inf
        for frame in range(self.last - 1, self.first - (self.before >= 0), -1):
            remains = self._step_back(frame, remains, joins)
        if self.before >= 0:
            return float(remains[self.before, -1])
        return min(self.total(self.shown(self.first, n) + self.earned(self.first, n)) + remains[n, 0] for n in nodes)

    def _step_back(self, frame: int, remains: np.ndarray, joins: np.ndarray) -> np.ndarray:
        """What remains before the step to a frame, of what remains after it."""
        nodes = range(self.n_nodes)
        shown = np.array([self.total(self.shown(frame, node)) for node in nodes])
        coming = shown + [self.total(self.earned(frame, node)) for node in nodes]
        held = shown + [self.total(self.held(frame, node)) for node in nodes]
        older = np.minimum(np.arange(1, self.shortest + 1), self.shortest - 1)  # the age after a step without a join
        found = np.full(remains.shape, np.inf)
        for node in nodes:
            if node not in self.ends:
                found[node] = coming[node + 1] + remains[node + 1, older]
            free = slice(None) if node in self.ends else slice(self.shortest - 1, None)
            by_join = (joins[node] + coming + remains[:, 0]).min()
            found[node, free] = np.minimum(found[node, free], held[node] + remains[node, older][free])
            found[node, free] = np.minimum(found[node, free], by_join)
        return found

    @staticmethod
    def total(rows) -> float:
        return sum(price for _, price in rows)


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

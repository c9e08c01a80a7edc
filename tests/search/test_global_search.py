"""The global search against every path there is, and against a plain dynamic program."""

import os
import pickle
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gesturegen.config import Continuity, GlobalSearch
from gesturegen.graph.neighbours import COUNT
from gesturegen.search import _global_kernels as kernels
from gesturegen.search import global_search, objective
from gesturegen.search.path import CUT, Piece, Target
from tests import naive, tiny

WORDS = ("greeting", "counting", "absent")
LAMBDAS = (
    "lambda_w", "lambda_len", "lambda_pass", "lambda_state", "lambda_hold", "lambda_rest", "lambda_end",
    "lambda_keyword", "lambda_join",
)  # fmt: skip


def runs(rng, count, share):
    """Random states in runs of a few frames; True for about `share` of them."""
    return np.repeat(rng.random(count) < share, rng.integers(1, 6, count))[:count]


def random_positions(rng, n_nodes, scale=1.0):
    shape = n_nodes, int(rng.integers(1, 3)), 3
    kind = rng.choice(["walk", "grid", "still", "few"])
    if kind == "walk":
        positions = rng.normal(size=shape).cumsum(axis=0)
    elif kind == "grid":
        positions = rng.integers(-1, 2, size=shape).astype(float)
    elif kind == "still":
        positions = np.ones(shape)
    else:
        positions = rng.normal(size=(2, *shape[1:]))[rng.integers(0, 2, n_nodes)]
    return positions * scale


def random_graph(rng, n_nodes, positions=None, onsets=0.2, **rules):
    """A built graph of one or two clips, with random key nodes, segments and pauses."""
    positions = random_positions(rng, n_nodes) if positions is None else positions
    starts = np.unique([0, *rng.integers(0, n_nodes, size=rng.integers(0, 3))])
    rows = [
        (node, "onset") if rng.random() < 0.7 else (node, "keyword", str(rng.choice(WORDS[:2])))
        for node in np.flatnonzero(rng.random(n_nodes) < onsets).tolist()
    ]
    rules = {"l_cn": int(rng.integers(1, 6)), "l_pn": int(rng.integers(1, 3))} | rules
    graph = tiny.graph_of_positions(positions, starts, rows, **rules)
    if rng.random() < 0.3:
        graph = with_edges(graph, rng)
    clips = starts[: rng.integers(1, len(starts) + 1)]
    return replace(
        graph, clip_starts=clips, clip_names=tuple(f"clip{k}" for k in range(len(clips))),
        speaking=runs(rng, n_nodes, rng.choice([0.0, 0.5, 1.0])),
    ), Continuity(**rules)  # fmt: skip


def with_edges(graph, rng):
    """More unnatural edges, which the pruning leaves few of in a small graph, some from segments' last nodes too."""
    natural = graph.successors[:, None] == np.arange(graph.n_nodes)
    pairs = (rng.random(natural.shape) < 2 / graph.n_nodes) & ~natural & ~np.eye(graph.n_nodes, dtype=bool)
    edges = {(int(a), int(b)): float(rng.choice([0.0, 0.25, 1.0])) for a, b in np.argwhere(pairs)}
    edges = naive.edges_of(graph) | edges
    lefts, rights = np.array(sorted(edges), dtype=np.int64).reshape(-1, 2).T
    return replace(
        graph, indptr=np.append(0, np.bincount(lefts, minlength=graph.n_nodes).cumsum()), indices=rights,
        weights=np.array([edges[pair] for pair in sorted(edges)], dtype=np.float32),
        natural=(rights == graph.successors[lefts]) & (rights != lefts),
    )  # fmt: skip


def random_targets(rng, count, longest):
    """Pieces of 1 to `longest` frames, and the states of their speech."""
    bounds = np.append(0, rng.integers(1, longest + 1, count).cumsum())
    targets = [
        Target(start, end, "keyword", str(rng.choice(WORDS))) if rng.random() < 0.4 else Target(start, end, "onset")
        for start, end in pairwise(bounds[:-1].tolist())
    ]
    targets.append(Target(int(bounds[-2]), int(bounds[-1]), "break"))
    return targets, runs(rng, int(bounds[-1]), rng.choice([0.0, 0.5, 1.0]))


def random_prices(rng):
    if rng.random() < 0.2:
        return {}
    return {name: float(rng.choice([0.0, 0.3, 1.0, 5.0, 20.0, 3 * rng.random()])) for name in LAMBDAS}


def random_config(rng, metric=None, **rules):
    chosen = random_prices(rng) | {
        "lambda_repeat": 0.0, "slack_frames": int(rng.integers(0, 3)),
        "max_piece_seconds": float(rng.choice([3.0, 3.0, 4.0 / tiny.FPS])),
    }  # fmt: skip
    return tiny.config(continuity=metric or Continuity(), global_search=GlobalSearch(**(chosen | rules)))


def random_problem(rng, most_nodes=9, most_pieces=4, longest=12, **rules):
    metric = {"lambda_pos": float(rng.choice([0.0, 1.0, 2.5])), "lambda_vel": float(rng.choice([0.0, 0.4, 1.0]))}
    graph, metric = random_graph(rng, int(rng.integers(1, most_nodes + 1)), **metric)
    targets, speaking = random_targets(rng, int(rng.integers(1, most_pieces + 1)), longest)
    return graph, targets, speaking, random_config(rng, metric, **rules)


def cut(graph, targets, config):
    return global_search.cut_long(targets, config.global_search.max_piece_seconds * graph.fps)


def restated(graph, targets, speaking, config):
    return naive.Objective(graph, cut(graph, targets, config), speaking, config)


def paths(result):
    return [piece.nodes.tolist() for piece in result.pieces]


def close(cost, scale=1.0):
    return pytest.approx(cost, rel=1e-6, abs=1e-6 * scale)


def check_optimal(problem):
    """The result, whose objective is the naive minimum, and the price by the plain loops as well."""
    result = global_search.search(*problem)
    plain = restated(*problem)
    cost = plain.cost(paths(result))
    assert cost["total"] == close(plain.cheapest())
    assert result.final["total"] == close(cost["total"])
    assert result.first == close(result.final)
    return result


# --- the optimum ----------------------------------------------------------------------------------------------


def test_the_naive_program_finds_the_least_of_all_paths():
    rng = np.random.default_rng(0)
    tried = 0
    while tried < 150:
        problem = random_problem(rng, most_nodes=3, most_pieces=3, longest=3, slack_frames=int(rng.integers(0, 2)))
        plain = restated(*problem)
        if np.prod([len(plain.counts(t)) * 3.0 ** plain.counts(t)[-1] for t in plain.targets]) > 4000:
            continue
        used = rng.choice([0.0, 0.5, 4.0], size=plain.n_nodes)
        costs = [plain.cost(path, used)["total"] for path in plain.all_paths()]
        assert plain.cheapest(used) == close(min(costs))
        tried += 1


def test_equals_the_least_of_all_paths():
    rng = np.random.default_rng(1)
    tried = 0
    while tried < 120:
        problem = random_problem(rng, most_nodes=3, most_pieces=3, longest=3, slack_frames=int(rng.integers(0, 2)))
        plain = restated(*problem)
        if np.prod([len(plain.counts(t)) * 3.0 ** plain.counts(t)[-1] for t in plain.targets]) > 4000:
            continue
        result = global_search.search(*problem)
        least = min(plain.cost(path)["total"] for path in plain.all_paths())
        assert result.first["total"] == close(least) and plain.cost(paths(result))["total"] == close(least)
        tried += 1


def test_equals_the_naive_program():
    rng = np.random.default_rng(2)
    seen = Counter()
    for _ in range(2000):
        graph, targets, speaking, _ = problem = random_problem(rng)
        result = check_optimal(problem)
        seen.update(piece.fallback for piece in result.pieces)
        seen["one node"] += graph.n_nodes == 1
        seen["clips"] += len(graph.clip_names) > 1
        seen["edges"] += result.final["edges"] > 0
        seen["joins"] += result.final["joins"] > 0
        seen["cut"] += len(result.pieces) > len(targets)
        seen["one frame"] += any(piece.target.length == 1 for piece in result.pieces)
        seen["rests"] += not speaking.all() and not graph.speaking.all()
    assert min(seen.values()) > 50 and {None, "hold", "keyword", "end", "clips", "edges", "cut"} <= set(seen), seen


def test_a_price_of_nodes_counts_in_every_frame():
    rng = np.random.default_rng(3)
    for _ in range(600):
        graph, targets, speaking, config = random_problem(rng)
        used = rng.choice([0.0, 0.5, 3.0, 10.0], size=graph.n_nodes)
        targets = cut(graph, targets, config)
        # As solved: to draw out a rest may move it to dearer nodes.
        pieces = global_search._Problem(graph, targets, speaking, config, used).solve(np.zeros(graph.n_nodes))
        plain = naive.Objective(graph, targets, speaking, config)
        cost = plain.cost([piece.nodes.tolist() for piece in pieces], used)
        assert cost["total"] - cost["repeats"] == close(plain.cheapest(used))


def large_problem(rng, scale=1.0):
    """More nodes than the index of the nearest holds; in most of them an end anywhere may be worth its price."""
    n_nodes = int(rng.integers(60, 200))
    positions = rng.normal(size=(n_nodes, 1, 3))
    positions = (positions.cumsum(axis=0) if rng.random() < 0.5 else 3 * positions) * scale
    graph, metric = random_graph(rng, n_nodes, positions, 0.04, lambda_vel=float(rng.choice([0.0, 1.0])))
    targets, speaking = random_targets(rng, 4, 6)
    rules = {"lambda_w": 1.0 / scale, "lambda_join": float(rng.choice([0.1, 0.3, 1.0])) / scale}
    if rng.random() < 0.7:
        graph, speaking = replace(graph, speaking=runs(rng, n_nodes, 0.5)), runs(rng, len(speaking), 0.5)
        rules |= {"lambda_end": float(rng.choice([0.5, 1.0, 2.0])), "lambda_state": 2.0, "lambda_len": 0.3}
        rules |= {"lambda_hold": 5.0, "lambda_keyword": 1.0}
    return graph, targets, speaking, random_config(rng, metric, **rules)


def test_equals_the_naive_program_on_graphs_beyond_the_index(monkeypatch):
    opened = []

    def counted(*arguments):
        nodes, counts, open_piece = follow(*arguments)
        opened.append(open_piece >= 0)
        return nodes, counts, open_piece

    follow = kernels.follow
    monkeypatch.setattr(kernels, "follow", counted)
    rng = np.random.default_rng(4)
    for _ in range(60):
        problem = large_problem(rng)
        assert problem[0].near_nodes.shape[1] == COUNT < problem[0].n_nodes - 1
        check_optimal(problem)
    # Some paths end where only a bound is known, and are found by solving again.
    assert sum(opened) > 30, sum(opened)


def test_bounds_that_would_take_too_much_memory_change_nothing(monkeypatch):
    rng = np.random.default_rng(5)
    problems = [large_problem(rng) for _ in range(100)] + [random_problem(rng) for _ in range(50)]
    stored = [global_search.search(*problem) for problem in problems]
    monkeypatch.setattr(global_search, "_MOST_STOP_COSTS", 0)
    global_search._joins.cache_clear()
    for problem, known in zip(problems, stored, strict=True):
        result = global_search.search(*problem)
        assert global_search._joins(problem[0], problem[3].global_search, problem[3].continuity).stop_costs.size == 0
        assert result.final == close(known.final)
    global_search._joins.cache_clear()


def test_cheapest_joins_equal_a_look_at_all():
    rng = np.random.default_rng(20)
    for number in range(60):
        graph, _, speaking, config = large_problem(rng)
        joins = global_search._joins(graph, config.global_search, config.continuity)
        away = np.array(naive.Objective(graph, [], speaking, config).distances) * config.global_search.lambda_join
        # Costs of the joins' own size, so that many a node beyond the nearest is worth the way.
        costs = rng.random(graph.n_nodes) * np.median(away) * rng.choice([0.5, 1.0, 2.0])
        if number % 3 == 0:
            costs[rng.random(graph.n_nodes) < 0.97] = np.inf
        least = costs.min()
        every = np.append(joins.stops, np.arange(graph.n_nodes))
        for froms, bounds in ((every, joins.stop_costs), (every, joins.stop_costs[:0])):
            best, to = kernels._cheapest(froms, bounds, costs, least, joins)
            np.testing.assert_allclose(best, (away[froms] + costs).min(axis=1), rtol=1e-12)
            np.testing.assert_allclose(away[froms, to] + costs[to], best, rtol=1e-12)


@pytest.mark.parametrize("scale", [1e-24, 1e-18, 1e15, 1e19])
@pytest.mark.parametrize("most_stop_costs", [0, 1 << 20])
def test_extreme_scales_of_positions(monkeypatch, scale, most_stop_costs):
    monkeypatch.setattr(global_search, "_MOST_STOP_COSTS", most_stop_costs)
    rng = np.random.default_rng(6)
    for number in range(60):
        if number < 8:
            problem = large_problem(rng, scale)
        else:
            graph, metric = random_graph(rng, 8, random_positions(rng, 8, scale))
            targets, speaking = random_targets(rng, 3, 8)
            join = float(rng.choice([1.0, 1.0 / scale]))
            problem = graph, targets, speaking, random_config(rng, metric, lambda_join=join, lambda_w=join)
        plain, result = restated(*problem), global_search.search(*problem)
        least = plain.cheapest()
        # Sums of large and small prices are exact to the large ones' last digits.
        assert result.final["total"] == pytest.approx(least, rel=1e-6, abs=1e-6 * min(scale, 1.0))
        assert plain.cost(paths(result))["total"] == pytest.approx(least, rel=1e-6, abs=1e-6 * min(scale, 1.0))


def test_joins_alone_decide_at_small_scales():
    """With nothing else to pay, the cheapest join counts down to the last digits, however short it is."""
    free = dict.fromkeys(LAMBDAS, 0.0) | dict.fromkeys(("lambda_hold", "lambda_rest", "lambda_end", "lambda_join"), 1.0)
    rng = np.random.default_rng(7)
    paid = 0
    for scale in (1e-18, 1e-6, 1.0):
        for _ in range(5):
            positions = rng.normal(size=(120, 1, 3)) * scale
            graph, metric = random_graph(rng, 120, positions, 0.05, l_cn=1)
            targets, speaking = random_targets(rng, 4, 3)
            config = tiny.config(
                continuity=metric, global_search=GlobalSearch(**free, lambda_repeat=0.0, slack_frames=0)
            )
            least = restated(graph, targets, speaking, config).cheapest()
            result = global_search.search(graph, targets, speaking, config)
            assert result.final["total"] == pytest.approx(least, rel=1e-6, abs=0.0)
            paid += 0.0 < least < 100 * scale
    assert paid > 10, paid


def test_a_node_with_more_edges_than_a_byte_counts():
    edges = {(0, node): 1.0 for node in range(2, 300)} | {(0, 290): 0.25}
    graph = tiny.graph_of_edges(300, edges, [(290, "onset")])
    graph = replace(graph, speaking=np.arange(300) < 2)
    targets, speaking = [Target(0, 2, "break")], np.array([True, False])
    result = global_search.search(graph, targets, speaking, tiny.config())
    assert paths(result) == [[0, 290]] and result.final["total"] == 0.25
    check_optimal((graph, targets, speaking, tiny.config()))


# --- windows and sweeps ---------------------------------------------------------------------------------------


def test_windows_equal_the_naive_program():
    rng = np.random.default_rng(8)
    for _ in range(400):
        graph, targets, speaking, config = random_problem(rng, most_pieces=6, longest=6)
        targets = cut(graph, targets, config)
        first, last = sorted(rng.choice(len(targets) + 1, 2, replace=False).tolist())
        before = int(rng.integers(0, graph.n_nodes)) if first > 0 else -1
        after = int(rng.integers(0, graph.n_nodes)) if last < len(targets) else -1
        entering = rng.choice([0.0, 0.0, 0.5, 4.0], size=graph.n_nodes)
        used = rng.choice([0.0, 0.0, 0.5, 4.0], size=graph.n_nodes)
        problem = global_search._Problem(graph, targets, speaking, config, used)
        pieces = problem.solve(entering, first, last, before, after)
        window = naive.Objective(graph, targets[first:last], speaking, config)
        path = [piece.nodes.tolist() for piece in pieces]
        found = window.cost(path, used, entering, before, after)["total"] - window.cost(path)["repeats"]
        assert found == close(window.cheapest(used, entering, before, after))


def repetitive_problem(rng, **rules):
    """Many pieces on a small graph, so that its nodes must come again."""
    graph, metric = random_graph(rng, int(rng.integers(3, 12)))
    targets, speaking = random_targets(rng, int(rng.integers(9, 25)), 4)
    rules = {"lambda_repeat": float(rng.choice([0.1, 0.5, 3.0]))} | rules
    return graph, targets, speaking, random_config(rng, metric, **rules)


def with_rules(config, **rules):
    return config.model_copy(update={"global_search": config.global_search.model_copy(update=rules)})


def test_sweeps_never_raise_the_objective():
    rng = np.random.default_rng(9)
    lowered = 0
    for _ in range(40):
        graph, targets, speaking, config = repetitive_problem(rng)
        totals = []
        for sweeps in range(5):
            result = global_search.search(graph, targets, speaking, with_rules(config, sweeps=sweeps))
            plain = naive.Objective(graph, cut(graph, targets, config), speaking, config)
            cost = plain.cost(paths(result))
            assert result.final == close({name: cost[name] for name in result.final})
            totals.append(result.final["total"])
            assert result.first["total"] == close(totals[0])
            # Whatever the sweeps give up is a price without repeats of at least the optimum's.
            assert result.final["total"] - result.final["repeats"] >= plain.cheapest() - 1e-6
        assert all(after <= before + 1e-9 for before, after in pairwise(totals))
        lowered += totals[-1] < totals[0] - 1e-6
    assert lowered > 10


def test_sweeps_do_not_raise_the_objective_with_a_price_of_nodes():
    rng = np.random.default_rng(10)
    for _ in range(30):
        graph, targets, speaking, config = repetitive_problem(rng)
        used = rng.choice([0.0, 0.5, 3.0], size=graph.n_nodes)
        plain = naive.Objective(graph, cut(graph, targets, config), speaking, config)
        totals = [
            plain.cost(paths(global_search.search(graph, targets, speaking, with_rules(config, sweeps=n), used)), used)
            for n in range(4)
        ]
        assert all(after["total"] <= before["total"] + 1e-9 for before, after in pairwise(totals))


def test_sweeps_stay_above_the_least_of_all_paths():
    rng = np.random.default_rng(11)
    for _ in range(40):
        graph, metric = random_graph(rng, int(rng.integers(1, 4)))
        targets, speaking = random_targets(rng, 3, 2)
        config = random_config(rng, metric, lambda_repeat=1.0, slack_frames=0)
        plain = naive.Objective(graph, cut(graph, targets, config), speaking, config)
        least = min(plain.cost(path)["total"] for path in plain.all_paths())
        result = global_search.search(graph, targets, speaking, config)
        assert least - 1e-6 <= result.final["total"] <= result.first["total"] + 1e-6


def test_without_a_price_of_repeats_there_is_nothing_to_sweep():
    rng = np.random.default_rng(12)
    for _ in range(20):
        graph, targets, speaking, config = repetitive_problem(rng, lambda_repeat=0.0)
        one, many = (global_search.search(graph, targets, speaking, with_rules(config, sweeps=n)) for n in (0, 6))
        assert paths(one) == paths(many) and one.final["repeats"] == 0.0


# --- what comes back ------------------------------------------------------------------------------------------


def test_pieces_tile_the_speech_within_their_lengths():
    rng = np.random.default_rng(13)
    for _ in range(150):
        graph, targets, speaking, config = random_problem(rng, longest=14)
        pieces = global_search.search(graph, targets, speaking, config).pieces
        plain = restated(graph, targets, speaking, config)
        assert [piece.target.start_frame for piece in pieces] == [0, *(piece.target.end_frame for piece in pieces[:-1])]
        assert pieces[-1].target.end_frame == len(speaking)
        rules = {target.end_frame: (target.end_kind, target.keyword) for target in targets}
        for piece in pieces:
            target = piece.target
            assert 1 <= target.length <= np.ceil(config.global_search.max_piece_seconds * graph.fps)
            assert (target.end_kind, target.keyword) == rules.get(target.end_frame, (CUT, ""))
            assert len(piece.nodes) in plain.counts(target)


def test_long_targets_are_cut_into_equal_parts():
    assert global_search.cut_long([Target(5, 95, "onset")], 90.0) == [Target(5, 95, "onset")]
    assert global_search.cut_long([Target(5, 96, "keyword", "hi")], 90.0) == [
        Target(5, 51, CUT), Target(51, 96, "keyword", "hi")
    ]  # fmt: skip
    assert global_search.cut_long([Target(0, 4, "onset"), Target(4, 13, "break")], 4.0) == [
        Target(0, 4, "onset"), Target(4, 7, CUT), Target(7, 10, CUT), Target(10, 13, "break")
    ]  # fmt: skip
    for length in range(1, 60):
        for most in (1.0, 2.0, 3.5, 7.3, 30.0):
            parts = global_search.cut_long([Target(3, 3 + length, "onset")], most)
            lengths = [part.length for part in parts]
            fewest = next(count for count in range(1, 99) if length <= count * most + 1e-6)
            assert sum(lengths) == length and len(parts) == fewest and max(lengths) - min(lengths) <= 1


@pytest.mark.parametrize("seconds", [0.001, 0.02, 1 / tiny.FPS])
def test_no_part_of_a_piece_is_shorter_than_a_frame(seconds):
    parts = global_search.cut_long([Target(0, 3, "onset"), Target(3, 4, "break")], seconds * tiny.FPS)
    assert [part.length for part in parts] == [1, 1, 1, 1]


@pytest.mark.parametrize(
    ("length", "slack", "expected"),
    [(1, 2, (1, 3)), (2, 2, (1, 4)), (3, 2, (1, 5)), (10, 2, (8, 12)), (30, 2, (27, 33)), (21, 2, (19, 23)),
     (1, 0, (1, 1)), (10, 0, (9, 11)), (100, 0, (90, 110)), (20, 2, (18, 22))],
)  # fmt: skip
def test_how_many_nodes_a_piece_may_have(length, slack, expected):
    assert global_search.lengths(length, GlobalSearch(slack_frames=slack)) == expected


def test_costs_of_pieces_add_up_to_the_objective():
    rng = np.random.default_rng(14)
    for number in range(150):
        problem = repetitive_problem(rng) if number % 3 == 0 else random_problem(rng)
        result, plain = global_search.search(*problem), restated(*problem)
        sums = Counter()
        for piece in result.pieces:
            assert piece.cost == close(sum(piece.costs.values())) and all(piece.costs.values())
            sums.update(piece.costs)
        cost = plain.cost(paths(result))
        for name in objective.PIECE_TERMS:
            assert sums[name] == close(cost[name]) and result.final[name] == close(cost[name])
        assert sum(piece.cost for piece in result.pieces) + result.final["repeats"] == close(result.final["total"])


def test_the_fallback_is_the_gravest_thing_that_gave_way():
    rng = np.random.default_rng(15)
    seen = Counter()
    for _ in range(150):
        # Every price is above 0: what costs nothing does not give way.
        prices = dict(zip(LAMBDAS, rng.choice([0.3, 1.0, 5.0], len(LAMBDAS)).tolist(), strict=True))
        problem = random_problem(rng, **prices)
        result, plain = global_search.search(*problem), restated(*problem)
        last = -1
        for piece in result.pieces:
            nodes, target = piece.nodes.tolist(), piece.target
            gave_way = {term for term, _ in plain.end(target, len(nodes), nodes[-1])} - {"length"}
            stays_on = last >= 0 and any(term == "held" for term, _ in plain.join(last, nodes[0], target.start_frame))
            held = stays_on or any(node == after for node, after in pairwise(nodes))
            expected = next((name for name in ("end", "keyword") if name in gave_way), "hold" if held else None)
            assert piece.fallback == expected
            seen[expected, frozenset(gave_way), held] += 1
            last = nodes[-1]
    assert seen["end", frozenset({"end", "keyword"}), True] and seen["keyword", frozenset({"keyword"}), True]


def test_the_same_again():
    rng = np.random.default_rng(16)
    for _ in range(20):
        problem = repetitive_problem(rng)
        once = global_search.search(*problem)
        global_search._joins.cache_clear()
        again = global_search.search(*problem)
        assert paths(once) == paths(again) and once.first == again.first and once.final == again.final


def test_the_loops_uncompiled_find_the_same(tmp_path):
    """What the compiler makes of the loops, whatever its version, does not show in the result."""
    rng = np.random.default_rng(19)
    problems = [random_problem(rng) for _ in range(25)] + [large_problem(rng) for _ in range(2)]
    (tmp_path / "problems").write_bytes(pickle.dumps(problems))
    code = (
        "import pickle, sys; from gesturegen.search import global_search\n"
        "for problem in pickle.loads(open(sys.argv[1], 'rb').read()):\n"
        "    print([piece.nodes.tolist() for piece in global_search.search(*problem).pieces])"
    )
    printed = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "problems"], env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert printed.splitlines() == [str(paths(global_search.search(*problem))) for problem in problems]


def test_the_inputs_do_not_change():
    graph, targets, speaking, config = repetitive_problem(np.random.default_rng(17))
    used = np.ones(graph.n_nodes)
    before = list(targets), speaking.copy(), used.copy()
    global_search.search(graph, targets, speaking, config, used)
    assert targets == before[0] and speaking.tolist() == before[1].tolist() and used.tolist() == before[2].tolist()


# --- rests ----------------------------------------------------------------------------------------------------


def resting_chain(n_nodes=12, quiet=slice(None)):
    graph = tiny.graph_of_edges(n_nodes, {})
    states = np.ones(n_nodes, dtype=bool)
    states[quiet] = False
    return replace(graph, speaking=states)


def spread(graph, nodes, speaking):
    piece = Piece(Target(0, len(nodes), "break"), np.array(nodes), 0.0)
    return global_search._spread_rests(piece, graph, np.array(speaking, dtype=bool)).nodes.tolist()


def test_a_rest_is_drawn_out_evenly():
    assert spread(resting_chain(), [2, 2, 2, 2, 2, 3, 4], [False] * 7) == [2, 2, 3, 3, 3, 4, 4]
    assert spread(resting_chain(), [2, 2, 2, 2], [False] * 4) == [2, 2, 2, 2]
    assert spread(resting_chain(), [2, 3, 4, 5], [False] * 4) == [2, 3, 4, 5]


def test_only_rests_are_drawn_out():
    held = [2, 2, 2, 2, 2, 3, 4]
    assert spread(resting_chain(), held, [True] * 7) == held
    assert spread(resting_chain(quiet=slice(0)), held, [False] * 7) == held
    # The speech rests for the first five frames only; the reference from node 3 on.
    assert spread(resting_chain(), [2, 2, 2, 2, 3, 3, 3], [False] * 5 + [True] * 2) == [2, 2, 2, 3, 3, 3, 3]
    assert spread(resting_chain(quiet=slice(3, None)), [2, 2, 3, 3, 3, 4], [False] * 6) == [2, 2, 3, 3, 4, 4]


def test_a_rest_is_not_drawn_out_across_a_jump():
    assert spread(resting_chain(), [2, 2, 2, 3, 7, 7, 7, 8], [False] * 8) == [2, 2, 3, 3, 7, 7, 8, 8]


def test_drawing_out_rests_costs_nothing():
    rng = np.random.default_rng(18)
    changed = 0
    for _ in range(200):
        n_nodes = int(rng.integers(2, 14))
        graph, metric = random_graph(rng, n_nodes)
        graph = replace(graph, speaking=runs(rng, n_nodes, 0.3))
        config = random_config(rng, metric, lambda_repeat=1.0, max_piece_seconds=3.0)
        targets, speaking = random_targets(rng, 2, 12)
        speaking = runs(rng, len(speaking), 0.3)
        plain = naive.Objective(graph, targets, speaking, config)
        path = []
        for target in targets:
            nodes = [int(rng.integers(0, n_nodes))]
            while len(nodes) < target.length:
                onwards = rng.random() < 0.4
                nodes.append(int(rng.choice(plain.children[nodes[-1]])) if onwards else nodes[-1])
            path.append(nodes)
        pieces = [Piece(target, np.array(nodes), 0.0) for target, nodes in zip(targets, path, strict=True)]
        drawn = [global_search._spread_rests(piece, graph, speaking).nodes.tolist() for piece in pieces]
        assert plain.cost(drawn) == close(plain.cost(path))
        for before, after in zip(path, drawn, strict=True):
            assert (before[0], before[-1], len(before)) == (after[0], after[-1], len(after))
            changed += before != after
    assert changed > 20

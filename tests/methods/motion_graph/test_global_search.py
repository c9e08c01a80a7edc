"""The global search against every path there is, and against a plain dynamic program."""

import os
import pickle
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from itertools import islice, pairwise

import numpy as np
import pytest

from gesturegen.data.keynodes import BREAK
from gesturegen.methods.motion_graph import global_search, objective
from gesturegen.methods.motion_graph.objective import PriceList
from gesturegen.methods.motion_graph.rewards import Reward
from gesturegen.methods.motion_graph.settings import GlobalSearch
from gesturegen.path import JOIN
from gesturegen.settings.models import Continuity
from tests import naive, tiny

FRAME = 1.0 / tiny.FPS


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


def random_rewards(rng, n_frames, n_nodes, size=None):
    size = float(rng.choice([1.0, 5.0, 30.0])) if size is None else size
    gains = [rng.random(n_frames) * (rng.random(n_frames) < 0.4) for _ in range(2)]
    names = ["beat", "onset", "keyword"][: rng.integers(0, 4)]
    # Two of them may share a gain, as beats and onsets do.
    return tuple(Reward(name, gains[k // 2], size * rng.normal(size=n_nodes)) for k, name in enumerate(names))


def random_prices(rng, most_nodes=14, most_frames=16, positions=None, scale=1.0, **rules) -> PriceList:
    """A built graph of up to three segments, a speech of some frames, and prices of all sizes, 0 among them."""
    n_nodes = int(rng.integers(1, most_nodes + 1)) if positions is None else len(positions)
    n_frames = int(rng.integers(1, most_frames + 1))
    positions = random_positions(rng, n_nodes, scale) if positions is None else positions
    metric = {"lambda_pos": float(rng.choice([0.0, 1.0, 2.5])), "lambda_vel": float(rng.choice([0.0, 0.4, 1.0]))}
    starts = np.unique([0, *rng.integers(0, n_nodes, size=rng.integers(0, 3))])
    graph = tiny.graph_of_positions(positions, starts, **metric)
    graph = replace(graph, speaking=runs(rng, n_nodes, rng.choice([0.0, 0.5, 1.0])))
    names = "join_price", "lambda_join", "lambda_state", "lambda_hold", "lambda_rest"
    chosen = {name: float(rng.choice([0.0, 0.3, 1.0, 5.0, 20.0])) for name in names}
    chosen |= {"min_stay_seconds": FRAME * rng.integers(0, 5), "stutter_seconds": FRAME * rng.integers(0, 3)}
    settings = GlobalSearch(**(chosen | {"lambda_repeat": 0.0} | rules))
    config = tiny.config(continuity=Continuity(**metric), global_search=settings)
    speaking = runs(rng, n_frames, rng.choice([0.0, 0.5, 1.0]))
    used = rng.choice([0.0, 0.0, 0.5, 3.0]) * rng.random(n_nodes)
    return PriceList(graph, config, speaking, random_rewards(rng, n_frames, n_nodes), used)


def solve(prices: PriceList) -> list[int]:
    return global_search.Problem(prices, len(prices.speaking)).solve().tolist()


def close(cost, scale=1.0):
    return pytest.approx(cost, rel=1e-5, abs=1e-5 * scale)


def check_optimal(prices, control=None):
    """A path that keeps the rules, whose objective is the naive minimum; its price by the plain loops as well."""
    plain = naive.Objective(prices, control)
    nodes = solve(prices)
    cost = plain.cost(nodes)
    assert plain.keeps_the_rules(nodes), nodes
    assert cost["total"] - cost.get("repeats", 0.0) == close(plain.cheapest())
    found = objective.total(np.array(nodes), prices)
    for name in ("total", *objective.TERMS):
        assert found[name] == close(cost.get(name, 0.0)), name
    return nodes, cost


# --- the optimum ----------------------------------------------------------------------------------------------


def test_the_naive_program_and_the_search_find_the_least_of_all_paths():
    rng = np.random.default_rng(0)
    tried = Counter()
    while tried["all"] < 150:
        prices = random_prices(rng, most_nodes=5, most_frames=5)
        plain = naive.Objective(prices)
        paths = list(islice(plain.all_paths(), 501))
        if len(paths) > 500:
            continue
        least = min(plain.cost(path)["total"] for path in paths)
        assert plain.cheapest() == close(least)
        nodes, _ = check_optimal(prices)
        assert nodes in paths
        tried["all"] += 1
        tried["many"] += len(paths) > 50
        tried["one"] += len(paths) == 1
    assert tried["many"] > 20, tried


def test_equals_the_naive_program():
    rng = np.random.default_rng(2)
    seen = Counter()
    for _ in range(250):
        prices = random_prices(rng)
        nodes, cost = check_optimal(prices)
        joins = objective.joined(np.array(nodes), prices.graph).sum()
        seen["one node"] += prices.graph.n_nodes == 1
        seen["segments"] += len(prices.graph.segment_starts) > 1
        seen["joins"] += joins > 0
        seen["many joins"] += joins > 3
        seen["rests"] += not prices.speaking.all() and not prices.graph.speaking.all()
        seen["shared gains"] += len(prices.rewards) > 1
        seen.update(name for name in cost if cost[name])
    assert min(seen.values()) > 5 and {"held", "price", "distance", "beat", "keyword", "state", "used"} <= set(seen), (
        seen
    )


def test_equals_the_naive_program_on_graphs_of_many_blocks():
    rng = np.random.default_rng(4)
    joins = 0
    for _ in range(12):
        n_nodes = int(rng.integers(100, 200))
        positions = rng.normal(size=(n_nodes, 1, 3))
        positions = positions.cumsum(axis=0) if rng.random() < 0.5 else 3 * positions
        # Joins of about what is earned, so that there are many targets, each of a few nodes.
        prices = random_prices(
            rng, positions=positions, most_frames=12, join_price=float(rng.choice([0.0, 0.3])), lambda_join=0.3,
            min_stay_seconds=2 * FRAME,
        )  # fmt: skip
        prices = replace(prices, rewards=random_rewards(rng, len(prices.speaking), n_nodes, size=3.0))
        nodes, _ = check_optimal(prices)
        joins += objective.joined(np.array(nodes), prices.graph).sum()
    assert joins > 10, joins


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1e6, 1e12])
def test_extreme_scales_of_positions(scale):
    rng = np.random.default_rng(6)
    joined = 0
    for _ in range(20):
        prices = random_prices(rng, scale=scale, lambda_join=1.0 / scale)
        _, cost = check_optimal(prices)
        joined += "distance" in cost
    assert joined > 2


def test_in_large_graphs_joins_lead_from_and_to_every_kth_node_and_segments_ends(monkeypatch):
    monkeypatch.setattr(global_search, "MOST_GATES", 6)
    rng = np.random.default_rng(5)
    joined = 0
    for _ in range(80):
        prices = random_prices(rng, most_nodes=24)
        step = -(-prices.graph.n_nodes // 6)
        plain = naive.Objective(prices, gates=range(0, prices.graph.n_nodes, step))
        nodes = solve(prices)
        assert plain.keeps_the_rules(nodes)
        cost = plain.cost(nodes)
        assert cost["total"] - cost.get("repeats", 0.0) == close(plain.cheapest())
        joined += step > 1 and "distance" in cost
    assert joined > 4, joined


# --- windows and sweeps ---------------------------------------------------------------------------------------


def random_window(rng, prices):
    """A window [first, last) of the speech with its ends, and marks in it; None where it cannot be passed."""
    n_frames, n_nodes = len(prices.speaking), prices.graph.n_nodes
    first, last = sorted(rng.choice(n_frames + 1, 2, replace=False).tolist())
    before = int(rng.integers(0, n_nodes)) if first > 0 else -1
    after = int(rng.integers(0, n_nodes)) if last < n_frames else -1
    rows = []
    for _ in range(rng.integers(0, 6)):
        low, high = sorted(rng.choice(n_nodes + 1, 2, replace=False).tolist())
        rows.append((int(rng.integers(first, last)), low, high))
    marks = np.array(sorted(rows), dtype=np.int64).reshape(-1, 3)
    plain = naive.Objective(prices, None, rows, first, last, before, after)
    return (first, last, before, after, marks), plain


def test_windows_equal_the_naive_program():
    rng = np.random.default_rng(8)
    tried = impossible = 0
    while tried < 250:
        prices = random_prices(rng, lambda_repeat=float(rng.choice([0.5, 4.0])))
        if len(prices.speaking) < 2:
            continue
        window, plain = random_window(rng, prices)
        least = plain.cheapest()
        if not np.isfinite(least):
            impossible += 1
            continue
        nodes = global_search.Problem(prices, len(prices.speaking)).solve(*window).tolist()
        assert len(nodes) == window[1] - window[0] and plain.keeps_the_rules(nodes), (window, nodes)
        cost = plain.cost(nodes)
        assert cost["total"] - cost.get("repeats", 0.0) == close(least), (window, nodes)
        tried += 1
    assert impossible < tried


def test_the_naive_windows_equal_all_paths():
    rng = np.random.default_rng(9)
    tried = 0
    while tried < 60:
        prices = random_prices(rng, most_nodes=5, most_frames=5, lambda_repeat=2.0)
        if len(prices.speaking) < 2:
            continue
        _, plain = random_window(rng, prices)
        paths = list(islice(plain.all_paths(), 501))
        if len(paths) > 500:
            continue
        costs = [plain.cost(path) for path in paths]
        least = min((cost["total"] - cost.get("repeats", 0.0) for cost in costs), default=np.inf)
        assert plain.cheapest() == close(least)
        tried += 1


def repetitive(rng, **rules) -> tuple:
    """A long speech on a small graph, so that its nodes must come again."""
    n_nodes, n_frames = int(rng.integers(8, 40)), int(rng.integers(30, 70))
    graph = tiny.graph_of_positions(rng.normal(size=(n_nodes, 2, 3)).cumsum(axis=0), (0, n_nodes // 2))
    graph = replace(graph, speaking=runs(rng, n_nodes, 0.7))
    chosen = {
        "join_price": float(rng.choice([1.0, 5.0])), "lambda_join": 0.5, "lambda_repeat": float(rng.choice([0.5, 3.0])),
        "repeat_seconds": float(rng.choice([0.5, 1.0])), "min_stay_seconds": 3 * FRAME, "stutter_seconds": 2 * FRAME,
        "lambda_hold": 5.0,
    }  # fmt: skip
    config = tiny.config(joints="all", global_search=GlobalSearch(**(chosen | rules)))
    speech = tiny.speech(n_frames, np.flatnonzero(rng.random(n_frames) < 0.1), [("hi", 3, 20)])
    return graph, speech, config


def with_rules(config, **rules):
    return config.model_copy(update={"global_search": config.global_search.model_copy(update=rules)})


def shown(result):
    return np.concatenate([piece.nodes for piece in result.pieces])


def test_sweeps_never_raise_the_objective_and_keep_the_rules():
    rng = np.random.default_rng(10)
    lowered = 0
    for _ in range(12):
        graph, speech, config = repetitive(rng)
        prices = global_search.price_list(graph, speech, config)
        plain, totals = naive.Objective(prices), []
        for sweeps in range(3):
            result = global_search.search(graph, speech, with_rules(config, sweeps=sweeps))
            nodes = shown(result).tolist()
            cost = plain.cost(nodes)
            assert {name: value for name, value in result.final.items() if value} == close(cost)
            # Rests that are drawn out hold frames where a stay is to play on.
            if (prices.speaking | graph.speaking[nodes]).all():
                assert plain.keeps_the_rules(nodes)
            totals.append(result.final["total"])
            assert result.first["total"] - result.first["repeats"] == close(plain.cheapest())
        # What is drawn out at the end may be shown again; the sweeps themselves never raise the sum.
        assert totals[-1] <= totals[0] + 1e-6
        lowered += totals[-1] < totals[0] - 1e-6
    assert lowered > 4, lowered


def test_a_sweep_lowers_the_objective_or_leaves_the_path():
    rng = np.random.default_rng(11)
    for _ in range(25):
        graph, speech, config = repetitive(rng)
        prices = global_search.price_list(graph, speech, config)
        problem, plain = global_search.Problem(prices, speech.n_frames), naive.Objective(prices)
        nodes = problem.solve()
        for stays in (1, 2, 3):
            other = problem.sweep(nodes, stays)
            before, after = (plain.cost(path.tolist())["total"] for path in (nodes, other))
            assert after < before or other.tolist() == nodes.tolist()
            assert plain.keeps_the_rules(other.tolist())
            nodes = other


def test_a_window_solved_beside_the_present_path_is_solved_the_same():
    """What must cost more than the present path is not looked for, which may change nothing."""
    rng = np.random.default_rng(20)
    seen = Counter()
    for _ in range(40):
        graph, speech, config = repetitive(
            rng, min_stay_seconds=FRAME * rng.integers(0, 6), join_price=float(rng.choice([0.0, 1.0, 5.0])),
            lambda_hold=float(rng.choice([0.2, 5.0])),
        )  # fmt: skip
        prices = global_search.price_list(graph, speech, config)
        problem = global_search.Problem(prices, speech.n_frames)
        nodes = problem.solve()
        bounds = objective.stay_bounds(nodes, graph).tolist()
        for place in range(len(bounds) - 1):
            first, last = bounds[place], bounds[min(place + int(rng.integers(1, 4)), len(bounds) - 1)]
            before = int(nodes[first - 1]) if first else -1
            window = first, last, before, int(nodes[last]) if last < len(nodes) else -1
            marks = problem._marks(nodes, first, last)
            part = problem.solve(*window, marks)
            assert problem.solve(*window, marks, nodes).tolist() == part.tolist()
            seen["all"] += 1
            seen["changed"] += part.tolist() != nodes[first:last].tolist()
            seen["joins inside"] += objective.joined(part, graph).any()
            seen["start"] += first == 0
            seen["end"] += last == len(nodes)
    assert min(seen.values()) > 20, seen


@pytest.mark.parametrize("inside", [False, True])
def test_marks_are_what_other_stays_show_around(inside):
    rng = np.random.default_rng(12)
    for _ in range(20):
        graph, speech, config = repetitive(rng, repeat_seconds=0.4)
        prices = global_search.price_list(graph, speech, config)
        problem = global_search.Problem(prices, speech.n_frames)
        nodes = problem.solve()
        starts = [0, *np.flatnonzero(objective.joined(nodes, graph)).tolist(), len(nodes)]
        place = int(rng.integers(len(starts) - 1))
        first, last = starts[place], starts[min(place + 2, len(starts) - 1)]
        found = np.zeros((len(nodes), graph.n_nodes), dtype=int)
        for frame, low, high in problem._marks(nodes, first, last, inside).tolist():
            found[frame, low:high] += 1
        expected = np.zeros_like(found)
        for start, end in pairwise(starts):
            own = first <= start < last
            for frame in range(first, last) if inside or not own else ():
                if start <= frame < end:
                    continue
                near = [nodes[t] for t in range(start, end) if abs(t - frame) < 0.4 * graph.fps - 1e-9]
                for node in range(graph.n_nodes):
                    expected[frame, node] += any(abs(node - other) <= 3 for other in near)
        np.testing.assert_array_equal(found, expected)


def test_without_a_price_of_repeats_there_is_nothing_to_sweep():
    rng = np.random.default_rng(13)
    for _ in range(8):
        graph, speech, config = repetitive(rng, lambda_repeat=0.0)
        one, many = (global_search.search(graph, speech, with_rules(config, sweeps=n)) for n in (0, 6))
        assert shown(one).tolist() == shown(many).tolist() and one.final["repeats"] == 0.0


# --- what comes back ------------------------------------------------------------------------------------------


def test_pieces_are_the_stays_and_their_costs_add_up():
    rng = np.random.default_rng(14)
    lengths = Counter()
    for _ in range(25):
        graph, speech, config = repetitive(rng)
        result = global_search.search(graph, speech, config)
        pieces = result.pieces
        bounds = [0, *(piece.target.end_frame for piece in pieces)]
        assert [piece.target.start_frame for piece in pieces] == bounds[:-1] and bounds[-1] == speech.n_frames
        assert [piece.target.end_kind for piece in pieces] == [JOIN] * (len(pieces) - 1) + [BREAK]
        sums = Counter()
        for piece in pieces:
            assert len(piece.nodes) == piece.target.length and piece.retries == 0 and piece.fallback is None
            assert not objective.joined(piece.nodes, graph).any() and piece.target.keyword == ""
            assert piece.cost == close(sum(piece.costs.values())) and all(
                name in objective.TERMS for name in piece.costs
            )
            for name, value in piece.costs.items():
                sums[name] += value
            lengths[len(piece.nodes)] += 1
        for left, right in pairwise(pieces):
            assert right.nodes[0] not in (left.nodes[-1], graph.successors[left.nodes[-1]])
        for name in objective.TERMS:
            assert sums[name] == close(result.final[name]), name
        assert sum(piece.cost for piece in pieces) == close(result.final["total"])
    assert len(lengths) > 5, lengths


def test_a_planted_answer_is_found():
    """One place of the reference has the onsets of the speech, another a keyword, another the end of a phrase."""
    n_nodes, fps = 600, tiny.FPS
    graph = tiny.graph_of_positions(np.zeros((n_nodes, 2, 3)), rows=[
        *((node, "onset") for node in (100, 109, 130, 142)), (301, "keyword", "greeting"), (400, "onset"), (500, "onset"),
    ])  # fmt: skip
    graph = replace(graph, phrase_ends=np.array([450]), joint_names=("left", "right"))
    speech = tiny.speech(60, (8, 17, 38, 50))
    prices = {
        "lambda_beat": 0.0,
        "lambda_phrase": 0.0,
        "lambda_keyword": 0.0,
        "lambda_onset": 10.0,
        "join_price": 100.0,
    }
    config = tiny.config(global_search=GlobalSearch(**prices))
    assert shown(global_search.search(graph, speech, config)).tolist() == list(range(92, 152))
    said = tiny.speech(90, (), [("here", 0, 40), ("hi", 40, 45), ("well", 45, 50)])
    for term, weight, places in (("lambda_keyword", 30.0, {301: 40}), ("lambda_phrase", 30.0, {450: 50})):
        config = tiny.config(
            global_search=GlobalSearch(**prices | {"lambda_onset": 0.0, term: weight, "join_price": 40.0})
        )
        nodes = shown(global_search.search(graph, said, config))
        for node, frame in places.items():
            assert nodes[frame] == node, (term, nodes[frame])
    assert fps == 30.0


def test_a_pause_shows_a_pause_drawn_out_and_no_statue():
    rng = np.random.default_rng(15)
    graph = tiny.graph_of_positions(rng.normal(size=(240, 2, 3)).cumsum(axis=0) * 0.1)
    quiet = np.isin(np.arange(240), np.arange(150, 190))
    graph = replace(graph, speaking=~quiet)
    words = [("a", 0, 60), ("b", 160, 240)]  # between them 100 frames of silence, of which the reference has 40
    nodes = shown(global_search.search(graph, tiny.speech(240, (), words), tiny.config()))
    rest = nodes[62:158]
    assert quiet[rest].mean() > 0.95
    # All frames of the rest are shown, each for two or three frames.
    held = np.bincount(rest[quiet[rest]], minlength=240)[151:189]
    assert held.min() >= 1 and held.max() <= 4, held


def test_a_reference_of_any_length_serves_a_speech_of_any_length():
    for n_nodes in (1, 2, 25):
        graph = tiny.graph_of_positions(np.arange(n_nodes * 3.0).reshape(-1, 1, 3))
        for n_frames in (1, 2, 40):
            result = global_search.search(graph, tiny.speech(n_frames, (0,), [("hi", 0, 1)]), tiny.config())
            assert len(shown(result)) == n_frames


def test_a_busy_reference_earns_nothing_by_being_busy():
    positions = np.random.default_rng(16).normal(size=(40, 1, 3))
    graph = tiny.graph_of_positions(positions, rows=[(node, "onset") for node in range(40)])
    result = global_search.search(graph, tiny.speech(30, (5, 9, 20)), tiny.config())
    # Bells at the ends of the reference are lower, which is all that differs.
    assert abs(result.final["onset"]) < 5.0


def test_the_same_again_from_a_pickled_graph_and_with_the_loops_uncompiled(tmp_path):
    """Neither a rerun nor another process nor what the compiler makes of the loops shows in the result."""
    rng = np.random.default_rng(17)
    problems = [repetitive(rng) for _ in range(2)]
    found = [global_search.search(*problem) for problem in problems]
    for problem, once in zip(problems, found, strict=True):
        again = global_search.search(*pickle.loads(pickle.dumps(problem)))
        assert shown(again).tolist() == shown(once).tolist() and again.final == once.final and again.first == once.first
    (tmp_path / "problems").write_bytes(pickle.dumps(problems))
    code = (
        "import pickle, sys; from gesturegen.methods.motion_graph import global_search\n"
        "for problem in pickle.loads(open(sys.argv[1], 'rb').read()):\n"
        "    print([piece.nodes.tolist() for piece in global_search.search(*problem).pieces])"
    )
    printed = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "problems"], env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert printed.splitlines() == [str([piece.nodes.tolist() for piece in one.pieces]) for one in found]


def test_the_inputs_do_not_change():
    graph, speech, config = repetitive(np.random.default_rng(18))
    used = np.ones(graph.n_nodes)
    global_search.search(graph, speech, config, used)
    assert used.tolist() == [1.0] * graph.n_nodes and not speech.onset_times.flags.writeable


# --- rests ----------------------------------------------------------------------------------------------------


def resting_chain(n_nodes=12, quiet=slice(None)):
    graph = tiny.graph_of_edges(n_nodes, {})
    states = np.ones(n_nodes, dtype=bool)
    states[quiet] = False
    return replace(graph, speaking=states)


def spread(graph, nodes, speaking):
    prices = PriceList(graph, tiny.config(), np.array(speaking, dtype=bool), (), np.zeros(graph.n_nodes))
    return global_search.spread_rests(np.array(nodes), prices).tolist()


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


def test_a_rest_is_not_drawn_out_across_a_join():
    assert spread(resting_chain(), [2, 2, 2, 3, 7, 7, 7, 8], [False] * 8) == [2, 2, 3, 3, 7, 7, 8, 8]


def test_drawing_out_rests_costs_nothing():
    rng = np.random.default_rng(19)
    changed = 0
    for _ in range(60):
        prices = replace(random_prices(rng, most_nodes=20, lambda_rest=0.3), rewards=())
        prices = replace(
            prices, used=np.zeros(prices.graph.n_nodes), speaking=np.zeros(len(prices.speaking), dtype=bool)
        )
        plain = naive.Objective(prices)
        nodes = [int(rng.integers(prices.graph.n_nodes))]
        while len(nodes) < len(prices.speaking):
            onwards = plain.onwards(nodes[-1]) if rng.random() < 0.4 else nodes[-1]
            nodes.append(int(rng.integers(prices.graph.n_nodes)) if rng.random() < 0.05 else onwards)
        drawn = global_search.spread_rests(np.array(nodes), prices).tolist()
        assert plain.cost(drawn) == close(plain.cost(nodes))
        changed += drawn != nodes
    assert changed > 10, changed

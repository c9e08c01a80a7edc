"""The global search with control against every path there is, and against a plain dynamic program."""

from collections import Counter
from dataclasses import replace
from itertools import islice, pairwise

import numpy as np
import pytest

from gesturegen.control import measures, schedule
from gesturegen.methods.motion_graph import global_search
from gesturegen.methods.motion_graph import search as motion_graph
from gesturegen.settings.control import Condition, Control
from gesturegen.settings.models import Config
from tests import naive, tiny
from tests.methods.motion_graph.test_global_search import check_optimal, close, random_prices, repetitive

# What a rest that is drawn out may change: what its frames earn, and whether they are shown again.
EARNED = "beat", "onset", "phrase", "keyword"


def random_demands(rng, n_frames: int, values) -> list[schedule.Demand]:
    """Up to three demands, hard and soft, that hold at times of their own."""
    found = []
    for place in range(int(rng.integers(1, 4))):
        key = list(values)[rng.integers(len(values))]
        start = int(rng.integers(n_frames))
        bound = float(rng.choice(values[key]))
        low, high = (bound, np.inf) if rng.random() < 0.5 else (-np.inf, bound)
        hard, price = bool(rng.random() < 0.5), float(rng.choice([0.5, 2.0, 30.0]))
        end = int(rng.integers(start + 1, n_frames + 1))
        found.append(schedule.Demand(place + 1, *key, low, high, start, end, hard, price, 0.5 + rng.random()))
    return found


def plain_price(demands, values, forbidden: float, moving: bool):
    """What showing a node in a frame costs, one demand after the other; hands that are held have no speed."""

    def price(frame: int, node: int) -> float:
        total = 0.0
        for one in demands:
            if not one.start_frame <= frame < one.end_frame:
                continue
            value = float(values[one.key][node]) if moving or one.measure != "speed" else 0.0
            outside = max(one.low - value, value - one.high, 0.0)
            total += (forbidden if outside > 0 else 0.0) if one.hard else one.price * outside / one.scale
        return total

    return price


def controlled(rng, graph, n_frames: int):
    """Random demands: as the search takes them, and as plain functions."""
    hands = rng.normal(size=(graph.n_nodes, 2, 3)).round(1)
    values = measures.hand_measures(hands, graph.segment_starts, graph.fps)
    demands, forbidden = random_demands(rng, n_frames, values), float(rng.choice([5.0, 1000.0]))
    still = {key: 0 * row if key[0] == "speed" else row for key, row in values.items()}
    states, sets = schedule.states(demands, n_frames)
    shown, held = (schedule.frame_prices(sets, demands, rows, forbidden) for rows in (values, still))
    plain = tuple(plain_price(demands, values, forbidden, moving) for moving in (True, False))
    return demands, (states, shown, np.maximum(held - shown, 0.0)), plain


def problems(rng, count: int, **sizes):
    """Prices of the global search with random control: (prices, plain objective, demands)."""
    for _ in range(count):
        prices = random_prices(rng, **sizes)
        demands, control, plain = controlled(rng, prices.graph, len(prices.speaking))
        states, shown, held = control
        prices = replace(prices, demanded=states, controlled=shown, controlled_held=held)
        yield prices, plain, demands


def test_equals_the_least_of_all_paths():
    rng = np.random.default_rng(0)
    tried = 0
    for prices, control, _ in problems(rng, 120, most_nodes=5, most_frames=5):
        plain = naive.Objective(prices, control)
        paths = list(islice(plain.all_paths(), 501))
        if len(paths) > 500:
            continue
        least = min(plain.cost(path)["total"] for path in paths)
        assert check_optimal(prices, control)[1]["total"] == close(least, 100)
        tried += 1
    assert tried > 60


def test_equals_the_naive_program():
    rng = np.random.default_rng(1)
    seen = Counter()
    for prices, control, demands in problems(rng, 120):
        _, cost = check_optimal(prices, control)
        seen["paid"] += cost.get("control", 0.0) > 0
        seen["hard"] += any(one.hard for one in demands)
        seen["soft"] += any(not one.hard for one in demands)
        seen["several sets"] += len(set(prices.demanded.tolist())) > 2
        seen["held"] += cost.get("held", 0.0) > 0
        seen["fast"] += any(one.measure == "speed" and one.low > 0 for one in demands)
    assert min(seen.values()) > 10, seen


def test_a_set_that_asks_nothing_changes_nothing_but_the_drawing_out_of_rests():
    rng = np.random.default_rng(3)
    for _ in range(10):
        graph, speech, config = repetitive(rng)
        nothing = np.zeros(speech.n_frames, dtype=int), *np.zeros((2, 1, graph.n_nodes))
        other = global_search.search(graph, speech, config, None, nothing)
        plain = global_search.search(graph, speech, config)
        assert other.first == close(plain.first) and other.final["control"] == 0.0
        apart = sum(plain.final[name] - other.final[name] for name in ("repeats", *EARNED))
        assert plain.final["total"] == close(other.final["total"] + apart)


def moving_graph(fast: int):
    """Sixty frames in which a left hand goes up, and between two of them jumps: so two nodes are fast."""
    positions = np.zeros((60, 2, 3))
    positions[:, 0, 1] = 0.1 * np.arange(60)
    positions[fast:, 0, 1] += 5.0
    graph = tiny.graph_of_positions(positions, rows=[(k, "onset") for k in range(5, 60, 10)])
    return replace(graph, joint_names=("left", "right"))


def test_a_fast_frame_that_is_held_is_not_fast():
    graph = moving_graph(30)
    asked = Condition(measure="speed", hand="left", at_least=50.0, to=0.5)
    # Holding is nearly free here: what keeps the search from it is the demand alone.
    settings = Config().global_search.model_copy(update={"lambda_hold": 0.01, "lambda_rest": 0.01})
    config = tiny.config(
        search="global", global_search=settings, control=Control(left="left", right="right", conditions=(asked,))
    )
    path = motion_graph.search(graph, tiny.speech(30, [10, 20]), config, np.random.default_rng(0))
    nodes = path.tracks[0].nodes
    assert not any(a == b == 30 for a, b in pairwise(nodes[:15])), nodes
    assert path.objective["final"]["control"] > 0


@pytest.mark.parametrize(("at_least", "at_most"), [(3.0, None), (None, 2.0)])
def test_the_method_shows_what_is_demanded(at_least, at_most):
    graph = moving_graph(30)
    asked = Condition(measure="height", hand="left", at_least=at_least, at_most=at_most)
    config = tiny.config(search="global", control=Control(left="left", right="right", conditions=(asked,)))
    path = motion_graph.search(graph, tiny.speech(20, [10]), config, np.random.default_rng(0))
    heights = graph.positions[path.tracks[0].nodes, 0, 1]
    assert (heights >= 3.0).all() if at_least else (heights <= 2.0).all()
    assert [demand.key for demand in path.demands] == [("height", "left")]
    assert path.objective["final"]["control"] == 0

"""Every term of the objective on paths whose price is known by hand."""

from dataclasses import replace

import numpy as np
import pytest

from gesturegen.methods.motion_graph import objective
from gesturegen.methods.motion_graph.objective import PriceList
from gesturegen.methods.motion_graph.rewards import Reward
from gesturegen.methods.motion_graph.settings import GlobalSearch
from gesturegen.settings.models import Continuity
from tests import naive, tiny

# Each price is another power of two, so that a sum tells what went into it.
PRICES = {
    "join_price": 4.0, "lambda_state": 8.0, "lambda_hold": 16.0, "lambda_rest": 32.0, "lambda_join": 256.0,
    "lambda_repeat": 512.0, "repeat_seconds": 0.0,
}  # fmt: skip
ONLY_POSITIONS = Continuity(lambda_vel=0.0)


def line(segment_starts=(0,), x=range(10), quiet=()):
    """A graph of one joint at the places `x` on a line."""
    positions = np.zeros((len(x), 1, 3))
    positions[:, 0, 0] = x
    graph = tiny.graph_of_positions(positions, segment_starts, l_cn=1)
    return replace(graph, speaking=~np.isin(np.arange(len(x)), quiet))


def price_list(graph, n_frames, silent=(), metric=ONLY_POSITIONS, rewards=(), used=None, **rules):
    config = tiny.config(continuity=metric, global_search=GlobalSearch(**(PRICES | rules)))
    speaking = ~np.isin(np.arange(n_frames), silent)
    return PriceList(graph, config, speaking, rewards, np.zeros(graph.n_nodes) if used is None else np.array(used))


def terms(graph, nodes, **given):
    """Each term that is not 0, by frame; checked by plain loops."""
    prices = price_list(graph, len(nodes), **given)
    restated = naive.Objective(prices).cost(nodes)
    total = objective.total(np.array(nodes), prices)
    assert set(total) == {*objective.TERMS, "total"}
    assert {name: value for name, value in total.items() if value or name == "total"} == pytest.approx(restated)
    return {name: values.tolist() for name, values in objective.terms(np.array(nodes), prices).items() if values.any()}


def test_a_natural_run_costs_nothing():
    assert terms(line(), [1, 2, 3, 4]) == {}
    assert terms(line(), [9]) == {}


def test_a_join_costs_its_price_and_the_distance_from_the_natural_successor():
    graph = line(x=[0, 1, 3, 6, 10, 15, 21, 28, 36, 45])
    # 2 would go on with 3, at 6; 5 is at 15.
    assert terms(graph, [2, 5]) == {"price": [0.0, 4.0], "distance": [0.0, 9 * 256.0]}
    # A step back.
    assert terms(graph, [2, 1, 2]) == {"price": [0.0, 4.0, 0.0], "distance": [0.0, 5 * 256.0, 0.0]}


def test_joins_weigh_velocities():
    graph = line(x=[0, 1, 3, 6, 10, 15, 21, 28, 36, 45])
    # From node 3, v = 3, to node 9, v = 9.
    costs = terms(graph, [2, 9], metric=Continuity(lambda_pos=0.5, lambda_vel=2.0))
    assert costs == {"price": [0.0, 4.0], "distance": [0.0, 256.0 * (0.5 * 39 + 2.0 * 6)]}


def test_a_segments_last_node_is_its_own_successor():
    graph = line(segment_starts=(0, 5), x=[0, 1, 2, 3, 4, 9, 10, 11, 12, 13])
    # The next node is of another segment, and a join; the last node again is held.
    assert terms(graph, [4, 5, 6]) == {"price": [0.0, 4.0, 0.0], "distance": [0.0, 5 * 256.0, 0.0]}
    assert terms(graph, [4, 4]) == {"held": [0.0, 16.0]}
    assert objective.joined(np.array([3, 4, 4, 5, 5, 6, 8]), graph).tolist() == [False] * 3 + [True] + [False] * 2 + [
        True
    ]


def test_state_counts_frames_that_differ_either_way():
    graph, path = line(quiet=[0, 1, 2]), [1, 2, 3, 4, 5]
    assert terms(graph, path, silent=[0, 1]) == {}
    assert terms(graph, path) == {"state": [8.0, 8.0, 0.0, 0.0, 0.0]}
    assert terms(graph, path, silent=[0, 1, 2, 3]) == {"state": [0.0, 0.0, 8.0, 8.0, 0.0]}


def test_a_held_frame_is_a_rest_where_both_pause():
    path = [3, 3, 3, 4, 5]
    quiet = line(quiet=[3])
    assert terms(quiet, path, silent=[0, 1, 2]) == {"held": [0.0, 32.0, 32.0, 0.0, 0.0]}
    assert terms(quiet, path, silent=[0, 1]) == {
        "held": [0.0, 32.0, 16.0, 0.0, 0.0], "state": [0.0, 0.0, 8.0, 0.0, 0.0]
    }  # fmt: skip
    assert terms(line(), path, silent=[0, 1, 2]) == {
        "held": [0.0, 16.0, 16.0, 0.0, 0.0], "state": [8.0, 8.0, 8.0, 0.0, 0.0]
    }  # fmt: skip


def test_rewards_are_products_and_what_is_held_earns_nothing():
    worth = np.zeros(10)
    worth[[3, 4]] = 5.0, -2.0
    beat = Reward("beat", np.array([1.0, 1.0, 2.0, 0.5]), worth)
    phrase = Reward("phrase", np.array([0.0, 0.0, 0.0, 3.0]), np.ones(10))
    assert terms(line(), [2, 3, 4, 5], rewards=(beat, phrase)) == {
        "beat": [0.0, -5.0, 4.0, 0.0], "phrase": [0.0, 0.0, 0.0, -3.0]
    }  # fmt: skip
    assert terms(line(), [3, 3, 3, 4], rewards=(beat,)) == {
        "beat": [-5.0, 0.0, 0.0, 1.0],
        "held": [0.0, 16.0, 16.0, 0.0],
    }
    # Rewards of one name add up.
    assert terms(line(), [2, 3, 4, 5], rewards=(beat, beat)) == {"beat": [0.0, -10.0, 8.0, 0.0]}


def test_what_earlier_variants_show_costs():
    assert terms(line(), [7, 8, 9], used=np.arange(10) == 8) == {"used": [0.0, 1.0, 0.0]}


def test_a_condition_is_a_cost_per_frame_and_more_where_it_is_held():
    prices = price_list(line(), 4)
    shown, held = np.zeros((2, 10)), np.zeros((2, 10))
    shown[1, 3], held[1, 3] = 7.0, 2.0
    prices = replace(prices, demanded=np.array([0, 1, 1, 0]), controlled=shown, controlled_held=held)
    assert objective.terms(np.array([2, 3, 3, 3]), prices)["control"].tolist() == [0.0, 7.0, 9.0, 0.0]
    assert prices.states.tolist() == [1, 3, 3, 1]
    assert prices.shown.shape == prices.holding.shape == (4, 10) and prices.shown[3, 3] == 7.0
    assert prices.holding[3, 3] == prices.holding[1, 3] + 2.0


def repeated(nodes, seconds, segment_starts=(0,)):
    graph = line(segment_starts, x=range(60))
    found = objective.repeated(np.array(nodes), graph, seconds).tolist()
    plain = naive.Objective(price_list(graph, len(nodes), repeat_seconds=seconds))
    assert found == plain.repeated(nodes)
    return np.flatnonzero(found).tolist()


def test_repeats_are_frames_near_what_another_stay_showed_a_short_while_before():
    assert repeated([1, 2, 3, 4, 5], 10.0) == [], "a stay does not repeat itself"
    assert repeated([10, 10, 10], 10.0) == [], "nor does what is held"
    assert repeated([10, 11, 30, 31, 10, 11], 10.0) == [4, 5]
    assert (
        repeated([10, 30, 13], 10.0) == [2] and repeated([10, 30, 14], 10.0) == [] and repeated([10, 30, 7], 1.0) == [2]
    )
    # Three frames ago, at 30 frames a second, is 0.1 s; that is long enough ago.
    assert repeated([10, 30, 50, 10], 0.1) == [] and repeated([10, 30, 50, 10], 0.1001) == [3]
    assert repeated([10, 12], 10.0) == [1], "a jump of two frames shows the same moment"
    assert repeated([4, 5], 10.0, (0, 5)) == [1], "and so does one across a break"
    assert repeated([10, 30, 10], 0.0) == []


def test_repeats_equal_plain_loops():
    rng = np.random.default_rng(0)
    counts = 0
    for _ in range(60):
        nodes = [int(rng.integers(60))]
        while len(nodes) < 50:
            draw = rng.random()
            nodes.append(int(rng.integers(60)) if draw < 0.15 else min(nodes[-1] + (draw < 0.9), 59))
        counts += len(repeated(nodes, float(rng.choice([0.1, 0.5, 10.0])), (0, 30)))
    assert counts > 300


def test_the_price_of_repeats_is_by_frame():
    costs = terms(line(), [1, 5, 1, 2], repeat_seconds=1.0)
    assert costs["repeats"] == [0.0, 0.0, 512.0, 512.0]

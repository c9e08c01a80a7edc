"""The beam search of one piece against a naive one and against enumeration."""

from fractions import Fraction

import numpy as np
import pytest

from gesturegen.methods.motion_graph import beam
from gesturegen.methods.motion_graph.settings import Beam
from tests import naive, tiny


def search(graph, stops, starts, target, natural_start=-1, **rules):
    marked = np.zeros(graph.n_nodes, dtype=bool)
    marked[list(stops)] = True
    nodes, cost = beam.search(graph, marked, np.array(starts), target, Beam(**rules), natural_start)
    return (None if nodes is None else nodes.tolist()), cost


def chain(n_nodes, edges=()):
    return tiny.graph_of_edges(n_nodes, dict(edges))


def test_a_natural_run_to_a_stop_node_costs_nothing():
    assert search(chain(20), [9], [5], 5) == ([5, 6, 7, 8, 9], 0.0)


def test_the_cost_is_weights_and_relative_length():
    graph = chain(20, {(6, 8): 0.25})
    nodes, cost = search(graph, [15], [5], 10, lambda_w=2.0, lambda_len=3.0)
    # 5 6 8 9 ... 15: ten nodes; 5 6 7 ... 15: eleven nodes and no weight, 3 * 0.1 against 2 * 0.25.
    assert nodes == list(range(5, 16)) and cost == pytest.approx(0.3)
    nodes, cost = search(graph, [15], [5], 10, lambda_w=1.0, lambda_len=3.0)
    assert nodes == [5, 6, *range(8, 16)] and cost == pytest.approx(0.25)


def test_too_short_and_too_long_paths_are_not_accepted():
    for end, expected in ((7, None), (8, 9), (9, 10), (10, 11), (11, None)):
        nodes, cost = search(chain(30), [end], [0], 10)
        assert (len(nodes) if nodes else None) == expected
        assert nodes is not None or cost == np.inf


def test_accepted_lengths_are_exact_fractions():
    for target in range(1, 201):
        shortest, longest = beam.accepted_lengths(target, Beam())
        inside = [n for n in range(1, 300) if Fraction(9, 10) * target <= n <= Fraction(11, 10) * target]
        assert (shortest, longest) == (inside[0], inside[-1])


def test_a_start_on_a_stop_node_is_no_path_yet():
    assert search(chain(10), [0, 4], [0], 5)[0] == [0, 1, 2, 3, 4]


def test_a_piece_of_one_frame_takes_one_node():
    assert search(chain(10), [4, 7], [2, 4, 7], 1) == ([4], 0.0)
    assert search(chain(10), [4], [2, 3], 1) == (None, np.inf)


def test_a_piece_of_two_frames_takes_two_nodes():
    assert search(chain(10), [4, 5], [4], 2) == ([4, 5], 0.0)


def test_a_terminated_path_is_not_extended():
    # The only way to a path of five nodes leads through the stop node 2.
    assert search(chain(10), [2, 4], [0], 5) == (None, np.inf)


def test_a_terminated_path_stays_in_the_beam():
    # The path from 0 stops at nine nodes; the beam goes on to eleven for the one from 20, with it inside.
    assert search(chain(40), [8, 30], [0, 20], 10, l_npaths=2) == ([*range(9)], pytest.approx(0.1))


def test_terminated_but_unacceptable_paths_keep_their_place():
    # 0 20 stops after two nodes and, being cheap, holds the only place of a beam of one.
    edges = {(0, 1): 9.0, (0, 20): 0.0} | {(node, node + 1): 0.0 for node in range(1, 39)}
    graph = tiny.graph_of_edges(40, edges, natural=False)
    assert search(graph, [20, 9], [0], 10, l_npaths=1) == (None, np.inf)
    assert search(graph, [20, 9], [0], 10, l_npaths=2) == ([*range(10)], 9.0)


def test_dead_ends_drop_out():
    # Node 5 ends its segment; only the start in the other segment gets far enough.
    graph = tiny.graph_of_edges(30, {}, segment_starts=(0, 6))
    assert search(graph, [5, 16], [3, 7], 10)[0] == list(range(7, 17))
    assert search(graph, [16], [3], 10) == (None, np.inf)


def test_a_dead_end_leaves_its_place_to_others():
    graph = tiny.graph_of_edges(6, {(0, 1): 0.0, (0, 2): 0.5, (2, 3): 0.0, (3, 4): 0.0}, natural=False)
    # 0 1 is cheaper than 0 2 and dead; a beam of one loses the way, one of two finds it.
    assert search(graph, [4], [0], 4, l_npaths=1) == (None, np.inf)
    assert search(graph, [4], [0], 4, l_npaths=2) == ([0, 2, 3, 4], 0.5)


def test_the_natural_start_comes_first_among_equals():
    graph = tiny.graph_of_edges(30, {}, segment_starts=(0, 10, 20))
    stops, starts = [6, 16, 26], [2, 12, 22]
    assert search(graph, stops, starts, 5)[0] == [2, 3, 4, 5, 6]
    for natural in starts:
        assert search(graph, stops, starts, 5, natural)[0][0] == natural
    # But not among unequal ones.
    assert search(graph, [6, 15], [2, 12], 5, 12)[0][0] == 2
    # It has its place in a beam of one.
    assert search(graph, stops, starts, 5, 22, l_npaths=1)[0][0] == 22


def test_lower_nodes_come_first_among_equals():
    graph = tiny.graph_of_edges(5, {(0, 3): 0.5, (0, 2): 0.5, (3, 4): 0.0, (2, 4): 0.0}, natural=False)
    assert search(graph, [4], [0], 3)[0] == [0, 2, 4]


def test_more_starts_than_the_beam_is_wide():
    assert search(chain(60), [59], range(60), 2, l_npaths=3) == (None, np.inf)
    assert search(chain(60), [59], range(60), 2, l_npaths=60)[0] == [58, 59]


def test_a_self_loop_can_be_walked():
    graph = tiny.graph_of_edges(3, {(0, 0): 0.25, (0, 1): 0.0}, natural=False)
    assert search(graph, [1], [0], 4, l_npaths=10) == ([0, 0, 0, 1], 0.5)


def test_no_stop_node_means_no_path():
    assert search(chain(20), [], [0, 5], 4) == (None, np.inf)


def random_case(rng):
    n_nodes = int(rng.integers(1, 10))
    graph = tiny.random_graph(rng, n_nodes)
    stops = rng.random(n_nodes) < rng.choice([0.1, 0.2, 0.5])
    starts = rng.permutation(n_nodes)[: rng.integers(1, n_nodes + 1)]
    natural = int(rng.choice([-1, *starts]))
    return graph, stops, starts, natural


def test_equals_the_naive_beam_on_random_graphs():
    rng = np.random.default_rng(0)
    found = 0
    for _ in range(3000):
        graph, stops, starts, natural = random_case(rng)
        target = int(rng.integers(1, 14))
        rules = Beam(
            l_npaths=int(rng.choice([1, 2, 3, 5, 20])), lambda_w=float(rng.choice([0.0, 0.5, 1.0])),
            lambda_len=float(rng.choice([0.0, 0.7, 1.0])), min_ratio=float(rng.choice([0.9, 0.5])),
            max_ratio=float(rng.choice([1.1, 1.5])),
        )  # fmt: skip
        nodes, cost = beam.search(graph, stops, starts, target, rules, natural)
        expected, expected_cost = naive.beam(naive.children_of(graph), stops, starts, target, rules, natural)
        assert (None if nodes is None else tuple(nodes.tolist()), cost) == (expected, expected_cost)
        found += nodes is not None
    assert 500 < found < 2500


def test_a_huge_beam_equals_enumeration():
    rng = np.random.default_rng(1)
    found = 0
    for _ in range(400):
        n_nodes = int(rng.integers(1, 6))
        graph = tiny.random_graph(rng, n_nodes)
        stops = rng.random(n_nodes) < 0.3
        starts = rng.permutation(n_nodes)[: rng.integers(1, n_nodes + 1)]
        target, natural = int(rng.integers(1, 7)), int(rng.choice([-1, *starts]))
        rules = Beam(l_npaths=100_000, max_ratio=float(rng.choice([1.1, 1.4])))
        paths = naive.all_accepted(naive.children_of(graph), stops, starts, target, rules)
        best = min(
            ((naive.cost_of(total, len(nodes), target, rules), nodes[0] != natural, nodes) for nodes, total in paths),
            default=(np.inf, True, None),
        )
        nodes, cost = beam.search(graph, stops, starts, target, rules, natural)
        assert (cost, None if nodes is None else tuple(nodes.tolist())) == (best[0], best[2])
        found += nodes is not None
    assert found > 100


def test_a_path_follows_edges_and_stops_only_at_its_end():
    rng = np.random.default_rng(2)
    for _ in range(500):
        graph, stops, starts, natural = random_case(rng)
        target = int(rng.integers(1, 14))
        nodes, cost = beam.search(graph, stops, starts, target, Beam(l_npaths=5), natural)
        if nodes is None:
            continue
        edges = naive.edges_of(graph)
        steps = list(zip(nodes[:-1].tolist(), nodes[1:].tolist(), strict=True))
        assert nodes[0] in starts and stops[nodes[-1]] and not stops[nodes[1:-1]].any()
        assert cost == pytest.approx(sum(edges[step] for step in steps) + abs(1 - len(nodes) / target))


def test_the_inputs_do_not_change():
    graph, stops, starts = chain(20), np.zeros(20, dtype=bool), np.array([5, 3, 1])
    stops[9] = True
    beam.search(graph, stops, starts, 5, Beam())
    assert starts.tolist() == [5, 3, 1] and np.flatnonzero(stops).tolist() == [9]

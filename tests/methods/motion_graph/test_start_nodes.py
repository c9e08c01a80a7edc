"""Where pieces may start: feature distances and the walk through the ranking."""

import numpy as np
import pytest

from gesturegen.methods.motion_graph.settings import Features
from gesturegen.methods.motion_graph.start_nodes import StartNodes, feature_distances, graph_features
from tests import naive, tiny

THREE = Features(l_feat=3, w_full=(1.0, 0.5, 0.5))
PRINTED = Features(l_feat=3, w_full=(1.0, 0.5, 0.5), align="as_printed")


def distances(test, graph, occurrences=None, rules=THREE):
    graph = np.array(graph, dtype=float)
    counts = np.zeros(len(graph)) if occurrences is None else np.array(occurrences, dtype=float)
    return feature_distances(np.array(test, dtype=float), graph, counts, rules).tolist()


def graph(rows, n_nodes=50, segment_starts=(0,)):
    return tiny.graph_of_edges(n_nodes, {}, rows, segment_starts)


ONSETS = [(frame, "onset") for frame in range(1, 49, 2)]


def test_graph_features_stay_inside_segments():
    found = graph_features(graph([(3, "onset"), (8, "onset"), (22, "onset")], 30, (0, 11, 20)), THREE)
    # Key nodes 3, 8, 10 (break), 19 (break), 22, 29 (break)
    assert found.tolist() == [[5, 2, 0], [2, 0, 0], [0, 0, 0], [0, 0, 0], [7, 0, 0], [0, 0, 0]]
    printed = graph_features(graph([(3, "onset"), (8, "onset"), (22, "onset")], 30, (0, 11, 20)), PRINTED)
    assert printed.tolist() == [[3, 5, 2], [5, 2, 0], [2, 0, 0], [8, 0, 0], [2, 7, 0], [7, 0, 0]]


def test_distance_by_hand():
    # full: |(3, 0.5 * 8, 0)| = 5; first: |1 - 8 / 5|
    assert distances([5, 10, 4], [[8, 18, 4]]) == pytest.approx([5 + 0.6])
    rules = Features(l_feat=3, w_full=(1.0, 0.5, 0.5), lambda_full=2.0, lambda_first=10.0, lambda_occ=0.5)
    assert distances([5, 10, 4], [[8, 18, 4]], [3], rules) == pytest.approx([10 + 6 + 1.5])


def test_equal_features_are_at_distance_zero_until_used():
    assert distances([5, 10, 4], [[5, 10, 4]] * 3, [0, 1, 2]) == [0.0, 0.5, 1.0]


def test_a_zero_first_element_divides_as_one():
    rules = Features(l_feat=3, w_full=(1.0, 0.5, 0.5), lambda_full=0.0)
    assert distances([0, 7, 7], [[0, 1, 1], [1, 1, 1], [4, 1, 1]], rules=rules) == [1.0, 0.0, 3.0]


def test_distances_equal_the_naive_ones():
    rng = np.random.default_rng(0)
    rules = Features()
    for _ in range(100):
        test, others = rng.integers(0, 30, size=10), rng.integers(0, 30, size=(20, 10))
        test[0] += 1
        counts = rng.integers(0, 5, size=20)
        expected = [naive.feature_distance(test, o, int(c), rules) for o, c in zip(others, counts, strict=True)]
        assert distances(test, others, counts, rules) == expected


def walk(costs, steps, rows=ONSETS, n_nodes=50, seed=0, **sections):
    made = graph(rows, n_nodes)
    nodes = StartNodes(made, np.array(costs, dtype=float), tiny.config(**sections), np.random.default_rng(seed))
    return made, nodes, [nodes.next().tolist() for _ in range(steps)]


def test_the_ranking_is_walked_step_by_step_with_ties_by_frame():
    costs = [1.0] * 25
    costs[4] = 0.0
    _, nodes, steps = walk(costs, 3, beam={"l_npaths": 8})
    frames = [*range(1, 49, 2), 49]
    ranking = [9, *frames[:4], *frames[5:]]
    assert steps == [ranking[:8], ranking[8:16], ranking[16:24]]
    assert nodes.best == 9


def test_random_nodes_come_when_too_few_key_nodes_are_left():
    _, _, steps = walk(range(25), 4)
    # 25 key nodes serve one step of 20; the 5 that are left are not handed out.
    assert steps[0] == list(range(1, 41, 2))
    for nodes in steps[1:]:
        assert len(nodes) == len(set(nodes)) == 20 and set(nodes) <= set(range(50))
    assert steps[1] != steps[2]
    rng = np.random.default_rng(0)
    assert steps[1:] == [rng.choice(50, size=20, replace=False).tolist() for _ in range(3)]


def test_exactly_twenty_left_are_enough():
    rows = [(frame, "onset") for frame in range(1, 20)]
    _, _, steps = walk(range(20), 1, rows)
    assert steps[0] == [*range(1, 20), 49]


def test_random_nodes_are_at_most_all_nodes():
    _, _, steps = walk([0.0, 0.0], 2, [(2, "onset")], n_nodes=7)
    assert [sorted(nodes) for nodes in steps] == [list(range(7))] * 2


def test_random_initialization_ignores_the_ranking_but_knows_the_best():
    _, nodes, steps = walk([*range(25, 0, -1)], 1, initialization="random")
    assert steps[0] == np.random.default_rng(0).choice(50, size=20, replace=False).tolist()
    assert nodes.best == 49

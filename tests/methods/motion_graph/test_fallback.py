"""What gives way, retry by retry, when a piece finds no path."""

import itertools

import numpy as np
import pytest

from gesturegen.methods.motion_graph.fallback import StopNodes
from gesturegen.methods.motion_graph.settings import Termination
from tests import tiny

N = 200
KEYWORDS = (3, 70)
ONSETS = tuple(range(10, 60))


@pytest.fixture
def graph():
    rows = [*((f, "keyword", "greeting") for f in KEYWORDS), *((f, "onset") for f in ONSETS)]
    return tiny.graph_of_edges(N, {}, rows, (0, 100))


RHYTHMIC = {*ONSETS, 99, 199}


def attempts(graph, keyword="", count=41, seed=0, **rules):
    """Stop nodes and fallback of each attempt."""
    stops = StopNodes(graph, keyword, Termination(**rules), np.random.default_rng(seed))
    return [(set(np.flatnonzero(stops.for_attempt(retry)).tolist()), stops.fallback) for retry in range(count)]


def test_the_keyword_is_kept_for_five_retries(graph):
    found = attempts(graph, "greeting", 11)
    assert found[:6] == [(set(KEYWORDS), None)] * 6
    assert found[6:] == [(RHYTHMIC, "keyword")] * 5


def test_a_keyword_that_the_reference_lacks_waits_too(graph):
    found = attempts(graph, "direction", 8)
    assert found[:6] == [(set(), None)] * 6 and found[6] == (RHYTHMIC, "keyword")


def test_rhythmic_pieces_keep_their_stops_for_ten_retries(graph):
    assert attempts(graph, count=11) == [(RHYTHMIC, None)] * 11


def test_from_the_eleventh_retry_a_tenth_is_dropped(graph):
    found = attempts(graph, count=41)
    assert len(found[40][0]) == 1
    for (before, _), (after, fallback) in itertools.pairwise(found[10:31]):
        assert after < before and fallback == "discard"
        assert len(before) - len(after) == max(1, len(before) // 10)


def test_discarding_follows_the_keyword(graph):
    found = attempts(graph, "greeting", 13)
    assert [fallback for _, fallback in found[9:]] == ["keyword", "keyword", "discard", "discard"]
    assert len(found[11][0]) == len(RHYTHMIC) - 5


def test_the_last_stop_node_stays():
    graph = tiny.graph_of_edges(10, {}, [(4, "onset"), (6, "onset")])
    found = attempts(graph, count=30)
    assert [len(stops) for stops, _ in found[10:16]] == [3, 2, 1, 1, 1, 1]
    assert len({frozenset(stops) for stops, _ in found[12:]}) == 1


def test_a_single_stop_node_is_no_discard():
    assert attempts(tiny.graph_of_edges(5, {}), count=20) == [({4}, None)] * 20


def test_what_is_dropped_is_drawn_from_the_generator(graph):
    assert attempts(graph, seed=1) == attempts(graph, seed=1)
    assert attempts(graph, seed=1) != attempts(graph, seed=2)
    rng = np.random.default_rng(7)
    left = sorted(RHYTHMIC)
    dropped = set(rng.choice(np.array(left), size=5, replace=False).tolist())
    assert attempts(graph, count=12, seed=7)[11][0] == RHYTHMIC - dropped


def test_without_fallbacks_nothing_gives_way(graph):
    assert attempts(graph, "greeting", 60, fallbacks=False) == [(set(KEYWORDS), None)] * 60
    assert attempts(graph, "", 60, fallbacks=False) == [(RHYTHMIC, None)] * 60


def test_forty_retries_with_fallbacks_and_four_hundred_without(graph):
    rng = np.random.default_rng(0)
    assert StopNodes(graph, "", Termination(), rng).last_retry == 40
    assert StopNodes(graph, "", Termination(fallbacks=False), rng).last_retry == 400


def test_the_keyword_gives_way_even_where_discarding_begins_earlier(graph):
    # Retry 3 drops one of the two keyword nodes; from retry 6 on the rhythmic stops count all the same.
    found = attempts(graph, "greeting", 7, discard_after_retries=2)
    assert len(found[3][0]) == 1 and len(found[6][0]) > 2


def test_the_graphs_own_stop_nodes_do_not_change(graph):
    before = graph.stop_nodes(None)
    attempts(graph)
    np.testing.assert_array_equal(graph.stop_nodes(None), before)

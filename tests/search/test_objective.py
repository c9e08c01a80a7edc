"""Every term of the objective on paths whose price is known by hand."""

from dataclasses import replace

import numpy as np
import pytest

from gesturegen.config import Continuity, GlobalSearch
from gesturegen.search import objective
from gesturegen.search.objective import PriceList
from gesturegen.search.path import CUT, Piece, Target
from tests import naive, tiny

# Each price is another power of two, so that a sum tells what went into it.
PRICES = {
    "lambda_w": 1.0, "lambda_len": 2.0, "lambda_pass": 4.0, "lambda_state": 8.0, "lambda_hold": 16.0,
    "lambda_rest": 32.0, "lambda_end": 64.0, "lambda_keyword": 128.0, "lambda_join": 256.0, "lambda_repeat": 512.0,
}  # fmt: skip
ONLY_POSITIONS = Continuity(lambda_vel=0.0)


def line(rows=(), segment_starts=(0,), x=range(10), quiet=()):
    """A graph of one joint at the places `x` on a line, without unnatural edges."""
    positions = np.zeros((len(x), 1, 3))
    positions[:, 0, 0] = x
    graph = tiny.graph_of_positions(positions, segment_starts, rows, l_cn=1)
    assert graph.natural.all()
    return replace(graph, speaking=~np.isin(np.arange(len(x)), quiet))


def terms(graph, pieces, silent=(), metric=ONLY_POSITIONS):
    """Of pieces (nodes, length, end_kind, keyword), each term that is not 0, by piece; checked by plain loops."""
    built, frame = [], 0
    for nodes, length, *end in pieces:
        built.append(Piece(Target(frame, frame + length, *end), np.array(nodes), 0.0))
        frame += length
    speaking = ~np.isin(np.arange(frame), silent)
    config = tiny.config(continuity=metric, global_search=GlobalSearch(**PRICES))
    prices = PriceList(graph, config.global_search, metric)
    plain = naive.Objective(graph, [piece.target for piece in built], speaking, config)
    restated = plain.cost([piece.nodes.tolist() for piece in built])
    total = objective.total(built, prices, speaking)
    assert total == pytest.approx({name: restated[name] for name in total})
    assert set(total) == {*objective.TERMS, "total"}
    costs = objective.terms(built, prices, speaking)
    assert tuple(costs) == objective.PIECE_TERMS
    return {name: values.tolist() for name, values in costs.items() if values.any()}


def test_a_natural_run_to_an_onset_costs_nothing():
    assert terms(line([(4, "onset")]), [([1, 2, 3, 4], 4, "onset")]) == {}


def test_length_counts_by_its_share_of_the_target():
    graph = line([(4, "onset")])
    assert terms(graph, [([1, 2, 3, 4], 5, "onset")]) == {"length": [pytest.approx(0.4)]}
    assert terms(graph, [([2, 3, 4], 2, "onset")]) == {"length": [1.0]}


def test_edges_count_with_their_weight():
    graph = tiny.graph_of_edges(10, {(1, 6): 0.25, (7, 3): 0.5}, [(3, "onset")])
    assert terms(graph, [([0, 1, 6, 7, 3], 5, "onset")]) == {"edges": [0.75]}


def test_key_nodes_cost_when_left_in_speech():
    graph = line([(1, "onset"), (3, "keyword", "greeting"), (6, "onset")])
    path = [([0, 1, 2, 3, 4, 5, 6], 7, "onset")]
    # Its own end, node 6, is not run over.
    assert terms(graph, path) == {"passed": [8.0]}
    # State is judged as well: 8 for each frame that rests against the reference's speech.
    assert terms(graph, path, silent=[3]) == {"passed": [4.0], "state": [8.0]}
    assert terms(graph, path, silent=[2, 4]) == {"passed": [8.0], "state": [16.0]}


def test_a_key_node_held_is_left_once_and_a_segment_end_by_an_edge_too():
    graph = line([(1, "onset"), (3, "onset")])
    assert terms(graph, [([1, 1, 1, 2, 3], 5, "onset")]) == {"passed": [4.0], "held": [32.0]}
    graph = tiny.graph_of_edges(10, {(4, 7): 0.5}, [(8, "onset")], segment_starts=(0, 5))
    assert terms(graph, [([3, 4, 7, 8], 4, "onset")]) == {"passed": [4.0], "edges": [0.5]}


def test_a_key_node_at_a_piece_border_is_free():
    graph = line([(1, "onset"), (3, "onset")])
    assert terms(graph, [([0, 1], 2, "onset"), ([2, 3], 2, "onset")]) == {}
    assert terms(graph, [([1], 1, "onset"), ([2, 3], 2, "onset")]) == {}


def test_state_counts_frames_that_differ_either_way():
    graph = line([(5, "onset")], quiet=[0, 1, 2])
    path = [([1, 2, 3, 4, 5], 5, "onset")]
    assert terms(graph, path, silent=[0, 1]) == {}
    assert terms(graph, path) == {"state": [16.0]}
    assert terms(graph, path, silent=[0, 1, 2, 3]) == {"state": [16.0]}


def test_nodes_beyond_the_target_are_judged_at_its_last_frame():
    graph = line([(5, "onset")], quiet=[3, 4, 5])
    long = [([2, 3, 4, 5], 2, "onset"), ([2], 1, CUT)]
    # Nodes 4 and 5 are shown at frame 1, not at frames 2 and 3; joined is node 6 to node 2.
    costs = terms(graph, long, silent=[1])
    assert costs == {"length": [2.0, 0.0], "joins": [0.0, 4 * 256.0]}
    costs = terms(graph, long, silent=[2])
    assert costs == {"length": [2.0, 0.0], "joins": [0.0, 4 * 256.0], "state": [3 * 8.0, 8.0]}


def test_a_held_frame_is_a_rest_where_both_pause():
    path = [([3, 3, 3, 4, 5], 5, "onset")]
    quiet = line([(5, "onset")], quiet=[3])
    assert terms(quiet, path, silent=[0, 1, 2]) == {"held": [64.0]}
    # The step from frame 1 to 2 is judged at frame 2.
    assert terms(quiet, path, silent=[0, 1]) == {"held": [32.0 + 16.0], "state": [8.0]}
    assert terms(quiet, path, silent=[1, 2]) == {"held": [64.0], "state": [8.0]}
    assert terms(line([(5, "onset")]), path, silent=[0, 1, 2]) == {"held": [32.0], "state": [24.0]}


def test_an_end_is_an_onset_or_a_segment_end():
    graph = line([(4, "onset"), (6, "keyword", "greeting")], segment_starts=(0, 8))
    for node, price in ((4, None), (7, None), (9, None), (6, 64.0), (5, 64.0)):
        expected = {} if price is None else {"end": [price]}
        assert terms(graph, [([node], 1, "onset")]) == expected
        assert terms(graph, [([node], 1, "break")]) == expected


def test_a_cut_part_may_end_anywhere():
    graph = line([(4, "onset")])
    assert all(terms(graph, [([node], 1, CUT)]) == {} for node in range(10))


def test_a_keyword_piece_ends_at_its_keyword_else_at_a_stop_node():
    rows = [(2, "keyword", "greeting"), (4, "onset"), (6, "keyword", "counting")]
    graph = line(rows)
    ends = {node: terms(graph, [([node], 1, "keyword", "greeting")]) for node in range(10)}
    assert ends[2] == {} and ends[4] == ends[9] == {"keyword": [128.0]}
    assert all(ends[node] == {"end": [64.0], "keyword": [128.0]} for node in (0, 1, 3, 5, 6, 7, 8))
    assert terms(graph, [([4], 1, "keyword", "absent")]) == {"keyword": [128.0]}


def test_joins_count_from_the_successor_and_with_the_piece_they_lead_into():
    graph = line([(2, "onset"), (5, "onset")], x=[0, 1, 3, 6, 10, 15, 21, 28, 36, 45])
    # 2 would go on with 3; 5 is 15 - 6 = 9 further, 3 itself is no way.
    assert terms(graph, [([2], 1, "onset"), ([5], 1, "onset")]) == {"joins": [0.0, 9 * 256.0]}
    assert terms(graph, [([2], 1, "onset"), ([3, 4, 5], 3, "onset")]) == {}
    # To begin with the last node again is a step back, and no hold.
    assert terms(graph, [([2], 1, "onset"), ([2], 1, "onset")]) == {"joins": [0.0, 3 * 256.0]}


def test_joins_weigh_velocities():
    graph = line([(2, "onset")], x=[0, 1, 3, 6, 10, 15, 21, 28, 36, 45])
    # From node 3, v = 3, to node 9, v = 9.
    costs = terms(graph, [([2], 1, "onset"), ([9], 1, "break")], metric=Continuity(lambda_pos=0.5, lambda_vel=2.0))
    assert costs == {"joins": [0.0, 256.0 * (0.5 * 39 + 2.0 * 6)]}


def test_a_segment_end_is_its_own_successor():
    graph = line([(7, "onset")], segment_starts=(0, 5), x=[0, 1, 2, 3, 4, 9, 10, 11, 12, 13])
    # The next node is of another segment, and a jump.
    assert terms(graph, [([4], 1, "onset"), ([5, 6, 7], 3, "onset")]) == {"joins": [0.0, 5 * 256.0]}
    assert terms(graph, [([4], 1, "onset"), ([3, 4], 2, "onset")]) == {"joins": [0.0, 256.0]}


def test_to_start_again_at_a_segment_end_is_to_hold_it():
    graph = line([], segment_starts=(0, 5), quiet=[4])
    twice = [([4], 1, "onset"), ([4], 1, "break")]
    assert terms(graph, twice, silent=[0, 1]) == {"held": [0.0, 32.0]}
    assert terms(graph, twice, silent=[0]) == {"held": [0.0, 16.0], "state": [0.0, 8.0]}
    # It is judged at the first frame of the next piece.
    assert terms(graph, twice, silent=[1]) == {"held": [0.0, 32.0], "state": [8.0, 0.0]}


def pieces_of(*runs):
    targets = [Target(frame, frame + 1, CUT) for frame in range(len(runs))]
    return [Piece(target, np.array(nodes), 0.0) for target, nodes in zip(targets, runs, strict=True)]


def test_stays_count_how_often_pieces_come_to_a_node():
    assert objective.stays(pieces_of([1, 1, 3, 1, 0, 0]), 6).tolist() == [1, 2, 0, 1, 0, 0]
    assert objective.stays(pieces_of([1, 1], [1], [2, 1]), 3).tolist() == [0, 3, 1]
    assert objective.stays([], 3).tolist() == [0, 0, 0]


def test_repeats_are_pairs_of_stays():
    graph = line([(3, "onset")], segment_starts=(0, 5))
    prices = PriceList(graph, GlobalSearch(**PRICES), ONLY_POSITIONS)
    speaking = np.ones(8, dtype=bool)
    counts = {
        ((0, 1, 2),): 0, ((0, 0, 0),): 0, ((0, 1, 2), (0,)): 1, ((4,), (4,), (4,)): 3, ((3, 4), (3, 3, 4)): 2,
        ((0,), (1, 2), (0, 1), (0,), (0,)): 7,
    }  # fmt: skip
    for runs, pairs in counts.items():
        assert objective.total(pieces_of(*runs), prices, speaking)["repeats"] == 512.0 * pairs, runs


def test_a_piece_of_one_node_has_no_steps():
    assert terms(line([(4, "onset")]), [([4], 3, "onset")]) == {"length": [pytest.approx(4 / 3)]}


def test_the_prices_of_nodes():
    rows = [(2, "keyword", "greeting"), (4, "onset")]
    prices = PriceList(line(rows, segment_starts=(0, 7), quiet=[0, 4]), GlobalSearch(**PRICES), ONLY_POSITIONS)
    key, quiet = np.isin(np.arange(10), [2, 4, 6, 9]), np.isin(np.arange(10), [0, 4])
    assert prices.passing.tolist() == [[0.0] * 10, (4.0 * key).tolist()]
    assert prices.shown.tolist() == [(8.0 * ~quiet).tolist(), (8.0 * quiet).tolist()]
    assert prices.holding.tolist() == [np.where(quiet, 32.0, 16.0).tolist(), [16.0] * 10]
    end, other = prices.end_prices(Target(0, 5, "keyword", "greeting"))
    assert end.tolist() == (64.0 * ~key).tolist()
    assert other.tolist() == (128.0 * (np.arange(10) != 2)).tolist()

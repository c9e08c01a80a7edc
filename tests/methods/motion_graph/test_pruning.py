"""The two pruning rules on hand-made candidates."""

import numpy as np
import pytest

from gesturegen.methods.motion_graph import pruning
from tests import naive


def thin(pairs, l_pn, starts=(0,), n_frames=100):
    lefts, rights = np.array(pairs, dtype=np.int64).reshape(-1, 2).T.copy()
    keep = pruning.thin_runs(lefts, rights, np.array(starts), n_frames, l_pn)
    return [pair for pair, kept in zip(pairs, keep, strict=True) if kept]


def drop(pairs, l_pn, starts=(0,), n_frames=100):
    lefts, rights = np.array(pairs, dtype=np.int64).reshape(-1, 2).T.copy()
    keep = pruning.drop_neighbours(lefts, rights, np.array(starts), n_frames, l_pn)
    return [pair for pair, kept in zip(pairs, keep, strict=True) if kept]


def test_a_run_keeps_the_first_of_every_block():
    pairs = [(0, right) for right in range(50, 57)]
    assert thin(pairs, 3) == [(0, 50), (0, 53), (0, 56)]
    assert thin(pairs, 1) == pairs
    assert thin(pairs, 10) == [(0, 50)]


def test_a_gap_or_another_left_begins_a_new_run():
    assert thin([(0, 50), (0, 51), (0, 53), (0, 54)], 10) == [(0, 50), (0, 53)]
    assert thin([(0, 50), (1, 51), (1, 52)], 10) == [(0, 50), (1, 51)]


def test_a_run_ends_with_its_segment():
    assert thin([(0, 50), (0, 51), (0, 52), (0, 53)], 10, starts=(0, 52)) == [(0, 50), (0, 52)]


def test_natural_edges_remove_what_lies_near():
    # 10 -> 11 leads from within 3 of 10 to within 3 of r exactly for r <= 10 + 7: a = 13, b = 14.
    assert drop([(10, 16), (10, 17), (10, 18)], 3) == [(10, 18)]


def test_natural_edges_remove_backward_candidates_too():
    # Roles swapped: from near 20 back to near 13 lies the natural edge 16 -> 17.
    assert drop([(20, 12)], 3) == [(20, 12)]
    assert drop([(20, 13)], 3) == []


def test_a_kept_edge_removes_its_neighbours():
    assert drop([(10, 50), (12, 52)], 2) == [(10, 50)]
    assert drop([(10, 50), (13, 50)], 2) == [(10, 50), (13, 50)]
    assert drop([(10, 50), (10, 55), (12, 53)], 2) == [(10, 50), (10, 55)]
    assert drop([(10, 50), (12, 53)], 2) == [(10, 50), (12, 53)]


def test_a_kept_edge_removes_its_reverse():
    assert drop([(10, 50), (52, 8)], 2) == [(10, 50)]
    assert drop([(10, 50), (52, 7)], 2) == [(10, 50), (52, 7)]
    assert drop([(10, 50), (53, 10)], 2) == [(10, 50), (53, 10)]


def test_candidates_of_one_left_do_not_see_each_other():
    assert drop([(10, 50), (10, 51), (10, 52)], 5) == [(10, 50), (10, 51), (10, 52)]


def test_a_removed_candidate_removes_nothing():
    # (12, 52) goes because of (10, 50); (14, 54) would go only because of (12, 52).
    assert drop([(10, 50), (12, 52), (14, 54)], 2) == [(10, 50), (14, 54)]


def test_neighbourhoods_do_not_cross_a_segment():
    assert drop([(10, 50), (11, 51)], 5, starts=(0, 11)) == [(10, 50), (11, 51)]
    assert drop([(10, 50), (11, 51)], 5, starts=(0, 51)) == [(10, 50), (11, 51)]
    assert drop([(10, 50), (11, 51)], 5, starts=(0, 25)) == [(10, 50)]
    # 10 -> 13 is near a natural edge only inside one segment.
    assert drop([(10, 13)], 5, starts=(0, 11)) == [(10, 13)]
    assert drop([(10, 13)], 5) == []


@pytest.mark.parametrize("l_pn", [1, 2, 5])
def test_no_natural_edge_leaves_a_segments_last_frame(l_pn):
    # Only 9 -> 10 could be near (9, 9 + 2 l_pn + 1), and 9 is its segment's last frame or not.
    pair = (9, 10 + 2 * l_pn)
    assert drop([pair], l_pn, starts=(0, 10)) == [pair]
    assert drop([pair], l_pn) == []


def test_both_rules_equal_the_naive_ones_on_random_candidates():
    rng = np.random.default_rng(0)
    for _ in range(200):
        n_frames, l_pn = int(rng.integers(2, 30)), int(rng.integers(1, 7))
        starts = np.unique([0, *rng.integers(0, n_frames, size=2)])
        segment = naive.segments(starts, n_frames)
        rows = [
            (left, right, 1.0)
            for left in range(n_frames) for right in range(n_frames)
            if left != right and left < segment[left][1] and right != left + 1 and rng.random() < 0.4
        ]  # fmt: skip
        pairs = [row[:2] for row in rows]
        thinned = [row[:2] for row in naive.thin_runs(rows, starts, n_frames, l_pn)]
        assert thin(pairs, l_pn, starts, n_frames) == thinned
        edges = {(f, f + 1): 0.0 for f in range(n_frames) if f < segment[f][1]}
        expected = []
        for left in range(n_frames):
            new = [p for p in pairs if p[0] == left and not naive._near_an_edge(left, p[1], edges, segment, l_pn)]
            edges |= dict.fromkeys(new, 1.0)
            expected += new
        assert drop(pairs, l_pn, starts, n_frames) == expected

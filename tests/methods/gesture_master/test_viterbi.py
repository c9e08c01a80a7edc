"""The dynamic programming over clips, against enumeration and against a plain one."""

import itertools

import numpy as np
import pytest

from gesturegen.methods.gesture_master.viterbi import InEdges, search
from tests import naive


def in_edges(edges, n_clips):
    """`InEdges` of costs by (p, q)."""
    rows = [sorted((p, cost) for (p, other), cost in edges.items() if other == q) for q in range(n_clips)]
    flat = [pair for row in rows for pair in row]
    return InEdges(
        np.cumsum([0, *map(len, rows)]),
        np.array([p for p, _ in flat], dtype=np.int32),
        np.array([cost for _, cost in flat], dtype=np.float32),
    )


def unaligned(array):
    """A read-only copy on an odd address."""
    odd = np.frombuffer(b"\0" + array.tobytes(), dtype=array.dtype, offset=1).reshape(array.shape)
    assert not odd.flags.aligned and not odd.flags.writeable
    return odd


def problem(seed, n_clips, n_segments, integers, share):
    """data, edges by (p, q), missing, reuse, twins, weight."""
    rng = np.random.default_rng(seed)

    def numbers(low, high, size=None):
        values = rng.integers(low, high + 1, size=size) if integers else rng.uniform(low, high, size=size)
        return values.astype(np.float32).astype(float) if size else float(np.float32(values))

    pairs = [pair for pair in itertools.product(range(n_clips), repeat=2) if rng.random() < share]
    edges = dict(zip(pairs, numbers(1, 4, (len(pairs),)).tolist() if pairs else [], strict=True))
    missing = [0.0, numbers(0, 1), numbers(1, 4), 6.0, 1000.0, -2.0][rng.integers(6)]
    reuse = [0.0, numbers(0, 3), 50.0, -1.0][rng.integers(4)]
    weight = [0.0, 1.0, 2.0, numbers(0, 2)][rng.integers(4)]
    twins = np.arange(n_clips)
    if rng.random() < 0.7:
        order = rng.permutation(n_clips)[: n_clips // 2 * 2].reshape(-1, 2)
        order = order[rng.random(len(order)) < 0.7]
        twins[order], twins[order[:, ::-1]] = order[:, ::-1], order
    elif rng.random() < 0.5:
        twins = rng.integers(n_clips, size=n_clips)  # not mutual
    return numbers(-2, 4, (n_segments, n_clips)), edges, missing, reuse, twins, weight


def solve(data, edges, *rest):
    choice, total = search(data, in_edges(edges, data.shape[1]), *rest)
    assert choice.shape == (len(data),) and choice.dtype.kind == "i"
    return choice.tolist(), total


@pytest.mark.parametrize("share", [0.0, 0.3, 0.8, 1.0])
@pytest.mark.parametrize("integers", [True, False])
def test_it_is_the_cheapest_of_all_sequences(integers, share):
    for seed in range(60):
        n_clips, n_segments = 1 + seed % 5, 1 + seed % 4
        this = problem(seed, n_clips, n_segments, integers, share)
        costs = {
            choice: naive.clips_cost(choice, *this) for choice in itertools.product(range(n_clips), repeat=n_segments)
        }
        choice, total = solve(*this)
        assert total == naive.clips_cost(choice, *this)
        if integers:  # sums are exact: of the cheapest the lowest, from the last clip backwards
            least = min(costs.values())
            ties = [list(other) for other, cost in costs.items() if cost == least]
            assert choice == min(ties, key=lambda other: other[::-1]) and total == least
        else:
            assert total == pytest.approx(min(costs.values()), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("integers", [True, False])
def test_it_is_the_plain_dynamic_programming_to_the_bit(integers):
    for seed in range(80):
        this = problem(1000 + seed, 12 + seed % 20, 2 + seed % 7, integers, [0.02, 0.2, 0.5, 0.95][seed % 4])
        assert solve(*this) == naive.viterbi(*this)


def test_ties_between_sums_that_rounding_makes_equal_go_to_the_lowest():
    # 1e16 + 1 and 1e16 are one number: clip 0 ties with clip 1, though it cost more before.
    data = np.array([[1.0, 0.0, 0.5], [4.0, 4.0, 0.0]])
    this = data, {}, 1e16, 0.0, np.arange(3), 1.0
    assert solve(*this) == naive.viterbi(*this) == ([0, 2], 1e16)


def test_an_edge_is_paid_though_none_would_be_cheaper():
    data = np.array([[0.0, 9.0], [9.0, 0.0]])
    assert solve(data, {(0, 1): 5.0}, 1.0, 0.0, np.arange(2), 1.0) == ([0, 1], 5.0)
    assert solve(data, {}, 1.0, 0.0, np.arange(2), 1.0) == ([0, 1], 1.0)


def test_a_clip_and_its_twin_are_used_again_only_for_a_price():
    data = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    assert solve(data, {}, 0.0, 5.0, np.array([1, 0, 2]), 1.0) == ([0, 2, 0], 1.0)
    assert solve(data, {}, 0.0, 5.0, np.arange(3), 1.0) == ([0, 1, 0], 0.0)
    assert solve(data, {}, 0.0, 0.25, np.array([1, 0, 2]), 1.0) == ([0, 0, 0], 0.5)


def test_one_clip_and_one_segment():
    alone = np.array([0])
    assert solve(np.array([[1.0], [2.0], [4.0]]), {}, 10.0, 100.0, alone, 2.0) == ([0, 0, 0], 247.0)
    assert solve(np.array([[1.0], [2.0]]), {(0, 0): 3.0}, 10.0, 0.5, alone, 2.0) == ([0, 0], 9.5)
    assert solve(np.array([[3.0, 1.0, 1.0]]), {(0, 1): 1.0}, 1.0, 1.0, np.arange(3), 1.0) == ([1], 1.0)
    assert solve(np.array([[3.0]]), {}, 1.0, 1.0, alone, 1.0) == ([0], 3.0)


def test_edges_may_be_read_only_unaligned_and_mapped(tmp_path):
    data, edges, *rest = problem(5, 40, 9, False, 0.3)
    plain = in_edges(edges, 40)
    wanted, total = search(data, plain, *rest)
    odd = InEdges(*map(unaligned, (plain.indptr.astype(np.int64), plain.sources, plain.costs)))
    (tmp_path / "edges").write_bytes(b"odd" + plain.sources.tobytes() + plain.costs.tobytes())
    shape = plain.sources.shape
    mapped = InEdges(
        plain.indptr,
        np.memmap(tmp_path / "edges", np.int32, "r", offset=3, shape=shape),
        np.memmap(tmp_path / "edges", np.float32, "r", offset=3 + plain.sources.nbytes, shape=shape),
    )
    assert not mapped.costs.flags.aligned
    for other in (odd, mapped):
        choice, again = search(unaligned(data), other, *rest[:2], unaligned(rest[2]), rest[3])
        assert choice.tolist() == wanted.tolist() and again == total


def test_what_makes_no_sense_is_refused():
    data, alone = np.zeros((2, 2)), np.arange(2)

    def refused(match, data=data, edges=((0, 1, 2), (0, 1), (1, 1)), missing=1.0, reuse=1.0, twins=alone, weight=1.0):
        indptr, sources, costs = edges
        arrays = InEdges(np.array(indptr), np.array(sources, dtype=np.int32), np.array(costs, dtype=np.float32))
        with pytest.raises(ValueError, match=match):
            search(data, arrays, missing, reuse, twins, weight)

    refused("one segment", data=np.zeros((0, 2)))
    refused("one segment", data=np.zeros((2, 0)))
    refused("finite", data=np.full((2, 2), np.inf))
    refused("finite", missing=np.inf)
    refused("finite", weight=np.nan)
    refused("too large", missing=1e308, weight=100.0, edges=((0, 0, 0), (), ()))
    refused("twin", twins=np.array([0, 2]))
    refused("twin", twins=np.array([0]))
    refused("shapes", edges=((0, 1), (0,), (1,)))
    refused("shapes", edges=((0, 1, 2), (0, 1), (1,)))
    refused("order", edges=((0, 1, 1), (0, 1), (1, 1)))
    refused("order", edges=((0, 3, 2), (0, 1), (1, 1)))
    refused("ascending", edges=((0, 2, 2), (1, 0), (1, 1)))
    refused("ascending", edges=((0, 2, 2), (1, 1), (1, 1)))
    refused("ascending", edges=((0, 1, 2), (-1, 1), (1, 1)))
    refused("ascending", edges=((0, 1, 2), (0, 2), (1, 1)))
    refused("finite", edges=((0, 1, 2), (0, 1), (1, np.nan)))

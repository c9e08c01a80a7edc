"""Transition costs of gesture clips, and the edges below a threshold, against the definition."""

import numpy as np
import pytest

from gesturegen.methods.gesture_master.transitions import Borders, costs, edges, quantile
from gesturegen.motion import rotation
from tests import naive


def borders(rng, n_clips=30, frames=4, joints=3, turns=2, scale=1.0, angle=1.0, steady=0.1):
    """Random borders whose frames differ `steady` times as much as the clips."""
    points = rng.normal(size=(n_clips, 1, joints, 3)) + steady * rng.normal(size=(n_clips, frames, joints, 3))
    vectors = rng.normal(size=(n_clips, 1, turns, 3)) + steady * rng.normal(size=(n_clips, frames, turns, 3))
    quaternions = rotation.from_expmap(angle * vectors) * rng.choice([-1, 1], size=(n_clips, frames, turns, 1))
    return Borders((scale * points).astype(np.float32), quaternions.astype(np.float32))


def table(ends, starts, *weights):
    """`costs` of all pairs, sources in rows."""
    lefts, rights = np.divmod(np.arange(len(ends) * len(starts)), len(starts))
    return costs(ends, starts, lefts, rights, *weights).reshape(len(ends), len(starts))


def expected(values, first, last, limit):
    """The edges of a table of costs, as (counts, sources, costs)."""
    rows = [np.flatnonzero(values[:, q] < limit) for q in range(first, last)]
    return (
        [len(sources) for sources in rows],
        [int(p) for sources in rows for p in sources],
        [np.float32(values[p, q]) for q, sources in zip(range(first, last), rows, strict=True) for p in sources],
    )


def found(*arguments, **options):
    counts, sources, values = edges(*arguments, **options)
    assert (counts.dtype, sources.dtype, values.dtype) == (np.int64, np.int32, np.float32)
    return counts.tolist(), sources.tolist(), values.tolist()


def single(points, quaternions):
    """Clips of one frame with one joint and one rotation."""
    return Borders(
        np.array(points, dtype=np.float32)[:, None, None], np.array(quaternions, dtype=np.float32)[:, None, None]
    )


def test_the_cost_weighs_distances_and_angles():
    ends = single([(0, 0, 0), (1, 1, 1)], [(1, 0, 0, 0), (0.6, 0.8, 0, 0)])
    starts = single([(3, 4, 0), (1, 1, 1)], [(0, 0, 1, 0), (0.6, 0.8, 0, 0)])
    values = costs(ends, starts, [0, 0, 1], [0, 1, 1], 2.0, 0.5)
    turn = 2 * np.arccos(0.6)
    np.testing.assert_allclose(values, [10 + np.pi / 2, 2 * np.sqrt(3) + turn / 2, 0.0], rtol=1e-7, atol=0)
    assert values[2] == 0.0


@pytest.mark.parametrize("weights", [(1.0, 1.0), (0.0, 1.0), (3.0, 0.0), (0.25, 7.0), (0.0, 0.0)])
@pytest.mark.parametrize("shape", [(1, 1, 1), (8, 17, 17), (5, 3, 0), (2, 0, 6), (3, 2, 5)])
def test_costs_are_the_definition(weights, shape):
    rng = np.random.default_rng(sum(shape))
    ends, starts = borders(rng, 6, *shape), borders(rng, 9, *shape, angle=3.0)
    np.testing.assert_allclose(
        table(ends, starts, *weights), naive.transition_costs(ends, starts, *weights), rtol=1e-12
    )


@pytest.mark.parametrize("angle", [1e-7, 1e-6, 1e-5, 1e-3, 0.1, np.pi / 2, np.pi - 1e-3, np.pi])
def test_angles_are_right_at_every_size(angle):
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(200, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    before = rotation.normalize(rng.normal(size=(200, 4)))
    after = rotation.multiply(before, rotation.from_expmap(angle * axes))
    # What float32 keeps of them is what counts, also where that is not quite a unit quaternion.
    ends, starts = (single(np.zeros((200, 3)), turns) for turns in (before, after))
    clips = np.arange(200)
    kept = rotation.angle_between(*(side.rotations[:, 0, 0].astype(np.float64) for side in (ends, starts)))
    np.testing.assert_allclose(costs(ends, starts, clips, clips, 0.0, 1.0), kept, rtol=1e-6 if angle < 1e-4 else 1e-11)


def test_the_sign_of_a_quaternion_does_not_count():
    rng = np.random.default_rng(0)
    ends, starts = borders(rng), borders(rng)
    signs = rng.choice([-1, 1], size=(*starts.rotations.shape[:3], 1)).astype(np.float32)
    flipped = Borders(starts.positions, starts.rotations * signs)
    assert np.array_equal(table(ends, starts, 1.0, 1.0), table(ends, flipped, 1.0, 1.0))
    assert found(ends, starts, 0, 30, 1.0, 1.0, 20.0) == found(ends, flipped, 0, 30, 1.0, 1.0, 20.0)
    same = Borders(ends.positions, -ends.rotations)
    assert not np.diag(table(ends, same, 1.0, 1.0)).any()


def test_the_cost_is_a_metric_between_borders():
    values = table(side := borders(np.random.default_rng(3), 25), side, 1.0, 0.7)
    assert not np.diag(values).any() and (values[~np.eye(25, dtype=bool)] > 0).all()
    assert np.array_equal(values, values.T)
    detours = (values[:, :, None] + values[None, :, :]).min(axis=1)
    assert (values <= detours * (1 + 1e-12)).all()


@pytest.mark.parametrize("steady", [0.0, 0.1, 3.0])
@pytest.mark.parametrize("scale, offset", [(1.0, 0.0), (1e-12, 0.0), (1e-3, 100.0), (1e12, 0.0), (1.0, 1e4)])
@pytest.mark.parametrize("weights", [(1.0, 1.0), (0.0, 1.0), (2.5, 0.0), (50.0, 0.1)])
def test_edges_are_the_pairs_below_the_limit(steady, scale, offset, weights):
    rng = np.random.default_rng(7)
    shape = {"scale": scale, "angle": 0.5, "steady": steady}
    ends, starts = (
        Borders(side.positions + np.float32(offset), side.rotations)
        for side in (borders(rng, 75, **shape), borders(rng, 20, **shape))
    )
    by_definition = naive.transition_costs(ends, starts, *weights)
    ordered = np.unique(by_definition)
    for share in (0.0, 0.01, 0.2, 0.7, 1.0):
        place = int(share * (len(ordered) - 2))
        limit = (ordered[place] + ordered[place + 1]) / 2
        counts, sources, values = found(ends, starts, 0, 20, *weights, limit)
        wanted = expected(by_definition, 0, 20, limit)
        assert (counts, sources) == wanted[:2]
        np.testing.assert_allclose(values, wanted[2], rtol=1e-6)
        # On the limit itself the cost is not below it, to the bit.
        exact = table(ends, starts, *weights)
        for tie in (exact.flat[place], np.nextafter(exact.flat[place], np.inf)):
            assert found(ends, starts, 0, 20, *weights, tie) == expected(exact, 0, 20, tie)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_no_edge_is_lost_where_the_lower_bound_is_the_cost(scale):
    # Borders that move as one body: the norm of the sum over frames is the sum of the norms, but for rounding.
    rng = np.random.default_rng(5)
    path = 100 * rng.normal(size=(1, 6, 4, 3))
    turns = np.repeat(rotation.from_expmap(1e-4 * rng.normal(size=(80, 1, 2, 3))), 6, axis=1).astype(np.float32)
    side = Borders((scale * (path + rng.integers(-8, 8, size=(80, 1, 1, 3)))).astype(np.float32), turns)
    exact = table(side, side, 1.0, 1.0)
    for limit in np.unique(exact)[:: exact.size // 40]:
        for near in (limit, np.nextafter(limit, np.inf)):
            assert found(side, side, 0, 80, 1.0, 1.0, near) == expected(exact, 0, 80, near)


def test_many_pairs_at_exactly_the_limit():
    rng = np.random.default_rng(1)
    points = rng.integers(0, 3, size=(70, 2, 2, 3)).astype(np.float32)
    points[..., 1:] = 0
    side = Borders(points, np.tile(np.float32([1, 0, 0, 0]), (70, 2, 1, 1)))
    exact = table(side, side, 1.0, 1.0)
    assert len(np.unique(exact)) == 9
    for limit in range(10):
        assert found(side, side, 0, 70, 1.0, 1.0, limit) == expected(exact, 0, 70, limit)


def test_blocks_do_not_matter():
    rng = np.random.default_rng(2)
    ends, starts = borders(rng, 150), borders(rng, 40)
    whole = edges(ends, starts, 0, 40, 1.0, 1.0, 12.0)
    for block_pairs in (1, 149, 150, 449, 10**9):
        again = edges(ends, starts, 0, 40, 1.0, 1.0, 12.0, block_pairs=block_pairs)
        assert all(np.array_equal(a, b) for a, b in zip(whole, again, strict=True))
    parts = [edges(ends, starts, first, last, 1.0, 1.0, 12.0) for first, last in ((0, 1), (1, 1), (1, 33), (33, 40))]
    assert all(np.array_equal(a, np.concatenate(b)) for a, b in zip(whole, zip(*parts, strict=True), strict=True))


def test_identical_borders_are_below_any_positive_limit():
    one = borders(np.random.default_rng(0), 1)
    side = Borders(np.repeat(one.positions, 5, axis=0), np.repeat(one.rotations, 5, axis=0))
    assert found(side, side, 0, 5, 1.0, 1.0, 1e-300) == ([5] * 5, [*range(5)] * 5, [0.0] * 25)
    for limit in (0.0, -1.0, -np.inf):
        assert found(side, side, 0, 5, 1.0, 1.0, limit) == ([0] * 5, [], [])
    other = borders(np.random.default_rng(1), 5)
    assert found(side, other, 0, 5, 1.0, 1.0, np.inf)[:2] == ([5] * 5, [*range(5)] * 5)


def test_the_quantile_is_that_of_all_pairs_of_different_clips():
    rng = np.random.default_rng(4)
    ends, starts = borders(rng, 12), borders(rng, 12)
    apart = table(ends, starts, 1.0, 2.0)[~np.eye(12, dtype=bool)]
    for share in (0.0, 0.03, 0.5, 1.0):
        for sample in (132, 200_000):
            assert quantile(ends, starts, share, 1.0, 2.0, rng, sample) == np.quantile(apart, share)


def test_the_quantile_of_a_sample_is_near_and_reproducible():
    rng = np.random.default_rng(4)
    ends = starts = borders(rng, 60)
    apart = table(ends, starts, 1.0, 2.0)[~np.eye(60, dtype=bool)]
    once, again = (quantile(ends, starts, 0.2, 1.0, 2.0, np.random.default_rng(9), 2000) for _ in range(2))
    assert once == again
    assert np.quantile(apart, 0.17) < once < np.quantile(apart, 0.23)
    # No clip is paired with itself, which would cost nothing here.
    assert quantile(ends, starts, 0.0, 1.0, 2.0, np.random.default_rng(9), 3539) > 0


def test_what_makes_no_sense_is_refused():
    rng = np.random.default_rng(0)
    side, other = borders(rng, 5), borders(rng, 5, frames=3)
    with pytest.raises(ValueError, match="differ"):
        costs(side, other, [0], [0], 1.0, 1.0)
    with pytest.raises(ValueError, match="0 to 4"):
        costs(side, side, [0, -1], [0, 0], 1.0, 1.0)
    with pytest.raises(ValueError, match="0 to 4"):
        costs(side, side, [0], [5], 1.0, 1.0)
    with pytest.raises(ValueError, match="one length"):
        costs(side, side, [0], [1, 2], 1.0, 1.0)
    with pytest.raises(ValueError, match="not negative"):
        edges(side, side, 0, 5, -1.0, 1.0, 1.0)
    with pytest.raises(ValueError, match="destinations"):
        edges(side, side, 0, 6, 1.0, 1.0, 1.0)
    with pytest.raises(ValueError, match="not a number"):
        edges(side, side, 0, 5, 1.0, 1.0, np.nan)
    with pytest.raises(ValueError, match="two clips"):
        quantile(borders(rng, 1), borders(rng, 1), 0.5, 1.0, 1.0, rng)
    with pytest.raises(ValueError, match="unit"):
        costs(Borders(side.positions, 2 * side.rotations), side, [0], [0], 1.0, 1.0)
    with pytest.raises(ValueError, match="finite"):
        costs(Borders(side.positions * np.float32(np.nan), side.rotations), side, [0], [0], 1.0, 1.0)
    with pytest.raises(ValueError, match=r"\[C, F, J, 3\]"):
        Borders(side.positions[:3], side.rotations)

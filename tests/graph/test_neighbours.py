"""The index of the nearest frames against sorting all distances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.config import Continuity
from gesturegen.graph import continuity, neighbours
from tests import naive

QUICK = settings(deadline=None, derandomize=True, max_examples=80)
BLOCKS = (1, 2, 39, 40, 41, 100, 1599, 1600, 10**7)


def motion_of(positions, starts=(0,)):
    poses = continuity.flatten(np.asarray(positions, dtype=np.float32))
    return poses, continuity.velocities(poses, np.array(starts))


def sorted_by_distance(poses, speeds, rules, count=neighbours.COUNT):
    """Nearest other frames and their distances, by sorting; ties by frame."""
    nodes, distances = [], []
    for left in range(len(poses)):
        away = naive.distances_from(left, poses, speeds, rules).tolist()
        order = sorted((away[right], right) for right in range(len(poses)) if right != left)[:count]
        nodes.append([right for _, right in order])
        distances.append([distance for distance, _ in order])
    return nodes, distances


def check(poses, speeds, rules, **options):
    nodes, distances = neighbours.nearest(poses, speeds, rules, **options)
    expected = sorted_by_distance(poses, speeds, rules, options.get("count", neighbours.COUNT))
    assert nodes.dtype == np.int32 and distances.dtype == np.float64
    assert (nodes.tolist(), distances.tolist()) == expected


@QUICK
@given(
    seed=st.integers(0, 10_000),
    frames=st.integers(1, 90),
    kind=st.sampled_from(["noise", "walk", "grid", "few"]),
    scale=st.sampled_from([1e-12, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e12]),
    offset=st.sampled_from([0.0, 1.0, 1e4]),
    lambda_pos=st.sampled_from([0.0, 0.3, 1.0]),
    lambda_vel=st.sampled_from([0.0, 1.0, 50.0]),
    count=st.sampled_from([1, 2, 7, neighbours.COUNT]),
)
def test_nearest_equals_sorting(seed, frames, kind, scale, offset, lambda_pos, lambda_vel, count):
    rng = np.random.default_rng(seed)
    shape = frames, int(rng.integers(1, 5)), 3
    positions = {
        "noise": lambda: rng.normal(size=shape),
        "walk": lambda: rng.normal(size=shape).cumsum(axis=0),
        "grid": lambda: rng.integers(-1, 2, size=shape).astype(float),
        "few": lambda: rng.normal(size=(3, *shape[1:]))[rng.integers(0, 3, frames)],
    }[kind]()
    poses, speeds = motion_of((positions + offset) * scale, np.unique([0, rng.integers(0, frames)]))
    check(poses, speeds, Continuity(lambda_pos=lambda_pos, lambda_vel=lambda_vel), count=count)


@pytest.mark.parametrize("block_pairs", BLOCKS)
def test_block_size_has_no_effect(block_pairs):
    rng = np.random.default_rng(0)
    for positions in (rng.normal(size=(40, 2, 3)), rng.integers(0, 2, size=(40, 1, 3))):
        poses, speeds = motion_of(positions, (0, 11))
        check(poses, speeds, Continuity(), block_pairs=block_pairs)


def test_the_lower_frame_comes_first_among_equals():
    poses, speeds = motion_of(np.ones((40, 1, 3)))
    nodes, distances = neighbours.nearest(poses, speeds, Continuity(), count=5)
    assert nodes[0].tolist() == [1, 2, 3, 4, 5] and nodes[2].tolist() == [0, 1, 3, 4, 5]
    assert nodes[39].tolist() == [0, 1, 2, 3, 4] and not distances.any()


def test_fewer_frames_than_asked_for():
    rng = np.random.default_rng(1)
    for frames in (1, 2, 3, neighbours.COUNT, neighbours.COUNT + 1, neighbours.COUNT + 2):
        poses, speeds = motion_of(rng.normal(size=(frames, 2, 3)))
        nodes, distances = neighbours.nearest(poses, speeds, Continuity())
        assert nodes.shape == distances.shape == (frames, min(frames - 1, neighbours.COUNT))
        check(poses, speeds, Continuity())


def test_close_pairs_far_from_the_origin():
    # Float32 products alone would not tell these apart.
    rng = np.random.default_rng(2)
    poses, speeds = motion_of(1e4 + 1e-2 * rng.normal(size=(120, 4, 3)))
    check(poses, speeds, Continuity())
    poses[60:] += 1e7
    check(poses, speeds, Continuity())


def exact_distances(poses, speeds, rules):
    return np.array([naive.distances_from(left, poses, speeds, rules) for left in range(len(poses))])


@QUICK
@given(
    seed=st.integers(0, 10_000),
    frames=st.integers(1, 90),
    scale=st.sampled_from([1e-12, 1e-3, 1.0, 1e3, 1e12]),
    offset=st.sampled_from([0.0, 1e4]),
    lambda_pos=st.sampled_from([0.0, 0.3, 1.0]),
    lambda_vel=st.sampled_from([0.0, 1.0, 50.0]),
)
def test_lower_bounds_never_exceed_the_distance(seed, frames, scale, offset, lambda_pos, lambda_vel):
    rng = np.random.default_rng(seed)
    joints = int(rng.integers(1, 30))
    positions = rng.normal(size=(frames, joints, 3)) * rng.choice([1e-4, 1.0], size=(frames, 1, 1))
    poses, speeds = motion_of((positions + offset) * scale, np.unique([0, rng.integers(0, frames)]))
    rules = Continuity(lambda_pos=lambda_pos, lambda_vel=lambda_vel)
    some = np.unique(rng.integers(0, frames, 5))
    low = neighbours.lower_bounds(poses, speeds, rules, some)
    assert low.dtype == np.float32 and low.shape == (len(some), frames) and (low >= 0).all()
    # In float64, where a float32 is exact.
    assert (low.astype(np.float64) <= exact_distances(poses, speeds, rules)[some]).all()


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_lower_bounds_are_tight(scale):
    rng = np.random.default_rng(3)
    poses, speeds = motion_of(rng.normal(size=(200, 25, 3)) * scale)
    low = neighbours.lower_bounds(poses, speeds, Continuity(), np.arange(200))
    exact = exact_distances(poses, speeds, Continuity())
    apart = ~np.eye(200, dtype=bool)
    assert (low[apart] > 0.999 * exact[apart]).all()
    # A frame is at most a rounding of the products away from itself.
    assert (np.diag(low) <= 0.0).all()

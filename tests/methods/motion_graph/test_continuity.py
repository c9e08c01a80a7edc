"""Velocities, distances, thresholds and candidates of the continuity analysis."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen import pose_distance
from gesturegen.methods.motion_graph import continuity
from gesturegen.settings.models import Continuity
from tests import naive

QUICK = settings(deadline=None, derandomize=True, max_examples=60)


def line(*x):
    """Positions of one joint that moves along X."""
    positions = np.zeros((len(x), 1, 3), dtype=np.float32)
    positions[:, 0, 0] = x
    return positions


def distances(positions, starts, lefts, rights, rules):
    poses = pose_distance.flatten(positions)
    return pose_distance.pose_distances(poses, pose_distance.velocities(poses, np.array(starts)), lefts, rights, rules)


def found(positions, starts, rules, **options):
    """Candidates of the package as (left, right, distance)."""
    starts = np.array(starts)
    poses = pose_distance.flatten(positions)
    speeds = pose_distance.velocities(poses, starts)
    limits = continuity.thresholds(poses, speeds, starts, rules)
    blocks = continuity.candidate_blocks(poses, speeds, limits, rules, **options)
    return [row for block in blocks for row in zip(*(column.tolist() for column in block), strict=True)]


def test_velocities_are_backward_differences_inside_segments():
    poses = pose_distance.flatten(line(0, 1, 3, 10, 14, 20))
    speeds = pose_distance.velocities(poses, np.array([0, 3, 5]))
    # A segment's first frame copies the second's velocity; the last segment has one frame.
    assert speeds[:, 0].tolist() == [1, 1, 2, 4, 4, 0]
    assert not speeds[:, 1:].any()


def test_distance_weighs_positions_and_velocities():
    positions = line(0, 1, 3, 10)
    rules = Continuity(lambda_pos=2.0, lambda_vel=0.5)
    # v = 1, 1, 2, 7: 2 * |0 - 10| + 0.5 * |1 - 7|
    assert distances(positions, [0], [0, 2], [3, 1], rules).tolist() == [23.0, 4.5]


def test_distance_is_taken_over_all_joints_at_once():
    positions = np.zeros((2, 2, 3), dtype=np.float32)
    positions[1] = [[1, 2, 2], [4, 0, 0]]
    rules = Continuity(lambda_vel=0.0)
    assert distances(positions, [0], [0], [1], rules).tolist() == [5.0]


def test_threshold_is_the_mean_to_the_following_frames_of_the_segment():
    poses = pose_distance.flatten(line(0, 1, 3, 7, 100, 110))
    starts = np.array([0, 4])
    rules = Continuity(lambda_vel=0.0, l_cn=2)
    limits = continuity.thresholds(poses, pose_distance.velocities(poses, starts), starts, rules)
    np.testing.assert_array_equal(limits, [2.0, 4.0, 4.0, np.nan, 10.0, np.nan])


def test_velocity_alone_can_decide():
    rules = Continuity(lambda_pos=0.0, lambda_vel=1.0, l_cn=2)
    # v = 3, 3, 1, -3, 1: thresholds (0 + 2) / 2, (2 + 6) / 2, (4 + 0) / 2 and 4
    assert found(line(0, 3, 4, 1, 2), [0], rules) == [(1, 0, 0.0), (1, 4, 2.0), (2, 4, 0.0)]


def test_a_candidate_lies_strictly_below_the_threshold():
    rules = Continuity(lambda_vel=0.0, l_cn=1)
    # threshold(0) = 1 and frame 2 lies at exactly 1
    assert [row[:2] for row in found(line(0, 1, -1, 0.5), [0], rules) if row[0] == 0] == [(0, 3)]


def test_the_next_frame_of_another_segment_is_no_natural_successor():
    rules = Continuity(lambda_vel=0.0)
    pairs = {row[:2] for row in found(line(0, 4, 8, 4, 1, 5), [0, 3], rules)}
    # 2 ends a segment and so has no unnatural edge; 1 -> 3 crosses into the next segment.
    assert (1, 3) in pairs and not any(left in (2, 5) for left, _ in pairs)
    assert (2, 3) not in pairs and not any(right == left + 1 for left, right in pairs)


def test_static_motion_has_no_candidates():
    assert found(np.ones((30, 3, 3), dtype=np.float32), [0, 10], Continuity()) == []


@QUICK
@given(
    seed=st.integers(0, 10_000),
    frames=st.integers(2, 60),
    offset=st.sampled_from([0.0, 1.0, 1e4]),
    scale=st.sampled_from([1e-12, 1e-6, 1e-3, 1.0, 1e3, 1e6]),
    lambda_pos=st.sampled_from([0.0, 0.3, 1.0, 50.0]),
    lambda_vel=st.sampled_from([0.0, 0.3, 1.0, 50.0]),
)
def test_preselection_loses_no_pair(seed, frames, offset, scale, lambda_pos, lambda_vel):
    rng = np.random.default_rng(seed)
    positions = ((rng.normal(size=(frames, 4, 3)).cumsum(axis=0) + offset) * scale).astype(np.float32)
    starts = np.unique([0, rng.integers(0, frames)])
    rules = Continuity(lambda_pos=lambda_pos, lambda_vel=lambda_vel)
    assert found(positions, starts, rules) == naive.candidates(positions, starts, rules)


def test_preselection_loses_no_pair_one_bit_below_the_threshold():
    # Far from the origin of the float32 grid, every second frame returns to within one unit of rounding.
    rng = np.random.default_rng(0)
    base = rng.normal(size=(40, 25, 3)) * 100 + 1e4
    step = rng.normal(size=(40, 25, 3))
    positions = np.concatenate([base, base + step]).astype(np.float32)[np.arange(80) % 40 + 40 * (np.arange(80) // 40)]
    rules = Continuity(lambda_vel=0.0, l_cn=1)
    poses = pose_distance.flatten(positions)
    starts = np.array([0])
    speeds = pose_distance.velocities(poses, starts)
    exact = pose_distance.pose_distances(poses, speeds, np.repeat(np.arange(80), 80), np.tile(np.arange(80), 80), rules)
    exact = exact.reshape(80, 80)
    for column in range(0, 80, 7):
        # Each frame's limit is the very next float above its distance to one frame.
        limits = np.nextafter(exact[:, column], np.inf)
        blocks = list(continuity.candidate_blocks(poses, speeds, limits, rules))
        pairs = {(left, right) for lefts, rights, _ in blocks for left, right in zip(lefts, rights, strict=True)}
        assert {(left, column) for left in range(80) if column not in (left, left + 1)} <= pairs


@pytest.mark.parametrize("scale", [1e-24, 1e19])
def test_preselection_survives_scales_at_the_ends_of_float32(scale):
    rng = np.random.default_rng(1)
    positions = (rng.normal(size=(40, 3, 3)).cumsum(axis=0) * scale).astype(np.float32)
    assert found(positions, [0], Continuity()) == naive.candidates(positions, [0], Continuity())


@QUICK
@given(seed=st.integers(0, 10_000), block_pairs=st.sampled_from([1, 2, 39, 40, 41, 100, 1599, 1600, 10**7]))
def test_block_size_has_no_effect(seed, block_pairs):
    positions = np.random.default_rng(seed).normal(size=(40, 2, 3)).cumsum(axis=0).astype(np.float32)
    assert found(positions, [0, 11], Continuity(), block_pairs=block_pairs) == found(positions, [0, 11], Continuity())


def test_distances_of_the_kernel_have_the_bits_of_a_plain_sum():
    positions = np.random.default_rng(2).normal(size=(30, 25, 3)).astype(np.float32)
    poses, speeds = naive.poses_and_velocities(positions, [0, 9])
    rules = Continuity(lambda_pos=0.7, lambda_vel=1.3)
    for left in (0, 8, 9, 29):
        ours = distances(positions, [0, 9], [left] * 30, range(30), rules)
        assert ours.tolist() == naive.distances_from(left, poses, speeds, rules).tolist()

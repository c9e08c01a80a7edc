"""Two-bone chains and curves: analytic cases."""

import numpy as np

from gesturegen.demo.curves import Move, follow, smooth_gate, smooth_noise
from gesturegen.demo.limbs import about, align, two_bone
from gesturegen.motion import rotation


def test_two_bone_reaches_a_right_angle():
    start, target = np.zeros((1, 3)), np.array([[3.0, -4.0, 0.0]]) * 6.0
    first, facing, bend = two_bone(start, target, 24.0, 18.0, np.array([[-1.0, -1.0, 0.0]]), 0.95)
    np.testing.assert_allclose(np.degrees(bend), 90.0, atol=0.2)
    elbow = 24.0 * first
    np.testing.assert_allclose(np.linalg.norm(target - elbow), 18.0, atol=0.05)
    np.testing.assert_allclose(np.sum(first * facing), 0.0, atol=1e-12)
    # The elbow points where the pole asks.
    assert elbow[0, 0] < 0.5 * target[0, 0]


def test_two_bone_far_target_stays_within_reach():
    first, _, bend = two_bone(
        np.zeros((3, 3)),
        np.array([[0, -30.0, 0], [0, -60.0, 0], [0, -900.0, 0]]),
        26.0,
        24.0,
        np.eye(3)[[2, 2, 2]],
        0.9,
    )
    assert np.isfinite(first).all() and (np.diff(bend) < 0).all() and bend[-1] >= 0.0


def test_align_turns_bone_and_side():
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(50, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    facing = np.cross(direction, rng.normal(size=(50, 3)))
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    bone, side = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    turn = align(bone, side, direction, facing)
    np.testing.assert_allclose(rotation.rotate(turn, np.tile(bone, (50, 1))), direction, atol=1e-9)
    np.testing.assert_allclose(rotation.rotate(turn, np.tile(side, (50, 1))), facing, atol=1e-9)


def test_about_an_axis():
    turned = rotation.rotate(about(2, np.array([np.pi / 2])), np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(turned, [[0.0, 1.0, 0.0]], atol=1e-12)


def test_moves_start_and_end_where_they_should():
    times = np.arange(0.0, 3.0, 1 / 30)
    moves = [Move(0.5, 1.0, np.array([10.0]), np.zeros(1)), Move(0.9, 1.6, np.array([-4.0]), np.zeros(1))]
    path = follow(times, np.array([2.0]), moves)[:, 0]
    assert path[0] == 2.0
    np.testing.assert_allclose(path[times > 1.61], -4.0)
    # The speed of a minimum-jerk move peaks midway.
    alone = follow(times, np.array([2.0]), moves[:1])[:, 0]
    assert abs(times[np.argmax(np.diff(alone))] + 1 / 60 - 0.75) < 1 / 30


def test_noise_and_gate():
    noise = smooth_noise(np.random.default_rng(1), 60000, 30.0, 0.5, 2)
    np.testing.assert_allclose(noise.std(axis=0), 1.0, atol=0.1)
    times = np.arange(0.0, 10.0, 0.1)
    gate = smooth_gate(times, ((4.0, 8.0),), 0.5)
    assert gate[times < 4.0].min() == 1.0 and abs(gate[(times > 4.6) & (times < 7.4)]).max() < 1e-12

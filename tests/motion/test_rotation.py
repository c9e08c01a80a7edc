import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gesturegen.motion import rotation
from tests.builders import SMALL, product, random_quaternions

ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
seeds = st.integers(0, 10**6)
angles = st.floats(-720, 720, allow_nan=False)


def same_rotation(a, b, tolerance=1e-9):
    np.testing.assert_allclose(rotation.to_matrix(a), rotation.to_matrix(b), atol=tolerance)


def scipy_of(quaternions):
    return Rotation.from_quat(quaternions, scalar_first=True)


@pytest.mark.parametrize("order", ORDERS)
@SMALL
@given(st.tuples(angles, angles, angles))
def test_euler_angles_are_intrinsic(order, degrees):
    quaternion = rotation.from_euler(order, np.radians(degrees))
    np.testing.assert_allclose(rotation.to_matrix(quaternion), product(order, degrees), atol=1e-9)


def test_quaternions_are_scalar_first():
    np.testing.assert_allclose(rotation.from_euler("X", [np.pi / 2]), [np.sqrt(0.5), np.sqrt(0.5), 0, 0])


@pytest.mark.parametrize("order", ORDERS)
@SMALL
@given(st.tuples(angles, angles, angles))
def test_euler_to_expmap_to_euler_is_the_same_rotation(order, degrees):
    quaternion = rotation.from_euler(order, np.radians(degrees))
    back = rotation.to_euler(order, rotation.from_expmap(rotation.to_expmap(quaternion)))
    np.testing.assert_allclose(product(order, np.degrees(back)), product(order, degrees), atol=1e-6)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("middle", (90.0, -90.0, 90.0 - 1e-7, 89.99999, -89.9999))
@pytest.mark.parametrize("outer", (0.0, 37.0, 180.0))
def test_euler_round_trip_holds_at_gimbal_lock(order, middle, outer):
    degrees = (outer, middle, -25.0)
    quaternion = rotation.from_euler(order, np.radians(degrees))
    back = rotation.to_euler(order, rotation.from_expmap(rotation.to_expmap(quaternion)))
    np.testing.assert_allclose(product(order, np.degrees(back)), product(order, degrees), atol=1e-6)


@pytest.mark.parametrize("angle", (0.0, 1e-300, 1e-12, 1e-8, 1e-4, 1.0, np.pi - 1e-9, np.pi))
def test_exp_of_log_is_the_identity(angle):
    axis = np.array([2.0, -3.0, 6.0]) / 7.0
    quaternion = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])
    expmap = rotation.to_expmap(quaternion)
    assert np.linalg.norm(expmap) == pytest.approx(angle, rel=1e-9, abs=1e-15)
    np.testing.assert_allclose(np.abs(expmap), angle * np.abs(axis), rtol=1e-7, atol=1e-15)
    same_rotation(rotation.from_expmap(expmap), quaternion, 1e-12)


@SMALL
@given(seeds)
def test_expmap_is_a_rotation_vector_of_at_most_pi(seed):
    quaternions = random_quaternions(np.random.default_rng(seed), 2, 5)
    expmaps = rotation.to_expmap(quaternions)
    assert expmaps.shape == (2, 5, 3)
    assert np.linalg.norm(expmaps, axis=-1).max() <= np.pi + 1e-12
    expected = scipy_of(quaternions.reshape(-1, 4)).as_rotvec().reshape(2, 5, 3)
    np.testing.assert_allclose(expmaps, expected, atol=1e-12)
    same_rotation(rotation.from_expmap(expmaps), quaternions)


@SMALL
@given(seeds)
def test_multiply_inverse_and_rotate_agree_with_scipy(seed):
    rng = np.random.default_rng(seed)
    a, b = random_quaternions(rng, 6), random_quaternions(rng, 6)
    vectors = rng.normal(size=(6, 3))
    expected = (scipy_of(a) * scipy_of(b)).as_matrix()
    np.testing.assert_allclose(rotation.to_matrix(rotation.multiply(a, b)), expected, atol=1e-12)
    np.testing.assert_allclose(rotation.to_matrix(rotation.inverse(a)), scipy_of(a).inv().as_matrix(), atol=1e-12)
    np.testing.assert_allclose(rotation.rotate(a, vectors), scipy_of(a).apply(vectors), atol=1e-12)


def test_multiply_and_rotate_broadcast():
    rng = np.random.default_rng(0)
    one, many = random_quaternions(rng, 4, 1), random_quaternions(rng, 4, 3)
    np.testing.assert_allclose(rotation.multiply(one, many)[2, 1], rotation.multiply(one[2, 0], many[2, 1]))
    vectors = rng.normal(size=(4, 3, 3))
    np.testing.assert_allclose(rotation.rotate(one, vectors)[2, 1], rotation.rotate(one[2, 0], vectors[2, 1]))


def test_normalize_gives_unit_length():
    np.testing.assert_allclose(rotation.normalize(np.array([[0.0, 3.0, 0.0, 4.0]])), [[0.0, 0.6, 0.0, 0.8]])


@pytest.mark.parametrize("angle", (0.0, 1e-9, 1e-4, 1.0, 3.0, np.pi))
def test_angle_between_is_the_planted_angle(angle):
    start = random_quaternions(np.random.default_rng(3))
    turned = rotation.multiply(start, rotation.from_expmap([0.0, 0.6 * angle, 0.8 * angle]))
    assert rotation.angle_between(start, turned) == pytest.approx(angle, abs=1e-12)
    assert rotation.angle_between(start, -turned) == pytest.approx(angle, abs=1e-12)


@SMALL
@given(seeds)
def test_slerp_ends_and_middle(seed):
    rng = np.random.default_rng(seed)
    a, b = random_quaternions(rng, 5), random_quaternions(rng, 5)
    same_rotation(rotation.slerp(a, b, 0.0), a, 1e-12)
    same_rotation(rotation.slerp(a, b, 1.0), b, 1e-12)
    whole = rotation.angle_between(a, b)
    for weight in (0.25, 0.5, 0.9):
        between = rotation.slerp(a, b, weight)
        np.testing.assert_allclose(np.linalg.norm(between, axis=-1), 1.0, atol=1e-14)
        np.testing.assert_allclose(rotation.angle_between(a, between), weight * whole, atol=1e-7)
        np.testing.assert_allclose(rotation.angle_between(between, b), (1 - weight) * whole, atol=1e-7)


def test_slerp_takes_the_shorter_arc():
    a, b = rotation.about_y(np.radians(170.0)), rotation.about_y(np.radians(-170.0))
    same_rotation(rotation.slerp(a, b, 0.5), rotation.about_y(np.pi))
    same_rotation(rotation.slerp(a, -b, 0.25), rotation.about_y(np.radians(175.0)))


@pytest.mark.parametrize("angle", (0.0, 1e-12, 1e-7, 1.9e-6, 2.1e-6))
def test_slerp_is_finite_and_even_for_tiny_angles(angle):
    a, b = rotation.about_y(0.3), rotation.about_y(0.3 + angle)
    middle = rotation.slerp(a, b, np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(rotation.heading(middle), 0.3 + angle * np.array([0.0, 0.5, 1.0]), atol=1e-14)


def test_slerp_of_opposite_quaternions_stays():
    a = random_quaternions(np.random.default_rng(1))
    same_rotation(rotation.slerp(a, -a, 0.5), a)


@SMALL
@given(seeds, st.floats(-10, 10, allow_nan=False))
def test_heading_adds_under_a_turn_about_y(seed, turn):
    pose = random_quaternions(np.random.default_rng(seed))
    turned = rotation.multiply(rotation.about_y(turn), pose)
    difference = rotation.heading(turned) - rotation.heading(pose) - turn
    assert rotation.wrap_angle(difference) == pytest.approx(0.0, abs=1e-9)


@SMALL
@given(st.floats(-3.1, 3.1, allow_nan=False), st.floats(-1.5, 1.5, allow_nan=False))
def test_heading_of_a_tilted_turn_is_the_turn(turn, tilt):
    tilted = rotation.multiply(rotation.about_y(turn), rotation.from_expmap([tilt * 0.6, 0.0, tilt * 0.8]))
    assert rotation.heading(tilted) == pytest.approx(turn, abs=1e-9)


def test_about_y_turns_z_towards_x():
    np.testing.assert_allclose(rotation.rotate(rotation.about_y(np.pi / 2), [0, 0, 1]), [1, 0, 0], atol=1e-15)


@pytest.mark.parametrize(
    ("angle", "wrapped"), [(0, 0), (np.pi, -np.pi), (-np.pi, -np.pi), (7.0, 7.0 - 2 * np.pi), (-4.0, 2 * np.pi - 4.0)]
)
def test_wrap_angle(angle, wrapped):
    assert rotation.wrap_angle(angle) == pytest.approx(wrapped)


# --- between ------------------------------------------------------------------------------------------------


def directions(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.mark.parametrize("scales", [(1.0, 1.0), (1e-12, 1e12), (1e12, 1e-12), (1e-12, 1e-12), (1e12, 1e12)])
@SMALL
@given(seeds)
def test_between_turns_the_shortest_way_into_the_other_direction(scales, seed):
    rng = np.random.default_rng(seed)
    start, end = directions(rng.normal(size=(6, 3))), directions(rng.normal(size=(6, 3)))
    found = rotation.between(scales[0] * start, scales[1] * end)
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1.0, atol=1e-12)
    np.testing.assert_allclose(rotation.rotate(found, start), end, atol=1e-9)
    # No rotation that takes one direction to another is by less than the angle between them.
    angle = np.arctan2(np.linalg.norm(np.cross(start, end), axis=-1), np.sum(start * end, axis=-1))
    np.testing.assert_allclose(rotation.angle_between(np.broadcast_to(rotation.IDENTITY, (6, 4)), found), angle)


AXES = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1), (1, 1, 1), (2, -3, 6), (1, 1e-9, 0)]


@pytest.mark.parametrize("scale", (1e-12, 1.0, 1e12))
@pytest.mark.parametrize("axis", AXES)
def test_between_parallel_vectors_is_no_rotation(axis, scale):
    vector = np.array(axis, dtype=float)
    np.testing.assert_allclose(np.abs(rotation.between(vector, scale * vector)), rotation.IDENTITY, atol=1e-12)


@pytest.mark.parametrize("scale", (1e-12, 1.0, 1e12))
@pytest.mark.parametrize("axis", AXES)
def test_between_opposite_vectors_is_half_a_turn(axis, scale):
    vector = np.array(axis, dtype=float)
    found = rotation.between(vector, -scale * vector)
    np.testing.assert_allclose(rotation.rotate(found, vector), -vector, atol=1e-9)
    assert rotation.angle_between(rotation.IDENTITY, found) == pytest.approx(np.pi)


@pytest.mark.parametrize("short", (1e-14, 1e-12, 1e-11, 1e-9, 1e-7, 1e-4))
@pytest.mark.parametrize("axis", AXES)
def test_between_vectors_that_are_almost_opposite(axis, short):
    start = directions(np.array(axis, dtype=float))
    across = directions(np.cross(start, [0.3, -0.5, 0.7]))
    end = -np.cos(short) * start + np.sin(short) * across
    # As near to half a turn as this the axis is known to few digits, and the vector need only point the right way.
    np.testing.assert_allclose(rotation.rotate(rotation.between(start, end), start), end, atol=1e-3)


def test_between_vectors_without_length_is_no_rotation():
    zero, some = np.zeros(3), np.array([3.0, -4.0, 5.0])
    for start, end in ((zero, some), (some, zero), (zero, zero)):
        np.testing.assert_array_equal(rotation.between(start, end), rotation.IDENTITY)


def test_between_takes_any_shape():
    rng = np.random.default_rng(5)
    start, end = rng.normal(size=(4, 1, 3)), rng.normal(size=(2, 3))
    found = rotation.between(start, end)
    assert found.shape == (4, 2, 4)
    np.testing.assert_allclose(found[3, 1], rotation.between(start[3, 0], end[1]), atol=1e-15)
    assert rotation.between(np.empty((0, 3)), np.empty((0, 3))).shape == (0, 4)

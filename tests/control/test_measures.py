"""Measures of the hands, by hand and against an obvious restatement."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gesturegen.control.measures import UNITS, hand_measures
from tests.builders import SMALL


def hands(left, right):
    """Points (x, y, z) of each hand, one per frame, as float [shape=(N, 2, 3)]."""
    return np.stack([np.array(left, dtype=float), np.array(right, dtype=float)], axis=1)


def test_every_measure_by_hand():
    # The left hand moves 5 cm a frame, then 13; the right one rests.
    found = hand_measures(hands([(3, 10, 4), (0, 10, 0), (12, 15, 0)], [(6, 2, -8)] * 3), [0], 10.0)
    assert found["height", "left"].tolist() == [10, 10, 15]
    assert found["height", "right"].tolist() == [2, 2, 2]
    assert found["height", "both"].tolist() == [6, 6, 8.5]
    assert found["speed", "left"].tolist() == [50, 50, 130]
    assert found["speed", "right"].tolist() == [0, 0, 0]
    assert found["speed", "both"].tolist() == [25, 25, 65]
    assert found["radius", "left"].tolist() == [5, 0, 12]
    assert found["radius", "right"].tolist() == [10, 10, 10]
    assert found["radius", "both"].tolist() == [7.5, 5, 11]
    assert found["symmetry", "both"].tolist() == [8, 8, 13]


def test_there_is_every_measure_of_every_hand_and_one_symmetry():
    found = hand_measures(np.zeros((4, 2, 3)), [0], 30.0)
    keys = {(name, hand) for name in ("height", "speed", "radius") for hand in ("left", "right", "both")}
    assert set(found) == keys | {("symmetry", "both")}
    assert {name for name, _ in found} == set(UNITS)
    assert all(values.shape == (4,) and values.dtype == np.float64 for values in found.values())


def test_speed_does_not_cross_a_break():
    # Segments of frames 0 to 1, 2 alone and 3 to 5; the hands jump between them.
    heights = [0.0, 1.0, 100.0, 200.0, 203.0, 207.0]
    points = [(0, y, 0) for y in heights]
    found = hand_measures(hands(points, points), np.array([0, 2, 3]), 10.0)
    assert found["speed", "both"].tolist() == [10, 10, 0, 30, 30, 40]


def test_the_first_frame_starts_a_stretch_whether_or_not_it_is_listed():
    points = np.random.default_rng(0).normal(size=(5, 2, 3))
    for starts in ([], [3]):
        listed = hand_measures(points, [0, *starts], 30.0)
        left_out = hand_measures(points, starts, 30.0)
        assert all(np.array_equal(listed[key], left_out[key]) for key in listed)


def test_a_lone_frame_and_a_lone_last_frame_have_no_speed():
    points = [(0, 0, 0), (0, 7, 0), (0, 9, 0)]
    assert hand_measures(hands(points[:1], points[:1]), [0], 30.0)["speed", "left"].tolist() == [0]
    assert hand_measures(hands(points, points), [0, 2], 1.0)["speed", "left"].tolist() == [7, 7, 0]


def test_no_frames_have_no_measures():
    assert all(len(values) == 0 for values in hand_measures(np.zeros((0, 2, 3)), [], 30.0).values())


def test_hands_at_one_height_are_symmetric_wherever_else_they_are():
    assert hand_measures(hands([(1, 20, 3)], [(-40, 20, 9)]), [0], 30.0)["symmetry", "both"].tolist() == [0]


@pytest.mark.parametrize("shape", [(4, 2), (4, 3, 3), (4, 2, 2)])
def test_hands_of_another_shape_are_refused(shape):
    with pytest.raises(ValueError, match="expected \\(N, 2, 3\\)"):
        hand_measures(np.zeros(shape), [0], 30.0)


@pytest.mark.parametrize("starts", [[4], [-1], [0, 9]])
def test_segments_outside_the_frames_are_refused(starts):
    with pytest.raises(ValueError, match="outside the 4 frames"):
        hand_measures(np.zeros((4, 2, 3)), starts, 30.0)


@SMALL
@given(seed=st.integers(0, 10_000), frames=st.integers(1, 12))
def test_equals_a_restatement_frame_by_frame(seed, frames):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(frames, 2, 3)) * 30
    starts = np.unique([0, *rng.integers(0, frames, rng.integers(0, 4))])
    found = hand_measures(points, starts, 15.0)
    for t in range(frames):
        from_ = max(start for start in starts if start <= t)
        end = min([start for start in starts if start > t], default=frames)
        each = []
        for hand, name in enumerate(("left", "right")):
            now = t if t > from_ else t + 1
            speed = 15 * math.dist(points[now, hand], points[now - 1, hand]) if now < end else 0.0
            x, y, z = points[t, hand]
            each.append({"height": y, "radius": math.hypot(x, z), "speed": speed})
            for measure, value in each[-1].items():
                assert found[measure, name][t] == pytest.approx(value)
        for measure in each[0]:
            assert found[measure, "both"][t] == pytest.approx((each[0][measure] + each[1][measure]) / 2)
        assert found["symmetry", "both"][t] == pytest.approx(abs(each[0]["height"] - each[1]["height"]))

"""Euler curves without jumps: equivalent angles, those of the source where its frames are taken over."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.motion import bvh, euler, rotation
from gesturegen.motion.skeleton import Motion
from tests.builders import POSITIONS, bvh_text, make_skeleton

ORDERS = ["".join(axes) for axes in permutations("XYZ")]
ANGLE = st.floats(-720, 720, allow_nan=False)
CURVES = st.lists(st.tuples(ANGLE, st.floats(-170, 170), ANGLE), min_size=2, max_size=5)


def curve(knots, steps=40):
    """Angles that pass through some knots in small steps, through gimbal lock or not."""
    places = np.linspace(0, len(knots) - 1, steps * (len(knots) - 1) + 1)
    return np.stack([np.interp(places, range(len(knots)), column) for column in np.transpose(knots)], axis=1)


def one_joint(order, angles, written=True):
    """The motion of a file with one joint that has these angles."""
    channels = [(*POSITIONS, *(f"{axis}rotation" for axis in order))]
    skeleton = make_skeleton(["root"], [-1], [[0, 0, 0]], channels)
    motion = Motion(
        skeleton, rotation.from_euler(order, np.radians(angles))[:, None], np.zeros((len(angles), 1, 3)), 30.0
    )
    return replace(motion, written_joints=np.array([0]), written_angles=angles[:, None]) if written else motion


def angles_of(motion):
    """The rotation channels of a file of one joint, and that file read again."""
    text = bvh.format_bvh(motion)
    rows = np.loadtxt(text.split("Frame Time: ")[1].splitlines()[1:], ndmin=2)
    return rows[:, 3:]


@pytest.mark.parametrize("order", ORDERS)
@settings(max_examples=10)
@given(knots=CURVES)
def test_curves_stay_curves(order, knots):
    angles = curve(knots)
    largest = np.abs(np.diff(angles, axis=0)).max()
    found = angles_of(one_joint(order, angles, written=False))
    turns = rotation.angle_between(
        rotation.from_euler(order, np.radians(found)), rotation.from_euler(order, np.radians(angles))
    )
    assert turns.max() < 1e-5
    # Through gimbal lock the nearest angles need not be those of the source, but they never go the long way round.
    assert np.abs(np.diff(found, axis=0)).max() <= max(180.0, largest) + 1e-6


@pytest.mark.parametrize("order", ORDERS)
@settings(max_examples=10)
@given(knots=CURVES)
def test_frames_taken_over_keep_their_angles(order, knots):
    angles = np.round(curve(knots), 6)
    np.testing.assert_allclose(angles_of(one_joint(order, angles)), angles, atol=2e-6)


def test_an_elbow_beyond_a_right_angle_has_no_jump():
    """The middle angle passes 90 degrees while the others move slowly: conversion alone turns both by 180."""
    angles = np.stack([np.linspace(0, 20, 50), np.linspace(60, 130, 50), np.linspace(-10, 10, 50)], axis=1)
    alone = np.degrees(rotation.to_euler("ZYX", rotation.from_euler("ZYX", np.radians(angles))))
    assert np.abs(np.diff(alone, axis=0)).max() > 150
    found = angles_of(one_joint("ZYX", angles, written=False))
    # One frame is at 90 degrees to the last digit, where only the difference of the others matters.
    np.testing.assert_allclose(found, angles, atol=0.5)
    assert np.abs(np.diff(found, axis=0)).max() < 2


def test_a_jump_of_the_source_is_kept_and_one_of_ours_is_not():
    angles = np.zeros((6, 3))
    angles[:, 0] = [170.0, 175.0, 180.0, -175.0, -170.0, -165.0]
    whole = one_joint("ZXY", angles)
    np.testing.assert_allclose(angles_of(whole), angles, atol=1e-6)
    # The last frames first: what then follows does not follow in the source, and is written near to what is before.
    again = whole.take(np.array([4, 5, 0, 1, 2, 3]))
    cut = again.written_angles.copy()
    cut[2] = np.nan
    found = angles_of(replace(again, written_angles=cut))[:, 0]
    np.testing.assert_allclose(found, [-170.0, -165.0, -190.0, -185.0, -180.0, -535.0], atol=1e-6)


def test_angles_that_the_motion_has_not_any_more_say_nothing():
    angles = np.tile([10.0, 370.0, 0.0], (5, 1))
    motion = one_joint("ZXY", angles)
    turned = replace(motion, rotations=rotation.multiply(rotation.about_y(np.full((5, 1), 0.5)), motion.rotations))
    assert np.abs(angles_of(turned)).max() < 180


def test_one_rotation_channel_only_turns():
    values = np.linspace(0, 800, 60)[:, None] * [1.0, 0.0, 0.0]
    rotations = rotation.from_euler("YXZ", np.radians(values))
    found = euler.continuous("YXZ", np.degrees(rotation.to_euler("YXZ", rotations)), rotations, None, one_axis=True)
    np.testing.assert_allclose(found[:, 0], values[:, 0], atol=1e-6)


def test_what_is_read_is_written_again(tmp_path):
    """Unwrapped angles, wrapped ones and a flip, through a file."""
    hierarchy = "HIERARCHY\nROOT hips\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Yrotation Xrotation\n}\n"
    rows = ["400.000000 100.000000 -200.000000", "405.000000 95.000000 -195.000000", "-140.000000 10.000000 20.000000"]
    path = tmp_path / "a.bvh"
    path.write_text(bvh_text(rows, hierarchy))
    assert bvh.format_bvh(bvh.read(path)).splitlines()[-3:] == rows

"""Paths of several tracks, and joins by `overlap`, at which both sides play on as recorded."""

import itertools
from collections import Counter
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from gesturegen.frames import ReferenceFrames, describe, join, positions_of
from gesturegen.motion import kinematics, rotation
from gesturegen.motion.skeleton import Motion
from gesturegen.path import Path, Piece, Target, Track
from gesturegen.render import render
from tests import naive, tiny
from tests.builders import SMALL, chain
from tests.methods.gesture_master import gesture_builders as gb
from tests.test_render import BODY, figure, ground, walk

LOWER = list(range(len(gb.LOWER)))
UPPER = list(range(len(gb.LOWER), len(gb.NAMES)))
ABSOLUTE = {"root": {"mode": "absolute"}}


def settings(l_blend=4, **sections):
    return gb.config(**{"blend": {"method": "overlap", "l_blend": l_blend}, "wrists": {"enabled": False}} | sections)


def frames_of(references, config) -> ReferenceFrames:
    """The nodes of some references, without any graph."""
    positions = np.concatenate([positions_of(reference.motion, config) for reference in references])
    return ReferenceFrames(positions=positions, **join([describe(reference, config) for reference in references]))


def pieces_of(*pieces):
    """Pieces from runs of nodes, (first, stop, length); without a length they take as long as they did."""
    built, frame = [], 0
    for first, stop, *own in pieces:
        length = own[0] if own else stop - first
        built.append(Piece(Target(frame, frame + length, "clip"), np.arange(first, stop), 0.0))
        frame += length
    return tuple(built)


def show(references, tracks, config):
    return render(Path(tuple(tracks)), references, frames_of(references, config), config)


def bodies(seed, *frames):
    rng = np.random.default_rng(seed)
    return [gb.reference(rng, count, f"clip{k}", spoken=[]) for k, count in enumerate(frames)]


def angles(one, other):
    return rotation.angle_between(one, other)


# Two recordings of 80 and 60 frames; upper and lower body change at the same frames.
UP = [(10, 40, 30), (90, 120, 26), (120, 135, 20), (5, 25, 20)]
DOWN = [(100, 130, 30), (130, 139, 26), (30, 60, 20), (60, 80, 20)]


def runs(rng, lengths, frames=140):
    """Random runs of nodes for pieces of some lengths."""
    rows = []
    for length in lengths:
        count = int(rng.integers(1, 25))
        first = int(rng.integers(0, frames - count))
        rows.append((first, first + count, length))
    return rows


# --- tracks -------------------------------------------------------------------------------------------------


@SMALL
@given(
    seed=st.integers(0, 10_000), lengths=st.lists(st.integers(1, 30), min_size=1, max_size=4),
    method=st.sampled_from(["overlap", "overlap", "crossfade", "inertialize", "least_jerk", "least_change"]),
    mode=st.sampled_from(["return", "absolute"]),
)  # fmt: skip
def test_each_track_moves_its_joints_as_if_it_were_alone(seed, lengths, method, mode):
    rng, references = np.random.default_rng(seed), bodies(seed, 80, 60)
    config = settings(blend={"method": method}, root={"mode": mode})
    upper, lower = (pieces_of(*runs(rng, lengths)) for _ in range(2))
    moved = show(references, [Track(upper), Track(lower, gb.LOWER)], config)
    above, below = (show(references, [Track(pieces)], config) for pieces in (upper, lower))
    for part, joints in ((above, UPPER), (below, LOWER)):
        np.testing.assert_array_equal(moved.rotations[:, joints], part.rotations[:, joints])
        np.testing.assert_array_equal(moved.positions[:, joints], part.positions[:, joints])
    # Legs and pelvis are where they are in the lower track, in the world too.
    places = kinematics.joint_positions(moved, LOWER)
    np.testing.assert_array_equal(places, kinematics.joint_positions(below, LOWER))
    assert moved.n_frames == sum(lengths)


def test_the_last_track_wins():
    references = bodies(1, 80, 60)
    tracks = [Track(pieces_of(*UP)), Track(pieces_of(*DOWN), gb.LOWER), Track(pieces_of((3, 99, 96)), gb.FINGERS)]
    config = settings()
    moved = show(references, tracks, config)
    alone = [show(references, [Track(track.pieces)], config) for track in tracks]
    for joint, name in enumerate(gb.NAMES):
        own = alone[2 if name in gb.FINGERS else 1 if name in gb.LOWER else 0]
        np.testing.assert_array_equal(moved.rotations[:, joint], own.rotations[:, joint])


def test_the_joint_at_the_pelvis_shows_recorded_angles():
    references = bodies(2, 80, 60)
    recorded = np.concatenate([reference.motion.rotations for reference in references])
    up, down = [(10, 40), (90, 116), (120, 140), (5, 25)], [(100, 130), (0, 26), (30, 50), (60, 80)]
    tracks = [Track(pieces_of(*up)), Track(pieces_of(*down), gb.LOWER)]
    moved = show(references, tracks, settings(l_blend=0))
    spine = gb.NAMES.index("b_spine0")
    nodes = [track.nodes for track in tracks]
    np.testing.assert_allclose(moved.rotations[:, spine], recorded[nodes[0], spine], atol=1e-12)
    np.testing.assert_allclose(moved.rotations[:, LOWER[1:]], recorded[nodes[1]][:, LOWER[1:]], atol=1e-12)
    # Four frames beside each join are blended, on both sides.
    blended = show(references, tracks, settings())
    beside = np.zeros(len(nodes[0]), dtype=bool)
    for seam in (30, 56, 76):
        beside[seam - 4 : seam + 4] = True
    apart = angles(blended.rotations[:, spine], recorded[nodes[0], spine])
    assert (apart[~beside] < 1e-7).all() and (apart[beside] > 1e-7).all()


def test_feet_are_locked_as_those_of_the_track_that_moves_the_legs():
    # Two figures that stand, 60 cm apart; the root glides from one to the other, and the feet must not.
    bent = figure(0, 2)
    rotations = np.tile(bent.rotations[:1], (80, 1, 1))
    positions = np.tile(bent.skeleton.offsets, (80, 1, 1))
    references = []
    for k, x in enumerate((0.0, 60.0)):
        placed = positions.copy()
        placed[:, 0, 0] += x
        references.append(tiny.reference(Motion(bent.skeleton, rotations, placed, tiny.FPS), name=f"clip{k}"))
    legs = [name for name in BODY if name != "b_spine0"]
    # The upper body is of one whose feet leave the ground.
    references.append(tiny.reference(figure(1, 80), name="clip2"))
    upper, lower = pieces_of((160, 190), (200, 230)), pieces_of((0, 30), (120, 150))
    locked, free = (
        tiny.config(blend={"method": "overlap", "l_blend": 4}, root={"return_half_life": 1.0}, feet={"lock": lock})
        for lock in (True, False)
    )
    moved = show(references, [Track(upper), Track(lower, tuple(legs))], locked)
    alone = show(references, [Track(lower)], locked)
    places = [BODY.index(name) for name in legs]
    np.testing.assert_array_equal(moved.rotations[:, places], alone.rotations[:, places])
    assert angles(alone.rotations, show(references, [Track(lower)], free).rotations).max() > 1e-2


def test_one_track_is_the_same_body_in_one_or_in_two():
    references = bodies(3, 80, 60)
    whole = show(references, [Track(pieces_of(*UP))], settings())
    twice = show(references, [Track(pieces_of(*UP)), Track(pieces_of(*UP), gb.LOWER)], settings())
    np.testing.assert_array_equal(whole.rotations, twice.rotations)
    np.testing.assert_array_equal(whole.positions, twice.positions)


def test_tracks_that_change_in_turn_move_without_a_leap():
    # Natural joins in one track where the other one has a hard one, and both natural.
    references = bodies(4, 160, 160)
    upper = pieces_of((0, 40), (40, 70), (200, 240), (240, 270))
    lower = pieces_of((170, 210), (20, 50), (50, 90), (90, 120))
    config = settings(root={"mode": "return", "return_half_life": 1e6})
    moved = show(references, [Track(upper), Track(lower, gb.LOWER)], config)
    hard = show(references, [Track(upper), Track(lower, gb.LOWER)], settings(l_blend=0))
    steps, leaps = (np.linalg.norm(np.diff(kinematics.joint_positions(m), axis=0), axis=-1) for m in (moved, hard))
    # Of the natural join at frame 110.
    for seam in (110,):
        neighbours = np.maximum(steps[seam - 2], steps[seam])
        assert (steps[seam - 1] <= 1.2 * neighbours + 0.05).all()
    # A pose is passed on over eight frames, so no step takes more than some two parts in nine of the leap.
    usual = np.delete(steps, np.r_[34:46, 64:76], axis=0).max(axis=0)
    for seam, joints in ((40, LOWER[1:]), (70, UPPER)):
        inside = steps[seam - 5 : seam + 5].max(axis=0)
        leap = leaps[seam - 1]
        assert leap[joints].max() > 15
        assert (inside <= usual + 0.35 * leap.max()).all()


# --- overlap ------------------------------------------------------------------------------------------------

SPINS = (np.array([0.031, -0.02, 0.012]), np.array([-0.01, 0.045, 0.02]))
ZEROS = (rotation.from_expmap(np.array([0.4, 0.1, -0.3])), rotation.from_expmap(np.array([-0.5, 0.6, 0.2])))
SPEEDS = (np.array([0.5, 0.0, 1.0]), np.array([-1.0, 0.2, 0.3]))
LENGTHS = (70, 50)
STARTS = (0, 70)


def turning():
    """Two recordings of one joint that turns steadily about one axis, on a root that travels steadily."""
    bones = chain(2)
    references = []
    for k, frames in enumerate(LENGTHS):
        times = np.arange(frames)[:, None]
        rotations = np.tile(rotation.IDENTITY, (frames, 2, 1))
        rotations[:, 1] = rotation.multiply(rotation.from_expmap(times * SPINS[k]), ZEROS[k])
        positions = np.tile(bones.offsets, (frames, 1, 1))
        positions[:, 0] = times * SPEEDS[k] + [30.0 * k, 0.0, 0.0]
        references.append(tiny.reference(Motion(bones, rotations, positions, tiny.FPS), name=f"clip{k}"))
    return references


def pose(clip, time):
    """The turn and the place at any time of a recording, which ends hold."""
    time = min(max(time, 0.0), LENGTHS[clip] - 1.0)
    turn = rotation.multiply(rotation.from_expmap(time * SPINS[clip]), ZEROS[clip])
    return turn, time * SPEEDS[clip] + [30.0 * clip, 0.0, 0.0]


def plainly(rows, l_blend):
    """Turns and places, frame by frame, and how many windows each frame is in; rows: (clip, first, stop, length)."""
    turns, places, windows, frame = [], [], [], 0
    spans = []
    for clip, first, stop, length in rows:
        pace = (stop - first - 1) / (length - 1) if length > 1 else float(stop - first - 1)
        spans.append((clip, first, stop, length, pace, frame))
        for k in range(length):
            at = first + k * pace if length > 1 else stop - 1
            turn, place = pose(clip, at)
            turns.append(turn)
            places.append(place)
            windows.append(0)
        frame += length
    for left, right in itertools.pairwise(spans):
        seam, (n_left, n_right) = right[5], [min(l_blend, own[3] // 2) for own in (left, right)]
        follows = left[2] if left[2] < LENGTHS[left[0]] else left[2] - 1
        if (right[0], right[1]) == (left[0], follows):
            continue
        for k, here in enumerate(range(seam - n_left, seam + n_right)):
            weight = (k + 1) / (n_left + n_right + 1)
            windows[here] += 1
            one, other = (turns[here], places[here]), (turns[here], places[here])
            if here < seam:
                other = pose(right[0], right[1] - (seam - here) * right[4])
            else:
                one = pose(left[0], left[2] - 1 + (here - seam + 1) * left[4])
            turns[here] = naive.slerp(one[0], other[0], weight)
            places[here] = (1 - weight) * one[1] + weight * other[1]
    return np.array(turns), np.array(places), np.array(windows)


def show_turning(rows, l_blend, **sections):
    config = tiny.config(blend={"method": "overlap", "l_blend": l_blend}, **{**ABSOLUTE, **sections})
    pieces = pieces_of(*((STARTS[clip] + first, STARTS[clip] + stop, length) for clip, first, stop, length in rows))
    return show(turning(), [Track(pieces)], config)


@st.composite
def rows_of_pieces(draw):
    rows = []
    for _ in range(draw(st.integers(1, 5))):
        clip = draw(st.integers(0, 1))
        first = draw(st.integers(0, LENGTHS[clip] - 1))
        if rows and draw(st.booleans()) and rows[-1][2] < LENGTHS[rows[-1][0]]:
            clip, first = rows[-1][0], rows[-1][2]  # plays on
        stop = draw(st.integers(first + 1, min(first + 25, LENGTHS[clip])))
        rows.append((clip, first, stop, draw(st.one_of(st.just(stop - first), st.integers(1, 30)))))
    return rows


@SMALL
@given(rows=rows_of_pieces(), l_blend=st.integers(0, 9))
def test_both_sides_play_on_through_a_join(rows, l_blend):
    turns, places, windows = plainly(rows, l_blend)
    assert windows.max() <= 1  # however short a piece is, its two joins stay apart
    moved = show_turning(rows, l_blend)
    assert moved.n_frames == len(turns) == sum(row[3] for row in rows)
    np.testing.assert_allclose(moved.positions[:, 0], places, atol=1e-9)
    assert angles(moved.rotations[:, 1], turns).max() < 1e-7


def test_the_window_has_the_middle_of_both_sides_at_the_seam():
    # About one axis at 1 degree and at -2 degrees per frame, by hand.
    bones, references = chain(2), []
    for start, speed in ((0.0, 1.0), (50.0, -2.0)):
        rotations = np.tile(rotation.IDENTITY, (40, 2, 1))
        rotations[:, 1, :] = rotation.from_euler("X", np.radians(start + speed * np.arange(40))[:, None])
        references.append(
            tiny.reference(Motion(bones, rotations, np.tile(bones.offsets, (40, 1, 1)), tiny.FPS), name=f"{start}")
        )
    config = tiny.config(blend={"method": "overlap", "l_blend": 2}, **ABSOLUTE)
    moved = show(references, [Track(pieces_of((10, 20), (50, 60)))], config)
    found = np.degrees(2 * np.arctan2(moved.rotations[:, 1, 1], moved.rotations[:, 1, 0]))
    left, right = np.arange(10, 30), 50.0 - 2 * np.arange(0, 20)
    expected = [*left[:8], *(left[k] + (k - 7) / 5 * (right[k] - left[k]) for k in range(8, 12)), *right[12:]]
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("lengths", [(15, 20), (30, 11), (8, 40)])
@pytest.mark.parametrize("mode", ["absolute", "return"])
def test_a_natural_join_changes_nothing_at_any_pace(lengths, mode):
    references = bodies(5, 80, 60)
    pieces = pieces_of((10, 25, lengths[0]), (25, 45, lengths[1]))
    overlapped, plain = (
        show(references, [Track(pieces)], settings(l_blend=l_blend, root={"mode": mode})) for l_blend in (6, 0)
    )
    np.testing.assert_array_equal(overlapped.rotations, plain.rotations)
    np.testing.assert_array_equal(overlapped.positions, plain.positions)
    np.testing.assert_allclose(plain.positions[0], references[0].motion.positions[10], atol=1e-9)
    np.testing.assert_allclose(plain.positions[lengths[0]], references[0].motion.positions[25], atol=1e-9)
    # From its first to its last frame a piece takes as long as it is given.
    np.testing.assert_allclose(plain.positions[lengths[0] - 1], references[0].motion.positions[24], atol=1e-9)
    np.testing.assert_allclose(plain.positions[-1], references[0].motion.positions[44], atol=1e-9)


@SMALL
@given(
    seed=st.integers(0, 10_000), lengths=st.lists(st.integers(1, 20), min_size=2, max_size=6), l_blend=st.integers(0, 9)
)
def test_frames_away_from_joins_are_untouched(seed, lengths, l_blend):
    rng, references = np.random.default_rng(seed), bodies(seed, 80, 60)
    pieces = pieces_of(*runs(rng, lengths))
    touched = np.zeros(sum(lengths), dtype=bool)
    for before, piece in itertools.pairwise(pieces):
        seam = piece.target.start_frame
        touched[seam - min(l_blend, before.target.length // 2) : seam + min(l_blend, piece.target.length // 2)] = True
    moved, plain = (
        show(references, [Track(pieces)], settings(l_blend=reach, root={"mode": mode}))
        for reach, mode in ((l_blend, "return"), (0, "return"))
    )
    np.testing.assert_array_equal(moved.rotations[~touched], plain.rotations[~touched])
    np.testing.assert_array_equal(moved.positions[~touched], plain.positions[~touched])


def test_beyond_the_end_of_a_recording_its_last_frame_is_held():
    # The left side ends with its recording, the right one begins with its own.
    rows = [(0, 50, 70, 20), (1, 0, 20, 20)]
    moved = show_turning(rows, 5)
    last, first = pose(0, 69), pose(1, 0)
    for k in range(5):
        left, right = (k + 1) / 11, (k + 6) / 11
        before, after = pose(0, 65 + k), pose(1, k)
        assert angles(moved.rotations[15 + k, 1], naive.slerp(before[0], first[0], left)) < 1e-7
        assert angles(moved.rotations[20 + k, 1], naive.slerp(last[0], after[0], right)) < 1e-7
        np.testing.assert_allclose(moved.positions[20 + k, 0], (1 - right) * last[1] + right * after[1], atol=1e-9)


@pytest.mark.parametrize("gap", [True, False])
def test_what_was_recorded_after_a_break_is_not_played_on(gap):
    reference = tiny.reference(turning()[0].motion, segment_starts=(0, 30) if gap else (0,))
    config = tiny.config(blend={"method": "overlap", "l_blend": 4}, **ABSOLUTE)
    moved = show([reference], [Track(pieces_of((10, 30), (50, 70)))], config)
    for k in range(4):
        weight = (k + 5) / 9
        on = pose(0, 29 if gap else 30 + k)[1]
        np.testing.assert_allclose(
            moved.positions[20 + k, 0], (1 - weight) * on + weight * pose(0, 50 + k)[1], atol=1e-9
        )
        back = pose(0, 46 + k)[1]
        np.testing.assert_allclose(
            moved.positions[16 + k, 0], (1 - (k + 1) / 9) * pose(0, 26 + k)[1] + (k + 1) / 9 * back, atol=1e-9
        )


@SMALL
@given(
    seed=st.integers(0, 10_000), lengths=st.lists(st.integers(1, 15), min_size=1, max_size=6),
    l_blend=st.integers(0, 12), curve=st.sampled_from(["linear", "sigmoid", "smoothstep"]),
    rotations=st.sampled_from(["slerp", "expmap"]), mode=st.sampled_from(["return", "absolute"]),
    resample=st.sampled_from(["interpolate", "nearest"]), lock=st.booleans(), smooth=st.booleans(),
)  # fmt: skip
def test_any_tracks_give_finite_unit_frames_of_the_exact_count(
    seed, lengths, l_blend, curve, rotations, mode, resample, lock, smooth
):
    rng, references = np.random.default_rng(seed), bodies(seed, 80, 60)
    config = settings(
        blend={"method": "overlap", "l_blend": l_blend, "curve": curve, "rotations": rotations}, root={"mode": mode},
        resample=resample, feet={"lock": lock}, smoothing={"enabled": smooth},
    )  # fmt: skip
    upper, lower = (pieces_of(*runs(rng, lengths)) for _ in range(2))
    moved = show(references, [Track(upper), Track(lower, gb.LOWER)], config)
    assert moved.n_frames == sum(lengths)
    assert np.isfinite(moved.rotations).all() and np.isfinite(moved.positions).all()
    np.testing.assert_allclose(np.linalg.norm(moved.rotations, axis=-1), 1.0, atol=1e-12)


# --- the root -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spins", [(0.0, 0.0), (0.02, -0.03), (0.05, 0.05)])
@pytest.mark.parametrize("lengths", [(30, 30), (20, 45)])
def test_the_root_walks_on_through_a_join(spins, lengths):
    motions = [walk(60, (0.0, 90.0, 0.0), 0.3, 1.0, spins[0]), walk(60, (200.0, 90.0, -80.0), 2.5, 1.0, spins[1])]
    references = [tiny.reference(moved, name=f"clip{k}") for k, moved in enumerate(motions)]
    config = tiny.config(blend={"method": "overlap", "l_blend": 6}, root={"mode": "return", "return_half_life": 1e9})
    moved = show(references, [Track(pieces_of((10, 40, lengths[0]), (70, 100, lengths[1])))], config)
    places, heading = ground(moved)
    steps, turns = np.linalg.norm(np.diff(places, axis=0), axis=1), np.diff(heading)
    paces = [29 / (length - 1) for length in lengths]
    # The right side starts where the left one would be at its own recorded speed. From there on a blend over 13
    # steps of two speeds adds up to six thirteenths of their difference.
    apart, seam = abs(paces[0] - paces[1]) * 6 / 13, max(abs(pace - 1) for pace in paces) / 13
    assert steps.min() > 0.97 * min(paces) - apart - seam and steps.max() < 1.03 * max(paces) + apart + seam
    spun = [spin * pace for spin, pace in zip(spins, paces, strict=True)]
    apart, seam = abs(spun[0] - spun[1]) * 6 / 13, seam * max(map(abs, spins))
    assert turns.min() > min(spun) - apart - seam - 1e-9 and turns.max() < max(spun) + apart + seam + 1e-9
    if paces[0] == paces[1]:  # it walks where it looks
        direction = np.unwrap(np.arctan2(*np.diff(places, axis=0).T))
        assert np.abs(rotation.wrap_angle(direction - heading[1:])).max() < 0.15


def test_the_way_back_is_no_leap_either():
    motions = [walk(60, (0.0, 90.0, 0.0), 0.3, 1.0, 0.02), walk(60, (200.0, 90.0, -80.0), 2.5, 1.0, -0.02)]
    references = [tiny.reference(moved, name=f"clip{k}") for k, moved in enumerate(motions)]
    config = tiny.config(blend={"method": "overlap", "l_blend": 6})
    moved = show(references, [Track(pieces_of((10, 40), (70, 100)))], config)
    places, _ = ground(moved)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.max() < 1.0 + 260 * (1 - 0.5 ** (1 / 90))


def test_on_the_recorded_ground_the_root_is_blended_in_place():
    motions = [walk(60, (0.0, 90.0, 0.0), 0.0, 1.0), walk(60, (10.0, 90.0, 0.0), 0.0, 1.0)]
    references = [tiny.reference(moved, name=f"clip{k}") for k, moved in enumerate(motions)]
    config = tiny.config(blend={"method": "overlap", "l_blend": 4}, **ABSOLUTE)
    places, _ = ground(show(references, [Track(pieces_of((10, 30), (90, 110)))], config))
    expected = [*[0.0] * 16, *(10 * k / 9 for k in range(1, 9)), *[10.0] * 16]
    np.testing.assert_allclose(places[:, 0], expected, atol=1e-9)
    np.testing.assert_allclose(np.diff(places[:, 1]), 1.0, atol=1e-9)


# --- smoothing ----------------------------------------------------------------------------------------------


def filtered(rotations, window, order):
    smooth = savgol_filter(rotations, window, order, axis=0)
    return smooth / np.linalg.norm(smooth, axis=-1, keepdims=True)


def test_smoothing_filters_limbs_by_their_own_order():
    references = bodies(6, 80, 60)
    tracks = [Track(pieces_of(*UP)), Track(pieces_of(*DOWN), gb.LOWER)]
    rough = show(references, tracks, settings())
    limbs = [joint for joint, name in enumerate(gb.NAMES) if name in gb.ARMS or name == "b_neck0"]
    others = [joint for joint in range(len(gb.NAMES)) if joint not in limbs]
    smooth = show(references, tracks, settings(smoothing={"enabled": True}))
    # No quaternion changes its sign in a motion as slow as this one.
    assert (np.sum(rough.rotations[1:] * rough.rotations[:-1], axis=-1) > 0).all()
    for joints, order in ((limbs, 2), (others, 1)):
        expected = filtered(rough.rotations[:, joints], 7, order)
        assert angles(smooth.rotations[:, joints], expected).max() < 1e-7
    assert angles(smooth.rotations, rough.rotations)[:, limbs].max() > 1e-4
    np.testing.assert_allclose(smooth.positions[:, 0], savgol_filter(rough.positions[:, 0], 7, 1, axis=0), atol=1e-9)
    np.testing.assert_allclose(smooth.positions[:, 1:], rough.positions[:, 1:], rtol=0, atol=1e-12)
    # A polynomial through all frames of the window leaves them as they are.
    for kept, changed, orders in ((limbs, others, (6, 1)), (others, limbs, (1, 6))):
        limb_order, order = orders
        own = show(references, tracks, settings(smoothing={"enabled": True, "limb_order": limb_order, "order": order}))
        assert angles(own.rotations, rough.rotations)[:, kept].max() < 1e-6
        assert (angles(own.rotations, rough.rotations)[:, changed].max(axis=0) > 1e-4).all()


# --- what is read -------------------------------------------------------------------------------------------


class Counting(Sequence):
    """References that count how often each is asked for."""

    def __init__(self, references):
        self.references, self.asked = references, Counter()

    def __getitem__(self, place):
        self.asked[int(place)] += 1
        return self.references[place]

    def __len__(self):
        return len(self.references)


@SMALL
@given(
    seed=st.integers(0, 10_000),
    method=st.sampled_from(["overlap", "crossfade", "inertialize", "least_jerk", "least_change"]),
)
def test_only_the_references_that_are_shown_are_read_and_each_once(seed, method):
    rng, references = np.random.default_rng(seed), bodies(seed, *[40] * 6)
    config = settings(blend={"method": method})
    graph, shown, tracks = frames_of(references, config), set(), []
    for joints in (None, gb.LOWER, gb.FINGERS):
        rows = []
        for _ in range(2):
            clip, first = int(rng.integers(6)), int(rng.integers(0, 30))
            rows.append((40 * clip + first, 40 * clip + first + 10))
            shown.add(clip)
        tracks.append(Track(pieces_of(*rows), joints))
    counting = Counting(references)
    moved = render(Path(tuple(tracks)), counting, graph, config)
    assert moved.n_frames == 20
    assert counting.asked == Counter(shown) + Counter([0])

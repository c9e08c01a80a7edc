"""From a path to motion: frame counts, joins, resampling, holds, the root, blending, feet, fingers."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from gesturegen.methods.motion_graph.graph import build
from gesturegen.metrics.feet import foot_skate
from gesturegen.motion import blend, kinematics, rotation
from gesturegen.motion.skeleton import Motion
from gesturegen.path import resampled_indices
from gesturegen.render import render
from tests import naive, tiny
from tests.builders import make_skeleton

RECORDED = {"root": {"mode": "absolute"}, "blend": {"l_blend": 0}}
STEADY = {"root": {"mode": "return"}, "blend": {"l_blend": 0}}


def show(motions, *pieces, segment_starts=(0,), **sections):
    """The rendered motion of pieces (runs of nodes, or (nodes, length)) over reference motions."""
    config = tiny.config(**sections)
    references = [tiny.reference(m, segment_starts=segment_starts, name=f"clip{k}") for k, m in enumerate(motions)]
    return render(tiny.path_of(*pieces), references, build(references, config), config)


def random_motions(seed, *frames):
    rng = np.random.default_rng(seed)
    return [tiny.motion(rng, count) for count in frames]


# --- frames -------------------------------------------------------------------------------------------------


@settings(deadline=None, derandomize=True, max_examples=150)
@given(
    seed=st.integers(0, 10_000),
    frames=st.lists(st.integers(1, 20), min_size=1, max_size=3),
    lengths=st.lists(st.tuples(st.integers(1, 12), st.integers(1, 12)), min_size=1, max_size=6),
    blend=st.fixed_dictionaries({
        "method": st.sampled_from(["crossfade", "inertialize", "least_jerk", "least_change"]), "l_blend": st.integers(0, 9),
        "curve": st.sampled_from(["linear", "sigmoid", "smoothstep"]), "rotations": st.sampled_from(["slerp", "expmap"]),
    }),
    mode=st.sampled_from(["return", "absolute"]),
    resample=st.sampled_from(["interpolate", "nearest"]),
    fingers=st.sampled_from(["follow", "rest"]),
)  # fmt: skip
def test_any_path_gives_finite_unit_frames_of_the_exact_count(seed, frames, lengths, blend, mode, resample, fingers):
    rng = np.random.default_rng(seed)
    motions = random_motions(seed, *frames)
    pieces = [(rng.integers(0, sum(frames), size=nodes).tolist(), length) for nodes, length in lengths]
    moved = show(motions, *pieces, blend=blend, root={"mode": mode}, resample=resample, fingers=fingers)
    assert moved.n_frames == sum(length for _, length in lengths)
    assert np.isfinite(moved.rotations).all() and np.isfinite(moved.positions).all()
    np.testing.assert_allclose(np.linalg.norm(moved.rotations, axis=-1), 1.0, atol=1e-12)
    assert moved.fps == tiny.FPS and moved.skeleton is motions[0].skeleton


def exact_motion(frames):
    """A motion whose quaternions have the norm 1 to the last bit."""
    (moved,) = random_motions(1, frames)
    some = np.array([[1, 0, 0, 0], [0.5, 0.5, 0.5, 0.5], [0, 1, 0, 0], [0.5, -0.5, 0.5, -0.5]])
    return Motion(moved.skeleton, some[np.arange(frames * 5).reshape(frames, 5) * 7 % 4], moved.positions, tiny.FPS)


@pytest.mark.parametrize("method", ["crossfade", "inertialize", "least_jerk", "least_change"])
def test_natural_joins_leave_the_recorded_frames_bit_for_bit(method):
    recorded = exact_motion(30)
    moved = show([recorded], range(3, 10), range(10, 22), [22], root={"mode": "absolute"}, blend={"method": method})
    np.testing.assert_array_equal(moved.positions, recorded.positions[3:23])
    np.testing.assert_array_equal(moved.rotations, recorded.rotations[3:23])


def test_natural_joins_leave_any_recorded_motion_to_the_last_digits():
    (recorded,) = random_motions(2, 30)
    moved = show([recorded], range(3, 10), range(10, 23), root={"mode": "absolute"})
    np.testing.assert_array_equal(moved.positions, recorded.positions[3:23])
    np.testing.assert_allclose(moved.rotations, recorded.rotations[3:23], rtol=0, atol=1e-15)


def test_a_natural_path_keeps_its_recorded_root():
    (recorded,) = random_motions(3, 30)
    moved = show([recorded], range(3, 10), range(10, 23))
    np.testing.assert_allclose(moved.positions, recorded.positions[3:23], atol=1e-12)
    np.testing.assert_allclose(moved.rotations, recorded.rotations[3:23], atol=1e-12)


def test_the_end_of_a_segment_is_held_without_blending():
    (recorded,) = random_motions(4, 20)
    moved = show([recorded], [7, 8, 9], [9, 9], segment_starts=(0, 10), root={"mode": "absolute"})
    np.testing.assert_array_equal(moved.positions, recorded.positions[[7, 8, 9, 9, 9]])


def test_several_references_are_numbered_one_after_the_other():
    first, second, third = random_motions(5, 6, 1, 8)
    moved = show([first, second, third], [5, 6, 7, 14, 0], **RECORDED)
    expected = [first.positions[5], second.positions[0], third.positions[0], third.positions[7], first.positions[0]]
    np.testing.assert_array_equal(moved.positions, expected)
    np.testing.assert_allclose(moved.rotations[2], third.rotations[0], atol=1e-15)


# --- resampling ---------------------------------------------------------------------------------------------


def test_resampling_is_even_from_end_to_end():
    (recorded,) = random_motions(6, 20)
    moved = show([recorded], (range(4, 14), 11), **RECORDED)
    np.testing.assert_array_equal(moved.positions[[0, -1]], recorded.positions[[4, 13]])
    for frame in range(11):
        at = 4 + frame * 9 / 10
        low, weight = int(at), at - int(at)
        high = min(low + 1, 13)
        expected = (1 - weight) * recorded.positions[low] + weight * recorded.positions[high]
        np.testing.assert_allclose(moved.positions[frame], expected, atol=1e-12)
        for joint in range(5):
            turned = naive.slerp(recorded.rotations[low, joint], recorded.rotations[high, joint], weight)
            assert rotation.angle_between(moved.rotations[frame, joint], turned) < 1e-7


def test_nearest_takes_recorded_frames():
    (recorded,) = random_motions(7, 20)
    moved = show([recorded], (range(4, 14), 9), resample="nearest", **RECORDED)
    # 9 frames over the indices 0 to 9: 0, 1.125, 2.25, 3.375, 4.5 (a tie), 5.625, 6.75, 7.875, 9
    np.testing.assert_array_equal(moved.positions[[0, 1, 2, 3]], recorded.positions[[4, 5, 6, 7]])
    np.testing.assert_array_equal(moved.positions[[5, 6, 7, 8]], recorded.positions[[10, 11, 12, 13]])
    assert (moved.positions[4] == recorded.positions[8]).all() or (moved.positions[4] == recorded.positions[9]).all()


def test_resampling_does_not_reach_into_the_next_piece():
    (recorded,) = random_motions(8, 40)
    moved = show([recorded], (range(4, 14), 11), (range(30, 35), 5), **RECORDED)
    np.testing.assert_array_equal(moved.positions[[10, 11]], recorded.positions[[13, 30]])


def test_one_node_fills_a_piece():
    (recorded,) = random_motions(9, 10)
    moved = show([recorded], ([6], 1), ([6], 4), **RECORDED)
    np.testing.assert_array_equal(moved.positions, recorded.positions[[6] * 5])


def test_a_piece_of_one_frame_shows_its_stop_node():
    # Its stop node is shown at the piece's last frame, which here is its only one (beam.max_ratio of 2 or more).
    (recorded,) = random_motions(10, 10)
    moved = show([recorded], ([3, 4], 1), **RECORDED)
    np.testing.assert_array_equal(moved.positions, recorded.positions[[4]])


def test_source_indices_of_equal_lengths_are_whole_numbers():
    for length in range(1, 200):
        (piece,) = tiny.path_of(range(length)).tracks[0].pieces
        assert resampled_indices(len(piece.nodes), piece.target.length).tolist() == list(range(length))


# --- holds --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["return", "absolute"])
@pytest.mark.parametrize("method", ["crossfade", "inertialize"])
@pytest.mark.parametrize(
    # At the end of a segment nothing natural follows; `nearest` shows recorded frames only.
    ("nodes", "resample"), [([7, 8, 9, 9, 9, 9], "interpolate"), ([3, 4, 5, 5, 5, 5, 6], "nearest")]
)  # fmt: skip
def test_holds_do_not_move(mode, method, nodes, resample):
    (recorded,) = random_motions(11, 20)
    options = {"root": {"mode": mode}, "blend": {"method": method}, "resample": resample}
    moved = show([recorded], nodes, segment_starts=(0, 10), **options)
    for frame in (3, 4, 5):
        np.testing.assert_array_equal(moved.positions[frame], moved.positions[2])
        np.testing.assert_array_equal(moved.rotations[frame], moved.rotations[2])
    np.testing.assert_allclose(moved.positions[-1], recorded.positions[nodes[-1]], atol=1e-12)


def test_holds_after_a_jump_do_not_move_the_root():
    motions = random_motions(12, 20, 20)
    moved = show(motions, [3, 4, 5], [30, 30, 30, 30], **STEADY)
    for frame in (4, 5, 6):
        np.testing.assert_array_equal(moved.positions[frame], moved.positions[3])


def ramp(frames):
    """A motion whose root is at the number of its frame along X, in cm, and turns by a hundredth of that."""
    numbers = np.arange(float(frames))
    moved = still_motion(frames)
    positions, rotations = moved.positions.copy(), moved.rotations.copy()
    positions[:, 0, 0], rotations[:, 0] = numbers, rotation.about_y(numbers / 100)
    return Motion(moved.skeleton, rotations, positions, tiny.FPS)


def nodes_shown(*pieces, **options):
    """The fractional node that each output frame shows."""
    moved = show([ramp(60)], *pieces, **RECORDED | options)
    np.testing.assert_allclose(rotation.heading(moved.rotations[:, 0]), moved.positions[:, 0, 0] / 100, atol=1e-9)
    return moved.positions[:, 0, 0]


def test_a_hold_before_its_natural_successor_is_slow_motion():
    shown = nodes_shown([3, 4, 5, 5, 5, 5, 6, 7, 7, 8])
    np.testing.assert_allclose(shown, [3, 4, 5, 5.25, 5.5, 5.75, 6, 7, 7.5, 8], atol=1e-12)


def test_slow_motion_is_a_matter_of_one_piece():
    # A piece that starts where the last one ended is a join; a held end goes on into the next piece.
    np.testing.assert_allclose(nodes_shown([4, 5], [5, 5, 6], [6, 7]), [4, 5, 5, 5.5, 6, 6, 7], atol=1e-12)
    np.testing.assert_allclose(nodes_shown([4, 5, 5], [6, 7]), [4, 5, 5.5, 6, 7], atol=1e-12)


@pytest.mark.parametrize("nodes", [[3, 4, 4, 4, 20, 21], [3, 4, 4, 4, 3], [3, 4, 4, 4], [4, 4, 4, 6]])
def test_a_hold_before_anything_else_stays(nodes):
    assert nodes_shown(nodes).tolist() == nodes


def test_a_hold_at_the_end_of_a_segment_stays():
    assert nodes_shown([8, 9, 9, 9, 10, 11], segment_starts=(0, 10)).tolist() == [8, 9, 9, 9, 10, 11]


def test_nearest_knows_no_slow_motion():
    assert nodes_shown([3, 4, 5, 5, 5, 6], resample="nearest").tolist() == [3, 4, 5, 5, 5, 6]
    assert nodes_shown(([4, 5, 5, 6], 10), resample="nearest").tolist() == [4] * 2 + [5] * 6 + [6] * 2


@pytest.mark.parametrize("lengths", [(7, 5), (12, 9), (1, 1), (3, 30)])
def test_pieces_without_holds_end_at_their_last_nodes(lengths):
    shown = nodes_shown((range(10, 17), lengths[0]), (range(17, 22), lengths[1]))
    assert shown[lengths[0] - 1] == 16 and shown[-1] == 21
    if lengths[1] > 1:
        assert shown[lengths[0]] == 17


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    holds=st.lists(st.integers(1, 4), min_size=2, max_size=12), share=st.floats(0, 1), lengths=st.tuples(*[st.integers(1, 40)] * 2)
)  # fmt: skip
def test_slow_motion_is_even_at_any_resampling(holds, share, lengths):
    # Each node of a natural path stands for as long as it is held, and leads to the next one all the while.
    nodes = np.repeat(np.arange(5, 5 + len(holds)), holds)
    nodes = nodes[: len(nodes) - holds[-1] + 1]
    starts = np.concatenate([[0], np.cumsum(holds[:-1])])
    cut = int(starts[1:][int(share * (len(starts) - 2))])
    shown = nodes_shown((nodes[:cut], lengths[0]), (nodes[cut:], lengths[1]))
    places = [resampled_indices(cut, lengths[0]), cut + resampled_indices(len(nodes) - cut, lengths[1])]
    expected = np.interp(np.concatenate(places), starts, np.arange(5, 5 + len(holds)))
    np.testing.assert_allclose(shown, expected, atol=1e-9)


def test_a_resampled_way_to_a_hold_is_not_cut_short():
    # Half-way to node 5 after half a step, however long it is held.
    np.testing.assert_allclose(nodes_shown(([4, 5, 5, 6], 7)), [4, 4.5, 5, 5.25, 5.5, 5.75, 6], atol=1e-12)


# --- cross-fade ---------------------------------------------------------------------------------------------


def seams_of(pieces, successors):
    """First frames of the pieces that do not follow naturally."""
    ends = itertools.accumulate(length for _, length in pieces)
    return [end for end, (before, _), (after, _) in zip(ends, pieces, pieces[1:], strict=False)
            if after[0] != successors[before[-1]]]  # fmt: skip


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    seed=st.integers(0, 10_000), l_blend=st.integers(0, 9), count=st.integers(1, 7),
    mode=st.sampled_from(["absolute", "return"]),
)  # fmt: skip
def test_crossfade_equals_the_naive_one(seed, l_blend, count, mode):
    rng = np.random.default_rng(seed)
    motions = random_motions(seed, 30)
    pieces, node = [], 0
    for _ in range(count):
        if node >= 25 or rng.random() < 0.6:
            node = int(rng.integers(0, 25))
        nodes = list(range(node, min(node + int(rng.integers(1, 13)), 30)))
        pieces.append((nodes, max(1, len(nodes) + int(rng.integers(-1, 2)))))
        node = nodes[-1] + 1
    raw = show(motions, *pieces, root={"mode": mode}, blend={"l_blend": 0})
    moved = show(motions, *pieces, root={"mode": mode}, blend={"l_blend": l_blend})
    successors = [*range(1, 30), 29]
    rotations, positions = naive.crossfade(raw.rotations, raw.positions, seams_of(pieces, successors), l_blend)
    np.testing.assert_allclose(moved.positions, positions, atol=1e-9)
    same = np.abs(np.sum(moved.rotations * rotations, axis=-1))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)


def still_motion(frames, place=(0.0, 0.0, 0.0), turn=0.0, bones=None, travelling=0, rest=None):
    """Standing still at `place` on the travelling joint, turned by `turn` about the vertical."""
    bones = tiny.skeleton() if bones is None else bones
    rotations = np.tile(rotation.IDENTITY, (frames, len(bones.names), 1))
    if rest is not None:
        rotations[:, :] = rest
    rotations[:, travelling] = rotation.multiply(rotation.about_y(turn), rotations[:, travelling])
    positions = np.tile(bones.offsets, (frames, 1, 1))
    positions[:, travelling] += place
    return Motion(bones, rotations, positions, tiny.FPS)


@pytest.mark.parametrize(
    ("curve", "expected"), [("linear", lambda x: x), ("smoothstep", lambda x: x * x * (3 - 2 * x))]
)
def test_crossfade_weights_run_from_one_to_m_over_m_plus_one(curve, expected):
    motions = [still_motion(10), still_motion(10, (17.0, 0.0, 0.0))]
    moved = show(motions, range(10), range(10, 20), root={"mode": "absolute"}, blend={"curve": curve})
    x = moved.positions[:, 0, 0]
    np.testing.assert_allclose(x[2:18], 17 * expected(np.arange(1, 17) / 17), atol=1e-12)
    assert x[:2].tolist() == [0, 0] and x[18:].tolist() == [17, 17]


def test_sigmoid_weights_rise_symmetrically_inside_the_open_interval():
    motions = [still_motion(10), still_motion(10, (1.0, 0.0, 0.0))]
    moved = show(motions, range(10), range(10, 20), root={"mode": "absolute"}, blend={"curve": "sigmoid"})
    x = moved.positions[2:18, 0, 0]
    assert (np.diff(x) > 0).all() and 0 < x[0] < 0.05
    np.testing.assert_allclose(x + x[::-1], 1.0, atol=1e-12)


def test_crossfade_uses_what_short_pieces_have():
    # Three frames left, two right: m = 5, weights 1/6 to 5/6.
    motions = [still_motion(3), still_motion(2, (6.0, 0.0, 0.0))]
    moved = show(motions, range(3), range(3, 5), root={"mode": "absolute"})
    np.testing.assert_allclose(moved.positions[:, 0, 0], [1, 2, 3, 4, 5], atol=1e-12)


def test_crossfade_turns_at_an_even_rate():
    motions = [still_motion(8), still_motion(8, turn=1.7)]
    moved = show(motions, range(8), range(8, 16), root={"mode": "absolute"}, blend={"rotations": "slerp"})
    np.testing.assert_allclose(rotation.heading(moved.rotations[:, 0]), 1.7 * np.arange(1, 17) / 17, atol=1e-12)


@pytest.mark.parametrize("turn", [0.5, -2.5])
def test_expmap_crossfade_of_turns_about_one_axis_is_slerp(turn):
    motions = [still_motion(8, turn=0.3), still_motion(8, turn=turn)]
    faded = [
        show(motions, range(8), range(8, 16), root={"mode": "absolute"}, blend={"rotations": how})
        for how in ("slerp", "expmap")
    ]
    assert rotation.angle_between(faded[0].rotations, faded[1].rotations).max() < 1e-7


def test_expmap_crossfade_takes_the_nearer_of_two_maps():
    # 170 and 190 degrees about the vertical: the maps +170 and -170 are 20 degrees apart, not 340.
    motions = [still_motion(8, turn=np.radians(170)), still_motion(8, turn=np.radians(190))]
    moved = show(motions, range(8), range(8, 16), root={"mode": "absolute"}, blend={"rotations": "expmap"})
    assert rotation.angle_between(moved.rotations[:-1], moved.rotations[1:]).max() < np.radians(2)


# --- the root -----------------------------------------------------------------------------------------------


def parented():
    """A skeleton whose travelling joint hangs below a joint that itself is moved and turned."""
    return tiny.skeleton(("world", "body", "b_root", "b_spine0", "b_r_leg"), (-1, 0, 1, 2, 2))


def walk(frames, place, turn, speed, spin=0.0, bones=None, parent=None, rest=None):
    """Walking at `speed` cm per frame in the direction of the body, which turns by `spin` per frame."""
    bones = tiny.skeleton() if bones is None else bones
    travelling = 0 if bones.names[0] == "b_root" else 1
    heading = turn + spin * np.arange(frames)
    steps = speed * np.column_stack([np.sin(heading), np.zeros(frames), np.cos(heading)])
    world = np.array(place) + np.cumsum(steps, axis=0)
    facing = rotation.about_y(heading)
    positions, rotations = np.tile(bones.offsets, (frames, 1, 1)), np.tile(rotation.IDENTITY, (frames, 5, 1))
    if travelling:
        parent = rotation.IDENTITY if parent is None else parent
        rotations[:, 0], positions[:, 0] = parent, [10.0, 5.0, -3.0]
        world = rotation.rotate(rotation.inverse(parent)[None], world - positions[:, 0])
        facing = rotation.multiply(rotation.inverse(parent), facing)
    rotations[:, travelling], positions[:, travelling] = facing, world
    if rest is not None:
        rotations[:, 2 if travelling else 0] = rotation.multiply(rotations[:, 2 if travelling else 0], rest)
    return Motion(bones, rotations, positions, tiny.FPS)


def ground(moved, rest=None):
    """Ground positions of the travelling joint, and the pelvis's heading in radians, unwrapped."""
    travelling = 0 if moved.skeleton.names[0] == "b_root" else 1
    rotations, positions = kinematics.world_transforms(moved, [travelling, moved.skeleton.index("b_root")])
    forward = rotation.rotate(rotation.inverse(rotation.IDENTITY if rest is None else rest), np.array([0.0, 0.0, 1.0]))
    facing = rotation.rotate(rotations[:, 1], np.tile(forward, (moved.n_frames, 1)))
    return positions[:, 0][:, [0, 2]], np.unwrap(np.arctan2(facing[:, 0], facing[:, 2]))


SIDEWAYS = rotation.from_euler("XZ", np.radians([[90.0, 35.0]]))[0]
TILTED = rotation.from_euler("YX", np.radians([[50.0, 20.0]]))[0]
KINDS = {
    "plain": {},
    "pelvis with its own axes": {"rest": SIDEWAYS},
    "below a turned parent": {"bones": parented(), "parent": rotation.about_y(np.array(1.1))},
    "below a tilted parent": {"bones": parented(), "parent": TILTED},
    "below a tilted parent with its own axes": {"bones": parented(), "parent": TILTED, "rest": SIDEWAYS},
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("turn", [90, -90, 180, 10])
@pytest.mark.parametrize("spin", [0.0, 0.02])
def test_the_root_does_not_jump_at_a_join(kind, turn, spin):
    options = KINDS[kind]
    motions = [
        walk(40, (0.0, 90.0, 0.0), 0.2, 1.5, spin, **options),
        walk(40, (500.0, 90.0, -300.0), 0.2 + np.radians(turn), 0.8, spin, **options),
    ]
    moved = show(motions, range(20), range(50, 70), **STEADY)
    places, heading = ground(moved, options.get("rest"))
    steps, turns = np.linalg.norm(np.diff(places, axis=0), axis=1), np.abs(np.diff(heading))
    # Across the join: one recorded step of the left side, to the last digits.
    assert steps[19] == pytest.approx(1.5, abs=1e-6) and turns[19] == pytest.approx(spin, abs=1e-6)
    # Elsewhere: the recorded step and what the decaying offset adds.
    fade = 1 - 0.5 ** (1 / 90)
    offset = np.linalg.norm(places[20] - ground(motions[1], options.get("rest"))[0][10])
    assert steps[:19].max() <= 1.5 + 1e-6 and steps[20:].max() <= 0.8 + fade * (offset + 2 * 20 * 0.8)
    assert turns.max() <= spin + fade * np.pi + 1e-6
    # Within the first frame after the join the body walks the way it now faces, not the recorded way.
    way = places[21] - places[20] + fade * (places[20] - ground(motions[1], options.get("rest"))[0][10])
    assert np.arctan2(*way) == pytest.approx(heading[20] + spin, abs=0.02)


@pytest.mark.parametrize("kind", KINDS)
def test_the_crossfade_does_not_make_the_root_jump(kind):
    options = KINDS[kind]
    motions = [walk(40, (0.0, 90.0, 0.0), 0.2, 1.5, **options), walk(40, (50.0, 90.0, -30.0), 1.8, 1.5, **options)]
    moved = show(motions, range(20), range(50, 70))
    places, heading = ground(moved, options.get("rest"))
    # Where the cross-fade sets in, a steady walk gains 8/17 of a step on itself: the held side is 8 steps ahead.
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.max() <= 1.5 * (1 + 8 / 17) + (1 - 0.5 ** (1 / 90)) * 100
    assert np.abs(np.diff(heading)).max() <= (1 - 0.5 ** (1 / 90)) * np.pi


def test_height_and_lean_stay_recorded():
    motions = [walk(10, (0.0, 90.0, 0.0), 0.0, 1.0), walk(10, (70.0, 84.0, 20.0), 2.0, 1.0)]
    lean = rotation.multiply(motions[1].rotations[:, :1], rotation.from_expmap(np.array([0.3, 0.0, 0.1])))
    rotations = np.concatenate([lean, motions[1].rotations[:, 1:]], axis=1)
    motions[1] = Motion(motions[1].skeleton, rotations, motions[1].positions, tiny.FPS)
    moved = show(motions, range(10), range(10, 20), **STEADY)
    np.testing.assert_allclose(moved.positions[10:, 0, 1], motions[1].positions[:, 0, 1])
    up = np.array([0.0, 1.0, 0.0])
    # The angle to the vertical is the recorded one, whatever the heading.
    shown, recorded = (rotation.rotate(q[:, 0], np.tile(up, (10, 1)))[:, 1] for q in (moved.rotations[10:], rotations))
    np.testing.assert_allclose(shown, recorded, atol=1e-12)


def test_other_joints_keep_their_recorded_rotations():
    motions = random_motions(13, 12, 12)
    moved = show(motions, range(6), range(15, 21), **STEADY)
    np.testing.assert_allclose(moved.rotations[6:, 1:], motions[1].rotations[3:9, 1:], atol=1e-15)
    np.testing.assert_allclose(moved.positions[6:, 1:], motions[1].positions[3:9, 1:], atol=1e-12)


@pytest.mark.parametrize("half_life", [1.0, 3.0])
@pytest.mark.parametrize("kind", ["plain", "below a turned parent", "below a tilted parent"])
def test_the_offset_halves_in_the_half_life(half_life, kind):
    frames = round(half_life * 30)
    motions = [walk(5, (0.0, 0.0, 0.0), 0.0, 0.0, **KINDS[kind]) for _ in range(2)]
    motions[1] = walk(2 * frames + 1, (100.0, 0.0, 50.0), np.radians(80), 0.0, **KINDS[kind])
    # A joint travels in the first clip, so that the renderer knows which one does.
    motions[0] = walk(5, (0.0, 0.0, 0.0), 0.0, 0.01, **KINDS[kind])
    moved = show(
        motions, range(5), range(5, 2 * frames + 6), root={"return_half_life": half_life}, blend={"l_blend": 0}
    )
    places, heading = ground(moved)
    offsets = places[5:] - [100.0, 50.0]
    turned = heading[5:] - np.radians(80)
    assert turned[0] == pytest.approx(np.radians(-80)) and offsets[0] == pytest.approx([-100, -50], abs=0.1)
    for after, share in ((frames, 0.5), (2 * frames, 0.25)):
        np.testing.assert_allclose(offsets[after], share * offsets[0], atol=1e-9)
        assert turned[after] == pytest.approx(share * turned[0])


def test_absolute_gives_the_recorded_root():
    motions = random_motions(14, 12, 12)
    moved = show(motions, range(6), range(15, 21), **RECORDED)
    np.testing.assert_array_equal(moved.positions[:6], motions[0].positions[:6])
    np.testing.assert_array_equal(moved.positions[6:], motions[1].positions[3:9])
    np.testing.assert_allclose(moved.rotations[6:], motions[1].rotations[3:9], atol=1e-15)


def test_absolute_crossfades_the_recorded_root():
    motions = [still_motion(8), still_motion(8, (17.0, 0.0, 34.0))]
    moved = show(motions, range(8), range(8, 16), root={"mode": "absolute"})
    np.testing.assert_allclose(moved.positions[:, 0, [0, 2]], np.outer(np.arange(1, 17), [1, 2]), atol=1e-12)


def test_the_root_does_not_jump_at_unnatural_edges_inside_a_piece():
    motions = [walk(40, (0.0, 90.0, 0.0), 0.0, 1.0), walk(40, (200.0, 90.0, 0.0), 2.0, 1.0)]
    moved = show(motions, [*range(10), *range(50, 60)], **STEADY)
    places, heading = ground(moved)
    assert np.linalg.norm(places[10] - places[9]) == pytest.approx(1.0, abs=1e-6)
    assert abs(heading[10] - heading[9]) < 1e-6


def test_the_root_does_not_jump_into_a_clip_that_travels_by_another_joint_than_the_first():
    # Nothing varies in the first clip, of one frame; in the second one `body` travels, not the root of the skeleton.
    bones = parented()
    first = walk(1, (0.0, 90.0, 0.0), 0.0, 1.0, bones=bones)
    second = walk(30, (200.0, 90.0, 100.0), 1.0, 1.0, bones=bones)
    places, _ = ground(show([first, second], [0, 0, 0], range(5, 15), **STEADY))
    assert np.linalg.norm(places[3] - places[2]) <= 1.0 + 1e-6


# --- inertialization ----------------------------------------------------------------------------------------


def inertial(motions, *pieces, half_life=0.1, mode="absolute"):
    return show(motions, *pieces, root={"mode": mode}, blend={"method": "inertialize", "half_life": half_life})


def test_inertialization_changes_nothing_without_jumps():
    (recorded,) = random_motions(15, 30)
    moved = inertial([recorded], range(3, 10), range(10, 23))
    np.testing.assert_array_equal(moved.positions, recorded.positions[3:23])
    np.testing.assert_allclose(moved.rotations, recorded.rotations[3:23], atol=1e-15)


def test_inertialization_leaves_the_left_side_alone():
    motions = random_motions(16, 20, 20)
    moved = inertial(motions, range(3, 10), range(25, 32))
    np.testing.assert_array_equal(moved.positions[:7], motions[0].positions[3:10])
    np.testing.assert_allclose(moved.rotations[:7], motions[0].rotations[3:10], atol=1e-15)


def test_inertialization_goes_on_where_the_left_side_was_heading():
    motions = random_motions(17, 20, 20)
    moved = inertial(motions, range(3, 10), range(25, 32))
    np.testing.assert_allclose(moved.positions[7], motions[0].positions[10], atol=1e-12)
    assert rotation.angle_between(moved.rotations[7], motions[0].rotations[10]).max() < 1e-7


def test_inertialization_keeps_the_velocity():
    # 2 cm per frame to the left, standing still to the right, and half-lives so long that one frame is short.
    motions = [walk(20, (0.0, 0.0, 0.0), 0.0, 2.0, 0.03), still_motion(200, (5.0, 0.0, 8.0), 1.0)]
    moved = inertial(motions, range(10), range(20, 200), half_life=4.0)
    places, heading = ground(moved)
    steps, turns = np.diff(places, axis=0), np.diff(heading)
    np.testing.assert_allclose(steps[10], steps[9], atol=0.1)
    assert turns[10] == pytest.approx(turns[9], abs=0.002)
    # No step differs much from the one before it.
    assert np.linalg.norm(np.diff(steps, axis=0), axis=1).max() < 0.1


def test_an_offset_is_gone_after_ten_half_lives():
    motions = random_motions(18, 20, 60)
    moved = inertial(motions, range(3, 10), range(22, 62))
    # Ten half-lives of 0.1 s are 30 frames.
    first, late = np.abs(moved.positions[7] - motions[1].positions[2]).max(), 7 + 30
    gap = np.abs(moved.positions[late:] - motions[1].positions[32:42]).max()
    assert gap < 1e-3 * first
    assert rotation.angle_between(moved.rotations[late:], motions[1].rotations[32:42]).max() < 1e-3


def test_an_offset_at_rest_halves_about_as_fast_as_the_half_life_says():
    motions = [still_motion(5), still_motion(60, (8.0, 0.0, 0.0))]
    moved = inertial(motions, range(5), range(5, 65), half_life=0.5)
    gap = 8.0 - moved.positions[5:, 0, 0]
    assert gap[0] == pytest.approx(8.0) and (np.diff(gap) < 0).all()
    # A critically damped spring takes a little longer than its half-life to the first half, and less from there on.
    assert gap[15] == pytest.approx(8 * (1 + 2 * np.log(2)) / 4)


def test_a_second_jump_takes_over_what_is_left_of_the_first():
    motions = [still_motion(20, (x, 0.0, 0.0)) for x in (0.0, 8.0, 30.0)]
    moved = inertial(motions, range(5), range(25, 28), range(45, 55), half_life=1.0)
    x = moved.positions[:, 0, 0]
    # The pose never leaps, although the first offset has hardly begun to decay.
    assert np.abs(np.diff(x)).max() < 0.5


def test_unnatural_edges_inside_a_piece_are_inertialized_too():
    motions = [still_motion(20), still_motion(20, (8.0, 0.0, 0.0))]
    moved = inertial(motions, [*range(5), *range(25, 35)], half_life=0.5)
    assert moved.positions[5, 0, 0] == pytest.approx(0.0)


def test_the_root_and_the_body_can_be_inertialized_together():
    motions = [walk(40, (0.0, 90.0, 0.0), 0.0, 1.0), walk(40, (200.0, 90.0, 0.0), 2.0, 1.0)]
    places, heading = ground(inertial(motions, range(10), range(50, 60), mode="return"))
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 1.0 + 200 * (1 - 0.5 ** (1 / 90))
    assert np.abs(np.diff(heading)).max() < 0.1


def test_inertialization_goes_on_where_the_left_side_was_heading_when_the_right_one_is_held():
    motions = random_motions(17, 20, 20)
    moved = inertial(motions, range(3, 10), [25, 25, 25, 25, 26, 27])
    np.testing.assert_allclose(moved.positions[7], motions[0].positions[10], atol=1e-12)
    assert rotation.angle_between(moved.rotations[7], motions[0].rotations[10]).max() < 1e-7


# --- corrections of least jerk ------------------------------------------------------------------------------


def jumping(pieces, successors):
    """bool `[shape=(n_frames,)]`: output frames with a jump on the way from the one before, node by node."""
    nodes = [node for piece, _ in pieces for node in piece]
    times, first = [], 0
    for piece, length in pieces:
        times += [first + place for place in resampled_indices(len(piece), length).tolist()]
        first += len(piece)
    jumps = [False]
    for before, after in itertools.pairwise(times):
        # The pose at a fraction is made of both its neighbours.
        steps = range(int(np.floor(before + 1e-9)), int(np.ceil(after - 1e-9)))
        jumps.append(any(nodes[k + 1] not in (successors[nodes[k]], nodes[k]) for k in steps))
    return np.array(jumps)


def as_crossfade(motions, pieces, reach, **options):
    raw = show(motions, *pieces, blend={"l_blend": 0}, **options)
    jumps = jumping(pieces, [*range(1, 30), 29])
    return jumps, *blend.least_jerk(raw.rotations, raw.positions, jumps, reach * tiny.FPS)


@pytest.mark.parametrize(
    ("pieces", "frames"),
    [
        ([(range(5), 5), (range(20, 25), 5)], [5]),
        ([([*range(5), *range(20, 25)], 10)], [5]),
        # Ten nodes over eleven frames: from 4.5 over 5.4 on, the jump 4 to 5 is a part of both steps.
        ([([*range(5), *range(20, 25)], 11)], [5, 6]),
        # Over 19 frames every other one is half-way between two nodes, frame 9 between the sides of the jump.
        ([([*range(5), *range(20, 25)], 19)], [9, 10]),
        ([([*range(5), *range(20, 25)], 4)], [2]),
        ([(range(5), 5), (range(5, 9), 7), ([9, 9, 9], 3)], []),
        ([([3], 4), ([12], 4)], [4]),
        # Out of slow motion, and into it.
        ([([3, 4, 5, 5, 6, 20, 21], 7)], [5]),
        ([([3, 20, 20, 20, 21, 22], 6)], [1]),
        # Pieces meet without a frame between them, so that all of it is in one step.
        ([(range(5), 9), (range(20, 25), 9)], [9]),
    ],
)
def test_jumps_are_where_recorded_motion_does_not_go_on(pieces, frames):
    motions = random_motions(20, 30)
    jumps, rotations, positions = as_crossfade(motions, pieces, 0.08, root={"mode": "absolute"})
    assert np.flatnonzero(jumps).tolist() == frames
    moved = show(motions, *pieces, blend={"method": "least_jerk"}, root={"mode": "absolute"})
    np.testing.assert_allclose(moved.positions, positions, atol=1e-9)
    assert rotation.angle_between(moved.rotations, rotations).max() < 1e-7


@settings(deadline=None, derandomize=True, max_examples=40)
@given(
    seed=st.integers(0, 10_000), count=st.integers(1, 5), reach=st.sampled_from([0.05, 0.08, 0.2]),
    mode=st.sampled_from(["absolute", "return"]),
)  # fmt: skip
def test_least_jerk_equals_the_correction_of_the_bare_path(seed, count, reach, mode):
    rng = np.random.default_rng(seed)
    motions, pieces = random_motions(seed, 30), []
    for _ in range(count):
        # No node is held, so that every place is where it is evenly.
        runs = [np.arange(start, start + rng.integers(1, 7)) for start in rng.choice(24, rng.integers(1, 3), False)]
        nodes = np.concatenate(runs)
        nodes = nodes[np.append(True, np.diff(nodes) != 0)]
        if pieces and pieces[-1][0][-1] == nodes[0]:
            continue
        pieces.append((nodes.tolist(), int(rng.integers(1, 15))))
    _, rotations, positions = as_crossfade(motions, pieces, reach, root={"mode": mode})
    moved = show(motions, *pieces, blend={"method": "least_jerk", "reach_seconds": reach}, root={"mode": mode})
    np.testing.assert_allclose(moved.positions, positions, atol=1e-8)
    assert rotation.angle_between(moved.rotations, rotations).max() < 1e-7


def test_least_jerk_takes_the_leap_out_of_a_join():
    motions = [still_motion(30), still_motion(30, (10.0, 0.0, 0.0), 1.0)]
    moved = show(motions, range(30), range(30, 60), blend={"method": "least_jerk"}, root={"mode": "absolute"})
    assert np.abs(np.diff(moved.positions[:, 0, 0])).max() < 1.5
    assert rotation.angle_between(moved.rotations[1:], moved.rotations[:-1]).max() < 0.15
    np.testing.assert_allclose(moved.positions[[0, -1], 0, 0], [0.0, 10.0], atol=0.05)


# --- feet ---------------------------------------------------------------------------------------------------

BODY = ("b_root", "b_spine0", "b_l_upleg", "b_l_leg", "b_l_foot", "b_r_upleg", "b_r_leg", "b_r_foot")
ON_FEET = ("b_l_foot", "b_r_foot")


def figure(seed, frames):
    """A body that sways and turns smoothly over knees that are bent."""
    rng = np.random.default_rng(seed)
    parents = (-1, 0, 0, 2, 3, 0, 5, 6)
    offsets = [(0, 85, 0), (0, 20, 0), *[(x, y, 0) for x in (9, -9) for y in (-4, -40, -42)]]
    offsets[3:5], offsets[6:8] = [(0, -40, 0), (0, -42, 0)], [(0, -40, 0), (0, -42, 0)]
    bones = make_skeleton(BODY, parents, offsets)
    maps = 0.5 * gaussian_filter1d(rng.normal(size=(frames, 8, 3)), 10.0, axis=0, mode="nearest")
    for hip, knee, foot in ((2, 3, 4), (5, 6, 7)):
        for joint, angle in ((hip, -0.3), (knee, 0.6), (foot, -0.3)):
            maps[:, joint, 0] += angle
    positions = np.tile(bones.offsets, (frames, 1, 1))
    positions[:, 0] += 15.0 * gaussian_filter1d(rng.normal(size=(frames, 3)), 10.0, axis=0, mode="nearest")
    return Motion(bones, rotation.from_expmap(maps), positions, tiny.FPS)


@settings(deadline=None, derandomize=True, max_examples=40)
@given(
    seed=st.integers(0, 10_000), method=st.sampled_from(["crossfade", "inertialize", "least_jerk", "least_change"]),
    lengths=st.lists(st.tuples(st.integers(1, 12), st.integers(1, 14)), min_size=1, max_size=5),
    mode=st.sampled_from(["return", "absolute"]), resample=st.sampled_from(["interpolate", "nearest"]),
)  # fmt: skip
def test_locked_feet_give_finite_unit_frames_that_differ_in_the_legs_only(seed, method, lengths, mode, resample):
    rng = np.random.default_rng(seed)
    motions = [figure(seed, 25), figure(seed + 1, 15)]
    pieces = [(rng.integers(0, 40, size=nodes).tolist(), length) for nodes, length in lengths]
    options = {"blend": {"method": method}, "root": {"mode": mode}, "resample": resample}
    free = show(motions, *pieces, **options)
    moved, again = (show(motions, *pieces, feet={"lock": True}, **options) for _ in range(2))
    assert moved.n_frames == sum(length for _, length in lengths)
    assert np.isfinite(moved.rotations).all()
    np.testing.assert_allclose(np.linalg.norm(moved.rotations, axis=-1), 1.0, atol=1e-12)
    np.testing.assert_array_equal(moved.positions, free.positions)
    np.testing.assert_allclose(moved.rotations[:, :2], free.rotations[:, :2], atol=1e-12)
    assert moved.rotations.tobytes() == again.rotations.tobytes()
    assert moved.positions.tobytes() == again.positions.tobytes()


@pytest.mark.parametrize("method", ["crossfade", "inertialize", "least_jerk"])
def test_natural_steps_stay_as_recorded_but_for_the_feet(method):
    recorded = figure(3, 60)
    options = {"blend": {"method": method}, "feet": {"lock": True}, "root": {"mode": "absolute"}}
    # The whole recording has its own floor, so that each foot bears weight just where it did.
    whole = show([recorded], range(20), range(20, 60), **options)
    np.testing.assert_array_equal(whole.positions, recorded.positions)
    assert rotation.angle_between(whole.rotations, recorded.rotations).max() < 1e-6
    part = show([recorded], range(10, 20), range(20, 40), **options)
    np.testing.assert_array_equal(part.positions, recorded.positions[10:40])
    assert rotation.angle_between(part.rotations[:, :2], recorded.rotations[10:40, :2]).max() < 1e-7


def test_locked_feet_slide_less_after_a_jump():
    # A second figure that stands 60 cm away, seen by a root whose offset halves every second.
    motions = [still_motion(60, place, bones=figure(0, 2).skeleton) for place in ((0.0, 0.0, 0.0), (60.0, 0.0, 0.0))]
    bent = figure(0, 2).rotations[0]
    motions = [Motion(m.skeleton, np.tile(bent, (60, 1, 1)), m.positions, m.fps) for m in motions]
    skates = []
    for lock in (False, True):
        moved = show(motions, range(30), range(60, 120), root={"return_half_life": 1.0}, feet={"lock": lock})
        places = kinematics.joint_positions(moved, [moved.skeleton.index(name) for name in ON_FEET])
        skates.append(foot_skate(places, [0, 1], fps=tiny.FPS).speed)
    assert skates[1] < skates[0] / 3


@pytest.mark.parametrize("method", ["crossfade", "least_jerk"])
def test_a_skeleton_without_feet_is_rendered_all_the_same(method):
    motions = random_motions(21, 12, 12)
    options = {"blend": {"method": method}}
    free, moved = (show(motions, range(6), range(15, 21), feet={"lock": lock}, **options) for lock in (False, True))
    np.testing.assert_allclose(moved.rotations, free.rotations, atol=1e-15)
    np.testing.assert_array_equal(moved.positions, free.positions)


# --- fingers ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fingers", ["follow", "rest"])
def test_fingers_follow_their_arm_or_rest(fingers):
    (recorded,) = random_motions(19, 12)
    wrists = {"enabled": False, "joints": ("b_r_wrist",)}
    moved = show([recorded], range(12), fingers=fingers, joints=tiny.JOINTS[:4], wrists=wrists, **RECORDED)
    np.testing.assert_allclose(moved.rotations[:, :4], recorded.rotations[:, :4], atol=1e-15)
    thumb = recorded.rotations[:, 4] if fingers == "follow" else np.tile(rotation.IDENTITY, (12, 1))
    np.testing.assert_allclose(moved.rotations[:, 4], thumb, atol=1e-15)
    np.testing.assert_array_equal(moved.positions, recorded.positions)

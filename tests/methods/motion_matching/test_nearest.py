"""Motion matching: every rule on numbers made by hand, and all of it against the plain restatement."""

from types import SimpleNamespace

import numpy as np
import pytest

from gesturegen.methods.motion_matching.nearest import Candidates, search
from gesturegen.methods.motion_matching.settings import MotionMatching
from tests import naive

STEPS = {"matched": 0, "sequences": 1, "pose_ranks": 2, "audio_ranks": 3, "pose_distances": 4, "audio_distances": 5}


def database(sequences, step=1, sounds=None):
    """Candidates of sequences that are segments too, each a list of poses, numbers or rows; sounds likewise."""

    def rows(lists):
        flat = np.array([value for values in lists for value in values], dtype=np.float32)
        return flat.reshape(len(flat), -1)

    stops = np.cumsum([len(poses) for poses in sequences])
    starts = np.append(0, stops[:-1])
    valid = np.concatenate([np.arange(len(poses)) + step < len(poses) for poses in sequences])
    sounds = sounds or [[[1.0, 0.0]] * len(poses) for poses in sequences]
    return Candidates(rows(sequences), rows(sounds), starts, stops, valid)


def angles(*degrees):
    """Sounds so many degrees from the test sound, which is (1, 0)."""
    return [[np.cos(np.radians(value)), np.sin(np.radians(value))] for value in degrees]


def one(base, first_pose, step=1, allowed=None, prices=None, steps=1, sound=(1.0, 0.0), **settings):
    """`search` for one clip whose sound is the same at each of its steps, compared with the plain restatement."""
    sounds = np.tile(np.array(sound, dtype=np.float32), (steps, 1))
    pose = np.array(first_pose, dtype=np.float32).reshape(1, -1)
    settings = MotionMatching(**settings)
    (found,) = search(base, [sounds], pose, step, settings, [allowed], [prices])
    assert_same(found, naive.match(base, sounds, pose[0], step, settings, allowed, prices), step)
    return found


def assert_same(found, wanted, step):
    """To the bit."""
    steps, failed = wanted
    assert found.failed == failed
    for name, column in STEPS.items():
        assert getattr(found, name).tolist() == [row[column] for row in steps], name
    assert found.nodes.tolist() == [row[0] + k for row in steps for k in range(1, step + 1)]


def test_by_pose_alone_the_sequence_with_the_nearest_pose_wins():
    base = database([[5, 9, 0], [3, 2, 0], [8, 4, 0]], sounds=[angles(0, 0, 0), angles(90, 90, 90), angles(9, 9, 9)])
    found = one(base, [1], use_audio=False)
    assert found.matched.tolist() == [4] and found.nodes.tolist() == [5] and found.sequences.tolist() == [1]
    assert found.pose_distances.tolist() == [1.0] and found.pose_ranks.tolist() == [0]
    assert found.audio_ranks.tolist() == [2]  # told, though it does not count


def test_a_sequence_offers_its_nearest_pose_and_the_sound_after_it_counts():
    # Sequence 0 offers node 1 (pose 4), whose next sound is at 60 degrees; sequence 1 node 4 (pose 4), at 30.
    base = database([[9, 4, 0], [9, 4, 0]], sounds=[angles(0, 0, 60), angles(90, 90, 30)])
    # Pose ranks 0 and 1 by the sequence's number, audio ranks 1 and 0: a tie that the pose rank decides.
    assert one(base, [4]).matched.tolist() == [1]
    # With another sound between them the sums are 2, 1 and 3.
    base = database([[9, 4, 0], [9, 4, 0], [9, 7, 0]], sounds=[angles(0, 0, 60), angles(90, 90, 30), angles(0, 0, 45)])
    found = one(base, [4])
    assert found.matched.tolist() == [4] and (found.pose_ranks[0], found.audio_ranks[0]) == (1, 0)
    assert found.audio_distances[0] == pytest.approx(1 - np.cos(np.radians(30)))


def test_equal_sums_go_to_the_lower_pose_rank():
    base = database([[3, 0], [2, 0], [1, 0]], sounds=[angles(0, 10), angles(0, 20), angles(0, 30)])
    # Pose ranks 2, 1, 0, audio ranks 0, 1, 2: all sums are 2.
    assert one(base, [0]).sequences.tolist() == [2]
    assert [one(base, [0], k=k).sequences[0] for k in (1, 2, 3, 4, 15)] == [2, 1, 0, 0, 0]


def test_the_lowest_sum_wins_though_it_is_first_in_neither_ranking():
    sounds = [angles(0, 40), angles(0, 30), angles(0, 10), angles(0, 0)]
    base = database([[1, 0], [4, 0], [2, 0], [3, 0]], sounds=sounds)
    # Pose ranks 0, 3, 1, 2; audio ranks 3, 2, 1, 0: sums 3, 5, 2, 2.
    assert one(base, [0]).sequences.tolist() == [2]
    assert [one(base, [0], k=k).sequences[0] for k in (2, 3, 4)] == [3, 0, 1]
    assert [one(base, [0], k=k, use_audio=False).sequences[0] for k in (1, 2, 3, 4, 5)] == [0, 2, 3, 1, 1]


def test_equally_near_nodes_of_a_sequence_go_to_the_lowest():
    base = database([[7, 3, 5, 3, 0]])
    assert one(base, [4]).matched.tolist() == [1]
    assert one(database([[7, 3, 3, 3, 0]]), [3], preselect="audio").matched.tolist() == [0]


def test_equal_distances_rank_by_the_number_of_the_sequence():
    base = database([[3, 0], [1, 0], [3, 0], [1, 0]])
    assert one(base, [2]).sequences.tolist() == [0]
    assert [one(base, [2], k=k).pose_ranks[0] for k in (1, 2, 3, 4)] == [0, 1, 2, 3]


def test_by_audio_each_sequence_offers_its_nearest_next_sound():
    base = database([[0, 5, 0, 0], [3, 2, 0, 0]], sounds=[angles(0, 90, 10, 90), angles(0, 20, 90, 90)])
    # Node 1 is offered for the sound of node 2, node 4 for that of node 5; pose 5 against 3, sound 10 against 20.
    found = one(base, [0], preselect="audio")
    assert found.matched.tolist() == [4] and (found.pose_ranks[0], found.audio_ranks[0]) == (0, 1)
    assert one(base, [0], preselect="audio", k=2).matched.tolist() == [1]
    # By pose nodes 0 and 6 are offered, both at 0 and followed by a sound at 90: the first sequence.
    assert one(base, [0], preselect="pose").matched.tolist() == [0]


def test_the_mask_is_looked_up_at_both_ends_of_what_is_shown():
    base = database([[0, 1, 2, 3, 4, 5, 6, 7]], step=3)

    def matched(pose, closed, **settings):
        mask = np.ones(8, dtype=bool)
        mask[closed] = False
        return one(base, [pose], 3, [mask], **settings).matched.tolist()

    assert matched(1, []) == [1]
    assert matched(1, [2]) == [0]  # node 2 would be shown first
    assert matched(1, [4]) == [0]  # node 4 would be shown last
    assert matched(1, [3]) == [1]  # node 3 is between them
    assert matched(1, [1]) == [1]  # node 1 is not shown
    assert matched(1, [2], preselect="audio") == [0] and matched(0, [1], preselect="audio") == [1]
    assert matched(0, [1, 2, 3]) == [3] and matched(0, [1, 2, 3], preselect="audio") == [3]
    assert matched(4, []) == [4] and matched(6, []) == [4] and matched(4, [7]) == [3]


def test_a_sequence_without_an_allowed_node_has_no_rank():
    base = database([[1, 0], [2, 0], [3, 0]])
    mask = np.array([True, False, True, True, True, True])
    found = one(base, [0], allowed=[mask])
    assert found.sequences.tolist() == [1] and found.pose_ranks.tolist() == [0]


@pytest.mark.parametrize("preselect", ["pose", "audio"])
def test_without_any_node_the_path_ends_there_and_other_clips_go_on(preselect):
    base = database([[0, 1, 2, 3, 4, 5]])
    nothing = np.zeros(6, dtype=bool)
    sounds = np.ones((3, 2), dtype=np.float32)
    settings = MotionMatching(preselect=preselect)
    masks = [[None, nothing, None], None, [nothing] * 3]
    first, second, third = search(base, [sounds] * 3, np.zeros((3, 1)), 1, settings, masks)
    assert first.failed == 1 and first.nodes.tolist() == [1] and len(first.audio_distances) == 1
    assert second.failed is None and len(second.nodes) == 3
    assert third.failed == 0 and third.nodes.tolist() == [] and third.nodes.dtype == np.int64
    (alone,) = search(base, [sounds], np.zeros((1, 1)), 1, settings, masks[2:])
    assert alone.failed == 0
    nowhere = Candidates(base.pose, base.audio, base.starts, base.stops, nothing)
    assert [found.failed for found in search(nowhere, [sounds, sounds[:0]], np.zeros((2, 1)), 1, settings)] == [0, None]


def test_it_plays_on_where_nothing_is_better():
    base = database([[0, 1, 2, 3, 4, 5, 6, 7, 8], [20, 21, 22, 23, 24]], step=2)
    found = one(base, [1], 2, steps=3)
    # The frame that was matched, 1, is not shown again, nor are the last ones of a step.
    assert found.nodes.tolist() == [2, 3, 4, 5, 6, 7] and found.matched.tolist() == [1, 3, 5]
    assert found.pose_distances.tolist() == [0.0, 0.0, 0.0]
    # After node 7 there are no two nodes: node 6 is the nearest that goes on.
    assert one(base, [1], 2, steps=4).matched.tolist()[-1] == 6


def test_what_is_shown_may_run_into_the_next_sequence_of_the_segment():
    poses = np.arange(6, dtype=np.float32)[:, None]
    valid = np.arange(6) < 4
    base = Candidates(poses, np.ones((6, 2)), np.array([0, 3]), np.array([3, 6]), valid)
    assert one(base, [2], 2).nodes.tolist() == [3, 4]


def test_nodes_of_no_sequence_are_shown_but_not_matched():
    base = Candidates(np.arange(6)[:, None], np.ones((6, 2)), np.array([1, 4]), np.array([3, 5]), np.arange(6) < 5)
    assert one(base, [3.4]).matched.tolist() == [4] and one(base, [3.4]).nodes.tolist() == [5]
    assert one(base, [0]).matched.tolist() == [1] and one(base, [0], preselect="audio").matched.tolist() == [1]


def test_a_price_at_both_ends_weighs_as_much_as_a_ranking():
    base = database([[0, 0, 0], [1, 1, 1], [2, 2, 2]], step=2)
    prices = np.zeros(9)

    def ranking(**settings):
        return [one(base, [0], 2, prices=[prices], k=k, **settings).sequences[0] for k in (1, 2, 3)]

    # Without prices the sums are 0, 2 and 4, of 3 candidates.
    assert ranking() == [0, 1, 2]
    prices[1] = 0.5  # 1.5 of rank at the first end
    assert ranking() == [0, 1, 2]
    prices[2] = 0.5  # 3 in all
    assert ranking() == [1, 0, 2]
    prices[1] = prices[2] = 1.0
    assert ranking() == [1, 2, 0]
    prices[:] = 0
    prices[0] = 9.0  # not shown
    assert ranking() == [0, 1, 2]
    prices[2] = 0.5
    assert ranking(use_audio=False) == [1, 0, 2]  # 1.5 against 1 and 2


@pytest.mark.parametrize("preselect", ["pose", "audio"])
def test_zero_and_constant_features(preselect):
    zero = [[0.0, 0.0]]
    base = database([[0, 0, 0], [0, 0, 0]], sounds=[zero * 3, [[0, 0], [-1, 0], [1, 0]]])
    # A zero sound is at 1: nearer than an opposite one, which is at 2, further than the same, which is at 0.
    assert one(base, [0], preselect=preselect).audio_distances.tolist() == [1.0]
    second = one(base, [0], preselect=preselect, k=2)
    assert second.audio_distances.tolist() == ([2.0] if preselect == "pose" else [0.0])
    silent = one(base, [0], preselect=preselect, sound=(0, 0), steps=2)
    assert silent.audio_distances.tolist() == [1.0, 1.0] and silent.matched.tolist() == [0, 0]
    tiny = one(base, [0], preselect=preselect, sound=(1e-30, 0))
    assert tiny.audio_distances.tolist() == [1.0]
    empty = Candidates(np.empty((3, 0)), np.ones((3, 2)), np.array([0]), np.array([3]), np.arange(3) < 2)
    assert one(empty, [], preselect=preselect).pose_distances.tolist() == [0.0]


def test_no_sound_is_nearer_than_itself():
    rng = np.random.default_rng(0)
    for _ in range(100):  # rounding would put some of them below 0
        sound = rng.normal(size=14).astype(np.float32)
        base = database([[0, 0]], sounds=[[sound, sound * np.float32(1.7)]])
        assert 0 <= one(base, [0], sound=sound).audio_distances[0] < 1e-6


def problem(seed):
    """base, clips, first poses, step, settings, masks, prices, block size."""
    rng = np.random.default_rng(seed)
    n_nodes, step = int(rng.integers(4, 90)), int(rng.integers(1, 5))
    kind = seed % 4
    width, sounds = int(rng.integers(1, 9)), int(rng.integers(1, 9))

    def features(rows, columns):
        if kind == 0:
            return rng.integers(-1, 2, size=(rows, columns)).astype(np.float32)
        if kind == 1:
            return rng.normal(size=(rows, columns)).astype(np.float32)
        if kind == 2:  # alike but for the last bits, far from zero
            return (1000 + rng.normal(size=(rows, columns)) * rng.choice([1e-4, 1e-3])).astype(np.float32)
        # Sizes that differ, some of them beyond all measure, and equals.
        sizes = rng.choice([0.0, 1e-20, 1e-12, 1.0, 1e5, 1e15], size=(rows, 1), p=[0.1, 0.1, 0.1, 0.5, 0.1, 0.1])
        return np.clip(rng.integers(-2, 3, size=(rows, columns)) * sizes, -1e15, 1e15).astype(np.float32)

    bounds = np.unique(np.append(rng.integers(0, n_nodes + 1, size=rng.integers(2, 20)), [0, n_nodes]))
    starts, stops = bounds[:-1], bounds[1:]
    if rng.random() < 0.3 and len(starts) > 2:  # some nodes are in no sequence
        kept = np.sort(rng.permutation(len(starts))[: len(starts) * 2 // 3])
        starts, stops = starts[kept], stops[kept]
    valid = rng.random(n_nodes) < rng.choice([0.5, 0.9, 1.0])
    valid[-step:] = False
    base = Candidates(features(n_nodes, width), features(n_nodes, sounds), starts, stops, valid)
    lengths = rng.integers(0, 6, size=rng.integers(1, 5))
    clips = [features(length, sounds) for length in lengths]
    settings = MotionMatching(
        preselect=str(rng.choice(["pose", "audio"])),
        use_audio=bool(rng.random() < 0.8),
        k=int(rng.choice([1, 1, 2, 9])),
    )

    def given(make, share):
        """Per clip None, an array of all steps or a list of some."""
        out = []
        for length in lengths:
            rows = [make() for _ in range(length)]
            chance = rng.random()
            some = [row if rng.random() < 0.6 else None for row in rows]
            out.append(None if chance > share else np.array(rows).reshape(length, n_nodes) if chance < 0.2 else some)
        return out

    masks = given(lambda: rng.random(n_nodes) < rng.choice([0.1, 0.6, 0.9]), 0.6)
    prices = given(lambda: rng.choice([0.0, 0.25, rng.random()], size=n_nodes), 0.5)
    return base, clips, features(len(clips), width), step, settings, masks, prices, int(rng.choice([1, 7, 100, 10**6]))


@pytest.mark.parametrize("part", range(4))
def test_it_is_the_plain_restatement_to_the_bit_alone_and_in_batches(part):
    ends = []
    for seed in range(part * 80, part * 80 + 80):
        base, clips, poses, step, settings, masks, prices, block = problem(seed)
        batch = search(base, clips, poses, step, settings, masks, prices, block)
        assert len(batch) == len(clips)
        for number, found in enumerate(batch):
            rest = step, settings, masks[number], prices[number]
            wanted = naive.match(base, clips[number], poses[number], *rest)
            assert_same(found, wanted, step)
            only = slice(number, number + 1)
            (alone,) = search(base, clips[only], poses[only], step, settings, masks[only], prices[only])
            assert_same(alone, wanted, step)
            ends.append(found.failed)
    assert None in ends and 0 in ends and max(end for end in ends if end is not None) > 0


@pytest.mark.parametrize("preselect", ["pose", "audio"])
def test_wide_features_and_smooth_motion(preselect):
    rng = np.random.default_rng(3)
    pose = np.cumsum(rng.normal(size=(700, 96)), axis=0) / 20
    sound = np.cumsum(rng.normal(size=(700, 112)), axis=0) / 5
    pose[350:420] = pose[349] + rng.normal(size=(70, 96)) * 1e-7  # a hold
    starts = np.arange(0, 700, 64)
    base = Candidates(pose, sound, starts, np.append(starts[1:], 700), np.arange(700) % 350 < 342)
    clips = [rng.normal(size=(length, 112)).astype(np.float32) for length in (9, 4)]
    poses = base.pose[[350, 20]]
    settings = MotionMatching(preselect=preselect)
    for found, clip, first in zip(search(base, clips, poses, 8, settings), clips, poses, strict=True):
        assert_same(found, naive.match(base, clip, first, 8, settings), 8)


@pytest.mark.parametrize("preselect", ["pose", "audio"])
def test_nothing_to_search_for(preselect):
    base = database([[0, 1, 2]])
    settings = MotionMatching(preselect=preselect)
    assert search(base, [], np.empty((0, 1)), 1, settings) == []
    (found,) = search(base, [np.empty((0, 2))], np.zeros((1, 1)), 1, settings)
    assert found.failed is None and found.nodes.shape == (0,) and found.sequences.shape == (0,)
    none = Candidates(np.empty((0, 1)), np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0))
    (found,) = search(none, [np.ones((2, 2))], np.zeros((1, 1)), 1, settings)
    assert found.failed == 0


def test_what_makes_no_sense_is_refused():
    sound = SimpleNamespace(
        pose=np.zeros((4, 1)), audio=np.zeros((4, 2)), starts=np.array([0, 2]), stops=np.array([2, 4]),
        valid=np.array([1, 1, 1, 0], dtype=bool),
    )  # fmt: skip
    base = Candidates(**vars(sound))
    for match, changed in [
        (r"\(N, P\)", {"pose": np.zeros(4)}),
        (r"valid is \(N,\)", {"valid": np.zeros((4, 1))}),
        ("3 poses", {"pose": np.zeros((3, 1))}),
        ("fit together", {"stops": np.array([2])}),
        ("stretches", {"stops": np.array([2, 5])}),
        ("stretches", {"stops": np.array([3, 4])}),
        ("stretches", {"stops": np.array([0, 4])}),
        ("stretches", {"starts": np.array([-1, 2])}),
        ("z-scores", {"pose": np.full((4, 1), np.nan)}),
        ("z-scores", {"audio": np.full((4, 2), 2e15)}),
    ]:
        with pytest.raises(ValueError, match=match):
            Candidates(**(vars(sound) | changed))

    def refused(match, width=2, poses=((0.0,),), step=1, **rest):
        with pytest.raises(ValueError, match=match):
            search(base, [np.zeros((1, width))], np.array(poses), step, MotionMatching(), **rest)

    refused("expected", width=3)
    refused("expected", poses=np.zeros((2, 1)))
    refused("z-scores", poses=[[np.inf]])
    refused("so many nodes", step=2)
    refused("so many nodes", step=0)
    refused("2 clips for 1", allowed=[None, None])
    refused("nodes", allowed=[[np.ones(3, dtype=bool)]])
    refused("nodes", allowed=[[np.ones(4)]])
    refused("nodes", prices=[[np.ones(5)]])
    refused("finite", prices=[[np.array([0, np.nan, 0, 0])]])

"""Coverage, repetition, stops at key nodes, utilisation of the training set."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.metrics.usage import key_node_share, reference_use, training_utilisation
from tests.metrics import naive_metrics as naive


def test_known_path():
    use = reference_use([3, 4, 4, 4, 5, 3, 4, 9, 9, 3], 20)
    assert (use.n_used, use.max_uses) == (4, 3)  # frame 3 is come to three times, frame 4 twice
    assert use.used_share == pytest.approx(4 / 20)
    assert use.held_share == pytest.approx(3 / 10)
    assert use.reused_share == pytest.approx(3 / 10)


def test_played_once_through():
    use = reference_use(np.arange(12), 12)
    assert use == (12, 1.0, 1, 0.0, 0.0)


def test_a_statue_is_held_not_reused():
    use = reference_use([7] * 10, 10)
    assert (use.used_share, use.max_uses, use.held_share, use.reused_share) == (0.1, 1, 0.9, 0.0)


def test_no_output():
    use = reference_use([], 5)
    assert (use.n_used, use.used_share, use.max_uses) == (0, 0.0, 0)
    assert np.isnan(use.held_share) and np.isnan(use.reused_share)
    assert np.isnan(reference_use([], 0).used_share)
    assert reference_use([0], 1).used_share == 1.0


def test_frames_outside_the_reference_are_refused():
    with pytest.raises(ValueError, match="0 to 4"):
        reference_use([0, 5], 5)
    with pytest.raises(ValueError, match="0 to 4"):
        reference_use([-1], 5)


@settings(deadline=None, derandomize=True, max_examples=30)
@given(st.lists(st.integers(0, 5), min_size=1, max_size=30))
def test_use_equals_naive_and_adds_up(frames):
    use = reference_use(frames, 6)
    n_used, max_uses, held, reused = naive.reference_use(frames)
    assert (use.n_used, use.max_uses) == (n_used, max_uses)
    assert (use.held_share, use.reused_share) == pytest.approx((held / len(frames), reused / len(frames)))
    assert use.held_share + use.reused_share + use.n_used / len(frames) == pytest.approx(1.0)


def test_the_node_before_the_key_frame_decides():
    shown, is_stop = np.array([0, 1, 2, 3, 4]), np.array([False, False, True, False, True])
    assert key_node_share([3], shown, is_stop) == 1.0
    assert key_node_share([2], shown, is_stop) == 0.0
    assert key_node_share([2, 3, 5], shown, is_stop) == pytest.approx(2 / 3)


def test_key_nodes_that_end_no_piece_are_left_out():
    shown, is_stop = np.array([1, 1, 1]), np.array([False, True])
    assert key_node_share([0, 2], shown, is_stop) == 1.0
    assert key_node_share([2, 4], shown, is_stop) == 1.0
    assert np.isnan(key_node_share([0], shown, is_stop))
    assert np.isnan(key_node_share([], shown, is_stop))
    assert np.isnan(key_node_share([1], [], is_stop))


def test_utilisation_counts_every_training_clip_once():
    durations = {"a": 10.0, "b": 20.0, "c": 70.0}
    used = training_utilisation([["a"], ["b", "a", "b"], ["a"]], durations)
    np.testing.assert_allclose(used.per_clip, [0.1, 0.3, 0.1])
    assert used.overall == pytest.approx(0.3)


def test_utilisation_of_the_paper():
    # 70 different references of 170.2 s on average out of 68069.9 s: 0.25 % each, 17.5 % in all (§5.1.1)
    durations = {f"r{k}": 170.2 for k in range(70)} | {"rest": 68069.9 - 70 * 170.2}
    used = training_utilisation([[f"r{k}"] for k in range(70)], durations)
    assert round(100 * used.per_clip.mean(), 2) == 0.25
    assert round(100 * used.overall, 1) == 17.5


def test_utilisation_edges():
    nothing = training_utilisation([], {"a": 1.0})
    assert nothing.per_clip.shape == (0,) and nothing.overall == 0.0
    assert np.isnan(training_utilisation([["a"]], {"a": 0.0}).overall)
    with pytest.raises(ValueError, match="'z'"):
        training_utilisation([["z"]], {"a": 1.0})

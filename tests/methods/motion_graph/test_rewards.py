"""Rewards on planted curves: bells, motion beats, their lag, and what each reward answers to."""

import re
from dataclasses import replace

import numpy as np
import pytest

from gesturegen.methods.motion_graph import description, rewards
from gesturegen.methods.motion_graph.settings import GlobalSearch
from tests import tiny

FPS = tiny.FPS
ALONE = dict.fromkeys(("lambda_beat", "lambda_onset", "lambda_phrase", "lambda_keyword"), 0.0)


def only(**weights):
    return tiny.config(control={"left": "left", "right": "right"}, global_search=GlobalSearch(**(ALONE | weights)))


# --- bells ----------------------------------------------------------------------------------------------------


def test_a_bell_is_as_high_as_its_weight_and_a_frame_or_two_wide():
    curve = rewards.bells(np.array([20]), np.array([3.0]), 40, FPS)
    assert curve.argmax() == 20 and curve.max() == pytest.approx(3.0)
    # A normal curve with a standard deviation of one frame, which ends after three.
    expected = 3.0 * np.exp(-0.5 * np.arange(-20, 20) ** 2) * (np.abs(np.arange(-20, 20)) <= 3)
    np.testing.assert_allclose(curve, expected, atol=1e-9)
    assert (curve > 0).sum() == 7


def test_bells_add_up_and_need_not_be_in_the_curve():
    one, two = (rewards.bells(np.array(places), None, 30, FPS) for places in ([10], [10, 10]))
    np.testing.assert_allclose(two, 2 * one)
    assert not rewards.bells(np.array([-1, 30, -2.4]), None, 30, FPS).any()
    assert not rewards.bells(np.zeros(0), None, 30, FPS).any()
    assert rewards.bells(np.array([0.4, 28.6]), None, 30, FPS)[[0, 29]].tolist() == pytest.approx([1.0, 1.0])
    # At twice the frame rate it is as wide in seconds.
    assert (rewards.bells(np.array([30]), None, 60, 2 * FPS) > 0).sum() == 13


# --- motion beats ---------------------------------------------------------------------------------------------


def strokes(places, n_frames=300, depths=None, speed=80.0, width=4.0):
    """Hands that move at a speed, and slow down at some places, by all of it or as deep as told."""
    frames = np.arange(n_frames)
    depths = np.full(len(places), speed) if depths is None else depths
    return speed - sum(
        depth * np.exp(-0.5 * ((frames - place) / width) ** 2) for place, depth in zip(places, depths, strict=True)
    )


def test_beats_are_the_minima_of_the_speed_weighted_by_how_far_it_fell():
    nodes, weights = rewards.motion_beats(strokes([50, 120, 210], depths=[60.0, 20.0, 40.0]), [0], FPS)
    assert nodes.tolist() == [50, 120, 210]
    assert weights == pytest.approx([1.5, 0.5, 1.0], abs=0.05)
    many = rewards.motion_beats(strokes([50, 120, 210, 250], depths=[75.0, 6.0, 6.0, 6.0]), [0], FPS)[1]
    assert many.max() == 2.0, "one beat among many weighs at most twice the mean"


def test_a_shallow_minimum_is_no_beat_and_nothing_crosses_a_segment():
    assert rewards.motion_beats(strokes([50, 120], depths=[60.0, 3.0]), [0], FPS)[0].tolist() == [50]
    # A break in the middle of a stroke: neither side has a minimum.
    assert rewards.motion_beats(strokes([120]), [0, 120], FPS)[0].tolist() == []
    assert rewards.motion_beats(strokes([50, 200]), [0, 120], FPS)[0].tolist() == [50, 200]
    for speeds in (np.full(100, 7.0), np.zeros(0), np.zeros(1)):
        nodes, weights = rewards.motion_beats(speeds, [0], FPS)
        assert len(nodes) == len(weights) == 0


# --- the lag of beats -----------------------------------------------------------------------------------------


def moving(places, n_frames=900, onsets=()):
    """A graph of two hands, of which the left moves to and fro and slows down at some places."""
    speeds = strokes(places, n_frames)
    positions = np.zeros((n_frames, 2, 3))
    positions[:, 0, 0] = np.cumsum(speeds / FPS)
    graph = tiny.graph_of_positions(positions, rows=[(frame, "onset") for frame in onsets])
    return replace(graph, joint_names=("left", "right"))


@pytest.mark.parametrize("lag", [-9, 0, 6])
def test_a_planted_lag_is_measured(lag):
    onsets = np.random.default_rng(0).permutation(np.arange(30, 870, 18))[:30]
    graph = moving(onsets + lag, onsets=sorted(onsets.tolist()))
    found, sure = rewards.measure_beat_lag(graph, only())
    assert found == pytest.approx(lag / FPS, abs=1.1 / FPS) and sure > 3.0


def test_where_beats_and_onsets_have_nothing_to_do_with_one_another_no_lag_stands_out():
    rng = np.random.default_rng(1)
    sure = []
    for _ in range(10):
        onsets, beats = (np.sort(rng.choice(np.arange(30, 870, 9), 30, replace=False)) for _ in range(2))
        sure.append(rewards.measure_beat_lag(moving(beats, onsets=onsets.tolist()), only())[1])
    assert np.median(sure) < 3.0, sure


def test_without_hands_or_beats_or_onsets_there_is_no_lag():
    onsets = range(30, 870, 30)
    config = only()
    unknown = replace(moving(onsets, onsets=onsets), joint_names=("a", "b"))
    for graph in (unknown, moving([], onsets=onsets), moving(onsets, onsets=[30])):
        assert rewards.measure_beat_lag(graph, config) is None


def test_build_graph_says_how_sure_the_lag_is():
    onsets = np.random.default_rng(0).permutation(np.arange(30, 870, 18))[:30]
    (line,) = description._beat_lag(moving(onsets + 6, onsets=sorted(onsets.tolist())), only())
    assert re.fullmatch(
        r"beats of the hands follow the onsets by \+0\.2\d s \(z \d+\.\d\); used is global_search.beat_lag_seconds = 0",
        line,
    )
    unsure = moving(np.arange(40, 870, 37), onsets=range(30, 870, 11))
    assert rewards.measure_beat_lag(unsure, only())[1] < description.SURE
    (line,) = description._beat_lag(unsure, only())
    assert re.fullmatch(r"beats of the hands follow the onsets by no lag that stands out \(z -?\d\.\d\)", line)
    assert description._beat_lag(tiny.graph_of_positions(np.zeros((9, 1, 3))), only()) == []


# --- the rewards ----------------------------------------------------------------------------------------------


def test_beats_of_the_hands_answer_to_the_onsets_shifted_by_the_lag():
    graph = moving([100, 500])
    speech = tiny.speech(90, (20, 60))
    (beat,) = rewards.find(graph, speech, only(lambda_beat=4.0))
    assert beat.name == "beat" and np.flatnonzero(beat.gain > 0.99).tolist() == [20, 60]
    assert np.argsort(beat.worth)[-2:].tolist() in ([100, 500], [500, 100])
    assert beat.worth.sum() == pytest.approx(0.0, abs=1e-9), "a busy reference earns nothing by being busy"
    assert beat.worth.max() == pytest.approx(4.0 * (1.0 - 2 * np.sqrt(2 * np.pi) / 900), rel=0.05)
    (later,) = rewards.find(graph, speech, only(lambda_beat=4.0, beat_lag_seconds=0.2))
    # Hands that slow down 0.2 s after the onset belong to a node that comes 0.2 s earlier.
    assert sorted(np.argsort(later.worth)[-2:].tolist()) == [94, 494]
    assert rewards.find(replace(graph, joint_names=("a", "b")), speech, only(lambda_beat=4.0)) == ()


def test_onsets_weigh_by_their_strength():
    graph = moving([], onsets=[300])
    said = tiny.speech(90, (20, 60, 80))
    speech = replace(said, onset_strengths=np.array([5.0, 10.0, 60.0]))
    (onset,) = rewards.find(graph, speech, only(lambda_onset=1.0))
    assert onset.gain[[20, 60, 80]] == pytest.approx([0.2, 0.4, 2.0])
    assert onset.worth.argmax() == 300 and onset.worth.mean() == pytest.approx(0.0, abs=1e-12)
    (plain,) = rewards.find(graph, said, only(lambda_onset=1.0))
    assert plain.gain[[20, 60, 80]] == pytest.approx([1.0, 1.0, 1.0])


def test_phrases_answer_to_phrases_and_keywords_to_the_same_keyword():
    rows = [(100, "keyword", "greeting"), (200, "keyword", "counting")]
    graph = tiny.graph_of_positions(np.zeros((300, 1, 3)), rows=rows)
    graph = replace(graph, phrase_ends=np.array([50, 250]))
    speech = tiny.speech(120, (), [("well", 0, 10), ("hello", 30, 40), ("you", 40, 45), ("end", 60, 110)])
    (phrase,) = rewards.find(graph, speech, only(lambda_phrase=2.0))
    # Gaps of over 0.2 s, 6 frames, and the last word.
    assert np.flatnonzero(phrase.gain > 0.99).tolist() == [10, 45, 110]
    assert sorted(np.argsort(phrase.worth)[-2:].tolist()) == [50, 250]
    (keyword,) = rewards.find(graph, speech, only(lambda_keyword=3.0))
    assert keyword.gain.argmax() == 30 and keyword.worth.argmax() == 100 and keyword.worth.max() == pytest.approx(3.0)
    assert keyword.worth[200] == 0.0 and keyword.worth.min() == 0.0, "nothing is taken off for a keyword"
    absent = tiny.speech(60, (), [("nothing", 0, 10)])
    assert rewards.find(graph, absent, only(lambda_keyword=3.0)) == ()


def test_what_costs_nothing_or_has_no_place_is_no_reward():
    graph = moving([100], onsets=[300])
    assert rewards.find(graph, tiny.speech(60, (20,)), only()) == ()
    assert rewards.find(graph, tiny.speech(60), tiny.config(control={"left": "left", "right": "right"})) == ()

"""The published search of a whole test speech, piece by piece."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen.methods import METHODS
from gesturegen.methods.motion_graph.graph import build
from gesturegen.methods.motion_graph.search import search
from gesturegen.speech.acoustics import Acoustics
from tests import naive, tiny
from tests.methods.gesture_master import gesture_builders


def found(path):
    """The pieces of a path in the naive search's form."""
    return [
        (
            piece.target.start_frame, piece.target.end_frame, tuple(piece.nodes.tolist()), piece.cost, piece.retries,
            piece.fallback,
        )
        for piece in path.tracks[0].pieces
    ]  # fmt: skip


def run(graph, speech, seed=0, **sections):
    return search(graph, speech, tiny.config(**sections), np.random.default_rng(seed))


def key_rows(speech):
    """Key nodes of a test speech by hand: a keyword where a run of it begins, else an onset."""
    labels = [""] * (speech.n_frames + 1)
    for word in speech.words:
        for frame in range(round(word.start * tiny.FPS), round(word.end * tiny.FPS)):
            if frame < speech.n_frames:
                labels[frame] = tiny.WORDS.get(word.text, "")
    rows = {round(time * tiny.FPS): ("onset", "") for time in speech.onset_times.tolist()}
    rows |= {f: ("keyword", labels[f]) for f in range(speech.n_frames) if labels[f] and labels[f] != labels[f - 1]}
    return [(frame, *rows[frame]) for frame in sorted(rows)]


def random_speech(rng, frames):
    onsets = np.flatnonzero(rng.random(frames) < rng.choice([0.0, 0.05, 0.15])).tolist()
    words = [(str(rng.choice([*tiny.WORDS, "um"])), f, f + 2) for f in np.flatnonzero(rng.random(frames) < 0.04)]
    return tiny.speech(frames, onsets, [(text, int(a), int(b)) for text, a, b in words])


def assert_equals_naive(graph, speech, config, seed):
    path = search(graph, speech, config, np.random.default_rng(seed))
    expected, failed = naive.search(graph, key_rows(speech), speech.n_frames, config, np.random.default_rng(seed))
    assert found(path) == expected
    assert (path.failure is not None) == failed
    return path


@settings(deadline=None, derandomize=True, max_examples=120)
@given(
    seed=st.integers(0, 10_000),
    reference_frames=st.sampled_from([1, 2, 5, 20, 40, 80]),
    frames=st.sampled_from([1, 2, 7, 30, 90]),
    l_npaths=st.sampled_from([1, 3, 20]),
    initialization=st.sampled_from(["feature", "feature", "random"]),
    align=st.sampled_from(["following", "as_printed"]),
    l_pn=st.sampled_from([1, 3]),
)
def test_equals_the_naive_search(seed, reference_frames, frames, l_npaths, initialization, align, l_pn):
    rng = np.random.default_rng(seed)
    config = tiny.config(
        beam={"l_npaths": l_npaths}, initialization=initialization, features={"align": align},
        continuity={"l_pn": l_pn},
    )  # fmt: skip
    references = [tiny.random_reference(rng, reference_frames, name) for name in "ab"[: rng.integers(1, 3)]]
    graph = build(references, config)
    path = assert_equals_naive(graph, random_speech(rng, frames), config, seed)
    assert sum(piece.target.length for piece in path.tracks[0].pieces) == frames
    assert path.failure is None


@settings(deadline=None, derandomize=True, max_examples=40)
@given(seed=st.integers(0, 10_000))
def test_equals_the_naive_search_without_fallbacks(seed):
    rng = np.random.default_rng(seed)
    config = tiny.config(termination={"fallbacks": False, "failure_retries": 12}, beam={"l_npaths": 3})
    graph = build([tiny.random_reference(rng, int(rng.integers(1, 60)))], config)
    assert_equals_naive(graph, random_speech(rng, 40), config, seed)


def test_the_search_meets_every_fallback():
    # Guards the comparisons above: random cases do reach each rule.
    seen = set()
    for seed in range(40):
        rng = np.random.default_rng(seed)
        graph = build([tiny.random_reference(rng, 40)], tiny.config())
        path = search(graph, random_speech(rng, 90), tiny.config(), rng)
        seen |= {piece.fallback for piece in path.tracks[0].pieces}
        seen |= {"retry" for piece in path.tracks[0].pieces if piece.retries}
    assert seen == {None, "retry", "keyword", "discard", "repeat"}


def test_the_same_seed_gives_the_same_path_and_another_seed_another():
    rng = np.random.default_rng(3)
    graph = build([tiny.random_reference(rng, 60)], tiny.config())
    speech = random_speech(np.random.default_rng(11), 150)
    assert found(run(graph, speech, 5)) == found(run(graph, speech, 5))
    assert len({str(found(run(graph, speech, seed))) for seed in range(6)}) > 1


# --- hand-made graphs ---------------------------------------------------------------------------------------

HUNDRED = 100


def steady_graph(extra=(), n_nodes=HUNDRED):
    """Onsets every ten nodes from 9 on, natural edges only."""
    return tiny.graph_of_edges(n_nodes, {}, [*((f, "onset") for f in range(9, n_nodes, 10)), *extra])


def test_pieces_join_naturally_where_the_rhythm_fits():
    path = run(steady_graph(), tiny.speech(50, [10, 20, 30, 40]), beam={"l_npaths": 5})
    nodes = np.concatenate([piece.nodes for piece in path.tracks[0].pieces])
    # The first piece starts at a key node; from there each piece stops ten nodes later.
    assert nodes[0] % 10 == 9 and len(path.tracks[0].pieces[0].nodes) == 11
    assert (np.diff(nodes) == 1).all()
    assert [piece.retries for piece in path.tracks[0].pieces] == [0] * 5


def test_the_natural_child_wins_among_equally_cheap_children():
    # From 9 lead 10 (natural, weight 0) and 0, whose run of ten is as cheap inside the next piece.
    rows = [(9, "onset"), (19, "onset"), (29, "onset")]
    graph = tiny.graph_of_edges(40, {(9, 0): 0.0, (19, 0): 0.0}, rows)
    speech = tiny.speech(31, [11, 21])
    path = run(graph, speech, beam={"l_npaths": 2})
    first, second, _ = path.tracks[0].pieces
    assert first.nodes[-1] in (9, 19) and second.nodes[0] == first.nodes[-1] + 1


def test_a_winner_without_children_is_followed_by_key_nodes_without_retry():
    # The only segment long enough ends in a dead end each time.
    graph = tiny.graph_of_edges(10, {}, [(0, "onset")])
    path = run(graph, tiny.speech(20, [10]))
    assert found(path) == [(0, 10, tuple(range(10)), 0.0, 0, None), (10, 20, tuple(range(10)), 0.0, 0, None)]


def test_a_keyword_piece_ends_on_its_keyword():
    graph = steady_graph([(45, "keyword", "greeting"), (12, "keyword", "counting")])
    path = run(graph, tiny.speech(40, [], [("hello", 17, 20)]))
    piece = path.tracks[0].pieces[0]
    assert piece.nodes[-1] == 45 and piece.target.keyword == "greeting" and piece.fallback is None


def test_a_keyword_that_the_reference_lacks_falls_back_after_five_retries():
    path = run(steady_graph(), tiny.speech(40, [], [("hello", 11, 20)]))
    piece = path.tracks[0].pieces[0]
    assert piece.fallback == "keyword" and piece.retries == 6
    assert piece.nodes[-1] % 10 == 9


def test_stop_nodes_are_discarded_where_the_reference_is_too_quick():
    # Every node is an onset: only dropping stop nodes makes a piece of eight frames possible.
    graph = tiny.graph_of_edges(60, {}, [(f, "onset") for f in range(60)])
    piece = run(graph, tiny.speech(8)).tracks[0].pieces[0]
    assert piece.fallback == "discard" and 11 <= piece.retries <= 40
    assert len(piece.nodes) == 8


def test_the_previous_pieces_last_node_is_repeated_after_forty_retries():
    graph = tiny.graph_of_edges(10, {}, [(0, "onset")])
    path = run(graph, tiny.speech(100, [10]))
    second = path.tracks[0].pieces[1]
    assert second.nodes.tolist() == [9] * 90 and second.fallback == "repeat" and second.retries == 40


def test_the_first_piece_repeats_its_best_ranked_key_node():
    graph = tiny.graph_of_edges(10, {}, [(0, "onset"), (4, "onset")])
    piece = run(graph, tiny.speech(100)).tracks[0].pieces[0]
    # Features 4 and 5 against 100: 0 has (4, 5), 4 has (5), 9 has none.
    assert piece.nodes.tolist() == [4] * 100 and piece.fallback == "repeat"


def test_without_fallbacks_the_search_fails_after_four_hundred_retries(monkeypatch):
    from gesturegen.methods.motion_graph import search as module

    calls = []
    original = module.beam.search
    monkeypatch.setattr(module.beam, "search", lambda *args: calls.append(args[2]) or original(*args))
    graph = tiny.graph_of_edges(10, {}, [(0, "onset")])
    path = run(graph, tiny.speech(100, [10]), termination={"fallbacks": False})
    assert (path.failure.start_frame, path.failure.end_frame) == (10, 100)
    assert len(path.tracks[0].pieces) == 1 and path.tracks[0].pieces[0].nodes.tolist() == list(range(10))
    # One attempt for the first piece, the second's first attempt and its 400 retries.
    assert len(calls) == 1 + 1 + 400


def test_the_ranking_is_walked_on_from_retry_to_retry(monkeypatch):
    from gesturegen.methods.motion_graph import search as module

    starts = []
    original = module.beam.search
    monkeypatch.setattr(
        module.beam, "search", lambda *args: starts.append(np.asarray(args[2]).tolist()) or original(*args)
    )
    rows = [(f, "onset") for f in range(0, 60, 2)]
    run(tiny.graph_of_edges(60, {}, rows), tiny.speech(1000), beam={"l_npaths": 10})
    ranked = [start for step in starts[:3] for start in step]
    assert sorted(ranked)[:-1] == sorted(set(ranked))[:-1] and len(set(ranked)) == 30
    assert set(ranked) <= {*range(0, 60, 2), 59}
    # One key node is left of 31: random nodes from here on.
    assert all(len(set(step)) == 10 for step in starts[3:]) and len(starts) == 41
    assert any(set(step) - {*range(0, 60, 2), 59} for step in starts[3:])


def test_the_second_piece_tries_the_children_and_then_the_best_ranks(monkeypatch):
    from gesturegen.methods.motion_graph import search as module

    starts = []
    original = module.beam.search
    monkeypatch.setattr(
        module.beam, "search", lambda *args: starts.append(np.asarray(args[2]).tolist()) or original(*args)
    )
    graph = tiny.graph_of_edges(30, {(9, 20): 0.5}, [(0, "onset"), (9, "onset"), (14, "onset")])
    path = run(graph, tiny.speech(110, [10]), beam={"l_npaths": 2})
    assert path.tracks[0].pieces[0].nodes.tolist() == list(range(10))
    # Ranks 1 and 2 for the first piece; then the children of 9; then ranks 1 and 2 of the second piece.
    assert starts[1] == [10, 20]
    assert len(starts[0]) == len(starts[2]) == 2 and set(starts[0] + starts[2]) <= {0, 9, 14, 29}


def occurrence_counts(monkeypatch, graph, speech, **sections):
    """The occurrence counts with which each piece was ranked."""
    from gesturegen.methods.motion_graph import search as module

    counts = []
    original = module.feature_distances
    monkeypatch.setattr(
        module, "feature_distances", lambda *args: counts.append(np.array(args[2]).tolist()) or original(*args)
    )
    run(graph, speech, **sections)
    return counts


def test_occurrences_count_each_accepted_path_once(monkeypatch):
    # The piece 0 1 0 1 2 3 4 passes key node 0 twice and ends at 4.
    edges = {(0, 1): 0.0, (1, 0): 0.0, (1, 2): 0.0, (2, 3): 0.0, (3, 4): 0.0, (4, 0): 0.0}
    graph = tiny.graph_of_edges(5, edges, [(0, "keyword", "greeting"), (4, "onset")], natural=False)
    counts = occurrence_counts(monkeypatch, graph, tiny.speech(21, [7, 14]))
    assert counts == [[0, 0], [1, 1], [2, 2]]


def test_a_repeated_piece_is_no_accepted_path(monkeypatch):
    # The second piece, of 90 frames, repeats node 9; only the first one is an accepted path.
    graph = tiny.graph_of_edges(10, {}, [(0, "onset")])
    counts = occurrence_counts(monkeypatch, graph, tiny.speech(200, [10, 100]))
    assert counts == [[0, 0], [1, 1], [1, 1]]


def test_used_key_nodes_fall_back_in_the_ranking():
    # Three equal segments: with a beam of one, each piece starts in the segment used least.
    rows = [(f, "onset") for f in (0, 10, 20)]
    graph = tiny.graph_of_edges(30, {}, rows, segment_starts=(0, 10, 20))
    path = run(graph, tiny.speech(30, [10, 20]), beam={"l_npaths": 1})
    assert [piece.nodes[0] for piece in path.tracks[0].pieces] == [0, 10, 20]


# --- odd input ----------------------------------------------------------------------------------------------


def frames_of(path):
    return sum(piece.target.length for piece in path.tracks[0].pieces)


def test_a_reference_of_one_frame_holds_it():
    graph = build([tiny.reference(tiny.motion(np.random.default_rng(0), 1))], tiny.config())
    path = run(graph, tiny.speech(25, [5, 6], [("hi", 12, 14)]))
    assert frames_of(path) == 25
    assert {int(node) for piece in path.tracks[0].pieces for node in piece.nodes} == {0}


def test_a_key_node_at_frame_zero_makes_no_piece():
    path = run(steady_graph(), tiny.speech(20, [0, 10]))
    assert [piece.target.length for piece in path.tracks[0].pieces] == [10, 10]


def test_a_speech_without_key_nodes_is_one_piece():
    path = run(steady_graph(), tiny.speech(10))
    assert frames_of(path) == 10 and len(path.tracks[0].pieces) == 1


def test_a_speech_of_one_frame_gets_one_node():
    path = run(steady_graph(), tiny.speech(1))
    (piece,) = path.tracks[0].pieces
    assert len(piece.nodes) == 1 and piece.nodes[0] % 10 == 9


def test_the_graph_does_not_change():
    graph = build([tiny.random_reference(np.random.default_rng(4), 40)], tiny.config())
    before = {name: getattr(graph, name).copy() for name in ("indptr", "indices", "weights")}
    run(graph, random_speech(np.random.default_rng(5), 90))
    for name, array in before.items():
        np.testing.assert_array_equal(getattr(graph, name), array)


def test_the_global_search_says_what_it_cannot_hear_or_see():
    graph = tiny.graph_of_positions(np.zeros((60, 2, 3)), rows=[(20, "keyword", "counting")])
    speech = tiny.speech(30, (5,), [("hi", 8, 12), ("one", 20, 24)])
    wrists = {"left": "left", "right": "right"}
    lacks = "keywords that its references lack, so nothing is shown for them: greeting"
    assert run(replace(graph, joint_names=("left", "right")), speech, search="global", control=wrists).notes == (lacks,)
    no_hands = "no beats of the hands, because control.left or control.right is none of its joints: right"
    assert run(replace(graph, joint_names=("left", "b")), speech, search="global", control=wrists).notes == (
        lacks,
        no_hands,
    )
    off = {"lambda_keyword": 0.0, "lambda_beat": 0.0}
    assert run(graph, speech, search="global", global_search=off).notes == ()


@pytest.mark.parametrize("name", sorted(METHODS))
def test_every_method_builds_and_searches(name):
    # Long enough, and with words and arms, that there are clips to cut and hands to tell their rhythm.
    rng, method = np.random.default_rng(6), METHODS[name]
    joints = {"joints": ("b_l_wrist", "b_r_wrist")}
    config = gesture_builders.config(method=name, acoustics={"enabled": True}, motion_matching=joints)
    reference = gesture_builders.reference(rng, 150, onsets=range(0, 150, 20))
    sound = Acoustics(rng.normal(size=(75, 14)), 15.0)
    heard = replace(reference, speech=replace(reference.speech, acoustics=sound))
    library = method.assemble([method.part(heard, config)], config)
    speech = replace(random_speech(rng, 45), acoustics=sound)
    path = method.search(library, speech, config, np.random.default_rng(0))
    assert frames_of(path) == 45

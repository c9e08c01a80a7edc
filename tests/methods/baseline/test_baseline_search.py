"""The baselines: stretches as recorded, from where and for how long."""

from itertools import pairwise

import numpy as np
import pytest

from gesturegen.errors import DataError
from gesturegen.methods import METHODS, libraries
from gesturegen.methods.baseline import search as baseline
from gesturegen.methods.motion_graph import graph
from tests import tiny
from tests.builders import refused


def frames(segment_starts=(0,), onsets=(), n_frames=60):
    """A library of one reference of `n_frames` frames."""
    moved = tiny.motion(np.random.default_rng(0), n_frames)
    return baseline.build([tiny.reference(moved, onsets, segment_starts=segment_starts)], tiny.config())


def run(library, speech, seed=0, kind="random_stretch"):
    """The pieces as (first frame, first node, last node), when they are whole."""
    path = baseline.search(library, speech, tiny.config(method="baseline", baseline=kind), np.random.default_rng(seed))
    pieces = path.tracks[0].pieces
    assert path.failure is None and pieces[0].target.start_frame == 0
    assert pieces[-1].target.end_frame == speech.n_frames
    for piece, following in pairwise(pieces):
        assert piece.target.end_frame == following.target.start_frame
    for piece in pieces:
        nodes = piece.nodes
        assert np.array_equal(nodes, np.arange(nodes[0], nodes[0] + piece.target.length))
        segments = np.searchsorted(library.segment_starts, nodes, side="right")
        assert len(set(segments.tolist())) == 1 and nodes[-1] < library.n_nodes
        assert piece.target.end_kind == "stretch" and piece.fallback is None
    return [(piece.target.start_frame, int(piece.nodes[0]), int(piece.nodes[-1])) for piece in pieces]


@pytest.mark.parametrize("kind", ["random_stretch", "mismatched"])
@pytest.mark.parametrize("length", [1, 7, 30, 59, 60, 61, 200])
@pytest.mark.parametrize("starts", [(0,), (0, 20), (0, 1, 2, 40)])
def test_every_frame_is_shown_in_stretches_as_recorded(kind, length, starts):
    library = frames(starts, onsets=(5, 12, 33, 50))
    for seed in range(5):
        found = run(library, tiny.speech(length, onsets=(3, 9)), seed, kind)
        assert found == run(library, tiny.speech(length, onsets=(3, 9)), seed, kind)


def test_a_random_stretch_starts_anywhere_where_the_whole_length_fits():
    library = frames((0, 20))
    found = [run(library, tiny.speech(18), seed) for seed in range(300)]
    assert all(len(pieces) == 1 for pieces in found)
    assert {pieces[0][1] for pieces in found} == {0, 1, 2, *range(20, 43)}


def test_only_one_stretch_is_long_enough():
    assert {run(frames((0, 20)), tiny.speech(39), seed)[0][1] for seed in range(30)} == {20, 21}


def test_where_none_is_long_enough_each_is_shown_before_any_comes_again():
    library = frames((0, 20))
    for seed in range(10):
        found = run(library, tiny.speech(170), seed)
        for k in (0, 2):
            assert {(first, last) for _, first, last in found[k : k + 2]} == {(0, 19), (20, 59)}
        found = run(frames(), tiny.speech(130), seed)
        assert found[:2] == [(0, 0, 59), (60, 0, 59)] and len(found) == 3


def test_mismatched_motion_has_a_reference_onset_on_the_first_onset_of_the_speech():
    library = frames(onsets=(5, 12, 33, 50))
    found = [run(library, tiny.speech(20, onsets=(8, 15)), seed, "mismatched") for seed in range(100)]
    # The onset at 5 is too early for one at 8, that at 50 too late for 20 frames.
    assert {pieces[0][1] for pieces in found} == {12 - 8, 33 - 8}


def test_mismatched_stretches_go_on_at_the_next_onset():
    library = frames((0, 30), onsets=(4, 10, 40))
    for seed in range(10):
        first, second = run(library, tiny.speech(45, onsets=(2, 27, 35)), seed, "mismatched")
        # From an onset at 4 to the end of its segment are 28 frames, from 40 with a lead of 2 are 22.
        assert first[1:] in {(2, 29), (38, 59)}
        lead = (27 if second[0] <= 27 else 35) - second[0]
        assert second[1] + lead in {4, 10, 40}


@pytest.mark.parametrize("speech", [tiny.speech(20), tiny.speech(20, onsets=(18,))])
def test_without_onsets_to_align_it_is_a_random_stretch(speech):
    library = frames(onsets=(5,))
    for seed in range(5):
        assert run(library, speech, seed, "mismatched") == run(library, speech, seed)


def test_the_library_is_stored_and_known_for_what_it_is(tmp_path):
    library, config, path = frames((0, 20), (5, 33)), tiny.config(method="baseline"), tmp_path / "clip.npz"
    libraries.save(path, METHODS["baseline"], library, config, ["digest"])
    stored = libraries.load(path, METHODS["baseline"], config, ["digest"])
    assert np.array_equal(stored.positions, library.positions) and stored.n_unnatural_edges == 0
    assert np.array_equal(stored.key_nodes.frames, library.key_nodes.frames)
    assert isinstance(libraries.read(path), baseline.RecordedFrames)
    with refused(DataError, "pauses.min_seconds"):
        libraries.load(path, METHODS["baseline"], tiny.config(pauses={"min_seconds": 9.0}))
    with refused(DataError, "preprocessed again"):
        libraries.load(path, METHODS["baseline"], config, ["other"])


def test_graphs_are_still_known_as_graphs(tmp_path):
    library = graph.build([tiny.random_reference(np.random.default_rng(1), 30)], tiny.config())
    libraries.save(tmp_path / "clip.npz", METHODS["motion_graph"], library, tiny.config())
    assert type(libraries.read(tmp_path / "clip.npz")) is type(library)


def test_references_of_two_skeletons_are_refused():
    rng = np.random.default_rng(0)
    other = tiny.skeleton(("b_root", "b_spine0"), (-1, 0))
    pair = [tiny.reference(tiny.motion(rng, 9)), tiny.reference(tiny.motion(rng, 9, other), name="other")]
    with refused(DataError, "cannot share a graph"):
        baseline.build(pair, tiny.config())

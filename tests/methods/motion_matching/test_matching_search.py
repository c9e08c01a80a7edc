"""k-NN motion matching on tiny references: its paths against a plain restatement, starts, variants, refusals."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gesturegen import render
from gesturegen.errors import DataError
from gesturegen.frames import describe
from gesturegen.methods.motion_matching import database
from gesturegen.methods.motion_matching import search as motion_matching
from gesturegen.path import Path
from gesturegen.randomness import generator
from gesturegen.speech.acoustics import Acoustics
from tests import naive
from tests.builders import refused
from tests.methods.gesture_master import gesture_builders as gb
from tests.methods.motion_matching.test_matching_database import (
    RATE,
    STEP,
    config,
    reference,
    references,
    restated,
    voice,
)

SETTINGS = {
    "usual": {},
    "pose_alone": {"use_audio": False},
    "audio_first": {"preselect": "audio"},
    "second": {"k": 2},
    "last": {"k": 1000},
    "mean": {"start": "mean"},
    "given": {"start": "given", "start_pose": "clip1@0.84"},
}
# Sequences of a second and short tails, of which some hold no node to follow on.
FRAMES = 200, 130, 90, 35


def speech(frames: int, seed: int = 0, name: str = "test"):
    return replace(gb.speech(frames, name=name), acoustics=voice(100 + seed, frames // 2 + 1))


def searched(library, spoken, settings, seed=0, earlier=()):
    return motion_matching.search(library, spoken, settings, np.random.default_rng(seed), earlier)


def nodes_of(path) -> list[list[int]]:
    return [piece.nodes.tolist() for piece in path.tracks[0].pieces]


def scored(base, spoken) -> np.ndarray:
    """The voice of a speech at each of its steps, in z-scores of the references'."""
    values, rows = spoken.acoustics.values.astype(np.float64), []
    for start in range(0, spoken.n_frames, STEP):
        value = (start + 1) // 2
        rows.append(np.concatenate([values[min(value + 2 * k, len(values) - 1)] for k in range(8)]))
    means, deviations = base.of_audio
    return (np.array(rows) - means) / deviations


def by_hand(recordings, spoken, settings, seed=0, extra=0):
    """The nodes of each step from the paper's words, and per step what the choice was made by."""
    base, own = restated(recordings), settings.motion_matching
    if own.start == "mean":
        first = np.zeros(base.pose.shape[1])
    elif own.start == "random":
        first = base.pose[np.random.default_rng(seed).integers(len(base.pose))]
    else:  # clip1@0.84: its frame 25
        first = base.pose[recordings[0].motion.n_frames + 25]
    own = own.model_copy(update={"k": own.k + extra})
    steps, failed = naive.match(base, scored(base, spoken), first, STEP, own)
    assert failed is None
    shown = [list(range(j + 1, j + STEP + 1)) for j, *_ in steps]
    shown[-1] = shown[-1][: spoken.n_frames - STEP * (len(steps) - 1)]
    return shown, steps


@pytest.fixture(scope="module")
def recordings():
    return references(20, *FRAMES, excluded=[(40, 55), (100, 101)])


@pytest.fixture(scope="module")
def library(recordings):
    return database.build(recordings, config())


# --- the search ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", SETTINGS)
def test_the_path_is_that_of_the_paper(kind, recordings, library):
    settings = config(SETTINGS[kind])
    spoken = speech(150)
    path = searched(library, spoken, settings)
    shown, steps = by_hand(recordings, spoken, settings)
    assert nodes_of(path) == shown
    for piece, (_, _, pose_rank, audio_rank, pose, audio) in zip(path.tracks[0].pieces, steps, strict=True):
        assert piece.cost == pose_rank + audio_rank
        assert piece.costs["audio"] == pytest.approx(audio, abs=1e-4)
        assert piece.costs["pose"] == pytest.approx(pose, abs=2e-3)


@pytest.mark.parametrize("seed", range(4))
def test_other_speeches_and_references_too(seed):
    recordings = references(30 + seed, 90 + 13 * seed, 75, excluded=[(20 + seed, 33)])
    spoken = speech(100 + 7 * seed, seed)
    shown, _ = by_hand(recordings, spoken, config(), seed)
    assert nodes_of(searched(database.build(recordings, config()), spoken, config(), seed)) == shown


def test_one_clip(recordings):
    library = database.build(recordings[:1], config())
    assert nodes_of(searched(library, speech(120), config())) == by_hand(recordings[:1], speech(120), config())[0]


@pytest.mark.parametrize("length", [1, 15, 16, 17, 32, 50])
def test_pieces_cover_the_speech_in_steps_of_half_a_second(length, library):
    path = searched(library, speech(length), config())
    (track,) = path.tracks
    pieces = track.pieces
    assert path.failure is None and path.notes == () and path.objective is None and track.joints is None
    assert [piece.target.start_frame for piece in pieces] == list(range(0, length, STEP))
    assert [piece.target.end_frame for piece in pieces] == [*range(STEP, length, STEP), length]
    for piece in pieces:
        assert piece.target.end_kind == "step" and len(piece.nodes) == piece.target.length
        assert (np.diff(piece.nodes) == 1).all() and set(piece.costs) == {"pose", "audio"}
    # What is shown to a longer speech begins alike: the last step is only cut.
    longer = searched(library, replace(speech(64), acoustics=speech(length).acoustics), config())
    assert longer.tracks[0].nodes[:length].tolist() == track.nodes.tolist()


def test_steps_of_another_length(recordings):
    settings = config({"step_seconds": 0.2})
    pieces = searched(database.build(recordings, settings), speech(20), settings).tracks[0].pieces
    assert [len(piece.nodes) for piece in pieces] == [6, 6, 6, 2]


def test_pieces_stay_within_a_stretch_of_a_recording(library):
    path = searched(library, speech(600), config())
    ends = set(library.segment_ends.tolist())
    for nodes in nodes_of(path):
        assert not ends & set(nodes[:-1])


def test_where_it_plays_on_the_matched_frame_is_not_shown_twice():
    # A single sequence offers just the frame shown last: the motion goes on as it was recorded.
    recorded = reference(40, 110, "clip0")
    settings = config({"sequence_seconds": 100.0, "start": "given", "start_pose": "clip0@0"})
    library = database.build([recorded], settings)
    path = searched(library, speech(96), settings)
    assert path.tracks[0].nodes.tolist() == list(range(1, 97))
    assert [piece.costs["pose"] for piece in path.tracks[0].pieces] == [0.0] * 6
    motion = render.render(path, [recorded], library, settings)
    np.testing.assert_allclose(motion.rotations, recorded.motion.rotations[1:97], atol=1e-9)


def test_it_plays_on_now_and_then(library):
    nodes = nodes_of(searched(library, speech(600), config({"use_audio": False})))
    naturally = [other[0] == one[-1] + 1 for one, other in pairwise(nodes)]
    assert sum(naturally) > 0 and all(other[0] != one[-1] for one, other in pairwise(nodes))
    # By pose alone it leaves a stretch only where too little of it is left.
    assert naturally == [bool(library.valid[one[-1]]) for one in nodes[:-1]]


# --- a planted case ------------------------------------------------------------------------------------------


def said_by(recorded, frames: int, name: str = "test"):
    """A speech with the sound of a recording from its second value on, that of its frame 1."""
    sound = Acoustics(recorded.speech.acoustics.values[1:], float(RATE))
    return replace(gb.speech(frames, name=name), acoustics=sound)


@pytest.mark.parametrize("preselect", ["pose", "audio"])
@pytest.mark.parametrize("clip", [0, 1, 2])
def test_a_reference_s_own_sound_and_pose_bring_its_motion(preselect, clip):
    recordings = references(50, 90, 100, 110)
    settings = config({"preselect": preselect, "start": "given", "start_pose": f"clip{clip}@0.0"})
    library = database.build(recordings, settings)
    path = searched(library, said_by(recordings[clip], 80), settings)
    assert path.tracks[0].nodes.tolist() == (library.clip_starts[clip] + np.arange(1, 81)).tolist()
    assert all(piece.cost == 0 for piece in path.tracks[0].pieces)
    np.testing.assert_allclose([piece.costs["audio"] for piece in path.tracks[0].pieces], 0, atol=1e-6)


def test_a_reference_s_own_sound_finds_it_from_any_pose():
    recordings = references(50, 300, 300, 300)
    for seed in range(5):
        settings = config({"preselect": "audio"})
        library = database.build(recordings, settings)
        nodes = searched(library, said_by(recordings[1], 280), settings, seed).tracks[0].nodes
        found = nodes == library.clip_starts[1] + np.arange(1, 281)
        # Once found, sound and pose both keep it.
        assert found[-1] and found[np.argmax(found) :].all() and found.mean() > 0.5, seed


# --- starts and variants -------------------------------------------------------------------------------------


def test_a_random_start_follows_the_seed(library):
    spoken = speech(64)
    paths = [nodes_of(searched(library, spoken, config(), seed)) for seed in (0, 0, 1, 2, 3)]
    assert paths[0] == paths[1] and len({str(path) for path in paths}) > 2
    for start in ({"start": "mean"}, {"start": "given", "start_pose": "clip2@1"}):
        assert nodes_of(searched(library, spoken, config(start), 0)) == nodes_of(
            searched(library, spoken, config(start), 1)
        )


def test_a_given_start_is_the_nearest_frame_there_is(library):
    # Frames 40 to 54 of clip0 are excluded: 1.45 s is nearer to frame 39, 1.75 s to frame 55.
    for seconds, frame in (("1.0", 30), ("1.45", 39), ("1.75", 40), ("1e3", 200 - 16 - 1), ("-3", 0)):
        settings = config({"start": "given", "start_pose": f"clip0@{seconds}", "use_audio": False})
        first = searched(library, speech(10), settings).tracks[0].pieces[0]
        if library.valid[frame]:
            assert first.nodes[0] == frame + 1 and first.costs["pose"] == 0, seconds
        else:
            apart = np.linalg.norm(library.pose.astype(float) - library.pose[frame], axis=1)
            assert first.costs["pose"] == pytest.approx(apart[library.valid].min()), seconds


@pytest.mark.parametrize("pose", ["nothing@1.0", "clip0", "clip0@soon", "@1", "clip0@", "clip0@nan", "clip0@inf", ""])
def test_a_bad_start_pose_is_refused(pose, library):
    settings = config({"start": "given", "start_pose": pose})
    with refused(DataError, "start_pose: .* is no frame of the references; give one of clip0", repr(pose)):
        searched(library, speech(20), settings)


def test_variants_show_the_next_best(recordings, library):
    spoken, settings, paths = speech(80), config(), []
    for extra in range(3):
        path = searched(library, spoken, settings, 5, paths)
        assert nodes_of(path) == by_hand(recordings, spoken, settings, 5, extra)[0]
        assert nodes_of(path) == nodes_of(searched(library, spoken, config({"k": 1 + extra}), 5))
        paths.append(path)
    assert len({str(nodes_of(path)) for path in paths}) == 3


def test_more_variants_than_sequences_show_the_last_one(library):
    paths = [searched(library, speech(20), config(), 5)] * 500
    assert nodes_of(searched(library, speech(20), config(), 5, paths)) == nodes_of(
        searched(library, speech(20), config({"k": 501}), 5)
    )


# --- many at once --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["usual", "audio_first", "given", "mean"])
def test_all_at_once_is_one_by_one(kind, library):
    settings = config(SETTINGS[kind], seed=3)
    speeches = {f"t{k}": speech(length, k, f"t{k}") for k, length in enumerate((70, 1, 16, 200, 33))}
    found = motion_matching.search_all(library, speeches, settings)
    assert list(found) == list(speeches)
    for name, spoken in speeches.items():
        alone = motion_matching.search(library, spoken, settings, generator(3, name))
        assert nodes_of(found[name]) == nodes_of(alone)
        for one, other in zip(found[name].tracks[0].pieces, alone.tracks[0].pieces, strict=True):
            assert (one.target, one.cost, one.costs) == (other.target, other.cost, other.costs)
    assert motion_matching.search_all(library, {}, settings) == {}


def test_one_that_cannot_be_searched_for_does_not_hold_up_the_others(library):
    good, bad = speech(40, name="good"), replace(speech(40, name="bad"), acoustics=None)
    found = motion_matching.search_all(library, {"bad": bad, "good": good}, config())
    assert isinstance(found["good"], Path) and isinstance(found["bad"], DataError)
    with refused(DataError, "clip bad: its sound was not measured; set acoustics.enabled: true"):
        searched(library, bad, config())


# --- too little ----------------------------------------------------------------------------------------------


def test_references_shorter_than_a_step_are_told_in_one_line():
    library = database.build(references(60, 10, 16), config())
    with refused(DataError, "clip test: from 0.00 s no sequence .* a stretch of 16 frames .*give longer references"):
        searched(library, speech(40), config())
    found = motion_matching.search_all(library, {"a": speech(40, name="a"), "b": speech(9, name="b")}, config())
    assert all(isinstance(error, DataError) for error in found.values())


def test_a_short_one_beside_long_ones_is_never_shown():
    recordings = references(60, 12, 80, 16)
    library = database.build(recordings, config())
    nodes = searched(library, speech(300), config()).tracks[0].nodes
    assert nodes.min() > 12 and nodes.max() < 92


def test_the_shortest_that_can_be_shown():
    library = database.build(references(61, 17), config())
    assert nodes_of(searched(library, speech(40), config())) == [
        list(range(1, 17)), list(range(1, 17)), list(range(1, 9))
    ]  # fmt: skip


def test_the_library_is_like_those_of_other_methods(recordings, library):
    described = [describe(one, config()) for one in recordings]
    assert library.n_nodes == sum(len(one["source_frames"]) for one in described)
    assert library.n_unnatural_edges == 0 and library.fps == 30
    assert library.clips == tuple((f"clip{k}", False) for k in range(4))

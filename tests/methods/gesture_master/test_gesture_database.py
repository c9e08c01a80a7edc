"""The gesture database: its clips in both copies, its edges, its fingers, its file, and arrays mapped from files."""

import itertools
import zipfile
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gesturegen import files
from gesturegen.data.keynodes import KeyNodes
from gesturegen.errors import DataError
from gesturegen.frames import describe, join, positions_of
from gesturegen.methods import METHODS, libraries
from gesturegen.methods.gesture_master import fingers, style
from gesturegen.methods.gesture_master import search as gesture_master
from gesturegen.methods.gesture_master.database import (
    GestureDatabase,
    all_borders,
    assemble,
    link,
    of_parts,
    part,
    threshold,
)
from gesturegen.methods.gesture_master.extraction import BODIES
from gesturegen.methods.motion_graph import graph as motion_graph
from gesturegen.motion import kinematics
from gesturegen.stored import arrays as stored_arrays
from tests import naive
from tests.builders import SMALL, refused
from tests.methods.gesture_master import gesture_builders as gb

NEAR = {"upper": {"delta_t": None, "delta_quantile": 0.4}, "lower": {"delta_t": 12.0}}


def save(path, library, *rest):
    libraries.save(path, METHODS["gesture_master"], library, *rest)


def load(path, *rest):
    return libraries.load(path, METHODS["gesture_master"], *rest)


def recordings(seed, *frames, **options):
    rng = np.random.default_rng(seed)
    return [gb.reference(rng, count, f"clip{k}", **options) for k, count in enumerate(frames)]


def built(references, config):
    """The database and the parts that it is built of."""
    parts = [part(reference, config) for reference in references]
    return of_parts(parts, config), [one.gestures for one in parts]


def described(references, config):
    return join([describe(reference, config) for reference in references])


def edges_of(database, body):
    """The edges of a database by (p, q)."""
    indptr, sources, costs = (getattr(database, f"{body}_{key}") for key in ("indptr", "sources", "costs"))
    return {
        (int(sources[e]), q): costs[e] for q in range(len(database.starts)) for e in range(indptr[q], indptr[q + 1])
    }


# --- nodes and clips ----------------------------------------------------------------------------------------


@gb.FEW
@given(seed=st.integers(0, 10_000), mirror=st.booleans(), excluded=st.booleans())
def test_clips_keep_their_place_in_their_recording(seed, mirror, excluded):
    config = gb.config({"mirror": mirror})
    references = recordings(seed, 200, 150, excluded=[(60, 100)] if excluded else [], voice=seed)
    database, parts = built(references, config)
    copies = 2 if mirror else 1
    all_parts = [(k, copy) for copy in range(copies) for k in range(2)]
    frames = sum(reference.motion.n_frames for reference in references)
    assert database.n_nodes == copies * frames
    assert database.clips == tuple((f"clip{k}", copy == 1) for k, copy in all_parts)
    shown = gb.shown(references, database, config)
    first = 0
    for (k, copy), clip_start, own in zip(all_parts, database.clip_starts.tolist(), shown, strict=True):
        part, places = parts[k], slice(first, first + len(parts[k].starts))
        assert clip_start == sum(r.motion.n_frames for r in references[:k]) + copy * frames
        np.testing.assert_array_equal(database.starts[places], part.starts + clip_start)
        np.testing.assert_array_equal(database.stops[places], part.stops + clip_start)
        for name in ("names", "rests", "rhythms"):
            np.testing.assert_array_equal(getattr(database, name)[places], getattr(part, name))
        np.testing.assert_array_equal(database.styles[places], part.styles[copy])
        nodes = slice(clip_start, clip_start + own.motion.n_frames)
        np.testing.assert_array_equal(database.positions[nodes], positions_of(own.motion, config))
        np.testing.assert_array_equal(database.source_frames[nodes], own.source_frames)
        starts = database.segment_starts[
            (database.segment_starts >= nodes.start) & (database.segment_starts < nodes.stop)
        ]
        np.testing.assert_array_equal(starts - clip_start, own.segment_starts)
        first = places.stop
    assert first == len(database.starts) and (np.diff(database.starts) > 0).all()


def test_what_is_said_of_nodes_is_said_of_their_mirrored_copies():
    references = recordings(1, 200, 150, excluded=[(60, 100)], onsets=[5, 30, 110])
    database, _ = built(references, gb.config())
    half = database.n_nodes // 2
    for name in ("source_frames", "speaking"):
        np.testing.assert_array_equal(getattr(database, name)[:half], getattr(database, name)[half:])
    nodes = database.key_nodes
    k = len(nodes) // 2
    np.testing.assert_array_equal(nodes.frames[k:], nodes.frames[:k] + half)
    np.testing.assert_array_equal(nodes.kinds[k:], nodes.kinds[:k])
    expected = motion_graph.build(references, gb.config())
    for name in ("frames", "kinds", "keywords"):
        np.testing.assert_array_equal(getattr(nodes, name)[:k], getattr(expected.key_nodes, name))
    np.testing.assert_array_equal(database.segment_ends[: len(database.segment_ends) // 2], expected.segment_ends)
    np.testing.assert_array_equal(database.successors[:half], expected.successors)
    np.testing.assert_array_equal(database.successors[half:], expected.successors + half)


@pytest.mark.parametrize("relative_to", ["root", "root_heading", "world"])
def test_positions_of_mirrored_copies_are_mirrored(relative_to):
    database, _ = built(recordings(2, 200, 100), gb.config(positions={"relative_to": relative_to}))
    half = database.n_nodes // 2
    names = list(database.joint_names)
    other = [names.index(name.replace("_l_", "_*_").replace("_r_", "_l_").replace("_*_", "_r_")) for name in names]
    np.testing.assert_allclose(
        database.positions[half:], database.positions[:half, other] * [-1.0, 1.0, 1.0], atol=1e-4
    )


@gb.FEW
@given(seed=st.integers(0, 10_000))
def test_twins_are_mutual_and_differ_in_sides_only(seed):
    references = recordings(seed, 200, 150)
    database, _ = built(references, gb.config())
    twins, half = database.twins, len(database.starts) // 2
    np.testing.assert_array_equal(twins[twins], np.arange(2 * half))
    np.testing.assert_array_equal(twins[:half], np.arange(half) + half)
    for name in ("names", "rests", "rhythms"):
        np.testing.assert_array_equal(getattr(database, name)[twins], getattr(database, name))
    np.testing.assert_array_equal(database.starts[:half] + database.n_nodes // 2, database.starts[half:])
    # Both hands count for speed and radius, the right one for height: in the mirror it is the left one.
    np.testing.assert_allclose(database.styles[twins, :2], database.styles[:, :2], rtol=1e-9)
    places = np.concatenate([kinematics.joint_positions(r.motion) for r in references])
    left = places[:, gb.NAMES.index("b_l_wrist"), 1] - places[:, 0, 1]
    for k in range(half):
        height = left[database.starts[k] : database.stops[k]].mean()
        assert database.styles[twins[k], 2] == pytest.approx(height, rel=1e-9)


def test_without_mirror_every_clip_is_its_own_twin():
    database, _ = built(recordings(3, 200), gb.config({"mirror": False}))
    np.testing.assert_array_equal(database.twins, np.arange(len(database.starts)))
    assert not database.mirrored.any()


def test_styles_are_scaled_by_those_of_the_gestures():
    database, _ = built(recordings(4, 400), gb.config())
    assert database.rests.any() and not database.rests.all()
    np.testing.assert_allclose(database.style_means, database.styles[~database.rests].mean(axis=0))
    np.testing.assert_allclose(database.style_scales, database.styles[~database.rests].std(axis=0))
    silent, _ = built(recordings(4, 200, spoken=[]), gb.config())
    assert silent.rests.all()
    np.testing.assert_allclose(silent.style_means, silent.styles.mean(axis=0))


def test_the_regression_is_learned_from_the_gestures_as_recorded():
    config = gb.config({"style": {"source": "predict"}})
    database, parts = built(recordings(5, 500, 400, voice=5), config)
    gestures = [~part.rests for part in parts]
    expected = style.fit(
        np.concatenate([part.features[own] for part, own in zip(parts, gestures, strict=True)]),
        np.concatenate([part.styles[0][own] for part, own in zip(parts, gestures, strict=True)]),
        np.repeat([0, 1], [own.sum() for own in gestures]),
        config.gesture_master.style,
    )
    for field in fields(style.Regression):
        np.testing.assert_array_equal(getattr(database.regression, field.name), getattr(expected, field.name))
    without, _ = built(recordings(5, 500, voice=5), gb.config())
    assert np.isnan(style.predict(without.regression, parts[0].features)).all()


def test_the_numbers_of_clips_by_threshold_are_those_of_all_recordings():
    database, parts = built(recordings(6, 300, 200), gb.config())
    total = parts[0].thresholds + parts[1].thresholds
    np.testing.assert_array_equal(database.thresholds[:, 0], total[:, 0])
    np.testing.assert_allclose(database.thresholds[:, 1], total[:, 1] / total[:, 0])
    silent, _ = built(recordings(6, 200, spoken=[]), gb.config())
    assert (silent.thresholds[:, 0] == 0).all() and np.isnan(silent.thresholds[:, 1]).all()


# --- distances of nodes -------------------------------------------------------------------------------------


@gb.FEW
@given(seed=st.integers(0, 10_000), breaks=st.lists(st.integers(1, 40), max_size=4))
@example(seed=1, breaks=[5, 6, 7, 20])
@example(seed=3, breaks=[1, 2])
def test_distances_are_those_of_the_motion_graph(seed, breaks):
    rng = np.random.default_rng(seed)
    config = gb.config({"quality": {"enabled": False}}, continuity={"lambda_vel": float(rng.uniform(0, 3))})
    (reference,) = recordings(seed, int(rng.integers(1, 41)) if seed > 5 else 21)
    starts = np.unique([0, *(b for b in breaks if b < reference.motion.n_frames)])
    database, _ = built([replace(reference, segment_starts=starts)], config)
    poses, speeds = naive.poses_and_velocities(database.positions, database.segment_starts)
    settings, n = config.continuity, database.n_nodes
    expected = [naive.distances_from(left, poses, speeds, settings) for left in range(n)]
    lefts, rights = np.divmod(np.arange(n * n), n)
    np.testing.assert_allclose(
        database.distances(lefts, rights, settings).reshape(n, n), expected, rtol=1e-12, atol=1e-12
    )
    graph = motion_graph.build([replace(reference, segment_starts=starts)], config)
    some = rng.integers(0, n // 2, size=(2, 20))
    np.testing.assert_array_equal(database.distances(*some, settings), graph.distances(*some, settings))


# --- edges --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mirror", [True, False])
@pytest.mark.parametrize("frames", [2, 5, 8])
def test_edges_are_the_pairs_below_delta(mirror, frames):
    delta_t = 1.5 * frames
    config = gb.config(NEAR | {"mirror": mirror, "transition_frames": frames, "lower": {"delta_t": delta_t}})
    database, parts = built(recordings(7, 240, 200, excluded=[(60, 100)]), config)
    assert database.deltas[1] == delta_t
    for body, delta in zip(BODIES, database.deltas, strict=True):
        own = getattr(config.gesture_master, body)
        costs = naive.transition_costs(*all_borders(parts, body, config), own.lambda_1, own.lambda_2)
        # No pair is so close to the threshold that rounding decides.
        assert np.abs(costs - delta).min() > 1e-9 or own.delta_quantile is not None
        found = edges_of(database, body)
        assert 0 < len(found) < costs.size
        below = {(int(p), int(q)) for p, q in np.argwhere(costs < delta - 1e-9)}
        near = {(int(p), int(q)) for p, q in np.argwhere(costs < delta + 1e-9)}
        assert below <= set(found) <= near
        for (p, q), cost in found.items():
            assert cost == pytest.approx(costs[p, q], rel=1e-6, abs=1e-7)


@gb.FEW
@given(seed=st.integers(0, 10_000))
def test_playing_on_costs_nothing(seed):
    database, _ = built(recordings(seed, 240, excluded=[(60, 100)]), gb.config())
    for body in BODIES:
        found = edges_of(database, body)
        for p in range(len(database.starts) - 1):
            # Not from one stretch, or copy, to another.
            if database.stops[p] == database.starts[p + 1] and database.starts[p + 1] not in database.segment_starts:
                assert found[p, p + 1] == 0.0
        assert all(cost >= 0 and cost < 8 for cost in found.values())


@gb.FEW
@given(seed=st.integers(0, 10_000), share=st.sampled_from([0.05, 0.3, 0.9]))
def test_the_quantile_is_the_share_of_transitions_between_different_clips(seed, share):
    config = gb.config({body: {"delta_t": None, "delta_quantile": share} for body in BODIES})
    database, _ = built(recordings(seed, 400), config)
    n = len(database.starts)
    for body, delta in zip(BODIES, database.deltas, strict=True):
        different = [(p, q) for p, q in edges_of(database, body) if p != q]
        # Of n (n - 1) pairs a quantile lies between two neighbours; up to four mirrored pairs cost the same.
        assert abs(len(different) - share * n * (n - 1)) <= 5
        assert delta > 0


@pytest.mark.parametrize("mirror", [True, False])
@pytest.mark.parametrize("frames", [10, 25, 50])
def test_a_quantile_of_no_transitions_at_all(frames, mirror):
    # One clip of its own, or none: there may be no pair of different clips.
    config = gb.config({body: {"delta_t": None, "delta_quantile": 0.5} for body in BODIES} | {"mirror": mirror})
    references = recordings(8, frames, spoken=[("a", 0, frames)])
    if frames < 15:
        with refused(DataError, "no gesture clip is left of 1 references .*the first: clip0@0.00: 0.33 s long"):
            built(references, config)
        return
    database, _ = built(references, config)
    assert len(database.starts) == (2 if mirror else 1)
    assert np.isfinite(database.deltas).all()


def test_no_clip_left_is_one_line():
    config = gb.config({"quality": {"exclude": ("clip*",)}})
    with refused(
        DataError, r"no gesture clip is left of 2 references \(\d+ were dropped, the first: clip0@0.00: excluded\)"
    ):
        built(recordings(8, 100, 100), config)


@pytest.mark.parametrize("blocks", [[1] * 100, [3, 1, 100], [100], [0, 2, 0, 100]])
def test_edges_found_block_by_block_are_the_same(blocks):
    config = gb.config(NEAR)
    database, parts = built(recordings(9, 240, 200), config)
    for body in BODIES:
        borders = all_borders(parts, body, config)
        delta = threshold(borders, body, config)
        whole = link(borders, body, delta, config)
        n, first, found = len(database.starts), 0, []
        for size in blocks:
            last = min(first + size, n)
            found.append(link(borders, body, delta, config, first, last))
            first = last
        counts = np.concatenate([np.diff(part.indptr) for part in found])
        np.testing.assert_array_equal(np.append(0, np.cumsum(counts)), whole.indptr)
        np.testing.assert_array_equal(np.concatenate([part.sources for part in found]), whole.sources)
        np.testing.assert_array_equal(np.concatenate([part.costs for part in found]), whole.costs)
        np.testing.assert_array_equal(whole.sources, getattr(database, f"{body}_sources"))
        assert whole.delta == delta == database.deltas[BODIES.index(body)]


def test_the_order_of_recordings_numbers_the_clips_only():
    config = gb.config(NEAR)
    references = recordings(10, 240, 200)
    (one, _), (other, _) = built(references, config), built(references[::-1], config)
    places = {key: k for k, key in enumerate(keys(other))}
    order = [places[key] for key in keys(one)]
    np.testing.assert_array_equal(other.styles[order], one.styles)
    for body in BODIES:
        moved = {(order[p], order[q]): cost for (p, q), cost in edges_of(one, body).items()}
        assert moved == edges_of(other, body)


def keys(database):
    half = len(database.starts) // 2
    return [(str(name), k >= half) for k, name in enumerate(database.names)]


# --- fingers ------------------------------------------------------------------------------------------------


def with_and_without(seed, config, *moving):
    rng = np.random.default_rng(seed)
    references = [gb.reference(rng, 150, f"clip{k}", fingers=own) for k, own in enumerate(moving)]
    return built(references, config)


@gb.FEW
@given(seed=st.integers(0, 10_000), mirror=st.booleans())
def test_clips_without_fingers_borrow_those_of_the_nearest_clip(seed, mirror):
    database, parts = with_and_without(seed, gb.config({"mirror": mirror}), True, False, True)
    copies = 2 if mirror else 1
    poses = np.concatenate([part.poses[copy] for copy in range(copies) for part in parts]).astype(float)
    has = np.concatenate([np.full(len(part.starts), bool(part.has_fingers)) for _ in range(copies) for part in parts])
    for k, source in enumerate(database.finger_sources.tolist()):
        if has[k]:
            assert source == k
        else:
            apart = [np.linalg.norm(poses[k] - poses[other]) if has[other] else np.inf for other in range(len(has))]
            assert source == int(np.argmin(apart))
    assert database.finger_names.tolist() == list(gb.FINGERS)


def test_the_mirrored_copy_borrows_from_the_mirrored_copy():
    database, _ = with_and_without(11, gb.config(), True, False)
    half = len(database.starts) // 2
    np.testing.assert_array_equal(database.finger_sources[half:], database.twins[database.finger_sources[:half]])


@pytest.mark.parametrize(
    ("moving", "master"),
    [((False, False), {}), ((True, True), {}), ((True, False), {"finger_transfer": False})],
)
def test_all_fingers_are_their_own_where_none_can_or_need_be_borrowed(moving, master):
    database, _ = with_and_without(12, gb.config(master), *moving)
    np.testing.assert_array_equal(database.finger_sources, np.arange(len(database.starts)))


def test_a_recording_without_clips_lends_and_borrows_nothing():
    rng = np.random.default_rng(13)
    references = [gb.reference(rng, 150, f"clip{k}", fingers=k != 1) for k in range(3)]
    config = gb.config({"quality": {"exclude": ("clip2@*",)}})
    database, parts = built(references, config)
    assert len(parts[2].starts) == 0 and not any(name.startswith("clip2") for name in database.names)
    two, _ = built(references[:2], config)
    np.testing.assert_array_equal(database.finger_sources, two.finger_sources)
    np.testing.assert_array_equal(database.styles, two.styles)
    for body in BODIES:
        assert edges_of(database, body) == edges_of(two, body)


def test_the_first_recording_may_be_the_one_without_clips():
    rng = np.random.default_rng(14)
    references = [gb.reference(rng, 150, f"clip{k}", fingers=k == 1) for k in range(3)]
    database, _ = built(references, gb.config({"quality": {"exclude": ("clip0@*",)}}))
    assert {name.split("@")[0] for name in database.names.tolist()} == {"clip1", "clip2"}
    assert (database.finger_sources[database.names == database.names[-1]] != len(database.names) - 1).any()
    assert fingers.has_fingers(references[1].motion.rotations[:, [gb.NAMES.index(name) for name in gb.FINGERS]])


# --- files --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    config = gb.config(NEAR)
    database, parts = built(recordings(15, 240, 200, excluded=[(60, 100)], onsets=[5, 30], fingers=False), config)
    path = tmp_path_factory.mktemp("database") / "graph.npz"
    save(path, database, config, ["one", "two"])
    return path, database, parts, config


def test_a_database_is_read_back_as_it_was(stored):
    path, database, _, config = stored
    back = load(path, config, ["one", "two"])
    assert isinstance(back, GestureDatabase)
    for field in fields(GestureDatabase):
        one, other = getattr(database, field.name), getattr(back, field.name)
        if isinstance(one, KeyNodes):
            for name in ("frames", "kinds", "keywords"):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        elif isinstance(one, np.ndarray):
            assert one.dtype == other.dtype and not other.flags.writeable, field.name
            np.testing.assert_array_equal(one, other, err_msg=field.name)
        else:
            assert type(one) is type(other) and one == other, field.name
    for name, array in files.map_arrays(path, 2000).items():
        np.testing.assert_array_equal(array, files.read_arrays(path, [name])[name], strict=True)


def test_a_stored_database_is_searched_alike(stored):
    path, database, _, config = stored
    speech = gb.speech(150, gb.words(np.random.default_rng(0), 150))
    one, other = (gesture_master.search(d, speech, config, np.random.default_rng(0)) for d in (database, load(path)))
    for left, right in zip(one.tracks, other.tracks, strict=True):
        np.testing.assert_array_equal(left.nodes, right.nodes)
    assert one.objective == other.objective


def test_saving_twice_gives_the_same_bytes(stored, tmp_path):
    path, _, parts, config = stored
    references = recordings(15, 240, 200, excluded=[(60, 100)], onsets=[5, 30], fingers=False)
    again = of_parts([part(reference, config) for reference in references], config)
    save(tmp_path / "again.npz", again, config, ["one", "two"])
    assert (tmp_path / "again.npz").read_bytes() == path.read_bytes()
    edges = {
        body: link(borders, body, threshold(borders, body, config), config)
        for body, borders in ((body, all_borders(parts, body, config)) for body in BODIES)
    }
    save(tmp_path / "parts.npz", assemble(parts, described(references, config), edges, config), config, ["one", "two"])
    assert (tmp_path / "parts.npz").read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    ("changed", "key"),
    [
        ({"upper": {"delta_t": 5.0}, "lower": NEAR["lower"]}, "gesture_master.upper.delta_quantile"),
        (NEAR | {"cutting": {"gap_seconds": 0.3}}, "gesture_master.cutting.gap_seconds"),
        (NEAR | {"rhythm": {"bits": 8}}, "gesture_master.rhythm.bits"),
        (NEAR | {"mirror": False}, "gesture_master.mirror"),
        (NEAR | {"quality": {"exclude": ("clip0@0.00",)}}, "gesture_master.quality.exclude"),
        (NEAR | {"transition_frames": 6}, "gesture_master.transition_frames"),
        (NEAR | {"style": {"source": "predict"}}, "gesture_master.style.source"),
    ],
)
def test_a_database_of_other_settings_is_refused(stored, changed, key):
    path = stored[0]
    with refused(DataError, f"made with {key} = .*run `gesturegen build-graph` again", path):
        load(path, gb.config(changed))
    assert key.rsplit(".", 1)[0] in METHODS["gesture_master"].settings or key in METHODS["gesture_master"].settings


def test_settings_of_the_search_do_not_matter(stored):
    path = stored[0]
    load(path, gb.config(NEAR | {"rhythm": {"words": "span"}, "lambda_reuse": 1.0, "time_scale": {"max": 1.5}}))
    load(path, gb.config({body: NEAR[body] | {"lambda_3": 9.0, "lambda_4": 9.0, "zeta": 1.0} for body in BODIES}))


def test_a_database_of_other_clips_is_refused(stored):
    path, _, _, config = stored
    for digests in (["one"], ["one", "2"], ["two", "one"], []):
        with refused(DataError, "its clips were preprocessed again since; run `gesturegen build-graph`", path):
            load(path, config, digests)


def test_a_database_of_another_format_or_without_an_array_is_refused(stored, tmp_path):
    arrays = files.read_arrays(stored[0])
    stored_arrays.write(tmp_path / "newer.npz", arrays | {"format_version": np.array(99)})
    with refused(
        DataError, "format 99, this version reads 3; run `gesturegen build-graph` again", tmp_path / "newer.npz"
    ):
        load(tmp_path / "newer.npz")
    for name in arrays:
        stored_arrays.write(tmp_path / "less.npz", {key: value for key, value in arrays.items() if key != name})
        with refused(DataError, f"no array '{name}' in it", tmp_path / "less.npz"):
            load(tmp_path / "less.npz", stored[3], ["one", "two"])
    with refused(DataError, "this gesture database has not been built; run `gesturegen build-graph` first"):
        load(tmp_path / "none.npz")


# --- mapped arrays ------------------------------------------------------------------------------------------


RNG = np.random.default_rng(0)
ARRAYS = {
    "floats": RNG.normal(size=(7, 3, 2)),
    "single": RNG.normal(size=50).astype(np.float32),
    "bools": RNG.random(33) < 0.5,
    "texts": np.array(["", "a", "Grüße", "long " * 20]),
    "no_texts": np.array([], dtype=str),
    "text": np.array("one"),
    "number": np.array(2.5),
    "whole": np.array(7),
    "empty": np.zeros(0),
    "flat": np.zeros((3, 0, 4), dtype=np.float32),
    "fortran": np.asfortranarray(RNG.normal(size=(40, 9))),
    "strided": RNG.normal(size=(40, 9))[::2, ::3],
    "bytes": RNG.integers(0, 255, size=1001).astype(np.uint8),
    "large": RNG.normal(size=(400, 400)),
    "large_fortran": np.asfortranarray(RNG.normal(size=(400, 500)).astype(np.float32)),
    "large_bools": RNG.random((1200, 900)) < 0.5,
    "large_texts": np.array([f"name {k}" for k in range(40_000)]),
    "big_endian": np.arange(5, dtype=">f8"),
}  # fmt: skip


@pytest.mark.parametrize("at_least", [None, 1, 200, 10**9])
def test_mapped_arrays_are_the_arrays(tmp_path, at_least):
    files.write_arrays(tmp_path / "all.npz", ARRAYS)
    mapped = files.map_arrays(tmp_path / "all.npz", *([] if at_least is None else [at_least]))
    read = files.read_arrays(tmp_path / "all.npz")
    assert list(mapped) == list(read) == list(ARRAYS)
    for name, array in read.items():
        assert mapped[name].dtype == array.dtype == ARRAYS[name].dtype, name
        assert mapped[name].shape == array.shape == ARRAYS[name].shape, name
        np.testing.assert_array_equal(mapped[name], ARRAYS[name], err_msg=name)
        assert type(mapped[name]) is np.ndarray
        assert mapped[name].flags.f_contiguous == array.flags.f_contiguous
        limit = 1_000_000 if at_least is None else at_least
        if array.nbytes > limit:
            assert not mapped[name].flags.writeable and not mapped[name].flags.owndata, name


@SMALL
@given(seed=st.integers(0, 10_000))
def test_any_arrays_are_mapped(tmp_path_factory, seed):
    rng = np.random.default_rng(seed)
    kinds = ["<f8", "<f4", "<i8", "|b1", "<U3", "|u1"]
    arrays = {}
    for k in range(int(rng.integers(0, 6))):
        shape = tuple(rng.integers(0, 5, size=int(rng.integers(0, 4))).tolist())
        array = np.asarray(rng.integers(0, 2, size=shape)).astype(rng.choice(kinds))
        arrays[f"a{'é' * k}{k}"] = np.asfortranarray(array) if rng.random() < 0.5 else array
    path = tmp_path_factory.mktemp("any") / "arrays.npz"
    files.write_arrays(path, arrays)
    for limit in (0, 150, 10**6):
        mapped = files.map_arrays(path, limit)
        assert list(mapped) == list(arrays)
        for name, array in arrays.items():
            np.testing.assert_array_equal(mapped[name], array, strict=True)


def test_a_mapped_array_outlives_the_file_and_can_be_written_over(tmp_path):
    path = tmp_path / "a.npz"
    files.write_arrays(path, {"a": np.arange(1000)})
    mapped = files.map_arrays(path, 1)["a"]
    files.write_arrays(path, {"a": np.zeros(1000, dtype=int)})
    np.testing.assert_array_equal(mapped, np.arange(1000))
    path.unlink()
    np.testing.assert_array_equal(mapped, np.arange(1000))


SOME = {"small": np.arange(4), "large": np.arange(200.0), "text": np.array(["x", "yz"])}


@pytest.mark.parametrize("at_least", [1, 10**6])
def test_a_truncated_file_is_refused_at_any_length(tmp_path, at_least):
    path = tmp_path / "a.npz"
    files.write_arrays(path, SOME)
    whole = path.read_bytes()
    for length in [*range(0, len(whole), 37), len(whole) - 1]:
        path.write_bytes(whole[:length])
        with refused(DataError, "damaged .*; delete it and run the command that writes it", path):
            files.map_arrays(path, at_least)


def test_a_damaged_byte_is_refused_or_does_not_matter(tmp_path):
    # No checksum guards what is mapped; an array that has lost its name is missed by whoever asks for it.
    path = tmp_path / "a.npz"
    files.write_arrays(path, SOME)
    whole = path.read_bytes()
    mapped = range(whole.index(b"\x93NUMPY", whole.index(b"large.npy")), whole.index(b"text.npy"))
    refusals = 0
    for place, flip in zip(range(len(whole)), itertools.cycle((0x01, 0x80, 0x10)), strict=False):
        if place in mapped:
            continue
        path.write_bytes(whole[:place] + bytes([whole[place] ^ flip]) + whole[place + 1 :])
        try:
            found = files.map_arrays(path, 1500)
        except DataError as error:
            assert "\n" not in str(error), (place, flip, str(error))
            refusals += 1
            continue
        for name in set(found) & set(SOME):
            np.testing.assert_array_equal(found[name], SOME[name], strict=True, err_msg=f"{name}, byte {place}")
    assert refusals > 250


def test_a_mapped_array_of_another_shape_than_its_size_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    files.write_arrays(path, SOME)
    path.write_bytes(path.read_bytes().replace(b"(200,)", b"(210,)"))
    with refused(DataError, "damaged", path):
        files.map_arrays(path, 1500)


@pytest.mark.parametrize("at_least", [1, 10**6])
def test_compressed_arrays_are_refused(tmp_path, at_least):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, **SOME)
    with refused(DataError, r"damaged \(small.npy is compressed\)", path):
        files.map_arrays(path, at_least)


@pytest.mark.parametrize("at_least", [1, 10**6])
def test_objects_and_other_files_are_refused(tmp_path, at_least):
    path = tmp_path / "a.npz"
    np.savez(path, objects=np.array([None, "x"], dtype=object))
    with refused(DataError, "damaged", path):
        files.map_arrays(path, at_least)
    path.write_text("no archive")
    with refused(DataError, "damaged", path):
        files.map_arrays(path, at_least)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("note.txt", "no array")
    with refused(DataError, "damaged", path):
        files.map_arrays(path, at_least)
    with refused(DataError, "cannot be read", tmp_path / "none.npz"):
        files.map_arrays(tmp_path / "none.npz", at_least)
    with refused(DataError, "cannot be read", tmp_path):
        files.map_arrays(tmp_path, at_least)

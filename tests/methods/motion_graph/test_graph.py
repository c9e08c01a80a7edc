"""Building, storing and reading motion graphs."""

import os
from pathlib import Path

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesturegen import pose_distance
from gesturegen.errors import DataError
from gesturegen.methods import METHODS, libraries
from gesturegen.methods.motion_graph import continuity
from gesturegen.methods.motion_graph.graph import build, from_positions
from gesturegen.motion import bvh, kinematics
from gesturegen.settings.models import GENEA_JOINTS, Continuity
from tests import naive, tiny

QUICK = settings(deadline=None, derandomize=True, max_examples=120)


def save(path, library, *rest):
    libraries.save(path, METHODS["motion_graph"], library, *rest)


def load(path, *rest):
    return libraries.load(path, METHODS["motion_graph"], *rest)


def unnatural(graph):
    return {pair: weight for pair, weight in naive.edges_of(graph).items() if weight or pair[1] != pair[0] + 1}


def assert_same_edges(graph, expected):
    found = naive.edges_of(graph)
    assert found.keys() == expected.keys()
    for pair, weight in expected.items():
        assert found[pair] == pytest.approx(weight, rel=1e-4, abs=0)


def test_a_five_frame_graph_has_the_edges_computed_by_hand():
    # x = 0, 3, 4, 1, 2: thresholds 3, 1, 3, 1; candidates 0->3, 0->4, 2->1, 2->4, of which only 0->4 is
    # not beside one of the natural edges 1->2 (twice) and 3->4.
    graph = tiny.graph_of_positions([[[x, 0, 0]] for x in (0, 3, 4, 1, 2)], lambda_vel=0.0, l_cn=1, l_pn=1)
    np.testing.assert_array_equal(graph.thresholds, [3, 1, 3, 1, np.nan])
    assert naive.edges_of(graph) == {(0, 1): 0, (0, 4): 2, (1, 2): 0, (2, 3): 0, (3, 4): 0}
    assert graph.indptr.tolist() == [0, 2, 3, 4, 5, 5]
    assert graph.indices.tolist() == [1, 4, 2, 3, 4]
    assert graph.natural.tolist() == [True, False, True, True, True]
    assert graph.weights.dtype == np.float32
    assert graph.children(0).tolist() == [1, 4] and graph.children(4).tolist() == []


def random_positions(kind, rng, frames):
    if kind == "walk":
        return rng.normal(size=(frames, 3, 3)).cumsum(axis=0)
    if kind == "grid":
        return rng.integers(0, 3, size=(frames, 2, 3)).astype(float)
    if kind == "loop":
        loop = rng.normal(size=(max(2, frames // 4), 3, 3)).cumsum(axis=0)
        return loop[np.arange(frames) % len(loop)]
    if kind == "smooth":
        times = np.linspace(0, 6 * np.pi, frames)[:, None, None]
        return 20 * np.sin(times + 6 * rng.random((1, 3, 3)))
    return np.ones((frames, 2, 3)) * rng.normal(size=3)  # static


@QUICK
@given(
    seed=st.integers(0, 10_000),
    kind=st.sampled_from(["walk", "grid", "loop", "smooth", "static"]),
    frames=st.integers(1, 60),
    l_pn=st.integers(1, 12),
    l_cn=st.integers(1, 8),
    lambdas=st.sampled_from([(1.0, 1.0), (1.0, 0.0), (0.0, 1.0), (0.0, 0.0), (0.5, 2.0)]),
    cuts=st.integers(0, 5),
    block_pairs=st.sampled_from([None, 1, 7, 100]),
)
def test_the_graph_equals_the_naive_one(seed, kind, frames, l_pn, l_cn, lambdas, cuts, block_pairs):
    rng = np.random.default_rng(seed)
    positions = random_positions(kind, rng, frames).astype(np.float32)
    starts = np.unique([0, *rng.integers(0, frames, size=cuts)])
    rules = {"lambda_pos": lambdas[0], "lambda_vel": lambdas[1], "l_pn": l_pn, "l_cn": l_cn}
    graph = tiny.graph_of_positions(positions, starts, block_pairs=block_pairs, **rules)
    assert_same_edges(graph, naive.build(positions, starts, Continuity(**rules)))
    np.testing.assert_array_equal(graph.thresholds, naive.thresholds(positions, starts, Continuity(**rules)))
    # Children ascend, naturals are flagged.
    for node in range(frames):
        assert (np.diff(graph.children(node)) > 0).all()
    flagged = {(a, b) for a in range(frames) for b, is_natural in
               zip(graph.children(a), graph.natural[graph.indptr[a] : graph.indptr[a + 1]], strict=True) if is_natural}  # fmt: skip
    segment = naive.segments(starts, frames)
    assert flagged == {(a, a + 1) for a in range(frames) if a < segment[a][1]}


def test_random_graphs_do_have_unnatural_edges():
    # Guards the comparison above against comparing nothing.
    rng = np.random.default_rng(0)
    for kind in ("walk", "grid", "loop", "smooth"):
        positions = random_positions(kind, rng, 60)
        assert len(unnatural(tiny.graph_of_positions(positions, l_pn=2))) > 5


def test_every_block_size_gives_the_same_graph():
    positions = np.random.default_rng(3).normal(size=(50, 3, 3)).cumsum(axis=0)
    expected = tiny.graph_of_positions(positions, [0, 20], l_pn=3)
    for block_pairs in [*range(1, 60, 7), 99, 100, 101, 2500, 10**9]:
        graph = tiny.graph_of_positions(positions, [0, 20], l_pn=3, block_pairs=block_pairs)
        np.testing.assert_array_equal(graph.indptr, expected.indptr)
        np.testing.assert_array_equal(graph.indices, expected.indices)
        np.testing.assert_array_equal(graph.weights, expected.weights)


def test_the_number_of_numba_threads_has_no_effect():
    positions = np.random.default_rng(4).normal(size=(60, 3, 3)).cumsum(axis=0)
    before = numba.get_num_threads()
    edges = []
    try:
        for threads in {1, before}:
            numba.set_num_threads(threads)
            edges.append(naive.edges_of(tiny.graph_of_positions(positions, l_pn=2)))
    finally:
        numba.set_num_threads(before)
    assert all(found == edges[0] for found in edges)


def test_a_graph_far_from_the_origin_equals_the_naive_one():
    rng = np.random.default_rng(5)
    for offset, scale in ((1e4, 1.0), (1e4, 1e-2), (0.0, 1e-6)):
        positions = (rng.normal(size=(50, 5, 3)).cumsum(axis=0) * scale + offset).astype(np.float32)
        assert_same_edges(tiny.graph_of_positions(positions, l_pn=2), naive.build(positions, [0], Continuity(l_pn=2)))


def test_successors_stop_at_a_segments_end():
    graph = tiny.graph_of_positions(np.zeros((6, 1, 3)), [0, 2, 3])
    assert graph.successors.tolist() == [1, 1, 2, 4, 5, 5]
    assert graph.segment_ends.tolist() == [1, 2, 5]


def test_stop_nodes_are_the_keyword_or_onsets_and_segment_ends():
    rows = [(1, "onset"), (2, "keyword", "greeting"), (3, "keyword", "counting"), (4, "keyword", "greeting")]
    graph = tiny.graph_of_positions(np.zeros((6, 1, 3)), [0, 5], rows)
    assert np.flatnonzero(graph.stop_nodes("greeting")).tolist() == [2, 4]
    assert np.flatnonzero(graph.stop_nodes("counting")).tolist() == [3]
    assert not graph.stop_nodes("direction").any()
    # The last node of the first segment is a stop node although its row says keyword.
    assert np.flatnonzero(graph.stop_nodes(None)).tolist() == [1, 4, 5]


def test_clips_stand_one_after_the_other():
    rng = np.random.default_rng(6)
    first = tiny.reference(tiny.motion(rng, 12), onsets=[3], segment_starts=[0, 7], name="a")
    second = tiny.reference(tiny.motion(rng, 9), onsets=[2], source_frames=range(5, 14), name="b")
    graph = build([first, second], tiny.config())
    assert graph.clip_names == ("a", "b") and graph.clip_starts.tolist() == [0, 12]
    assert graph.segment_starts.tolist() == [0, 7, 12]
    assert graph.source_frames.tolist() == [*range(12), *range(5, 14)]
    assert graph.key_nodes.frames.tolist() == [3, 6, 11, 20]
    assert graph.n_nodes == 21 and graph.fps == 30.0 and graph.joint_names == tiny.JOINTS
    assert_same_edges(graph, naive.build(graph.positions, graph.segment_starts, Continuity()))


def test_edges_lead_from_clip_to_clip():
    rng = np.random.default_rng(7)
    shared = tiny.motion(rng, 20)
    graph = build([tiny.reference(shared, name="a"), tiny.reference(shared, name="b")], tiny.config())
    assert any((left < 20) != (right < 20) for left, right in unnatural(graph))


def test_positions_are_those_of_the_selected_joints_from_the_root():
    moved = tiny.motion(np.random.default_rng(8), 5)
    settings = tiny.config(joints=("b_r_wrist", "b_root"), positions={"scale": 2.0})
    graph = build([tiny.reference(moved)], settings)
    world = kinematics.joint_positions(moved)
    np.testing.assert_array_equal(graph.positions[:, 0], (2.0 * (world[:, 3] - world[:, 0])).astype(np.float32))
    assert not graph.positions[:, 1].any()
    assert graph.joint_names == ("b_r_wrist", "b_root") and graph.positions.dtype == np.float32
    world_graph = build([tiny.reference(moved)], tiny.config(positions={"relative_to": "world"}))
    np.testing.assert_array_equal(world_graph.positions, world.astype(np.float32))


def test_different_skeletons_are_refused():
    rng = np.random.default_rng(9)
    other = tiny.skeleton(("b_root", "b_spine0", "b_l_arm", "b_r_wrist", "b_r_thumb0"))
    pair = [tiny.reference(tiny.motion(rng, 5), name="a"), tiny.reference(tiny.motion(rng, 5, other), name="b")]
    with pytest.raises(DataError, match=r"clips a and b cannot share a graph: joint 2 is 'b_r_arm' against 'b_l_arm'"):
        build(pair, tiny.config())


def test_a_saved_graph_comes_back(tmp_path):
    rng = np.random.default_rng(10)
    clips = [tiny.random_reference(rng, 30, "a"), tiny.random_reference(rng, 20, "b")]
    graph = build(clips, tiny.config())
    save(tmp_path / "g.npz", graph, tiny.config())
    again = load(tmp_path / "g.npz", tiny.config())
    for name in ("positions", "clip_starts", "source_frames", "segment_starts", "indptr", "indices", "weights",
                 "natural", "thresholds"):  # fmt: skip
        np.testing.assert_array_equal(getattr(again, name), getattr(graph, name))
        assert getattr(again, name).dtype == getattr(graph, name).dtype
    for name in ("frames", "kinds", "keywords"):
        np.testing.assert_array_equal(getattr(again.key_nodes, name), getattr(graph.key_nodes, name))
    assert (again.joint_names, again.fps, again.clip_names) == (graph.joint_names, graph.fps, graph.clip_names)
    # The file alone defines the edges.
    stored = np.load(tmp_path / "g.npz")
    assert_same_edges(again, naive.build(stored["positions"], stored["segment_starts"], Continuity()))


def test_a_stored_graph_has_the_documented_arrays(tmp_path):
    graph = build([tiny.random_reference(np.random.default_rng(11), 15)], tiny.config())
    save(tmp_path / "g.npz", graph, tiny.config())
    documented = {
        "positions", "joint_names", "fps", "clip_names", "clip_starts", "segment_starts", "indptr", "indices",
        "weights", "natural", "thresholds", "key_frames", "key_kinds", "key_words", "config", "format_version",
    }  # fmt: skip
    assert documented <= set(np.load(tmp_path / "g.npz", allow_pickle=False).files)


def test_a_graph_of_other_settings_is_refused(tmp_path):
    graph = build([tiny.random_reference(np.random.default_rng(12), 15)], tiny.config())
    save(tmp_path / "g.npz", graph, tiny.config())
    with pytest.raises(
        DataError, match=r"made with continuity.l_pn = 10, the config says 1; run `gesturegen build-graph` again"
    ):
        load(tmp_path / "g.npz", tiny.config(continuity={"l_pn": 1}))
    load(tmp_path / "g.npz", tiny.config(beam={"l_npaths": 3}))


def test_a_missing_graph_is_refused(tmp_path):
    with pytest.raises(DataError, match="has not been built; run `gesturegen build-graph` first"):
        load(tmp_path / "g.npz")


def test_arrays_are_read_only():
    graph = tiny.graph_of_positions(np.zeros((3, 1, 3)))
    with pytest.raises(ValueError, match="read-only"):
        graph.weights[0] = 1.0


# --- the real sample ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def real_motion():
    folder = os.environ.get("GESTUREGEN_TEST_DATA")
    if not folder:
        pytest.skip("GESTUREGEN_TEST_DATA is not set: the counts on the real sample are not checked")
    return bvh.read(next(Path(folder).glob("genea_style_sample/trn/main-agent/bvh/*.bvh")))


@pytest.fixture(scope="module", params=["root", "world"])
def real_positions(request, real_motion):
    joints = [real_motion.skeleton.index(name) for name in GENEA_JOINTS]
    pelvis = real_motion.skeleton.index("b_root")
    placed = kinematics.relative_positions(real_motion, joints, pelvis, request.param)
    return request.param, placed.astype(np.float32)


@pytest.mark.parametrize("l_pn", [10, 1])
def test_the_real_sample_has_the_published_number_of_edges(real_positions, l_pn):
    relative_to, positions = real_positions
    assert positions.shape == (1906, 25, 3)
    graph = tiny.graph_of_positions(positions, l_pn=l_pn)
    expected = {("root", 10): 147, ("root", 1): 1957, ("world", 10): 13, ("world", 1): 534}
    assert int((~graph.natural).sum()) == expected[relative_to, l_pn]


def test_the_real_sample_has_the_published_number_of_candidates(real_motion):
    joints = [real_motion.skeleton.index(name) for name in GENEA_JOINTS]
    placed = kinematics.relative_positions(real_motion, joints, real_motion.skeleton.index("b_root"), "root")
    poses, starts = pose_distance.flatten(placed.astype(np.float32)), np.array([0])
    speeds = pose_distance.velocities(poses, starts)
    limits = continuity.thresholds(poses, speeds, starts, Continuity())
    blocks = continuity.candidate_blocks(poses, speeds, limits, Continuity())
    assert sum(len(lefts) for lefts, _, _ in blocks) == 11_004


@pytest.mark.slow
def test_the_real_sample_equals_the_naive_graph(real_positions):
    relative_to, positions = real_positions
    l_pn = {"root": 10, "world": 1}[relative_to]
    expected = naive.build(positions, [0], Continuity(l_pn=l_pn))
    assert_same_edges(tiny.graph_of_positions(positions, l_pn=l_pn), expected)


def test_the_real_clip_keeps_its_edges_through_build(real_motion):
    reference = tiny.reference(real_motion)
    graph = build([reference], tiny.config(joints=GENEA_JOINTS))
    assert int((~graph.natural).sum()) == 147
    rules = Continuity()
    again = from_positions(
        graph.positions, graph.segment_starts, rules, joint_names=graph.joint_names, fps=graph.fps,
        clip_names=graph.clip_names, clip_starts=graph.clip_starts, source_frames=graph.source_frames,
        key_nodes=graph.key_nodes, speaking=graph.speaking,
    )  # fmt: skip
    np.testing.assert_array_equal(again.indices, graph.indices)

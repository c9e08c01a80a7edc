"""Measures of one clip and of a run: what they gather, and how totals are formed."""

import numpy as np
import pytest

from gesturegen import evaluation, submission
from gesturegen.data.clips import Speech
from gesturegen.data.keynodes import of_speech
from gesturegen.methods.motion_graph import graph as motion_graph
from gesturegen.metrics import beats, frechet, genea, synchrony
from gesturegen.metrics.feet import FootSkate
from gesturegen.path import Path, Piece, Target, Track
from gesturegen.render import render
from tests import tiny

CONFIG = tiny.config()


@pytest.fixture
def moved():
    return tiny.motion(np.random.default_rng(0), 120)


def test_positions_are_the_metrics_inputs(moved):
    joints = evaluation.locate(moved, CONFIG)
    assert joints.world.shape == (120, 5, 3)
    assert np.abs(joints.relative[:, 0]).max() < 1e-9  # b_root, seen from itself
    assert joints.wrists == [3] and joints.parents.tolist() == [-1, 0, 1, 2, 3]


def test_every_measure_has_its_own_evidence(moved):
    joints = evaluation.locate(moved, CONFIG)
    bare = evaluation.measure_clip(joints, CONFIG)
    known = {key for key, value in bare.items() if np.isfinite(value)}
    assert known == {"failure", "div", "jerk", "acceleration", "still_share", "still_longest"}
    onsets = np.array([0.5, 1.0, 2.5])
    heard = evaluation.measure_clip(joints, CONFIG, evaluation.Heard(onsets))
    assert {key for key, value in heard.items() if np.isfinite(value)} == known | {
        "bc_distance", "bc_kernel", *(f"{reading}{end}" for reading in ("a2m", "hands_beat", "angle_beat")
                                      for end in ("", "_z", "_deviation")),
    }  # fmt: skip
    times = beats.motion_beats(beats.angle_change_rate(joints.world, joints.parents, fps=30), fps=30)
    assert heard["bc_kernel"] == beats.beat_kernel(onsets, times, sigma_seconds=0.1)


def test_a_motion_is_at_no_distance_from_itself(moved):
    joints = evaluation.locate(moved, CONFIG)
    row = evaluation.measure_clip(joints, CONFIG, truth=joints)
    assert row["syn"] == 0 and row["hellinger"] == 0 and row["frechet_30"] == pytest.approx(0, abs=1e-6)


def test_totals_pool_distributions_and_average_the_rest():
    rng = np.random.default_rng(1)
    clips = [evaluation.locate(tiny.motion(rng, frames), CONFIG) for frames in (90, 120)]
    truths = [evaluation.locate(tiny.motion(rng, frames, travel=2.0), CONFIG) for frames in (100, 110)]
    rows = [evaluation.measure_clip(a, CONFIG, truth=b) for a, b in zip(clips, truths, strict=True)]
    total = evaluation.totals([*rows, evaluation.failed_row(CONFIG)], clips, truths, CONFIG)
    assert total["failure"] == 1
    assert total["syn"] == pytest.approx(
        np.mean([synchrony.synchrony(a.world, b.world) for a, b in zip(clips, truths, strict=True)])
    )
    histograms = [sum(genea.speed_histogram(j.world, fps=30) for j in side) for side in (clips, truths)]
    assert total["hellinger"] == genea.hellinger_distance(*histograms)
    sides = [[j.relative for j in side] for side in (clips, truths)]
    assert total["frechet_30"] == frechet.window_frechet_distance(*sides, window_frames=30)


def path_of(pieces) -> Path:
    """A path from (start, end, nodes) triples."""
    return Path((Track(tuple(Piece(Target(a, b, "onset"), np.array(nodes), 0.0) for a, b, nodes in pieces)),))


def traced(moved, pieces, onsets=(10,)):
    """Graph of `moved` and the trace of hand-made pieces."""
    reference = tiny.reference(moved, onsets=(19, 39))
    graph = motion_graph.build([reference], CONFIG)
    frames = pieces[-1][1]
    speech = Speech("test", np.array(onsets) / 30, (), frames, 30.0)
    trace = submission.make_trace(path_of(pieces), graph, "clip", speech, of_speech(speech, tiny.WORDS), CONFIG)
    return graph, trace


def test_use_of_the_reference_is_read_off_the_trace(moved):
    graph, trace = traced(moved, [(0, 10, range(10, 20)), (10, 30, range(20, 40)), (30, 40, range(10, 20))])
    joints = evaluation.locate(moved.take(trace.shown_nodes()), CONFIG)
    row = evaluation.measure_clip(joints, CONFIG, trace=trace, graph=graph)
    assert row["reference_share"] == pytest.approx(30 / 120)
    assert row["max_uses"] == 2 and row["held_share"] == 0
    assert row["repeated_share"] == pytest.approx(10 / 40)
    assert row["key_node_share"] == 1.0  # node 19, an onset, stands at frame 9, before the key node at 10
    assert row["hard_joins_per_minute"] == pytest.approx(1 / (40 / 30 / 60))
    jump = graph.distances([40], [10], CONFIG.continuity)[0]
    assert row["join_distance_mean"] == row["join_distance_max"] == pytest.approx(jump)


def test_a_key_node_without_a_stop_node_is_not_met(moved):
    graph, trace = traced(moved, [(0, 10, range(11, 21)), (10, 20, range(21, 31))])
    row = evaluation.measure_clip(evaluation.locate(moved.take(slice(0, 20)), CONFIG), CONFIG, trace=trace, graph=graph)
    assert row["key_node_share"] == 0.0


def test_seams_are_hard_joins_and_unnatural_edges(moved):
    graph, trace = traced(moved, [(0, 10, [*range(5), *range(50, 55)]), (10, 20, range(55, 65)), (20, 30, range(10))])
    assert evaluation.seam_frames(trace, graph).tolist() == [5, 20]


def test_a_seam_inside_a_resampled_piece(moved):
    graph, trace = traced(moved, [(0, 11, [*range(5), *range(50, 55)])])
    # Ten nodes over eleven frames: node 5 stands at frame 5 * 10 / 9 = 5.6, first shown at frame 6.
    assert evaluation.seam_frames(trace, graph).tolist() == [6]


def test_unblended_natural_motion_has_no_seam_and_a_jump_has(moved):
    smooth = moved.take(slice(0, 40))
    graph, trace = traced(moved, [(0, 10, range(10)), (10, 40, range(10, 40))])
    row = evaluation.measure_clip(evaluation.locate(smooth, CONFIG), CONFIG, trace=trace, graph=graph)
    assert np.isnan(row["seam_jerk"]) and row["hard_joins_per_minute"] == 0
    nodes = [*range(10), *range(80, 110)]
    graph, trace = traced(moved, [(0, 10, nodes[:10]), (10, 40, nodes[10:])])
    row = evaluation.measure_clip(evaluation.locate(moved.take(nodes), CONFIG), CONFIG, trace=trace, graph=graph)
    assert row["seam_jerk"] > 1.5


def test_bare_positions_have_no_beats():
    positions = np.random.default_rng(0).normal(size=(50, 5, 3)).cumsum(axis=0)
    row = evaluation.measure_clip(
        evaluation.from_positions(positions, CONFIG), CONFIG, evaluation.Heard(np.array([0.5]))
    )
    assert np.isnan(row["bc_distance"]) and row["jerk"] > 0


def test_compat_rows_and_total():
    rng = np.random.default_rng(2)
    clips = {name: evaluation.from_positions(rng.normal(size=(60, 25, 3)).cumsum(axis=0) / 9, CONFIG) for name in "ab"}
    rows, total = evaluation.genea_compat(clips, {"a": clips["b"]})
    assert np.isnan(rows["b"]["hellinger_1"]) and rows["a"]["hellinger_1"] == total["hellinger_1"] > 0
    assert total["jerk"] == pytest.approx((rows["a"]["jerk"] + rows["b"]["jerk"]) / 2)


# --- feet, wrists and pauses --------------------------------------------------------------------------------

ON_FEET = tiny.skeleton(("b_root", "b_spine0", "b_r_wrist", "b_l_foot", "b_r_foot"), (-1, 0, 1, 0, 0))
WRISTS = tiny.config(wrists={"enabled": False, "joints": ("b_r_wrist",)})


@pytest.fixture
def walked():
    return tiny.motion(np.random.default_rng(4), 120, ON_FEET)


def measured(shown, graph, trace, config=WRISTS, **given):
    return evaluation.measure_clip(evaluation.locate(shown, config), config, trace=trace, graph=graph, **given)


def played(moved, pieces, onsets=(10,)):
    """Measures of the frames of `moved` that the pieces show, as they are."""
    graph, trace = traced(moved, pieces, onsets)
    return measured(moved.take(trace.shown_nodes()), graph, trace)


def test_foot_skate_of_several_motions_is_weighted_by_their_contact():
    skates = [(FootSkate(2.0, 0.5), 100), (FootSkate(8.0, 1.0), 25)]
    assert evaluation.mean_foot_skate(skates) == pytest.approx((2.0 * 50 + 8.0 * 25) / 75)
    nothing = FootSkate(float("nan"), float("nan"))
    assert evaluation.mean_foot_skate([*skates, (nothing, 1000)]) == evaluation.mean_foot_skate(skates)
    # A foot that touches the floor now and then, never for two frames on end.
    assert evaluation.mean_foot_skate([*skates, (FootSkate(float("nan"), 0.2), 9)]) == pytest.approx(4.0)
    assert np.isnan(evaluation.mean_foot_skate([])) and np.isnan(evaluation.mean_foot_skate([(nothing, 9)]))


def test_foot_skate_is_set_against_the_references(walked):
    joints = evaluation.locate(walked, WRISTS)
    row = evaluation.measure_clip(joints, WRISTS, reference_skate=4.0)
    assert row["foot_skate"] == evaluation.foot_skate(joints).speed > 0
    assert row["foot_skate_ratio"] == pytest.approx(row["foot_skate"] / 4.0)
    assert 0 < row["foot_contact_share"] <= 1
    for unknown in (0.0, float("nan")):
        row = evaluation.measure_clip(joints, WRISTS, reference_skate=unknown)
        assert row["foot_skate"] > 0 and np.isnan(row["foot_skate_ratio"])


def test_without_feet_there_is_no_skate(moved):
    row = evaluation.measure_clip(evaluation.locate(moved, WRISTS), WRISTS, reference_skate=4.0)
    assert np.isnan([row["foot_skate"], row["foot_skate_ratio"], row["foot_contact_share"]]).all()


def test_the_reference_played_as_it_is(walked):
    reference = tiny.reference(walked, onsets=(19, 39))
    pieces = [(0, 10, range(30, 40)), (10, 40, range(40, 70))]
    graph, trace = traced(walked, pieces)
    shown = render(path_of(pieces), [reference], graph, WRISTS)
    row = measured(shown, graph, trace)
    # The first frame has no speed here, but one in the recording.
    assert row["wrist_speed_ratio"] == pytest.approx(1.0, abs=0.05)
    assert np.isnan([row["seam_jerk"], row["seam_jerk_wrists"]]).all()
    assert row["hard_joins_per_minute"] == row["join_distance_sum"] == 0
    # From node 0 on the frames that count are the same on both sides.
    assert played(walked, [(0, 40, range(40))])["wrist_speed_ratio"] == pytest.approx(1.0, abs=1e-5)


def test_wrists_at_half_their_recorded_speed(walked):
    graph, trace = traced(walked, [(0, 199, range(100))])
    shown = render(path_of([(0, 199, range(100))]), [tiny.reference(walked)], graph, WRISTS)
    assert measured(shown, graph, trace)["wrist_speed_ratio"] == pytest.approx(0.5, abs=0.05)


def test_join_distances_are_summed(walked):
    pieces = [(0, 10, range(10, 20)), (10, 30, range(50, 70)), (30, 40, range(70, 80)), (40, 50, range(10))]
    graph, _ = traced(walked, pieces)
    jumps = graph.distances([20, 80], [50, 0], WRISTS.continuity)
    row = played(walked, pieces)
    assert row["join_distance_sum"] == pytest.approx(jumps.sum())
    assert row["join_distance_max"] == pytest.approx(jumps.max())


def test_pauses_are_shown_with_pauses_of_the_reference(walked):
    # The reference speaks at nodes 19 and 39 only, the test speech at frame 10; the ten frames before are no pause.
    row = played(walked, [(0, 10, range(10)), (10, 40, range(10, 40))])
    assert row["pause_share"] == pytest.approx(27 / 29)
    wrist = evaluation.locate(walked, WRISTS).relative[:, 2]
    steps = 30 * np.linalg.norm(np.diff(wrist, axis=0), axis=1)
    assert row["pause_speed"] == pytest.approx(steps[10:39].mean())
    resting = np.delete(steps, [18, 38])
    assert row["pause_speed_ratio"] == pytest.approx(steps[10:39].mean() / resting.mean(), rel=1e-5)


def test_the_pauses_of_the_test_speech_may_be_none(walked):
    row = played(walked, [(0, 10, range(10)), (10, 40, range(10, 40))], onsets=(8, 16, 24, 32))
    assert np.isnan([row["pause_share"], row["pause_speed"], row["pause_speed_ratio"]]).all()
    assert row["wrist_speed_ratio"] > 0


def test_the_pauses_of_the_reference_may_be_none(walked):
    reference = tiny.reference(walked, onsets=range(0, 120, 9))
    graph = motion_graph.build([reference], WRISTS)
    assert graph.speaking.all()
    _, trace = traced(walked, [(0, 10, range(10)), (10, 40, range(10, 40))])
    row = measured(walked.take(slice(0, 40)), graph, trace)
    assert np.isnan([row["pause_share"], row["pause_speed_ratio"]]).all() and row["pause_speed"] > 0


def test_without_wrists_there_are_no_speeds(walked):
    nobody = tiny.config(wrists={"enabled": False, "joints": ("left_hand",)})
    pieces = [(0, 10, range(10)), (10, 40, range(50, 80))]
    graph, trace = traced(walked, pieces)
    row = measured(walked.take(trace.shown_nodes()), graph, trace, nobody)
    wrists = ("wrist_speed_ratio", "pause_speed", "pause_speed_ratio", "seam_jerk_wrists")
    assert np.isnan([row[key] for key in wrists]).all()
    # What is shown in pauses is known without any joint.
    assert row["pause_share"] == 1 and row["seam_jerk"] > 0

"""What stands beside the figures, and what a run's clips give together."""

from dataclasses import replace

import numpy as np
import pytest

from gesturegen import evaluation, viewer
from gesturegen.settings.models import Config
from tests import tiny

CONFIG = Config(
    joints="all", control={"left": "b_r_wrist", "right": "b_r_wrist"}, evaluation={"seam_joints": ("b_root", "b_r_wrist")}
)  # fmt: skip
ONSETS = np.arange(10, 290, 23)


@pytest.fixture(scope="module")
def curves():
    motion = tiny.motion(np.random.default_rng(2), 300)
    return evaluation.locate(motion, CONFIG).curves


def recorded(curves, name="ref"):
    return viewer.Recorded(name, curves, viewer.measure(curves, CONFIG, ONSETS))


def test_a_statue_does_not_score(curves):
    moving, statue = (viewer.measure(one, CONFIG, ONSETS) for one in (curves, curves.held(300)))
    keys = [key for reading in viewer.READINGS for key in (reading, f"{reading}_z")]
    assert all(np.isfinite(moving[key]) for key in keys) and moving["still_share"] == 0
    assert all(np.isnan(statue[key]) for key in keys)
    assert statue["still_share"] == 1 and statue["still_longest"] == 10


def test_a_motion_that_stands_still_for_over_half_scores_in_no_measure_of_alignment():
    motion = tiny.motion(np.random.default_rng(2), 120)
    frozen = motion.take(np.minimum(np.arange(120), 50))
    heard = evaluation.Heard(np.array([0.5, 1.0, 1.4]))
    row, moving = (evaluation.measure_clip(evaluation.locate(one, CONFIG), CONFIG, heard) for one in (frozen, motion))
    keys = ("bc_distance", "bc_kernel", *viewer.READINGS)
    assert all(np.isnan(row[key]) for key in keys) and all(np.isfinite(moving[key]) for key in keys)


def test_a_recording_shown_by_many_clips_counts_once(curves):
    found = [viewer.beside(200, [recorded(curves)], None, CONFIG, name, ONSETS[ONSETS < 200], None) for name in "abc"]
    rows, once = viewer.beside_totals(found), recorded(curves).row
    assert rows[viewer.RECORDING] == pytest.approx({key: once[key] for key in rows[viewer.RECORDING]}, nan_ok=True)
    assert list(rows) == [viewer.RECORDING, viewer.STRETCH, viewer.STATUE]
    assert rows[viewer.STATUE]["still_share"] == 1
    assert abs(rows[viewer.STRETCH]["a2m_z"]) < 2  # the mean of several that hear nothing
    assert len(found[0].stretches) == CONFIG.evaluation.stretches


def test_a_clip_that_is_a_stretch_of_the_recording_is_as_far_as_stretches_are(curves):
    stretch = curves.take(np.arange(40, 240))
    other = replace(stretch, velocities=4.0 * stretch.velocities)
    near, far = (viewer.velocity_ratio(one, None, [recorded(curves)], CONFIG, "a") for one in (stretch, other))
    assert 0.3 < near < 3 < far
    assert viewer.velocity_ratio(stretch, stretch, [recorded(curves)], CONFIG, "a") == pytest.approx(0, abs=1e-9)


def test_seams_need_joins_and_the_control_sees_the_recording(curves):
    shown = np.concatenate([np.arange(0, 100), np.arange(150, 250)])
    jumpy = curves.take(shown)
    evidence = viewer.seam_evidence(jumpy, np.array([100]), shown, np.array([0]), [(recorded(curves), False)], 1)
    assert evidence.n_seams == 1 and evidence.is_seam.sum() == 5
    assert set(evidence.source) <= {f"ref:{fold}" for fold in range(5)}
    # Far from the join and from the ends both have the same motion; at the join the output jumps, the recording not.
    assert evidence.features[10:80] == pytest.approx(evidence.control[10:80], abs=1e-3)
    assert evidence.features[evidence.is_seam, :, 2, 1].max() > evidence.control[evidence.is_seam, :, 2, 1].max()
    total, by_clip = viewer.detect_seams({"a": evidence}, CONFIG)
    assert np.isnan(list(total.values())).all() and np.isnan(list(by_clip["a"].values())).all()


def test_no_speed_is_measured_from_one_segment_to_the_next(curves):
    halves = [curves.take(np.arange(150)), curves.take(np.arange(150, 300))]
    both = viewer.joined(halves)
    for name in ("velocities", "hand_speeds", "joint_beats", "seam_positions"):
        assert np.array_equal(getattr(both, name), getattr(curves, name))

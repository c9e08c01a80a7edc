"""Planted seams: what a forest must find, and what it must not."""

import numpy as np
import pytest

from gesturegen.metrics import detectability


def walk(seed, n_frames=400, n_joints=2):
    """Smooth motion without any structure."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(n_frames + 8, n_joints, 3))
    smooth = np.stack([steps[k : k + n_frames] for k in range(9)]).mean(axis=0)
    return np.cumsum(smooth, axis=0)


def looked_at(clips, seams):
    parts = []
    for number, (positions, frames) in enumerate(zip(clips, seams, strict=True)):
        used, is_seam = detectability.label_frames(len(positions), frames)
        features = detectability.kinematic_features(positions)
        parts.append((features[used], is_seam[used], np.full(used.sum(), number)))
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


SEAMS = [list(range(30 + 7 * k, 380, 50)) for k in range(3)]


def test_frames_near_and_far():
    used, is_seam = detectability.label_frames(40, [20])
    assert np.flatnonzero(is_seam).tolist() == [18, 19, 20, 21, 22]
    assert np.flatnonzero(used & ~is_seam).tolist() == [*range(10), *range(31, 40)]
    used, is_seam = detectability.label_frames(5, [])
    assert used.all() and not is_seam.any()


def test_features_of_known_motion():
    # x = t ** 2 cm: speed 2 t - 1, second difference 2 everywhere, third 0, of which the logarithm has a floor.
    positions = np.zeros((10, 1, 3))
    positions[:, 0, 0] = np.arange(10) ** 2
    features = detectability.kinematic_features(positions, around=1)
    assert features[5, 0, 0] == pytest.approx([np.log(9), np.log(11), np.log(7 * 9 * 11) / 3], rel=1e-6)
    assert features[:, 0, 1, 0] == pytest.approx(np.log(2))
    assert features[:, 0, 2, 0] == pytest.approx(np.log(1e-4))
    assert np.isnan(detectability.kinematic_features(positions[:3])).all()


def test_a_jump_of_one_joint_is_found_by_it_alone_and_no_seam_is_not():
    clips = [walk(seed) for seed in range(3)]
    untouched = detectability.group_aucs(*looked_at(clips, SEAMS), {"still": [0], "jumping": [1]})
    assert all(0.35 < auc < 0.65 for auc in untouched.values())
    jumped = [clip.copy() for clip in clips]
    for clip, frames in zip(jumped, SEAMS, strict=True):
        for frame in frames:
            clip[frame:, 1] += [6.0, 0, 0]
    evidence = looked_at(jumped, SEAMS)
    found = detectability.group_aucs(*evidence, {"still": [0], "jumping": [1]})
    assert found["jumping"] > 0.95 and found["still"] == untouched["still"]
    rougher = detectability.jerk_at_seams_less_elsewhere(*evidence[:2])
    assert rougher[1] > 0.5 > abs(rougher[0])
    assert detectability.seam_auc(*evidence) == detectability.seam_auc(*evidence)


def test_seams_that_are_too_smooth_are_found_in_a_single_clip():
    clip = walk(5, 900)
    frames = list(range(40, 880, 40))
    for frame in frames:  # straight on for 8 frames
        clip[frame - 4 : frame + 5] = np.linspace(clip[frame - 4], clip[frame + 4], 9)
    evidence = looked_at([clip], [frames])
    assert detectability.seam_auc(*evidence) > 0.95
    assert (detectability.jerk_at_seams_less_elsewhere(*evidence[:2]) < -1).all()


def test_without_frames_of_both_kinds_there_is_no_figure():
    features, _, clips = looked_at([walk(0)], [[]])
    assert np.isnan(detectability.seam_auc(features, np.zeros(len(features), bool), clips))
    assert np.isnan(detectability.jerk_at_seams_less_elsewhere(features, np.zeros(len(features), bool))).all()
    assert np.isnan(detectability.auc_over_folds(np.array([0.2, 0.4]), np.array([True, False]), np.array([0, 1])))


def test_auc_of_known_scores():
    # Fold 0: one of two pairs is right; fold 1: a tie.
    scores, truth = np.array([0.9, 0.5, 0.7, 0.3, 0.3]), np.array([False, False, True, True, False])
    assert detectability.auc_over_folds(scores, truth, np.array([0, 0, 0, 1, 1])) == pytest.approx(1.5 / 3)


def test_parts_of_the_body_by_name():
    groups = detectability.joint_groups(["b_root", "b_head", "b_l_wrist", "LeftFoot"])
    assert groups == {"all": [0, 1, 2, 3], "wrists": [2], "head": [1], "feet": [3], "root": [0]}

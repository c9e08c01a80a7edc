"""The matching database on tiny references: its features restated frame by frame, its sequences, its file."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gesturegen.errors import DataError
from gesturegen.methods import METHODS, libraries
from gesturegen.methods.motion_matching import features
from gesturegen.methods.motion_matching.database import (
    FORMAT_VERSION,
    MatchingDatabase,
    build,
    step_frames,
)
from gesturegen.settings.models import Config
from gesturegen.speech.acoustics import Acoustics
from gesturegen.stored import arrays as stored_arrays
from tests import tiny
from tests.builders import refused
from tests.methods.gesture_master import gesture_builders as gb

RATE = 15
JOINTS = ("b_l_forearm", "b_r_forearm", "b_l_wrist", "b_r_wrist", "b_l_index1", "b_r_index1")
STEP = 16


def save(path, library, *rest):
    libraries.save(path, METHODS["motion_matching"], library, *rest)


def load(path, *rest):
    return libraries.load(path, METHODS["motion_matching"], *rest)


def config(matching=None, **sections) -> Config:
    """Settings of sequences of a second, so that tiny references have many."""
    usual = {
        "method": "motion_matching", "joints": "all", "wrists": {"enabled": False}, "acoustics": {"enabled": True},
        "keywords": {"words": tiny.WORDS}, "motion_matching": {"joints": JOINTS, "sequence_seconds": 1.0} | (matching or {}),
    }  # fmt: skip
    return Config(**usual | sections)


def voice(seed: int, values: int) -> Acoustics:
    """A random voice that changes slowly, of `values` values of 14 kinds."""
    rng = np.random.default_rng([seed, 1])
    noise = rng.normal(size=(values + 4, 14)) * np.linspace(1, 30, 14) - 5
    return Acoustics(sum(noise[n : n + values] for n in range(5)) / 5, float(RATE))


def reference(seed: int, frames: int, name: str, **options):
    """A recording with a voice; options as of `gesture_builders.reference`."""
    recorded = gb.reference(np.random.default_rng(seed), frames, name, **options)
    return replace(recorded, speech=replace(recorded.speech, acoustics=voice(seed, frames // 2 + 2)))


def references(seed: int, *frames: int, excluded=()):
    """Several recordings, `excluded` of the first."""
    return [
        reference(10 * seed + k, count, f"clip{k}", excluded=excluded if k == 0 else ())
        for k, count in enumerate(frames)
    ]


# --- the paper's features, frame by frame --------------------------------------------------------------------


def joint_positions(motion, frame: int) -> dict[str, np.ndarray]:
    """Where the joints are in a frame as seen from the pelvis, which faces along z: joint by joint from the root."""
    skeleton, turned, placed = motion.skeleton, [], []
    for joint, parent in enumerate(skeleton.parents):
        local = Rotation.from_quat(motion.rotations[frame, joint], scalar_first=True).as_matrix()
        before, origin = (np.eye(3), np.zeros(3)) if parent < 0 else (turned[parent], placed[parent])
        turned.append(before @ local)
        placed.append(origin + before @ motion.positions[frame, joint])
    pelvis = turned[0]
    heading = np.arctan2(pelvis[0, 2] - pelvis[2, 0], pelvis[0, 0] + pelvis[2, 2])
    back = Rotation.from_euler("Y", -heading).as_matrix()
    return {name: back @ (placed[j] - placed[0]) for j, name in enumerate(skeleton.names)}


def restated(recordings, fps: int = 30) -> SimpleNamespace:
    """The database's features from the paper's words, for the usual settings at 30 fps.

    Poses are those of now and of 1, 2 and 3 fifteenths of a second later; the voice that of now and of 7 times two
    fifteenths later, at the time of the recording. All are z-scores over all frames.
    """
    poses, sounds, starts, stops, valid = [], [], [], [], []
    for recorded in recordings:
        places = [joint_positions(recorded.motion, frame) for frame in range(recorded.motion.n_frames)]
        values = recorded.speech.acoustics.values
        ends = [*recorded.segment_starts[1:].tolist(), recorded.motion.n_frames]
        for start, end in zip(recorded.segment_starts.tolist(), ends, strict=True):
            first = len(poses)
            for frame in range(start, end):
                shown = [places[min(frame + 2 * k, end - 1)] for k in range(4)]
                poses.append(np.concatenate([place[name] for place in shown for name in JOINTS]))
                value = (int(recorded.source_frames[frame]) + 1) // 2
                sounds.append(np.concatenate([values[min(value + 2 * k, len(values) - 1)] for k in range(8)]))
                valid.append(frame + STEP < end)
            cuts = [*range(first, first + end - start, fps), first + end - start]
            starts += cuts[:-1]
            stops += cuts[1:]
    pose, sound = np.array(poses), np.array(sounds, dtype=np.float64)
    return SimpleNamespace(
        pose=(pose - pose.mean(axis=0)) / pose.std(axis=0), audio=(sound - sound.mean(axis=0)) / sound.std(axis=0),
        starts=np.array(starts), stops=np.array(stops), valid=np.array(valid), of_audio=(sound.mean(axis=0), sound.std(axis=0)),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("frames", "excluded"),
    [((100,), ()), ((90, 47, 61), ()), ((120, 40), [(31, 50)]), ((130, 35), [(0, 7), (40, 41), (57, 99)])],
)
def test_features_sequences_and_valid_nodes_are_those_of_the_paper(frames, excluded):
    recordings = references(1, *frames, excluded=excluded)
    database, plain = build(recordings, config()), restated(recordings)
    assert database.pose.dtype == database.audio.dtype == np.float32
    assert database.pose.shape == (database.n_nodes, 4 * 6 * 3) and database.audio.shape == (database.n_nodes, 8 * 14)
    np.testing.assert_allclose(database.pose, plain.pose, atol=2e-4)
    np.testing.assert_allclose(database.audio, plain.audio, atol=2e-4)
    assert database.sequence_starts.tolist() == plain.starts.tolist()
    assert database.sequence_stops.tolist() == plain.stops.tolist()
    assert database.valid.tolist() == plain.valid.tolist()


def test_excluded_frames_do_not_move_the_sound():
    whole, cut = reference(3, 120, "a"), reference(3, 120, "a", excluded=[(20, 50)])
    settings = config()
    first, second = build([whole], settings), build([cut], settings)
    kept = cut.source_frames
    assert len(kept) == 90 and second.source_frames.tolist() == kept.tolist()

    def raw(database):
        return database.audio * database.audio_scales + database.audio_means

    np.testing.assert_allclose(raw(second), raw(first)[kept], atol=1e-3)
    # No pose of the first stretch sees the second one.
    assert second.segment_starts.tolist() == [0, 20] and not second.valid[4:20].any() and second.valid[:4].all()


def test_a_clip_does_not_see_the_next_one():
    both, alone = build(references(4, 60, 50), config()), build(references(4, 60), config())
    for name in ("pose", "audio"):
        raw = [
            getattr(one, name)[:60] * getattr(one, f"{name}_scales") + getattr(one, f"{name}_means")
            for one in (both, alone)
        ]
        np.testing.assert_allclose(raw[0], raw[1], atol=1e-3)
    assert both.clip_names == ("clip0", "clip1") and both.clip_starts.tolist() == [0, 60]
    assert both.sequence_starts.tolist() == [0, 30, 60, 90] and both.sequence_stops.tolist() == [30, 60, 90, 110]


def test_features_are_z_scores_and_new_sound_is_scaled_alike():
    recordings = references(5, 100, 80)
    database = build(recordings, config())
    for scores in (database.pose, database.audio):
        np.testing.assert_allclose(scores.mean(axis=0), 0, atol=1e-5)
        np.testing.assert_allclose(scores.std(axis=0), 1, atol=1e-5)
    times = recordings[1].source_frames / 30
    heard = features.audio_features(recordings[1].speech.acoustics, times, config().motion_matching)
    np.testing.assert_array_equal(features.apply(database.audio_scaling, heard), database.audio[100:])


def test_the_scale_of_positions_does_not_change_scores():
    recordings = references(5, 60)
    metres = build(recordings, config(positions={"scale": 100.0}))
    usual = build(recordings, config())
    np.testing.assert_allclose(metres.pose, usual.pose, atol=1e-4)
    np.testing.assert_allclose(metres.pose_scales, 100 * usual.pose_scales, rtol=1e-5)
    # They look at the pelvis's heading whatever the distances of graphs do.
    for way in ("world", "root_heading"):
        np.testing.assert_array_equal(build(recordings, config(positions={"relative_to": way})).pose, usual.pose)


def test_where_the_speaker_stands_and_faces_does_not_matter():
    recorded = reference(6, 60, "a")
    turn = Rotation.from_euler("Y", 100, degrees=True)
    rotations, positions = recorded.motion.rotations.copy(), recorded.motion.positions.copy()
    own = Rotation.from_quat(rotations[:, 0], scalar_first=True)
    rotations[:, 0] = (turn * own).as_quat(scalar_first=True)
    positions[:, 0] = turn.apply(positions[:, 0]) + np.array([500, 0, -200])
    moved = replace(recorded, motion=replace(recorded.motion, rotations=rotations, positions=positions))
    np.testing.assert_allclose(build([moved], config()).pose, build([recorded], config()).pose, atol=1e-3)


def test_steps_in_frames():
    assert [step_frames(config(fps=fps)) for fps in (15, 30, 25, 60)] == [8, 16, 13, 32]
    assert step_frames(config({"step_seconds": 0.001})) == 1


def test_short_stretches_hold_no_node_to_follow_on():
    database = build(references(7, 16, 17, 18), config())
    assert np.flatnonzero(database.valid).tolist() == [16, 33, 34]
    assert not build(references(7, 5), config()).valid.any()


# --- its file ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def built():
    return build(references(8, 70, 50, excluded=[(10, 30)]), config())


def test_what_is_saved_is_loaded(built, tmp_path):
    path = tmp_path / "graphs/a-matching.npz"
    save(path, built, config(), ("one", "two"))
    for found in (load(path), load(path, config(), ("one", "two")), libraries.read(path)):
        assert isinstance(found, MatchingDatabase)
        for field in fields(built):
            old, new = getattr(built, field.name), getattr(found, field.name)
            if field.name == "key_nodes":
                assert old.frames.tolist() == new.frames.tolist() and old.kinds.tolist() == new.kinds.tolist()
            elif isinstance(old, np.ndarray):
                assert old.dtype == new.dtype and np.array_equal(old, new), field.name
            else:
                assert old == new, field.name
    save(tmp_path / "again.npz", built, config(), ("one", "two"))
    assert (tmp_path / "again.npz").read_bytes() == path.read_bytes()


def test_a_file_of_other_clips_or_settings_is_refused(built, tmp_path):
    path = tmp_path / "a.npz"
    with refused(DataError, "has not been built; run `gesturegen build-graph`", path):
        load(path)
    save(path, built, config(), ("one", "two"))
    with refused(DataError, "preprocessed again since; run `gesturegen build-graph` again", path):
        load(path, config(), ("one", "three"))
    for changed, key in (
        (config({"step_seconds": 0.5}), "motion_matching.step_seconds = 0.53"),
        (config({"audio_values": 4}), "motion_matching.audio_values = 8"),
        (config({"joints": JOINTS[:2]}), "motion_matching.joints = "),
        (config(acoustics={"enabled": True, "rate": 25}), "acoustics.rate = 15"),
        (config(fps=15), "fps = 30"),
    ):
        with refused(DataError, f"made with {key}.*; run `gesturegen build-graph` again", path):
            load(path, changed)


def test_what_only_the_search_looks_at_is_no_setting_of_the_file(built, tmp_path):
    path = tmp_path / "a.npz"
    save(path, built, config())
    other = {"k": 3, "preselect": "audio", "use_audio": False, "start": "mean"}
    assert load(path, config(other, seed=7, refine=True)).n_nodes == built.n_nodes


def test_another_version_and_a_damaged_file_are_refused(built, tmp_path):
    path = tmp_path / "a.npz"
    save(path, built, config())
    arrays = dict(np.load(path))
    stored_arrays.write(path, arrays | {"format_version": np.array(FORMAT_VERSION + 1)})
    with refused(DataError, f"this version reads {FORMAT_VERSION}; run `gesturegen build-graph` again", path):
        load(path)
    stored_arrays.write(path, {name: value for name, value in arrays.items() if name != "pose_means"})
    with refused(DataError, "no array 'pose_means' in it", path):
        load(path)
    save(path, built, config())
    path.write_bytes(path.read_bytes()[:-300])
    with refused(DataError, "damaged|cannot be read|not a", path):
        load(path)


# --- what cannot be built ------------------------------------------------------------------------------------


def test_a_missing_joint_is_named():
    settings = config({"joints": (*JOINTS, "b_l_pinky1")})
    with refused(DataError, "no joint 'b_l_pinky1'.*nearest is", "it has: b_root"):
        build(references(9, 40), settings)


def test_sound_that_was_not_measured_is_told():
    good, bad = references(9, 40, 40)
    bad = replace(bad, speech=replace(bad.speech, acoustics=None))
    with refused(DataError, "clip clip1: its sound was not measured; set acoustics.enabled: true"):
        build([good, bad], config())


def test_references_of_two_skeletons_are_refused():
    other = gb.skeleton(("b_root", *gb.NAMES[1:-1], "another"))
    with refused(DataError, "clips clip0 and b cannot share", "another"):
        build([*references(9, 40), reference(1, 40, "b", bones=other)], config())

"""From a recording to its gesture clips: coverage, names, words, borders, mirrored copies, corrections, lists."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gesturegen.errors import DataError
from gesturegen.methods.gesture_master import fingers, style
from gesturegen.methods.gesture_master.extraction import as_borders, clip_name, extract, mirrored, spoken
from gesturegen.motion import kinematics, rotation
from gesturegen.motion.skeleton import Motion
from gesturegen.speech import rhythm
from tests.builders import make_skeleton, refused
from tests.methods.gesture_master import gesture_builders as gb

OFF = {"quality": {"enabled": False}}
RANGES = st.lists(
    st.tuples(st.integers(0, 560), st.integers(1, 90)).map(lambda r: (r[0], r[0] + r[1])), max_size=2
)  # fmt: skip


def recording(seed, frames=600, **options):
    return gb.reference(np.random.default_rng(seed), frames, **options)


def segments_of(reference):
    """First and last frame of every uninterrupted stretch."""
    return list(itertools.pairwise([*reference.segment_starts.tolist(), reference.motion.n_frames]))


def by_copy(name):
    """Whether an array has a row for the recording and one for its mirrored copy."""
    return name in (
        "positions",
        "styles",
        "poses",
        *(f"{b}_{s}" for b in ("upper", "lower") for s in ("ends", "starts")),
    )


def rows_of(gestures, places):
    """What there is of some clips, in both copies."""
    return {
        name: array[:, places] if by_copy(name) else array[places]
        for name, array in gestures.arrays().items()
        if name in ("rests", "rhythms", "features") or (by_copy(name) and name != "positions")
    }


# --- coverage and names -------------------------------------------------------------------------------------


@gb.FEW
@given(seed=st.integers(0, 10_000), excluded=RANGES)
def test_clips_cover_every_stretch_from_end_to_end(seed, excluded):
    reference = recording(seed, excluded=excluded)
    found = extract(reference, gb.config(OFF))
    bounds = list(zip(found.starts.tolist(), found.stops.tolist(), strict=True))
    assert not len(found.dropped)
    for start, stop in segments_of(reference):
        inside = [bound for bound in bounds if start <= bound[0] < stop]
        assert inside[0][0] == start and inside[-1][1] == stop
        assert all(before[1] == after[0] for before, after in itertools.pairwise(inside))
    assert sum(stop - start for start, stop in bounds) == reference.motion.n_frames


@gb.FEW
@given(seed=st.integers(0, 10_000), excluded=RANGES, glitches=st.lists(st.integers(0, 400), max_size=4))
def test_a_clip_is_either_kept_or_dropped_with_a_reason(seed, excluded, glitches):
    reference = recording(seed, excluded=excluded)
    for frame in glitches:
        reference = gb.glitch(reference, min(frame, reference.motion.n_frames - 1))
    everything = extract(reference, gb.config(OFF))
    found = extract(reference, gb.config())
    left_out = dict(found.dropped.tolist())
    assert sorted([*found.names.tolist(), *left_out]) == sorted(everything.names.tolist())
    kept = np.isin(everything.names, found.names)
    # Judging leaves the others as they are.
    for name, rows in rows_of(everything, kept).items():
        np.testing.assert_array_equal(rows, rows_of(found, slice(None))[name], err_msg=name)
    for name, start, stop in zip(everything.names, everything.starts, everything.stops, strict=True):
        inside = range(start + 1, stop)  # the step onto a clip's first frame is not in it
        if any(f in inside or f + 1 in inside for f in glitches):
            assert name in left_out
        elif stop - start < 15:
            assert left_out[name] == f"{(stop - start) / 30:.2f} s long, below 0.5"
        else:
            assert name not in left_out


def test_names_count_the_frames_of_the_recording():
    reference = recording(3, excluded=[(200, 290)])
    found = extract(reference, gb.config(OFF))
    for name, start in zip(found.names, found.starts.tolist(), strict=True):
        recorded = start if start < 200 else start + 90
        assert name == f"clip@{recorded / 30:.2f}" == clip_name("clip", recorded, 30.0)
    assert "clip@9.67" in found.names  # frame 290, the first after the gap
    assert len(set(found.names.tolist())) == len(found.names)


def test_names_of_dropped_clips_count_the_frames_of_the_recording():
    reference = gb.glitch(recording(3, excluded=[(200, 290)]), 203)
    found = extract(reference, gb.config())
    assert found.dropped[0, 0] == "clip@9.67"


# --- stretches ----------------------------------------------------------------------------------------------


def test_words_after_an_excluded_range_cut_where_they_are_spoken():
    # The second stretch is frames 290 to 599; 15 frames between two of its words, from 315 to 330.
    spoken = [("a", 0, 200), ("b", 210, 280), ("c", 290, 315), ("d", 330, 380), ("e", 382, 599)]
    found = extract(
        recording(4, excluded=[(200, 290)], spoken=spoken), gb.config(OFF | {"cutting": {"max_seconds": 20.0}})
    )
    assert found.starts.tolist() == [0, 200, 200 + 322 - 290]
    assert found.stops.tolist() == [200, 232, 510]


def test_a_word_that_is_cut_off_by_an_excluded_range_counts_on_both_sides():
    found = extract(recording(4, excluded=[(200, 290)], spoken=[("long", 150, 340)]), gb.config(OFF))
    rests = list(zip(found.starts[found.rests].tolist(), found.stops[found.rests].tolist(), strict=True))
    # Silent: the frames 0 to 149 and, of the recording, 340 to 599. Long rests are cut up.
    silent = np.zeros(510, dtype=bool)
    for start, stop in rests:
        silent[start:stop] = True
    assert silent.tolist() == [True] * 150 + [False] * (50 + 50) + [True] * 260


@gb.FEW
@given(seed=st.integers(0, 10_000), excluded=RANGES, voice=st.booleans())
def test_every_stretch_is_as_if_it_were_a_recording_of_its_own(seed, excluded, voice):
    reference = recording(seed, excluded=excluded, voice=seed if voice else None)
    whole = extract(reference, gb.config(OFF))
    first, thresholds = 0, 0.0
    for start, stop in segments_of(reference):
        zero = reference.source_frames[start] / gb.FPS
        words = [(w.start - zero, w.end - zero) for w in reference.speech.words]
        own = gb.reference(
            np.random.default_rng(0), stop - start, spoken=[], moved=reference.motion.take(slice(start, stop))
        )
        heard = [replace(w, start=a, end=b) for w, (a, b) in zip(reference.speech.words, words, strict=True)]
        part = extract(replace(own, speech=replace(own.speech, words=tuple(heard))), gb.config(OFF))
        places = slice(first, first + len(part.starts))
        np.testing.assert_array_equal(whole.starts[places], part.starts + start)
        np.testing.assert_array_equal(whole.stops[places], part.stops + start)
        for name, rows in rows_of(part, slice(None)).items():
            if name != "features":
                np.testing.assert_array_equal(rows_of(whole, places)[name], rows, err_msg=name)
        first += len(part.starts)
        thresholds = thresholds + part.thresholds
    assert first == len(whole.starts)
    np.testing.assert_allclose(whole.thresholds, thresholds)


def test_features_are_those_of_the_voice_at_the_recorded_time():
    reference = recording(5, excluded=[(200, 290)], voice=5)
    found = extract(reference, gb.config(OFF))
    starts = np.array([word.start for word in reference.speech.words])
    for row, start, stop in zip(found.features, found.starts.tolist(), found.stops.tolist(), strict=True):
        shift = 0 if start < 200 else 90
        expected = style.features(reference.speech.prosody, starts, (start + shift) / 30, (stop + shift) / 30)
        np.testing.assert_allclose(row, expected, rtol=1e-12, equal_nan=True)
    assert np.isnan(extract(recording(5), gb.config(OFF)).features).all()


def test_rhythms_and_styles_are_those_of_the_hands():
    # Restated: the hands seen from the hips, turned so that the hips face along z.
    reference = recording(6, 300, excluded=[(100, 130)])
    found = extract(reference, gb.config(OFF))
    names = reference.motion.skeleton.names
    hips = names.index("b_root")
    hands = [names.index(f"b_{side}_wrist") for side in "lr"]
    facing = rotation.about_y(-rotation.heading(reference.motion.rotations[:, hips]))
    places = kinematics.joint_positions(reference.motion)
    seen = np.stack([rotation.rotate(facing, places[:, hand] - places[:, hips]) for hand in hands], axis=1)
    settings = gb.config().gesture_master.rhythm
    for copy, flip in ((0, 1.0), (1, -1.0)):
        own = seen * [flip, 1.0, 1.0]
        right = [1] if copy == 0 else [0]
        for k, (start, stop) in enumerate(zip(found.starts, found.stops, strict=True)):
            np.testing.assert_allclose(found.styles[copy, k], style.signature(own[start:stop], right, 30.0), rtol=1e-9)
    for start, stop in segments_of(reference):
        speeds = rhythm.hand_speeds(seen[start:stop], 30.0, settings.smoothing_seconds)
        for k in np.flatnonzero((found.starts >= start) & (found.starts < stop)):
            bits = rhythm.of_motion(speeds[found.starts[k] - start : found.stops[k] - start], settings)
            np.testing.assert_array_equal(found.rhythms[k], bits)


# --- borders ------------------------------------------------------------------------------------------------


@gb.FEW
@given(seed=st.integers(0, 10_000), excluded=RANGES, frames=st.integers(2, 9))
def test_clips_recorded_one_after_the_other_have_equal_borders(seed, excluded, frames):
    reference = recording(seed, excluded=excluded)
    found = extract(reference, gb.config(OFF | {"transition_frames": frames}))
    same = found.stops[:-1] == found.starts[1:]
    same &= ~np.isin(found.starts[1:], reference.segment_starts)
    assert same.sum() == len(found.starts) - len(reference.segment_starts)
    for body in ("upper", "lower"):
        ends, starts = getattr(found, f"{body}_ends"), getattr(found, f"{body}_starts")
        assert ends.dtype == starts.dtype == np.float32
        np.testing.assert_array_equal(ends[:, :-1][:, same], starts[:, 1:][:, same])


@pytest.mark.parametrize("frames", [2, 5, 8])
def test_borders_are_the_frames_around_them_within_their_stretch(frames):
    reference = recording(7, 300, excluded=[(100, 130)])
    found = extract(reference, gb.config(OFF | {"transition_frames": frames}))
    assert found.upper_joints.tolist() == [len(gb.UPPER)] * 2 and found.lower_joints.tolist() == [len(gb.LOWER)] * 2
    around = range(-(frames // 2), frames - frames // 2)
    for copy, own in enumerate((reference, mirrored(reference, gb.config()))):
        turns, places = kinematics.world_transforms(own.motion)
        hips, hips_at = turns[:, 0], places[:, 0]
        level = rotation.about_y(-rotation.heading(hips))
        rotations = {"upper": own.motion.rotations[:, 5:], "lower": own.motion.rotations[:, :5].copy()}
        rotations["lower"][:, 0] = rotation.multiply(level, hips)
        centred = places - hips_at[:, None]
        seen = {
            "upper": rotation.rotate(rotation.inverse(hips)[:, None], centred)[:, 5:],
            "lower": rotation.rotate(level[:, None], centred)[:, :5],
        }
        for body, (side, marks) in itertools.product(
            ("upper", "lower"), (("ends", found.stops), ("starts", found.starts))
        ):
            joints = getattr(found, f"{body}_joints")
            borders = as_borders(getattr(found, f"{body}_{side}")[copy], joints, frames)
            for k, mark in enumerate(marks.tolist()):
                low, high = next((a, b - 1) for a, b in segments_of(reference) if a <= found.starts[k] < b)
                for f, offset in enumerate(around):
                    frame = min(max(mark + offset, low), high)
                    np.testing.assert_allclose(borders.positions[k, f], seen[body][frame] / 100, atol=1e-6)
                    np.testing.assert_allclose(borders.rotations[k, f], rotations[body][frame], atol=1e-6)


def test_where_the_speaker_stands_and_faces_does_not_count():
    reference = recording(8, 300)
    moved = reference.motion
    rotations, positions = moved.rotations.copy(), moved.positions.copy()
    turn = rotation.about_y(np.array(2.0))
    rotations[:, 0] = rotation.multiply(turn, rotations[:, 0])
    positions[:, 0] = rotation.rotate(turn, positions[:, 0]) + np.array([300.0, 0.0, -50.0])
    elsewhere = replace(reference, motion=replace(moved, rotations=rotations, positions=positions))
    here, there = (extract(own, gb.config(OFF)) for own in (reference, elsewhere))
    np.testing.assert_array_equal(here.starts, there.starts)
    np.testing.assert_array_equal(here.rhythms, there.rhythms)
    np.testing.assert_allclose(here.styles, there.styles, atol=1e-8)
    for body, side in itertools.product(("upper", "lower"), ("ends", "starts")):
        name = f"{body}_{side}"
        # q and -q are one rotation.
        np.testing.assert_allclose(np.abs(getattr(here, name)), np.abs(getattr(there, name)), atol=1e-6)


# --- mirrored copies ----------------------------------------------------------------------------------------


@gb.FEW
@given(seed=st.integers(0, 10_000), excluded=RANGES, voice=st.booleans())
def test_the_second_copy_is_the_first_of_the_mirrored_recording(seed, excluded, voice):
    config = gb.config(OFF)
    reference = recording(
        seed, 300, excluded=[(a // 2, b // 2 + 1) for a, b in excluded], voice=seed if voice else None
    )
    here, there = extract(reference, config), extract(mirrored(reference, config), config)
    for name, array in here.arrays().items():
        other = getattr(there, name)
        if by_copy(name):
            # Mirrored twice, a recording is the one it was.
            np.testing.assert_allclose(array[::-1], other, rtol=0, atol=1e-5, err_msg=name)
        else:
            np.testing.assert_array_equal(array, other, err_msg=name)


def test_without_mirror_there_is_the_first_copy_only():
    reference = recording(9, 300)
    both, one = (extract(reference, gb.config(OFF | {"mirror": mirror})) for mirror in (True, False))
    for name, array in one.arrays().items():
        other = getattr(both, name)
        np.testing.assert_array_equal(array, other[:1] if by_copy(name) else other, err_msg=name)
    assert len(one.positions) == 1 and len(both.positions) == 2


# --- corrections --------------------------------------------------------------------------------------------


BITS = "01" * 16


def corrected(start, clip="clip", bits=BITS, **master):
    return gb.config({"rhythm": {"corrections": ({"clip": clip, "start": start, "bits": bits},)}} | master)


@pytest.mark.parametrize("clip", ["clip", "cl*"])
def test_a_correction_replaces_the_bits_of_one_clip(clip):
    reference = recording(10, excluded=[(200, 290)])
    plain = extract(reference, gb.config())
    for k in range(0, len(plain.names), 5):
        name = str(plain.names[k])
        found = extract(reference, corrected(float(name.split("@")[1]), clip))
        np.testing.assert_array_equal(found.rhythms[k], rhythm.from_text(BITS))
        others = np.arange(len(plain.names)) != k
        np.testing.assert_array_equal(found.rhythms[others], plain.rhythms[others])


def test_corrections_of_other_recordings_are_none_of_its_business():
    reference = recording(10)
    np.testing.assert_array_equal(
        extract(reference, corrected(1e6, "other")).rhythms, extract(reference, gb.config()).rhythms
    )


def test_a_correction_of_no_clip_names_the_nearest():
    reference = recording(10)
    plain = extract(reference, gb.config())
    start = plain.starts[3] / 30 + 0.1
    with refused(
        DataError, r"no gesture clip of clip starts at [\d.]+ s; the nearest starts at", f"{plain.starts[3] / 30:.2f}"
    ):
        extract(reference, corrected(start))


def test_a_correction_of_a_recording_without_clips_is_refused_too():
    with refused(DataError, "no gesture clip of clip starts at 1 s; `gesturegen inspect`"):
        extract(recording(10, 10), corrected(1.0))


# --- lists and quality --------------------------------------------------------------------------------------


def test_lists_overrule_the_figures():
    reference = gb.glitch(recording(11, voice=1), 100)
    plain = extract(reference, gb.config())
    ((name, reason),) = plain.dropped.tolist()
    assert "cm/s, above 900" in reason  # a hand that leaps, more than it turns the arm
    assert name == max(
        (n for n in extract(reference, gb.config(OFF)).names.tolist() if float(n.split("@")[1]) * 30 <= 100.1),
        key=lambda n: float(n.split("@")[1]),
    )
    included = extract(reference, gb.config({"quality": {"include": (name,)}}))
    assert name in included.names and not len(included.dropped)
    other = plain.names[0]
    excluded = extract(reference, gb.config({"quality": {"exclude": (str(other), name)}}))
    assert excluded.dropped.tolist() == sorted(
        [[name, "excluded"], [other, "excluded"]], key=lambda d: float(d[0].split("@")[1])
    )
    assert set(excluded.names) == set(plain.names) - {other}
    # Leaving out wins over taking in, also where nothing is judged.
    both = {"quality": {"include": ("clip@*",), "exclude": ("clip@*",), "enabled": False}}
    assert set(extract(reference, gb.config(both)).dropped[:, 1]) == {"excluded"}


def test_a_recording_without_clips_has_arrays_of_the_usual_width():
    usual = extract(recording(12), gb.config())
    for empty in (
        extract(recording(12), gb.config({"quality": {"exclude": ("*",)}})),
        extract(recording(12, 5), gb.config()),
    ):
        assert len(empty.starts) == 0 and len(empty.dropped)
        for name, array in empty.arrays().items():
            expected = getattr(usual, name)
            assert array.ndim == expected.ndim, name
            assert array.dtype.kind == expected.dtype.kind, name
            if name not in ("dropped", "notes", "positions"):
                trailing = slice(2 if by_copy(name) else 1, None)
                assert array.shape[trailing] == expected.shape[trailing], name


def test_a_recording_shorter_than_a_clip_may_be():
    reference = recording(13, 14, spoken=[("a", 2, 10)])
    found = extract(reference, gb.config())
    assert found.dropped.tolist() == [["clip@0.00", "0.47 s long, below 0.5"]]
    for taken in ({"quality": {"include": ("clip@0.00",)}}, OFF):
        found = extract(reference, gb.config(taken))
        assert (found.starts.tolist(), found.stops.tolist(), found.rests.tolist()) == ([0], [14], [False])


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_a_recording_of_a_few_frames(frames):
    found = extract(recording(13, frames), gb.config(OFF))
    assert found.stops.tolist() == [frames]
    for name, array in found.arrays().items():
        if array.dtype.kind == "f" and name != "features":
            assert np.isfinite(array).all(), name


# --- skeletons and speech -----------------------------------------------------------------------------------


def renamed(reference, names):
    moved = reference.motion
    return replace(reference, motion=replace(moved, skeleton=gb.skeleton(names)))


def test_hands_of_other_names_are_those_farthest_out_and_noted():
    names = tuple(name.replace("wrist", "carpus") for name in gb.NAMES)
    reference = renamed(recording(14, 300), names)
    found = extract(reference, gb.config(OFF))
    (note,) = found.notes.tolist()
    assert "none of the wrist joints (wrists.joints)" in note and note.endswith("b_l_index1, b_r_index1")
    assert not found.has_fingers and not len(found.finger_names)
    named = extract(reference, gb.config(OFF, wrists={"joints": ("b_l_carpus", "b_r_carpus")}))
    usual = extract(recording(14, 300), gb.config(OFF))
    assert not len(named.notes) and named.finger_names.tolist() == list(gb.FINGERS) and named.has_fingers
    np.testing.assert_array_equal(named.styles, usual.styles)
    np.testing.assert_array_equal(named.rhythms, usual.rhythms)


def test_a_skeleton_without_arms_has_no_hands_and_no_rhythm():
    bones = make_skeleton(
        ("b_root", "b_spine0", "b_head", "b_l_leg", "b_r_leg"), (-1, 0, 1, 0, 0),
        [(0, 90, 0), (0, 20, 0), (0, 30, 0), (9, -80, 0), (-9, -80, 0)],
    )  # fmt: skip
    rng = np.random.default_rng(15)
    maps = 0.1 * np.sin(np.arange(200)[:, None, None] / 20 + rng.uniform(0, 6, size=(5, 3)))
    moved = Motion(bones, rotation.from_expmap(maps), np.tile(bones.offsets, (200, 1, 1)), gb.FPS)
    found = extract(gb.reference(rng, 200, moved=moved), gb.config(OFF))
    assert found.notes.tolist()[0].endswith("none")
    assert not found.rhythms.any() and not found.styles.any() and not found.has_fingers
    assert found.upper_names.tolist() == ["b_spine0", "b_head"]


def test_fingers_that_never_move_were_not_recorded():
    assert extract(recording(16, 200), gb.config()).has_fingers
    still = extract(recording(16, 200, fingers=False), gb.config())
    assert not still.has_fingers and still.finger_names.tolist() == list(gb.FINGERS)


def test_poses_are_those_of_the_upper_body_seen_from_the_hips():
    reference = recording(17, 200)
    found = extract(reference, gb.config(OFF))
    turns, places = kinematics.world_transforms(reference.motion)
    seen = rotation.rotate(rotation.inverse(turns[:, :1]), places - places[:, :1])[:, 5:]
    for row, start, stop in zip(found.poses[0], found.starts, found.stops, strict=True):
        np.testing.assert_allclose(row, fingers.describe_poses(seen[start:stop]), atol=1e-4)


def test_without_words_onsets_stand_for_them():
    onsets = [20, 30, 60, 61, 100, 180, 190, 299]
    heard = extract(recording(18, 300, spoken=[], onsets=onsets), gb.config(OFF))
    instants = extract(recording(18, 300, spoken=[("x", f, f) for f in onsets]), gb.config(OFF))
    for name, array in heard.arrays().items():
        np.testing.assert_array_equal(array, getattr(instants, name), err_msg=name)
    assert not heard.rests.all()
    rest_at = heard.rests[np.searchsorted(heard.starts, np.arange(300), side="right") - 1]
    assert not rest_at[onsets].any() and rest_at[[0, 140, 250]].all()


def test_onsets_do_not_count_where_there_are_words():
    some = [("a", 30, 60), ("b", 64, 90)]
    with_onsets = recording(18, 300, spoken=some, onsets=[200, 210])
    np.testing.assert_array_equal(
        extract(with_onsets, gb.config(OFF)).rests, extract(recording(18, 300, spoken=some), gb.config(OFF)).rests
    )
    assert spoken(with_onsets.speech.words, with_onsets.speech.onset_times) == [(1.0, 2.0), (64 / 30, 3.0)]


def test_without_words_and_onsets_all_is_rest():
    found = extract(recording(18, 300, spoken=[]), gb.config(OFF))
    assert found.rests.all() and found.starts[0] == 0 and found.stops[-1] == 300
    assert (found.thresholds == 0).all()

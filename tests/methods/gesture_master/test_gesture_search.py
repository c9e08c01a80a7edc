"""GestureMaster's search: the objective by enumeration, planted clips, pieces, costs, fallbacks, odd input."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gesturegen.frames import ReferenceFrames
from gesturegen.methods.gesture_master import style
from gesturegen.methods.gesture_master.database import build
from gesturegen.methods.gesture_master.search import data_terms, search, segments
from gesturegen.render import render
from gesturegen.speech import rhythm
from gesturegen.speech.cutting import cut
from tests import naive
from tests.builders import SMALL
from tests.methods.gesture_master import gesture_builders as gb

BODIES = ("upper", "lower")
RNG = np.random.default_rng(0)
# Every pair is linked, and costs next to nothing.
LINKED = {body: {"delta_t": 1e6, "lambda_4": 1e-6} for body in BODIES}
FREE_TIME = {"lambda_scale": 0.0, "lambda_outside": 0.0}


def recording(seed, frames, **options):
    return gb.reference(np.random.default_rng(seed), frames, **options)


def talk(seed, frames, **options):
    rng = np.random.default_rng(seed)
    return gb.speech(frames, gb.words(rng, frames), **options)


def find(database, speech, config, earlier=()):
    return search(database, speech, config, np.random.default_rng(0), earlier)


def clips_of(database, track):
    """The numbers of the clips that a track shows; each piece is one clip from end to end."""
    numbers = []
    for piece in track.pieces:
        (k,) = np.flatnonzero(database.starts == piece.nodes[0])
        np.testing.assert_array_equal(piece.nodes, np.arange(database.starts[k], database.stops[k]))
        numbers.append(int(k))
    return numbers


# --- the objective ------------------------------------------------------------------------------------------


def edges_of(database, body):
    indptr, sources, costs = (getattr(database, f"{body}_{key}") for key in ("indptr", "sources", "costs"))
    return {
        (int(sources[e]), q): float(costs[e])
        for q in range(len(database.starts))
        for e in range(indptr[q], indptr[q + 1])
    }


def wanted_styles(speech, cuts, config):
    """By the targets of the settings, the one that shares most with a clip."""
    rows = []
    for start, end in cuts:
        shared = [
            (min(t.to, end / 30) - max(t.from_, start / 30), t) for t in config.gesture_master.style.targets or ()
        ]
        best = max(shared, key=lambda pair: pair[0], default=(0.0, None))
        rows.append((best[1].speed, best[1].radius, best[1].height) if best[0] > 0 else (None, None, None))
    return rows


def plain_terms(database, speech, config, shown=()):
    """The data costs of every segment and clip, by body, one at a time."""
    master, fps = config.gesture_master, speech.fps
    cuts = segments(speech, config)
    wanted = wanted_styles(speech, [(c.start, c.end) for c in cuts], config)
    costs = {body: [[0.0] * len(database.starts) for _ in cuts] for body in BODIES}
    for (i, own), k in itertools.product(enumerate(cuts), range(len(database.starts))):
        bits = [False] * master.rhythm.bits
        for word in speech.words:
            place = (word.start - own.start / fps) / ((own.end - own.start) / fps) * master.rhythm.bits
            if 0 <= math.floor(place + 1e-7) < master.rhythm.bits:
                bits[math.floor(place + 1e-7)] = True
        hamming = sum(one != other for one, other in zip(bits, database.rhythms[k].tolist(), strict=True))
        apart = 0.0
        for value, has, scale in zip(wanted[i], database.styles[k], database.style_scales, strict=True):
            if value is not None and scale > 0:
                apart += ((value - has) / scale) ** 2
        factor = (own.end - own.start) / (database.stops[k] - database.starts[k])
        limits = master.time_scale
        low, high = (limits.rest_min, limits.rest_max) if own.rest else (limits.min, limits.max)
        outside = max(0.0, math.log(factor / high), math.log(low / factor))
        scale_price = limits.lambda_scale * abs(math.log(factor)) + limits.lambda_outside * outside
        for body in BODIES:
            weights = getattr(master, body)
            cost = weights.lambda_3 * (weights.lambda_5 * math.sqrt(apart) + weights.lambda_6 * hamming) + scale_price
            if body == "upper":
                cost += master.lambda_kind * (own.rest != database.rests[k])
                cost += master.lambda_variant * list(shown).count(k)
            costs[body][i][k] = cost
    return costs


def plain_rules(database, body, config):
    weights = getattr(config.gesture_master, body)
    twins = database.twins.tolist()
    return edges_of(database, body), weights.zeta, config.gesture_master.lambda_reuse, twins, weights.lambda_4


TARGETS = st.lists(
    st.fixed_dictionaries({
        "clip": st.just("speech"), "from": st.floats(0, 3), "speed": st.one_of(st.none(), st.floats(0, 300)),
        "height": st.one_of(st.none(), st.floats(-30, 60)),
    }).map(lambda t: t | {"to": t["from"] + 1.5}),
    max_size=2,
)  # fmt: skip


@SMALL
@given(
    seed=st.integers(0, 10_000), mirror=st.booleans(), quantile=st.sampled_from([0.1, 0.5, 0.9]), targets=TARGETS,
    zeta=st.sampled_from([0.0, 3.0, 10_000.0]), reuse=st.sampled_from([0.0, 4.0, 100_000.0]),
    kind=st.sampled_from([0.0, 20.0, 100_000.0]), outside=st.sampled_from([0.0, 30.0, 1e6]),
)  # fmt: skip
def test_the_search_finds_the_least_of_all_sequences(seed, mirror, quantile, targets, zeta, reuse, kind, outside):
    body = {"delta_t": None, "delta_quantile": quantile, "zeta": zeta}
    config = gb.config({
        "mirror": mirror, "upper": body, "lower": body, "lambda_reuse": reuse, "lambda_kind": kind,
        "time_scale": {"lambda_outside": outside}, "style": {"source": "targets", "targets": tuple(targets)},
    })  # fmt: skip
    database = build([recording(seed, 110 if mirror else 190, excluded=[(40, 44)] if seed % 3 == 0 else [])], config)
    speech = talk(seed + 1, 60 + seed % 80)
    n, count = len(segments(speech, config)), len(database.starts)
    assume(count**n <= 7000)
    shown = np.random.default_rng(seed).integers(count, size=2).tolist() if seed % 2 else []
    path = find(database, speech, config, [path_of(database, shown)] if shown else ())
    costs = plain_terms(database, speech, config, shown)
    for name, track in zip(BODIES, path.tracks, strict=False):
        rules = plain_rules(database, name, config)
        chosen = clips_of(database, track)
        total = naive.clips_cost(chosen, costs[name], *rules)
        least = min(naive.clips_cost(c, costs[name], *rules) for c in itertools.product(range(count), repeat=n))
        assert total == pytest.approx(least, rel=1e-9, abs=1e-9)
        assert path.objective[name]["total"] == pytest.approx(total, rel=1e-9, abs=1e-9)
        assert sum(piece.cost for piece in track.pieces) == pytest.approx(total, rel=1e-9, abs=1e-9)


def path_of(database, clips):
    """A path that shows some clips."""
    from gesturegen.path import Path, Piece, Target, Track

    pieces = [
        Piece(Target(k, k + 1, "clip"), np.arange(database.starts[c], database.stops[c]), 0.0)
        for k, c in enumerate(clips)
    ]
    return Path((Track(tuple(pieces)),))


def test_the_enumeration_meets_every_case():
    # Guards the comparison above: random searches do end in repeated clips and twins, missing edges, rests, scales.
    seen = set()
    for seed in range(60):
        linked = {"zeta": 1000.0, "delta_t": 100.0} if seed % 2 else {"zeta": 1.0}
        prices = {"lambda_kind": 2.0, "lambda_reuse": float(seed % 3), "time_scale": {"lambda_outside": 3.0}}
        config = gb.config(prices | {"upper": linked})
        database = build([recording(seed, 110)], config)
        path = find(database, talk(seed + 1, 130), config)
        chosen = clips_of(database, path.tracks[0])
        pairs = list(itertools.pairwise(chosen))
        seen |= {"again" for p, q in pairs if p == q} | {"twin" for p, q in pairs if database.twins[p] == q != p}
        seen |= {piece.fallback for piece in path.tracks[0].pieces} | {
            piece.target.end_kind for piece in path.tracks[0].pieces
        }
    assert seen == {"again", "twin", None, "edge", "kind", "scale", "rest", "clip"}


@gb.FEW
@given(seed=st.integers(0, 10_000), predict=st.booleans())
def test_costs_add_up_to_the_objective(seed, predict):
    config = gb.config({"style": {"source": "predict" if predict else "none"}})
    database = build([recording(seed, 400, voice=seed)], config)
    speech = talk(seed + 1, 200, voice=seed)
    first = find(database, speech, config)
    path = find(database, speech, config, [first])
    terms = data_terms(database, speech, segments(speech, config), config)
    for body, track in zip(BODIES, path.tracks, strict=True):
        summed = dict(path.objective[body])
        total = summed.pop("total")
        assert sum(summed.values()) == pytest.approx(total, rel=1e-9)
        own = getattr(config.gesture_master, body)
        chosen = clips_of(database, track)
        for i, (piece, clip) in enumerate(zip(track.pieces, chosen, strict=True)):
            assert piece.cost == pytest.approx(sum(piece.costs.values()))
            assert set(piece.costs) == set(summed)
            assert piece.costs["style"] == own.lambda_3 * own.lambda_5 * terms["style"][i, clip]
            assert piece.costs["rhythm"] == own.lambda_3 * own.lambda_6 * terms["rhythm"][i, clip]
            assert piece.costs["scale"] == terms["scale"][i, clip]
            if i == 0:
                assert piece.costs["transition"] == piece.costs["reuse"] == 0.0
        for term, value in summed.items():
            assert value == pytest.approx(sum(piece.costs[term] for piece in track.pieces))
    if not predict:
        assert path.objective["upper"]["style"] == 0.0
    # As the paper has it, the lower body follows no speech.
    assert all(path.objective["lower"][term] == 0.0 for term in ("style", "rhythm", "kind", "variant"))


@gb.FEW
@given(seed=st.integers(0, 10_000), frames=st.integers(1, 300))
def test_pieces_cover_the_speech_and_show_one_clip_each(seed, frames):
    config = gb.config()
    database = build([recording(seed, 300)], config)
    speech = talk(seed + 1, frames)
    path = find(database, speech, config)
    settings = config.gesture_master.cutting
    expected = cut([(w.start, w.end) for w in speech.words], frames, 30.0, settings)
    assert len(path.tracks) == 2 and path.failure is None
    for track in path.tracks:
        clips_of(database, track)
        targets = [piece.target for piece in track.pieces]
        assert [(t.start_frame, t.end_frame, t.end_kind) for t in targets] == [
            (c.start, c.end, "rest" if c.rest else "clip") for c in expected
        ]
        assert targets[0].start_frame == 0 and targets[-1].end_frame == frames
    assert path.tracks[0].joints is None and path.tracks[1].joints == gb.LOWER
    again = find(database, speech, config)
    for one, other in zip(path.tracks, again.tracks, strict=True):
        np.testing.assert_array_equal(one.nodes, other.nodes)
    assert path.objective == again.objective


# --- planted clips ------------------------------------------------------------------------------------------


@gb.FEW
@given(seed=st.integers(0, 10_000))
def test_a_clip_of_the_rhythm_of_the_speech_is_found(seed):
    speech = talk(seed, 150)
    plain = gb.config({"time_scale": FREE_TIME, "lambda_reuse": 0.0, "lambda_kind": 0.0} | LINKED)
    recorded = recording(seed + 1, 400)
    database = build([recorded], plain)
    words = [(w.start, w.end) for w in speech.words]
    cuts = segments(speech, plain)
    rng, half = np.random.default_rng(seed), len(database.starts) // 2
    assume(len(cuts) <= half)
    places = rng.choice(half, size=len(cuts), replace=False)
    bits = [rhythm.of_words(words, c.start / 30, c.end / 30, plain.gesture_master.rhythm) for c in cuts]
    corrections = tuple(
        {"clip": "clip", "start": float(database.names[place].split("@")[1]), "bits": rhythm.to_text(own)}
        for place, own in zip(places, bits, strict=True)
    )
    master = {"time_scale": FREE_TIME, "lambda_reuse": 0.0, "lambda_kind": 0.0, "rhythm": {"corrections": corrections}}
    config = gb.config(master | {"upper": LINKED["upper"] | {"lambda_6": 1.0}, "lower": LINKED["lower"]})
    planted = build([recorded], config)
    path = find(planted, speech, config)
    assert path.objective["upper"]["rhythm"] == 0.0
    for clip, own in zip(clips_of(planted, path.tracks[0]), bits, strict=True):
        np.testing.assert_array_equal(planted.rhythms[clip], own)


@gb.FEW
@given(seed=st.integers(0, 10_000))
def test_clips_of_the_wanted_style_are_found(seed):
    speech = talk(seed, 150)
    master = {"time_scale": FREE_TIME, "lambda_reuse": 0.0, "lambda_kind": 0.0}
    recorded = recording(seed + 1, 300)
    database = build([recorded], gb.config(master | LINKED))
    cuts = segments(speech, gb.config())
    places = np.random.default_rng(seed).integers(len(database.starts), size=len(cuts))
    targets = tuple(
        {"clip": "spe*", "from": c.start / 30, "to": c.end / 30}
        | dict(zip(style.VALUES, database.styles[place].tolist(), strict=True))
        for c, place in zip(cuts, places, strict=True)
    )
    upper = LINKED["upper"] | {"lambda_5": 1e6, "lambda_6": 0.0}
    config = gb.config(
        master | {"upper": upper, "lower": LINKED["lower"], "style": {"source": "targets", "targets": targets}}
    )
    path = find(database, speech, config)
    assert clips_of(database, path.tracks[0]) == places.tolist()
    assert path.objective["upper"]["style"] == pytest.approx(0.0, abs=1e-3)
    # Targets of other clips do not count.
    other = find(database, replace(speech, name="another"), config)
    assert other.objective["upper"]["style"] == 0.0


def test_the_predicted_style_is_that_of_the_voice():
    config = gb.config({"style": {"source": "predict"}})
    database = build([recording(1, 600, voice=1)], config)
    slopes = np.random.default_rng(1).normal(size=database.coefficients.shape)
    database = replace(database, coefficients=slopes)
    speech = talk(2, 300, voice=2)
    cuts = segments(speech, config)
    terms = data_terms(database, speech, cuts, config)["style"]
    starts = np.array([word.start for word in speech.words])
    assert any(c.rest for c in cuts) and not all(c.rest for c in cuts)
    for i, own in enumerate(cuts):
        if own.rest:
            assert not terms[i].any()
            continue
        heard = style.features(speech.prosody, starts, own.start / 30, own.end / 30)
        wanted = style.predict(database.regression, heard[None])[0]
        apart = (wanted - database.styles) / database.style_scales
        np.testing.assert_allclose(terms[i], np.sqrt((apart**2).sum(axis=1)), rtol=1e-9)
    assert not data_terms(database, replace(speech, prosody=None), cuts, config)["style"].any()


def test_a_recording_is_found_by_its_own_words():
    # Rhythm by correction, time and transitions speak for the recorded order: nothing costs anything.
    recorded = recording(3, 400)
    config = gb.config({"lambda_reuse": 0.0})
    cuts = cut([(w.start, w.end) for w in recorded.speech.words], 400, 30.0, config.gesture_master.cutting)
    database = build([recorded], config)
    words = [(w.start, w.end) for w in recorded.speech.words]
    signatures = [
        rhythm.of_words(words, a / 30, b / 30, config.gesture_master.rhythm)
        for a, b in zip(database.starts % 400, (database.stops - 1) % 400 + 1, strict=True)
    ]
    database = replace(database, rhythms=np.array(signatures))
    speech = replace(recorded.speech, name="speech")
    path = find(database, speech, config)
    # Long clips are cut elsewhere where there is no motion to look at.
    if [(c.start, c.end) for c in cuts] == list(
        zip(*(v[: len(cuts)].tolist() for v in (database.starts, database.stops)), strict=True)
    ):
        assert path.objective["upper"]["total"] == 0.0
    assert path.objective["upper"]["kind"] == 0.0


# --- fallbacks ----------------------------------------------------------------------------------------------


@gb.FEW
@given(seed=st.integers(0, 10_000))
def test_a_piece_says_what_gave_way(seed):
    rng = np.random.default_rng(seed)
    prices = {"lambda_kind": float(rng.choice([0.0, 1e5])), "upper": {"zeta": float(rng.choice([0.0, 1e4]))}}
    config = gb.config(prices | {"time_scale": {"lambda_outside": float(rng.choice([1.0, 1e6]))}})
    database = build([recording(seed, 200)], config)
    path = find(database, talk(seed + 1, 200), config)
    cuts, limits = segments(talk(seed + 1, 200), config), config.gesture_master.time_scale
    for body, track in zip(BODIES, path.tracks, strict=True):
        edges, before, scaled = edges_of(database, body), None, 0
        for own, piece, clip in zip(cuts, track.pieces, clips_of(database, track), strict=True):
            factor = (own.end - own.start) / len(piece.nodes)
            low, high = (limits.rest_min, limits.rest_max) if own.rest else (limits.min, limits.max)
            expected = None if low <= factor <= high else "scale"
            if before is not None and (before, clip) not in edges:
                expected = "edge"
            if body == "upper" and config.gesture_master.lambda_kind and own.rest != database.rests[clip]:
                expected = "kind"
            assert piece.fallback == expected
            scaled += not low <= factor <= high
            before = clip
        if body == "upper":
            notes = [note for note in path.notes if "scaled in time beyond 0.8 to 1.25 (rests 0.5 to 2)" in note]
            assert [note.split()[0] for note in notes] == ([str(scaled)] if scaled else [])


def test_kinds_do_not_matter_where_they_cost_nothing():
    config = gb.config({"lambda_kind": 0.0})
    database = build([recording(4, 200, spoken=[])], config)
    path = find(database, gb.speech(40, [("a", 0, 40)]), config)
    assert database.rests.all() and "kind" not in [piece.fallback for piece in path.tracks[0].pieces]
    assert "its references have no gesture clip, so rests are shown instead" in path.notes[0]


@pytest.mark.parametrize(("silent", "held"), [(True, "rest"), (False, "gesture")])
def test_references_of_one_kind_are_noted(silent, held):
    config = gb.config()
    reference = recording(5, 200, spoken=[] if silent else [("a", 0, 100), ("b", 101, 200)])
    database = build([reference], config)
    path = find(database, gb.speech(150, [("a", 0, 60), ("b", 120, 150)]), config)
    lacking = "gesture" if silent else "rest"
    assert any(f"have no {lacking} clip, so {held}s are shown instead" in note for note in path.notes)
    for piece in path.tracks[0].pieces:
        assert (piece.fallback == "kind") == ((piece.target.end_kind == "rest") != silent)


# --- odd input ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mirror", [True, False])
def test_a_database_of_one_clip(mirror):
    config = gb.config({"mirror": mirror})
    database = build([recording(6, 40, spoken=[("a", 0, 40)])], config)
    assert len(database.starts) == 1 + mirror
    speech = talk(7, 300)
    path = find(database, speech, config)
    assert sum(piece.target.length for piece in path.tracks[0].pieces) == 300
    # There is nothing else to show, in a row or not.
    reused = [piece.costs["reuse"] for piece in path.tracks[0].pieces]
    assert reused[0] == 0.0 and set(reused[1:]) == {config.gesture_master.lambda_reuse}


def test_a_clip_after_its_own_mirror_image_is_a_repetition_too():
    master = {"lambda_reuse": 5.0, "upper": {"delta_t": 1000.0}, "lower": {"delta_t": 1000.0}}
    config, again = gb.config(master), []
    for seed in range(20):
        database = build([recording(seed, 40, spoken=[("a", 0, 40)])], config)
        path = find(database, talk(7, 200), config)
        for body, track in zip(BODIES, path.tracks, strict=True):
            chosen = clips_of(database, track)
            again += [p != q for p, q in itertools.pairwise(chosen)]
            assert [piece.costs["reuse"] for piece in track.pieces] == [0.0] + [5.0] * (len(chosen) - 1)
            assert sum(piece.cost for piece in track.pieces) == pytest.approx(path.objective[body]["total"])
    assert any(again) and not all(again)


def test_onsets_stand_for_the_words_of_a_speech_without():
    config = gb.config({"time_scale": {"lambda_outside": 10.0}})
    database = build([recording(8, 300)], config)
    onsets = [10, 22, 40, 43, 90, 140]
    heard = find(database, gb.speech(200, onsets=onsets), config)
    instants = find(database, gb.speech(200, [("x", f, f) for f in onsets]), config)
    for one, other in zip(heard.tracks, instants.tracks, strict=True):
        np.testing.assert_array_equal(one.nodes, other.nodes)
    assert (
        heard.notes[0] == "no words, so its onsets and the sound of its voice stand for them"
        and heard.notes[1:] == instants.notes
    )
    assert {piece.target.end_kind for piece in heard.tracks[0].pieces} == {"rest", "clip"}


def test_a_speech_without_words_and_onsets_is_rest():
    config = gb.config()
    database = build([recording(8, 400)], config)
    path = find(database, gb.speech(200), config)
    assert path.notes[0] == "no words, no onsets and no voice, so all of it is rest"
    for piece, clip in zip(path.tracks[0].pieces, clips_of(database, path.tracks[0]), strict=True):
        assert piece.target.end_kind == "rest" and database.rests[clip] and piece.fallback != "kind"


def test_a_speech_without_pauses_is_all_gesture():
    config = gb.config({"time_scale": {"lambda_outside": 10.0}})
    database = build([recording(9, 400)], config)
    path = find(database, gb.speech(200, [("on", f, f + 10) for f in range(0, 200, 10)]), config)
    assert {piece.target.end_kind for piece in path.tracks[0].pieces} == {"clip"}
    assert all(piece.target.length <= 60 for piece in path.tracks[0].pieces)
    assert sum(piece.target.length for piece in path.tracks[0].pieces) == 200
    assert not database.rests[clips_of(database, path.tracks[0])].any()


@pytest.mark.parametrize("frames", [1, 2, 14])
def test_a_speech_shorter_than_a_clip(frames):
    config = gb.config()
    path = find(build([recording(9, 300)], config), gb.speech(frames, [("a", 0, frames)]), config)
    (piece,) = path.tracks[0].pieces
    assert piece.target.length == frames and piece.target.end_kind == "clip"


# --- fingers ------------------------------------------------------------------------------------------------


def test_a_third_track_lends_fingers_where_there_are_none():
    config = gb.config({"quality": {"enabled": False}}, feet={"lock": False})
    references = [recording(10, 200, name="with"), recording(11, 200, name="without", fingers=False)]
    database = build(references, config)
    paths = [find(database, talk(seed, 200), config) for seed in range(8)]
    mixed = 0
    for path in paths:
        shown = clips_of(database, path.tracks[0])
        if (database.finger_sources[shown] == shown).all():
            assert len(path.tracks) == 2
            continue
        mixed += 1
        assert len(path.tracks) == 3 and path.tracks[2].joints == gb.FINGERS
        assert clips_of(database, path.tracks[2]) == database.finger_sources[shown].tolist()
        assert [p.target for p in path.tracks[2].pieces] == [p.target for p in path.tracks[0].pieces]
        moved = render(path, gb.shown(references, database, config), database, config)
        names = list(gb.NAMES)
        alone = render(
            replace(path, tracks=(replace(path.tracks[2], joints=None),)), gb.shown(references, database, config),
            database, config,
        )  # fmt: skip
        for finger in map(names.index, gb.FINGERS):
            np.testing.assert_array_equal(moved.rotations[:, finger], alone.rotations[:, finger])
            # Fingers move in every clip.
            for piece in path.tracks[0].pieces:
                inside = slice(piece.target.start_frame, piece.target.end_frame)
                assert np.ptp(moved.rotations[inside, finger], axis=0).max() > 1e-3
    assert mixed


@pytest.mark.parametrize("transfer", [True, False])
def test_no_third_track_where_no_fingers_can_be_lent(transfer):
    config = gb.config({"finger_transfer": transfer})
    database = build([recording(12, 200, fingers=False)], config)
    assert len(find(database, talk(1, 200), config).tracks) == 2


# --- variants -----------------------------------------------------------------------------------------------


def test_earlier_variants_price_what_they_showed():
    config = gb.config({"lambda_variant": 1000.0, "upper": {"zeta": 1.0}})
    database = build([recording(13, 600)], config)
    speech = talk(14, 200)
    first = find(database, speech, config)
    second = find(database, speech, config, [first])
    third = find(database, speech, config, [first, second])
    shown = [clips_of(database, path.tracks[0]) for path in (first, second, third)]
    assert shown[0] != shown[1] != shown[2] != shown[0]
    for k, path in enumerate((first, second, third)):
        earlier = [clip for own in shown[:k] for clip in own]
        for piece, clip in zip(path.tracks[0].pieces, shown[k], strict=True):
            assert piece.costs["variant"] == 1000.0 * earlier.count(clip)
        assert all(piece.costs["variant"] == 0.0 for piece in path.tracks[1].pieces)
        # Legs do the same in all of them.
        np.testing.assert_array_equal(path.tracks[1].nodes, first.tracks[1].nodes)
    free = gb.config({"lambda_variant": 0.0, "upper": {"zeta": 1.0}})
    np.testing.assert_array_equal(find(database, speech, free, [first]).tracks[0].nodes, first.tracks[0].nodes)


@gb.FEW
@given(seed=st.integers(0, 10_000))
def test_what_is_found_can_be_shown(seed):
    config = gb.config()
    references = [recording(seed, 250, excluded=[(60, 90)])]
    database = build(references, config)
    speech = talk(seed + 1, 120)
    path = find(database, speech, config)
    moved = render(path, gb.shown(references, database, config), database, config)
    assert isinstance(database, ReferenceFrames)
    assert moved.n_frames == 120 and np.isfinite(moved.rotations).all() and np.isfinite(moved.positions).all()

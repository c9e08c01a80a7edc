"""GestureMaster (Zhou et al. 2022): a gesture clip for every clip of the speech, by rhythm, style and transition.

The upper body and the lower one are searched for by themselves, each in its own graph; the renderer joins them at
the pelvis.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesturegen.data.clips import Speech
from gesturegen.data.recordings import is_listed
from gesturegen.methods.gesture_master import style, viterbi
from gesturegen.methods.gesture_master.database import GestureDatabase
from gesturegen.methods.gesture_master.extraction import BODIES
from gesturegen.methods.gesture_master.settings import UpperBody
from gesturegen.path import Path, Piece, Target, Track
from gesturegen.settings.models import Config
from gesturegen.speech import cutting, rhythm
from gesturegen.speech.cutting import Cut, spoken

# What gave way in a piece, from the gravest: a rest for a gesture or the other way round, a transition that is no
# edge, a time scale outside its limits.
_KIND, _EDGE, _SCALE = "kind", "edge", "scale"


def search(
    found: GestureDatabase, speech: Speech, config: Config, _rng: np.random.Generator, earlier: Sequence[Path] = ()
) -> Path:
    """Find the clips with the least sum of data and transition terms (§4.2, equations 2 to 4).

    earlier : other variants of this clip, whose clips cost `lambda_variant` each time they were shown
    """
    settings = config.gesture_master
    cuts = segments(speech, config)
    used = np.zeros(len(found.starts))
    for path in earlier:
        np.add.at(used, np.searchsorted(found.starts, [p.nodes[0] for p in path.tracks[0].pieces]), 1.0)
    terms = data_terms(found, speech, cuts, config)
    tracks, objective = [], {}
    for name in BODIES:
        own: UpperBody = getattr(settings, name)
        upper = name == "upper"
        edges = viterbi.InEdges(*(getattr(found, f"{name}_{key}") for key in ("indptr", "sources", "costs")))
        data = {
            "style": own.lambda_3 * own.lambda_5 * terms["style"],
            "rhythm": own.lambda_3 * own.lambda_6 * terms["rhythm"],
            "scale": terms["scale"],
            # What legs do is no gesture and no rest, and variants differ by gestures.
            "kind": settings.lambda_kind * terms["kind"] * upper,
            "variant": np.broadcast_to(settings.lambda_variant * used * upper, terms["kind"].shape),
        }
        choice, total = viterbi.search(
            np.asarray(sum(data.values())), edges, own.zeta, settings.lambda_reuse, found.twins, own.lambda_4
        )
        pieces = _pieces(choice, cuts, data, edges, own, found, config)
        tracks.append(pieces)
        costs = [piece.costs for piece in pieces if piece.costs is not None]
        summed = {key: float(sum(one[key] for one in costs)) for key in costs[0]}
        objective[name] = summed | {"total": total}
    return Path(
        _tracks(found, tracks[0], tracks[1]), objective=objective, notes=_notes(found, speech, cuts, tracks[0], config)
    )


def segments(speech: Speech, config: Config) -> list[Cut]:
    """Cut a test speech into clips by the rule that cuts the references."""
    words = spoken(speech.words, speech.onset_times, speech.voice)
    return cutting.cut(words, speech.n_frames, speech.fps, config.gesture_master.cutting)


def data_terms(found: GestureDatabase, speech: Speech, cuts: Sequence[Cut], config: Config) -> dict[str, np.ndarray]:
    """Compute what each clip of the database costs in each clip of the speech, by term, float `[shape=(n, G)]`.

    Equation 3 (style, rhythm) without its weights, the price of time-scaling, and whether one is a rest and the
    other a gesture.
    """
    settings = config.gesture_master
    words, fps = spoken(speech.words, speech.onset_times, speech.voice), speech.fps
    signatures = np.array([rhythm.of_words(words, cut.start / fps, cut.end / fps, settings.rhythm) for cut in cuts])
    wanted = _wanted_styles(found, speech, cuts, config)
    rests = np.array([cut.rest for cut in cuts])
    return {
        "style": style.distances(wanted, found.styles, found.style_means, found.style_scales),
        "rhythm": rhythm.hamming(signatures, found.rhythms).astype(np.float64),
        "scale": _scale_prices(cuts, found.lengths, config),
        "kind": (rests[:, None] != found.rests).astype(np.float64),
    }


def _scale_prices(cuts: Sequence[Cut], lengths: np.ndarray, config: Config) -> np.ndarray:
    misfit, outside = _scales(cuts, lengths, config)
    settings = config.gesture_master.time_scale
    return settings.lambda_scale * np.abs(misfit) + settings.lambda_outside * outside


def _scales(cuts: Sequence[Cut], lengths: np.ndarray, config: Config) -> tuple[np.ndarray, np.ndarray]:
    """Compute the logarithm of each clip's time scale in each segment, and how far it is outside the limits."""
    settings = config.gesture_master.time_scale
    wanted = np.array([cut.end - cut.start for cut in cuts], dtype=np.float64)
    rests = np.array([cut.rest for cut in cuts])[:, None]
    misfit = np.log(wanted[:, None] / lengths)
    low = np.log(np.where(rests, settings.rest_min, settings.min))
    high = np.log(np.where(rests, settings.rest_max, settings.max))
    return misfit, np.maximum(np.maximum(misfit - high, low - misfit), 0.0)


def _wanted_styles(found: GestureDatabase, speech: Speech, cuts: Sequence[Cut], config: Config) -> np.ndarray:
    """Determine the style of each clip of the speech `[shape=(n, 3)]`, NaN where any will do, as in silence."""
    settings, fps = config.gesture_master.style, speech.fps
    wanted = np.full((len(cuts), len(style.VALUES)), np.nan)
    if settings.source == "predict" and speech.prosody is not None:
        starts = np.array([word.start for word in speech.words])
        features = [style.features(speech.prosody, starts, cut.start / fps, cut.end / fps) for cut in cuts]
        wanted = style.predict(found.regression, np.array(features))
        wanted[[cut.rest for cut in cuts]] = np.nan
    if settings.source == "targets":
        own = [target for target in settings.targets or () if is_listed(speech.name, (target.clip,))]
        for row, cut in zip(wanted, cuts, strict=True):
            shared = [min(t.to, cut.end / fps) - max(t.from_, cut.start / fps) for t in own]
            if own and max(shared) > 0:
                target = own[int(np.argmax(shared))]
                row[:] = [np.nan if value is None else value for value in (target.speed, target.radius, target.height)]
    return wanted


def _pieces(
    choice: np.ndarray, cuts: Sequence[Cut], data: dict[str, np.ndarray], edges: viterbi.InEdges, own: UpperBody,
    found: GestureDatabase, config: Config,
) -> tuple[Piece, ...]:  # fmt: skip
    settings = config.gesture_master
    _, outside = _scales(cuts, found.lengths, config)
    pieces = []
    for k, (cut, clip) in enumerate(zip(cuts, choice.tolist(), strict=True)):
        costs = {term: float(values[k, clip]) for term, values in data.items()} | {"transition": 0.0, "reuse": 0.0}
        fallback = _SCALE if outside[k, clip] > 0 else None
        if k:
            before = int(choice[k - 1])
            cost = viterbi.edge_cost(edges, before, clip)
            fallback = _EDGE if cost is None else fallback
            costs["transition"] = own.lambda_4 * (own.zeta if cost is None else cost)
            costs["reuse"] = settings.lambda_reuse * float(clip in (before, found.twins[before]))
        if costs["kind"]:
            fallback = _KIND
        target = Target(cut.start, cut.end, "rest" if cut.rest else "clip")
        nodes = np.arange(found.starts[clip], found.stops[clip])
        pieces.append(Piece(target, nodes, sum(costs.values()), fallback=fallback, costs=costs))
    return tuple(pieces)


def _tracks(found: GestureDatabase, upper: tuple[Piece, ...], lower: tuple[Piece, ...]) -> tuple[Track, ...]:
    """Build the tracks, the upper body first, of which the trace tells; fingers of other clips get their own."""
    tracks = (Track(upper), Track(lower, tuple(map(str, found.lower_names))))
    shown = np.searchsorted(found.starts, [piece.nodes[0] for piece in upper])
    sources = found.finger_sources[shown]
    if (sources == shown).all() or not len(found.finger_names):
        return tracks
    lent = tuple(
        Piece(piece.target, np.arange(found.starts[source], found.stops[source]), 0.0)
        for piece, source in zip(upper, sources, strict=True)
    )
    return (*tracks, Track(lent, tuple(map(str, found.finger_names))))


def _notes(
    found: GestureDatabase, speech: Speech, cuts: Sequence[Cut], pieces: Sequence[Piece], config: Config
) -> tuple[str, ...]:
    """List what a user should know of a clip beyond its figures."""
    notes = []
    heard = len(speech.onset_times) or (speech.voice is not None and len(speech.voice))
    if not speech.words and heard:
        notes.append("no words, so its onsets and the sound of its voice stand for them")
    elif not speech.words:
        notes.append("no words, no onsets and no voice, so all of it is rest")
    kinds = {"rest": any(cut.rest for cut in cuts), "gesture": any(not cut.rest for cut in cuts)}
    held = {"rest": bool(found.rests.any()), "gesture": bool((~found.rests).any())}
    for kind, other in (("rest", "gestures"), ("gesture", "rests")):
        if kinds[kind] and not held[kind]:
            notes.append(f"its references have no {kind} clip, so {other} are shown instead; give longer references")
    _, outside = _scales(cuts, np.array([len(piece.nodes) for piece in pieces]), config)
    stretched = int(np.count_nonzero(np.diag(outside)))
    if stretched:
        limits = config.gesture_master.time_scale
        notes.append(
            f"{stretched} of {len(pieces)} clips are scaled in time beyond {limits.min:g} to {limits.max:g} (rests "
            f"{limits.rest_min:g} to {limits.rest_max:g}); give longer references"
        )
    return tuple(notes)

"""The gesture database: clips of all references as the nodes of two motion graphs, and its file (§4.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gesturegen import frames as reference_frames
from gesturegen.data.clips import Reference
from gesturegen.data.keynodes import KeyNodes
from gesturegen.errors import DataError
from gesturegen.frames import ReferenceFrames, describe, join, one_skeleton, require_one_skeleton
from gesturegen.methods.gesture_master import fingers, style, transitions
from gesturegen.methods.gesture_master.extraction import BODIES, Gestures, as_borders, extract
from gesturegen.methods.gesture_master.settings import UpperBody
from gesturegen.motion.skeleton import Skeleton
from gesturegen.randomness import generator
from gesturegen.settings.models import Config
from gesturegen.speech import cutting
from gesturegen.stored import arrays as stored_arrays
from gesturegen.stored.arrays import Array, Kind

FORMAT_VERSION = 3


@dataclass(frozen=True, eq=False)
class GestureDatabase(ReferenceFrames):
    """A gesture database, whose clips are stretches of nodes; the second half of the references may be mirrored.

    mirrored : bool [shape=(C,)], which reference clips are mirrored copies
    starts, stops : int [shape=(G,)], nodes [start, stop) of the gesture clips; names : str [shape=(G,)]
    rests : bool [shape=(G,)]; rhythms : bool [shape=(G, bits)]
    styles : float [shape=(G, 3)], mean hand speed (cm/s), radius and height (cm); style_means, style_scales : of
        those that are no rests, float [shape=(3,)]
    twins : int [shape=(G,)], the mirrored copy of each, itself without one
    finger_sources : int [shape=(G,)], the clip whose fingers it shows, itself where it has its own
    edges below delta_T, by the clip they lead to: `<body>_indptr` int [shape=(G + 1,)], `<body>_sources` int32
        [shape=(E,)], ascending, and `<body>_costs` float32 [shape=(E,)] for the upper and the lower body
    deltas : float [shape=(2,)], delta_T of both
    feature_means, feature_scales, coefficients, intercepts, r2, n_fitted : the regression of style on prosody
        (`style.Regression`); without one all it says is NaN, of which no style is wanted
    upper_names, lower_names, finger_names : str, joints of the skeleton
    dropped : names of clips left out, and why, str [shape=(K, 2)]
    notes : str, what a user should know of the references
    thresholds : float [shape=(K, 2)], number and mean seconds of clips by gap threshold (`cutting.THRESHOLDS`)
    """

    mirrored: np.ndarray
    starts: np.ndarray
    stops: np.ndarray
    names: np.ndarray
    rests: np.ndarray
    rhythms: np.ndarray
    styles: np.ndarray
    style_means: np.ndarray
    style_scales: np.ndarray
    twins: np.ndarray
    finger_sources: np.ndarray
    upper_indptr: np.ndarray
    upper_sources: np.ndarray
    upper_costs: np.ndarray
    lower_indptr: np.ndarray
    lower_sources: np.ndarray
    lower_costs: np.ndarray
    deltas: np.ndarray
    feature_means: np.ndarray
    feature_scales: np.ndarray
    coefficients: np.ndarray
    intercepts: np.ndarray
    r2: np.ndarray
    n_fitted: np.ndarray
    upper_names: np.ndarray
    lower_names: np.ndarray
    finger_names: np.ndarray
    dropped: np.ndarray
    thresholds: np.ndarray
    notes: np.ndarray

    @property
    def clips(self) -> tuple[tuple[str, bool], ...]:
        return tuple(zip(self.clip_names, self.mirrored.tolist(), strict=True))

    @property
    def lengths(self) -> np.ndarray:
        """Count the frames of each gesture clip `[shape=(G,)]`."""
        return self.stops - self.starts

    @property
    def n_unnatural_edges(self) -> int:
        """Count the upper-body edges between clips that were not recorded one after the other."""
        destinations = np.repeat(np.arange(len(self.starts)), np.diff(self.upper_indptr))
        return int(np.count_nonzero(self.starts[destinations] != self.stops[self.upper_sources]))

    def clip_name_of(self, nodes: Sequence[int]) -> str | None:
        """Name the gesture clip of exactly these nodes; a mirrored copy has the name of its recording's clip."""
        clip = int(np.searchsorted(self.starts, nodes[0], side="right") - 1)
        whole = clip >= 0 and nodes[0] == self.starts[clip] and nodes[-1] == self.stops[clip] - 1
        return str(self.names[clip]) if whole else None

    @property
    def regression(self) -> style.Regression:
        """Return the regression of style on prosody that is stored in the database."""
        return style.Regression(
            self.feature_means, self.feature_scales, self.coefficients, self.intercepts, self.r2, int(self.n_fitted)
        )


def assemble(parts: Sequence[Gestures], described: dict, edges: dict[str, Edges], config: Config) -> GestureDatabase:
    """Assemble one database from the clips of all recordings.

    described : the fields of `ReferenceFrames` but for positions, of the recordings without mirrored copies
    edges : of both bodies, as `link` finds them over `all_borders`
    """
    settings = config.gesture_master
    copies = 2 if settings.mirror else 1
    first_nodes, n_nodes = described["clip_starts"], len(described["source_frames"])
    counts = [len(part.starts) for part in parts]
    own = np.arange(sum(counts))
    rests = _by_copy(parts, lambda part, _copy: part.rests)
    styles = _by_copy(parts, lambda part, copy: part.styles[copy])
    offsets = np.repeat(first_nodes, counts)
    starts = np.concatenate([part.starts for part in parts]) + offsets
    stops = np.concatenate([part.stops for part in parts]) + offsets
    gestures = ~rests if (~rests).any() else np.ones(len(rests), dtype=bool)
    if len(rests) == 0:
        raise DataError(_nothing_left(parts))
    regression = _regression(parts, counts, config)
    return GestureDatabase(
        positions=np.concatenate([part.positions[copy] for copy in range(copies) for part in parts]),
        **_repeated(described, copies, n_nodes),
        mirrored=np.repeat([False, True][:copies], len(parts)),
        starts=np.concatenate([starts + copy * n_nodes for copy in range(copies)]),
        stops=np.concatenate([stops + copy * n_nodes for copy in range(copies)]),
        names=_by_copy(parts, lambda part, _copy: part.names),
        rests=rests,
        rhythms=_by_copy(parts, lambda part, _copy: part.rhythms),
        styles=styles,
        style_means=styles[gestures].mean(axis=0),
        style_scales=styles[gestures].std(axis=0),
        twins=np.concatenate([own + len(own), own]) if copies == 2 else own,
        finger_sources=_finger_sources(parts, counts, copies) if settings.finger_transfer else np.arange(len(rests)),
        **{f"{body}_{key}": getattr(edges[body], key) for body in BODIES for key in ("indptr", "sources", "costs")},
        deltas=np.array([edges[body].delta for body in BODIES]),
        feature_means=regression.feature_means,
        feature_scales=regression.feature_scales,
        coefficients=regression.coefficients,
        intercepts=regression.intercepts,
        r2=regression.r2,
        n_fitted=np.array(regression.n_clips),
        **{name: getattr(parts[0], name) for name in ("upper_names", "lower_names", "finger_names")},
        dropped=np.concatenate([part.dropped for part in parts]),
        thresholds=_mean_lengths(np.asarray(sum(part.thresholds for part in parts))),
        notes=np.array(list(dict.fromkeys(note for part in parts for note in part.notes.tolist())), dtype=str),
    )


def _nothing_left(parts: Sequence[Gestures]) -> str:
    dropped = [f"{name}: {reason}" for part in parts for name, reason in part.dropped.tolist()]
    return (
        f"no gesture clip is left of {len(parts)} references ({len(dropped)} were dropped, the first: {dropped[0]}); "
        "give longer references, or change gesture_master.quality"
    )


def _by_copy(parts: Sequence[Gestures], of: Callable[[Gestures, int], np.ndarray]) -> np.ndarray:
    """Stack the rows of all clips: those of all recordings, then, where there are any, their mirrored copies."""
    copies = len(parts[0].positions)
    return np.concatenate([of(part, copy) for copy in range(copies) for part in parts])


def _repeated(described: dict, copies: int, n_nodes: int) -> dict:
    """Repeat the description of the recordings for their mirrored copies."""
    if copies == 1:
        return described
    key_nodes = described["key_nodes"]
    return described | {
        "clip_names": described["clip_names"] * 2,
        **{
            name: np.concatenate([described[name], described[name] + n_nodes])
            for name in ("clip_starts", "segment_starts")
        },
        **{name: np.tile(described[name], 2) for name in ("source_frames", "speaking")},
        "key_nodes": KeyNodes(
            np.concatenate([key_nodes.frames, key_nodes.frames + n_nodes]),
            np.tile(key_nodes.kinds, 2),
            np.tile(key_nodes.keywords, 2),
        ),
    }


def _mean_lengths(sums: np.ndarray) -> np.ndarray:
    """Convert counts and total seconds to counts and mean seconds; NaN where there is no clip."""
    with np.errstate(invalid="ignore"):
        return np.column_stack([sums[:, 0], sums[:, 1] / sums[:, 0]])


def _regression(parts: Sequence[Gestures], counts: Sequence[int], config: Config) -> style.Regression:
    """Fit the style regression to the gestures as recorded: no voice made their mirrored copies."""
    gestures = np.concatenate([~part.rests for part in parts])
    if config.gesture_master.style.source != "predict" or not gestures.any():
        n_features, n_values = len(style.FEATURES), len(style.VALUES)
        return style.Regression(
            np.zeros(n_features), np.ones(n_features), np.zeros((n_features, n_values)), np.full(n_values, np.nan),
            np.full(n_values, np.nan), 0,
        )  # fmt: skip
    return style.fit(
        np.concatenate([part.features for part in parts])[gestures],
        np.concatenate([part.styles[0] for part in parts])[gestures],
        np.repeat(np.arange(len(parts)), counts)[gestures],
        config.gesture_master.style,
    )


def _finger_sources(parts: Sequence[Gestures], counts: Sequence[int], copies: int) -> np.ndarray:
    """Find for clips without finger motion the nearest clip with it, by position; in mirrored copies too."""
    sources = np.arange(sum(counts) * copies)
    has = np.tile(np.repeat([bool(part.has_fingers) for part in parts], counts), copies)
    if has.any() and not has.all():
        poses = _by_copy(parts, lambda part, copy: part.poses[copy])
        offered = np.flatnonzero(has)
        nearest, _ = fingers.nearest(poses[~has], poses[offered])
        sources[~has] = offered[nearest]
    return sources


# --- edges --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges of one body, by the clip they lead to (`GestureDatabase`); delta : delta_T."""

    indptr: np.ndarray
    sources: np.ndarray
    costs: np.ndarray
    delta: float


def all_borders(
    parts: Sequence[Gestures], body: str, config: Config
) -> tuple[transitions.Borders, transitions.Borders]:
    """Collect the transitional frames at the ends and at the starts of all clips, mirrored copies last."""
    joints = getattr(parts[0], f"{body}_joints")
    ends, starts = (
        as_borders(
            _by_copy(parts, lambda part, copy: getattr(part, f"{body}_{side}")[copy]),  # noqa: B023
            joints,
            config.gesture_master.transition_frames,
        )
        for side in ("ends", "starts")
    )
    return ends, starts


def threshold(borders: tuple[transitions.Borders, transitions.Borders], body: str, config: Config) -> float:
    """Compute delta_T of one body, as given or as a quantile of the database's own transition costs."""
    settings: UpperBody = getattr(config.gesture_master, body)
    if settings.delta_t is not None:
        return settings.delta_t
    if len(borders[0]) < 2:  # no transition between different clips
        return 0.0
    assert settings.delta_quantile is not None  # the settings are refused without either
    # Not by the run's seed: a graph is the same for all of them.
    rng = generator(0, f"delta_T of the {body} body")
    return transitions.quantile(*borders, settings.delta_quantile, settings.lambda_1, settings.lambda_2, rng)


def link(
    borders: tuple[transitions.Borders, transitions.Borders], body: str, delta: float, config: Config,
    first: int = 0, last: int | None = None,
) -> Edges:  # fmt: skip
    """Find the edges below `delta` that lead to clips `first` to before `last`, by default all of them."""
    settings: UpperBody = getattr(config.gesture_master, body)
    last = len(borders[1].positions) if last is None else last
    counts, sources, costs = transitions.edges(*borders, first, last, settings.lambda_1, settings.lambda_2, delta)
    return Edges(np.append(0, np.cumsum(counts)), sources, costs, delta)


@dataclass(frozen=True, eq=False)
class Part:
    """The part of a database from one recording: its gesture clips, `frames.describe` and its skeleton."""

    gestures: Gestures
    described: dict
    skeleton: Skeleton


def part(reference: Reference, config: Config) -> Part:
    """Extract the gesture clips of a reference and its mirrored copy; DataError when it cannot be mirrored."""
    return Part(extract(reference, config), describe(reference, config), reference.motion.skeleton)


def of_parts(parts: Sequence[Part], config: Config) -> GestureDatabase:
    """Build the database of several recordings, edges and all; DataError when skeletons differ or no clip is left."""
    one_skeleton([(one.described["clip_names"][0], one.skeleton) for one in parts], config)
    gestures, edges = [one.gestures for one in parts], {}
    for body in BODIES:
        borders = all_borders(gestures, body, config)
        edges[body] = link(borders, body, threshold(borders, body, config), config)
    return assemble(gestures, join([one.described for one in parts]), edges, config)


def build(references: Sequence[Reference], config: Config) -> GestureDatabase:
    """Build the database of one or several references; DataErrors as by `part` and `of_parts` (§3, §4.1)."""
    require_one_skeleton(references, config)
    return of_parts([part(reference, config) for reference in references], config)


# --- files --------------------------------------------------------------------------------------------------


def unfit_clips(stored: Mapping[str, np.ndarray]) -> str | None:
    """Say what is wrong with the gesture clips of a file; None when they lie within segments."""
    starts, stops = stored["starts"], stored["stops"]
    places = (np.searchsorted(stored["segment_starts"], nodes, side="right") for nodes in (starts, stops - 1))
    if not (starts < stops).all() or np.subtract(*places).any():
        return "stops do not end the gesture clips within their segments"
    return None


def _unfit(stored: Mapping[str, np.ndarray]) -> str | None:
    """Say what is wrong between the arrays of a database, each valid by itself; None when nothing is."""
    return reference_frames.unfit(stored) or unfit_clips(stored)


def _edge_arrays(body: str) -> dict[str, Array]:
    return {
        f"{body}_indptr": Array("i8", "G+1", stored_arrays.pointers(f"{body}_edges")),
        f"{body}_sources": Array("i4", f"{body}_edges", stored_arrays.below("G")),
        f"{body}_costs": Array("f4", f"{body}_edges"),
    }


# What a database and the part of one recording share, of G gesture clips.
CLIP_ARRAYS = {
    "starts": Array("i8", "G", stored_arrays.below("N")),
    "stops": Array("i8", "G", stored_arrays.up_to("N")),
    "names": Array("str", "G"),
    "rests": Array("bool", "G"),
    "rhythms": Array("bool", "G bits"),
    "upper_names": Array("str", "upper_joints"),
    "lower_names": Array("str", "lower_joints"),
    "finger_names": Array("str", "fingers"),
    "dropped": Array("str", "dropped 2"),
    "thresholds": Array("f8", f"{len(cutting.THRESHOLDS)} 2", stored_arrays.finite_or_nan),
    "notes": Array("str", "notes"),
}
_VALUES = len(style.VALUES)
KIND = Kind(
    "gesture database", "build-graph",
    reference_frames.ARRAYS | CLIP_ARRAYS | {
        "mirrored": Array("bool", "C"),
        "styles": Array("f8", f"G {_VALUES}"),
        "style_means": Array("f8", f"{_VALUES}"),
        "style_scales": Array("f8", f"{_VALUES}", stored_arrays.not_negative),
        "twins": Array("i8", "G", stored_arrays.below("G")),
        "finger_sources": Array("i8", "G", stored_arrays.below("G")),
        **_edge_arrays("upper"),
        **_edge_arrays("lower"),
        "deltas": Array("f8", f"{len(BODIES)}", stored_arrays.not_negative),
        "feature_means": Array("f8", f"{len(style.FEATURES)}"),
        "feature_scales": Array("f8", f"{len(style.FEATURES)}", stored_arrays.not_negative),
        "coefficients": Array("f8", f"{len(style.FEATURES)} {_VALUES}", stored_arrays.any_size_or_nan),
        "intercepts": Array("f8", f"{_VALUES}", stored_arrays.any_size_or_nan),
        "r2": Array("f8", f"{_VALUES}", stored_arrays.any_size_or_nan),
        "n_fitted": Array("i8", "", stored_arrays.not_negative),
    },
    FORMAT_VERSION, _unfit,
)  # fmt: skip

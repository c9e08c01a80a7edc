"""Conditions on the hands in the frames of one clip: what they demand, which nodes meet them, what was achieved.

Hard conditions limit the search to the reference frames that meet them, as the control mask of Habibie et al.
2022 (§3.1.3) does; soft ones have a price.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from gesturegen.control.measures import UNITS
from gesturegen.data.recordings import is_listed, is_named
from gesturegen.errors import DataError
from gesturegen.settings.control import Condition, Control, bound_text, resolve_bound, shared_time, time_text

Measures = Mapping[tuple[str, str], np.ndarray]

# Seconds by which a condition may reach past the end of the clip that it names.
_GRACE = 0.5
# A time at exactly the end lies there, whatever its rounding.
_SLACK = 1e-6
# A spread below this share of the size of the values is rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Demand:
    """A condition on the hands, resolved to the frames of one clip.

    place : its number among the conditions, from 1
    low, high : what the measure is to be, in cm or cm/s; -inf and inf where it does not matter
    start_frame, end_frame : the half-open range of frames in which it holds, at least one
    price : of a violation by `scale` in one frame, for a soft demand
    scale : standard deviation of the measure in the references; 1 where it does not vary
    """

    place: int
    measure: str
    hand: str
    low: float
    high: float
    start_frame: int
    end_frame: int
    hard: bool
    price: float
    scale: float

    @property
    def key(self) -> tuple[str, str]:
        """The measure and the hand, as `hand_measures` calls them."""
        return self.measure, self.hand


# --- from conditions to demands -----------------------------------------------------------------------------


def demands(control: Control, clip_name: str, n_frames: int, fps: float, values: Measures) -> tuple[Demand, ...]:
    """Resolve the conditions that concern a clip, in the order of the file.

    n_frames : of the speech that is to be gestured
    values : each measure in the N nodes of the references, float [shape=(N,)]
    Ranges are clipped to the clip; a condition that matches it by a glob only and starts past its end is left
    out. Raises DataError with one line for each condition that does not fit the clip or that no node meets, and
    for those that contradict one another.
    """
    duration = n_frames / fps
    found: list[Demand] = []
    inside: list[tuple[int, Condition]] = []
    problems: list[str] = []
    for place, condition in enumerate(control.conditions, 1):
        if not is_listed(clip_name, (condition.clip,)):
            continue
        past = _past_the_end(condition, clip_name, duration)
        if past is None:
            inside.append((place, condition))
            demand = _demand(place, condition, n_frames, fps, values)
            mistake = _impossible(demand, condition, values[demand.key])
            if mistake is None:
                found.append(demand)
            else:
                problems.append(f"condition {place}: {mistake}")
        elif names_one_clip(condition.clip, clip_name):
            problems.append(f"condition {place}: {past}")
    # Bounds of one measure that overlap may well contradict each other, and one line says enough.
    overlaps = _overlaps(inside)
    problems += overlaps or _contradictions(found, values, fps)
    if problems:
        raise DataError("\n".join(f"clip {clip_name}: {problem}" for problem in problems))
    return tuple(found)


def names_one_clip(pattern: str, clip_name: str) -> bool:
    """Tell whether a pattern is the name of the clip, so that a condition which does not fit the clip is a mistake."""
    return is_named(clip_name, pattern)


def _past_the_end(condition: Condition, clip_name: str, duration: float) -> str | None:
    """Describe how the times of a condition pass the end of the clip; a glob may end past it, but not start there."""
    if condition.from_ >= duration - _SLACK:
        return f"starts at {condition.from_:g} s, the clip ends at {duration:.2f} s"
    too_long = condition.to is not None and condition.to > duration + _GRACE + _SLACK
    if too_long and names_one_clip(condition.clip, clip_name):
        return f"ends at {condition.to:g} s, the clip at {duration:.2f} s; leave out `to` for the end of the clip"
    return None


def _demand(place: int, condition: Condition, n_frames: int, fps: float, values: Measures) -> Demand:
    """Resolve one condition to the frames of the clip and to numbers."""
    measured = _measured(values, (condition.measure, condition.hand))
    # A short range holds in one frame at least, and the last one of the clip is within it.
    start = min(round(condition.from_ * fps), n_frames - 1)
    end = n_frames if condition.to is None else min(max(round(condition.to * fps), start + 1), n_frames)
    spread = float(measured.std())
    return Demand(
        place=place,
        measure=condition.measure,
        hand=condition.hand,
        low=resolve_bound(condition.at_least, -math.inf, lambda share: np.quantile(measured, share)),
        high=resolve_bound(condition.at_most, math.inf, lambda share: np.quantile(measured, share)),
        start_frame=start,
        end_frame=end,
        hard=condition.hard,
        price=1.0 if condition.price is None else condition.price,
        scale=spread if spread > _ROUNDING * np.abs(measured).max() else 1.0,
    )


def _impossible(demand: Demand, condition: Condition, measured: np.ndarray) -> str | None:
    """Explain why a demand can never be met; None where it can, or where it is soft and has bounds in order."""
    unit = UNITS[demand.measure]
    texts = []
    for what, bound, number in (
        ("at least", condition.at_least, demand.low),
        ("at most", condition.at_most, demand.high),
    ):
        if bound is not None:
            resolved = f" ({number:.4g} {unit})" if isinstance(bound, str) else f" {unit}"
            texts.append(f"{what} {bound_text(bound)}{resolved}")
    asked = f"{_subject(demand)} of {' and '.join(texts)}"
    if demand.low > demand.high:
        return f"asks for {asked}, which no value is; exchange or change the bounds"
    if not demand.hard or satisfied((demand,), {demand.key: measured}).any():
        return None
    outside = violations((demand,), {demand.key: measured})[0]
    nearest = float(measured[outside.argmin()])
    # Rounded so that what the message says can be asked for.
    tenths = nearest * 10
    nearest = math.floor(tenths + _SLACK) / 10 if nearest < demand.low else math.ceil(tenths - _SLACK) / 10
    return (
        f"no frame of the references has {asked}; the nearest has {nearest:g} {unit}; ask for that, or set hard: false"
    )


def _subject(demand: Demand) -> str:
    """Name what a demand is about, such as `height (left)`."""
    return demand.measure if demand.measure == "symmetry" else f"{demand.measure} ({demand.hand})"


def _overlaps(conditions: list[tuple[int, Condition]]) -> list[str]:
    """Describe conditions on the same measure of the same hand at the same time, one line for each two."""
    problems = []
    for (first, one), (second, other) in itertools.combinations(conditions, 2):
        time = shared_time(one, other)
        if (one.measure, one.hand) == (other.measure, other.hand) and time:
            problems.append(
                f"conditions {first} ({one.clip}) and {second} ({other.clip}) overlap {time_text(*time)}; "
                "let one of them concern this clip, or give times apart"
            )
    return problems


def _contradictions(found: list[Demand], values: Measures, fps: float) -> list[str]:
    """Describe the smallest sets of hard demands that no node meets together, one line for each set."""
    hard = [demand for demand in found if demand.hard]
    met = satisfied(hard, values)
    problems = {}
    for together in states(hard, max((demand.end_frame for demand in hard), default=0))[1]:
        if not together or met[list(together)].all(axis=0).any():
            continue
        smallest = list(together)
        for member in together:
            rest = [other for other in smallest if other != member]
            if not met[rest].all(axis=0).any():
                smallest = rest
        places = [str(hard[member].place) for member in smallest]
        start = max(hard[member].start_frame for member in smallest) / fps
        problems[tuple(smallest)] = (
            f"no frame of the references meets conditions {', '.join(places[:-1])} and {places[-1]} together, "
            f"as they ask from {start:.2f} s on; ask for less, or set hard: false"
        )
    return list(problems.values())


# --- what nodes are worth -----------------------------------------------------------------------------------


def satisfied(demands: Sequence[Demand], values: Measures) -> np.ndarray:
    """Tell which nodes meet which of D demands, bool `[shape=(D, N)]`.

    values : float [shape=(N,)] for each measure
    """
    rows = [_measured(values, demand.key) for demand in demands]
    met = [(row >= demand.low) & (row <= demand.high) for demand, row in zip(demands, rows, strict=True)]
    return _stacked(met, values, bool)


def violations(demands: Sequence[Demand], values: Measures) -> np.ndarray:
    """Compute how far nodes lie outside the bounds of D demands.

    Returns float `[shape=(D, N)]`, standard deviations; 0 inside the bounds.
    """
    rows = [_measured(values, demand.key) for demand in demands]
    outside = [
        np.maximum(np.maximum(demand.low - row, row - demand.high), 0.0) / demand.scale
        for demand, row in zip(demands, rows, strict=True)
    ]
    return _stacked(outside, values, np.float64)


def _measured(values: Measures, key: tuple[str, str]) -> np.ndarray:
    """Return the values of a measure in double precision."""
    # In single precision, what lies just outside a bound would be inside.
    return np.asarray(values[key], dtype=np.float64)


def _stacked(rows: list[np.ndarray], values: Measures, dtype: type) -> np.ndarray:
    """Stack rows to an array `[shape=(D, N)]`, also where there is no row."""
    if rows:
        return np.stack(rows)
    return np.zeros((0, len(next(iter(values.values()), ()))), dtype=dtype)


def states(demands: Sequence[Demand], n_frames: int) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """Tell which demands hold in which frames: the state of each frame, int `[shape=(n_frames,)]`, and the S states.

    A state is the tuple of the demands, by their index, that hold together. State 0 is that of none, whether or
    not any frame has it; the others come in order of their first frame.
    """
    numbers: dict[tuple[int, ...], int] = {(): 0}
    of_frame = np.zeros(n_frames, dtype=np.int64)
    edges = {0, n_frames, *(frame for demand in demands for frame in (demand.start_frame, demand.end_frame))}
    for start, end in itertools.pairwise(sorted(edge for edge in edges if edge <= n_frames)):
        active = tuple(n for n, demand in enumerate(demands) if demand.start_frame <= start < demand.end_frame)
        of_frame[start:end] = numbers.setdefault(active, len(numbers))
    return of_frame, list(numbers)


def frame_prices(
    sets: Sequence[tuple[int, ...]], demands: Sequence[Demand], values: Measures, forbidden: float
) -> np.ndarray:
    """Compute the price of showing each of N nodes in a frame of each of S states, float `[shape=(S, N)]`.

        price = sum over soft demands of price * violation + forbidden * number of violated hard demands

    sets : the states, as `states` gives them
    """
    soft, met = violations(demands, values), satisfied(demands, values)
    # Chosen, not multiplied: `forbidden` may be infinite.
    prices = [
        np.where(met[n], 0.0, forbidden) if demand.hard else demand.price * soft[n] for n, demand in enumerate(demands)
    ]
    rows = _stacked(prices, values, np.float64)
    return np.stack([rows[list(members)].sum(axis=0) for members in sets])


# --- what was achieved --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Achieved:
    """Figures of how well an output meets a demand: the columns of the paper's table 2, and figures of the references.

    at_least, at_most : what was asked for, -inf and inf where nothing was
    mean, deviation : of the measure over the frames of the demand, in cm or cm/s
    inside : share of these frames that meet the demand, 0 to 1
    reference_mean, reference_deviation : of the measure over all nodes of the references
    """

    place: int
    measure: str
    hand: str
    hard: bool
    start_frame: int
    end_frame: int
    at_least: float
    at_most: float
    mean: float
    deviation: float
    inside: float
    reference_mean: float
    reference_deviation: float

    def row(self) -> dict:
        """Return the figures as JSON can hold them: None for a bound that was not asked for."""
        return {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in asdict(self).items()
        }


def achieved(demands: Sequence[Demand], values_of_output: Measures, values_of_reference: Measures) -> list[Achieved]:
    """Measure what an output achieves of each demand.

    values_of_output : each measure in the T frames of the output, float [shape=(T,)]
    values_of_reference : each measure in the N nodes of the references, float [shape=(N,)]
    Raises ValueError for an output that ends before a demand does.
    """
    rows = []
    for demand in demands:
        whole, recorded = _measured(values_of_output, demand.key), _measured(values_of_reference, demand.key)
        if len(whole) < demand.end_frame:
            raise ValueError(f"the output has {len(whole)} frames, a demand holds until frame {demand.end_frame}")
        shown = whole[demand.start_frame : demand.end_frame]
        rows.append(
            Achieved(
                place=demand.place,
                measure=demand.measure,
                hand=demand.hand,
                hard=demand.hard,
                start_frame=demand.start_frame,
                end_frame=demand.end_frame,
                at_least=demand.low,
                at_most=demand.high,
                mean=float(shown.mean()),
                deviation=float(shown.std()),
                inside=float(satisfied((demand,), {demand.key: shown}).mean()),
                reference_mean=float(recorded.mean()),
                reference_deviation=float(recorded.std()),
            )
        )
    return rows

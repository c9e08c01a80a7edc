"""Section `control` and its file: conditions on the hands, and gestures of a library that are to be shown."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, field_validator, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from gesturegen.settings.base import MOST_MISTAKES, NotNegative, Positive, Section

# A share of the reference frames, such as 85% or 2.5%.
_QUANTILE = re.compile(r"[0-9]+(\.[0-9]+)?%")


class Condition(Section):
    """Condition on a measure of the hands in a time range; a bound is a number or a quantile such as `85%`.

    Heights, radii and symmetry are in cm, speeds in cm/s, times in seconds; without `to` the range reaches to
    the end of the clip. Only a soft condition has a price, 1 where none is given.
    """

    clip: str = "*"
    from_: Annotated[float, Field(ge=0, alias="from")] = 0.0
    to: Positive | None = None
    measure: Literal["height", "speed", "radius", "symmetry"]
    hand: Literal["left", "right", "both"] = "both"
    at_least: float | str | None = None
    at_most: float | str | None = None
    hard: bool = True
    price: Positive | None = None

    @field_validator("at_least", "at_most", mode="before")
    @classmethod
    def _a_bound(cls, bound: Any) -> Any:
        number = isinstance(bound, (int, float)) and not isinstance(bound, bool)
        if bound is None or (number and abs(bound) < math.inf) or _quantile(bound) is not None:
            return bound
        raise PydanticCustomError("bound", "a finite number, or a quantile from `0%` to `100%` such as `85%`")

    @model_validator(mode="after")
    def _can_be_met(self) -> Self:
        if self.to is not None and self.to <= self.from_:
            raise ValueError("`to` must be later than `from`")
        if self.at_least is None and self.at_most is None:
            raise ValueError("give at_least, at_most or both")
        if self.measure == "symmetry" and self.hand != "both":
            raise ValueError("symmetry compares the hands and has none of its own; leave out `hand`")
        if self.hard and self.price is not None:
            raise ValueError("a hard condition has no price; leave it out, or set hard: false")
        least, most = self.at_least, self.at_most
        if least is not None and most is not None:
            quantiles = _quantile(least), _quantile(most)
            low, high = (least, most) if None in quantiles else quantiles
            # A number and a quantile can be compared once the references are known.
            if isinstance(low, (int, float)) and isinstance(high, (int, float)) and low > high:
                raise ValueError(f"at_least {bound_text(least)} is more than at_most {bound_text(most)}")
        return self


def _quantile(bound: Any) -> float | None:
    """Parse a text from `0%` to `100%` as 0 to 1; None for anything else."""
    if not isinstance(bound, str) or not _QUANTILE.fullmatch(bound):
        return None
    share = float(bound[:-1]) / 100
    return share if share <= 1 else None


def bound_text(bound: float | str) -> str:
    """Format a bound as it is written in a config."""
    return bound if isinstance(bound, str) else f"{bound:g}"


def resolve_bound(bound: float | str | None, missing: float, quantile: Callable[[float], float]) -> float:
    """Return the number that a bound stands for; `missing` where there is none.

    quantile : what of the references a share from 0 to 1 lies below
    """
    if bound is None:
        return missing
    share = _quantile(bound)
    return float(bound) if share is None else float(quantile(share))


def shared_time(one: Condition, other: Condition) -> tuple[float, float] | None:
    """Find from when to when both conditions hold, in seconds (inf for the end of the clip); None for never."""
    ends = [math.inf if condition.to is None else condition.to for condition in (one, other)]
    start, end = max(one.from_, other.from_), min(ends)
    return (start, end) if start < end else None


def time_text(start: float, end: float) -> str:
    """Format a time range in seconds, in words."""
    return f"from {start:g} s on" if math.isinf(end) else f"from {start:g} to {end:g} s"


class KeywordGesture(Section):
    """Gesture of the library that is to be shown at a time, or wherever a word is said."""

    clip: str = "*"
    word: str | None = None
    at: NotNegative | None = None
    gesture: str

    @field_validator("word")
    @classmethod
    def _one_word(cls, word: str | None) -> str | None:
        if word is not None and (len(word.split()) != 1 or not any(map(str.isalnum, word))):
            raise ValueError(f"{word!r} is not one word, so no transcript can match it")
        return word

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.word is None) == (self.at is None):
            raise ValueError("give one of word and at")
        return self


class Schedule(Section):
    """The contents of a control file: conditions on the hands, and gestures that are to be shown."""

    # Each is compared with each other.
    conditions: Annotated[tuple[Condition, ...], Field(max_length=1000)] = ()
    gestures: Annotated[tuple[KeywordGesture, ...], Field(max_length=1000)] = ()

    @field_validator("conditions")
    @classmethod
    def _one_at_a_time(cls, conditions: tuple[Condition, ...]) -> tuple[Condition, ...]:
        mistakes: list[InitErrorDetails] = []
        for (first, one), (second, other) in itertools.combinations(enumerate(conditions), 2):
            time = shared_time(one, other)
            if time and (one.clip, one.measure, one.hand) == (other.clip, other.measure, other.hand):
                problem = PydanticCustomError(
                    "value_error",
                    "conditions {first} and {second} overlap {time}; give both bounds in one condition, or times apart",
                    {"first": first + 1, "second": second + 1, "time": time_text(*time)},
                )
                mistakes.append({"type": problem, "loc": (second,), "input": None})
                if len(mistakes) > MOST_MISTAKES:
                    break
        if mistakes:
            # Unlike a ValueError, this says which condition it is, and so in which line.
            raise ValidationError.from_exception_data(cls.__name__, mistakes)
        return conditions


class Control(Schedule):
    """The conditions and gestures, given directly or else read from `file`; the gestures are those of `library`."""

    file: str | None = None
    library: str | None = None
    left: str = "b_l_wrist"
    right: str = "b_r_wrist"
    forbidden: Positive = 1000.0

"""Sections of the settings for reading, measuring and cutting sound and words."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from gesturegen.settings.base import Count, NotNegative, Positive, Section, Share


class Audio(Section):
    """Section `audio`: which channel of a sound file is the speech."""

    channel: int | str = "mix"

    @field_validator("channel", mode="before")
    @classmethod
    def _a_channel(cls, channel: Any) -> Any:
        number = isinstance(channel, int) and not isinstance(channel, bool) and 1 <= channel <= 64
        if number or channel in ("mix", "left", "right"):
            return channel
        raise PydanticCustomError("channel", "'mix', 'left', 'right' or a number from 1 to 64")


class Voice(Section):
    """Section `voice`: the detection of voice activity."""

    threshold: Annotated[float, Field(gt=0, lt=1)] = 0.5
    smoothing_seconds: NotNegative = 0.1
    loud_db: NotNegative = 12.0


class Onsets(Section):
    """Section `onsets`: the detection of onsets, without the pops at the edges of censored names."""

    min_strength: NotNegative = 5.0
    per_second: Positive | None = None
    sample_rate: Count = 22050
    hop_length: Count = 512
    muted_min_seconds: NotNegative = 0.1
    muted_max_seconds: NotNegative = 3.0
    muted_margin_seconds: NotNegative = 0.05
    muted_max_share: Share = 0.2


class Keywords(Section):
    """Section `keywords`: the keyword of each word, given directly or read from a file."""

    file: str | None = None
    words: dict[str, str] | None = None


class Prosody(Section):
    """Section `prosody`: the measurement of energy and pitch."""

    enabled: bool = False
    sample_rate: Annotated[int, Field(ge=4000)] = 8000
    hop_length: Count = 320
    pitch_min: Positive = 65.0
    pitch_max: Positive = 500.0

    @model_validator(mode="after")
    def _a_range(self) -> Self:
        if not 1.2 * self.pitch_min <= self.pitch_max < self.sample_rate / 2:
            raise ValueError("pitch_max must be at least 1.2 times pitch_min, and below half the sample_rate")
        return self


class Acoustics(Section):
    """Section `acoustics`: the measurement of cepstral coefficients for motion matching."""

    enabled: bool = False
    sample_rate: Count = 22050
    rate: Count = 15
    coefficients: Count = 13

    @model_validator(mode="after")
    def _whole_hops(self) -> Self:
        if self.sample_rate % self.rate:
            raise ValueError("sample_rate must be a multiple of rate, so that there are so many values a second")
        return self


class Pauses(Section):
    """Section `pauses`: the least length of a pause, and when the sound of the voice tells it."""

    min_seconds: NotNegative = 0.5
    voice: Literal["without_words", "always"] = "without_words"


class Phrases(Section):
    """Section `phrases`: the gap between words that ends a phrase."""

    min_gap_seconds: NotNegative = 0.2


class Cutting(Section):
    """The rule that cuts speech into clips, in seconds."""

    gap_seconds: NotNegative = 0.4
    rest_seconds: Positive = 1.0
    min_seconds: Positive = 1.0
    max_seconds: Positive = 10.0

    @model_validator(mode="after")
    def _can_be_cut(self) -> Self:
        if self.max_seconds < 2 * self.min_seconds:
            raise ValueError("max_seconds must be at least twice min_seconds, or a long clip cannot be cut in two")
        return self


class Correction(Section):
    """The rhythm signature of the gesture clip of recording `clip` that starts at `start` seconds."""

    clip: str
    start: NotNegative
    bits: Annotated[str, Field(pattern="^[01]+$")]


class Rhythm(Section):
    """The rhythm signature of a clip, and corrections of it."""

    bits: Annotated[int, Field(ge=2)] = 32
    words: Literal["start", "span"] = "start"
    smoothing_seconds: NotNegative = 0.1
    corrections_file: str | None = None
    corrections: tuple[Correction, ...] | None = None

    @model_validator(mode="after")
    def _as_many_bits(self) -> Self:
        for correction in self.corrections or ():
            if len(correction.bits) != self.bits:
                raise ValueError(
                    f"the correction of {correction.clip} at {correction.start:g} s has {len(correction.bits)} bits, "
                    f"rhythm.bits is {self.bits}"
                )
        return self

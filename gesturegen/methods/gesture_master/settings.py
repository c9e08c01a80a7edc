"""Settings of GestureMaster: section `gesture_master`."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from gesturegen.settings.base import NotNegative, Positive, Section, Share
from gesturegen.settings.speech import Cutting, Rhythm


class Quality(Section):
    """Limits above which a gesture clip is left out, and names or patterns that overrule them."""

    enabled: bool = True
    max_turn: Positive = 1350.0
    max_speed: Positive = 900.0
    max_jitter: Positive = 0.2
    frozen_seconds: Positive = 1.0
    include: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()


class StyleTarget(Section):
    """Style values that are wanted in a time range of a test clip; None where any will do."""

    clip: str
    from_: Annotated[float, Field(ge=0, alias="from")]
    to: Positive
    speed: NotNegative | None = None
    radius: NotNegative | None = None
    height: float | None = None

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        if self.to <= self.from_:
            raise ValueError("`to` must be later than `from`")
        return self


class Style(Section):
    """The source of wanted styles, and the parameters of the regression that predicts them."""

    source: Literal["predict", "targets", "none"] = "predict"
    ridge: Positive = 10.0
    folds: Annotated[int, Field(ge=2)] = 5
    targets_file: str | None = None
    targets: tuple[StyleTarget, ...] | None = None

    @model_validator(mode="after")
    def _targets_given(self) -> Self:
        if self.source == "targets" and self.targets_file is None and self.targets is None:
            raise ValueError(
                "source `targets` needs the key `targets_file`, a CSV file: clip,from,to,speed,radius,height"
            )
        return self


class UpperBody(Section):
    """Weights of the transition and data terms of the upper body, and the threshold delta_T of its edges."""

    lambda_1: NotNegative = 0.7
    lambda_2: NotNegative = 0.3
    delta_t: Positive | None = 8.0
    delta_quantile: Share | None = None
    lambda_3: NotNegative = 1.0
    lambda_4: Positive = 3.0
    lambda_5: NotNegative = 1.0
    lambda_6: NotNegative = 0.1
    zeta: NotNegative = 10000.0

    @model_validator(mode="after")
    def _one_threshold(self) -> Self:
        if (self.delta_t is None) == (self.delta_quantile is None):
            raise ValueError("give one of delta_t and delta_quantile, and null for the other")
        return self


class LowerBody(UpperBody):
    """The same weights for the lower body, which ignores style and rhythm by default."""

    lambda_3: NotNegative = 0.0
    lambda_4: Positive = 1.0
    lambda_5: NotNegative = 0.0
    lambda_6: NotNegative = 0.0


class TimeScale(Section):
    """Limits within which gesture clips are scaled in time, and the prices of scaling."""

    min: Annotated[float, Field(gt=0, le=1)] = 0.8
    max: Annotated[float, Field(ge=1)] = 1.25
    rest_min: Annotated[float, Field(gt=0, le=1)] = 0.5
    rest_max: Annotated[float, Field(ge=1)] = 2.0
    lambda_scale: NotNegative = 5.0
    lambda_outside: NotNegative = 1_000_000.0


class GestureMaster(Section):
    """Section `gesture_master`: all settings of GestureMaster."""

    cutting: Cutting = Cutting()
    quality: Quality = Quality()
    mirror: bool = True
    joint_pairs: tuple[tuple[str, str], ...] = ()
    finger_transfer: bool = True
    rhythm: Rhythm = Rhythm()
    style: Style = Style()
    transition_frames: Annotated[int, Field(ge=2)] = 8
    upper: UpperBody = UpperBody()
    lower: LowerBody = LowerBody()
    time_scale: TimeScale = TimeScale()
    lambda_kind: NotNegative = 100_000.0
    lambda_reuse: NotNegative = 100_000.0
    lambda_variant: NotNegative = 1.0

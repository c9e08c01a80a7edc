"""Settings of gesture motion graphs: of the published search, piece by piece, and of the global one."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from gesturegen.settings.base import Count, NotNegative, Section, Share


class Beam(Section):
    """Section `beam`: width, weights and accepted lengths of the beam search (§4.2.1)."""

    l_npaths: Count = 20
    lambda_w: NotNegative = 1.0
    lambda_len: NotNegative = 1.0
    min_ratio: Annotated[float, Field(gt=0, le=1)] = 0.9
    max_ratio: Annotated[float, Field(ge=1)] = 1.1


class GlobalSearch(Section):
    """Section `global_search`: prices and rewards of the optimal search."""

    join_price: NotNegative = 60.0
    lambda_join: NotNegative = 1.0
    min_stay_seconds: NotNegative = 0.67
    stutter_seconds: NotNegative = 0.5
    lambda_state: NotNegative = 3.0
    lambda_hold: NotNegative = 20.0
    lambda_rest: NotNegative = 1.0
    lambda_beat: NotNegative = 15.0
    beat_lag_seconds: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0
    lambda_onset: NotNegative = 3.0
    lambda_phrase: NotNegative = 5.0
    lambda_keyword: NotNegative = 20.0
    lambda_repeat: NotNegative = 1.0
    repeat_seconds: NotNegative = 10.0
    sweeps: Annotated[int, Field(ge=0)] = 2
    lambda_variant: NotNegative = 1.0


class Features(Section):
    """Section `features`: features that rank start nodes (§4.2.3)."""

    l_feat: Count = 10
    w_full: tuple[Share, ...] = (1.0, 0.5, 0.5, 0.2, 0.2, 0.2, 0.1, 0.1, 0.1, 0.1)
    lambda_full: NotNegative = 1.0
    lambda_first: NotNegative = 1.0
    lambda_occ: NotNegative = 0.5
    align: Literal["following", "as_printed"] = "following"

    @model_validator(mode="after")
    def _one_weight_each(self) -> Self:
        if len(self.w_full) != self.l_feat:
            raise ValueError(
                f"w_full has {len(self.w_full)} weights for l_feat {self.l_feat}; give one weight per element"
            )
        return self


class Termination(Section):
    """Section `termination`: retries and fallbacks of a piece that finds no path (A.1.1)."""

    fallbacks: bool = True
    keyword_retries: Annotated[int, Field(ge=0)] = 5
    discard_after_retries: Annotated[int, Field(ge=0)] = 10
    discard_share: Annotated[float, Field(gt=0, le=1)] = 0.1
    max_retries: Count = 40
    failure_retries: Count = 400

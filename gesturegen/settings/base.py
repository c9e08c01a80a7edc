"""The base of all sections of the settings: their strictness and the kinds of numbers that they hold."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]

NotNegative = Annotated[float, Field(ge=0)]

Count = Annotated[int, Field(ge=1)]

Share = Annotated[float, Field(ge=0, le=1)]

# Of one file that are told; each takes a look for the nearest name.
MOST_MISTAKES = 20


class Section(BaseModel):
    """Base of all sections: frozen, and strict about types and unknown keys."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

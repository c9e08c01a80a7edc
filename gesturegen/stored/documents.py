"""The pydantic models of stored JSON files, and their reading, writing and validation.

Entries that a model does not name may be there, and are kept; those that it names must be, of their type and in their
range. Traces, manifests and the index of clips are models of their own rooms (`trace.py`, `manifest.py`,
`data/index.py`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, GetPydanticSchema, ValidationError
from pydantic_core import core_schema, from_json

from gesturegen import files
from gesturegen.errors import DamagedError, DataError
from gesturegen.stored.sealing import damaged, remade, sealed_text, unsealed_text

_Item = TypeVar("_Item")

# Frames and nodes are numbered in 31 bits.
Number = Annotated[int, Field(ge=0, lt=1 << 31)]
# A whole number stays one, so that it is written as it was.
Figure = Annotated[
    float,
    GetPydanticSchema(
        lambda *_: core_schema.union_schema(
            [core_schema.int_schema(ge=-(1 << 63), lt=1 << 63), core_schema.float_schema(allow_inf_nan=False)],
            custom_error_type="figure",
            custom_error_message="Input should be a finite number",
        )
    ),
]
Distance = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Seed = Annotated[int, Field(ge=0)]
Seconds = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]
Rate = Annotated[float, Field(gt=0, le=10_000, allow_inf_nan=False)]
Row = dict[str, Figure | None]
# A JSON array; what is in it is checked as strictly as all else.
Many = Annotated[tuple[_Item, ...], Field(strict=False)]


class Part(BaseModel):
    """An immutable, strictly typed part of a stored document."""

    model_config = ConfigDict(strict=True, frozen=True, extra="allow")


class Document(Part):
    """The content of a stored JSON file."""

    def to_json(self) -> str:
        """Format the file's text, without its checksum; NaN and infinities, which JSON lacks, raise ValueError."""
        return _format(self.model_dump(exclude_unset=True))

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """Parse a text; ValueError for one that is no JSON, ValidationError for one that does not fit the model."""
        return cls.model_validate(from_json(text, allow_inf_nan=False))


# --- tables -------------------------------------------------------------------------------------------------


class Summary(Document):
    """The figures that `evaluate` computes; beside : the figures that they are compared with."""

    signature: dict[str, str | int]
    total: Row
    clips: dict[str, Row]
    control: dict[str, list[dict[str, str | bool | Figure | None]]] = {}
    beside: dict[str, Row] = {}


class _Setup(Part):
    mean: Row = {}
    spread: Row = {}
    paper: Row | None = None


class Ablation(Document):
    """The table that `ablate` computes, as far as the report shows it."""

    setups: dict[str, _Setup]


class Lengths(Document):
    """The figures that `ablate` computes by length of the references, as far as the report shows them."""

    lines: dict[str, list[dict[str, str | Figure | None]]]


# --- refiner.pt ---------------------------------------------------------------------------------------------


class _Scale(Part):
    mean: list[Figure]
    scale: list[Figure]


class _Scales(Part):
    audio: _Scale
    gesture: _Scale


class _Description(Part):
    joints: list[str]
    fps: Rate


class _History(Part):
    reconstruction: list[float]
    distance: list[float]
    gradient_norm: list[float]
    checks: list[Number]
    figures: list[float]
    stopped: bool


class _Networks(Part):
    generator: dict[str, Any]
    critic: dict[str, Any]


class Checkpoint(_Networks):
    """The checkpoint of `train-refiner`; its weights are checked by the networks that load them."""

    description: _Description
    settings: dict[str, Any]
    seed: Seed
    digest: str
    audio_channels: Annotated[int, Field(ge=1, le=1 << 16)]
    scales: _Scales
    best: _Networks
    generator_adam: dict[str, Any]
    critic_adam: dict[str, Any]
    rng: dict[str, Any]
    history: _History


# --- files --------------------------------------------------------------------------------------------------


def write(path: str | Path, value: Document | Mapping) -> str:
    """Store a document, or any JSON object, with a checksum; returns the hash of the whole file.

    NaN and infinities, which JSON does not have, are a ValueError.
    """
    text = value.to_json() if isinstance(value, Document) else _format(value)
    return files.write_text(path, sealed_text(text))


def _format(value: Mapping) -> str:
    return json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


_Stored = TypeVar("_Stored", bound=Document)


def read(path: str | Path, model: type[_Stored], command: str) -> _Stored:
    """Read and validate the document in a stored JSON file.

    Raises DataError for a file that cannot be read, DamagedError for one that is not as it was written or not as the
    model declares. command : what makes it again
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise DataError(f"{path}: not a file; remove it and run `gesturegen {command}` again")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); run `gesturegen {command}` again") from None
    text = unsealed_text(path, data, command)
    try:
        return model.from_json(text)
    except ValidationError as error:
        raise damaged(path, first_problem(error), command) from None
    except (ValueError, RecursionError) as error:
        raise damaged(path, f"not JSON: {str(error).splitlines()[0]}", command) from None


def damage(path: str | Path, model: type[Document], command: str) -> list[str]:
    """Say whether a stored JSON file that is about to be made again was damaged: at most one line."""
    try:
        if Path(path).is_file():
            read(path, model, command)
    except DamagedError as error:
        return [remade(error)]
    return []


def first_problem(error: ValidationError) -> str:
    """Describe the first problem of a validation error in one line."""
    first = error.errors(include_url=False, include_input=False, include_context=False)[0]
    place = ".".join(map(str, first["loc"]))
    return f"{place[:80]}: {first['msg'].removeprefix('Value error, ')}".removeprefix(": ").splitlines()[0]

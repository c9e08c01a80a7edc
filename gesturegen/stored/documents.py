"""Stored JSON files: what each kind holds, as models, and the check of a file against them.

Entries that a model does not name may be there; those that it names must be, of their type and in their range.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from gesturegen import files
from gesturegen.errors import DamagedError, DataError
from gesturegen.stored.sealing import damaged, remade, sealed_text, unsealed_text

# Frames and nodes are numbered in 31 bits.
Number = Annotated[int, Field(ge=0, lt=1 << 31)]
Figure = Annotated[float, Field(allow_inf_nan=False)]
Distance = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Seed = Annotated[int, Field(ge=0)]
Seconds = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]
Rate = Annotated[float, Field(gt=0, le=10_000, allow_inf_nan=False)]
Row = dict[str, Figure | None]


class _Model(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, extra="ignore")


# --- clips/index.json ---------------------------------------------------------------------------------------


class _Recording(_Model):
    speaker: str | None
    seconds: Seconds


class _Test(_Recording):
    audio: str | None = None
    truth: str | None


class Index(_Model):
    """What `preprocess` leaves for later commands."""

    format_version: int
    settings: str
    references: dict[str, _Recording]
    tests: dict[str, _Test]
    training_seconds: Seconds
    failed: dict[str, str]


# --- reenact/<clip>.trace.json ------------------------------------------------------------------------------


class _KeyNode(_Model):
    frame: Number
    kind: Literal["onset", "keyword", "break"]
    keyword: str


class _Origin(_Model):
    clip: str
    start_node: Number
    mirrored: bool = False


class _Piece(_Model):
    start_frame: Number
    end_frame: Number
    target_length: Number
    end_kind: str
    keyword: str
    nodes: Annotated[list[Number], Field(min_length=1)]
    cost: Figure
    retries: Number
    fallback: str | None
    costs: dict[str, Figure] | None = None


class _Join(_Model):
    frame: Number
    from_node: Number
    to_node: Number
    distance: Distance
    natural: bool


class _Demand(_Model):
    place: Number
    measure: Literal["height", "speed", "radius", "symmetry"]
    hand: Literal["left", "right", "both"]
    low: Figure | None
    high: Figure | None
    start_frame: Number
    end_frame: Number
    hard: bool
    price: Figure
    scale: Figure


class _Failure(_Model):
    start_frame: Number
    end_frame: Number
    end_kind: str
    keyword: str


class _Track(_Model):
    joints: list[str]
    pieces: list[_Piece]
    joins: list[_Join]


class Trace(_Model):
    """What explains the frames of a clip."""

    clip: str
    method: str
    search: str
    seed: Seed
    variant: Number = 1
    graph: str
    references: Annotated[list[_Origin], Field(min_length=1)]
    fps: Rate
    n_frames: Number
    version: str
    config_hash: str
    key_nodes: list[_KeyNode]
    pieces: list[_Piece]
    joins: list[_Join]
    pauses: list[Annotated[list[Number], Field(min_length=2, max_length=2)]]
    objective: dict[str, dict[str, Figure]] | None
    failure: _Failure | None
    control: list[_Demand]
    tracks: list[_Track]
    notes: list[str]
    inputs: str
    bvh_sha256: str | None

    @model_validator(mode="after")
    def _fits_together(self) -> Trace:
        starts = [reference.start_node for reference in self.references]
        if starts[0] != 0 or any(b <= a for a, b in pairwise(starts)):
            raise ValueError("the start nodes of the references do not rise from 0")
        frames = [node.frame for node in self.key_nodes] + [end - 1 for _, end in self.pauses]
        frames += [demand.end_frame - 1 for demand in self.control]
        if any(frame >= self.n_frames for frame in frames) or any(d.start_frame >= d.end_frame for d in self.control):
            raise ValueError(f"frames beyond the {self.n_frames} of the clip")
        for track in (self, *self.tracks):
            _require_gapless(track.pieces, track.joins, None if self.failure else self.n_frames)
        return self


def _require_gapless(pieces: Sequence[_Piece], joins: Sequence[_Join], n_frames: int | None) -> None:
    """Pieces follow one another from frame 0 on, to the end where the search was not stuck."""
    frame = 0
    for piece in pieces:
        if piece.start_frame != frame or piece.end_frame <= frame or piece.target_length != piece.end_frame - frame:
            raise ValueError(f"the piece at frame {piece.start_frame} does not follow the one before")
        frame = piece.end_frame
    if n_frames is not None and frame != n_frames:
        raise ValueError(f"pieces for {frame} of {n_frames} frames")
    if [join.frame for join in joins] != [piece.start_frame for piece in pieces[1:]]:
        raise ValueError("joins are not where pieces meet")


# --- reenact/manifest.json ----------------------------------------------------------------------------------


class _Clip(_Model):
    clip: str
    references: list[str]
    stuck: bool
    error: str | None
    files: dict[str, str]
    n_frames: Number = 0
    pieces: Number = 0
    hard_joins: Number = 0
    retries: Number = 0
    fallbacks: dict[str, Number] = {}

    @model_validator(mode="after")
    def _has_figures(self) -> _Clip:
        if self.error is None or self.stuck:
            missing = {"n_frames", "pieces", "hard_joins", "retries", "fallbacks"} - self.model_fields_set
            if missing:
                raise ValueError(f"no {min(missing)}")
        return self


class _Settings(_Model):
    fps: Rate


class Manifest(_Model):
    """What `reenact` leaves of a run."""

    gesturegen: str
    method: str
    search: str
    seed: Seed
    config_hash: str
    clips: list[_Clip]
    config: _Settings


# --- tables -------------------------------------------------------------------------------------------------


class Summary(_Model):
    """The figures of `evaluate`; beside : of what they are compared with."""

    signature: dict[str, str | int]
    total: Row
    clips: dict[str, Row]
    control: dict[str, list[dict[str, str | bool | Figure | None]]] = {}
    beside: dict[str, Row] = {}


class _Setup(_Model):
    mean: Row = {}
    spread: Row = {}
    paper: Row | None = None


class Ablation(_Model):
    """The table of `ablate`, as far as it is shown."""

    setups: dict[str, _Setup]


class Lengths(_Model):
    """The figures of `ablate` by length of the references, as far as they are shown."""

    lines: dict[str, list[dict[str, str | Figure | None]]]


# --- refiner.pt ---------------------------------------------------------------------------------------------


class _Scale(_Model):
    mean: list[Figure]
    scale: list[Figure]


class _Scales(_Model):
    audio: _Scale
    gesture: _Scale


class _Description(_Model):
    joints: list[str]
    fps: Rate


class _History(_Model):
    reconstruction: list[float]
    distance: list[float]
    gradient_norm: list[float]
    checks: list[Number]
    figures: list[float]
    stopped: bool


class _Networks(_Model):
    generator: dict[str, Any]
    critic: dict[str, Any]


class Checkpoint(_Networks):
    """What `train-refiner` keeps, but for the weights, which the networks check as they take them."""

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


def write(path: str | Path, value: dict) -> None:
    """Store a JSON object with a checksum; NaN and infinities, which JSON does not have, are a ValueError."""
    write_text(path, json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def write_text(path: str | Path, text: str) -> str:
    """Store the text of a JSON object with a checksum; returns the hash of the whole file."""
    return files.write_text(path, sealed_text(text))


def read(path: str | Path, model: type[_Model], command: str) -> Any:
    """The object in a stored JSON file, without its checksum.

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
        value = json.loads(text, parse_constant=_refuse)
        model.model_validate(value)
    except ValidationError as error:
        raise damaged(path, first_problem(error), command) from None
    except (ValueError, RecursionError) as error:
        raise damaged(path, f"not JSON: {str(error).splitlines()[0]}", command) from None
    return value


def damage(path: str | Path, model: type[_Model], command: str) -> list[str]:
    """What to say of a stored JSON file that is about to be made again: nothing, or that it was damaged."""
    try:
        if Path(path).is_file():
            read(path, model, command)
    except DamagedError as error:
        return [remade(error)]
    return []


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number")


def first_problem(error: ValidationError) -> str:
    """The first of what is wrong, in one line."""
    first = error.errors(include_url=False, include_input=False, include_context=False)[0]
    place = ".".join(map(str, first["loc"]))
    return f"{place[:80]}: {first['msg'].removeprefix('Value error, ')}".removeprefix(": ").splitlines()[0]

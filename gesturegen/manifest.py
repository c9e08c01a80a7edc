"""The manifest of a run of `reenact`, stored as `reenact/manifest.json` (docs/files.md)."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, Field, TypeAdapter, model_validator

from gesturegen.stored.documents import Document, Many, Number, Part, Rate, Seed

_RATE = TypeAdapter(Rate)


class ClipRow(Part):
    """The row of one clip in the manifest; a clip that failed has no figures.

    clip, references, graph : names; n_frames : of the speech; pieces : how many; hard_joins : joins that leave the
    recording; retries : how often the search began a piece anew; fallbacks : pieces that gave way, by what did
    stuck : whether the search found no path; error : what went wrong, in one line, else None
    files : SHA-256 of what was written, by name
    """

    clip: str
    references: Many[str]
    graph: str = ""
    n_frames: Number = 0
    pieces: Number = 0
    hard_joins: Number = 0
    retries: Number = 0
    fallbacks: dict[str, Number] = Field(default_factory=dict)
    stuck: bool
    error: str | None
    files: dict[str, str]

    @model_validator(mode="after")
    def _has_figures(self) -> ClipRow:
        if self.error is None or self.stuck:
            missing = {"n_frames", "pieces", "hard_joins", "retries", "fallbacks"} - self.model_fields_set
            if missing:
                raise ValueError(f"no {min(missing)}")
        return self

    @property
    def fallback_text(self) -> str:
        """Say what the search gave up, and in how many pieces."""
        return ", ".join(f"{count} {kind}" for kind, count in self.fallbacks.items()) or "none"


def _with_rate(config: dict[str, Any]) -> dict[str, Any]:
    if "fps" not in config:
        raise ValueError("no fps")
    _RATE.validate_python(config["fps"], strict=True)
    return config


class Manifest(Document):
    """The settings, inputs, figures and file hashes of a run; the same for the same inputs.

    gesturegen : its version; variant : its number, from 1; clips : all test clips, by name, `n_failed` of which have an
    error; config : all settings but the folders
    """

    gesturegen: str
    method: str
    search: str
    seed: Seed
    variant: Number = 1
    config_hash: str
    n_clips: Number = 0
    n_failed: Number = 0
    clips: Many[ClipRow]
    config: Annotated[dict[str, Any], AfterValidator(_with_rate)]

    @property
    def fps(self) -> float:
        """Return the frames per second of the motions."""
        return self.config["fps"]

    @property
    def made(self) -> list[ClipRow]:
        """List the clips that have a motion."""
        return [row for row in self.clips if row.error is None]

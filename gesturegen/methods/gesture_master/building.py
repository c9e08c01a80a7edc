"""Building of gesture databases, even of a whole training set, recording by recording and block by block.

What has been built of a recording is stored in `WORK/gestures`, and edges in blocks beside the database, until it is
complete: a build that was interrupted goes on where it stopped, and recordings are cut once for all databases.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from gesturegen import __version__
from gesturegen import frames as reference_frames
from gesturegen.data import clips
from gesturegen.data.keynodes import KeyNodes
from gesturegen.data.recordings import is_listed, without_match
from gesturegen.data.stored_clips import digests, limits, load_reference
from gesturegen.errors import DamagedError, DataError
from gesturegen.frames import describe as describe_frames
from gesturegen.frames import join, require_one_skeleton
from gesturegen.methods.gesture_master import database, extraction, style
from gesturegen.methods.gesture_master.database import CLIP_ARRAYS, Edges, GestureDatabase
from gesturegen.methods.gesture_master.extraction import BODIES, Gestures, extract
from gesturegen.methods.gesture_master.method import GestureMasterMethod
from gesturegen.methods.method import Description, Job, Prepared
from gesturegen.methods.parts import by_library
from gesturegen.settings.models import Config
from gesturegen.stored import arrays as stored_arrays
from gesturegen.stored import sealing
from gesturegen.stored.arrays import Array, Kind
from gesturegen.workspace import clip_path, work_path

if TYPE_CHECKING:
    from gesturegen.outcome import Outcome

# Clips that edges lead to, of one task.
BLOCK = 2000
_COPIES = {f"{body}_{end}": Array("f4", f"copies G {body}_values") for body in BODIES for end in ("ends", "starts")}
_DESCRIBED = {
    name: value
    for name, value in reference_frames.ARRAYS.items()
    if name not in ("method", "config", "clip_digests", "positions")
}


def _unfit_part(stored: Mapping[str, np.ndarray]) -> str | None:
    """Say what is wrong between the arrays of a part, each valid by itself; None when nothing is."""
    frames = {name.removeprefix("described_"): value for name, value in stored.items()}
    for body in BODIES:
        positions, rotations = stored[f"{body}_joints"].tolist()
        values, frame = stored[f"{body}_ends"].shape[-1], 3 * positions + 4 * rotations
        if values and (not frame or values % frame):
            return f"{body}_joints do not fit {body}_ends"
    return reference_frames.unfit(frames) or database.unfit_clips(frames)


# What has been built of a recording: `Gestures`, and what `describe` says of its frames.
_PART = Kind(
    "part of a gesture database", "build-graph",
    {
        "made_of": Array("str"),
        "positions": Array("f4", "copies N J 3"),
        **CLIP_ARRAYS,
        **_COPIES,
        "styles": Array("f8", f"copies G {len(style.VALUES)}"),
        "features": Array("f8", f"G {len(style.FEATURES)}", stored_arrays.finite_or_nan),
        "upper_joints": Array("i8", "2", stored_arrays.not_negative),
        "lower_joints": Array("i8", "2", stored_arrays.not_negative),
        "has_fingers": Array("bool"),
        "poses": Array("f4", "copies G pose_values"),
        **{name if name.startswith("key_") else f"described_{name}": value for name, value in _DESCRIBED.items()},
    },
    relations=_unfit_part,
)  # fmt: skip
# The edges that lead to some of the clips, of which there are as many as there are in the whole database.
_BLOCK_KIND = Kind(
    "block of edges", "build-graph",
    {
        "made_of": Array("str"),
        "indptr": Array("i8", "led_to+1", stored_arrays.pointers("E")),
        "sources": Array("i4", "E", stored_arrays.not_negative),
        "costs": Array("f4", "E"),
        "delta": Array("f8", "", stored_arrays.not_negative),
    },
)  # fmt: skip
# Named in the lines of `build-graph`; `inspect` lists all of them.
_MOST_DROPPED = 10


def prepare(
    jobs: Mapping[str, Job], is_stored: Callable[[Job], bool], run: Callable[[Mapping, str], Outcome]
) -> Prepared:
    """Cut all recordings, then find all edges, except what is stored already and current.

    The notes are of stored parts that had to be made again.
    """
    todo = {name for name, job in jobs.items() if not is_stored(job)}
    different = {name: line for name, job in jobs.items() if name in todo and (line := _different_skeletons(job))}
    tasks: dict[str, partial] = {}
    users: dict[str, list[str]] = {}
    for name, job in jobs.items():
        if name in different:
            continue
        for recording, limit in zip(job.names, limits(job.config, job.names), strict=True):
            path = _part_path(job.config, recording, limit)
            if name not in todo and not path.is_file():
                continue  # a database that is whole needs no parts, but those that are there must be whole too
            title = path.stem
            tasks[title] = partial(_extract, job.config, recording, limit)
            users.setdefault(title, []).append(name)
    cut = run(tasks, "gestures")
    errors, bugs = by_library(cut.errors, users) | different, by_library(cut.bugs, users)
    links: dict[str, partial] = {}
    owners: dict[str, list[str]] = {}
    for name, job in jobs.items():
        if name not in todo or name in errors or name in bugs:
            continue
        count = _n_clips([part for part, _ in _read_parts(job.config, job.names)])
        for body in BODIES:
            for first in range(0, count, BLOCK):
                title = f"{name}, {body} body, clips from {first}"
                links[title] = partial(_link, job.config, job.names, job.path, body, first)
                owners[title] = [name]
    joined = run(links, "edges")
    notes: dict[str, list[str]] = {}
    for title, own in {**cut.done, **joined.done}.items():
        for name in {**users, **owners}[title]:
            notes.setdefault(name, []).extend(own)
    return Prepared(
        notes=notes, errors=errors | by_library(joined.errors, owners), bugs=bugs | by_library(joined.bugs, owners)
    )


def _different_skeletons(job: Job) -> str | None:
    """Say why recordings cannot share a database, since each part is stored without a look at the others."""
    try:
        texts = [
            str(stored_arrays.read(clip_path(job.config, name), clips.KIND, ("hierarchy",))["hierarchy"])
            for name in job.names
        ]
        for name, text in zip(job.names, texts, strict=True):
            if text != texts[0]:
                require_one_skeleton([load_reference(job.config, n, 1) for n in (job.names[0], name)], job.config)
    except DataError as error:
        return str(error)
    return None


# --- gestures of a recording --------------------------------------------------------------------------------


def _part_path(config: Config, recording: str, limit: int | None) -> Path:
    # By settings: setups of an ablation cut the same recordings in different ways.
    settings = hashlib.sha256(config.section_json(*GestureMasterMethod.clip_settings).encode()).hexdigest()[:12]
    cut = "" if limit is None else f"-{limit}f"
    return work_path(config, "gestures", f"{recording}{cut}-{settings}.npz")


def _made_of(config: Config, names: Sequence[str], *settings: str) -> str:
    """Hash all that a stored part depends on."""
    parts = [__version__, config.section_json(*settings), *names, *digests(config, names)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _is_stored(path: Path, kind: Kind, made_of: str) -> tuple[bool, list[str]]:
    """Tell whether a part of these inputs is stored as it was written, with a note on one that is not."""
    try:
        return path.is_file() and str(stored_arrays.read(path, kind, mapped=True)["made_of"]) == made_of, []
    except DamagedError as error:
        return False, [sealing.remade(error)]
    except DataError:
        return False, []


def _extract(config: Config, recording: str, limit: int | None) -> list[str]:
    """Cut a recording and store its gesture clips; return the notes on it."""
    path = _part_path(config, recording, limit)
    made_of = _made_of(config, [recording], *GestureMasterMethod.clip_settings)
    stored, notes = _is_stored(path, _PART, made_of)
    if stored:
        return notes
    reference = load_reference(config, recording, limit)
    described = describe_frames(reference, config)
    nodes = described.pop("key_nodes")
    stored_arrays.write(
        path,
        {
            "made_of": np.array(made_of),
            **extract(reference, config).arrays(),
            # A type of its own also for an empty list, of a skeleton without hands.
            **{
                f"described_{name}": np.array(value, dtype=str if _DESCRIBED[name].dtype == "str" else None)
                for name, value in described.items()
            },
            "key_frames": nodes.frames,
            "key_kinds": nodes.kinds,
            "key_words": nodes.keywords,
        },
    )
    return notes


def _read_part(path: Path) -> tuple[Gestures, dict]:
    stored = stored_arrays.read(path, _PART, mapped=True)
    described: dict[str, Any] = {
        name.removeprefix("described_"): value for name, value in stored.items() if "described_" in name
    }
    described |= {
        "joint_names": tuple(described["joint_names"].tolist()),
        "clip_names": tuple(described["clip_names"].tolist()),
        "fps": float(described["fps"]),
        "key_nodes": KeyNodes(stored["key_frames"], stored["key_kinds"], stored["key_words"]),
    }
    return Gestures(**{field.name: stored[field.name] for field in fields(Gestures)}), described


def _read_parts(config: Config, names: Sequence[str]) -> list[tuple[Gestures, dict]]:
    return [_read_part(_part_path(config, *pair)) for pair in zip(names, limits(config, names), strict=True)]


# --- edges --------------------------------------------------------------------------------------------------


def _block_path(library: Path, body: str, first: int) -> Path:
    return library.with_suffix(".blocks") / f"{body}-{first}.npz"


def _link(config: Config, names: tuple[str, ...], library: Path, body: str, first: int) -> list[str]:
    """Find and store the edges that lead to a block of clips; return the notes on it."""
    path = _block_path(library, body, first)
    made_of = _made_of(config, names, *GestureMasterMethod.settings)
    stored, notes = _is_stored(path, _BLOCK_KIND, made_of)
    if stored:
        return notes
    borders, delta = _borders(config.model_dump_json(by_alias=True), names, digests(config, names), body)
    last = min(first + BLOCK, len(borders[1].positions))
    edges = database.link(borders, body, delta, config, first, last)
    stored_arrays.write(path, {"made_of": np.array(made_of), **vars(edges), "delta": np.array(edges.delta)})
    return notes


@lru_cache(maxsize=1)
def _borders(config_json: str, names: tuple[str, ...], _digests: tuple[str, ...], body: str) -> tuple:
    """Compute the transitional frames of all clips, and delta_T; a worker keeps the last ones for its next block."""
    config = Config.model_validate_json(config_json)
    borders = database.all_borders([part for part, _ in _read_parts(config, names)], body, config)
    return borders, database.threshold(borders, body, config)


# --- the whole ----------------------------------------------------------------------------------------------


def build(job: Job) -> GestureDatabase:
    """Build a database from the parts that `prepare` has stored."""
    parts, described = zip(*_read_parts(job.config, job.names), strict=True)
    count = _n_clips(parts)
    edges = {}
    for body in BODIES:
        blocks = [Edges(**_edge_arrays(_block_path(job.path, body, first))) for first in range(0, count, BLOCK)]
        if blocks:  # without a gesture clip there are none, which `assemble` refuses
            edges[body] = Edges(
                np.append(0, np.cumsum(np.concatenate([np.diff(block.indptr) for block in blocks]))),
                np.concatenate([block.sources for block in blocks]),
                np.concatenate([block.costs for block in blocks]),
                blocks[0].delta,
            )
    return database.assemble(parts, join(described), edges, job.config)


def _n_clips(parts: Sequence[Gestures]) -> int:
    """Count the gesture clips with their mirrored copies."""
    return sum(len(part.starts) * len(part.positions) for part in parts)


def _edge_arrays(path: Path) -> dict:
    stored = stored_arrays.read(path, _BLOCK_KIND, mapped=True)
    return {name: stored[name] for name in ("indptr", "sources", "costs")} | {"delta": float(stored["delta"])}


def forget_blocks(library: Path) -> None:
    """Delete the stored blocks of edges, which are in the database now."""
    shutil.rmtree(library.with_suffix(".blocks"), ignore_errors=True)


def describe(found: GestureDatabase, config: Config) -> Description:
    """Describe a database for the output of `build-graph`."""
    own = ~found.mirrored[np.searchsorted(found.clip_starts, found.starts, side="right") - 1]
    seconds = found.lengths / found.fps
    lines = [
        f"{int(own.sum())} gesture clips of {seconds[own].mean():.1f} s on average, {int(found.rests[own].sum())} of "
        f"them rests, {'and as many mirrored, ' if found.mirrored.any() else ''}edges: {len(found.upper_sources)} "
        f"upper body (below {found.deltas[0]:.3g}), {len(found.lower_sources)} lower body (below {found.deltas[1]:.3g})"
    ]
    if np.isfinite(found.r2).all():
        lines.append(style.describe(found.regression))
    if len(found.dropped):
        named = "; ".join(f"{name} {reason}" for name, reason in found.dropped[:_MOST_DROPPED].tolist())
        more = f"; and {len(found.dropped) - _MOST_DROPPED} more" if len(found.dropped) > _MOST_DROPPED else ""
        lines.append(f"{len(found.dropped)} clips dropped: {named}{more}")
    notes = [*found.notes.tolist()]
    notes += [
        f"gesture_master.rhythm.corrections: {correction.clip!r} is none of these references"
        for correction in config.gesture_master.rhythm.corrections or ()
        if not any(is_listed(name, (correction.clip,)) for name in found.clip_names)
    ]
    return Description(lines, notes, _unmatched(found, config))


def _unmatched(found: GestureDatabase, config: Config) -> list[tuple[str, str, str]]:
    """List key, pattern and error of each pattern of `quality` that matches no gesture clip of a database."""
    known = [*found.names.tolist(), *found.dropped[:, 0].tolist()]
    return [
        (f"gesture_master.quality.{key}", pattern, problem)
        for key in ("include", "exclude")
        for pattern in getattr(config.gesture_master.quality, key)
        if (problem := without_match(f"gesture_master.quality.{key}", pattern, known, "gesture clip")) is not None
    ]


class StoredReferences(Sequence[clips.Reference]):
    """Sequence of references that are read on access and not kept, with mirrored copies after the recordings."""

    def __init__(self, config: Config, names: Sequence[str]):
        self.config, self.names = config, tuple(names)
        self.limits = limits(config, names)

    def __len__(self) -> int:
        return len(self.names) * (2 if self.config.gesture_master.mirror else 1)

    @overload
    def __getitem__(self, number: int) -> clips.Reference: ...

    @overload
    def __getitem__(self, number: slice) -> Sequence[clips.Reference]: ...

    def __getitem__(self, number: int | slice) -> clips.Reference | Sequence[clips.Reference]:
        if isinstance(number, slice):
            return [self[k] for k in range(*number.indices(len(self)))]
        if not 0 <= number < len(self):
            raise IndexError(number)
        copy, own = divmod(number, len(self.names))
        reference = load_reference(self.config, self.names[own], self.limits[own])
        return extraction.mirrored(reference, self.config) if copy else reference

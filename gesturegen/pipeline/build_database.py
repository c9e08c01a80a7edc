"""Gesture databases, which may be of a whole training set: built recording by recording and block by block.

What has been built of a recording is stored in `WORK/gestures`, and edges in blocks beside the database, until it is
complete: a build that was interrupted goes on where it stopped, and recordings are cut once for all databases.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import fields
from fnmatch import fnmatchcase
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gesturegen import __version__, files
from gesturegen.config import Config
from gesturegen.errors import DataError
from gesturegen.gestures import database, style
from gesturegen.gestures.database import GESTURE_SETTINGS, SETTINGS, Edges, GestureDatabase
from gesturegen.gestures.extraction import BODIES, Gestures, extract
from gesturegen.graph.reference_frames import describe as describe_frames
from gesturegen.graph.reference_frames import join, require_one_skeleton
from gesturegen.keynodes import KeyNodes
from gesturegen.methods import METHODS
from gesturegen.parallel import Outcome, for_each
from gesturegen.pipeline.common import clip_path, digests, limits, load_reference, work_path
from gesturegen.recordings import is_listed

if TYPE_CHECKING:
    from gesturegen.pipeline.build_graph import Library

# Clips that edges lead to, of one task.
BLOCK = 2000
# Named in the lines of `build-graph`; `inspect` lists all of them.
_MOST_DROPPED = 10


def prepare(libraries: Mapping[str, Library], jobs: int, label: str, quiet: bool, reuse: bool) -> Outcome:
    """Cut all recordings, then find all edges; whatever is stored already and current is kept.

    Returns errors and bugs by library.
    """
    todo = {name: library for name, library in libraries.items() if not (reuse and is_current(library))}
    different = {name: line for name, library in todo.items() if (line := _different_skeletons(library))}
    tasks, users = {}, {}
    for name, library in todo.items():
        if name in different:
            continue
        for recording, limit in zip(library.names, limits(library.config, library.names), strict=True):
            title = _part_path(library.config, recording, limit).stem
            tasks[title] = partial(_extract, library.config, recording, limit)
            users.setdefault(title, []).append(name)
    failed = failures(for_each(tasks, jobs, f"{label}: gestures", quiet), users) if tasks else Outcome()
    failed.errors |= different
    links, owners = {}, {}
    for name, library in todo.items():
        if name in failed.errors or name in failed.bugs:
            continue
        count = _n_clips([part for part, _ in _read_parts(library.config, library.names)])
        for body in BODIES:
            for first in range(0, count, BLOCK):
                title = f"{name}, {body} body, clips from {first}"
                links[title] = partial(_link, library.config, library.names, library.path, body, first)
                owners[title] = [name]
    linked = failures(for_each(links, jobs, f"{label}: edges", quiet), owners) if links else Outcome()
    return Outcome(errors=failed.errors | linked.errors, bugs=failed.bugs | linked.bugs)


def is_current(library: Library) -> bool:
    """Whether what is stored was built of these clips with these settings."""
    try:
        METHODS[library.config.method].load(library.path, library.config, digests(library.config, library.names))
    except DataError:
        return False
    return True


def _different_skeletons(library: Library) -> str | None:
    """Why recordings cannot share a database: stored parts do not know with which others they will be joined."""
    try:
        texts = [
            str(files.read_arrays(clip_path(library.config, name), only=("hierarchy",)).get("hierarchy"))
            for name in library.names
        ]
        for name, text in zip(library.names, texts, strict=True):
            if text != texts[0]:
                require_one_skeleton([load_reference(library.config, n, 1) for n in (library.names[0], name)])
    except DataError as error:
        return str(error)
    return None


def failures(outcome: Outcome, users: Mapping[str, Sequence[str]]) -> Outcome:
    """What failed, by the libraries that need it."""
    return Outcome(
        errors={name: error for title, error in outcome.errors.items() for name in users[title]},
        bugs={name: trace for title, trace in outcome.bugs.items() for name in users[title]},
    )


# --- gestures of a recording --------------------------------------------------------------------------------


def _part_path(config: Config, recording: str, limit: int | None) -> Path:
    # By settings: setups of an ablation cut the same recordings in different ways.
    settings = hashlib.sha256(config.section_json(*GESTURE_SETTINGS).encode()).hexdigest()[:12]
    cut = "" if limit is None else f"-{limit}f"
    return work_path(config, "gestures", f"{recording}{cut}-{settings}.npz")


def _made_of(config: Config, names: Sequence[str], *settings: str) -> str:
    """A hash of all that a stored part depends on."""
    parts = [__version__, config.section_json(*settings), *names, *digests(config, names)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _is_stored(path: Path, made_of: str) -> bool:
    try:
        return str(files.read_arrays(path)["made_of"]) == made_of
    except (DataError, KeyError):
        return False


def _extract(config: Config, recording: str, limit: int | None) -> None:
    path = _part_path(config, recording, limit)
    made_of = _made_of(config, [recording], *GESTURE_SETTINGS)
    if _is_stored(path, made_of):
        return
    reference = load_reference(config, recording, limit)
    described = describe_frames(reference, config)
    nodes = described.pop("key_nodes")
    files.write_arrays(
        path,
        {
            "made_of": np.array(made_of),
            **extract(reference, config).arrays(),
            **{f"described_{name}": np.array(value) for name, value in described.items()},
            "key_frames": nodes.frames,
            "key_kinds": nodes.kinds,
            "key_words": nodes.keywords,
        },
    )


def _read_part(path: Path) -> tuple[Gestures, dict]:
    stored = files.map_arrays(path)
    described = {name.removeprefix("described_"): value for name, value in stored.items() if "described_" in name}
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


def _link(config: Config, names: tuple[str, ...], library: Path, body: str, first: int) -> None:
    path = _block_path(library, body, first)
    made_of = _made_of(config, names, *SETTINGS)
    if _is_stored(path, made_of):
        return
    borders, delta = _borders(config.model_dump_json(by_alias=True), names, digests(config, names), body)
    last = min(first + BLOCK, len(borders[1].positions))
    edges = database.link(borders, body, delta, config, first, last)
    files.write_arrays(path, {"made_of": np.array(made_of), **vars(edges)})


@lru_cache(maxsize=1)
def _borders(config_json: str, names: tuple[str, ...], _digests: tuple[str, ...], body: str) -> tuple:
    """The transitional frames of all clips, and delta_T; a worker keeps the last ones for its next block."""
    config = Config.model_validate_json(config_json)
    borders = database.all_borders([part for part, _ in _read_parts(config, names)], body, config)
    return borders, database.threshold(borders, body, config)


# --- the whole ----------------------------------------------------------------------------------------------


def assemble(config: Config, names: Sequence[str], library: Path) -> GestureDatabase:
    """The database of what `prepare` has stored."""
    parts, described = zip(*_read_parts(config, names), strict=True)
    count = _n_clips(parts)
    edges = {}
    for body in BODIES:
        blocks = [Edges(**_edge_arrays(_block_path(library, body, first))) for first in range(0, count, BLOCK)]
        edges[body] = (
            Edges(
                np.append(0, np.cumsum(np.concatenate([np.diff(block.indptr) for block in blocks]))),
                np.concatenate([block.sources for block in blocks]),
                np.concatenate([block.costs for block in blocks]),
                blocks[0].delta,
            )
            if blocks
            else None
        )
    return database.assemble(parts, join(described), edges, config)


def _n_clips(parts: Sequence[Gestures]) -> int:
    """Gesture clips with their mirrored copies."""
    return sum(len(part.starts) * len(part.positions) for part in parts)


def _edge_arrays(path: Path) -> dict:
    stored = files.map_arrays(path)
    return {name: stored[name] for name in ("indptr", "sources", "costs")} | {"delta": float(stored["delta"])}


def forget_blocks(library: Path) -> None:
    """Edges are in the database now."""
    shutil.rmtree(library.with_suffix(".blocks"), ignore_errors=True)


def describe(found: GestureDatabase, config: Config) -> dict:
    """What to say of a database: `lines` and `notes`."""
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
        f"gesture_master.rhythm.corrections: {correction.clip!r} is none of these references; check its spelling"
        for correction in config.gesture_master.rhythm.corrections or ()
        if not any(is_listed(name, (correction.clip,)) for name in found.clip_names)
    ]
    known = [*found.names.tolist(), *found.dropped[:, 0].tolist()]
    for key in ("include", "exclude"):
        notes += [
            f"gesture_master.quality.{key}: {pattern!r} matches no gesture clip; `gesturegen inspect` lists them"
            for pattern in getattr(config.gesture_master.quality, key)
            if not any(fnmatchcase(name, pattern) for name in known)
        ]
    return {"lines": lines, "notes": notes}

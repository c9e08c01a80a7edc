"""The setups of a plan as changes to its base: from files, written in place, or all combinations of some axes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import product
from math import prod
from typing import Any

from gesturegen.errors import ConfigError
from gesturegen.settings.messages import brief
from gesturegen.settings.models import Config, Grid

# It is also the name of a folder.
_NAME = re.compile(r"\w[\w.+-]*")
_MOST_SETUPS = 1000
_SECTIONS = {field.alias or name for name, field in Config.model_fields.items()}


@dataclass(frozen=True)
class Changes:
    """Settings that differ from a base, and the line of each key in the file that they stand in."""

    values: Mapping[str, Any]
    lines: dict[tuple, int]


def written_in_place(entry: Any, key: tuple, lines: Mapping[tuple, int], origin: str) -> tuple[str, Changes]:
    """Read an element `{name: settings}` of the setups; ConfigError for anything else.

    key : its place in the file; lines : of all keys of the file, which errors call `origin`
    """
    where = f"{origin}:{lines[key]}: setups"
    if not isinstance(entry, dict) or len(entry) != 1:
        raise ConfigError(f"{where}: found {brief(entry)}, allowed: the name of a file, or one `name: settings`")
    ((name, values),) = entry.items()
    return _usable(name, where), _section(values, (*key, name), lines, where)


def combinations(grid: Grid, lines: Mapping[tuple, int], origin: str) -> Iterator[tuple[str, Changes, str]]:
    """Name each combination of a grid: yield name, settings, and the place in the file that errors tell.

    Raises ConfigError, of one line.
    """
    at = f"{origin}:{lines['grid',]}: grid"
    if not grid.axes:
        raise ConfigError(f"{at}.axes: there are none; add one, such as `search: [beam, global]`")
    axes = {axis: list(_points(axis, values, lines, origin)) for axis, values in grid.axes.items()}
    if (n_setups := prod(map(len, axes.values()))) > _MOST_SETUPS:
        raise ConfigError(f"{at}: {n_setups:,} combinations, at most {_MOST_SETUPS:,} are run; give shorter axes")
    pattern = "_".join(f"{{{axis}}}" for axis in axes) if grid.name is None else grid.name
    for axis in re.findall(r"\{([^{}]*)\}", pattern):
        if axis not in axes:
            raise ConfigError(
                f"{origin}:{lines['grid', 'name']}: grid.name: no axis {axis!r}; there are {', '.join(axes)}"
            )
    found: dict[str, Changes] = {}
    for points in product(*axes.values()):
        labels = dict(zip(axes, (label for label, _ in points), strict=True))
        name = _usable(_filled_in(pattern, labels), at)
        if name in found:
            raise ConfigError(f"{at}: two setups are called {name}; put every axis into `name`")
        found[name] = _together([changes for _, changes in points], at)
    for number, name in enumerate(grid.leave_out):
        if name not in found:
            near = get_close_matches(name, found, n=1, cutoff=0)
            raise ConfigError(
                f"{origin}:{lines['grid', 'leave_out', number]}: grid.leave_out: no setup {name!r}; did you mean {near[0]!r}?"
            )
    yield from ((name, changes, at) for name, changes in found.items() if name not in grid.leave_out)


def _filled_in(pattern: str, labels: Mapping[str, str]) -> str:
    """Replace each `{axis}` of a pattern by the label of this axis."""
    return re.sub(r"\{([^{}]*)\}", lambda match: labels[match[1]], pattern)


def _points(axis: str, values: Any, lines: Mapping[tuple, int], origin: str) -> Iterator[tuple[str, Changes]]:
    """Read the values of an axis: label, and the settings that it means."""
    key = ("grid", "axes", axis)
    where = f"{origin}:{lines[key]}: grid.axes.{axis}"
    path = tuple(axis.split("."))
    is_setting = path[0] in _SECTIONS
    if (not isinstance(values, dict) and not (is_setting and isinstance(values, list))) or not values:
        allowed = "values of this setting, as a list or by label" if is_setting else "settings by label"
        raise ConfigError(f"{where}: found {brief(values)}, allowed: {allowed}")
    for place, value in values.items() if isinstance(values, dict) else enumerate(values):
        label = place if isinstance(place, str) else value if isinstance(value, str) else json.dumps(value)
        if not is_setting:
            yield label, _section(value, (*key, place), lines, where)
            continue
        inner = _below((*key, place), lines)
        own = {path[:n]: lines[(*key, place)] for n in range(1, len(path) + 1)}
        changes = value
        for part in reversed(path):
            changes = {part: changes}
        yield label, Changes(changes, own | {(*path, *below): line for below, line in inner.items()})


def _section(values: Any, key: tuple, lines: Mapping[tuple, int], where: str) -> Changes:
    if values is not None and not isinstance(values, dict):
        raise ConfigError(f"{where}: {key[-1]}: found {brief(values)}, allowed: settings, such as `search: global`")
    return Changes(values or {}, _below(key, lines))


def _below(key: tuple, lines: Mapping[tuple, int]) -> dict[tuple, int]:
    """Select the lines of all that is below a key, by their path from there."""
    return {other[len(key) :]: line for other, line in lines.items() if other[: len(key)] == key != other}


def _together(parts: Sequence[Changes], where: str) -> Changes:
    """Merge the settings of several axes; ConfigError where two of them set the same."""
    values: dict[str, Any] = {}
    lines: dict[tuple, int] = {}
    for part in parts:
        for key in part.lines:
            if key in lines and not (_below(key, lines) and _below(key, part.lines)):
                raise ConfigError(f"{where}: two axes set {'.'.join(map(str, key))}; keep it in one")
        values = _merged(values, part.values)
        lines |= part.lines
    return Changes(values, lines)


def _merged(values: Mapping, others: Mapping) -> dict:
    both = {key: _merged(values[key], others[key]) for key in values.keys() & others.keys()}
    return {**values, **others, **both}


def _usable(name: str, where: str) -> str:
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f"{where}: {brief(name)} cannot be the name of a setup; use letters, digits, and `_`, `-`, `.`"
        )
    return name

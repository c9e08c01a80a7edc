"""YAML without its traps: a key that stands twice is an error, and every key knows its line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from gesturegen.errors import ConfigError


class _Loader(yaml.SafeLoader):
    """In plain YAML the last of two equal keys wins in silence, and `no` as a key is False."""


def _construct_mapping(loader: _Loader, node: yaml.MappingNode) -> dict:
    seen: dict[str, int] = {}
    for key_node, _ in node.value:
        key = loader.construct_object(key_node, deep=True)
        line = key_node.start_mark.line + 1
        if not isinstance(key, str):
            kind = type(key).__name__
            raise ConfigError(f"{loader.name}:{line}: key {key!r} is read by YAML as a {kind}; put it in quotes")
        if key in seen:
            raise ConfigError(f"{loader.name}:{line}: key {key!r} stands twice, first in line {seen[key]}; keep one")
        seen[key] = line
    return yaml.SafeLoader.construct_mapping(loader, node, deep=True)


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _construct_mapping)


def read(path: str | Path, hint: str = "check the path") -> Any:
    """The value of a YAML file; ConfigError with the line for what is missing or malformed.

    hint : what to do when the file cannot be read
    """
    return _compose(_read_text(path, hint), str(path))[0]


def parse(text: str, name: str) -> Any:
    """The value of a piece of YAML that errors call `name`."""
    return _compose(text, name)[0]


def read_mapping(path: str | Path, hint: str) -> tuple[dict[str, Any], dict[tuple, int]]:
    """The mapping of a YAML file (empty for an empty file), and the line of every key path and list element."""
    values, node = _compose(_read_text(path, hint), str(path))
    if node is None or values is None:
        return {}, {}
    if not isinstance(values, dict):
        raise ConfigError(f"{path}: expected `key: value` lines, found a {type(values).__name__}")
    lines: dict[tuple, int] = {}
    _note_lines(node, (), lines)
    return values, lines


def _note_lines(node: yaml.Node, at: tuple, lines: dict[tuple, int]) -> None:
    if isinstance(node, yaml.MappingNode):
        children = [(key.value, key.start_mark.line, value) for key, value in node.value]
    elif isinstance(node, yaml.SequenceNode):
        children = [(number, value.start_mark.line, value) for number, value in enumerate(node.value)]
    else:
        return
    for name, line, child in children:
        lines[(*at, name)] = line + 1
        _note_lines(child, (*at, name), lines)


def _read_text(path: str | Path, hint: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); {hint}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file in UTF-8") from None


def _compose(text: str, name: str) -> tuple[Any, yaml.Node | None]:
    try:
        loader = _Loader(text)
        loader.name = name
        try:
            node = loader.get_single_node()
            return (loader.construct_document(node) if node is not None else None), node
        finally:
            loader.dispose()
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f":{mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise ConfigError(f"{name}{where}: not valid YAML ({problem})") from None

"""Strict YAML: null, true and false, decimal numbers and text, and every key knows its line.

PyYAML parses; what a scalar means is decided here, as in the core schema of YAML 1.2 without its octal and
hexadecimal numbers: `no`, `2020-01-01`, `010`, `1:30`, `0x1F`, `1_000` and `.inf` are text, `1e-3` is a number.
Refused are keys that stand twice, tags, anchors, aliases, merge keys, several documents, control characters, more
than 50 levels, numbers of more than 18 digits, and files of more than 200 kB.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml
from yaml.parser import Parser
from yaml.reader import Reader
from yaml.scanner import Scanner

from gesturegen import inputs
from gesturegen.errors import ConfigError

# PyYAML reads 100 kB a second.
MOST_BYTES = 200_000
MOST_LEVELS = 50
MOST_DIGITS = 18
_CONSTANTS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_INTEGER = re.compile(r"[-+]?(?:0|[1-9][0-9]*)")
_REAL = re.compile(r"[-+]?(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")


def read(path: str | Path, hint: str = "check the path") -> Any:
    """Read the value of a YAML file; ConfigError with the line for what is missing or malformed.

    hint : what to do when the file cannot be read
    """
    return _Document(_read_text(path, hint), inputs.shown(path)).value


def parse(text: str, name: str) -> Any:
    """Parse a piece of YAML that errors call `name`."""
    return _Document(text, inputs.shown(name)).value


def read_mapping(path: str | Path, hint: str) -> tuple[dict[str, Any], dict[tuple, int]]:
    """Read the mapping of a YAML file (empty for an empty file), and the line of every key path and list element."""
    document = _Document(_read_text(path, hint), inputs.shown(path))
    if document.value is None:
        return {}, {}
    if not isinstance(document.value, dict):
        raise ConfigError(f"{inputs.shown(path)}: expected `key: value` lines, found a {type(document.value).__name__}")
    return document.value, document.lines


def _read_text(path: str | Path, hint: str) -> str:
    raw = inputs.read_bytes(path, MOST_BYTES, ConfigError, hint)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ConfigError(f"{inputs.shown(path)}:{line}: not a text file in UTF-8; save it as UTF-8") from None


class _Events(Reader, Scanner, Parser):
    """PyYAML's parser without its resolver and constructors."""

    def __init__(self, text: str):
        Reader.__init__(self, text)
        Scanner.__init__(self)
        Parser.__init__(self)


class _Document:
    """The value of one document, and the line of every key path and list element in it."""

    def __init__(self, text: str, name: str):
        self.name = name
        self.lines: dict[tuple, int] = {}
        self.line = 1
        self.key: tuple[str | int, ...] = ()
        if len(text) > MOST_BYTES:
            raise ConfigError(f"{name}: {len(text):,} characters, at most {MOST_BYTES:,} are read; give less")
        try:
            self.events = _Events(text)
            self.value = self._read_document()
        except yaml.YAMLError as error:
            mark = getattr(error, "problem_mark", None)
            line = mark.line if mark else text.count("\n", 0, getattr(error, "position", 0))
            problem = getattr(error, "problem", None) or str(error).splitlines()[0]
            # What is no character at all stands in no line of a text that an editor shows.
            where = f":{line + 1}" if mark or "\n" in text else ""
            raise ConfigError(f"{name}{where}: not valid YAML ({inputs.shown(problem)})") from None
        except (ValueError, OverflowError, RecursionError) as error:  # of PyYAML, as for "\U00110000"
            raise self._fail(f"not valid YAML ({inputs.shown(error)})") from None

    def _fail(self, message: str) -> ConfigError:
        key = inputs.shown(".".join(map(str, self.key)))
        return ConfigError(f"{self.name}:{self.line}: {key + ': ' if key else ''}{message}")

    def _read_document(self) -> Any:
        self.events.get_event()  # the stream starts
        if self.events.check_event(yaml.StreamEndEvent):
            return None
        self.events.get_event()  # the document starts
        value = self._read_value(())
        self.events.get_event()  # the document ends
        event = self.events.peek_event()
        if not isinstance(event, yaml.StreamEndEvent):
            self.line, self.key = event.start_mark.line + 1, ()
            raise self._fail("a second document starts here; keep one in a file")
        return value

    def _read_value(self, key: tuple) -> Any:
        event = self.events.get_event()
        self.line, self.key = event.start_mark.line + 1, key
        if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
            sign = "*" if isinstance(event, yaml.AliasEvent) else "&"
            raise self._fail(f"`{sign}{event.anchor}`: anchors and aliases are not read; write the value out")
        if event.tag is not None:
            raise self._fail(f"the tag {inputs.shown(event.tag)} is not read; leave it out, and put a text in quotes")
        if isinstance(event, yaml.ScalarEvent):
            return self._scalar(event)
        if len(key) >= MOST_LEVELS:
            raise self._fail_deep()
        return self._mapping(key) if isinstance(event, yaml.MappingStartEvent) else self._sequence(key)

    def _fail_deep(self) -> ConfigError:
        self.key = tuple(key for key in self.key[:1] if isinstance(key, str))
        return self._fail(f"more than {MOST_LEVELS} levels; no setting has so many")

    def _sequence(self, key: tuple) -> list:
        values: list[Any] = []
        while not self.events.check_event(yaml.SequenceEndEvent):
            own = (*key, len(values))
            self.lines[own] = self.events.peek_event().start_mark.line + 1
            values.append(self._read_value(own))
        self.events.get_event()
        return values

    def _mapping(self, key: tuple) -> dict[str, Any]:
        values: dict[str, Any] = {}
        while not self.events.check_event(yaml.MappingEndEvent):
            plain = getattr(self.events.peek_event(), "style", None) is None
            name = self._read_value(key)
            if isinstance(name, (list, dict)):
                raise self._fail(f"a {type(name).__name__} as a key; a key is a word")
            if not isinstance(name, str):
                raise self._fail(f"key {name!r} is read by YAML as a {type(name).__name__}; put it in quotes")
            if name == "<<" and plain:
                raise self._fail("merge keys (`<<`) are not read; write the values out")
            own = (*key, name)
            if name in values:
                raise self._fail(f"key {name!r} stands twice, first in line {self.lines[own]}; keep one")
            self.lines[own] = self.line
            values[name] = None
            values[name] = self._read_value(own)
        self.events.get_event()
        return values

    def _scalar(self, event: yaml.ScalarEvent) -> Any:
        text = event.value
        if (control := inputs.control_character(text)) is not None:
            raise self._fail(f"holds a line break or control character ({control}); write it in one line without")
        if event.style is not None:
            return text
        if text in _CONSTANTS:
            return _CONSTANTS[text]
        if _INTEGER.fullmatch(text):
            digits = len(text.lstrip("+-"))
            if digits > MOST_DIGITS:
                raise self._fail(
                    f"a number of {digits:,} digits, at most {MOST_DIGITS} are read; write it shorter, or a text in quotes"
                )
            return int(text)
        if _REAL.fullmatch(text):
            number = inputs.decimal(text)
            if number is None or abs(number) == float("inf"):
                raise self._fail(f"{inputs.shown(text[:30])} is too large or too long for a number; write it shorter")
            return number
        return text

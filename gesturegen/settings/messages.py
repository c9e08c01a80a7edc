"""Messages about mistakes in settings: the file, the line, the key, what was found and what is allowed."""

from __future__ import annotations

import json
import re
from collections.abc import Collection
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from gesturegen import inputs
from gesturegen.errors import ConfigError
from gesturegen.settings.base import MOST_MISTAKES, Section


def validated(
    model: type[Section], values: dict, origin: str, lines: dict[tuple, int], set_keys: Collection[tuple] = ()
) -> Any:
    """Validate values as a model; ConfigError with one line a mistake, with the line in the file or `--set`."""
    try:
        return model.model_validate_json(json.dumps(values, default=str))
    except ValidationError as error:
        problems = [problem for problem in error.errors() if not _of_other_member(problem)]
        problems.sort(key=lambda problem: _line(_key(problem), lines) or 0)
        mistakes = [_describe(problem, model, origin, lines, set_keys) for problem in problems[:MOST_MISTAKES]]
        if len(problems) > MOST_MISTAKES:
            mistakes.append(f"{origin}: and {len(problems) - MOST_MISTAKES} more")
        raise ConfigError("\n".join(dict.fromkeys(mistakes))) from None


def _of_other_member(problem: ErrorDetails) -> bool:
    """Tell whether an error only says that a list of joints is not `all`: a list is wrong for its elements only."""
    return (
        problem["loc"][:1] == ("joints",) and problem["type"] == "literal_error" and isinstance(problem["input"], list)
    )


def _key(problem: ErrorDetails) -> tuple:
    """Return the path of the key that one of pydantic's errors is about."""
    # What is wrong with several sections together names the key to look at.
    key = tuple(problem["loc"]) or tuple(problem.get("ctx", {}).get("key", "").split("."))
    if key[:1] == ("joints",):
        # The union adds the member it tried to the path; an index into the list may follow.
        key = ("joints", *(part for part in key[1:] if isinstance(part, int)))
    return key


def _line(key: tuple, lines: dict[tuple, int]) -> int | None:
    """Return the line of a key, or of the nearest section around it that is in the file."""
    return next((lines[key[:n]] for n in range(len(key), 0, -1) if key[:n] in lines), None)


def _describe(
    problem: ErrorDetails, top: type[Section], origin: str, lines: dict[tuple, int], set_keys: Collection[tuple]
) -> str:
    """Describe one of pydantic's errors in one line."""
    key = _key(problem)
    if any(key[: len(parts)] == parts[: len(key)] for parts in set_keys):
        where = "--set"
    else:
        line = _line(key, lines)
        where = f"{origin}:{line}" if line else origin
    name = ".".join(str(part) for part in key) or "the whole file"
    if problem["type"] == "extra_forbidden":
        known = _keys_beside(key, top)
        near = get_close_matches(str(key[-1])[:100], known, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}?" if near else f"allowed here: {', '.join(known)}"
        return f"{where}: unknown key {inputs.shown(name)!r}; {hint}"
    if problem["type"] == "missing":
        return f"{where}: {name}: missing; add this key"
    found, allowed = problem["input"], allowed_text(problem["msg"])
    if problem["type"] == "value_error":
        return f"{where}: {name}: {allowed}"
    if key == ("joints",):
        allowed = "'all' or a list of joint names"
    return f"{where}: {name}: found {brief(found)}, allowed: {allowed}{_hint(found, problem['type'])}"


def allowed_text(message: str) -> str:
    """Rephrase a message of pydantic, which is in terms of JSON, in terms of YAML."""
    message = message.removeprefix("Value error, ").removeprefix("Input should be ")
    message = message.replace("an object", "a section").replace("a valid array", "a list")
    return message[0].lower() + message[1:]


def brief(found: Any) -> str:
    """Format a value that was found for a message, cut when it is long."""
    text = inputs.shown(json.dumps(found, ensure_ascii=False))
    return text if len(text) <= 80 else text[:77] + "..."


def _hint(found: Any, problem: str) -> str:
    """Guess what is meant by a text that other readers of YAML take for a number or for a bool."""
    if problem == "string_type" and isinstance(found, (bool, int, float)):
        return " (put it in quotes)"
    if not isinstance(found, str) or not problem.startswith(("int_", "float_", "bool_", "bound")):
        return ""
    return next((f" ({hint})" for pattern, hint in _HINTS if pattern.fullmatch(found)), "")


def _keys_beside(key: tuple, top: type[Section]) -> list[str]:
    """List the keys that the section around `key` does have."""
    model: Any = top
    for part in key[:-1]:
        if isinstance(part, int):
            continue
        field = next((f for name, f in model.model_fields.items() if (f.alias or name) == part), None)
        model = _section_within(field.annotation) if field else top
    return [field.alias or name for name, field in model.model_fields.items()]


def _section_within(annotation: Any) -> Any:
    """Return the model that a field is, or that its list is of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_section_within, get_args(annotation))), None)


_HINTS = tuple(
    (re.compile(pattern, re.I), hint)
    for pattern, hint in (
        (r"[-+]?0[0-9]+(\.[0-9]*)?", "this is text; write the number without a leading zero"),
        (r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)(e[-+]?[0-9]+)?", "this is text; write the number without quotes"),
        (r"[-+]?[0-9][0-9,_']*(\.[0-9_]*)?", "this is text; write the number with digits and a decimal point alone"),
        (r"[-+]?[0-9]+(:[0-9]+)+(\.[0-9]*)?", "this is text; write seconds as a decimal number"),
        (r"0x[0-9a-f]+|0o[0-7]+|0b[01]+", "this is text; write a decimal number"),
        (r"[-+]?\.?inf(inity)?|\.?nan", "this is text; write a finite number"),
        (r"yes|no|on|off|y|n|true|false", "this is text; write true or false, without quotes"),
    )
)

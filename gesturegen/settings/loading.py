"""Settings are read from YAML files, laid one over another, and completed by the files that they name."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gesturegen import inputs, strict_csv, strict_yaml
from gesturegen.errors import ConfigError
from gesturegen.methods.sections import LISTS
from gesturegen.settings.base import Section
from gesturegen.settings.control import Schedule
from gesturegen.settings.messages import allowed_text, brief, validated
from gesturegen.settings.models import Config, PlanFile, no_control
from gesturegen.settings.speech import Keywords


def configs_folder() -> Path:
    """The folder of the configs that come with gesturegen: inside an installed wheel, else of the checkout."""
    package = Path(__file__).parent.parent
    inside = package / "configs"
    return inside if inside.is_dir() else package.parent / "configs"


def load_config(
    path: str | Path | None = None, overrides: Sequence[str] = (), folders: Mapping[str, str] | None = None
) -> Config:
    """Settings from a YAML file (the defaults without one), then `key.path=value` overrides in order.

    folders : key path -> folder name, taken to the letter, for options that name a folder

    Raises ConfigError with one line per mistake.
    """
    origin = "--set"
    values: dict[str, Any] = {}
    lines: dict[tuple, int] = {}
    if path is not None:
        origin = inputs.shown(path)
        values, lines = strict_yaml.read_mapping(path, "give an existing file with --config")
    set_keys = set()
    for override in overrides:
        set_keys.add(_apply_override(values, override))
    for key, folder in (folders or {}).items():
        if (control := inputs.control_character(folder)) is not None:
            raise ConfigError(f"{inputs.shown(folder)}: the name holds {control}; rename the folder ({key})")
        section, name = key.split(".")
        if values.get(section) is None:
            values[section] = {}
        if isinstance(values[section], dict):  # anything else is refused below
            values[section][name] = folder
    config = validated(Config, values, origin, lines, set_keys)
    return _with_files(config, Path(path).parent if path is not None else None)


def layer_config(base: Config, changes: Mapping, lines: dict[tuple, int], path: str | Path) -> Config:
    """`base` with changes that stand in a YAML file, at these lines of it; ConfigError as by `load_config`."""
    values = json.loads(base.model_dump_json(by_alias=True))
    if "keywords" in changes:
        values["keywords"] = {}  # the base's words were read in, and would win over another file
    for section, part, file, rows, _ in LISTS:  # likewise
        if file in _section(_section(changes, section), part):
            values[section][part][rows] = None
    if "file" in _section(changes, "control"):
        values["control"] |= {"conditions": [], "gestures": []}
    return _with_files(validated(Config, _merged(values, changes), inputs.shown(path), lines), Path(path).parent)


def _section(values: Mapping, name: str) -> dict:
    """A section of a file that is not validated yet; empty where it is missing or no section."""
    section = values.get(name)
    return section if isinstance(section, dict) else {}


def _merged(values: dict, changes: Mapping) -> dict:
    """`values` with `changes` laid over them, section by section."""
    merged = dict(values)
    for key, value in changes.items():
        both = isinstance(value, dict) and isinstance(values.get(key), dict)
        merged[key] = _merged(values[key], value) if both else value
    return merged


def load_plan_file(path: str | Path) -> tuple[PlanFile, dict[tuple, int]]:
    """A plan of setups and seeds, and the line of each of its keys; ConfigError as by `load_config`."""
    values, lines = strict_yaml.read_mapping(path, "give an existing plan of setups with --config")
    return validated(PlanFile, values, inputs.shown(path), lines), lines


def _apply_override(values: dict, override: str) -> tuple:
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        raise ConfigError(f"--set {brief(override)}: expected key=value, such as continuity.l_pn=1")
    value = strict_yaml.parse(text, f"--set {override if len(override) <= 80 else override[:77] + '...'}")
    parts = tuple(key.strip().split("."))
    if len(parts) > strict_yaml.MOST_LEVELS or inputs.control_character(key):
        raise ConfigError(f"--set {brief(override)}: no such key; expected key=value, such as continuity.l_pn=1")
    place = values
    for part in parts[:-1]:
        if place.get(part) is None:
            place[part] = {}
        place = place[part]
        if not isinstance(place, dict):
            raise ConfigError(f"--set {brief(override)}: {inputs.shown(part)!r} is no section")
    place[parts[-1]] = value
    return parts


def _with_files(config: Config, folder: Path | None) -> Config:
    """Read the lists that are kept in files into the config, so that nothing later depends on where they were kept."""
    config = _with_keywords(config, folder)
    for section, part, file, rows, model in LISTS:
        outer = getattr(config, section)
        settings = getattr(outer, part)
        name = getattr(settings, file)
        if name is not None and getattr(settings, rows) is None:
            path = _beside(name, folder, f"{section}.{part}.{file}")
            settings = settings.model_copy(update={rows: _read_list(path, model, settings, rows)})
            config = config.model_copy(update={section: outer.model_copy(update={part: settings})})
    return _with_control(config, folder)


def _beside(name: str, folder: Path | None, key: str) -> Path:
    """A file named in a config: beside the config, or by its path."""
    places = [place / name for place in ([folder] if folder else []) + [Path()]]
    path = next((place for place in places if inputs.is_file(place)), None)
    if path is None:
        raise ConfigError(
            f"{key}: {inputs.shown(name)!r} does not exist (looked at {', '.join(map(inputs.shown, places))})"
        )
    return path


def _read_list(path: Path, model: type[Section], settings: Section, rows: str) -> tuple:
    """The rows of a CSV file as models that `settings` may hold in `rows`; the columns are the model's keys."""
    columns = {field.alias or name: field.is_required() for name, field in model.model_fields.items()}
    found = []
    for line, row in strict_csv.read_rows(path, columns, "check the path"):
        try:
            # Not strict: every cell of a CSV file is text.
            found.append(model.model_validate({key: cell for key, cell in row.items() if cell}, strict=False))
            type(settings).model_validate(dict(settings) | {rows: tuple(found[-1:])})
        except ValidationError as error:
            problem = error.errors()[0]
            key, allowed = ".".join(map(str, problem["loc"])), allowed_text(problem["msg"])
            wrong = f"{key}: found {brief(problem['input'])}, allowed: {allowed}" if key else allowed
            raise ConfigError(f"{inputs.shown(path)}:{line}: {wrong}") from None
    return tuple(found)


def _with_keywords(config: Config, folder: Path | None) -> Config:
    if config.keywords.words is not None:
        words = _lower_cased(config.keywords.words, "keywords.words")
        return config.model_copy(update={"keywords": Keywords(file=config.keywords.file, words=words)})
    name = config.keywords.file or "keywords.yaml"
    places = [*([folder] if folder else []), Path(), configs_folder()]
    path = next((place / name for place in places if inputs.is_file(place / name)), None)
    if path is None:
        tried = ", ".join(inputs.shown(place / name) for place in places)
        raise ConfigError(f"keywords.file: {inputs.shown(name)!r} does not exist (looked at {tried})")
    words = strict_yaml.read(path)
    if not isinstance(words, dict) or not all(isinstance(value, str) for value in words.values()):
        raise ConfigError(
            f"{inputs.shown(path)}: expected `word: keyword` lines with text on both sides; "
            "put words such as true and null in quotes"
        )
    words = _lower_cased(words, inputs.shown(path))
    return config.model_copy(update={"keywords": Keywords(file=config.keywords.file, words=words)})


def _with_control(config: Config, folder: Path | None) -> Config:
    control = config.control
    # A config that was read before has one list at least, and must not look for the file in another folder.
    if control.file is None or control.conditions or control.gestures:
        return config
    path = _beside(control.file, folder, "control.file")
    values, lines = strict_yaml.read_mapping(path, "check control.file")
    origin = inputs.shown(path)
    schedule = validated(Schedule, values, origin, lines)
    if not (schedule.conditions or schedule.gestures):
        raise ConfigError(f"{origin}: neither conditions nor gestures in it; add some, or leave out control.file")
    if schedule.conditions and not config.controls:
        raise ConfigError(f"{origin}: conditions: {no_control()}")
    return config.model_copy(update={"control": control.model_copy(update=dict(schedule))})


def _lower_cased(words: Mapping[str, str], where: str) -> dict[str, str]:
    """Words as transcripts have them after normalization; ConfigError for what can never match."""
    lower: dict[str, str] = {}
    for word, keyword in sorted(words.items()):
        if not word.strip() or len(word.split()) != 1:
            raise ConfigError(f"{where}: {inputs.shown(word)!r} is not one word, so no transcript can match it")
        if lower.setdefault(word.lower(), keyword) != keyword:
            raise ConfigError(f"{where}: {inputs.shown(word)!r} stands twice with different keywords; keep one")
    return lower

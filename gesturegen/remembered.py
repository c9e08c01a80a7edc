"""The settings that a work folder remembers, in `WORK/config.yaml`.

Commands that make motion write the settings they run with there. Later commands take them from there when they are
given no others, so that nobody overwrites a good result by forgetting an option. Places of files are kept as seen
from the work folder, since it may be moved together with the data.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gesturegen import files, inputs, strict_yaml
from gesturegen.errors import ConfigError, GesturegenError
from gesturegen.settings.loading import configs_folder, load_config
from gesturegen.settings.models import PLACES, Config

NAME = "config.yaml"
_CHECKSUM = "# sha256: "
RECOMMENDED = "best"
SETTINGS, PLANS = "settings, for --config of every command", "plans, for --config of `ablate` and `compare`"
OTHERS = "files that settings name"
_FOLDERS = ("paths.data", "data.references", "data.tests")
_PLACES = (*_FOLDERS, "control.library", "refiner.checkpoint", "references.list")
# What is measured does not change what was made, and a work folder may be moved.
_HARMLESS = ("paths.work", "evaluation", *(key for key in PLACES if key.endswith("file")))
_MOST_KEYS = 6


def shipped(name: str | os.PathLike[str]) -> Path:
    """Find the file that `--config` means: an existing one, or the config of that name that comes with gesturegen.

    Raises ConfigError for neither, with the names that there are.
    """
    if inputs.is_file(name) or len(Path(name).parts) != 1 or Path(name).suffix:
        return Path(name)
    if inputs.is_file(path := configs_folder() / f"{name}.yaml"):
        return path
    names = ", ".join(sorted(path.stem for path in configs_folder().glob("*.yaml")))
    raise ConfigError(
        f"{inputs.shown(name)}: neither a file nor a config that comes with gesturegen; those are {names}"
    )


def listing() -> dict[str, list[tuple[str, str]]]:
    """List the configs that come with gesturegen by purpose, with name and the first sentence of each file."""
    found: dict[str, list[tuple[str, str]]] = {key: [] for key in (SETTINGS, PLANS, OTHERS)}
    for path in sorted(configs_folder().glob("*.yaml")):
        values = strict_yaml.read(path)
        kind = (
            PLANS
            if values.keys() & {"setups", "grid"}
            else SETTINGS
            if values.keys() <= Config.model_fields.keys()
            else OTHERS
        )
        found[kind].append((path.stem, _first_sentence(path)))
    return found


def _first_sentence(path: Path) -> str:
    comment = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        comment.append(line.lstrip("# "))
    return re.split(r"(?<!et al)\. ", " ".join(comment))[0].rstrip(".")


def load(path: Path | None, overrides: Sequence[str], folders: Mapping[str, str]) -> tuple[Config, str | None]:
    """Load the settings of a command from the given file, else the work folder, else the recommended config.

    overrides, folders : as in `load_config`. The second value says in one line which settings were taken, None where
    a file was given. Raises ConfigError.
    """
    if path is not None:
        return load_config(shipped(path), overrides, folders), None
    kept = _work(overrides, folders) / NAME
    if inputs.is_file(kept):
        if not _is_whole(kept):
            raise ConfigError(
                f"{inputs.shown(kept)}: not as it was written; give the settings with --config, or delete the file"
            )
        return load_config(kept, overrides, remembered_folders(overrides, folders)), f"settings: {inputs.shown(kept)}"
    line = f"settings: {RECOMMENDED}, the recommended ones (--config takes others, `gesturegen configs` lists them)"
    return load_config(shipped(RECOMMENDED), overrides, folders), line


def remembered_folders(overrides: Sequence[str], folders: Mapping[str, str]) -> dict[str, str]:
    """Add to `folders` the remembered places that neither `folders` nor `overrides` name."""
    work = _work(overrides, folders)
    if not inputs.is_file(work / NAME) or not _is_whole(work / NAME):
        return dict(folders)
    values, _ = strict_yaml.read_mapping(work / NAME, "check the work folder")
    named = {override.partition("=")[0].strip() for override in overrides} | folders.keys()
    # Other recordings than the remembered ones are asked for by any of the three.
    places = _PLACES if named.isdisjoint(_FOLDERS) else tuple(key for key in _PLACES if key not in _FOLDERS)
    found = {key: _get(values, key) for key in places if key not in named}
    return {key: _seen_from(work, value) for key, value in found.items() if isinstance(value, str)} | dict(folders)


def _work(overrides: Sequence[str], folders: Mapping[str, str]) -> Path:
    if "paths.work" in folders:
        return Path(folders["paths.work"])
    named = [value.strip() for key, _, value in (o.partition("=") for o in overrides) if key.strip() == "paths.work"]
    return Path(named[-1] if named else Config().paths.work)


def _seen_from(work: Path, value: str) -> str:
    """Convert a stored place, relative to the work folder, to one relative to the current folder."""
    return value if Path(value).is_absolute() else os.path.relpath(Path(os.path.realpath(work)) / value)


def _is_whole(path: Path) -> bool:
    """Tell whether a file of remembered settings is as it was written."""
    text, sign, checksum = inputs.read_bytes(path, strict_yaml.MOST_BYTES, ConfigError).rpartition(_CHECKSUM.encode())
    return bool(sign) and checksum.strip() == hashlib.sha256(text).hexdigest().encode()


@contextmanager
def kept(config: Config, force: bool, say: Callable[[str], None]) -> Iterator[None]:
    """Keep the settings in the work folder for later commands; ConfigError if it has results of other settings.

    say : is given a line for a damaged file that is written anew.

    When the block is refused before anything was made, a folder that remembered nothing remembers nothing.
    """
    work = Path(config.paths.work)
    path = work / NAME
    before = path.read_bytes() if inputs.is_file(path) else None
    text = to_text(config, work)
    if before != text.encode():
        if before is not None and not _is_whole(path):
            say(f"warning: {inputs.shown(path)}: not as it was written; written anew with the settings of this command")
        elif before is not None and not force and inputs.is_file(work / "reenact" / "manifest.json"):
            _require_same(config)
        files.write_text(path, text)
    try:
        yield
    except GesturegenError:
        if before is None and not (work / "clips").exists():
            path.unlink(missing_ok=True)
        raise


def write(config: Config, work: Path) -> None:
    """Write settings into another folder for later commands, such as that of a variant."""
    files.write_text(work / NAME, to_text(config, work))


def to_text(config: Config, work: Path) -> str:
    """Format all settings as YAML that `load` reads, with places as seen from the work folder."""
    import yaml

    values = _values(config)
    del values["paths"]["work"]
    for key in _PLACES:
        section, name = key.split(".")
        if (place := values[section][name]) is not None:
            values[section][name] = Path(os.path.relpath(os.path.realpath(place), os.path.realpath(work))).as_posix()
    head = (
        "# The settings of this folder, kept by gesturegen. Later commands take them when they are given no others.\n"
    )
    text = head + yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=120)
    return f"{text}{_CHECKSUM}{hashlib.sha256(text.encode()).hexdigest()}\n"


def changed_yaml(config: Config, without: Sequence[str]) -> str:
    """Format as YAML the settings that differ from the defaults, except places and the sections `without`."""
    import yaml

    plain = _values(Config())
    changed = _changed(_values(config), plain)
    for key in ("paths", "data", "keywords", *without):
        changed.pop(key, None)
    return yaml.safe_dump(changed, sort_keys=False, allow_unicode=True, width=120) if changed else ""


def _changed(values: Mapping[str, Any], plain: Mapping[str, Any]) -> dict[str, Any]:
    found = {}
    for name, value in values.items():
        if value != plain[name]:
            inner = isinstance(value, dict) and isinstance(plain[name], dict)
            found[name] = _changed(value, plain[name]) if inner else value
    return found


def _values(config: Config) -> dict[str, Any]:
    return json.loads(config.model_dump_json(by_alias=True))


def differences(config: Config) -> list[str]:
    """Describe the settings in which `config` differs from those that its work folder remembers."""
    path = Path(config.paths.work) / NAME
    if not inputs.is_file(path) or not _is_whole(path):
        return []
    folders = {"paths.work": str(path.parent)}
    there = _flat(_values(load_config(path, (), remembered_folders((), folders))))
    here = _flat(_values(config))
    return [
        f"{key}: {_shown(here.get(key))} (there {_shown(there.get(key))})"
        for key in sorted(here.keys() | there.keys(), key=lambda key: (key.count("."), key))
        if not any(key == harmless or key.startswith(f"{harmless}.") for harmless in _HARMLESS)
        and _settled(key, here.get(key)) != _settled(key, there.get(key))
    ]


def _require_same(config: Config) -> None:
    """Raise ConfigError with the settings in which `config` differs from the remembered ones."""
    if differing := differences(config):
        more = f", and {len(differing) - _MOST_KEYS} more" if len(differing) > _MOST_KEYS else ""
        raise ConfigError(
            f"{inputs.shown(config.paths.work)}: holds results of other settings: "
            f"{', '.join(differing[:_MOST_KEYS])}{more}; give another folder with --work, leave the options out, or add "
            "--force to make them anew"
        )


def _settled(key: str, value: Any) -> Any:
    """Return a value as it is compared: a place by what it leads to."""
    return os.path.realpath(value) if key in _PLACES and isinstance(value, str) else value


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _flat(values: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in values.items():
        found |= _flat(value, f"{above}{name}.") if isinstance(value, dict) else {f"{above}{name}": value}
    return found


def _get(values: Mapping[str, Any], key: str) -> Any:
    found: Any = values
    for name in key.split("."):
        found = found.get(name) if isinstance(found, dict) else None
    return found

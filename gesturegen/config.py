"""Settings: frozen models, read from YAML, strict.

A config file holds only what it changes; the defaults are the paper's (`configs/casia_go_2023.yaml` spells
them all out). An unknown key, a wrong type or a value out of range is refused with the file, the line, the
key's path, what was found, what is allowed and, for a typo, the nearest key.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from gesturegen.errors import ConfigError

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(ge=0, le=1)]

GENEA_JOINTS = (
    "b_root", "b_spine0", "b_spine1", "b_spine2", "b_spine3", "b_neck0", "b_head",
    "b_r_shoulder", "b_r_arm", "b_r_arm_twist", "b_r_forearm", "b_r_wrist_twist", "b_r_wrist",
    "b_r_upleg", "b_r_leg", "b_r_foot",
    "b_l_shoulder", "b_l_arm", "b_l_arm_twist", "b_l_forearm", "b_l_wrist_twist", "b_l_wrist",
    "b_l_upleg", "b_l_leg", "b_l_foot",
)  # fmt: skip


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Paths(_Section):
    data: str = "data"
    work: str = "work"


class Data(_Section):
    reference_split: str = "trn"
    test_split: str = "tst"
    truth_split: str | None = None
    references: str | None = None
    tests: str | None = None


class Wrists(_Section):
    enabled: bool = True
    joints: tuple[str, ...] = ("b_l_wrist", "b_r_wrist", "b_l_wrist_twist", "b_r_wrist_twist")
    axes: Literal["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"] = "XYZ"
    window: Annotated[int, Field(ge=3)] = 15
    order: Annotated[int, Field(ge=0)] = 3

    @model_validator(mode="after")
    def _filter_exists(self):
        if self.window % 2 == 0 or self.order >= self.window:
            raise ValueError("window must be odd and larger than order")
        return self


class ExcludedRange(_Section):
    clip: str
    from_: Annotated[float, Field(ge=0, alias="from")]
    to: Positive

    @model_validator(mode="after")
    def _not_empty(self):
        if self.to <= self.from_:
            raise ValueError("`to` must be later than `from`")
        return self


class References(_Section):
    mode: Literal["per_test_clip", "k", "speaker", "all", "list"] = "per_test_clip"
    k: Count = 1
    list_file: Annotated[str | None, Field(alias="list")] = None

    @model_validator(mode="after")
    def _list_given(self):
        if self.mode == "list" and self.list_file is None:
            raise ValueError(
                "mode `list` needs the key `references.list`, a YAML file that pins references to test clips"
            )
        return self


class Onsets(_Section):
    min_strength: NotNegative = 5.0
    sample_rate: Count = 22050
    hop_length: Count = 512
    muted_min_seconds: NotNegative = 0.1
    muted_max_seconds: NotNegative = 3.0
    muted_margin_seconds: NotNegative = 0.05
    muted_max_share: Share = 0.2


class Keywords(_Section):
    file: str | None = None
    words: dict[str, str] | None = None


class Breaks(_Section):
    max_joint_speed: Positive | None = None


class Positions(_Section):
    relative_to: Literal["root", "root_heading", "world"] = "root"
    root_joint: str = "b_root"
    scale: Positive = 1.0


class Continuity(_Section):
    lambda_pos: NotNegative = 1.0
    lambda_vel: NotNegative = 1.0
    l_cn: Count = 5
    l_pn: Count = 10


class Beam(_Section):
    l_npaths: Count = 20
    lambda_w: NotNegative = 1.0
    lambda_len: NotNegative = 1.0
    min_ratio: Annotated[float, Field(gt=0, le=1)] = 0.9
    max_ratio: Annotated[float, Field(ge=1)] = 1.1


class Features(_Section):
    l_feat: Count = 10
    w_full: tuple[Share, ...] = (1.0, 0.5, 0.5, 0.2, 0.2, 0.2, 0.1, 0.1, 0.1, 0.1)
    lambda_full: NotNegative = 1.0
    lambda_first: NotNegative = 1.0
    lambda_occ: NotNegative = 0.5
    align: Literal["following", "as_printed"] = "following"

    @model_validator(mode="after")
    def _one_weight_each(self):
        if len(self.w_full) != self.l_feat:
            raise ValueError(
                f"w_full has {len(self.w_full)} weights for l_feat {self.l_feat}; give one weight per element"
            )
        return self


class Termination(_Section):
    fallbacks: bool = True
    keyword_retries: Annotated[int, Field(ge=0)] = 5
    discard_after_retries: Annotated[int, Field(ge=0)] = 10
    discard_share: Annotated[float, Field(gt=0, le=1)] = 0.1
    max_retries: Count = 40
    failure_retries: Count = 400


class Blend(_Section):
    method: Literal["crossfade", "inertialize"] = "crossfade"
    l_blend: Annotated[int, Field(ge=0)] = 8
    curve: Literal["linear", "sigmoid", "smoothstep"] = "linear"
    rotations: Literal["slerp", "expmap"] = "slerp"
    half_life: Positive = 0.1


class Root(_Section):
    mode: Literal["return", "absolute"] = "return"
    return_half_life: Positive = 3.0


class Evaluation(_Section):
    bc_sigma: Positive = 0.1
    div_min_angle: Annotated[float, Field(gt=0, lt=180)] = 45.0
    div_speed_floor: NotNegative = 0.1
    hellinger_bin_width: Positive = 1.0
    frechet_windows: tuple[Count, ...] = (30, 60, 90)
    seam_radius: Count = 4
    feet: tuple[str, ...] = ("b_l_foot", "b_r_foot")


class Config(_Section):
    """All settings of a run; see `configs/casia_go_2023.yaml` for what each one means."""

    method: Literal["motion_graph"] = "motion_graph"
    search: Literal["beam"] = "beam"
    seed: Annotated[int, Field(ge=0)] = 0
    paths: Paths = Paths()
    data: Data = Data()
    fps: Count = 30
    joints: Literal["all"] | tuple[str, ...] = GENEA_JOINTS
    wrists: Wrists = Wrists()
    blacklist: tuple[str, ...] = ()
    exclude: tuple[ExcludedRange, ...] = ()
    references: References = References()
    onsets: Onsets = Onsets()
    keywords: Keywords = Keywords()
    breaks: Breaks = Breaks()
    positions: Positions = Positions()
    continuity: Continuity = Continuity()
    beam: Beam = Beam()
    features: Features = Features()
    initialization: Literal["feature", "random"] = "feature"
    termination: Termination = Termination()
    resample: Literal["interpolate", "nearest"] = "interpolate"
    blend: Blend = Blend()
    root: Root = Root()
    fingers: Literal["follow", "rest"] = "follow"
    evaluation: Evaluation = Evaluation()

    def section_json(self, *keys: str) -> str:
        """Canonical JSON of some settings (`"continuity"`, `"onsets.min_strength"`), for stored files."""
        values = json.loads(self.model_dump_json(by_alias=True))
        chosen = {}
        for key in keys:
            value = values
            for part in key.split("."):
                value = value[part]
            chosen[key] = value
        return json.dumps(chosen, sort_keys=True)

    def signature(self) -> str:
        """Twelve hexadecimal digits that name the settings, wherever they were read and files are kept."""
        places = {"paths": True, "data": {"references", "tests"}, "keywords": {"file"}}
        values = json.loads(self.model_dump_json(by_alias=True, exclude=places))
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]


def configs_folder() -> Path:
    """The folder of the configs that come with gesturegen: inside an installed wheel, else of the checkout."""
    inside = Path(__file__).parent / "configs"
    return inside if inside.is_dir() else Path(__file__).parent.parent / "configs"


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
        origin = str(path)
        values, lines = _read_mapping(Path(path))
    set_keys = set()
    for override in overrides:
        set_keys.add(_apply_override(values, override))
    for key, folder in (folders or {}).items():
        section, name = key.split(".")
        values[section] = (values.get(section) or {}) | {name: folder}
    try:
        config = Config.model_validate_json(json.dumps(values, default=str))
    except ValidationError as error:
        raise ConfigError(
            "\n".join(_describe(problem, origin, lines, set_keys) for problem in error.errors())
        ) from None
    return _with_keywords(config, Path(path).parent if path is not None else None)


class _Loader(yaml.SafeLoader):
    """YAML in which a key that stands twice is an error instead of the last one winning in silence."""


def _construct_mapping(loader: _Loader, node: yaml.MappingNode) -> dict:
    seen: dict[Any, int] = {}
    for key_node, _ in node.value:
        key = loader.construct_object(key_node, deep=True)
        line = key_node.start_mark.line + 1
        if not isinstance(key, str):
            raise ConfigError(
                f"{loader.name}:{line}: key {key!r} is read by YAML as a {type(key).__name__}; put it in quotes"
            )
        if key in seen:
            raise ConfigError(f"{loader.name}:{line}: key {key!r} stands twice, first in line {seen[key]}; keep one")
        seen[key] = line
    return yaml.SafeLoader.construct_mapping(loader, node, deep=True)


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _construct_mapping)


def read_yaml(path: Path) -> Any:
    """A YAML file; raises ConfigError with the line for what is missing or malformed."""
    return _compose(path)[0]


def _compose(path: Path) -> tuple[Any, yaml.Node | None]:
    try:
        text = path.read_text()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); give an existing file with --config") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file in UTF-8") from None
    try:
        loader = _Loader(text)
        loader.name = str(path)
        try:
            node = loader.get_single_node()
            return (loader.construct_document(node) if node is not None else None), node
        finally:
            loader.dispose()
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f":{mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise ConfigError(f"{path}{where}: not valid YAML ({problem})") from None


def _read_mapping(path: Path) -> tuple[dict, dict[tuple, int]]:
    values, node = _compose(path)
    if values is None:
        return {}, {}
    if not isinstance(values, dict):
        raise ConfigError(f"{path}: expected `key: value` lines, found a {type(values).__name__}")
    lines: dict[tuple, int] = {}

    def note(node: yaml.Node, at: tuple) -> None:
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                lines[(*at, key.value)] = key.start_mark.line + 1
                note(value, (*at, key.value))
        elif isinstance(node, yaml.SequenceNode):
            for number, value in enumerate(node.value):
                lines[(*at, number)] = value.start_mark.line + 1
                note(value, (*at, number))

    note(node, ())
    return values, lines


def _apply_override(values: dict, override: str) -> tuple:
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        raise ConfigError(f"--set {override!r}: expected key=value, such as continuity.l_pn=1")
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        raise ConfigError(f"--set {override!r}: the value is not valid YAML") from None
    parts = tuple(key.strip().split("."))
    place = values
    for part in parts[:-1]:
        if place.get(part) is None:
            place[part] = {}
        place = place[part]
        if not isinstance(place, dict):
            raise ConfigError(f"--set {override!r}: {part!r} is no section")
    place[parts[-1]] = value
    return parts


def _describe(problem: dict, origin: str, lines: dict[tuple, int], set_keys: set[tuple]) -> str:
    """One line for one of pydantic's errors."""
    found_key = tuple(problem["loc"])
    # The union of `joints` adds the tried type to the path; a key of the file never looks like that.
    key = tuple(part for part in found_key if not (isinstance(part, str) and ("[" in part or part == "tuple")))
    if any(key[: len(parts)] == parts[: len(key)] for parts in set_keys):
        where = "--set"
    else:
        line = next((lines[key[:n]] for n in range(len(key), 0, -1) if key[:n] in lines), None)
        where = f"{origin}:{line}" if line else origin
    name = ".".join(str(part) for part in key) or "the whole file"
    if problem["type"] == "extra_forbidden":
        allowed = _keys_beside(key)
        near = get_close_matches(str(key[-1]), allowed, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}?" if near else f"allowed here: {', '.join(allowed)}"
        return f"{where}: unknown key {name!r}; {hint}"
    message = problem["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    found = problem["input"]
    hint = ""
    if isinstance(found, str) and _is_number(found):
        hint = f" (YAML reads {found} as text; write it with a decimal point, as in 1.0e-3)"
    if isinstance(found, dict):
        return f"{where}: {name}: {message[0].lower()}{message[1:]}"
    return f"{where}: {name}: found {json.dumps(found, ensure_ascii=False)}, allowed: {message[0].lower()}{message[1:]}{hint}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _keys_beside(key: tuple) -> list[str]:
    """The keys that the section around `key` does have."""
    model: Any = Config
    for part in key[:-1]:
        if isinstance(part, int):
            continue
        field = next((f for name, f in model.model_fields.items() if (f.alias or name) == part), None)
        model = field.annotation if field else Config
        if part == "exclude":
            model = ExcludedRange
    return [field.alias or name for name, field in model.model_fields.items()]


def _with_keywords(config: Config, folder: Path | None) -> Config:
    """Read the keyword list into the config, so that nothing later depends on where it was kept."""
    if config.keywords.words is not None:
        return config
    name = config.keywords.file or "keywords.yaml"
    places = [*([folder] if folder else []), Path(), configs_folder()]
    path = next((place / name for place in places if (place / name).is_file()), None)
    if path is None:
        tried = ", ".join(str(place / name) for place in places)
        raise ConfigError(f"keywords.file: {name!r} does not exist (looked at {tried})")
    words = read_yaml(path)
    if not isinstance(words, dict) or not all(isinstance(value, str) for value in words.values()):
        raise ConfigError(
            f"{path}: expected `word: keyword` lines with text on both sides; put words such as no and on in quotes"
        )
    words = {word.lower(): keyword for word, keyword in sorted(words.items())}
    return config.model_copy(update={"keywords": Keywords(file=config.keywords.file, words=words)})

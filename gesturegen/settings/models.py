"""Settings: frozen models, read from YAML, strict.

A config file holds only what it changes; the defaults are the papers' (`configs/casia_go_2023.yaml` spells
them all out, but for those that other methods alone have, which stand in the configs of those methods). An unknown
key, a wrong type or a value out of range is refused with the file, the line, the key's path, what was found, what is
allowed and, for a typo, the nearest key.
"""

from __future__ import annotations

import hashlib
import json
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from gesturegen.methods import METHODS
from gesturegen.methods.sections import LISTS, MethodSections
from gesturegen.settings.base import Count, NotNegative, Positive, Section
from gesturegen.settings.control import Control
from gesturegen.settings.speech import Acoustics, Audio, Keywords, Onsets, Pauses, Phrases, Prosody, Voice

GENEA_JOINTS = (
    "b_root", "b_spine0", "b_spine1", "b_spine2", "b_spine3", "b_neck0", "b_head",
    "b_r_shoulder", "b_r_arm", "b_r_arm_twist", "b_r_forearm", "b_r_wrist_twist", "b_r_wrist",
    "b_r_upleg", "b_r_leg", "b_r_foot",
    "b_l_shoulder", "b_l_arm", "b_l_arm_twist", "b_l_forearm", "b_l_wrist_twist", "b_l_wrist",
    "b_l_upleg", "b_l_leg", "b_l_foot",
)  # fmt: skip

# Centimetres in the units that BVH files come in.
UNITS = {"cm": 1.0, "m": 100.0, "mm": 0.1, "inch": 2.54}


class Paths(Section):
    data: str = "data"
    work: str = "work"


class Data(Section):
    reference_split: str = "trn"
    test_split: str = "tst"
    truth_split: str | None = None
    references: str | None = None
    tests: str | None = None


class MotionFiles(Section):
    unit: float | str = "auto"
    up_axis: Literal["auto", "y", "z"] = "auto"
    same_skeleton: Annotated[float, Field(ge=0, lt=0.1)] = 0.01

    @field_validator("unit", mode="before")
    @classmethod
    def _a_unit(cls, unit: Any) -> Any:
        number = isinstance(unit, (int, float)) and not isinstance(unit, bool)
        if unit in ("auto", *UNITS) or (number and 1e-6 <= unit <= 1e6):
            return unit
        raise PydanticCustomError("unit", "'auto', 'cm', 'm', 'mm', 'inch' or the number of centimetres in one unit")


class SkeletonRoles(Section):
    """Names of joints by role, for skeletons whose roles are not recognised; null leaves it to recognition."""

    pelvis: str | None = None
    spine: tuple[str, ...] | None = None
    neck: str | None = None
    head: str | None = None
    left_shoulder: str | None = None
    left_upper_arm: str | None = None
    left_elbow: str | None = None
    left_wrist: str | None = None
    left_fingers: tuple[str, ...] | None = None
    left_hip: str | None = None
    left_knee: str | None = None
    left_ankle: str | None = None
    left_toes: str | None = None
    right_shoulder: str | None = None
    right_upper_arm: str | None = None
    right_elbow: str | None = None
    right_wrist: str | None = None
    right_fingers: tuple[str, ...] | None = None
    right_hip: str | None = None
    right_knee: str | None = None
    right_ankle: str | None = None
    right_toes: str | None = None


class Wrists(Section):
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


class ExcludedRange(Section):
    clip: str
    from_: Annotated[float, Field(ge=0, alias="from")]
    to: Positive

    @model_validator(mode="after")
    def _not_empty(self):
        if self.to <= self.from_:
            raise ValueError("`to` must be later than `from`")
        return self


class References(Section):
    mode: Literal["per_test_clip", "k", "speaker", "all", "list"] = "per_test_clip"
    k: Count = 1
    list_file: Annotated[str | None, Field(alias="list")] = None
    seconds: Positive | None = None

    @model_validator(mode="after")
    def _list_given(self):
        if self.mode == "list" and self.list_file is None:
            raise ValueError(
                "mode `list` needs the key `references.list`, a YAML file that pins references to test clips"
            )
        return self


class Breaks(Section):
    max_joint_speed: Positive | None = None


class Positions(Section):
    relative_to: Literal["root", "root_heading", "world"] = "root"
    root_joint: str = "b_root"
    scale: Positive = 1.0


class Continuity(Section):
    lambda_pos: NotNegative = 1.0
    lambda_vel: NotNegative = 1.0
    l_cn: Count = 5
    l_pn: Count = 10


class Refiner(Section):
    checkpoint: str | None = None
    w_reconstruction: NotNegative = 0.1
    w_adversarial: NotNegative = 1.0
    w_penalty: NotNegative = 100.0
    learning_rate: Positive = 1e-4
    iterations: Count = 300_000
    batch: Count = 64
    stride_seconds: Positive = 5 / 15
    furthest_k: Count = 15
    held_out_share: Annotated[float, Field(gt=0, lt=1)] = 0.1
    patience: Count = 20
    check_every: Count = 500
    device: Literal["auto", "cpu", "cuda"] = "auto"


class Blend(Section):
    method: Literal["crossfade", "inertialize", "least_change", "least_jerk", "overlap"] = "crossfade"
    l_blend: Annotated[int, Field(ge=0)] = 8
    curve: Literal["linear", "sigmoid", "smoothstep"] = "linear"
    rotations: Literal["slerp", "expmap"] = "slerp"
    half_life: Positive = 0.1
    reach_seconds: Annotated[float, Field(gt=0, le=1)] = 0.08


class Smoothing(Section):
    enabled: bool = False
    window: Annotated[int, Field(ge=3)] = 7
    limb_order: Annotated[int, Field(ge=0)] = 2
    order: Annotated[int, Field(ge=0)] = 1

    @model_validator(mode="after")
    def _filter_exists(self):
        if self.window % 2 == 0 or max(self.order, self.limb_order) >= self.window:
            raise ValueError("window must be odd and larger than order and limb_order")
        return self


class Root(Section):
    mode: Literal["return", "absolute"] = "return"
    return_half_life: Positive = 3.0


class Feet(Section):
    lock: bool = False
    joints: tuple[str, ...] = ("b_l_foot", "b_r_foot")
    release_half_life: Positive = 0.3
    max_offset: Positive = 15.0
    step_seconds: Positive = 0.5
    step_height: Positive = 6.0


class Evaluation(Section):
    bc_sigma: Positive = 0.1
    div_min_angle: Annotated[float, Field(gt=0, lt=180)] = 45.0
    div_speed_floor: NotNegative = 0.1
    hellinger_bin_width: Positive = 1.0
    frechet_windows: tuple[Count, ...] = (30, 60, 90)
    seam_radius: Count = 4
    stutter_frames: Count = 15
    same_frames: Annotated[int, Field(ge=0)] = 3
    again_seconds: Positive = 10.0
    still_speed: Positive = 10.0
    still_seconds: Positive = 0.33
    knee_straight_degrees: Annotated[float, Field(gt=0, lt=180)] = 177.0
    knee_snap_acceleration: Positive = 6000.0
    seam_joints: tuple[str, ...] = (
        "b_root", "b_spine3", "b_head", "b_l_arm", "b_r_arm", "b_l_forearm", "b_r_forearm", "b_l_wrist", "b_r_wrist",
        "b_l_foot", "b_r_foot",
    )  # fmt: skip
    seam_min_joins: Count = 5
    alignment_joints: tuple[str, ...] = (
        "b_spine1", "b_spine2", "b_spine3", "b_neck0", "b_head", "b_l_shoulder", "b_l_arm", "b_l_forearm", "b_l_wrist",
        "b_r_shoulder", "b_r_arm", "b_r_forearm", "b_r_wrist",
    )  # fmt: skip
    stretches: Count = 5


# Keys that say where files are kept, and nothing of what is made of them.
PLACES = (
    "paths", "data.references", "data.tests", "keywords.file", "control.file", "control.library", "refiner.checkpoint",
    *(f"{section}.{part}.{file}" for section, part, file, _, _ in LISTS),
)  # fmt: skip


def no_control() -> str:
    """What is wrong with conditions under settings whose method cannot follow them."""
    able = " or ".join(method.control for method in METHODS.values() if method.control)
    return f"control of the hands needs {able}; choose one of them or leave conditions out"


class Config(MethodSections):
    """All settings of a run.

    See `configs/casia_go_2023.yaml` for what each one means; the configs of other methods say it of their sections.
    """

    seed: Annotated[int, Field(ge=0)] = 0
    paths: Paths = Paths()
    data: Data = Data()
    fps: Count = 30
    motion: MotionFiles = MotionFiles()
    skeleton: SkeletonRoles = SkeletonRoles()
    joints: Literal["all"] | tuple[str, ...] = GENEA_JOINTS
    wrists: Wrists = Wrists()
    blacklist: tuple[str, ...] = ()
    exclude: tuple[ExcludedRange, ...] = ()
    references: References = References()
    audio: Audio = Audio()
    voice: Voice = Voice()
    onsets: Onsets = Onsets()
    keywords: Keywords = Keywords()
    breaks: Breaks = Breaks()
    pauses: Pauses = Pauses()
    phrases: Phrases = Phrases()
    prosody: Prosody = Prosody()
    acoustics: Acoustics = Acoustics()
    positions: Positions = Positions()
    continuity: Continuity = Continuity()
    control: Control = Control()
    resample: Literal["interpolate", "nearest"] = "interpolate"
    blend: Blend = Blend()
    smoothing: Smoothing = Smoothing()
    root: Root = Root()
    feet: Feet = Feet()
    fingers: Literal["follow", "rest"] = "follow"
    refine: bool = False
    refiner: Refiner = Refiner()
    evaluation: Evaluation = Evaluation()

    @field_validator("method")
    @classmethod
    def _a_method(cls, name: str) -> str:
        if name not in METHODS:
            *others, last = map(repr, METHODS)
            raise PydanticCustomError("literal_error", f"{', '.join(others)} or {last}")
        return name

    @model_validator(mode="after")
    def _measured(self):
        if (lacking := METHODS[self.method].lacks(self)) is not None:
            raise PydanticCustomError("value_error", "{lacking}", {"lacking": lacking, "key": "method"})
        return self

    @model_validator(mode="after")
    def _can_be_controlled(self):
        if self.control.conditions and not self.controls:
            raise PydanticCustomError("value_error", no_control(), {"key": "control"})
        return self

    @property
    def roles(self) -> tuple[tuple[str, str | tuple[str, ...]], ...]:
        """The roles of joints that are set by name: (role, joint or joints)."""
        return tuple((role, name) for role, name in self.skeleton if name is not None)

    @property
    def hands(self) -> Control:
        """Section `control` with the wrists that section `skeleton` names, where `left` and `right` are the default."""
        default = Control()
        named = {"left": self.skeleton.left_wrist, "right": self.skeleton.right_wrist}
        changes = {k: name for k, name in named.items() if name and getattr(self.control, k) == getattr(default, k)}
        return self.control.model_copy(update=changes)

    @property
    def controls(self) -> bool:
        """Whether the search can follow conditions; gestures of a library can be shown whatever it is."""
        return METHODS[self.method].follows_conditions(self)

    @property
    def search_name(self) -> str:
        """What the method searches with."""
        return METHODS[self.method].search_name(self)

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
        values = json.loads(self.model_dump_json(by_alias=True))
        for key in PLACES:
            *sections, name = key.split(".")
            place = values
            for section in sections:
                place = place[section]
            del place[name]
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]


class Grid(Section):
    """Setups as all combinations of some axes; see `configs/reference_length.yaml`.

    name : how each is called, `{axis}` standing for the label of its value; None for all labels, joined by `_`
    axes : by name, the first changing slowest: values of the setting of that name, as a list or by label, or, under
        any other name, settings by label; leave_out : names of combinations that are no setups
    """

    name: str | None = None
    axes: dict[str, Any]
    leave_out: tuple[str, ...] = ()


class PlanFile(Section):
    """What a plan of setups and seeds holds; see `configs/ablation.yaml`.

    setups : file names, or `{name: settings}`; the setups of the grid follow them
    """

    base: str | None = None
    seeds: tuple[Annotated[int, Field(ge=0)], ...] = (0, 1, 2)
    setups: tuple[Any, ...] | None = None
    grid: Grid | None = None

    @field_validator("seeds", "setups")
    @classmethod
    def _different(cls, values: tuple | None) -> tuple | None:
        if values is not None and (not values or any(values.count(value) > 1 for value in values)):
            raise ValueError("give at least one, and each once")
        return values

    @model_validator(mode="after")
    def _any_setup(self) -> PlanFile:
        if self.setups is None and self.grid is None:
            raise ValueError("there are no setups; add the key `setups`, or `grid`")
        return self

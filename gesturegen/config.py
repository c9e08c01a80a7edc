"""Settings: frozen models, read from YAML, strict.

A config file holds only what it changes; the defaults are the papers' (`configs/casia_go_2023.yaml` spells
them all out, but for those that other methods alone have, which stand in `configs/gesture_master_2022.yaml` and
`configs/motion_matching_2022.yaml`). An unknown key, a wrong type or a value out of range is refused with the file,
the line, the key's path, what was found, what is allowed and, for a typo, the nearest key.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator
from pydantic_core import PydanticCustomError

from gesturegen import inputs, strict_csv, strict_yaml
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


# Centimetres in the units that BVH files come in.
UNITS = {"cm": 1.0, "m": 100.0, "mm": 0.1, "inch": 2.54}
# Of one file that are told; each takes a look for the nearest name.
_MOST_MISTAKES = 20


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


class MotionFiles(_Section):
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


class SkeletonRoles(_Section):
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
    seconds: Positive | None = None

    @model_validator(mode="after")
    def _list_given(self):
        if self.mode == "list" and self.list_file is None:
            raise ValueError(
                "mode `list` needs the key `references.list`, a YAML file that pins references to test clips"
            )
        return self


class Audio(_Section):
    channel: int | str = "mix"

    @field_validator("channel", mode="before")
    @classmethod
    def _a_channel(cls, channel: Any) -> Any:
        number = isinstance(channel, int) and not isinstance(channel, bool) and 1 <= channel <= 64
        if number or channel in ("mix", "left", "right"):
            return channel
        raise PydanticCustomError("channel", "'mix', 'left', 'right' or a number from 1 to 64")


class Voice(_Section):
    threshold: Annotated[float, Field(gt=0, lt=1)] = 0.5
    smoothing_seconds: NotNegative = 0.1
    loud_db: NotNegative = 12.0


class Onsets(_Section):
    min_strength: NotNegative = 5.0
    per_second: Positive | None = None
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


class Prosody(_Section):
    enabled: bool = False
    sample_rate: Annotated[int, Field(ge=4000)] = 8000
    hop_length: Count = 320
    pitch_min: Positive = 65.0
    pitch_max: Positive = 500.0

    @model_validator(mode="after")
    def _a_range(self):
        if not 1.2 * self.pitch_min <= self.pitch_max < self.sample_rate / 2:
            raise ValueError("pitch_max must be at least 1.2 times pitch_min, and below half the sample_rate")
        return self


# A share of the reference frames, such as 85% or 2.5%.
_QUANTILE = re.compile(r"[0-9]+(\.[0-9]+)?%")


class Condition(_Section):
    """What a measure of the hands is to be in a time range; a bound is a number or a quantile such as `85%`.

    Heights, radii and symmetry are in cm, speeds in cm/s, times in seconds; without `to` the range reaches to
    the end of the clip. Only a soft condition has a price, 1 where none is given.
    """

    clip: str = "*"
    from_: Annotated[float, Field(ge=0, alias="from")] = 0.0
    to: Positive | None = None
    measure: Literal["height", "speed", "radius", "symmetry"]
    hand: Literal["left", "right", "both"] = "both"
    at_least: float | str | None = None
    at_most: float | str | None = None
    hard: bool = True
    price: Positive | None = None

    @field_validator("at_least", "at_most", mode="before")
    @classmethod
    def _a_bound(cls, bound: Any) -> Any:
        number = isinstance(bound, (int, float)) and not isinstance(bound, bool)
        if bound is None or (number and abs(bound) < math.inf) or _quantile(bound) is not None:
            return bound
        raise PydanticCustomError("bound", "a finite number, or a quantile from `0%` to `100%` such as `85%`")

    @model_validator(mode="after")
    def _can_be_met(self):
        if self.to is not None and self.to <= self.from_:
            raise ValueError("`to` must be later than `from`")
        if self.at_least is None and self.at_most is None:
            raise ValueError("give at_least, at_most or both")
        if self.measure == "symmetry" and self.hand != "both":
            raise ValueError("symmetry compares the hands and has none of its own; leave out `hand`")
        if self.hard and self.price is not None:
            raise ValueError("a hard condition has no price; leave it out, or set hard: false")
        bounds = [self.at_least, self.at_most]
        quantiles = [_quantile(bound) for bound in bounds]
        if None not in quantiles:
            bounds = quantiles
        # A number and a quantile can be compared once the references are known.
        if not any(bound is None or isinstance(bound, str) for bound in bounds) and bounds[0] > bounds[1]:
            raise ValueError(f"at_least {bound_text(self.at_least)} is more than at_most {bound_text(self.at_most)}")
        return self


def _quantile(bound: Any) -> float | None:
    """0 to 1 for a text from `0%` to `100%`; None for anything else."""
    if not isinstance(bound, str) or not _QUANTILE.fullmatch(bound):
        return None
    share = float(bound[:-1]) / 100
    return share if share <= 1 else None


def bound_text(bound: float | str) -> str:
    """A bound as it is written."""
    return bound if isinstance(bound, str) else f"{bound:g}"


def resolve_bound(bound: float | str | None, missing: float, quantile: Callable[[float], float]) -> float:
    """The number that a bound stands for; `missing` where there is none.

    quantile : what of the references a share from 0 to 1 lies below
    """
    if bound is None:
        return missing
    share = _quantile(bound)
    return float(bound) if share is None else float(quantile(share))


def shared_time(one: Condition, other: Condition) -> tuple[float, float] | None:
    """From when to when both conditions hold, in seconds (inf for the end of the clip); None for never."""
    ends = [math.inf if condition.to is None else condition.to for condition in (one, other)]
    start, end = max(one.from_, other.from_), min(ends)
    return (start, end) if start < end else None


def time_text(start: float, end: float) -> str:
    """A time range in seconds, in words."""
    return f"from {start:g} s on" if math.isinf(end) else f"from {start:g} to {end:g} s"


class KeywordGesture(_Section):
    """A gesture of the library that is to be shown at a time, or wherever a word is said."""

    clip: str = "*"
    word: str | None = None
    at: NotNegative | None = None
    gesture: str

    @field_validator("word")
    @classmethod
    def _one_word(cls, word: str | None) -> str | None:
        if word is not None and (len(word.split()) != 1 or not any(map(str.isalnum, word))):
            raise ValueError(f"{word!r} is not one word, so no transcript can match it")
        return word

    @model_validator(mode="after")
    def _one_place(self):
        if (self.word is None) == (self.at is None):
            raise ValueError("give one of word and at")
        return self


class Schedule(_Section):
    """What a control file holds: what is demanded of the hands, and which gestures are to be shown."""

    # Each is compared with each other.
    conditions: Annotated[tuple[Condition, ...], Field(max_length=1000)] = ()
    gestures: Annotated[tuple[KeywordGesture, ...], Field(max_length=1000)] = ()

    @field_validator("conditions")
    @classmethod
    def _one_at_a_time(cls, conditions: tuple[Condition, ...]) -> tuple[Condition, ...]:
        mistakes = []
        for (first, one), (second, other) in itertools.combinations(enumerate(conditions), 2):
            time = shared_time(one, other)
            if time and (one.clip, one.measure, one.hand) == (other.clip, other.measure, other.hand):
                problem = PydanticCustomError(
                    "value_error",
                    "conditions {first} and {second} overlap {time}; give both bounds in one condition, or times apart",
                    {"first": first + 1, "second": second + 1, "time": time_text(*time)},
                )
                mistakes.append({"type": problem, "loc": (second,), "input": None})
                if len(mistakes) > _MOST_MISTAKES:
                    break
        if mistakes:
            # Unlike a ValueError, this says which condition it is, and so in which line.
            raise ValidationError.from_exception_data(cls.__name__, mistakes)
        return conditions


class Control(Schedule):
    """The conditions and gestures, given directly or else read from `file`; the gestures are those of `library`."""

    file: str | None = None
    library: str | None = None
    left: str = "b_l_wrist"
    right: str = "b_r_wrist"
    forbidden: Positive = 1000.0


class Refiner(_Section):
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


class Acoustics(_Section):
    enabled: bool = False
    sample_rate: Count = 22050
    rate: Count = 15
    coefficients: Count = 13

    @model_validator(mode="after")
    def _whole_hops(self):
        if self.sample_rate % self.rate:
            raise ValueError("sample_rate must be a multiple of rate, so that there are so many values a second")
        return self


class MotionMatching(_Section):
    sequence_seconds: Positive = 64 / 15
    step_seconds: Positive = 8 / 15
    audio_values: Count = 8
    audio_interval_seconds: NotNegative = 2 / 15
    pose_values: Count = 4
    pose_interval_seconds: NotNegative = 1 / 15
    joints: tuple[str, ...] = (
        "b_l_forearm", "b_r_forearm", "b_l_wrist", "b_r_wrist", "b_l_index1", "b_r_index1", "b_l_pinky1", "b_r_pinky1",
    )  # fmt: skip
    preselect: Literal["pose", "audio"] = "pose"
    use_audio: bool = True
    k: Count = 1
    start: Literal["random", "mean", "given"] = "random"
    start_pose: str | None = None

    @model_validator(mode="after")
    def _start_given(self):
        if (self.start == "given") != (self.start_pose is not None):
            raise ValueError("start: given goes with start_pose, a reference clip and a time such as trn_000@12.30")
        return self


class Beam(_Section):
    l_npaths: Count = 20
    lambda_w: NotNegative = 1.0
    lambda_len: NotNegative = 1.0
    min_ratio: Annotated[float, Field(gt=0, le=1)] = 0.9
    max_ratio: Annotated[float, Field(ge=1)] = 1.1


class Pauses(_Section):
    min_seconds: NotNegative = 0.5
    voice: Literal["without_words", "always"] = "without_words"


class Phrases(_Section):
    min_gap_seconds: NotNegative = 0.2


class GlobalSearch(_Section):
    join_price: NotNegative = 60.0
    lambda_join: NotNegative = 1.0
    min_stay_seconds: NotNegative = 0.67
    stutter_seconds: NotNegative = 0.5
    lambda_state: NotNegative = 3.0
    lambda_hold: NotNegative = 20.0
    lambda_rest: NotNegative = 1.0
    lambda_beat: NotNegative = 15.0
    beat_lag_seconds: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0
    lambda_onset: NotNegative = 3.0
    lambda_phrase: NotNegative = 5.0
    lambda_keyword: NotNegative = 20.0
    lambda_repeat: NotNegative = 1.0
    repeat_seconds: NotNegative = 10.0
    sweeps: Annotated[int, Field(ge=0)] = 2
    lambda_variant: NotNegative = 1.0


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


class Cutting(_Section):
    gap_seconds: NotNegative = 0.4
    rest_seconds: Positive = 1.0
    min_seconds: Positive = 1.0
    max_seconds: Positive = 10.0

    @model_validator(mode="after")
    def _can_be_cut(self):
        if self.max_seconds < 2 * self.min_seconds:
            raise ValueError("max_seconds must be at least twice min_seconds, or a long clip cannot be cut in two")
        return self


class Quality(_Section):
    enabled: bool = True
    max_turn: Positive = 1350.0
    max_speed: Positive = 900.0
    max_jitter: Positive = 0.2
    frozen_seconds: Positive = 1.0
    include: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()


class Correction(_Section):
    """The rhythm signature of the gesture clip of recording `clip` that starts at `start` seconds."""

    clip: str
    start: NotNegative
    bits: Annotated[str, Field(pattern="^[01]+$")]


class Rhythm(_Section):
    bits: Annotated[int, Field(ge=2)] = 32
    words: Literal["start", "span"] = "start"
    smoothing_seconds: NotNegative = 0.1
    corrections_file: str | None = None
    corrections: tuple[Correction, ...] | None = None

    @model_validator(mode="after")
    def _as_many_bits(self):
        for correction in self.corrections or ():
            if len(correction.bits) != self.bits:
                raise ValueError(
                    f"the correction of {correction.clip} at {correction.start:g} s has {len(correction.bits)} bits, "
                    f"rhythm.bits is {self.bits}"
                )
        return self


class StyleTarget(_Section):
    """Style values that are wanted in a time range of a test clip; None where any will do."""

    clip: str
    from_: Annotated[float, Field(ge=0, alias="from")]
    to: Positive
    speed: NotNegative | None = None
    radius: NotNegative | None = None
    height: float | None = None

    @model_validator(mode="after")
    def _not_empty(self):
        if self.to <= self.from_:
            raise ValueError("`to` must be later than `from`")
        return self


class Style(_Section):
    source: Literal["predict", "targets", "none"] = "predict"
    ridge: Positive = 10.0
    folds: Annotated[int, Field(ge=2)] = 5
    targets_file: str | None = None
    targets: tuple[StyleTarget, ...] | None = None

    @model_validator(mode="after")
    def _targets_given(self):
        if self.source == "targets" and self.targets_file is None and self.targets is None:
            raise ValueError(
                "source `targets` needs the key `targets_file`, a CSV file: clip,from,to,speed,radius,height"
            )
        return self


class UpperBody(_Section):
    lambda_1: NotNegative = 0.7
    lambda_2: NotNegative = 0.3
    delta_t: Positive | None = 8.0
    delta_quantile: Share | None = None
    lambda_3: NotNegative = 1.0
    lambda_4: Positive = 3.0
    lambda_5: NotNegative = 1.0
    lambda_6: NotNegative = 0.1
    zeta: NotNegative = 10000.0

    @model_validator(mode="after")
    def _one_threshold(self):
        if (self.delta_t is None) == (self.delta_quantile is None):
            raise ValueError("give one of delta_t and delta_quantile, and null for the other")
        return self


class LowerBody(UpperBody):
    lambda_3: NotNegative = 0.0
    lambda_4: Positive = 1.0
    lambda_5: NotNegative = 0.0
    lambda_6: NotNegative = 0.0


class TimeScale(_Section):
    min: Annotated[float, Field(gt=0, le=1)] = 0.8
    max: Annotated[float, Field(ge=1)] = 1.25
    rest_min: Annotated[float, Field(gt=0, le=1)] = 0.5
    rest_max: Annotated[float, Field(ge=1)] = 2.0
    lambda_scale: NotNegative = 5.0
    lambda_outside: NotNegative = 1_000_000.0


class GestureMaster(_Section):
    cutting: Cutting = Cutting()
    quality: Quality = Quality()
    mirror: bool = True
    joint_pairs: tuple[tuple[str, str], ...] = ()
    finger_transfer: bool = True
    rhythm: Rhythm = Rhythm()
    style: Style = Style()
    transition_frames: Annotated[int, Field(ge=2)] = 8
    upper: UpperBody = UpperBody()
    lower: LowerBody = LowerBody()
    time_scale: TimeScale = TimeScale()
    lambda_kind: NotNegative = 100_000.0
    lambda_reuse: NotNegative = 100_000.0
    lambda_variant: NotNegative = 1.0


class Blend(_Section):
    method: Literal["crossfade", "inertialize", "least_change", "least_jerk", "overlap"] = "crossfade"
    l_blend: Annotated[int, Field(ge=0)] = 8
    curve: Literal["linear", "sigmoid", "smoothstep"] = "linear"
    rotations: Literal["slerp", "expmap"] = "slerp"
    half_life: Positive = 0.1
    reach_seconds: Annotated[float, Field(gt=0, le=1)] = 0.08


class Smoothing(_Section):
    enabled: bool = False
    window: Annotated[int, Field(ge=3)] = 7
    limb_order: Annotated[int, Field(ge=0)] = 2
    order: Annotated[int, Field(ge=0)] = 1

    @model_validator(mode="after")
    def _filter_exists(self):
        if self.window % 2 == 0 or max(self.order, self.limb_order) >= self.window:
            raise ValueError("window must be odd and larger than order and limb_order")
        return self


class Root(_Section):
    mode: Literal["return", "absolute"] = "return"
    return_half_life: Positive = 3.0


class Feet(_Section):
    lock: bool = False
    joints: tuple[str, ...] = ("b_l_foot", "b_r_foot")
    release_half_life: Positive = 0.3
    max_offset: Positive = 15.0
    step_seconds: Positive = 0.5
    step_height: Positive = 6.0


class Evaluation(_Section):
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


_NO_CONTROL = (
    "control of the hands needs search: global or method: motion_matching; choose one of them or leave conditions out"
)


class Config(_Section):
    """All settings of a run.

    See `configs/casia_go_2023.yaml` for what each one means, `configs/gesture_master_2022.yaml` for section
    `gesture_master`, `configs/motion_matching_2022.yaml` for `acoustics`, `motion_matching`, `refine` and `refiner`.
    """

    method: Literal["motion_graph", "gesture_master", "motion_matching", "baseline"] = "motion_graph"
    search: Literal["beam", "global"] = "beam"
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
    beam: Beam = Beam()
    global_search: GlobalSearch = GlobalSearch()
    features: Features = Features()
    initialization: Literal["feature", "random"] = "feature"
    termination: Termination = Termination()
    gesture_master: GestureMaster = GestureMaster()
    motion_matching: MotionMatching = MotionMatching()
    baseline: Literal["random_stretch", "mismatched"] = "random_stretch"
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

    @model_validator(mode="after")
    def _prosody_measured(self):
        predicts = self.method == "gesture_master" and self.gesture_master.style.source == "predict"
        if predicts and not self.prosody.enabled:
            raise PydanticCustomError(
                "value_error",
                "gesture_master with gesture_master.style.source: predict needs prosody.enabled: true, which measures "
                "energy and pitch; or set the source to targets or none",
                {"key": "method"},
            )
        return self

    @model_validator(mode="after")
    def _acoustics_measured(self):
        if self.method == "motion_matching" and not self.acoustics.enabled:
            raise PydanticCustomError(
                "value_error",
                "motion_matching needs acoustics.enabled: true, which measures the sound that it matches",
                {"key": "method"},
            )
        return self

    @model_validator(mode="after")
    def _can_be_controlled(self):
        if self.control.conditions and not self.controls:
            raise PydanticCustomError("value_error", _NO_CONTROL, {"key": "control"})
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
        return self.method == "motion_matching" or self.search_name == "global"

    @property
    def search_name(self) -> str:
        """What the method searches with."""
        own = {"gesture_master": "viterbi", "motion_matching": "nearest", "baseline": self.baseline}
        return own.get(self.method, self.search)

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
        places = {
            "paths": True, "data": {"references", "tests"}, "keywords": {"file"}, "control": {"file", "library"},
            "gesture_master": {section: {file} for section, file, _ in _LISTS}, "refiner": {"checkpoint"},
        }  # fmt: skip
        values = json.loads(self.model_dump_json(by_alias=True, exclude=places))
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]


class Ablation(_Section):
    """What an ablation file holds; see `configs/ablation.yaml`."""

    base: str | None = None
    seeds: tuple[Annotated[int, Field(ge=0)], ...] = (0, 1, 2)
    setups: tuple[str, ...]

    @field_validator("seeds", "setups")
    @classmethod
    def _different(cls, values: tuple) -> tuple:
        if not values or len(set(values)) < len(values):
            raise ValueError("give at least one, and each once")
        return values


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
    config = _validated(Config, values, origin, lines, set_keys)
    return _with_files(config, Path(path).parent if path is not None else None)


def layer_config(base: Config, path: str | Path) -> Config:
    """`base` with what a YAML file changes of it; ConfigError as by `load_config`."""
    changes, lines = strict_yaml.read_mapping(path, "check the path")
    values = json.loads(base.model_dump_json(by_alias=True))
    if "keywords" in changes:
        values["keywords"] = {}  # the base's words were read in, and would win over another file
    for section, file, rows in _LISTS:  # likewise
        if file in _section(_section(changes, "gesture_master"), section):
            values["gesture_master"][section][rows] = None
    if "file" in _section(changes, "control"):
        values["control"] |= {"conditions": [], "gestures": []}
    return _with_files(_validated(Config, _merged(values, changes), inputs.shown(path), lines), Path(path).parent)


def _section(values: dict, name: str) -> dict:
    """A section of a file that is not validated yet; empty where it is missing or no section."""
    section = values.get(name)
    return section if isinstance(section, dict) else {}


def _merged(values: dict, changes: dict) -> dict:
    """`values` with `changes` laid over them, section by section."""
    merged = dict(values)
    for key, value in changes.items():
        both = isinstance(value, dict) and isinstance(values.get(key), dict)
        merged[key] = _merged(values[key], value) if both else value
    return merged


def load_ablation(path: str | Path) -> tuple[Ablation, dict[tuple, int]]:
    """An ablation file and the line of each of its keys; ConfigError as by `load_config`."""
    values, lines = strict_yaml.read_mapping(path, "give an existing ablation file with --config")
    return _validated(Ablation, values, inputs.shown(path), lines), lines


def _validated(
    model: type[_Section], values: dict, origin: str, lines: dict[tuple, int], set_keys: Collection[tuple] = ()
) -> Any:
    try:
        return model.model_validate_json(json.dumps(values, default=str))
    except ValidationError as error:
        problems = [problem for problem in error.errors() if not _of_other_member(problem)]
        mistakes = [_describe(problem, model, origin, lines, set_keys) for problem in problems[:_MOST_MISTAKES]]
        if len(problems) > _MOST_MISTAKES:
            mistakes.append(f"{origin}: and {len(problems) - _MOST_MISTAKES} more")
        raise ConfigError("\n".join(dict.fromkeys(mistakes))) from None


def _apply_override(values: dict, override: str) -> tuple:
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        raise ConfigError(f"--set {_brief(override)}: expected key=value, such as continuity.l_pn=1")
    value = strict_yaml.parse(text, f"--set {override if len(override) <= 80 else override[:77] + '...'}")
    parts = tuple(key.strip().split("."))
    if len(parts) > strict_yaml.MOST_LEVELS or inputs.control_character(key):
        raise ConfigError(f"--set {_brief(override)}: no such key; expected key=value, such as continuity.l_pn=1")
    place = values
    for part in parts[:-1]:
        if place.get(part) is None:
            place[part] = {}
        place = place[part]
        if not isinstance(place, dict):
            raise ConfigError(f"--set {_brief(override)}: {inputs.shown(part)!r} is no section")
    place[parts[-1]] = value
    return parts


def _of_other_member(problem: dict) -> bool:
    """Whether a list of joints is called no `all`: a list is wrong for its elements only."""
    return (
        problem["loc"][:1] == ("joints",) and problem["type"] == "literal_error" and isinstance(problem["input"], list)
    )


def _describe(
    problem: dict, top: type[_Section], origin: str, lines: dict[tuple, int], set_keys: Collection[tuple]
) -> str:
    """One line for one of pydantic's errors."""
    # What is wrong with several sections together names the key to look at.
    key = tuple(problem["loc"]) or tuple(problem.get("ctx", {}).get("key", "").split("."))
    if key[:1] == ("joints",):
        # The union adds the member it tried to the path; an index into the list may follow.
        key = ("joints", *(part for part in key[1:] if isinstance(part, int)))
    if any(key[: len(parts)] == parts[: len(key)] for parts in set_keys):
        where = "--set"
    else:
        line = next((lines[key[:n]] for n in range(len(key), 0, -1) if key[:n] in lines), None)
        where = f"{origin}:{line}" if line else origin
    name = ".".join(str(part) for part in key) or "the whole file"
    if problem["type"] == "extra_forbidden":
        allowed = _keys_beside(key, top)
        near = get_close_matches(str(key[-1])[:100], allowed, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}?" if near else f"allowed here: {', '.join(allowed)}"
        return f"{where}: unknown key {inputs.shown(name)!r}; {hint}"
    if problem["type"] == "missing":
        return f"{where}: {name}: missing; add this key"
    found, allowed = problem["input"], _allowed(problem["msg"])
    if problem["type"] == "value_error":
        return f"{where}: {name}: {allowed}"
    if key == ("joints",):
        allowed = "'all' or a list of joint names"
    return f"{where}: {name}: found {_brief(found)}, allowed: {allowed}{_hint(found, problem['type'])}"


def _allowed(message: str) -> str:
    """pydantic's words, which are JSON's, in those of YAML."""
    message = message.removeprefix("Value error, ").removeprefix("Input should be ")
    message = message.replace("an object", "a section").replace("a valid array", "a list")
    return message[0].lower() + message[1:]


def _brief(found: Any) -> str:
    text = inputs.shown(json.dumps(found, ensure_ascii=False))
    return text if len(text) <= 80 else text[:77] + "..."


def _hint(found: Any, problem: str) -> str:
    """What is meant, perhaps, by a text that other readers of YAML take for a number or for a bool."""
    if problem == "string_type" and isinstance(found, (bool, int, float)):
        return " (put it in quotes)"
    if not isinstance(found, str) or not problem.startswith(("int_", "float_", "bool_", "bound")):
        return ""
    return next((f" ({hint})" for pattern, hint in _HINTS if pattern.fullmatch(found)), "")


def _keys_beside(key: tuple, top: type[_Section]) -> list[str]:
    """The keys that the section around `key` does have."""
    model: Any = top
    for part in key[:-1]:
        if isinstance(part, int):
            continue
        field = next((f for name, f in model.model_fields.items() if (f.alias or name) == part), None)
        model = _section_within(field.annotation) if field else top
    return [field.alias or name for name, field in model.model_fields.items()]


def _section_within(annotation: Any) -> Any:
    """The model that a field is, or that its list is of."""
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


# Sections of `gesture_master` with a list that may be kept in a CSV file: section, key of the file, key of the list.
_LISTS = (("rhythm", "corrections_file", "corrections"), ("style", "targets_file", "targets"))


def _with_files(config: Config, folder: Path | None) -> Config:
    """Read the lists that are kept in files into the config, so that nothing later depends on where they were kept."""
    config = _with_keywords(config, folder)
    master = config.gesture_master
    for (section, file, rows), model in zip(_LISTS, (Correction, StyleTarget), strict=True):
        settings = getattr(master, section)
        name = getattr(settings, file)
        if name is not None and getattr(settings, rows) is None:
            path = _beside(name, folder, f"gesture_master.{section}.{file}")
            settings = settings.model_copy(update={rows: _read_list(path, model, settings, rows)})
            master = master.model_copy(update={section: settings})
    return _with_control(config.model_copy(update={"gesture_master": master}), folder)


def _beside(name: str, folder: Path | None, key: str) -> Path:
    """A file named in a config: beside the config, or by its path."""
    places = [place / name for place in ([folder] if folder else []) + [Path()]]
    path = next((place for place in places if inputs.is_file(place)), None)
    if path is None:
        raise ConfigError(
            f"{key}: {inputs.shown(name)!r} does not exist (looked at {', '.join(map(inputs.shown, places))})"
        )
    return path


def _read_list(path: Path, model: type[_Section], settings: _Section, rows: str) -> tuple:
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
            key, allowed = ".".join(map(str, problem["loc"])), _allowed(problem["msg"])
            wrong = f"{key}: found {_brief(problem['input'])}, allowed: {allowed}" if key else allowed
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
    schedule = _validated(Schedule, values, origin, lines)
    if not (schedule.conditions or schedule.gestures):
        raise ConfigError(f"{origin}: neither conditions nor gestures in it; add some, or leave out control.file")
    if schedule.conditions and not config.controls:
        raise ConfigError(f"{origin}: conditions: {_NO_CONTROL}")
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

"""Settings of k-NN motion matching: section `motion_matching`."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from gesturegen.settings.base import Count, NotNegative, Positive, Section


class MotionMatching(Section):
    """Section `motion_matching`: features and search of k-NN motion matching."""

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
    def _start_given(self) -> Self:
        if (self.start == "given") != (self.start_pose is not None):
            raise ValueError("start: given goes with start_pose, a reference clip and a time such as trn_000@12.30")
        return self

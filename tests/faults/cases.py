"""The recommended configs on recordings of a few seconds."""

from __future__ import annotations

from pathlib import Path

from gesturegen.settings.loading import configs_folder
from tests.test_gesture_master import CUTTING, settings, write_recording
from tests.test_motion_matching import TINY

# What each stage writes, by the first folder or name below the work folder.
STAGES = {
    "preprocess": ("clips",),
    "build-graph": ("gestures", "graphs"),
    "reenact": ("reenact",),
    "evaluate": ("evaluate",),
    "pack": ("submission",),
}
_ARM = settings("joints=all", "wrists.enabled=false")
_PROSODY = settings("prosody.hop_length=800", "prosody.pitch_min=150.0", "prosody.pitch_max=300.0")
# The recommended configs, and what lets them work on recordings of a few seconds of a skeleton of a few joints.
CONFIGS = {
    "casia_go_2023": _ARM,
    "best": _ARM,
    "gesture_master_2022": (*_ARM, *settings(CUTTING), *_PROSODY),
    "motion_matching_2022": (*TINY, *settings("motion_matching.sequence_seconds=1.0"), *_PROSODY[:4]),
}


def write_data(data: Path) -> Path:
    """Two references and three tests of a few seconds."""
    for seed, (name, seconds) in enumerate((("trn_a", 6.0), ("trn_b", 5.0))):
        write_recording(data, name, seconds, seed)
    for seed, name in enumerate(("tst_a", "tst_b", "tst_c")):
        write_recording(data, name, 2.0, 10 + seed)
    return data


def arguments(config: str, data: Path, work: Path, jobs: int = 2, command: str = "run") -> list[str]:
    given = ["--config", configs_folder() / f"{config}.yaml", *CONFIGS[config], "--data", data, "--work", work]
    return [command, *map(str, given), "-j", str(jobs), "--quiet"]

"""The unit and the vertical of a BVH file: detected from the body, converted to centimetres and y up, written back.

BVH says neither. A body whose bones add up to 1.7 is in metres; one whose head stays above its pelvis along z and whose
feet stay below it stands along z. Where motion and rest pose disagree the motion says which way is up: some systems
export rest poses that lie, or bones along x.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gesturegen.motion import axes, bvh, kinematics, roles, rotation
from gesturegen.motion.skeleton import Motion, Skeleton, Space
from gesturegen.settings.models import UNITS, Config, MotionFiles

# Centimetres in the unit of the CMU recordings: 1 / 0.45 of an inch.
_CMU = 2.54 / 0.45
# Centimetres, of people and of what is drawn like people.
_SMALLEST, _LARGEST = 80.0, 260.0
_SAMPLES = 200
# How much of a body is along the axis that is up: its cosine, in the median over frames.
_UPRIGHT = 0.7
# The same of legs, which are bent where somebody sits.
_LEGS = 0.2


def read(path: str | Path, config: Config) -> Motion:
    """Read a BVH file in centimetres and with y up, whatever its unit and axes, which `Skeleton.space` keeps.

    Raises DataError as `bvh.read` does.
    """
    motion = bvh.read(path)
    return axes.to_inside(motion, detect(motion, config.motion, config.roles))


def detect(motion: Motion, settings: MotionFiles, overrides: Sequence[tuple[str, str | tuple[str, ...]]] = ()) -> Space:
    """Detect the unit and the vertical of a motion as it was read: as set, else as its body suggests."""
    found = roles.recognise(motion.skeleton, overrides)
    scale = UNITS.get(settings.unit) if isinstance(settings.unit, str) else float(settings.unit)
    if scale is None:
        scale = _scale(motion.skeleton, found)
    up = settings.up_axis if settings.up_axis != "auto" else _vertical(motion, found)
    return Space(scale, up)


def _scale(skeleton: Skeleton, found: roles.Roles) -> float:
    """Compute the centimetres in a unit from the height of the body; 1 where that fits no unit or there is no body."""
    height = roles.body_height(skeleton, found)
    if height <= 0 or not (found.is_body or found.pair("wrist") or found.pair("ankle")):
        return 1.0
    units = [UNITS["cm"], UNITS["m"], UNITS["mm"], UNITS["inch"]]
    if found.family == "CMU":
        units.append(_CMU)
    fitting = [unit for unit in units if _SMALLEST <= height * unit <= _LARGEST]
    # A child of 90 cm would also be a giant of 90 inches.
    return min(fitting, key=lambda unit: abs(np.log(height * unit / 170.0)), default=1.0)


def _vertical(motion: Motion, found: roles.Roles) -> str:
    """Tell the vertical axis of a motion: `z` where the body stands along z, else `y`."""
    pelvis, head = found["pelvis"], found["head"]
    if pelvis < 0 or head < 0:
        return "y"
    frames = np.unique(np.linspace(0, motion.n_frames - 1, min(motion.n_frames, _SAMPLES)).round().astype(int))
    ankles = found.pair("ankle")
    places = kinematics.joint_positions(motion.take(frames), [pelvis, head, *ankles])
    height = max(roles.body_height(motion.skeleton, found), 1e-9)
    trunk, legs = _along(places, 1)
    if trunk > _UPRIGHT and legs > _LEGS:
        return "y"
    trunk, legs = _along(places, 2)
    resting = _rests_along(motion.skeleton, [pelvis, head, *ankles])
    # Whoever sits on the floor has legs that say nothing.
    if trunk <= _UPRIGHT or (legs <= _LEGS and resting != "z"):
        return "y"
    if resting != "y" or not ankles:
        return "z"
    # At rest along y: somebody who lies along z, or a body that was turned to stand along z? That has its feet on a floor.
    floor = np.percentile(places[:, 2:, 2].min(axis=1), 10)
    return "z" if abs(floor) < 0.2 * height or np.ptp(places[:, 0, 1]) > 0.5 * height else "y"


def _along(places: np.ndarray, axis: int) -> tuple[float, float]:
    """Measure how upright trunk and legs are along an axis, from pelvis, head and ankles `[shape=(T, 2 + A, 3)]`.

    Cosines, the median over frames; legs that are not there are along any axis.
    """
    pelvis, head, ankles = places[:, 0], places[:, 1], places[:, 2:]
    legs = _cosine(pelvis - ankles.mean(axis=1), axis) if ankles.shape[1] else 1.0
    return _cosine(head - pelvis, axis), legs


def _cosine(ways: np.ndarray, axis: int) -> float:
    """Compute the median cosine between vectors `[shape=(T, 3)]` and an axis."""
    return float(np.median(ways[:, axis] / np.maximum(np.linalg.norm(ways, axis=1), 1e-9)))


def _rests_along(skeleton: Skeleton, joints: Sequence[int]) -> str:
    """Name the axis along which a body stands where no joint turns; empty where it stands along neither y nor z."""
    still = np.tile(rotation.IDENTITY, (1, len(skeleton.names), 1))
    rest = Motion(skeleton, still, np.asarray(skeleton.offsets)[None], 1.0)
    places = kinematics.joint_positions(rest, list(joints))
    return next((name for name, axis in (("y", 1), ("z", 2)) if min(_along(places, axis)) > _UPRIGHT), "")


def kind_of(note: str) -> str | None:
    """Classify a line of `notes` regardless of the figure in it; None for a line of another kind."""
    known = ("lengths are taken to be in", "its figure is", *(f"{axis} is taken to be up" for axis in "yz"))
    return next((note.split(",")[0] if kind == known[0] else kind for kind in known if note.startswith(kind)), None)


def notes(skeleton: Skeleton, config: Config) -> list[str]:
    """List what was assumed of a file, a line for each kind of assumption; empty for centimetres with y up."""
    space, lines = skeleton.space, []
    height = roles.body_height(skeleton, roles.recognise(skeleton, config.roles))
    set_unit, set_up = config.motion.unit != "auto", config.motion.up_axis != "auto"
    if space.scale != 1.0:
        name = next((name for name, scale in UNITS.items() if scale == space.scale), f"units of {space.scale:.4g} cm")
        why = "as set" if set_unit else f"for its figure is {height / space.scale:.4g} units tall"
        lines.append(f"lengths are taken to be in {name}, {why} (motion.unit); written back as they came")
    elif not set_unit and height > 0 and not _SMALLEST <= height <= _LARGEST:
        lines.append(f"its figure is {height:.4g} units tall, which fits no unit: taken for cm; set motion.unit")
    if space.up != "y":
        lines.append(
            f"{space.up} is taken to be up{', as set' if set_up else ''} (motion.up_axis); written back as it came"
        )
    return lines

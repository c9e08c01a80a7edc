"""Description of how a BVH file is read: its unit, its vertical axis, and which joint is which part of the body."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from gesturegen.joints import roles_of, settings_for
from gesturegen.methods import METHODS
from gesturegen.motion import axes, bvh, roles, space
from gesturegen.settings.models import Config


def _value(key: str, config: Config) -> Any:
    """Look up a setting by its section and name."""
    section, _, name = key.partition(".")
    return getattr(getattr(config, section), name)


_SETTINGS: tuple[tuple[str, Callable[[Config], Any]], ...] = (
    ("joints", lambda config: config.joints), ("wrists.joints", lambda config: config.wrists.joints),
    ("wrists.axes", lambda config: [config.wrists.axes]), ("feet.joints", lambda config: config.feet.joints),
    ("control.left, control.right", lambda config: [config.control.left, config.control.right]),
    *((key, partial(_value, key)) for method in METHODS.values() for key in method.joint_settings),
)  # fmt: skip


def describe_skeleton(path: Path, config: Config) -> dict:
    """Gather the facts of a BVH file, ready for JSON: lengths in cm, joints by name."""
    motion = bvh.read(path)
    found_space = space.detect(motion, config.motion, config.roles)
    skeleton = axes.to_inside(motion, found_space).skeleton
    found = roles_of(skeleton, config)
    own = settings_for(skeleton, config)
    return {
        "file": str(path),
        "joints": len(skeleton.names),
        "frames": motion.n_frames,
        "fps": motion.fps,
        "centimetres_per_unit": found_space.scale,
        "up_axis": found_space.up,
        "height": round(roles.body_height(skeleton, found), 2),
        "family": found.family,
        "is_body": found.is_body,
        "by_shape": list(found.by_shape),
        "roles": roles.describe(skeleton, found),
        "settings": {
            name: list(value) if value != "all" else ["all"] for name, get in _SETTINGS if (value := get(own))
        },
        "notes": space.notes(skeleton, config),
    }


def skeleton_lines(facts: Mapping) -> list[str]:
    """Format the facts of a BVH file: a line for each role, then the values of the settings that name joints."""
    told = facts["family"] or ("a body, by its shape" if facts["is_body"] else "no body that is known")
    lines = [
        f"{facts['file']}: {facts['joints']} joints, {facts['frames']} frames at {facts['fps']:.6g} fps",
        f"recognised: {told}" + (" (in part by its shape)" if facts["by_shape"] and facts["family"] else ""),
        f"unit: {facts['centimetres_per_unit']:.6g} cm, up: {facts['up_axis']}, height of the body: {facts['height']:.1f} cm",
        "",
    ]
    width = max(map(len, facts["roles"]))
    lines += [f"{role:{width}}  {' '.join(names) or '-'}" for role, names in facts["roles"].items()]
    lines += ["", "settings that name joints, with this skeleton:"]
    lines += [f"  {name}: {', '.join(names)}" for name, names in facts["settings"].items()]
    if not facts["is_body"]:
        lines.append("name its joints in section `skeleton` of the config, such as skeleton.left_wrist")
    return lines

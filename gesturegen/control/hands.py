"""Measures of the hands in the nodes of a library and in the frames of a motion, for control."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from gesturegen.control.measures import hand_measures
from gesturegen.errors import DataError
from gesturegen.frames import ReferenceFrames
from gesturegen.settings.control import Control


def names(control: Control, joint_names: Sequence[str], by_role: Sequence[str] = ()) -> list[str]:
    """Name the joints that are the left and the right hand.

    by_role : those that are hands by their roles, which stand in for the default names where these are no joints
    """
    default, given = Control(), [control.left, control.right]
    if len(by_role) == 2 and given == [default.left, default.right] and not set(given) & set(joint_names):
        return list(by_role)
    return given


def of_nodes(library: ReferenceFrames, control: Control) -> dict[tuple[str, str], np.ndarray]:
    """Measure the hands in every node of a library (`measures.hand_measures`).

    Raises DataError for a hand that is none of the joints that positions are kept of.
    """
    return of_positions(
        library.positions, library.joint_names, library.segment_starts, library.fps, control, library.hand_names
    )


def of_positions(
    positions: np.ndarray, joint_names: Sequence[str], segment_starts: ArrayLike, fps: float, control: Control,
    by_role: Sequence[str] = (),
) -> dict[tuple[str, str], np.ndarray]:  # fmt: skip
    """Measure the hands in every frame of joint positions.

    positions : float `[shape=(T, J, 3)]`, of the named joints, seen from the pelvis, cm
    by_role : as in `names`
    """
    places = []
    for side, name in zip(("left", "right"), names(control, joint_names, by_role), strict=True):
        if name not in joint_names:
            raise DataError(
                f"control.{side}: {name!r} is none of the joints that are measured (joints): {', '.join(joint_names)}"
            )
        places.append(list(joint_names).index(name))
    return hand_measures(positions[:, places], segment_starts, fps)

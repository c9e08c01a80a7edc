"""Where the hands are: in the nodes of a library and in the frames of a motion, as control looks at them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesturegen.config import Control
from gesturegen.control.measures import hand_measures
from gesturegen.errors import DataError
from gesturegen.graph.reference_frames import ReferenceFrames
from gesturegen.motion import roles


def of_nodes(library: ReferenceFrames, control: Control) -> dict[tuple[str, str], np.ndarray]:
    """Every measure of the hands in every node (`measures.hand_measures`).

    Raises DataError for a hand that is none of the joints that positions are kept of.
    """
    return of_positions(library.positions, library.joint_names, library.segment_starts, library.fps, control)


def of_positions(
    positions: np.ndarray, joint_names: Sequence[str], segment_starts: Sequence[int], fps: float, control: Control
) -> dict[tuple[str, str], np.ndarray]:
    """The same of positions `[shape=(T, J, 3)]` of named joints, seen from the pelvis, cm."""
    places = []
    for side in ("left", "right"):
        name = getattr(control, side)
        if name not in joint_names and name == getattr(Control(), side):
            # Another family's skeleton, which has no joint of the default's name.
            name = roles.hand_named(joint_names, side) or name
        if name not in joint_names:
            raise DataError(
                f"control.{side}: {name!r} is none of the joints that are measured (joints): {', '.join(joint_names)}"
            )
        places.append(list(joint_names).index(name))
    return hand_measures(positions[:, places], segment_starts, fps)

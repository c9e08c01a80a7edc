"""The two types that carry motion: `Skeleton` and `Motion`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches

import numpy as np

from gesturegen.errors import DataError


def read_only(array: np.ndarray) -> np.ndarray:
    """Return a view of `array` that cannot be written through."""
    view = np.asarray(array).view()
    view.setflags(write=False)
    return view


@dataclass(frozen=True)
class Space:
    """The unit and the vertical of a file, by which its numbers are converted to centimetres with y up.

    scale : centimetres in one unit of the file
    up : the axis of the file that points up, `y` or `z`
    """

    scale: float = 1.0
    up: str = "y"


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A joint hierarchy as a BVH file declares it, parents before children.

    names : joint names in file order
    parents : int [shape=(J,)], -1 for the root
    offsets : float [shape=(J, 3)], OFFSET of every joint, centimetres and y up (as in the file where `space` is plain)
    end_sites : float [shape=(J, 3)], OFFSET of the joint's End Site, NaN where it has none
    channels : per joint, its channel names in file order, such as `("Xposition", ..., "Yrotation")`
    hierarchy : the text from HIERARCHY up to MOTION as read, so that writing repeats it to the letter
    space : what the file's own unit and vertical are; files are written back in these
    """

    names: tuple[str, ...]
    parents: np.ndarray
    offsets: np.ndarray
    end_sites: np.ndarray
    channels: tuple[tuple[str, ...], ...]
    hierarchy: str
    space: Space = Space()

    def __post_init__(self) -> None:
        joints = len(self.names)
        for name, shape in (("parents", (joints,)), ("offsets", (joints, 3)), ("end_sites", (joints, 3))):
            array = read_only(getattr(self, name))
            if array.shape != shape:
                raise ValueError(f"skeleton {name} has shape {array.shape}, expected {shape}")
            object.__setattr__(self, name, array)
        if joints == 0 or self.parents[0] != -1 or any(p < 0 or p >= j for j, p in enumerate(self.parents) if j):
            raise ValueError("skeleton joints must start with the root and list parents before children")

    @property
    def n_channels(self) -> int:
        """Number of channels of all joints."""
        return sum(len(channels) for channels in self.channels)

    def index(self, name: str) -> int:
        """Return the number of the joint called `name`; raises DataError with the nearest name when there is none."""
        try:
            return self.names.index(name)
        except ValueError:
            near = get_close_matches(name, self.names, n=1, cutoff=0.4)
            hint = f", nearest is {near[0]!r}" if near else ""
            raise DataError(f"the skeleton has no joint {name!r}{hint}; it has: {', '.join(self.names)}") from None

    def children(self, joint: int) -> list[int]:
        """List the joints right below `joint`, in file order."""
        return [j for j, parent in enumerate(self.parents) if parent == joint]

    def descendants(self, joint: int) -> list[int]:
        """List all joints below `joint`, in file order."""
        below = {joint}
        for j, parent in enumerate(self.parents):
            if parent in below:
                below.add(j)
        return sorted(below - {joint})

    def pelvis(self, name: str) -> int:
        """Find the joint called `name`, else the first joint from the root down where the hierarchy branches."""
        if name in self.names:
            return self.names.index(name)
        joint = 0
        while len(below := self.children(joint)) == 1:
            joint = below[0]
        return joint

    def difference(self, other: Skeleton, tolerance: float = 1e-4) -> str | None:
        """Describe how two skeletons differ; None when joints, offsets and channels are equal.

        tolerance : by which the OFFSET of a joint may differ, in its length and direction; files round them differently.
        OFFSETs from the root to where the hierarchy branches say nothing where position channels replace them.
        """
        stem = self._stem()
        if self.names != other.names:
            if len(self.names) != len(other.names):
                return f"{len(self.names)} joints against {len(other.names)}"
            first = next(j for j, (a, b) in enumerate(zip(self.names, other.names, strict=True)) if a != b)
            return f"joint {first} is {self.names[first]!r} against {other.names[first]!r}"
        for j, name in enumerate(self.names):
            if self.parents[j] != other.parents[j]:
                return f"joint {name!r} has another parent"
            if self.channels[j] != other.channels[j]:
                return f"joint {name!r} has channels {' '.join(self.channels[j])} against {' '.join(other.channels[j])}"
            if j in stem and sum(channel.endswith("position") for channel in self.channels[j]) == 3:
                continue
            if np.abs(self.offsets[j] - other.offsets[j]).max() > tolerance:
                return f"joint {name!r} has OFFSET {self.offsets[j]} against {other.offsets[j]}"
        return None

    def _stem(self) -> set[int]:
        """Collect the joints from the root to the first at which the hierarchy branches."""
        joint, stem = 0, {0}
        while len(below := self.children(joint)) == 1:
            joint = below[0]
            stem.add(joint)
        return stem


@dataclass(frozen=True, eq=False)
class Motion:
    """Local rotations and positions of every joint in every frame.

    rotations : float [shape=(T, J, 4)], unit quaternions wxyz, child to parent
    positions : float [shape=(T, J, 3)], local positions; a position channel replaces the OFFSET
    fps : frames per second
    written_joints : int [shape=(K,)], joints whose angles a file writes otherwise than one would from their rotations
    written_angles : float [shape=(T, K, 3)], these angles, degrees, in the file's order; NaN where a frame is not
        one of a file, or does not follow on the frame before. They say nothing of a joint that turns otherwise by now.
    """

    skeleton: Skeleton
    rotations: np.ndarray
    positions: np.ndarray
    fps: float
    written_joints: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    written_angles: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3)))

    def __post_init__(self) -> None:
        # Whoever makes other frames of a motion need not know of the angles: those of other frames say nothing.
        if self.written_angles.shape[:2] != (len(self.rotations), len(self.written_joints)):
            object.__setattr__(self, "written_joints", np.zeros(0, dtype=np.int64))
            object.__setattr__(self, "written_angles", np.zeros((len(self.rotations), 0, 3)))
        frames, joints = len(self.rotations), len(self.skeleton.names)
        for name, width in (("rotations", 4), ("positions", 3)):
            array = read_only(getattr(self, name))
            if array.shape != (frames, joints, width):
                raise ValueError(f"motion {name} has shape {array.shape}, expected {(frames, joints, width)}")
            object.__setattr__(self, name, array)

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.rotations)

    def take(self, frames: np.ndarray | slice) -> Motion:
        """Select frames by an index array or slice."""
        return replace(
            self, rotations=self.rotations[frames], positions=self.positions[frames],
            written_angles=self.written_angles[frames],
        )  # fmt: skip

    def cut_at(self, frames: np.ndarray) -> Motion:
        """Mark frames (numbers, or bool for each) that do not follow on the one before in a file."""
        if not len(self.written_joints):
            return self
        angles = np.array(self.written_angles)
        angles[frames] = np.nan
        return replace(self, written_angles=angles)


def written_of(motions: Sequence[Motion]) -> tuple[np.ndarray, np.ndarray]:
    """Join `written_joints` and `written_angles` of motions one after the other, as arguments of `Motion`."""
    joints = np.unique(np.concatenate([motion.written_joints for motion in motions])).astype(np.int64)
    angles = np.full((sum(motion.n_frames for motion in motions), len(joints), 3), np.nan)
    first = 0
    for motion in motions:
        angles[first : first + motion.n_frames, np.searchsorted(joints, motion.written_joints)] = motion.written_angles
        first += motion.n_frames
    return joints, angles

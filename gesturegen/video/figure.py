"""The drawn figure of a motion: bones with a thickness and a side, facing the viewer, in body heights.

Left and right are told apart by the joints' names, the direction a body faces by its hips and shoulders.
Face helpers (tongue, teeth, eyes, jaw) are left out: at this size they are a smudge.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gesturegen.motion import kinematics, rotation
from gesturegen.motion.skeleton import Motion, Skeleton

CENTRE, LEFT, RIGHT = 0, 1, 2
_NAMED_LEFT = re.compile(r"(?i:left)|(?:^|[^A-Za-z])[lL](?:[^A-Za-z]|$)|^[lL](?=[A-Z])")
_NAMED_RIGHT = re.compile(r"(?i:right)|(?:^|[^A-Za-z])[rR](?:[^A-Za-z]|$)|^[rR](?=[A-Z])")
_NOT_DRAWN = re.compile(r"(?i)tongue|teeth|tooth|jaw|eye|brow|lid|lip(?!s*joint)|cheek|nose|navel|delt")
_HEAD = re.compile(r"(?i)head(?!.*(null|end|nub|top|site))")
_FOLLOW_SECONDS = 0.5
# Some skeletons end at the neck's top, or just above it.
_SMALLEST_HEAD = 0.04


@dataclass(frozen=True, eq=False)
class Figure:
    """A body to draw; lengths in body heights, Y up, the floor at 0, facing +Z on average.

    points : float [shape=(T, K, 3)]; bones : int [shape=(B, 2)], the points that each bone joins
    radii : float [shape=(B,)]; sides : int [shape=(B,)], CENTRE, LEFT or RIGHT
    targets : float [shape=(T, 2)], X and Z on the floor that the camera follows
    height : of the body in file units
    """

    points: np.ndarray
    bones: np.ndarray
    radii: np.ndarray
    sides: np.ndarray
    targets: np.ndarray
    height: float


def make_figure(motion: Motion, root_joint: str) -> Figure:
    """Make the figure of a motion; `root_joint` names the pelvis, which the camera follows."""
    skeleton = motion.skeleton
    pelvis = skeleton.pelvis(root_joint)
    if not skeleton.children(pelvis):
        pelvis = 0  # a chain has no pelvis: all of it is drawn
    drawn = [j for j in [pelvis, *skeleton.descendants(pelvis)] if not _hidden(skeleton, j)]
    rotations, joints = kinematics.world_transforms(motion)
    points, bones, sides = _collect_bones(skeleton, drawn, pelvis, rotations, joints)
    turn = rotation.about_y(-_facing(skeleton, drawn, joints))
    points = rotation.rotate(turn, points)
    floor = np.percentile(points[..., 1].min(axis=1), 10)
    extent = np.percentile(points[..., 1].max(axis=1), 95) - floor
    # A figure that lies on the floor is still as long as it is.
    height = max(float(extent), 0.5 * float(np.ptp(points[0], axis=0).max()), 1e-6)
    points = (points - [0.0, floor, 0.0]) / height
    lengths = np.linalg.norm(points[0, bones[:, 0]] - points[0, bones[:, 1]], axis=-1)
    targets = _smooth_track(points[:, 0][:, [0, 2]], _FOLLOW_SECONDS * motion.fps)
    radii = np.clip(0.13 * lengths, 0.006, 0.018)
    points, bones, radii, sides = _add_head(skeleton, drawn, points, bones, radii, sides)
    return Figure(points, bones, radii, sides, targets, height)


def _smooth_track(track: np.ndarray, sigma: float) -> np.ndarray:
    """Remove the sway from a track `[shape=(T, 2)]`; a walk is continued beyond both ends, so that it leads to them."""
    pad = min(int(3 * sigma), len(track) - 1)
    longer = np.pad(track, ((pad, pad), (0, 0)), mode="reflect", reflect_type="odd") if pad else track
    return gaussian_filter1d(longer, sigma, axis=0, mode="nearest")[pad : pad + len(track)]


def _hidden(skeleton: Skeleton, joint: int) -> bool:
    """Tell whether a joint or one above it is a face helper."""
    while joint >= 0:
        if _NOT_DRAWN.search(skeleton.names[joint]):
            return True
        joint = int(skeleton.parents[joint])
    return False


def side_of(name: str) -> int:
    """Tell the side of a joint by its name: `b_l_wrist`, `LeftArm`, `UpperArm_L`, `lShldr`."""
    left, right = _NAMED_LEFT.search(name), _NAMED_RIGHT.search(name)
    return CENTRE if bool(left) == bool(right) else LEFT if left else RIGHT


def _collect_bones(
    skeleton: Skeleton, drawn: list[int], pelvis: int, rotations: np.ndarray, joints: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Collect points (the pelvis first), bones and sides: from each joint to its parent, and to its End Site if any."""
    place = {joint: k for k, joint in enumerate(drawn)}
    points = [joints[:, joint] for joint in drawn]
    bones, sides = [], []
    for joint in drawn:
        if joint != pelvis:
            bones.append((place[int(skeleton.parents[joint])], place[joint]))
            sides.append(side_of(skeleton.names[joint]))
        end = skeleton.end_sites[joint]
        if not np.isnan(end).any() and np.abs(end).max() > 0:
            bones.append((place[joint], len(points)))
            sides.append(side_of(skeleton.names[joint]))
            points.append(joints[:, joint] + rotation.rotate(rotations[:, joint], end))
    if not bones:  # a single joint is a dot
        bones, sides = [(0, 0)], [CENTRE]
    return np.stack(points, axis=1), np.array(bones), np.array(sides)


def _facing(skeleton: Skeleton, drawn: list[int], joints: np.ndarray) -> float:
    """Compute the mean heading in radians, from where hips and shoulders leave the trunk; 0 without sides."""
    groups: dict[int, list[int]] = {LEFT: [], RIGHT: []}
    for joint in drawn[1:]:
        side = side_of(skeleton.names[joint])
        if side != CENTRE and side_of(skeleton.names[skeleton.parents[joint]]) == CENTRE:
            groups[side].append(joint)
    if not groups[LEFT] or not groups[RIGHT]:
        return 0.0
    across = joints[:, groups[LEFT]].mean(axis=(0, 1)) - joints[:, groups[RIGHT]].mean(axis=(0, 1))
    # Facing +Z with Y up, left is +X.
    return float(np.arctan2(-across[2], across[0]))


def _add_head(
    skeleton: Skeleton, drawn: list[int], points: np.ndarray, bones: np.ndarray, radii: np.ndarray, sides: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Add a thick bone from the head joint to the crown; none where no joint is called a head."""
    heads = [k for k, joint in enumerate(drawn) if _HEAD.search(skeleton.names[joint])]
    if not heads:
        return points, bones, radii, sides
    rows = np.flatnonzero(bones[:, 0] == heads[0])
    if not len(rows):  # nothing above the head joint: a ball around it
        bones = np.concatenate([bones, [(heads[0], heads[0])]])
        return points, bones, np.append(radii, _SMALLEST_HEAD), np.append(sides, CENTRE)
    sizes = np.linalg.norm(points[0, bones[rows, 1]] - points[0, heads[0]], axis=-1)
    row, size = int(rows[sizes.argmax()]), float(sizes.max())
    base, tip = points[:, heads[0]], points[:, bones[row, 1]]
    # Round at both ends, the capsule reaches from the joint to the crown.
    radius = max(0.36 * size, _SMALLEST_HEAD)
    ends = np.stack([base + 0.4 * (tip - base), base + 0.68 * (tip - base)], axis=1)
    count = points.shape[1]
    bones, radii = bones.copy(), radii.copy()
    bones[row], radii[row] = (count, count + 1), radius
    return np.concatenate([points, ends], axis=1), bones, radii, sides

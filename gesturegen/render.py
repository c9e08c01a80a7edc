"""From a `Path` of graph nodes to motion: the one renderer that all methods share (§4.2.4).

Order: take the reference frames of the nodes; keep the root from jumping; with `inertialize`, let the
offsets at jumps decay; resample every piece to its length; with `crossfade`, blend the joins, with
`least_jerk` correct around all jumps; lock the feet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gesturegen.clips import Reference, select_joints
from gesturegen.config import Config
from gesturegen.graph.motion_graph import MotionGraph
from gesturegen.motion import blend, cleanup, feet, kinematics, rotation
from gesturegen.motion.skeleton import Motion
from gesturegen.search.path import Path, Piece, resampled_indices

# Of times, which are sums of fractions.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class _Steps:
    """How each node follows the one before it: bool `[shape=(n,)]`; the first is neither."""

    hold: np.ndarray
    jump: np.ndarray


def render(path: Path, references: Sequence[Reference], graph: MotionGraph, config: Config) -> Motion:
    """The motion of a complete path: exactly as many frames as its targets have, at the graph's rate.

    references : those of the graph, in its order. All joints of the skeleton move, so that fingers follow
    their arm, unless `fingers: rest`.
    """
    pieces = path.tracks[0].pieces
    nodes = path.tracks[0].nodes
    recorded = _Recorded(references, graph)
    source = recorded.take(nodes)
    before = nodes[:-1]
    hold = np.append(False, nodes[1:] == before)
    steps = _Steps(hold, np.append(False, (nodes[1:] != graph.successors[before]) & (nodes[1:] != before)))
    # A body that stands still would go on standing, whatever the recording does next.
    successors = recorded.take(np.where(hold, nodes, graph.successors[nodes]))
    if config.root.mode == "return":
        source, successors = _steady_root(source, successors, steps, references, config)
    rotations, positions = source.rotations.copy(), source.positions.copy()
    if config.blend.method == "inertialize":
        _inertialize(rotations, positions, successors, steps, config)
    kept, times = _timeline(pieces, nodes, graph, config.resample)
    jumps = _jumps(times, steps.jump[kept])
    motion = cleanup.interpolate(replace(source, rotations=rotations[kept], positions=positions[kept]), times)
    rotations, positions = motion.rotations.copy(), motion.positions.copy()
    if config.blend.method == "crossfade":
        _crossfade_joins(rotations, positions, pieces, graph, config)
    elif config.blend.method == "least_jerk":
        rotations, positions = blend.least_jerk(rotations, positions, jumps, config.blend.reach_seconds * motion.fps)
    if config.feet.lock:
        motion = replace(motion, rotations=rotation.normalize(rotations), positions=positions)
        as_recorded = cleanup.interpolate(recorded.take(nodes[kept]), times)
        bearing = recorded.foot_contacts(config.feet.joints)[nodes[kept][np.round(times).astype(int)]]
        pelvis = motion.skeleton.pelvis(config.positions.root_joint)
        rotations = feet.lock(motion, as_recorded, bearing, jumps, pelvis, config.feet).rotations
    if config.fingers == "rest":
        rotations[:, _fingers(motion, config)] = rotation.IDENTITY
    return replace(motion, rotations=rotation.normalize(rotations), positions=positions)


class _Recorded:
    """The reference frames by graph node."""

    def __init__(self, references: Sequence[Reference], graph: MotionGraph):
        self.references, self.starts = references, graph.clip_starts

    def take(self, nodes: np.ndarray) -> Motion:
        first = self.references[0].motion
        shape = (len(nodes), len(first.skeleton.names))
        rotations, positions = np.empty((*shape, 4)), np.empty((*shape, 3))
        clips = np.searchsorted(self.starts, nodes, side="right") - 1
        for clip in np.unique(clips):
            chosen = clips == clip
            frames = nodes[chosen] - self.starts[clip]
            rotations[chosen] = self.references[clip].motion.rotations[frames]
            positions[chosen] = self.references[clip].motion.positions[frames]
        return Motion(first.skeleton, rotations, positions, first.fps)

    def foot_contacts(self, joints: Sequence[str]) -> np.ndarray:
        """bool `[shape=(N, F)]`: which of the feet that there are bear weight, by node."""
        names = self.references[0].motion.skeleton.names
        places = [names.index(name) for name in joints if name in names]
        if not places:
            return np.zeros((sum(r.motion.n_frames for r in self.references), 0), dtype=bool)
        return np.concatenate([feet.contacts(kinematics.joint_positions(r.motion, places)) for r in self.references])


# --- root ---------------------------------------------------------------------------------------------------


def _steady_root(
    source: Motion, successors: Motion, steps: _Steps, references: Sequence[Reference], config: Config
) -> tuple[Motion, Motion]:
    """Move ground position and heading so that they never jump; the offset then decays.

    At a jump the new side starts where the old side's next frame would have been. Within a run the offset
    turns the travelled way along with the body, so that feet do not slide more than the decay makes them.
    """
    skeleton = source.skeleton
    travelling = kinematics.travelling_joint([reference.motion for reference in references])
    pelvis = skeleton.pelvis(config.positions.root_joint)
    zero_heading = kinematics.world_transforms(references[0].motion.take(slice(0, 1)), [pelvis])[0][0, 0]
    here = _ground_poses(source, travelling, pelvis, zero_heading)
    ahead = _ground_poses(successors, travelling, pelvis, zero_heading)
    offsets = np.array(_ground_offsets(here, ahead, steps, 0.5 ** (1.0 / (config.root.return_half_life * source.fps))))
    moved = _move_ground(source, travelling, offsets[:, 0], offsets[:, 1:3])
    return moved, _move_ground(successors, travelling, offsets[:, 3], offsets[:, 4:6])


def _ground_poses(motion: Motion, travelling: int, pelvis: int, zero_heading: np.ndarray) -> np.ndarray:
    """Heading in radians, x and z `[shape=(T, 3)]`: position of the travelling joint, heading of the pelvis."""
    rotations, positions = kinematics.world_transforms(motion, [travelling, pelvis])
    turned = rotation.multiply(rotations[:, 1], rotation.inverse(zero_heading))
    return np.column_stack([rotation.heading(turned), positions[:, 0, 0], positions[:, 0, 2]])


def _ground_offsets(here: np.ndarray, ahead: np.ndarray, steps: _Steps, decay: float) -> list[list[float]]:
    """Per node the offset (turn, x, z) of its frame and of its natural successor's."""
    rows = []
    turn = x = z = next_turn = next_x = next_z = 0.0
    for k, ((heading, px, pz), (_, ax, az)) in enumerate(zip(here.tolist(), ahead.tolist(), strict=True)):
        if steps.jump[k]:
            old_heading, old_x, old_z = ahead[k - 1]
            turn = float(rotation.wrap_angle(old_heading + next_turn - heading))
            x, z = old_x + next_x - px, old_z + next_z - pz
        elif k and not steps.hold[k]:
            turn, x, z = next_turn, next_x, next_z
        cosine, sine = np.cos(turn) - 1.0, np.sin(turn)
        step_x, step_z = ax - px, az - pz
        next_turn = decay * turn
        next_x = decay * x + cosine * step_x + sine * step_z
        next_z = decay * z - sine * step_x + cosine * step_z
        rows.append([turn, x, z, next_turn, next_x, next_z])
    return rows


def _move_ground(motion: Motion, travelling: int, turns: np.ndarray, shifts: np.ndarray) -> Motion:
    """Turn the travelling joint about the vertical through itself and shift it on the ground, in world space."""
    joints = [travelling]
    parent = int(motion.skeleton.parents[travelling])
    world_rotations, world_positions = kinematics.world_transforms(motion, joints)
    turned = rotation.multiply(rotation.about_y(turns), world_rotations[:, 0])
    moved = world_positions[:, 0].copy()
    moved[:, [0, 2]] += shifts
    if parent >= 0:
        parent_rotations, parent_positions = kinematics.world_transforms(motion, [parent])
        back = rotation.inverse(parent_rotations[:, 0])
        turned, moved = rotation.multiply(back, turned), rotation.rotate(back, moved - parent_positions[:, 0])
    rotations, positions = motion.rotations.copy(), motion.positions.copy()
    rotations[:, travelling], positions[:, travelling] = turned, moved
    return replace(motion, rotations=rotations, positions=positions)


# --- joins --------------------------------------------------------------------------------------------------


def _inertialize(
    rotations: np.ndarray, positions: np.ndarray, successors: Motion, steps: _Steps, config: Config
) -> None:
    """At every jump keep the new side and let its offset in pose and velocity to the old side decay, in place."""
    fps = successors.fps
    jumps = np.flatnonzero(steps.jump)
    ends = np.append(jumps, len(rotations))[1:]
    # What the current run adds to its source at the frame after its last one.
    turn_ahead, shift_ahead = np.zeros((*rotations.shape[1:-1], 3)), np.zeros(positions.shape[1:])
    for start, end in zip(jumps, ends, strict=True):
        last = start - 1
        expected = rotation.multiply(rotation.from_expmap(turn_ahead), successors.rotations[last])
        expected_place = successors.positions[last] + shift_ahead
        turn = rotation.to_expmap(rotation.multiply(expected, rotation.inverse(rotations[start])))
        shift = expected_place - positions[start]
        spin = _spin(rotations[last], expected) - _spin(rotations[start], successors.rotations[start])
        drift = (expected_place - positions[last]) - (successors.positions[start] - positions[start])
        times = np.arange(end - start + 1) / fps
        turns = blend.spring_decay(turn, spin * fps, times, config.blend.half_life)
        shifts = blend.spring_decay(shift, drift * fps, times, config.blend.half_life)
        rotations[start:end] = rotation.multiply(rotation.from_expmap(turns[:-1]), rotations[start:end])
        positions[start:end] += shifts[:-1]
        turn_ahead, shift_ahead = turns[-1], shifts[-1]


def _spin(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The rotation vector from one pose to the next, in radians per frame."""
    return rotation.to_expmap(rotation.multiply(after, rotation.inverse(before)))


def _timeline(
    pieces: Sequence[Piece], nodes: np.ndarray, graph: MotionGraph, how: str
) -> tuple[np.ndarray, np.ndarray]:
    """Which of all nodes are interpolated between `[shape=(K,)]`, and where among them each output frame lies.

    Every piece is evenly resampled to its target's length. A node that a piece holds before it goes on to its
    natural successor is on the way there all the while, slow motion in place of a stop: only the first of its
    copies is kept. A pose that is repeated for want of a path (A.1.1) stays.
    """
    times, first = [], 0
    for piece in pieces:
        indices = resampled_indices(len(piece.nodes), piece.target.length)
        times.append(first + (np.round(indices) if how == "nearest" else indices))
        first += len(piece.nodes)
    evenly = np.concatenate(times)
    everything = np.arange(len(nodes))
    if how == "nearest":
        return everything, evenly
    counts = np.array([len(piece.nodes) for piece in pieces])
    fresh = np.append(True, nodes[1:] != nodes[:-1])
    fresh[np.cumsum(counts)[:-1]] = True
    begins = np.flatnonzero(fresh)
    ends = np.append(begins[1:], len(nodes))
    repeated = np.repeat([piece.fallback == "repeat" for piece in pieces], counts)[begins]
    goes_on = np.append(nodes[begins[1:]] == graph.successors[nodes[begins[:-1]]], False) & ~repeated
    copies = np.repeat(ends - begins, ends - begins)
    copy = everything - np.repeat(begins, ends - begins)
    slowed = np.repeat(goes_on, ends - begins)
    keeps = ~slowed | (copy == 0)
    places = np.cumsum(keeps) - 1.0 + np.where(slowed, copy / copies, 0.0)
    return np.flatnonzero(keeps), np.interp(evenly, everything, places)


def _jumps(times: np.ndarray, jump: np.ndarray) -> np.ndarray:
    """bool `[shape=(n_frames,)]`: output frames between which and the one before lies a jump, or part of one.

    jump : bool `[shape=(K,)]`, of the nodes that `times` lie among
    """
    counts = np.cumsum(jump)
    before, after = np.floor(times[:-1] + _ROUNDING).astype(int), np.ceil(times[1:] - _ROUNDING).astype(int)
    return np.append(False, counts[after] > counts[before])


def _crossfade_joins(
    rotations: np.ndarray, positions: np.ndarray, pieces: Sequence[Piece], graph: MotionGraph, config: Config
) -> None:
    """Cross-fade every join that is not natural, left to right, in place."""
    seams = [
        piece.target.start_frame
        for before, piece in pairwise(pieces)
        if piece.nodes[0] != graph.successors[before.nodes[-1]]
    ]
    for seam, right_end in pairwise([*seams, len(rotations)]):
        blend.crossfade(rotations, positions, seam, right_end, config.blend)


def _fingers(motion: Motion, config: Config) -> list[int]:
    """Joints below the wrists that are not selected for distances."""
    names = motion.skeleton.names
    wrists = [names.index(name) for name in config.wrists.joints if name in names]
    below = {joint for wrist in wrists for joint in motion.skeleton.descendants(wrist)}
    selected, _ = select_joints(motion.skeleton, config)
    return sorted(below - set(selected))

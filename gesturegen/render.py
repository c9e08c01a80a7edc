"""Rendering of a `Path` of graph nodes to motion, by the one renderer that all methods share (§4.2.4).

Each track of the path is rendered by itself. Order: take the reference frames of the nodes; keep the root from
jumping; with `inertialize`, let the offsets at jumps decay; resample every piece to its length; with `crossfade`
or `overlap`, blend the joins, with `least_jerk` correct around all jumps. Then put the tracks together, smooth,
and lock the feet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gesturegen.data.clips import Reference, select_joints
from gesturegen.frames import ReferenceFrames
from gesturegen.joints import fingers, settings_for
from gesturegen.motion import blend, body, cleanup, feet, kinematics, rotation, smoothing, splice
from gesturegen.motion.skeleton import Motion, Skeleton, written_of
from gesturegen.path import Path, Piece, Track, resampled_indices
from gesturegen.settings.models import Config

# Of times, which are sums of fractions.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class _Steps:
    """The steps from node to node, bool `[shape=(n,)]`: whether a node is held or jumped to; the first is neither."""

    hold: np.ndarray
    jump: np.ndarray


@dataclass(frozen=True)
class _Rendered:
    """The motion of a track, and of its frames the recorded motion, the bearing feet and the jumps.

    as_recorded : None where feet are not locked, which alone needs it
    """

    motion: Motion
    as_recorded: Motion | None
    bearing: np.ndarray
    jumps: np.ndarray


def render(path: Path, references: Sequence[Reference], graph: ReferenceFrames, config: Config) -> Motion:
    """Render a complete path: exactly as many frames as its targets have, at the graph's rate.

    references : those of the graph, in its order; only those that are shown are looked at. Without a set of joints
    a track moves all of the skeleton, so that fingers follow their arm, unless `fingers: rest`.
    """
    recorded = _Recorded(references, graph, _needed_nodes(path, graph, config), config)
    skeleton = recorded.first.skeleton
    config = settings_for(skeleton, config)
    pelvis = skeleton.pelvis(config.positions.root_joint)
    rendered = [_render_track(track, recorded, graph, pelvis, config) for track in path.tracks]
    motion, standing = rendered[0].motion, rendered[0]
    for track, part in zip(path.tracks[1:], rendered[1:], strict=True):
        assert track.joints is not None  # of several tracks, each after the first says what it moves
        joints = [skeleton.names.index(name) for name in track.joints]
        motion = _with_joints(motion, part.motion, joints)
        if pelvis in joints:
            standing = part
    if config.smoothing.enabled:
        limbs = body.split(skeleton, pelvis).limbs
        motion = smoothing.savitzky_golay(motion, limbs, config.smoothing)
    if config.feet.lock:
        assert standing.as_recorded is not None  # each track keeps it where feet are locked
        motion = feet.lock(motion, standing.as_recorded, standing.bearing, standing.jumps, pelvis, config.feet)
    rotations = motion.rotations.copy()
    if config.fingers == "rest":
        selected, _ = select_joints(skeleton, config)
        rotations[:, np.setdiff1d(fingers(skeleton, config), selected)] = rotation.IDENTITY
    return replace(motion, rotations=rotation.normalize(rotations))


def _render_track(track: Track, recorded: _Recorded, graph: ReferenceFrames, pelvis: int, config: Config) -> _Rendered:
    """Render one track on the whole skeleton."""
    pieces, nodes = track.pieces, track.nodes
    before = nodes[:-1]
    hold = np.append(False, nodes[1:] == before)
    steps = _Steps(hold, np.append(False, (nodes[1:] != graph.successors[before]) & (nodes[1:] != before)))
    source = recorded.take(nodes).cut_at(steps.jump)
    # A body that stands still would go on standing, whatever the recording does next.
    successors = recorded.take(np.where(hold, nodes, graph.successors[nodes]))
    offsets = np.zeros((len(nodes), 6))
    if config.root.mode == "return":
        offsets = _ground_offsets(source, successors, steps, recorded, pelvis, config)
        source = _move_ground(source, recorded.travelling, offsets[:, 0], offsets[:, 1:3])
        successors = _move_ground(successors, recorded.travelling, offsets[:, 3], offsets[:, 4:6])
    if config.blend.method == "inertialize":
        rotations, positions = source.rotations.copy(), source.positions.copy()
        _inertialize(rotations, positions, successors, steps, config)
        source = replace(source, rotations=rotations, positions=positions)
    del successors  # a long motion is large: no more of it at a time than is needed
    kept, times = _timeline(pieces, nodes, graph, config.resample)
    jumps = _jumps(times, steps.jump[kept])
    motion = cleanup.interpolate(source if len(kept) == len(nodes) else source.take(kept), times)
    del source
    rotations, positions = motion.rotations.copy(), motion.positions.copy()
    if config.blend.method == "crossfade":
        _crossfade_joins(rotations, positions, pieces, graph, config)
    elif config.blend.method == "overlap":
        ends = np.cumsum([len(piece.nodes) for piece in pieces])
        for k, seam in _hard_joins(pieces, graph):
            sides = offsets[ends[k - 1] - 1, :3], offsets[ends[k - 1], :3]
            _overlap_join(rotations, positions, pieces[k - 1 : k + 1], seam, sides, recorded, graph, config)
    elif config.blend.method == "least_jerk":
        rotations, positions = blend.least_jerk(rotations, positions, jumps, config.blend.reach_seconds * motion.fps)
    elif config.blend.method == "least_change":
        runs = _Runs(nodes[kept], times, steps.jump[kept], offsets[kept], recorded, graph, pelvis, config)
        shown = runs.play(runs.numbers, np.arange(len(times)))
        rotations, positions = splice.least_change(*shown, runs.numbers, runs.play)
    return _Rendered(
        replace(motion, rotations=rotation.normalize(rotations), positions=positions),
        as_recorded=cleanup.interpolate(recorded.take(nodes[kept]), times) if config.feet.lock else None,
        bearing=recorded.bearing(nodes[kept][np.round(times).astype(int)]),
        jumps=jumps,
    )


def _with_joints(motion: Motion, other: Motion, joints: Sequence[int]) -> Motion:
    """Replace the motion of some joints by that of another motion."""
    rotations, positions = motion.rotations.copy(), motion.positions.copy()
    rotations[:, joints], positions[:, joints] = other.rotations[:, joints], other.positions[:, joints]
    return replace(motion, rotations=rotations, positions=positions)


# --- what was recorded --------------------------------------------------------------------------------------


def _needed_nodes(path: Path, graph: ReferenceFrames, config: Config) -> np.ndarray:
    """List all nodes that rendering may look at."""
    needed = []
    for track in path.tracks:
        nodes = track.nodes
        needed += [nodes, graph.successors[nodes]]
        if config.blend.method == "least_change":
            reach = np.arange(-_BEYOND, _BEYOND + 1)
            ends = np.flatnonzero(nodes[1:] != graph.successors[nodes[:-1]])
            edges = np.concatenate([nodes[[0, -1]], nodes[ends], nodes[ends + 1]])[:, None]
            segments = np.searchsorted(graph.segment_starts, edges, side="right") - 1
            needed.append(np.clip(edges + reach, graph.segment_starts[segments], graph.segment_ends[segments]).ravel())
        if config.blend.method == "overlap":
            for k, _ in _hard_joins(track.pieces, graph):
                for piece, side in ((track.pieces[k - 1], 1), (track.pieces[k], -1)):
                    reach = side * np.arange(int(np.ceil(config.blend.l_blend * _pace(piece))) + 2)
                    needed.append(_inside_segment(piece.nodes[-1 if side > 0 else 0] + reach, piece, side, graph))
    return np.unique(np.concatenate(needed))


class _Recorded:
    """The reference frames of some graph nodes, read one reference clip after the other.

    travelling : the first joint that travels in them
    """

    def __init__(self, references: Sequence[Reference], graph: ReferenceFrames, nodes: np.ndarray, config: Config):
        self.nodes = nodes
        clips = np.searchsorted(graph.clip_starts, nodes, side="right") - 1
        self.first = references[0].motion.take(slice(0, 1))
        feet_joints = settings_for(self.first.skeleton, config).feet.joints
        parts, bearing, motions = [], [], []
        for clip in np.unique(clips):
            motion = references[clip].motion
            frames = nodes[clips == clip] - graph.clip_starts[clip]
            parts.append(_on_skeleton(motion.take(frames), self.first.skeleton))
            bearing.append(_foot_contacts(motion, feet_joints)[frames])
            motions.append(motion)
        written_joints, written_angles = written_of(parts)
        self.motion = replace(
            self.first,
            rotations=np.concatenate([part.rotations for part in parts]),
            positions=np.concatenate([part.positions for part in parts]),
            written_joints=written_joints,
            written_angles=written_angles,
        )
        self._bearing = np.concatenate(bearing)
        self.travelling = kinematics.travelling_joint(motions)

    def take(self, nodes: np.ndarray) -> Motion:
        """Take the frames of nodes."""
        return self.motion.take(np.searchsorted(self.nodes, nodes))

    def bearing(self, nodes: np.ndarray) -> np.ndarray:
        """Tell which of the skeleton's feet bear weight at nodes, bool `[shape=(n, F)]`."""
        return self._bearing[np.searchsorted(self.nodes, nodes)]


def _on_skeleton(motion: Motion, skeleton: Skeleton) -> Motion:
    """Convert a motion to another skeleton of the same performer, as files of that skeleton hold it.

    Joints that do not travel are where the other OFFSETs have them.
    """
    own = motion.skeleton
    moved = np.flatnonzero((own.offsets != skeleton.offsets).any(axis=1))
    if not len(moved):
        return motion if own is skeleton else replace(motion, skeleton=skeleton)
    positions = np.array(motion.positions, dtype=np.float64)
    at_rest = np.abs(positions - own.offsets).max(axis=(0, 2), initial=0.0) < 1e-9
    for joint in moved[at_rest[moved]].tolist():
        positions[:, joint] = skeleton.offsets[joint]
    return replace(motion, skeleton=skeleton, positions=positions)


def _foot_contacts(motion: Motion, joints: Sequence[str]) -> np.ndarray:
    """Tell which of the named feet that the skeleton has are near the floor."""
    names = motion.skeleton.names
    places = [names.index(name) for name in joints if name in names]
    if not places:
        return np.zeros((motion.n_frames, 0), dtype=bool)
    return feet.contacts(kinematics.joint_positions(motion, places))


# --- root ---------------------------------------------------------------------------------------------------


def _ground_offsets(
    source: Motion, successors: Motion, steps: _Steps, recorded: _Recorded, pelvis: int, config: Config
) -> np.ndarray:
    """Compute the offsets of ground position and heading by which they never jump; the offset then decays.

    At a jump the new side starts where the old side's next frame would have been. Within a run the offset
    turns the travelled way along with the body, so that feet do not slide more than the decay makes them.
    Returns per node the offset (turn, x, z) of its frame and of its natural successor's `[shape=(n, 6)]`.
    """
    zero_heading = kinematics.world_transforms(recorded.first, [pelvis])[0][0, 0]
    here = _ground_poses(source, recorded.travelling, pelvis, zero_heading)
    ahead = _ground_poses(successors, recorded.travelling, pelvis, zero_heading)
    decay = 0.5 ** (1.0 / (config.root.return_half_life * source.fps))
    return np.array(_accumulated_offsets(here, ahead, steps, decay))


def _ground_poses(motion: Motion, travelling: int, pelvis: int, zero_heading: np.ndarray) -> np.ndarray:
    """Compute heading in radians, x and z `[shape=(T, 3)]`: position of the travelling joint, heading of the pelvis."""
    rotations, positions = kinematics.world_transforms(motion, [travelling, pelvis])
    turned = rotation.multiply(rotations[:, 1], rotation.inverse(zero_heading))
    return np.column_stack([rotation.heading(turned), positions[:, 0, 0], positions[:, 0, 2]])


def _accumulated_offsets(here: np.ndarray, ahead: np.ndarray, steps: _Steps, decay: float) -> list[list[float]]:
    """Accumulate the offsets of `_ground_offsets` node by node."""
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
    """Keep the new side of every jump and let its offset in pose and velocity to the old side decay, in place."""
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
    """Compute the rotation vector from one pose to the next, in radians per frame."""
    return rotation.to_expmap(rotation.multiply(after, rotation.inverse(before)))


def _timeline(
    pieces: Sequence[Piece], nodes: np.ndarray, graph: ReferenceFrames, how: str
) -> tuple[np.ndarray, np.ndarray]:
    """Choose the nodes to interpolate between `[shape=(K,)]`, and the place of each output frame among them.

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


# Nodes that a run is played on by: what three output frames take at up to 1.6 nodes a frame.
_BEYOND = 6


class _Runs:
    """The uninterrupted stretches of a track, each continued beyond its ends.

    numbers : int `[shape=(n_frames,)]`, the run that each output frame shows; one between two runs shows the first
    """

    def __init__(
        self, nodes: np.ndarray, times: np.ndarray, jump: np.ndarray, offsets: np.ndarray, recorded: _Recorded,
        graph: ReferenceFrames, pelvis: int, config: Config,
    ):  # fmt: skip
        self.numbers = np.cumsum(jump)[np.floor(times + _ROUNDING).astype(int)]
        self._times, self._starts = times, np.append(np.flatnonzero(np.append(True, jump[1:])), len(nodes))
        decay = 0.5 ** (1.0 / (config.root.return_half_life * recorded.first.fps))
        zero_heading = kinematics.world_transforms(recorded.first, [pelvis])[0][0, 0]
        parts = []
        for start, end in pairwise(self._starts.tolist()):
            motion = _played_on(nodes[start:end], recorded, graph)
            if config.root.mode == "return":
                poses = _ground_poses(motion, recorded.travelling, pelvis, zero_heading)
                moves = _continued_offsets(poses, offsets[start:end, :3], decay)
                motion = _move_ground(motion, recorded.travelling, moves[:, 0], moves[:, 1:])
            parts.append(motion)
        self._motion = replace(
            recorded.first,
            rotations=np.concatenate([part.rotations for part in parts]),
            positions=np.concatenate([part.positions for part in parts]),
        )

    def play(self, runs: np.ndarray, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Interpolate runs at output frames, also some beyond their ends, at the pace they have there.

        Returns rotations and positions.
        """
        first = np.searchsorted(self.numbers, runs)
        last = np.searchsorted(self.numbers, runs, side="right") - 1
        inside = np.clip(frames, first, last)
        alone = last == first
        pace_before = np.where(alone, 1.0, self._times[np.minimum(first + 1, last)] - self._times[first])
        pace_after = np.where(alone, 1.0, self._times[last] - self._times[np.maximum(last - 1, first)])
        beyond = frames - inside
        places = self._times[inside] + beyond * np.where(beyond < 0, pace_before, pace_after)
        places = np.clip(places, self._starts[runs] - _BEYOND, self._starts[runs + 1] + _BEYOND - 1.0)
        places += _BEYOND * (2 * runs + 1)
        low, high = np.floor(places + _ROUNDING).astype(int), np.ceil(places - _ROUNDING).astype(int)
        shown = cleanup.mix(self._motion.take(low), self._motion.take(high), np.clip(places - low, 0.0, 1.0))
        return shown.rotations, shown.positions


def _played_on(nodes: np.ndarray, recorded: _Recorded, graph: ReferenceFrames) -> Motion:
    """Continue the recorded frames of a run by `_BEYOND` before and after it.

    A run that ends in a pose that is held holds it on. Where a segment ends, its frames are mirrored at that pose.
    """
    before, after = (
        _beyond(int(nodes[edge]), side * (len(nodes) == 1 or nodes[edge] != nodes[neighbour]), recorded, graph)
        for edge, neighbour, side in ((0, min(1, len(nodes) - 1), -1), (-1, max(-2, -len(nodes)), 1))
    )
    middle = recorded.take(nodes)
    return replace(
        middle,
        rotations=np.concatenate([before.rotations[::-1], middle.rotations, after.rotations]),
        positions=np.concatenate([before.positions[::-1], middle.positions, after.positions]),
    )


def _beyond(edge: int, step: int, recorded: _Recorded, graph: ReferenceFrames) -> Motion:
    """Take the `_BEYOND` frames after a node, by steps of -1, 0 or 1."""
    segment = np.searchsorted(graph.segment_starts, edge, side="right") - 1
    bounds = int(graph.segment_starts[segment]), int(graph.segment_ends[segment])
    nodes = edge + step * np.arange(1, _BEYOND + 1)
    inside = np.clip(nodes, *bounds)
    border, mirrored = recorded.take(inside), recorded.take(np.clip(2 * inside - nodes, *bounds))
    outside = nodes != inside
    turned = rotation.multiply(
        rotation.multiply(border.rotations, rotation.inverse(mirrored.rotations)), border.rotations
    )
    return replace(
        border,
        rotations=np.where(outside[:, None, None], turned, border.rotations),
        positions=np.where(outside[:, None, None], 2.0 * border.positions - mirrored.positions, border.positions),
    )


def _continued_offsets(poses: np.ndarray, offsets: np.ndarray, decay: float) -> np.ndarray:
    """Continue the ground offsets (turn, x, z) of a run's nodes beyond its ends; see `_ground_offsets`.

    poses : on the ground, of all `[shape=(n + 2 * _BEYOND, 3)]`; offsets : `[shape=(n, 3)]`
    """
    found = np.pad(offsets, [(_BEYOND, _BEYOND), (0, 0)])
    steps = np.diff(poses[:, 1:], axis=0)
    for k in range(len(poses) - _BEYOND, len(poses)):
        turn, x, z = found[k - 1]
        more_x, more_z = _turned_step(turn, steps[k - 1])
        found[k] = decay * turn, decay * x + more_x, decay * z + more_z
    for k in range(_BEYOND - 1, -1, -1):
        turn, x, z = found[k + 1]
        turn /= decay
        more_x, more_z = _turned_step(turn, steps[k])
        found[k] = turn, (x - more_x) / decay, (z - more_z) / decay
    return found


def _turned_step(turn: float, step: np.ndarray) -> tuple[float, float]:
    """Compute by how much a step over the ground changes when it is turned."""
    cosine, sine = np.cos(turn) - 1.0, np.sin(turn)
    return cosine * step[0] + sine * step[1], cosine * step[1] - sine * step[0]


def _jumps(times: np.ndarray, jump: np.ndarray) -> np.ndarray:
    """Find the output frames with a jump, or part of one, since the frame before, bool `[shape=(n_frames,)]`.

    jump : bool `[shape=(K,)]`, of the nodes that `times` lie among
    """
    counts = np.cumsum(jump)
    before, after = np.floor(times[:-1] + _ROUNDING).astype(int), np.ceil(times[1:] - _ROUNDING).astype(int)
    return np.append(False, counts[after] > counts[before])


def _hard_joins(pieces: Sequence[Piece], graph: ReferenceFrames) -> list[tuple[int, int]]:
    """List number and first frame of every piece that is no natural continuation of the one before."""
    return [
        (k, piece.target.start_frame)
        for k, (before, piece) in enumerate(pairwise(pieces), 1)
        if piece.nodes[0] != graph.successors[before.nodes[-1]]
    ]


def _crossfade_joins(
    rotations: np.ndarray, positions: np.ndarray, pieces: Sequence[Piece], graph: ReferenceFrames, config: Config
) -> None:
    """Cross-fade every hard join, left to right, in place."""
    seams = [seam for _, seam in _hard_joins(pieces, graph)]
    for seam, right_end in pairwise([*seams, len(rotations)]):
        blend.crossfade(rotations, positions, seam, right_end, config.blend)


def _pace(piece: Piece) -> float:
    """Compute the nodes per output frame of a piece."""
    return (len(piece.nodes) - 1) / max(piece.target.length - 1, 1)


def _inside_segment(nodes: np.ndarray, piece: Piece, side: int, graph: ReferenceFrames) -> np.ndarray:
    """Limit nodes (fractional ones too) after a piece's last (side 1) or before its first (-1) to what was recorded."""
    if side > 0:
        segment = np.searchsorted(graph.segment_starts, piece.nodes[-1], side="right") - 1
        return np.minimum(nodes, graph.segment_ends[segment])
    segment = np.searchsorted(graph.segment_starts, piece.nodes[0], side="right") - 1
    return np.maximum(nodes, graph.segment_starts[segment])


def _overlap_join(
    rotations: np.ndarray, positions: np.ndarray, pieces: Sequence[Piece], seam: int,
    offsets: tuple[np.ndarray, np.ndarray], recorded: _Recorded, graph: ReferenceFrames, config: Config,
) -> None:  # fmt: skip
    """Blend up to `l_blend` frames on each side of a seam, in place: both sides play on through them as recorded.

    offsets : on the ground (turn, x, z), of the left piece's last node and of the right piece's first
    """
    left, right = pieces
    # No more than half of a piece, so that its two joins stay apart.
    counts = [min(config.blend.l_blend, piece.target.length // 2) for piece in pieces]
    amount = blend.weights(sum(counts), config.blend.curve)[:, None]
    before, after = np.arange(seam - counts[0], seam), np.arange(seam, seam + counts[1])
    beyond = left.nodes[-1] + (after - seam + 1) * _pace(left)
    ahead = right.nodes[0] - (seam - before) * _pace(right)
    played_on = _played(beyond, left, 1, offsets[0], recorded, graph)
    played_before = _played(ahead, right, -1, offsets[1], recorded, graph)
    for frames, weights, start, end in (
        (before, amount[: counts[0]], None, played_before),
        (after, amount[counts[0] :], played_on, None),
    ):
        first = (rotations[frames], positions[frames]) if start is None else (start.rotations, start.positions)
        second = (rotations[frames], positions[frames]) if end is None else (end.rotations, end.positions)
        rotations[frames] = blend.mix_rotations(first[0], second[0], weights, config.blend.rotations)
        positions[frames] = (1.0 - weights[..., None]) * first[1] + weights[..., None] * second[1]


def _played(
    nodes: np.ndarray, piece: Piece, side: int, offset: np.ndarray, recorded: _Recorded, graph: ReferenceFrames
) -> Motion:
    """Interpolate poses at fractional nodes beyond an end of a piece, placed on the ground where the piece is there."""
    edge = int(piece.nodes[-1 if side > 0 else 0])
    nodes = _inside_segment(nodes, piece, side, graph)
    low, high = np.floor(nodes).astype(int), np.ceil(nodes).astype(int)
    poses = cleanup.mix(recorded.take(low), recorded.take(high), nodes - low)
    there = kinematics.world_transforms(recorded.take(np.array([edge])), [recorded.travelling])[1][0, 0]
    way = kinematics.world_transforms(poses, [recorded.travelling])[1][:, 0] - there
    turned = rotation.rotate(rotation.about_y(np.full(len(nodes), offset[0])), way)
    shifts = offset[1:3] + (turned - way)[:, [0, 2]]
    return _move_ground(poses, recorded.travelling, np.full(len(nodes), offset[0]), shifts)

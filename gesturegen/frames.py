"""The frames of the reference clips as nodes: what every method chooses from, whatever it links them by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path

import numpy as np

from gesturegen import pose_distance
from gesturegen.data.clips import Reference, check_settings, select_joints
from gesturegen.data.keynodes import BREAK, KEYWORD, ONSET, KeyNodes, of_reference, reference_speaking
from gesturegen.errors import DataError
from gesturegen.joints import hand_names, roles_of, settings_for
from gesturegen.motion import kinematics, roles
from gesturegen.motion.skeleton import Motion, Skeleton, read_only
from gesturegen.settings.models import Config, Continuity
from gesturegen.stored import arrays as stored_arrays
from gesturegen.stored.arrays import Array, Kind
from gesturegen.stored.sealing import damaged


@dataclass(frozen=True, eq=False)
class ReferenceFrames:
    """Nodes are the frames of the reference clips, one clip after the other.

    positions : float32 [shape=(N, J, 3)], as used for distances; joint_names : the J joints
    clip_names : the C reference clips; clip_starts : int [shape=(C,)], their first nodes
    source_frames : int [shape=(N,)], each node's frame in its recording
    segment_starts : int [shape=(S,)], first nodes of the uninterrupted stretches
    key_nodes : onset, keyword and break nodes
    hand_names : the joints that are the left and the right hand by their roles, as far as there are any
    speaking : bool [shape=(N,)], False in the pauses of the references' speech
    """

    positions: np.ndarray
    joint_names: tuple[str, ...]
    fps: float
    clip_names: tuple[str, ...]
    clip_starts: np.ndarray
    source_frames: np.ndarray
    segment_starts: np.ndarray
    key_nodes: KeyNodes
    speaking: np.ndarray
    hand_names: tuple[str, ...] = field(default=(), kw_only=True)

    # Whether large arrays stay maps of the stored file.
    mapped = True

    def __post_init__(self):
        for own in fields(self):
            if own.type == "np.ndarray":
                object.__setattr__(self, own.name, read_only(getattr(self, own.name)))

    @property
    def n_nodes(self) -> int:
        return len(self.positions)

    @property
    def n_unnatural_edges(self) -> float:
        """Edges that leave the order of the recordings; none where any frame may follow any other."""
        return 0

    @property
    def clips(self) -> tuple[tuple[str, bool], ...]:
        """Each clip's recording, and whether it is a mirrored copy of it."""
        return tuple((name, False) for name in self.clip_names)

    @cached_property
    def segment_ends(self) -> np.ndarray:
        """Last nodes `[shape=(S,)]` of the segments."""
        return pose_distance.segment_ends(self.segment_starts, self.n_nodes)

    @cached_property
    def successors(self) -> np.ndarray:
        """The natural successor of each node `[shape=(N,)]`; a segment's last node is its own."""
        after = np.arange(1, self.n_nodes + 1)
        after[self.segment_ends] = self.segment_ends
        return after

    def stop_nodes(self, keyword: str | None) -> np.ndarray:
        """bool `[shape=(N,)]`: nodes at which a piece may end (§4.2.2).

        Nodes of exactly `keyword`; without one, onset nodes and the last nodes of segments.
        """
        stops = np.zeros(self.n_nodes, dtype=bool)
        if keyword is not None:
            stops[self.key_nodes.frames[self.key_nodes.keywords == keyword]] = True
        else:
            stops[self.key_nodes.frames[self.key_nodes.kinds == "onset"]] = True
            stops[self.segment_ends] = True
        return stops

    @cached_property
    def any_stop(self) -> np.ndarray:
        """bool `[shape=(N,)]`: key nodes of any kind."""
        stops = np.zeros(self.n_nodes, dtype=bool)
        stops[self.key_nodes.frames] = True
        stops[self.segment_ends] = True
        return read_only(stops)

    def distances(self, lefts, rights, settings: Continuity) -> np.ndarray:
        """Pose distances `[shape=(K,)]` of pairs of nodes; only their frames are looked at."""
        lefts, rights = np.asarray(lefts, dtype=np.int64), np.asarray(rights, dtype=np.int64)
        nodes = np.concatenate([lefts, rights])
        # As `pose_distance.velocities`: a segment's first frame copies the second's, a lone frame has none.
        moving = np.where(np.isin(nodes, self.segment_starts), np.minimum(nodes + 1, self.n_nodes - 1), nodes)
        alone = np.isin(moving, self.segment_starts)
        poses = pose_distance.flatten(self.positions[nodes])
        speeds = pose_distance.flatten(self.positions[moving]) - pose_distance.flatten(self.positions[moving - 1])
        speeds[alone] = 0.0
        pairs = np.arange(len(lefts))
        return pose_distance.pose_distances(poses, speeds, pairs, pairs + len(lefts), settings)


@dataclass(frozen=True, eq=False)
class ExtendedFrames(ReferenceFrames):
    """Frames of a library of any kind with those of further clips after them.

    mirrored : bool [shape=(C,)], which clips are mirrored copies
    """

    mirrored: np.ndarray

    @property
    def n_unnatural_edges(self) -> float:
        """They are the library's, and not known here."""
        return float("nan")

    @property
    def clips(self) -> tuple[tuple[str, bool], ...]:
        return tuple(zip(self.clip_names, self.mirrored.tolist(), strict=True))


def require_one_skeleton(references: Sequence[Reference], config: Config) -> Skeleton:
    """The skeleton of all references, as by `one_skeleton`."""
    return one_skeleton([(reference.name, reference.motion.skeleton) for reference in references], config)


def one_skeleton(named: Sequence[tuple[str, Skeleton]], config: Config) -> Skeleton:
    """The skeleton of the first of all clips, given by name; DataError when they are not of one performer.

    OFFSETs may differ as those of one performer's recordings do that were calibrated on different days.
    """
    (first, skeleton), *others = named
    tolerance = offset_tolerance(skeleton, config)
    for name, other in others:
        difference = skeleton.difference(other, tolerance)
        if difference:
            raise DataError(
                f"clips {first} and {name} cannot share a graph: {difference}; choose clips of one skeleton"
            )
    return skeleton


def offset_tolerance(skeleton: Skeleton, config: Config) -> float:
    """By how much the OFFSETs of one performer's recordings may differ, in cm (`motion.same_skeleton`)."""
    height = roles.body_height(skeleton, roles_of(skeleton, config))
    return max(config.motion.same_skeleton * height, 1e-4)


def positions_of(motion: Motion, config: Config) -> np.ndarray:
    """Positions as used for distances: float32 `[shape=(T, J, 3)]`, seen from the pelvis as the config says."""
    joints, _ = select_joints(motion.skeleton, config)
    pelvis = motion.skeleton.pelvis(settings_for(motion.skeleton, config).positions.root_joint)
    found = kinematics.relative_positions(motion, joints, pelvis, config.positions.relative_to)
    return (found * config.positions.scale).astype(np.float32)


def describe(reference: Reference, config: Config) -> dict:
    """The fields of `ReferenceFrames`, but for positions, of one reference."""
    skeleton = reference.motion.skeleton
    joints, _ = select_joints(skeleton, config)
    return {
        "joint_names": tuple(skeleton.names[j] for j in joints),
        "hand_names": hand_names(skeleton, config),
        "fps": reference.motion.fps,
        "clip_names": (reference.name,),
        "clip_starts": np.array([0]),
        "source_frames": reference.source_frames,
        "segment_starts": reference.segment_starts,
        "key_nodes": of_reference(reference, config.keywords.words),
        "speaking": reference_speaking(reference, config.pauses),
    }


def join(described: Sequence[dict]) -> dict:
    """What `describe` says of several references of one skeleton, one after the other."""
    lengths = [len(one["source_frames"]) for one in described]
    first_nodes = np.cumsum([0, *lengths[:-1]])
    nodes = [one["key_nodes"] for one in described]
    return described[0] | {
        "clip_names": tuple(name for one in described for name in one["clip_names"]),
        **{
            name: np.concatenate([one[name] + first for one, first in zip(described, first_nodes, strict=True)])
            for name in ("clip_starts", "segment_starts")
        },
        **{name: np.concatenate([one[name] for one in described]) for name in ("source_frames", "speaking")},
        "key_nodes": KeyNodes(
            np.concatenate([own.frames + first for own, first in zip(nodes, first_nodes, strict=True)]),
            np.concatenate([own.kinds for own in nodes]),
            np.concatenate([own.keywords for own in nodes]),
        ),
    }


# --- files --------------------------------------------------------------------------------------------------

# What every library holds, of N nodes, J joints and C clips.
METHOD_ARRAY = "method"
ARRAYS = {
    METHOD_ARRAY: Array("str"),
    "config": Array("str"),
    "clip_digests": Array("str", "digests"),
    "positions": Array("f4", "N J 3"),
    "joint_names": Array("str", "J"),
    "hand_names": Array("str", "hands"),
    "fps": Array("f8", "", stored_arrays.within(1e-3, 1e5)),
    "clip_names": Array("str", "C"),
    "clip_starts": Array("i8", "C", stored_arrays.starts("N")),
    "source_frames": Array("i8", "N", stored_arrays.not_negative),
    "segment_starts": Array("i8", "S", stored_arrays.starts("N")),
    "speaking": Array("bool", "N"),
    "key_frames": Array("i8", "K", stored_arrays.rising("N")),
    "key_kinds": Array("str", "K", stored_arrays.among(ONSET, KEYWORD, BREAK)),
    "key_words": Array("str", "K"),
}


_ANY = Kind("graph", "build-graph", ARRAYS)


def read_arrays(path: str | Path, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Some of the arrays that every library holds, whichever method it is of; DataErrors as by `load`."""
    if not Path(path).is_file():
        raise DataError(f"{path}: this graph has not been built; run `gesturegen build-graph` first")
    return stored_arrays.read(path, _ANY, names)


def unfit(stored: Mapping[str, np.ndarray]) -> str | None:
    """What is wrong between the arrays of a library, each of which is as it should be."""
    if not np.isin(stored["clip_starts"], stored["segment_starts"]).all():
        return "clip_starts do not begin segments"
    within_clips = np.ones(len(stored["source_frames"]), dtype=bool)
    within_clips[stored["clip_starts"]] = False
    if not (np.diff(stored["source_frames"])[within_clips[1:]] > 0).all():
        return "source_frames do not rise within clips"
    if (stored["key_words"][stored["key_kinds"] != KEYWORD] != "").any():
        return "key_words are there for nodes that are no keywords"
    return None


def save(
    path: str | Path, library: ReferenceFrames, kind: Kind, method: str, settings: str, clip_digests: Sequence[str] = ()
) -> None:
    """Store what a method searches as `.npz` (docs/files.md).

    method : the name of the method whose library it is; settings : JSON of all that it depends on
    clip_digests : SHA-256 of the stored clips it was built from, so that `load` can tell when they changed
    """
    values = {field.name: getattr(library, field.name) for field in fields(library)}
    nodes = values.pop("key_nodes")
    stored_arrays.write(
        path,
        {
            "format_version": np.array(kind.version),
            METHOD_ARRAY: np.array(method),
            "config": np.array(settings),
            "clip_digests": np.array(clip_digests, dtype=str),
            **{name: np.asarray(value) for name, value in values.items()},
            "fps": np.array(float(library.fps)),
            "hand_names": np.array(library.hand_names, dtype=str),
            "key_frames": nodes.frames,
            "key_kinds": nodes.kinds,
            "key_words": nodes.keywords,
        },
    )


def load(
    made: type[ReferenceFrames], kind: Kind, path: str | Path, settings: str | None = None,
    clip_digests: Sequence[str] | None = None,
) -> ReferenceFrames:  # fmt: skip
    """Read what `save` stored,  and check it against its kind.

    DataError when it is missing, DamagedError when it is damaged or of another version, DataError, where they are
    given, when it was made with other settings or from clips with other digests.
    """
    path = Path(path)
    if not path.is_file():
        raise DataError(f"{path}: this {kind.what} has not been built; run `gesturegen build-graph` first")
    stored = stored_arrays.read(path, kind, mapped=made.mapped)
    if settings is not None:
        check_settings(path, str(stored["config"]), settings, "build-graph")
    if clip_digests is not None and list(clip_digests) != stored["clip_digests"].tolist():
        raise DataError(f"{path}: its clips were preprocessed again since; run `gesturegen build-graph` again")
    try:
        return made(
            **{field.name: stored[field.name] for field in fields(made) if field.type == "np.ndarray"},
            joint_names=tuple(map(str, stored["joint_names"])),
            hand_names=tuple(map(str, stored["hand_names"])),
            fps=float(stored["fps"]),
            clip_names=tuple(map(str, stored["clip_names"])),
            key_nodes=KeyNodes(stored["key_frames"], stored["key_kinds"], stored["key_words"]),
        )
    except ValueError as error:
        raise damaged(path, str(error), "build-graph") from None

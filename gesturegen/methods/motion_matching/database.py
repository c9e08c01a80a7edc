"""The matching database: for every reference frame what the hands do next and what the voice does, and its file.

k-NN motion matching (Habibie et al. 2022, §3.1.1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gesturegen import frames as reference_frames
from gesturegen.data.clips import Reference
from gesturegen.errors import DataError
from gesturegen.frames import (
    ReferenceFrames,
    describe,
    join,
    one_skeleton,
    positions_of,
    require_one_skeleton,
)
from gesturegen.joints import settings_for
from gesturegen.methods.motion_matching import features
from gesturegen.methods.motion_matching.features import Scaling
from gesturegen.methods.motion_matching.nearest import Candidates
from gesturegen.motion import kinematics
from gesturegen.motion.skeleton import Skeleton
from gesturegen.settings.models import Config
from gesturegen.stored import arrays as stored_arrays
from gesturegen.stored.arrays import Array, Kind

FORMAT_VERSION = 3


@dataclass(frozen=True, eq=False)
class MatchingDatabase(ReferenceFrames):
    """Features of every node, and the sequences that each offer one node at every step.

    pose : float32 [shape=(N, P)], audio : float32 [shape=(N, A)], z-scores (`features.py`)
    pose_means, pose_scales : float [shape=(P,)], audio_means, audio_scales : float [shape=(A,)], of these
    sequence_starts, sequence_stops : int [shape=(M,)]; valid : bool [shape=(N,)], nodes that a step can follow on
    """

    pose: np.ndarray
    audio: np.ndarray
    pose_means: np.ndarray
    pose_scales: np.ndarray
    audio_means: np.ndarray
    audio_scales: np.ndarray
    sequence_starts: np.ndarray
    sequence_stops: np.ndarray
    valid: np.ndarray

    @cached_property
    def candidates(self) -> Candidates:
        """Return the arrays that the search reads."""
        return Candidates(self.pose, self.audio, self.sequence_starts, self.sequence_stops, self.valid)

    @property
    def audio_scaling(self) -> Scaling:
        """Return the scaling of the audio features."""
        return Scaling(self.audio_means, self.audio_scales)


def step_frames(config: Config) -> int:
    """Compute how many frames are shown before the next search."""
    return max(round(config.motion_matching.step_seconds * config.fps), 1)


@dataclass(frozen=True, eq=False)
class Part:
    """The part of a database from one recording: unscaled features, positions, and `reference_frames.describe`."""

    described: dict
    skeleton: Skeleton
    positions: np.ndarray
    pose: np.ndarray
    audio: np.ndarray


def describe_part(reference: Reference, config: Config) -> Part:
    """Compute the features of a recording.

    Raises DataError when its skeleton lacks a configured joint or its sound was not measured.
    """
    skeleton, fps = reference.motion.skeleton, reference.motion.fps
    own = settings_for(skeleton, config)
    settings = own.motion_matching
    if reference.speech.acoustics is None:
        raise DataError(f"clip {reference.name}: its sound was not measured; set acoustics.enabled: true")
    joints = [skeleton.index(name) for name in settings.joints]
    pelvis = skeleton.pelvis(own.positions.root_joint)
    seen = kinematics.relative_positions(reference.motion, joints, pelvis, "root_heading") * config.positions.scale
    return Part(
        describe(reference, config),
        skeleton,
        positions_of(reference.motion, config),
        features.pose_features(seen, reference.segment_starts, fps, settings),
        features.audio_features(reference.speech.acoustics, reference.source_frames / fps, settings),
    )


def assemble(parts: Sequence[Part], config: Config) -> MatchingDatabase:
    """Assemble the database of several recordings; DataError when their skeletons differ."""
    one_skeleton([(part.described["clip_names"][0], part.skeleton) for part in parts], config)
    described = join([part.described for part in parts])
    pose, audio = (np.concatenate([getattr(part, name) for part in parts]) for name in ("pose", "audio"))
    pose_scaling, audio_scaling = Scaling.of(pose), Scaling.of(audio)
    segment_starts, n_nodes = described["segment_starts"], len(pose)
    starts, stops = features.sequences(segment_starts, n_nodes, described["fps"], config.motion_matching)
    ends = np.append(segment_starts[1:], n_nodes) - 1
    last = ends[np.searchsorted(segment_starts, np.arange(n_nodes), side="right") - 1]
    return MatchingDatabase(
        positions=np.concatenate([part.positions for part in parts]),
        **described,
        pose=features.apply(pose_scaling, pose),
        audio=features.apply(audio_scaling, audio),
        pose_means=pose_scaling.means,
        pose_scales=pose_scaling.scales,
        audio_means=audio_scaling.means,
        audio_scales=audio_scaling.scales,
        sequence_starts=starts,
        sequence_stops=stops,
        valid=np.arange(n_nodes) + step_frames(config) <= last,
    )


def build(references: Sequence[Reference], config: Config) -> MatchingDatabase:
    """Build the database of one or several references; DataErrors as by `describe_part` and `assemble`."""
    require_one_skeleton(references, config)
    return assemble([describe_part(reference, config) for reference in references], config)


# --- files --------------------------------------------------------------------------------------------------


def _unfit(stored: Mapping[str, np.ndarray]) -> str | None:
    """Say what is wrong between the arrays of a database, each valid by itself; None when nothing is."""
    if problem := reference_frames.unfit(stored):
        return problem
    starts, stops = stored["sequence_starts"], stored["sequence_stops"]
    first, last = (np.searchsorted(stored["segment_starts"], nodes, side="right") for nodes in (starts, stops - 1))
    if not (starts < stops).all() or not (stops[:-1] <= starts[1:]).all() or (first != last).any():
        return "sequence_stops do not end the sequences within their segments"
    return None


KIND = Kind(
    "matching database", "build-graph",
    reference_frames.ARRAYS | {
        "pose": Array("f4", "N P"),
        "audio": Array("f4", "N A"),
        "pose_means": Array("f8", "P"),
        "pose_scales": Array("f8", "P", stored_arrays.not_negative),
        "audio_means": Array("f8", "A"),
        "audio_scales": Array("f8", "A", stored_arrays.not_negative),
        "sequence_starts": Array("i8", "sequences", stored_arrays.starts("N")),
        "sequence_stops": Array("i8", "sequences", stored_arrays.up_to("N")),
        "valid": Array("bool", "N"),
    },
    FORMAT_VERSION, _unfit,
)  # fmt: skip

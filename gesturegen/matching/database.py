"""The matching database: for every reference frame what the hands do next and what the voice does, and its file.

k-NN motion matching (Habibie et al. 2022, §3.1.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from gesturegen.clips import Reference
from gesturegen.config import Config
from gesturegen.errors import DataError
from gesturegen.graph import reference_frames
from gesturegen.graph.reference_frames import ReferenceFrames, describe, join, positions_of, require_one_skeleton
from gesturegen.matching import features
from gesturegen.matching.features import Scaling
from gesturegen.motion import kinematics
from gesturegen.search.nearest import Candidates

FORMAT_VERSION = 1
SETTINGS = (
    "fps", "joints", "positions", "onsets", "wrists", "exclude", "breaks", "keywords.words", "pauses", "acoustics",
    "references.seconds", "motion_matching.sequence_seconds", "motion_matching.step_seconds",
    "motion_matching.audio_values", "motion_matching.audio_interval_seconds", "motion_matching.pose_values",
    "motion_matching.pose_interval_seconds", "motion_matching.joints",
)  # fmt: skip


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

    @property
    def n_unnatural_edges(self) -> int:
        """Any frame may follow any other, so there are none to count."""
        return 0

    @cached_property
    def candidates(self) -> Candidates:
        return Candidates(self.pose, self.audio, self.sequence_starts, self.sequence_stops, self.valid)

    @property
    def audio_scaling(self) -> Scaling:
        return Scaling(self.audio_means, self.audio_scales)


def step_frames(config: Config) -> int:
    """Frames that are shown before the next search."""
    return max(round(config.motion_matching.step_seconds * config.fps), 1)


def build(references: Sequence[Reference], config: Config) -> MatchingDatabase:
    """The database of one or several references with the same skeleton.

    Raises DataError when their skeletons differ or lack a configured joint, or when their sound was not measured.
    """
    skeleton = require_one_skeleton(references)
    described = join([describe(reference, config) for reference in references])
    settings = config.motion_matching
    joints = [skeleton.index(name) for name in settings.joints]
    pelvis = skeleton.pelvis(config.positions.root_joint)
    poses, sounds = [], []
    for reference in references:
        seen = kinematics.relative_positions(reference.motion, joints, pelvis, "root_heading")
        poses.append(
            features.pose_features(
                seen * config.positions.scale, reference.segment_starts, reference.motion.fps, settings
            )
        )
        if reference.speech.acoustics is None:
            raise DataError(f"clip {reference.name}: its sound was not measured; set acoustics.enabled: true")
        times = reference.source_frames / reference.motion.fps
        sounds.append(features.audio_features(reference.speech.acoustics, times, settings))
    pose, audio = np.concatenate(poses), np.concatenate(sounds)
    pose_scaling, audio_scaling = Scaling.of(pose), Scaling.of(audio)
    segment_starts, n_nodes = described["segment_starts"], len(pose)
    starts, stops = features.sequences(segment_starts, n_nodes, described["fps"], settings)
    ends = np.append(segment_starts[1:], n_nodes) - 1
    last = ends[np.searchsorted(segment_starts, np.arange(n_nodes), side="right") - 1]
    return MatchingDatabase(
        positions=np.concatenate([positions_of(reference.motion, config) for reference in references]),
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


def save(path: str | Path, database: MatchingDatabase, config: Config, clip_digests: Sequence[str] = ()) -> None:
    """Store it, with the settings that it depends on (`reference_frames.save`)."""
    reference_frames.save(path, database, FORMAT_VERSION, config.section_json(*SETTINGS), clip_digests)


def load(path: str | Path, config: Config | None = None, clip_digests: Sequence[str] | None = None) -> MatchingDatabase:
    """Read a stored one; DataErrors as by `reference_frames.load`."""
    settings = None if config is None else config.section_json(*SETTINGS)
    return reference_frames.load(MatchingDatabase, "matching database", path, FORMAT_VERSION, settings, clip_digests)

"""k-NN motion matching (Habibie et al. 2022) as a method."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gesturegen.methods.method import Description, Inspection, Job, Material, Prepared, Trainer

if TYPE_CHECKING:
    import numpy as np

    from gesturegen.data.clips import Reference, Speech
    from gesturegen.errors import GesturegenError
    from gesturegen.methods.motion_matching.database import MatchingDatabase, Part
    from gesturegen.outcome import Outcome
    from gesturegen.path import Path
    from gesturegen.settings.models import Config
    from gesturegen.stored.arrays import Kind

_FEW_MINUTES = 5.0


class MotionMatchingMethod(Trainer["MatchingDatabase"]):
    """Method that chooses every half second the piece of motion that goes on best and sounds best (§3.1)."""

    name = "motion_matching"
    suffix = "-matching"
    settings = (
        "fps", "joints", "skeleton", "positions", "audio", "voice", "onsets", "wrists", "exclude", "breaks",
        "keywords.words", "pauses", "acoustics", "references.seconds", "motion_matching.sequence_seconds",
        "motion_matching.step_seconds", "motion_matching.audio_values", "motion_matching.audio_interval_seconds",
        "motion_matching.pose_values", "motion_matching.pose_interval_seconds", "motion_matching.joints",
    )  # fmt: skip
    control = "method: motion_matching"
    joint_settings: Mapping[str, tuple[str, ...]] = {"motion_matching.joints": ("elbow", "wrist", "finger_roots")}
    at_once = True

    def search_name(self, config: Config) -> str:
        return "nearest"

    def lacks(self, config: Config) -> str | None:
        if config.acoustics.enabled:
            return None
        return "motion_matching needs acoustics.enabled: true, which measures the sound that it matches"

    def follows_conditions(self, config: Config) -> bool:
        return True

    def prospects(self, material: Material) -> Sequence[tuple[str, str, str]]:
        missing = sorted({*material.config.motion_matching.joints} - material.joint_names)
        able = "no" if missing else "yes" if material.minutes >= _FEW_MINUTES else "limited"
        lacking = f"the skeleton lacks {', '.join(missing)}; give motion_matching.joints"
        return (
            (self.name, able, lacking if missing else f"{material.references} ({_FEW_MINUTES:g} or more are better)"),
        )

    def part(self, reference: Reference, config: Config) -> Part:
        from gesturegen.methods.motion_matching import database

        return database.describe_part(reference, config)

    def assemble(self, parts: Sequence[Any], config: Config) -> MatchingDatabase:
        from gesturegen.methods.motion_matching import database

        return database.assemble(parts, config)

    def prepare(
        self, jobs: Mapping[str, Job], is_stored: Callable[[Job], bool], run: Callable[[Mapping, str], Outcome]
    ) -> Prepared:
        from gesturegen.methods import parts

        return parts.in_processes(self, jobs, is_stored, run, "features")

    def kind(self) -> Kind:
        from gesturegen.methods.motion_matching import database

        return database.KIND

    def library_type(self) -> type[MatchingDatabase]:
        from gesturegen.methods.motion_matching import database

        return database.MatchingDatabase

    def describe(self, library: MatchingDatabase, config: Config) -> Description:
        return Description([f"{library.n_nodes} nodes, {len(library.sequence_starts)} sequences"])

    def inspect(self, library: MatchingDatabase) -> Inspection:
        from gesturegen.methods.inspection import inspect_frames

        features = {"pose": library.pose.shape[1], "audio": library.audio.shape[1]}
        line = f"{len(library.sequence_starts)} sequences; features: {features['pose']} of pose, {features['audio']} of sound"
        return inspect_frames(library, {"sequences": len(library.sequence_starts), "features": features}, [line])

    def search(
        self, library: MatchingDatabase, speech: Speech, config: Config, rng: np.random.Generator,
        earlier: Sequence[Path] = (),
    ) -> Path:  # fmt: skip
        from gesturegen.methods.motion_matching import search

        return search.search(library, speech, config, rng, earlier)

    def search_all(
        self, library: MatchingDatabase, speeches: Mapping[str, Speech], config: Config
    ) -> dict[str, Path | GesturegenError]:
        from gesturegen.methods.motion_matching import search

        return search.search_all(library, speeches, config)

    def stand_in(
        self, library: MatchingDatabase, reference: Reference, k: int, config: Config, rng: np.random.Generator
    ) -> Path:
        from gesturegen.methods.motion_matching import training_paths

        return training_paths.stand_in(library, reference, k, config, rng)

    def build_loops(self) -> Sequence[Callable[[], object]]:
        from gesturegen.methods.motion_matching import compiling

        return (compiling.compile_matching,)

    search_loops = build_loops

"""GestureMaster (Zhou et al. 2022) as a method."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gesturegen.methods.method import WORKER_BYTES, Description, Inspection, Job, Material, Method, Prepared

if TYPE_CHECKING:
    import numpy as np

    from gesturegen.data.clips import Reference, Speech
    from gesturegen.methods.gesture_master.database import GestureDatabase, Part
    from gesturegen.outcome import Outcome
    from gesturegen.path import Path
    from gesturegen.settings.models import Config
    from gesturegen.stored.arrays import Kind

_FEW_GESTURES = 50
# A gesture database stays on disk but for what is looked at; building one takes this much of a reference frame, its
# mirrored copy included.
_BYTES_PER_FRAME = 2_500


class GestureMasterMethod(Method["GestureDatabase"]):
    """Method that chooses a gesture clip for every clip of the speech, by rhythm, style and transition (§4)."""

    name = "gesture_master"
    suffix = "-gestures"
    # What the gesture clips of a recording depend on, and what the database of several recordings depends on.
    clip_settings = (
        "fps", "joints", "skeleton", "positions", "audio", "voice", "onsets", "wrists", "exclude", "breaks", "prosody",
        "gesture_master.cutting", "gesture_master.quality", "gesture_master.mirror", "gesture_master.joint_pairs",
        "gesture_master.rhythm.bits", "gesture_master.rhythm.smoothing_seconds", "gesture_master.rhythm.corrections",
        "gesture_master.transition_frames", "keywords.words", "pauses",
    )  # fmt: skip
    settings = (
        *clip_settings, "references.seconds", "gesture_master.finger_transfer", "gesture_master.style.source",
        "gesture_master.style.ridge", "gesture_master.style.folds", "gesture_master.upper.lambda_1",
        "gesture_master.upper.lambda_2", "gesture_master.upper.delta_t", "gesture_master.upper.delta_quantile",
        "gesture_master.lower.lambda_1", "gesture_master.lower.lambda_2", "gesture_master.lower.delta_t",
        "gesture_master.lower.delta_quantile",
    )  # fmt: skip
    sections = ("gesture_master",)
    bodies = ("upper", "lower", "fingers")

    def search_name(self, config: Config) -> str:
        return "viterbi"

    def lacks(self, config: Config) -> str | None:
        if config.prosody.enabled or config.gesture_master.style.source != "predict":
            return None
        return (
            "gesture_master with gesture_master.style.source: predict needs prosody.enabled: true, which measures "
            "energy and pitch; or set the source to targets or none"
        )

    def named_clips(self, config: Config) -> Iterable[tuple[str, str, str]]:
        own = config.gesture_master
        for target in own.style.targets or ():
            yield "gesture_master.style.targets", target.clip, "test clip"
        for correction in own.rhythm.corrections or ():
            yield "gesture_master.rhythm.corrections", correction.clip, "reference clip"
        # A gesture clip is called by its recording and a time; of a glob, that may be anywhere.
        for key in ("include", "exclude"):
            for name in getattr(own.quality, key):
                if "@" in name:
                    yield f"gesture_master.quality.{key}", name.rpartition("@")[0], "reference clip"

    def prospects(self, material: Material) -> Sequence[tuple[str, str, str]]:
        clips = material.gesture_clips
        able = "yes" if clips >= _FEW_GESTURES else "limited" if clips else "no"
        return ((self.name, able, f"{clips} gesture clips ({_FEW_GESTURES} or more are better)"),)

    def bytes_needed(self, reference_frames: int, test_frames: int, config: Config, kept_frames: int) -> float:
        return WORKER_BYTES + _BYTES_PER_FRAME * reference_frames

    def part(self, reference: Reference, config: Config) -> Part:
        from gesturegen.methods.gesture_master import database

        return database.part(reference, config)

    def assemble(self, parts: Sequence[Any], config: Config) -> GestureDatabase:
        from gesturegen.methods.gesture_master import database

        return database.of_parts(parts, config)

    def prepare(
        self, jobs: Mapping[str, Job], is_stored: Callable[[Job], bool], run: Callable[[Mapping, str], Outcome]
    ) -> Prepared:
        from gesturegen.methods.gesture_master import building

        return building.prepare(jobs, is_stored, run)

    def build(self, job: Job, prepared: Any = None) -> GestureDatabase:
        from gesturegen.methods.gesture_master import building

        return building.build(job)

    def built(self, job: Job) -> None:
        from gesturegen.methods.gesture_master import building

        building.forget_blocks(job.path)

    def kind(self) -> Kind:
        from gesturegen.methods.gesture_master import database

        return database.KIND

    def library_type(self) -> type[GestureDatabase]:
        from gesturegen.methods.gesture_master import database

        return database.GestureDatabase

    def shown_clips(self, config: Config, names: Sequence[str]) -> Sequence[Reference]:
        from gesturegen.methods.gesture_master import building

        return building.StoredReferences(config, names)

    def describe(self, library: GestureDatabase, config: Config) -> Description:
        from gesturegen.methods.gesture_master import building

        return building.describe(library, config)

    def inspect(self, library: GestureDatabase) -> Inspection:
        from gesturegen.methods.gesture_master import description

        return description.inspect(library)

    def piece_name(self, library: GestureDatabase, nodes: Sequence[int]) -> str | None:
        return library.clip_name_of(nodes)

    def shows_whole_pieces(self) -> bool:
        return True

    def search(
        self, library: GestureDatabase, speech: Speech, config: Config, rng: np.random.Generator,
        earlier: Sequence[Path] = (),
    ) -> Path:  # fmt: skip
        from gesturegen.methods.gesture_master import search

        return search.search(library, speech, config, rng, earlier)

    def build_loops(self) -> Sequence[Callable[[], object]]:
        from gesturegen.methods.gesture_master import compiling

        return (compiling.compile_gestures,)

    search_loops = build_loops

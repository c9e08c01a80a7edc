"""The baselines as a method: uninterrupted stretches of recorded motion, for comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gesturegen.methods.method import Material, Method

if TYPE_CHECKING:
    import numpy as np

    from gesturegen.data.clips import Reference, Speech
    from gesturegen.methods.baseline.search import RecordedFrames
    from gesturegen.motion.skeleton import Skeleton
    from gesturegen.path import Path
    from gesturegen.settings.models import Config
    from gesturegen.stored.arrays import Kind


class Baseline(Method["RecordedFrames"]):
    """Method that shows a random stretch of the references, or the motion of other speech (`config.baseline`)."""

    name = "baseline"
    suffix = "-frames"
    settings = (
        "fps", "joints", "skeleton", "positions", "audio", "voice", "onsets", "wrists", "exclude", "breaks",
        "keywords.words", "pauses", "references.seconds",
    )  # fmt: skip

    def search_name(self, config: Config) -> str:
        return config.baseline

    def prospects(self, material: Material) -> Sequence[tuple[str, str, str]]:
        return ()

    def part(self, reference: Reference, config: Config) -> tuple[Skeleton, dict, np.ndarray]:
        from gesturegen.methods.baseline import search

        return search.part(reference, config)

    def assemble(self, parts: Sequence[Any], config: Config) -> RecordedFrames:
        from gesturegen.methods.baseline import search

        return search.assemble(parts, config)

    def kind(self) -> Kind:
        from gesturegen.methods.baseline import search

        return search.KIND

    def library_type(self) -> type[RecordedFrames]:
        from gesturegen.methods.baseline import search

        return search.RecordedFrames

    def search(
        self, library: RecordedFrames, speech: Speech, config: Config, rng: np.random.Generator,
        earlier: Sequence[Path] = (),
    ) -> Path:  # fmt: skip
        from gesturegen.methods.baseline import search

        return search.search(library, speech, config, rng, earlier)

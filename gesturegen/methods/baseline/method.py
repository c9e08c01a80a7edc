"""The baselines as a method: uninterrupted stretches of recorded motion, for comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gesturegen.methods.method import Material, Method

if TYPE_CHECKING:
    from gesturegen.settings.models import Config


class Baseline(Method):
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

    def part(self, reference, config):
        from gesturegen.methods.baseline import search

        return search.part(reference, config)

    def assemble(self, parts: Sequence[Any], config):
        from gesturegen.methods.baseline import search

        return search.assemble(parts, config)

    def kind(self):
        from gesturegen.methods.baseline import search

        return search.KIND

    def library_type(self):
        from gesturegen.methods.baseline import search

        return search.RecordedFrames

    def search(self, library, speech, config, rng, earlier=()):
        from gesturegen.methods.baseline import search

        return search.search(library, speech, config, rng, earlier)

"""The settings of all methods as sections of the config, and those of their lists that may be kept in files."""

from __future__ import annotations

from typing import Literal

from gesturegen.methods.gesture_master.settings import GestureMaster, StyleTarget
from gesturegen.methods.motion_graph.settings import Beam, Features, GlobalSearch, Termination
from gesturegen.methods.motion_matching.settings import MotionMatching
from gesturegen.settings.base import Section
from gesturegen.settings.speech import Correction, Cutting, Rhythm


class MethodSections(Section):
    """The settings of all methods, each in its own sections; `method` is the name of the one that is used."""

    method: str = "motion_graph"
    search: Literal["beam", "global"] = "beam"
    beam: Beam = Beam()
    global_search: GlobalSearch = GlobalSearch()
    features: Features = Features()
    initialization: Literal["feature", "random"] = "feature"
    termination: Termination = Termination()
    gesture_master: GestureMaster = GestureMaster()
    motion_matching: MotionMatching = MotionMatching()
    baseline: Literal["random_stretch", "mismatched"] = "random_stretch"

    @property
    def cutting(self) -> Cutting:
        """Return how speech is cut into clips, by which the rhythm of every method is measured."""
        return self.gesture_master.cutting

    @property
    def rhythm(self) -> Rhythm:
        """Return how words and hand speeds become bits, by which the rhythm of every method is measured."""
        return self.gesture_master.rhythm

    @property
    def window_seconds(self) -> float:
        """Return the length of the windows that a refinement network is trained on."""
        return self.motion_matching.sequence_seconds


# Lists that may be kept in a CSV file: section, its part, key of the file, key of the list, and what a row is.
LISTS = (
    ("gesture_master", "rhythm", "corrections_file", "corrections", Correction),
    ("gesture_master", "style", "targets_file", "targets", StyleTarget),
)

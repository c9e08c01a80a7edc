"""Methods choose frames: modules with `build(references, config)` and `search(library, speech, config, rng, earlier)`.

A library is stored by `save(path, library, config, digests)` and read by `load(path, config, digests)`; it depends on
the references and on the settings in `SETTINGS`.
"""

from pathlib import Path

from gesturegen import files
from gesturegen.errors import DataError
from gesturegen.gestures.database import GestureDatabase
from gesturegen.graph.motion_graph import MotionGraph
from gesturegen.methods import baseline, gesture_master, motion_graph, motion_matching
from gesturegen.stored import sealing

METHODS = {
    "motion_graph": motion_graph, "gesture_master": gesture_master, "motion_matching": motion_matching,
    "baseline": baseline,
}  # fmt: skip
# An array that tells the library of a method from that of another, and one that tells it from a part of one. What a
# baseline has, all have: it comes last.
_MARKS = {
    "indptr": motion_graph, "rhythms": gesture_master, "sequence_starts": motion_matching, "clip_starts": baseline,
}  # fmt: skip
_WHOLE = "format_version"


def load_library(path: str | Path) -> MotionGraph | GestureDatabase:
    """Read a stored library, whichever method it is of; DataError when it is missing, damaged or none."""
    if not Path(path).is_file():
        raise DataError(f"{path}: this graph has not been built; run `gesturegen build-graph` first")
    sealing.checksum(path, "build-graph")
    found = files.map_arrays(path, only={*_MARKS, _WHOLE})
    for mark, method in _MARKS.items():
        if mark in found and _WHOLE in found:
            return method.load(path)
    raise DataError(
        f"{path}: a clip or other arrays, not a graph and not a gesture database; both are in the folder `graphs`"
    )

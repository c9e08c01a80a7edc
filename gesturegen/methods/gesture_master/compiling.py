"""A small problem that compiles the loops of GestureMaster."""

from __future__ import annotations

import numpy as np

from gesturegen.methods.gesture_master import transitions, viterbi
from gesturegen.methods.gesture_master.transitions import Borders
from gesturegen.motion import rotation
from gesturegen.motion.skeleton import read_only


def compile_gestures() -> None:
    """Compile the loops: link a few gesture clips and search them."""
    rng = np.random.default_rng(0)
    poses = Borders(rng.normal(size=(3, 2, 2, 3)).astype(np.float32), np.tile(rotation.IDENTITY, (3, 2, 2, 1)))
    found = transitions.edges(poses, poses, 0, 3, 1.0, 1.0, np.inf)
    transitions.quantile(poses, poses, 0.5, 1.0, 1.0, rng)
    indptr = np.append(0, np.cumsum(found[0]))
    edges = viterbi.InEdges(*(read_only(array) for array in (indptr, *found[1:])))
    viterbi.search(rng.normal(size=(2, 3)), edges, 1.0, 1.0, np.arange(3), 1.0)

"""A small problem that compiles the loops of motion matching."""

from __future__ import annotations

import numpy as np

from gesturegen.methods.motion_matching import nearest
from gesturegen.methods.motion_matching.settings import MotionMatching


def compile_matching() -> None:
    """Compile the loops: search a small database, by pose and by sound first."""
    rng = np.random.default_rng(0)
    poses, sounds = (rng.normal(size=(20, width)).astype(np.float32) for width in (3, 2))
    candidates = nearest.Candidates(poses, sounds, np.array([0, 10]), np.array([10, 20]), np.arange(20) % 10 < 8)
    for settings in (MotionMatching(preselect=by) for by in ("pose", "audio")):
        nearest.search(candidates, [sounds[:2]], poses[:1], 1, settings)

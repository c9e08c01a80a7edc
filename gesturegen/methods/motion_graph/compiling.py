"""Small problems that compile the loops of the motion graph and of its two searches."""

from __future__ import annotations

import numpy as np

from gesturegen.data.clips import Speech
from gesturegen.data.keynodes import KeyNodes
from gesturegen.methods.motion_graph import beam, global_search, graph
from gesturegen.methods.motion_graph.graph import MotionGraph
from gesturegen.settings.loading import load_config
from gesturegen.settings.models import Continuity


def small_graph() -> MotionGraph:
    """Build a graph of a few frames, in whose building all loops run."""
    positions = np.cumsum(np.random.default_rng(0).normal(size=(50, 2, 3)), axis=0).astype(np.float32)
    key_nodes = KeyNodes(np.array([20, 49]), np.array(["onset", "break"]), np.array(["", ""]))
    # Graphs' arrays are read-only, which is a type of its own to numba.
    return graph.from_positions(
        positions, np.array([0]), Continuity(),
        joint_names=("a", "b"), fps=30.0, clip_names=("noise",), clip_starts=np.array([0]),
        source_frames=np.arange(50), key_nodes=key_nodes, speaking=np.arange(50) < 40,
    )  # fmt: skip


def compile_beam() -> None:
    """Compile the loops of the beam search: search a small graph piece by piece."""
    built = small_graph()
    beam.search(built, built.stop_nodes(None), np.array([0]), 20, load_config().beam)


def compile_global() -> None:
    """Compile the loops of the global search: search a small graph as a whole."""
    built, speech, config = small_graph(), Speech("noise", np.array([0.5]), (), 40, 30.0), load_config()
    global_search.search(built, speech, config)
    # So short a path shows nothing again, for which windows of it would be solved again.
    problem = global_search.Problem(global_search.price_list(built, speech, config), speech.n_frames)
    problem.solve_again(problem.solve(), 10, 20)

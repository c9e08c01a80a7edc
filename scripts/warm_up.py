"""Compile and cache the loops (numba, and librosa's own), so that the first real command is fast."""

import numpy as np

from gesturegen.clips import Speech
from gesturegen.config import Continuity, load_config
from gesturegen.gestures import transitions
from gesturegen.gestures.transitions import Borders
from gesturegen.graph import motion_graph
from gesturegen.keynodes import KeyNodes
from gesturegen.motion import rotation
from gesturegen.motion.skeleton import read_only
from gesturegen.search import beam, global_search, viterbi
from gesturegen.speech import audio, prosody


def main() -> None:
    config = load_config()
    rng = np.random.default_rng(0)
    samples = rng.normal(size=config.onsets.sample_rate).astype(np.float32)
    audio.detect_onset_peaks(samples, 16000, config.onsets)
    positions = np.cumsum(rng.normal(size=(50, 2, 3)), axis=0).astype(np.float32)
    key_nodes = KeyNodes(np.array([20, 49]), np.array(["onset", "break"]), np.array(["", ""]))
    # Graphs' arrays are read-only, which is a type of its own to numba.
    graph = motion_graph.from_positions(
        positions, np.array([0]), Continuity(),
        joint_names=("a", "b"), fps=30.0, clip_names=("noise",), clip_starts=np.array([0]),
        source_frames=np.arange(50), key_nodes=key_nodes, speaking=np.arange(50) < 40,
    )  # fmt: skip
    beam.search(graph, graph.stop_nodes(None), np.array([0]), 20, config.beam)
    global_search.search(graph, Speech("noise", np.array([0.5]), (), 40, 30.0), config)
    poses = Borders(rng.normal(size=(3, 2, 2, 3)).astype(np.float32), np.tile(rotation.IDENTITY, (3, 2, 2, 1)))
    counts, sources, costs = (read_only(array) for array in transitions.edges(poses, poses, 0, 3, 1.0, 1.0, np.inf))
    edges = viterbi.InEdges(np.append(0, np.cumsum(counts)), sources, costs)
    viterbi.search(rng.normal(size=(2, 3)), edges, 1.0, 1.0, np.arange(3), 1.0)
    prosody.measure(samples, 16000, config.prosody)


if __name__ == "__main__":
    main()

"""What is compiled before the workers of a command start, in one process, so that they find it ready.

Without it every worker would compile the same loops at the same time. Nothing but time depends on the lists here: a
loop that is missing in them is compiled where it is first called, and kept from then on.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from gesturegen.clips import Speech
from gesturegen.compiled import hook, is_switched_on, store
from gesturegen.config import Continuity, MotionMatching, load_config
from gesturegen.gestures import transitions
from gesturegen.gestures.transitions import Borders
from gesturegen.graph import motion_graph
from gesturegen.graph.motion_graph import MotionGraph
from gesturegen.keynodes import KeyNodes
from gesturegen.motion import rotation
from gesturegen.motion.skeleton import read_only
from gesturegen.search import beam, global_search, nearest, viterbi
from gesturegen.speech import acoustics, audio, prosody
from gesturegen.video import _kernels as video_kernels

# Groups that this process has found or made ready.
_ready: set[str] = set()


def prepare(groups: Iterable[str], quiet: bool = True) -> None:
    """Compile groups of loops, those that are not yet kept, and say so in one line unless `quiet`.

    One process compiles while others wait for it; what is damaged or missing is compiled anew. That nothing can be
    kept is no error: then every process compiles for itself.
    """
    groups = [group for group in groups if group not in _ready]
    if is_switched_on() and not all(_is_kept(group) for group in groups):
        with store.alone() as folder:
            missing = [group for group in groups if not _is_kept(group)]
            if missing and not quiet:
                _tell(folder)
            for group in missing:
                GROUPS[group]()
                store.keep(_record(group), json.dumps(sorted(store.used)).encode())
    _ready.update(groups)


def _tell(folder: Path | None) -> None:
    from tqdm import tqdm

    line = "compiling loops for this version and processor, once; it takes up to a minute"
    reason = store.refusal()
    if folder is None:
        line += f"; they cannot be kept ({reason}): set XDG_CACHE_HOME to a folder that can be written"
    elif folder.parent != store.cache_folder():
        line += f"; they are kept in {folder.parent} ({reason or 'there is no home folder'})"
    tqdm.write(line, file=sys.stderr)


def _record(group: str) -> str:
    """The name of the entry that lists what a group needs, as of the present sources."""
    return f"group-{group}-{hook.source_digest(__file__)[:24]}"


def _is_kept(group: str) -> bool:
    """Whether everything that a group needs is in the store and sound."""
    for stored in store.read(_record(group)):
        if all(store.is_sound(name) for name in json.load(stored)):
            return True
    return False


def _compile_speech() -> None:
    config = load_config()
    samples = np.random.default_rng(0).normal(size=config.onsets.sample_rate).astype(np.float32)
    audio.detect_onset_peaks(samples, 16000, config.onsets)
    prosody.measure(samples, 16000, config.prosody)
    acoustics.measure(samples, 16000, config.acoustics)


def _small_graph() -> MotionGraph:
    positions = np.cumsum(np.random.default_rng(0).normal(size=(50, 2, 3)), axis=0).astype(np.float32)
    key_nodes = KeyNodes(np.array([20, 49]), np.array(["onset", "break"]), np.array(["", ""]))
    # Graphs' arrays are read-only, which is a type of its own to numba.
    return motion_graph.from_positions(
        positions, np.array([0]), Continuity(),
        joint_names=("a", "b"), fps=30.0, clip_names=("noise",), clip_starts=np.array([0]),
        source_frames=np.arange(50), key_nodes=key_nodes, speaking=np.arange(50) < 40,
    )  # fmt: skip


def _compile_beam() -> None:
    graph = _small_graph()
    beam.search(graph, graph.stop_nodes(None), np.array([0]), 20, load_config().beam)


def _compile_global() -> None:
    graph, speech, config = _small_graph(), Speech("noise", np.array([0.5]), (), 40, 30.0), load_config()
    global_search.search(graph, speech, config)
    # So short a path shows nothing again, for which windows of it would be solved again.
    problem = global_search.Problem(global_search.price_list(graph, speech, config), speech.n_frames)
    problem.solve_again(problem.solve(), 10, 20)


def _compile_gestures() -> None:
    rng = np.random.default_rng(0)
    poses = Borders(rng.normal(size=(3, 2, 2, 3)).astype(np.float32), np.tile(rotation.IDENTITY, (3, 2, 2, 1)))
    found = transitions.edges(poses, poses, 0, 3, 1.0, 1.0, np.inf)
    transitions.quantile(poses, poses, 0.5, 1.0, 1.0, rng)
    indptr = np.append(0, np.cumsum(found[0]))
    edges = viterbi.InEdges(*(read_only(array) for array in (indptr, *found[1:])))
    viterbi.search(rng.normal(size=(2, 3)), edges, 1.0, 1.0, np.arange(3), 1.0)


def _compile_matching() -> None:
    rng = np.random.default_rng(0)
    poses, sounds = (rng.normal(size=(20, width)).astype(np.float32) for width in (3, 2))
    candidates = nearest.Candidates(poses, sounds, np.array([0, 10]), np.array([10, 20]), np.arange(20) % 10 < 8)
    for settings in (MotionMatching(preselect=by) for by in ("pose", "audio")):
        nearest.search(candidates, [sounds[:2]], poses[:1], 1, settings)


def _compile_video() -> None:
    image, segments, radii, colours = (
        np.zeros((8, 8, 3), np.uint8),
        np.ones((1, 4)),
        np.ones(1),
        np.zeros((1, 3), np.uint8),
    )
    video_kernels.draw_capsules(image, segments, radii, colours, np.array([0, 0, 8, 8]))
    video_kernels.to_yuv420(image, np.empty((12, 8), np.uint8))


GROUPS: dict[str, Callable[[], object]] = {
    "speech": _compile_speech,
    "graph": _small_graph,
    "beam": _compile_beam,
    "global": _compile_global,
    "gestures": _compile_gestures,
    "matching": _compile_matching,
    "video": _compile_video,
}


if __name__ == "__main__":
    prepare(GROUPS, quiet=False)

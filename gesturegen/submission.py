"""The files that a run writes: BVH, traces that explain every frame, and the manifest; with the check of them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from gesturegen import __version__, files
from gesturegen import trace as traces
from gesturegen.control.schedule import Demand
from gesturegen.data import keynodes
from gesturegen.data.clips import Speech
from gesturegen.data.keynodes import KeyNodes
from gesturegen.errors import DamagedError, DataError
from gesturegen.frames import ReferenceFrames
from gesturegen.manifest import ClipRow, Manifest
from gesturegen.methods import METHODS
from gesturegen.motion import bvh, rotation
from gesturegen.motion.skeleton import Motion, Skeleton
from gesturegen.path import Path as SearchPath
from gesturegen.path import Piece, Track
from gesturegen.runs import runs
from gesturegen.settings.models import Config
from gesturegen.stored import documents
from gesturegen.trace import Trace

# A torn frame turns a joint by a right angle or more; recorded gestures and blends stay well below, unless the recording
# itself has such a frame: then a joint may turn a little faster than there, as a blend adds to it.
LARGEST_TURN_DEGREES_PER_SECOND = 2700.0
MOST_TIMES_RECORDED = 1.1
# Below this nothing moves: a written file has six decimals.
STILL_DEGREES, STILL_DISTANCE = 1e-3, 1e-5
STILL_SECONDS = 1.0
# Of a stretch without motion, what may fall into speech; nobody who speaks stands like a statue for longer.
STILL_WHILE_SPEAKING_SECONDS = 2.0


def make_trace(
    path: SearchPath, graph: ReferenceFrames, graph_name: str, speech: Speech, key_nodes: KeyNodes, config: Config,
    variant: int = 1, inputs: str = "",
) -> Trace:  # fmt: skip
    """Build the trace that explains a clip's frames, as it is before the clip is written.

    inputs : a hash of all that the path was made of
    """
    pieces = path.tracks[0].pieces
    stuck = path.failure
    return Trace(
        clip=speech.name,
        method=config.method,
        search=config.search_name,
        seed=config.seed,
        variant=variant,
        graph=graph_name,
        references=tuple(
            traces.Origin(clip=name, start_node=int(start), mirrored=mirrored)
            for (name, mirrored), start in zip(graph.clips, graph.clip_starts, strict=True)
        ),
        fps=graph.fps,
        n_frames=speech.n_frames,
        version=__version__,
        config_hash=config.signature(),
        key_nodes=tuple(
            traces.KeyNode.model_validate({"frame": int(frame), "kind": str(kind), "keyword": str(keyword)})
            for frame, kind, keyword in zip(key_nodes.frames, key_nodes.kinds, key_nodes.keywords, strict=True)
        ),
        pieces=tuple(_trace_piece(piece) for piece in pieces),
        joins=_trace_joins(pieces, graph, config),
        pauses=runs(~keynodes.speaking(speech, config.pauses)).tolist(),
        objective=None if path.objective is None else {name: dict(terms) for name, terms in path.objective.items()},
        failure=None
        if stuck is None
        else traces.Failure(
            start_frame=stuck.start_frame,
            end_frame=stuck.end_frame,
            end_kind=stuck.end_kind,
            keyword=stuck.keyword,
        ),
        control=tuple(_trace_demand(demand) for demand in path.demands),
        tracks=tuple(_trace_track(track, graph, config) for track in path.tracks[1:]),
        notes=path.notes,
        inputs=inputs,
        bvh_sha256=None,
    )


def _trace_demand(demand: Demand) -> traces.Demand:
    free = (-math.inf, math.inf)
    return traces.Demand.model_validate(
        {name: None if value in free else value for name, value in vars(demand).items()}
    )


def _trace_track(track: Track, graph: ReferenceFrames, config: Config) -> traces.Track:
    """Convert a further track, which moves joints of its own, for the trace."""
    assert track.joints is not None  # only the first track of a path moves all joints
    return traces.Track(
        joints=track.joints,
        pieces=tuple(_trace_piece(piece) for piece in track.pieces),
        joins=_trace_joins(track.pieces, graph, config),
    )


def _trace_piece(piece: Piece) -> traces.Piece:
    return traces.Piece(
        start_frame=piece.target.start_frame,
        end_frame=piece.target.end_frame,
        target_length=piece.target.length,
        end_kind=piece.target.end_kind,
        keyword=piece.target.keyword,
        nodes=piece.nodes.tolist(),
        cost=piece.cost,
        retries=piece.retries,
        fallback=piece.fallback,
        costs=None if piece.costs is None else dict(piece.costs),
    )


def _trace_joins(pieces: Sequence[Piece], graph: ReferenceFrames, config: Config) -> tuple[traces.Join, ...]:
    """Describe the joins of pieces; distances run from the left side's natural successor to the right's first node."""
    lefts = np.array([piece.nodes[-1] for piece in pieces[:-1]], dtype=int)
    rights = np.array([piece.nodes[0] for piece in pieces[1:]], dtype=int)
    distances = graph.distances(graph.successors[lefts], rights, config.continuity)
    return tuple(
        traces.Join(
            frame=piece.target.start_frame,
            from_node=int(left),
            to_node=int(right),
            distance=float(distance),
            natural=bool(right == graph.successors[left]),
        )
        for piece, left, right, distance in zip(pieces[1:], lefts, rights, distances, strict=True)
    )


def write_clip(folder: Path, name: str, motion: Motion | None, trace: Trace) -> dict[str, str]:
    """Write a clip's BVH (none for a clip that got stuck) and then its trace, which knows the BVH's hash.

    Returns the hashes of the files by name, for the manifest: of what was written, whatever is there later.
    """
    written, digest = {}, None
    if motion is None:
        remove_clip(folder, name)
    else:
        digest = written[f"{name}.bvh"] = bvh.write(folder / f"{name}.bvh", motion)
    told = trace.model_copy(update={"bvh_sha256": digest})
    written[f"{name}.trace.json"] = documents.write(folder / f"{name}.trace.json", told)
    return written


def kept_clip(folder: Path, name: str, trace: Trace) -> dict[str, str]:
    """Return the hashes of the files of a clip that an earlier run wrote, as `write_clip` returned them then."""
    digest, path = trace.bvh_sha256, folder / f"{name}.trace.json"
    return ({f"{name}.bvh": digest} if digest else {}) | {path.name: files.sha256(path)}


def remove_clip(folder: Path, name: str) -> None:
    """Remove a clip's files of an earlier run, so that they do not pass for results of this run."""
    for suffix in (".bvh", ".trace.json"):
        (folder / f"{name}{suffix}").unlink(missing_ok=True)


def read_trace_if_current(folder: Path, name: str, inputs: str) -> Trace | None:
    """Read the trace of a written clip if the clip was made of `inputs`; else return None.

    DamagedError when it or its BVH is not as it was written.
    """
    path = folder / f"{name}.trace.json"
    try:
        found = read_trace(path) if path.is_file() else None
        if found is None or found.inputs != inputs:
            return None
        require_unchanged(folder / f"{name}.bvh", found)
        return found
    except DamagedError:
        raise
    except DataError:
        return None


def read_trace(path: Path) -> Trace:
    """Read a stored trace; DataError when it cannot be read, DamagedError when it is not as it was written."""
    found = documents.read(path, Trace, "reenact")
    if found.method not in METHODS:
        raise DamagedError(
            f"{path}: made by method {found.method!r}, which this version of gesturegen does not have; "
            "run `gesturegen reenact` again"
        )
    return found


def require_unchanged(path: Path, trace: Trace) -> None:
    """Raise DamagedError for a BVH file that is not the one its trace was written with."""
    digest = files.sha256(path) if path.is_file() else None
    if digest != trace.bvh_sha256:
        change = "missing" if digest is None else "not as it was written beside its trace"
        raise DamagedError(f"{path}: {change}; run `gesturegen reenact` again")


def manifest(results: Iterable[ClipRow], config: Config, variant: int = 1) -> Manifest:
    """Build the manifest of a run: settings, inputs, figures and file hashes; the same for the same inputs.

    results : one row per test clip, of `clip_row` or of `failed_row`
    """
    rows = sorted(results, key=lambda row: row.clip)
    return Manifest(
        gesturegen=__version__,
        method=config.method,
        search=config.search_name,
        seed=config.seed,
        variant=variant,
        config_hash=config.signature(),
        n_clips=len(rows),
        n_failed=sum(row.error is not None for row in rows),
        clips=tuple(rows),
        config=json.loads(config.model_dump_json(by_alias=True, exclude={"paths"})),
    )


def clip_row(trace: Trace, written: Mapping[str, str]) -> ClipRow:
    """Gather the figures of one clip for manifest and summary; written : the hashes that `write_clip` returned."""
    stuck = trace.failure
    return ClipRow(
        clip=trace.clip,
        references=tuple(reference.clip for reference in trace.references),
        graph=trace.graph,
        n_frames=trace.n_frames,
        pieces=len(trace.pieces),
        hard_joins=trace.n_hard_joins,
        retries=trace.n_retries,
        fallbacks=trace.fallbacks,
        stuck=stuck is not None,
        error=None if stuck is None else describe_failure(stuck, trace.fps),
        files=dict(written),
    )


def failed_row(name: str, references: Iterable[str], error: str) -> ClipRow:
    """Return the manifest row of a clip that could not be made."""
    return ClipRow(clip=name, references=tuple(references), stuck=False, error=error, files={})


def describe_failure(stuck: traces.Failure, fps: float) -> str:
    """Say in one line why a search got stuck and what helps."""
    what = f"keyword {stuck.keyword!r}" if stuck.keyword else f"{stuck.end_kind} node"
    return (
        f"no path for the piece from {stuck.start_frame / fps:.2f} to {stuck.end_frame / fps:.2f} s that ends at a {what}; "
        "set termination.fallbacks=true or give longer references"
    )


def check_motion(
    path: Path, skeletons: Sequence[Skeleton], n_frames: int | None, fps: float,
    recorded_turns: Callable[[], Mapping[str, float]] = dict, speaking: Callable[[], np.ndarray | None] = lambda: None,
) -> tuple[list[str], list[str]]:  # fmt: skip
    """Check a BVH file as a challenge submission: return what is wrong and what is odd, one line each.

    skeletons : those of the training data, one of which it must have; n_frames : of its speech, None where
    unknown; recorded_turns : gives the fastest turn of each joint in the training data, in degrees a second; it is
    called only when one turns faster than bodies do; speaking : gives the frames in which the speech goes on, bool
    `[shape=(n_frames,)]`, None where unknown, and is called only when there is a stretch without motion. Raises
    nothing: a file that cannot be read is one of the problems.
    """
    if not path.is_file():
        return [f"{path}: missing"], []
    try:
        motion = bvh.read(path)
    except DataError as error:
        return [str(error)], []
    problems = []
    differences = [motion.skeleton.difference(skeleton) for skeleton in skeletons]
    if all(differences):
        problems.append(f"{path}: not the training skeleton: {differences[0]}")
    if n_frames is not None and motion.n_frames != n_frames:
        problems.append(f"{path}: {motion.n_frames} frames, the speech has {n_frames}")
    if motion.fps != fps:
        problems.append(f"{path}: {motion.fps:g} fps, expected {fps:g}")
    standing, warnings = _still_stretches(path, motion, speaking)
    return problems + _torn_frames(path, motion, recorded_turns) + standing, warnings


def turns_per_second(motion: Motion) -> np.ndarray:
    """Compute how fast each joint turns between frames, in degrees a second `[shape=(T - 1, J)]`."""
    return np.degrees(rotation.angle_between(motion.rotations[:-1], motion.rotations[1:])) * motion.fps


def _torn_frames(path: Path, motion: Motion, recorded_turns: Callable[[], Mapping[str, float]]) -> list[str]:
    """List the joints that turn faster than a body can and than the recordings do, with the worst frame of each."""
    turns = turns_per_second(motion)
    if not turns.size or turns.max() <= LARGEST_TURN_DEGREES_PER_SECOND:
        return []
    recorded = recorded_turns()
    found = []
    for joint, frame in enumerate(turns.argmax(axis=0)):
        name, turn = motion.skeleton.names[joint], turns[frame, joint]
        limit = max(LARGEST_TURN_DEGREES_PER_SECOND, MOST_TIMES_RECORDED * recorded.get(name, 0.0))
        if turn > limit:
            found.append(f"{path}: frame {frame + 1}: {name} turns {turn:.0f} degrees/s, more than {limit:.0f}")
    return found


def _still_stretches(
    path: Path, motion: Motion, speaking: Callable[[], np.ndarray | None]
) -> tuple[list[str], list[str]]:
    """List stretches of over a second in which no channel changes: those while the speech goes on, and the others."""
    turns = np.degrees(rotation.angle_between(motion.rotations[:-1], motion.rotations[1:]))
    moves = np.abs(np.diff(motion.positions, axis=0))
    still = (turns < STILL_DEGREES).all(axis=1) & (moves < STILL_DISTANCE).all(axis=(1, 2))
    stretches = [(a, b) for a, b in runs(still).tolist() if b - a > STILL_SECONDS * motion.fps]
    spoken = speaking() if stretches else None
    problems, warnings = [], []
    for start, end in stretches:
        line = f"{path}: frames {start} to {end}: no motion for {(end - start) / motion.fps:.1f} s"
        seconds = 0.0 if spoken is None else float(spoken[start:end].sum()) / motion.fps
        if seconds > STILL_WHILE_SPEAKING_SECONDS:
            problems.append(f"{line}, in {seconds:.1f} s of which the speech goes on")
        else:
            warnings.append(line)
    return problems, warnings

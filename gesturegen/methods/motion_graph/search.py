"""Gesture motion graphs (Zhao et al. 2023, §4): the published search, piece by piece, or the optimal one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gesturegen.control import hands, schedule
from gesturegen.data import keynodes
from gesturegen.data.clips import Speech
from gesturegen.methods.motion_graph import beam, global_search
from gesturegen.methods.motion_graph.fallback import StopNodes
from gesturegen.methods.motion_graph.graph import MotionGraph
from gesturegen.methods.motion_graph.start_nodes import StartNodes, feature_distances, graph_features, speech_features
from gesturegen.methods.motion_graph.termination import targets
from gesturegen.path import Path, Piece, Target, Track
from gesturegen.settings.models import Config


def search(
    graph: MotionGraph, speech: Speech, config: Config, rng: np.random.Generator, earlier: Sequence[Path] = ()
) -> Path:
    """Find a path of graph nodes for a whole test speech (§4.2), by the search that the config names.

    earlier : other variants of this clip: the global search prices what they show, the beam search counts their
    key nodes as used
    """
    path = _search(graph, speech, config, rng, earlier)
    return replace(path, notes=_notes(path, graph, speech, config))


def _notes(path: Path, graph: MotionGraph, speech: Speech, config: Config) -> tuple[str, ...]:
    """List what a user should know of a clip beyond its figures."""
    notes, pieces = [], path.tracks[0].pieces
    wanted = keynodes.of_speech(speech, config.keywords.words or {}).keywords
    lacking = ", ".join(sorted(set(wanted.tolist()) - set(graph.key_nodes.keywords.tolist())))
    if config.search == "global":
        if lacking and config.global_search.lambda_keyword > 0:
            notes.append(f"keywords that its references lack, so nothing is shown for them: {lacking}")
        hands_of = ", ".join(
            sorted(set(hands.names(config.hands, graph.joint_names, graph.hand_names)) - set(graph.joint_names))
        )
        if hands_of and config.global_search.lambda_beat > 0:
            notes.append(
                f"no beats of the hands, because control.left or control.right is none of its joints: {hands_of}"
            )
        return tuple(notes)
    if lacking and config.termination.fallbacks:
        notes.append(f"keywords that its references lack, so those pieces end at onsets: {lacking}")
    repeats = sum(piece.fallback == "repeat" for piece in pieces)
    if repeats:
        notes.append(f"{repeats} of {len(pieces)} pieces hold one pose, because no path fits; give longer references")
    return tuple(notes)


def _search(
    graph: MotionGraph, speech: Speech, config: Config, rng: np.random.Generator, earlier: Sequence[Path]
) -> Path:
    if config.search == "global":
        used = np.zeros(graph.n_nodes)
        for path in earlier:
            used[path.tracks[0].nodes] += config.global_search.lambda_variant
        demands, control = _control(graph, speech, config)
        result = global_search.search(graph, speech, config, used, control)
        objective = {"first": result.first, "final": result.final}
        return Path((Track(result.pieces),), objective=objective, demands=demands)
    key_nodes = keynodes.of_speech(speech, config.keywords.words or {})
    cuts = targets(key_nodes, speech.n_frames)
    wanted = speech_features(key_nodes, np.array([cut.start_frame for cut in cuts]), speech.n_frames, config.features)
    return _search_by_pieces(graph, cuts, wanted, config, rng, earlier)


def _control(graph: MotionGraph, speech: Speech, config: Config) -> tuple:
    """Collect what is demanded of the hands, and the prices of frames that show otherwise; None where nothing is."""
    if not config.control.conditions:
        return (), None
    values = hands.of_nodes(graph, config.hands)
    demands = schedule.demands(config.control, speech.name, speech.n_frames, speech.fps, values)
    if not demands:
        return (), None
    states, sets = schedule.states(demands, speech.n_frames)
    prices = schedule.frame_prices(sets, demands, values, config.control.forbidden)
    # Hands that are held do not move, however fast they were: else the search would hold a fast frame.
    still = {key: np.zeros_like(row) if key[0] == "speed" else row for key, row in values.items()}
    held = schedule.frame_prices(sets, demands, still, config.control.forbidden)
    return demands, (states, prices, np.maximum(held - prices, 0.0))


def _search_by_pieces(
    graph: MotionGraph, cuts: Sequence[Target], wanted: np.ndarray, config: Config, rng: np.random.Generator,
    earlier: Sequence[Path],
) -> Path:  # fmt: skip
    """Run the beam search (§4.2.1) from piece to piece; `wanted` are the features at their starts.

    Each piece starts from the children of the previous winner's last node; the first one, one after a
    winner without children and every retry start from key nodes by feature distance.
    """
    pieces: list[Piece] = []
    candidates = graph_features(graph, config.features)
    occurrences = np.zeros(len(graph.key_nodes))
    for shown in (shown for path in earlier for shown in path.tracks[0].pieces):
        occurrences += np.isin(graph.key_nodes.frames, shown.nodes)
    for target, feature in zip(cuts, wanted, strict=True):
        distances = feature_distances(feature, candidates, occurrences, config.features)
        piece = _search_piece(graph, target, pieces[-1] if pieces else None, distances, config, rng)
        if piece is None:
            return Path((Track(tuple(pieces)),), failure=target)
        if piece.fallback != "repeat":  # a held pose is no accepted path
            occurrences += np.isin(graph.key_nodes.frames, piece.nodes)
        pieces.append(piece)
    return Path((Track(tuple(pieces)),))


def _search_piece(
    graph: MotionGraph,
    target: Target,
    previous: Piece | None,
    distances: np.ndarray,
    config: Config,
    rng: np.random.Generator,
) -> Piece | None:
    stop_nodes = StopNodes(graph, target.keyword, config.termination, rng)
    start_nodes = StartNodes(graph, distances, config, rng)
    last = int(previous.nodes[-1]) if previous else -1
    children = graph.children(last) if previous else np.zeros(0, dtype=np.int64)
    for retry in range(stop_nodes.last_retry + 1):
        stops = stop_nodes.for_attempt(retry)
        if retry == 0 and len(children):
            natural = int(graph.successors[last])
            nodes, cost = beam.search(graph, stops, children, target.length, config.beam, natural)
        else:
            nodes, cost = beam.search(graph, stops, start_nodes.next(), target.length, config.beam)
        if nodes is not None:
            return Piece(target, nodes, cost, retry, stop_nodes.fallback)
    if not config.termination.fallbacks:
        return None
    held = last if previous else start_nodes.best
    return Piece(target, np.full(target.length, held), 0.0, stop_nodes.last_retry, "repeat")

"""Rewards for frames where the speech and the recorded motion agree: beats, onsets, keywords and phrases.

The question answered: which node of a graph goes well with which frame of a test speech? Each reward is a product of
a gain, a curve over the speech, and a worth, a curve over the nodes. Worths of beats, onsets and phrases are taken
minus their mean, so that a busy reference earns nothing by being busy.

Motion beats are minima of the hands' speed after a stroke (as in §3.3 of Ao et al. 2022, Rhythmic Gesticulator, and in
the measures of BEAT), weighted by how far the speed fell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from gesturegen.control import hands
from gesturegen.data import keynodes
from gesturegen.data.clips import Speech
from gesturegen.errors import DataError
from gesturegen.methods.motion_graph.graph import MotionGraph
from gesturegen.settings.models import Config
from gesturegen.speech.pauses import phrase_ends

# Curves over time are sums of bells of this width, in frames of 30 a second; they end where they are below 1 %.
KERNEL_SECONDS = 1.0 / 30.0
_TRUNCATE = 3.0
# Hands are smoothed by so much before their beats are looked for; a beat stands out by at least so much.
SMOOTHING_SECONDS, LEAST_PROMINENCE = 0.05, 5.0
# An onset or beat counts at most so many times the mean one.
_MOST_WEIGHT = 2.0
LARGEST_LAG_SECONDS = 0.5


@dataclass(frozen=True, eq=False)
class Reward:
    """A reward, of which node n in frame t earns gain[t] * worth[n].

    name : of the term; gain : float [shape=(T,)]; worth : float [shape=(N,)], weight included
    """

    name: str
    gain: np.ndarray
    worth: np.ndarray


def find(graph: MotionGraph, speech: Speech, config: Config) -> tuple[Reward, ...]:
    """Find all rewards whose weight is not 0 and that can be earned at all."""
    settings, fps = config.global_search, graph.fps
    onsets = bells(speech.onset_frames, _onset_weights(speech), speech.n_frames, fps)
    rewards = []
    if settings.lambda_beat > 0 and (beats := _beats(graph, config)) is not None:
        worth = bells(beats[0] - settings.beat_lag_seconds * fps, beats[1], graph.n_nodes, fps)
        rewards.append(Reward("beat", onsets, settings.lambda_beat * _centred(worth)))
    if settings.lambda_onset > 0:
        nodes = graph.key_nodes.frames[graph.key_nodes.kinds == keynodes.ONSET]
        worth = bells(nodes, np.ones(len(nodes)), graph.n_nodes, fps)
        rewards.append(Reward("onset", onsets, settings.lambda_onset * _centred(worth)))
    if settings.lambda_phrase > 0:
        gain = bells(_phrase_frames(speech, config), None, speech.n_frames, fps)
        worth = bells(graph.phrase_ends, None, graph.n_nodes, fps)
        rewards.append(Reward("phrase", gain, settings.lambda_phrase * _centred(worth)))
    if settings.lambda_keyword > 0:
        rewards += _keyword_rewards(graph, speech, config)
    return tuple(reward for reward in rewards if reward.gain.any() and reward.worth.any())


def _keyword_rewards(graph: MotionGraph, speech: Speech, config: Config) -> list[Reward]:
    spoken = keynodes.of_speech(speech, config.keywords.words or {})
    found = []
    for word in sorted(set(spoken.keywords.tolist()) - {""}):
        nodes = graph.key_nodes.frames[graph.key_nodes.keywords == word]
        gain = bells(spoken.frames[spoken.keywords == word], None, speech.n_frames, graph.fps)
        worth = bells(nodes, None, graph.n_nodes, graph.fps)
        found.append(Reward("keyword", gain, config.global_search.lambda_keyword * worth))
    return found


def bells(places: np.ndarray, weights: np.ndarray | None, count: int, fps: float) -> np.ndarray:
    """Compute a curve `[shape=(count,)]` with a bell of height 1, or of its weight, at each of `places`, in frames."""
    curve = np.zeros(count)
    frames = np.round(np.asarray(places)).astype(np.int64)
    inside = (frames >= 0) & (frames < count)
    np.add.at(curve, frames[inside], 1.0 if weights is None else np.asarray(weights)[inside])
    sigma = KERNEL_SECONDS * fps
    # The filter keeps sums; a bell keeps its height.
    impulse = np.zeros(2 * int(np.ceil(_TRUNCATE * sigma)) + 1)
    impulse[len(impulse) // 2] = 1.0
    height = gaussian_filter1d(impulse, sigma, mode="constant", truncate=_TRUNCATE).max()
    return gaussian_filter1d(curve, sigma, mode="constant", truncate=_TRUNCATE) / height


def _centred(worth: np.ndarray) -> np.ndarray:
    return worth - worth.mean()


def _onset_weights(speech: Speech) -> np.ndarray:
    """Compute the strengths `[shape=(K,)]` of the onset frames over their mean, at most 2."""
    frames = speech.onset_frames
    if speech.onset_strengths is None or not len(frames):
        return np.ones(len(frames))
    strengths = np.zeros(speech.n_frames + 1)
    places = np.clip(np.round(speech.onset_times * speech.fps).astype(int), 0, speech.n_frames)
    np.maximum.at(strengths, places, speech.onset_strengths)
    found = strengths[frames]
    return np.minimum(found / max(found.mean(), 1e-9), _MOST_WEIGHT)


def _phrase_frames(speech: Speech, config: Config) -> np.ndarray:
    return np.round(phrase_ends(speech.words, config.phrases, speech.voice) * speech.fps).astype(np.int64)


def _beats(graph: MotionGraph, config: Config) -> tuple[np.ndarray, np.ndarray] | None:
    """Find the motion beats of the nodes, and their weights; None where no hands are known."""
    try:
        speeds = hands.of_nodes(graph, config.hands)
    except DataError:
        return None
    return motion_beats(np.maximum(speeds["speed", "left"], speeds["speed", "right"]), graph.segment_starts, graph.fps)


def motion_beats(speeds: np.ndarray, segment_starts: np.ndarray, fps: float) -> tuple[np.ndarray, np.ndarray]:
    """Find minima of the speed of the faster hand, and their weights: prominence over its mean, at most 2.

    speeds : `[shape=(N,)]`, cm/s; minima at the border of a segment do not count
    """
    minima_of_parts, prominences = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    for part in np.split(np.arange(len(speeds)), np.asarray(segment_starts)[1:]):
        smooth = gaussian_filter1d(speeds[part], SMOOTHING_SECONDS * fps)
        minima, found = find_peaks(-smooth, prominence=LEAST_PROMINENCE)
        minima_of_parts.append(part[minima])
        prominences.append(found["prominences"])
    nodes, weights = np.concatenate(minima_of_parts), np.concatenate(prominences)
    return nodes, np.minimum(weights / weights.mean(), _MOST_WEIGHT) if len(weights) else weights


def measure_beat_lag(graph: MotionGraph, config: Config) -> tuple[float, float] | None:
    """Measure by how many seconds a reference's motion beats follow its onsets, and how sure that is.

    The lag is that of the highest correlation between the curves of beats and onsets, up to half a second either way;
    how sure is how far that one stands above the others, in standard deviations of these. None where there is nothing
    to compare.
    """
    beats = _beats(graph, config)
    onsets = graph.key_nodes.frames[graph.key_nodes.kinds == keynodes.ONSET]
    if beats is None or len(beats[0]) < 2 or len(onsets) < 2:
        return None
    heard = bells(onsets, None, graph.n_nodes, graph.fps)
    moved = bells(beats[0], beats[1], graph.n_nodes, graph.fps)
    lags = np.arange(-round(2 * LARGEST_LAG_SECONDS * graph.fps), round(2 * LARGEST_LAG_SECONDS * graph.fps) + 1)
    heard, moved = _centred(heard), _centred(moved)
    scores = np.array([np.dot(heard, np.roll(moved, -lag)) for lag in lags])
    near = np.abs(lags) <= round(LARGEST_LAG_SECONDS * graph.fps)
    best = np.flatnonzero(near)[scores[near].argmax()]
    others = np.delete(scores, best)
    spread = others.std()
    return float(lags[best] / graph.fps), float((scores[best] - others.mean()) / spread) if spread > 0 else 0.0

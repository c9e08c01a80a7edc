"""The plan of the hands: rest, preparation, stroke, hold, retraction, timed by the stressed syllables."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gesturegen.demo import shapes
from gesturegen.demo.curves import Move
from gesturegen.demo.shapes import Shape
from gesturegen.demo.speaker import Speaker
from gesturegen.demo.speech import Script

# Strokes stay in this box before the body, centimetres outward, up and forward from the chest joint.
_NEAREST = np.array([3.0, -42.0, 22.0])
_FARTHEST = np.array([40.0, 13.0, 46.0])
_SECONDS_PER_CM = 0.01  # no move is faster than this on average
_REST_SPREAD = np.array([1.5, 1.5, 1.5, 0.1, 0.05, *[0.08] * 5])
_NO_ARC = np.zeros(10)


@dataclass(frozen=True)
class Stroke:
    """A stroke that is fastest at `time` (seconds): its hands ("r", "l" or "rl") and the syllable's stress."""

    time: float
    hands: str
    stress: float


@dataclass
class HandPlan:
    """The moves of one hand, in order, from `base`; `at` is where the last one ends and `free` when."""

    base: np.ndarray
    at: np.ndarray
    free: float = 0.0
    moves: list[Move] = field(default_factory=list)

    def go(self, start: float, end: float, target: np.ndarray, arc: np.ndarray = _NO_ARC) -> None:
        """Add a move from `start` to `end` seconds to `target`, bulging by `arc` (both `[shape=(10,)]`)."""
        self.moves.append(Move(start, end, target, arc))
        self.at, self.free = target, end


@dataclass(frozen=True)
class Beat:
    """A stressed syllable that a stroke may fall on, and its keyword if it is one."""

    time: float
    stress: float
    keyword: str | None


def plan_gestures(
    rng: np.random.Generator, speaker: Speaker, script: Script
) -> tuple[dict[str, HandPlan], list[Stroke]]:
    """Plan the moves of both hands over the clip, starting at rest, and list the strokes among them."""
    rest = _rest_poses(rng, speaker)
    hands = {side: HandPlan(rest[side], rest[side]) for side in "rl"}
    strokes: list[Stroke] = []
    for (_, begin), (end, _) in zip(script.rests[:-1], script.rests[1:], strict=True):
        beats = _choose_beats(rng, script, begin, end)
        for hand in hands.values():
            # The hands leave their rest shortly before the first word, not in the middle of the pause.
            hand.free = max(hand.free, begin - 0.4)
        for number, beat in enumerate(beats):
            until = beats[number + 1].time if number + 1 < len(beats) else None
            strokes.append(_make_stroke(rng, speaker, hands, beat, until))
        rest = _rest_poses(rng, speaker)
        for side, hand in hands.items():
            if beats:
                start = max(hand.free + 0.05, min(end - 0.5, hand.free + 0.6))
                hand.go(start, start + rng.uniform(0.65, 0.85), rest[side])
    return hands, strokes


def _rest_poses(rng: np.random.Generator, speaker: Speaker) -> dict[str, np.ndarray]:
    """Choose where the hands rest this time: mostly the speaker's habit, now and then the other way."""
    folded = speaker.folded == (rng.random() < 0.75)
    poses = {}
    for side in "rl":
        pose = (shapes.FOLDED if folded else shapes.HANGING) + rng.normal(0.0, 1.0, 10) * _REST_SPREAD
        if folded and side == "l":
            # One hand lies over the other.
            pose[:3] += (0.0, -3.5, 4.0)
        poses[side] = pose
    return poses


def _choose_beats(rng: np.random.Generator, script: Script, begin: float, end: float) -> list[Beat]:
    """Choose stressed syllables of a stretch of speech, at least about half a second apart; keywords come first."""
    found: list[Beat] = []
    for word in script.words:
        if not begin <= word.start < end or not word.syllables:
            continue
        strongest = max(word.syllables, key=lambda syllable: syllable.stress)
        keyword = word.text if word.text in shapes.KEYWORDS else None
        if strongest.stress >= 0.2 or keyword:
            found.append(Beat(strongest.vowel_start, max(strongest.stress, 0.5 if keyword else 0.0), keyword))
    chosen: list[Beat] = []
    for beat in found:
        apart = beat.time - chosen[-1].time if chosen else np.inf
        if apart >= rng.uniform(0.5, 0.7):
            chosen.append(beat)
        elif not chosen[-1].keyword and (beat.keyword or beat.stress > chosen[-1].stress + 0.25):
            chosen[-1] = beat
    return chosen


def _make_stroke(
    rng: np.random.Generator,
    speaker: Speaker,
    hands: dict[str, HandPlan],
    beat: Beat,
    until: float | None,
) -> Stroke:
    """Prepare and make one stroke with one hand or both; the other hand comes along a little."""
    amplitude = speaker.amplitude * (0.8 + 0.7 * beat.stress)
    lead = "r" if rng.random() < speaker.right_share else "l"
    named = beat.keyword is not None
    shape = shapes.free_shape(rng, amplitude) if beat.keyword is None else shapes.keyword_shape(beat.keyword, lead)
    both = shape.both or (not named and rng.random() < speaker.both_share)
    other = "l" if lead == "r" else "r"
    length = float(np.clip(rng.normal(0.46, 0.06), 0.34, 0.6))
    _stroke_hand(rng, hands[lead], shape, beat.time, length, 1.0, named)
    if both:
        _stroke_hand(
            rng, hands[other], shape, beat.time + rng.uniform(-0.02, 0.05), length, rng.uniform(0.75, 1.0), named
        )
    else:
        _stroke_hand(
            rng, hands[other], shape, beat.time + rng.uniform(0.0, 0.08), length + 0.1, rng.uniform(0.3, 0.6), named
        )
    for hand in hands.values():
        if until is not None and until - hand.free > 0.9:
            _relax(rng, hand)
    return Stroke(beat.time, "rl" if both else lead, beat.stress)


def _stroke_hand(
    rng: np.random.Generator, hand: HandPlan, shape: Shape, time: float, length: float, share: float, named: bool
) -> None:
    """Plan one hand's preparation, stroke and after-strokes; `share` below 1 draws the shape towards NEUTRAL.

    named : the shape belongs to a keyword and is not to be altered
    """
    points = [_hand_vector(rng, point, shape.fingers, share) for point in shape.points]
    start = time - 0.5 * length
    # The slow ends of neighbouring moves may overlap.
    room = start - hand.free + 0.1
    if room > 0.27:
        prepare = min(room, rng.uniform(0.6, 0.9))
        # A far preparation in little time stops short rather than dash.
        distance = float(np.linalg.norm((points[0] - hand.at)[:3]))
        points[0] = hand.at + min(1.0, prepare / (_SECONDS_PER_CM * distance + 1e-6)) * (points[0] - hand.at)
        arc = np.concatenate([rng.normal((0.0, 1.5, 1.5), 1.0), np.zeros(7)])
        hand.go(start - prepare, start, points[0], arc)
    else:
        # No time to prepare: the hand strokes from where it is, to and fro about the neutral place.
        start = max(start, hand.free - 0.12)
        across = (points[1] - points[0])[:3]
        if not named:
            ahead, behind = hand.at[:3] + across, hand.at[:3] - across
            nearer = min(ahead, behind, key=lambda place: np.linalg.norm(place - shapes.NEUTRAL[:3]))
            points[1][:3] = np.clip(nearer, _NEAREST, _FARTHEST)
        elif np.linalg.norm((points[1] - hand.at)[:3]) < 8.0 * share:
            points[1] = points[0]
    distance = float(np.linalg.norm((points[1] - hand.at)[:3]))
    arc = np.concatenate([rng.normal(0.0, 1.2, 3), np.zeros(7)])
    hand.go(start, max(time + 0.5 * length, start + 0.3, start + _SECONDS_PER_CM * distance), points[1], arc)
    for point in points[2:]:
        hand.go(hand.free - 0.06, hand.free + 0.28, point)
    # Recoil: a stroke springs back a little before the hold.
    back = hand.at.copy()
    back[:3] += 0.14 * (points[0] - points[1])[:3] + rng.normal(0.0, 0.6, 3)
    free = hand.free
    hand.go(free - 0.05, free + 0.22, back)
    hand.free = free


def _relax(rng: np.random.Generator, hand: HandPlan) -> None:
    """Let a hand sink half-way towards the neutral place after a hold."""
    start = hand.free + rng.uniform(0.0, 0.2)
    target = 0.4 * hand.at + 0.6 * shapes.NEUTRAL
    target[1] -= rng.uniform(0.0, 4.0)
    hand.go(start, start + rng.uniform(0.5, 0.7), target)


def _hand_vector(
    rng: np.random.Generator, point: tuple[float, float, float, float], fingers: tuple[float, ...], share: float
) -> np.ndarray:
    """Make a hand vector `[shape=(10,)]` of a way point, a little off the mark, inside the gesture space."""
    vector = np.array([*point, 0.0, *fingers])
    vector[:3] += rng.normal(0.0, 1.3, 3)
    vector[3:5] += rng.normal(0.0, 0.08, 2)
    vector = share * vector + (1.0 - share) * shapes.NEUTRAL
    vector[:3] = np.clip(vector[:3], _NEAREST, _FARTHEST)
    return vector

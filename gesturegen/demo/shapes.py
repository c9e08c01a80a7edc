"""Gesture shapes: the way points of the hands in a stroke, as numbers.

A hand is a vector of 10: x outward, y up, z forward in cm from the chest joint (`b_spine3`), the forearm's roll
(negative: palm up) and the wrist's bend in radians, and the curl of the thumb and four fingers in radians
per joint. Outward is to the hand's own side, so one table serves both hands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RELAXED = (0.10, 0.22, 0.30, 0.36, 0.40)
OPEN = (0.00, 0.04, 0.06, 0.10, 0.12)
POINT = (0.35, 0.02, 1.00, 1.10, 1.10)
TWO = (0.45, 0.02, 0.05, 1.05, 1.10)
THREE = (0.45, 0.02, 0.05, 0.08, 1.00)
GRIP = (0.40, 0.80, 0.85, 0.90, 0.90)
PINCH = (0.35, 0.55, 0.30, 0.28, 0.28)

HANGING = np.array([23.0, -46.5, 9.0, 0.15, 0.05, *RELAXED])
FOLDED = np.array([8.0, -37.0, 23.5, 0.45, 0.10, *RELAXED])
NEUTRAL = np.array([18.0, -27.0, 30.0, 0.10, -0.05, *RELAXED])


@dataclass(frozen=True)
class Shape:
    """The shape of a stroke: the hand's way points (x, y, z, roll), the fingers, and whether both hands make it.

    The first way point ends the preparation; the stroke goes to the second, and on to any others.
    """

    points: tuple[tuple[float, float, float, float], ...]
    fingers: tuple[float, ...] = OPEN
    both: bool = False


_WAVE = Shape(((24, 6, 26, 0.0), (33, 10, 27, -0.5), (22, 11, 27, 0.3), (33, 10, 27, -0.4)))
_COUNT = ((17, -14, 30, -0.7), (18, -4, 34, -0.9))
_BURST = Shape(((9, -24, 30, 0.2), (30, 2, 30, -0.8)), OPEN, True)

# Every keyword has a shape of its own, as the right hand makes it; a left hand mirrors it.
KEYWORDS: dict[str, Shape] = {
    **dict.fromkeys(("hey", "hi", "hello"), _WAVE),
    **dict.fromkeys(("one", "first"), Shape(_COUNT, POINT)),
    **dict.fromkeys(("two", "second"), Shape(_COUNT, TWO)),
    **dict.fromkeys(("three", "third"), Shape(_COUNT, THREE)),
    "north": Shape(((15, -22, 28, 0.0), (17, 8, 36, -0.2)), POINT),
    "south": Shape(((15, -14, 30, 0.3), (16, -38, 33, 0.7)), POINT),
    "east": Shape(((10, -18, 30, 0.2), (40, -12, 22, -0.2)), POINT),
    "west": Shape(((30, -18, 28, 0.2), (1, -14, 36, 0.6)), POINT),
    "back": Shape(((19, -18, 32, -0.3), (30, 0, 14, -0.9)), GRIP),
    "front": Shape(((14, -20, 24, 0.3), (14, -14, 45, 0.2)), OPEN),
    "away": Shape(((8, -22, 28, 0.5), (36, -8, 32, -0.2)), OPEN),
    "here": Shape(((15, -16, 32, 0.5), (13, -36, 32, 0.9)), POINT),
    "around": Shape(((10, -22, 28, 0.3), (26, -12, 36, 0.0), (28, -30, 30, -0.2), (10, -26, 28, 0.3)), POINT),
    **dict.fromkeys(("crazy", "incredible", "surprising"), _BURST),
    "walk": Shape(((14, -30, 26, 0.4), (14, -24, 36, 0.4), (14, -32, 28, 0.4)), RELAXED),
    "drive": Shape(((14, -20, 34, 0.2), (18, -26, 34, 0.4), (12, -14, 35, 0.1)), GRIP, True),
    "ride": Shape(((12, -22, 28, 0.6), (14, -26, 40, 0.6)), GRIP, True),
    "enter": Shape(((20, -18, 25, -0.3), (10, -24, 42, 0.6)), OPEN),
    "open": Shape(((5, -24, 34, 0.5), (28, -22, 30, -0.7)), OPEN, True),
    "attach": Shape(((24, -22, 30, 0.1), (5, -22, 34, 0.3)), PINCH, True),
    "take": Shape(((18, -18, 44, -0.5), (14, -26, 26, -0.3)), GRIP),
    "move": Shape(((8, -24, 34, 0.3), (30, -24, 32, 0.2)), OPEN),
    "more": Shape(((8, -30, 30, 0.2), (27, -14, 32, -0.6)), OPEN, True),
    "less": Shape(((22, -12, 32, 0.2), (12, -30, 32, 0.7)), OPEN, True),
    "much": Shape(((12, -26, 30, -0.2), (34, -18, 30, -0.5)), OPEN, True),
    "few": Shape(((14, -22, 32, 0.1), (10, -14, 34, -0.2)), PINCH),
    "called": Shape(((16, -16, 32, 0.0), (16, -8, 36, -0.2)), TWO, True),
}


def keyword_shape(word: str, hand: str) -> Shape:
    """Return the shape of a keyword for hand "r" or "l": mirrored, but east stays to the speaker's right."""
    if hand == "l":
        word = {"east": "west", "west": "east"}.get(word, word)
    return KEYWORDS[word]


def free_shape(rng: np.random.Generator, amplitude: float) -> Shape:
    """Draw the shape of a stroke without a meaning: a beat, sweep, raise, push or circle somewhere before the body."""
    x, y, z = np.array([18.0, -25.0, 31.0]) + rng.normal(0.0, (5.0, 7.5, 3.5))
    size = amplitude * rng.uniform(0.9, 1.6)
    roll = rng.normal(-0.1, 0.35)
    kind = rng.choice(["beat", "sweep", "inward", "raise", "push", "circle"], p=[0.36, 0.2, 0.1, 0.12, 0.14, 0.08])
    half = {
        "beat": (1.0, -9.0, 2.0),
        "sweep": (12.0, -1.0, -1.0),
        "inward": (-9.0, -3.0, 2.0),
        "raise": (3.0, 9.0, 2.0),
        "push": (1.0, 2.0, 9.0),
        "circle": (8.0, 5.0, 2.0),
    }[str(kind)]
    turn = {"sweep": -0.35, "inward": 0.3, "raise": -0.3}.get(str(kind), 0.1)
    dx, dy, dz = (size * (part + rng.normal(0.0, 1.5)) for part in half)
    points = [(x - dx, y - dy, z - dz, roll - turn), (x + dx, y + dy, z + dz, roll + turn)]
    if kind == "circle":
        points.append((x + 0.3 * dx, y - dy, z + dz, roll))
    fingers = OPEN if rng.random() < 0.6 else RELAXED
    return Shape(tuple(points), fingers, both=False)

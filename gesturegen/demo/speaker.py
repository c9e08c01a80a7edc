"""The demo's speakers: the sound of each voice and the style of its gestures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SPEAKERS = 6


@dataclass(frozen=True)
class Speaker:
    """The voice and the gesture style of one speaker.

    number : 1 to SPEAKERS, as in metadata.csv
    pitch : mean f0 in Hz; tract : formant scale, above 1 for a shorter vocal tract; rate : speech rate, 1 is usual
    amplitude : gesture size, 1 is usual; right_share : share of one-handed gestures made by the right hand
    both_share : share of gestures made by both hands; folded : hands rest before the belly, else hang
    """

    number: int
    pitch: float
    tract: float
    rate: float
    amplitude: float
    right_share: float
    both_share: float
    folded: bool


def speaker(number: int, seed: int) -> Speaker:
    """Draw speaker `number` of the dataset made with `seed`; the result does not depend on any clip."""
    rng = np.random.default_rng([seed, 9, number])
    high = number % 2 == 0
    return Speaker(
        number=number,
        pitch=float(rng.uniform(185.0, 225.0) if high else rng.uniform(100.0, 135.0)),
        tract=float(rng.uniform(1.08, 1.18) if high else rng.uniform(0.95, 1.05)),
        rate=float(rng.uniform(0.95, 1.06)),
        amplitude=float(rng.uniform(1.1, 1.45)),
        right_share=0.25 if number % 3 == 0 else 0.85,
        both_share=float(rng.uniform(0.45, 0.7)),
        folded=number % 4 >= 2,
    )

"""Channels of a sound file: their mix, or one of them, and a check that the mix does not cancel the voice.

The question answered: is the mean of all channels the speaker's voice? It is not where each channel has a speaker of
its own, and it is next to silence where the channels are the same with opposite signs, as of a balanced cable.
"""

from __future__ import annotations

import numpy as np

from gesturegen.errors import DataError

# Loudness is compared over stretches of so many seconds.
_STRETCH_SECONDS = 0.05
# A mix of unrelated channels has the n-th part of their power; with less than a quarter of that they cancel out.
_CANCELLING = 0.25
# Channels whose loudness goes up and down together correlate by 0.9 and more, two speakers by less than 0.
_DIFFERENT = 0.4
# dB between the loudest and the quietest channel.
_UNEQUAL_DB = 20.0
_SIDES = {"left": 1, "right": 2}


class Mixer:
    """A reduction of blocks of several channels to one, with statistics of the channels on the way.

    channel : `mix`, `left`, `right` or a number from 1; a file with one channel is taken as it is with the first three
    """

    def __init__(self, path: str, n_channels: int, rate: int, channel: str | int = "mix"):
        self.n_channels, self.channel = n_channels, channel
        number: int | None
        if isinstance(channel, int):
            number = channel
        else:
            number = None if channel == "mix" or n_channels == 1 else _SIDES[channel]
        if number is not None and number > n_channels:
            raise DataError(
                f"{path}: {n_channels} channel{'s'[: n_channels > 1]}, audio.channel says {channel}; set it to mix or to a lower number"
            )
        self._place = None if number is None else number - 1
        self._length = max(round(_STRETCH_SECONDS * rate), 1)
        self._rest = np.zeros((0, n_channels), dtype=np.float32)
        self._powers: list[np.ndarray] = []
        self._mixed = 0.0

    def add(self, block: np.ndarray) -> np.ndarray:
        """Return one channel `[shape=(n,)]` of a block `[shape=(n, channels)]`, float32."""
        mono = block.mean(axis=1, dtype=np.float32) if self._place is None else block[:, self._place].copy()
        if self._place is None and self.n_channels > 1:
            self._mixed += float(np.sum(np.square(mono, dtype=np.float64)))
            joined = np.concatenate([self._rest, block])
            whole = len(joined) // self._length * self._length
            stretches = np.square(joined[:whole], dtype=np.float64).reshape(-1, self._length, self.n_channels)
            self._powers.append(stretches.sum(axis=1))
            self._rest = joined[whole:].copy()
        return mono

    def notes(self, name: str) -> list[str]:
        """Describe what is odd about the channels of a file called `name`, in one line at most."""
        if not self._powers:
            return []
        last = np.square(self._rest, dtype=np.float64).sum(axis=0)
        powers = np.concatenate([*self._powers, last[None]])
        sums = powers.sum(axis=0)
        if not sums.max() > 0:
            return []
        cure = "set audio.channel to the speaker's (left, right or a number)"
        if self._mixed < _CANCELLING / self.n_channels * sums.mean():
            return [f"{name}: its {self.n_channels} channels cancel each other out when they are mixed; {cure}"]
        decibels = 10 * np.log10(np.maximum(sums, 1e-12 * sums.max()) / sums.max())
        quiet = int(np.argmin(decibels))
        if decibels[quiet] < -_UNEQUAL_DB:
            loud = int(np.argmax(decibels))
            return [
                f"{name}: channel {quiet + 1} is {-decibels[quiet]:.0f} dB below channel {loud + 1}, and all are mixed; {cure}"
            ]
        if len(powers) > 2:
            loudness = np.sqrt(powers)
            varying = np.ptp(loudness, axis=0) > 0
            if varying.all() and (lowest := float(np.corrcoef(loudness.T).min())) < _DIFFERENT:
                return [
                    f"{name}: its channels differ (loudness correlates by {lowest:.2f}), perhaps a speaker each, and all "
                    f"are mixed; {cure}"
                ]
        return []

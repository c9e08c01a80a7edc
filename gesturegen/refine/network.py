"""The two networks of the refiner: a generator that corrects gestures, and a critic that tells them from real ones.

Habibie et al. 2022, section 3.2. Both take audio `[shape=(B, A, T)]` and gestures `[shape=(B, C, T)]` of any T.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

# Widths of the four levels of the generator and of the three of the critic, two blocks each.
_GENERATOR_WIDTHS = (128, 256, 256, 512)
_CRITIC_WIDTHS = (512, 256, 128)
# Both halve the sequence three times.
_MULTIPLE = 8
# The text does not say. With kernels of 3 a correction already depends on 67 frames to either side, more than a
# window of 64, and what the critic averages are views of some 35 frames; kernels of 5 take 5 / 3 of the work.
_KERNEL = 3
_LEAK = 0.2


class Generator(nn.Module):
    """A 1D U-Net: eight blocks down to an eighth of the frames, eight back up, added to its input.

    The text has the network put out the gesture itself. Here it puts out a correction that is added to the k-NN's
    gesture: a plain U-Net spends its first thousands of steps on learning to copy, and what it has not learned to
    copy yet shakes the hands.
    """

    def __init__(self, audio_channels: int, gesture_channels: int):
        super().__init__()
        self.down = nn.ModuleList()
        width = audio_channels + gesture_channels
        for level in _GENERATOR_WIDTHS:
            self.down.append(nn.Sequential(_block(width, level), _block(level, level)))
            width = level
        self.up = nn.ModuleList([nn.Sequential(_block(width, width), _block(width, width))])
        for level in reversed(_GENERATOR_WIDTHS[1:-1]):
            self.up.append(nn.Sequential(_block(width + level, level), _block(level, level)))
            width = level
        level = _GENERATOR_WIDTHS[0]
        self.up.append(nn.Sequential(_block(width + level, level), _convolution(level, gesture_channels)))

    def forward(self, audio: Tensor, gesture: Tensor) -> Tensor:
        """Correct gestures `[shape=(B, C, T)]` for audio `[shape=(B, A, T)]`."""
        frames = gesture.shape[-1]
        x = _whole(torch.cat([audio, gesture], dim=1))
        passed = []
        for level, blocks in enumerate(self.down):
            if level:
                x = functional.max_pool1d(x, 2)
            x = blocks(x)
            passed.append(x)
        passed.pop()
        x = self.up[0](x)
        for blocks in self.up[1:]:
            x = functional.interpolate(x, scale_factor=2, mode="nearest")
            x = blocks(torch.cat([x, passed.pop()], dim=1))
        return gesture + x[..., :frames]


class Critic(nn.Module):
    """A network of six blocks that scores each sequence `[shape=(B,)]`: higher for more real speech and gesture.

    The last layer looks at the mean over time, so that a sequence may have any length.

    The text has instance norm in every block: each channel of each sequence with mean 0 and variance 1 over time.
    Then nothing of how much two channels move together is left in a mean over time: on sequences of which four
    sounds move every channel, such a critic tells real from fake no better after 400 steps than before, and with a
    last layer over all frames it learns its training windows by heart. Here the statistics are of a sequence's
    channels together, which is what Gulrajani et al. 2017 advise with their penalty: the same critic tells them
    apart within 100 steps, on held-out windows too. `as_printed` gives the text's.
    """

    def __init__(self, audio_channels: int, gesture_channels: int, as_printed: bool = False):
        super().__init__()
        layers: list[nn.Module] = []
        width = audio_channels + gesture_channels
        for level in _CRITIC_WIDTHS:
            for _ in range(2):
                norm = nn.InstanceNorm1d(level) if as_printed else nn.GroupNorm(1, level)
                layers += [nn.Conv1d(width, level, _KERNEL, padding="same"), norm, nn.LeakyReLU(_LEAK)]
                width = level
            layers.append(nn.AvgPool1d(2))
        self.blocks = nn.Sequential(*layers)
        self.last = nn.Linear(width, 1)

    def forward(self, audio: Tensor, gesture: Tensor) -> Tensor:
        """Score gestures `[shape=(B, C, T)]` with audio `[shape=(B, A, T)]`."""
        x = self.blocks(_whole(torch.cat([audio, gesture], dim=1)))
        return self.last(x.mean(dim=-1))[:, 0]


def _convolution(before: int, after: int) -> nn.Conv1d:
    """Make a convolution over time that keeps the number of frames."""
    # The edge repeated: a whole recording is corrected in one pass, where most frames are far from any edge.
    return nn.Conv1d(before, after, _KERNEL, padding="same", padding_mode="replicate")


def _block(before: int, after: int) -> nn.Sequential:
    """Make a convolution with batch norm and ReLU."""
    return nn.Sequential(_convolution(before, after), nn.BatchNorm1d(after), nn.ReLU())


def _whole(x: Tensor) -> Tensor:
    """Pad a sequence with its last frame to a multiple of eight frames."""
    missing = -x.shape[-1] % _MULTIPLE
    return functional.pad(x, (0, missing), mode="replicate") if missing else x

"""The 3D networks: one that a CPU trains in minutes, and one of the published size.

Both take any cubic grid whose edge is a multiple of :attr:`STRIDE`, where something is inside, and
a few numbers about each object as a whole. They give one channel for each output at the same
resolution, 0 in the air.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, TypeVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

__all__ = ["STRIDE", "CpuNet", "FullNet", "Size", "backbone", "count_parameters"]

Size = Literal["cpu", "full"]
Layer = TypeVar("Layer", nn.Conv3d, nn.Linear)
STRIDE = 8
"""How much coarser the coarsest level of either network is than its input."""
GROUPS = 8

Volume = Float[Tensor, "batch inputs x y z"]
Answer = Float[Tensor, "batch outputs x y z"]
Inside = Bool[Tensor, "batch x y z"]
Told = Float[Tensor, "batch told"]


def backbone(size: Size, inputs: int, told: int, outputs: int) -> nn.Module:
    """Return a fresh network; its weights are drawn from torch's generator."""
    return (CpuNet if size == "cpu" else FullNet)(inputs, told, outputs)


def count_parameters(network: nn.Module) -> int:
    """Count the trainable numbers of a network."""
    return sum(weight.numel() for weight in network.parameters() if weight.requires_grad)


class Residual(nn.Module):
    """Two convolutions beside a shortcut; the second starts at zero, so that the block passes on.

    Parameters
    ----------
    inputs, outputs
        Channels.
    activation
        Between normalisation and convolution.
    """

    def __init__(self, inputs: int, outputs: int, activation: nn.Module) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.GroupNorm(GROUPS, inputs),
            activation,
            nn.Conv3d(inputs, outputs, 3, padding=1),
            nn.GroupNorm(GROUPS, outputs),
            activation,
            _zeroed(nn.Conv3d(outputs, outputs, 3, padding=1)),
        )
        same = inputs == outputs
        self.shortcut = nn.Identity() if same else nn.Conv3d(inputs, outputs, 1)

    def forward(self, volume: Volume) -> Answer:
        """Give the same grid with other channels."""
        out: Tensor = self.shortcut(volume) + self.body(volume)
        return out


class CpuNet(nn.Module):
    """U-Net with 16, 32 and 64 channels that works at half the resolution.

    A 2³ convolution of stride 2 halves the grid, and one residual block stands at each level. The
    outputs are made at full resolution, from the U-Net's features and the inputs themselves, by a
    perceptron that runs over the voxels inside alone: objects fill a small part of their cube.

    Parameters
    ----------
    inputs, told, outputs
        Channels, numbers about an object, channels.
    widths
        Channels of the levels, finest first; multiples of 8.
    hidden
        Width of the perceptron.
    """

    def __init__(
        self,
        inputs: int,
        told: int,
        outputs: int,
        widths: Sequence[int] = (16, 32, 64),
        hidden: int = 64,
    ) -> None:
        super().__init__()
        steps = list(pairwise(widths))
        self.stem = nn.Conv3d(inputs, widths[0], 2, stride=2)
        self.tell = nn.Linear(told, widths[0])
        self.down_blocks = nn.ModuleList(Residual(w, w, nn.SiLU()) for w in widths)
        self.downs = nn.ModuleList(nn.Conv3d(a, b, 2, stride=2) for a, b in steps)
        self.ups = nn.ModuleList(_up(b, a, 1) for a, b in steps)
        self.up_blocks = nn.ModuleList(Residual(a, a, nn.SiLU()) for a, _ in steps)
        self.unstem = nn.ConvTranspose3d(widths[0], 16, 2, stride=2)
        self.head = nn.Sequential(
            nn.Linear(16 + inputs + told, hidden),
            nn.SiLU(),
            nn.Linear(hidden, hidden),
            nn.SiLU(),
            _zeroed(nn.Linear(hidden, outputs)),
        )

    def forward(self, volume: Volume, inside: Inside, told: Told) -> Answer:
        """Give one channel for each output."""
        finest = self.down_blocks[0](self.stem(volume) + self.tell(told)[..., None, None, None])
        levels = [finest]
        for down, block in zip(self.downs, self.down_blocks[1:], strict=True):
            levels.append(block(down(levels[-1])))
        out = levels.pop()
        for up, block in zip(reversed(self.ups), reversed(self.up_blocks), strict=True):
            out = block(up(out) + levels.pop())
        seen = [grid.movedim(1, -1)[inside] for grid in (self.unstem(out), volume)]
        known = told.repeat_interleave(inside.sum((1, 2, 3)), dim=0)
        values: Tensor = self.head(torch.cat([*seen, known], dim=1))
        answer = values.new_zeros(*inside.shape, values.shape[-1])
        answer[inside] = values
        return answer.movedim(-1, 1)


class FullNet(nn.Module):
    """Pixie's architecture: a projector to 32 channels, here of 1³, and a U-Net of base width 64.

    Levels of 64, 64, 128 and 256 channels, three residual blocks at each on the way down and four
    on the way up, attention at the bottom only. Group normalisation stands where the original has
    layer normalisation over the grid, which would fix the resolution (arXiv 2508.17437).

    Parameters
    ----------
    inputs, told, outputs
        Channels, numbers about an object, channels.
    base, multipliers
        Channels of the finest level, and those of each level over it.
    """

    def __init__(
        self,
        inputs: int,
        told: int,
        outputs: int,
        base: int = 64,
        multipliers: Sequence[int] = (1, 1, 2, 4),
    ) -> None:
        super().__init__()
        widths = [base * multiplier for multiplier in multipliers]
        self.projector = _projector(inputs, 32)
        self.stem = nn.Conv3d(32, base, 3, padding=1)
        self.tell = nn.Linear(told, base)
        self.down, skips = _way_down(base, widths)
        bottom = widths[-1]
        self.middle = nn.Sequential(
            _block(bottom, bottom), Attention(bottom), _block(bottom, bottom)
        )
        self.up = _way_up(widths, skips)
        self.head = nn.Sequential(
            nn.GroupNorm(GROUPS, base),
            nn.LeakyReLU(0.02),
            _zeroed(nn.Conv3d(base, outputs, 3, padding=1)),
        )

    def forward(self, volume: Volume, inside: Inside, told: Told) -> Answer:
        """Give one channel for each output."""
        out = self.stem(self.projector(volume)) + self.tell(told)[..., None, None, None]
        skips = [out]
        for block in self.down:
            out = block(out)
            skips.append(out)
        out = self.middle(out)
        for block in self.up:
            out = block(torch.cat([out, skips.pop()], dim=1))
        answer: Tensor = self.head(out) * inside[:, None]
        return answer


class Attention(nn.Module):
    """Every voxel looks at every other; for the few of the coarsest level."""

    def __init__(self, width: int, heads: int = 4) -> None:
        super().__init__()
        self.norm = nn.GroupNorm(GROUPS, width)
        self.attention = nn.MultiheadAttention(width, heads, batch_first=True)

    def forward(self, volume: Volume) -> Volume:
        """Add what attention finds."""
        tokens = self.norm(volume).flatten(2).transpose(1, 2)
        found, _ = self.attention(tokens, tokens, tokens, need_weights=False)
        out: Tensor = volume + found.transpose(1, 2).reshape(volume.shape)
        return out


def _projector(inputs: int, outputs: int, width: int = 128) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv3d(inputs, width, 1),
        nn.GroupNorm(32, width),
        nn.SiLU(),
        nn.Conv3d(width, width, 1),
        nn.GroupNorm(32, width),
        nn.SiLU(),
        nn.Conv3d(width, outputs, 1),
        nn.GroupNorm(GROUPS, outputs),
    )


def _way_down(base: int, widths: Sequence[int], blocks: int = 3) -> tuple[nn.ModuleList, list[int]]:
    """Blocks and halvings in order, and the channels of every skip, the stem's first."""
    modules, skips = nn.ModuleList(), [base]
    for level, width in enumerate(widths):
        for _ in range(blocks):
            modules.append(_block(skips[-1], width))
            skips.append(width)
        if level + 1 < len(widths):
            modules.append(nn.Conv3d(width, width, 3, stride=2, padding=1))
            skips.append(width)
    return modules, skips


def _way_up(widths: Sequence[int], skips: Sequence[int], blocks: int = 4) -> nn.ModuleList:
    """Blocks in order, each fed with one skip; the last of a level doubles the grid."""
    modules, left, width = nn.ModuleList(), list(skips), widths[-1]
    for level in reversed(range(len(widths))):
        for number in range(blocks):
            block = _block(width + left.pop(), widths[level])
            width = widths[level]
            last = number + 1 == blocks and level > 0
            modules.append(nn.Sequential(block, _up(width, width, 3)) if last else block)
    return modules


def _block(inputs: int, outputs: int) -> Residual:
    return Residual(inputs, outputs, nn.LeakyReLU(0.02))


def _up(inputs: int, outputs: int, kernel: int) -> nn.Sequential:
    """Nearest voxels, doubled; a 1³ convolution goes first, where it costs an eighth."""
    convolution = nn.Conv3d(inputs, outputs, kernel, padding=kernel // 2)
    doubled = nn.Upsample(scale_factor=2)
    return nn.Sequential(*([convolution, doubled] if kernel == 1 else [doubled, convolution]))


def _zeroed(layer: Layer) -> Layer:
    nn.init.zeros_(layer.weight)
    assert layer.bias is not None
    nn.init.zeros_(layer.bias)
    return layer

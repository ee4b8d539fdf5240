"""The network: a picture in, for each block of four by four pixels the material it shows."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from huggingface_hub import PyTorchModelHubMixin
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

__all__ = ["STRIDE", "PixelNetwork", "as_input"]

STRIDE = 4
"""Rows and columns of pixels for each of the network's answers."""
COARSEST = 32
"""A picture's edges are padded to a multiple of this many pixels."""
WIDTHS = (32, 48, 64, 96)
"""Features at a quarter of the picture's resolution, and at each half of it from there."""
GROUPS = 8


class _Block(nn.Module):
    """Two 3×3 convolutions, and past them a way of their own."""

    def __init__(self, seen: int, width: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(seen, width, 3, padding=1)
        self.second = nn.Conv2d(width, width, 3, padding=1)
        self.norms = nn.ModuleList([nn.GroupNorm(GROUPS, width), nn.GroupNorm(GROUPS, width)])
        self.past = nn.Conv2d(seen, width, 1) if seen != width else nn.Identity()

    def forward(self, seen: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k h w"]:
        inner = functional.silu(self.norms[0](self.first(seen)))
        inner = self.norms[1](self.second(inner))
        return functional.silu(inner + self.past(seen))


class PixelNetwork(nn.Module, PyTorchModelHubMixin):
    """A 2D U-Net (Ronneberger et al., MICCAI 2015) that begins at a quarter of the resolution.

    Parameters
    ----------
    materials
        Names of what it tells apart.
    """

    def __init__(self, *, materials: Sequence[str]) -> None:
        super().__init__()
        self.materials = tuple(materials)
        half = WIDTHS[0] // 2
        self.stem = nn.Sequential(
            nn.Conv2d(4, half, 5, stride=2, padding=2),
            nn.SiLU(),
            nn.Conv2d(half, half, 3, padding=1),
            nn.SiLU(),
            nn.Conv2d(half, WIDTHS[0], 3, stride=2, padding=1),
            nn.SiLU(),
        )
        self.down = nn.ModuleList([_Block(width, width) for width in WIDTHS])
        self.shrink = nn.ModuleList(
            [nn.Conv2d(*pair, 3, stride=2, padding=1) for pair in pairwise(WIDTHS)]
        )
        self.up = nn.ModuleList([_Block(fine + coarse, fine) for fine, coarse in pairwise(WIDTHS)])
        self.head = nn.Conv2d(WIDTHS[0], len(self.materials), 1)

    def forward(
        self, pictures: Float[Tensor, "batch 4 rows columns"]
    ) -> Float[Tensor, "batch materials down across"]:
        """Give logits of the material of each block of pixels, for edges that 32 divides.

        Parameters
        ----------
        pictures
            See :func:`as_input`.
        """
        seen = self.stem(pictures)
        levels: list[Tensor] = []
        for index, block in enumerate(self.down):
            seen = block(seen)
            if index < len(self.shrink):
                levels.append(seen)
                seen = self.shrink[index](seen)
        for block, fine in zip(reversed(self.up), reversed(levels), strict=True):
            wider = functional.interpolate(seen, scale_factor=2, mode="nearest")
            seen = block(torch.cat([fine, wider], dim=1))
        logits: Tensor = self.head(seen)
        return logits


def as_input(
    colors: Float[Tensor, "batch rows columns 3"], masks: Float[Tensor, "batch rows columns"]
) -> Float[Tensor, "batch 4 up across"]:
    """Colours from -1 to 1, 0 off the object, and the mask; edges padded to a multiple of 32.

    Parameters
    ----------
    colors
        From 0 to 1.
    masks
        1 on the object.
    """
    inside = masks[:, None]
    seen = torch.cat([(2 * colors.movedim(-1, 1) - 1) * inside, inside], dim=1)
    rows, columns = masks.shape[1:]
    return functional.pad(seen, (0, -columns % COARSEST, 0, -rows % COARSEST))

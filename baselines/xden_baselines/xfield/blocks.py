"""Blocks of the network."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from xden_baselines.xfield.planes import grid_means, grid_samples

__all__ = ["FiLM", "Head", "PointVoxel", "Pyramid", "TokenBlock", "Unscaled", "ViewEncoder"]

GROUPS: Final = 8
STEM: Final = 4
"""How much coarser the encoder's finest map is than the image."""
FILM_HIDDEN: Final = 64
USUAL_LOG_CM: Final = 1.5
"""Logarithm of half the edge of a usual cube in cm."""


class PointVoxel(nn.Module):
    """Point-voxel convolution: neighbours on a coarse grid, detail by each point's own perceptron.

    PVCNN (Liu et al., NeurIPS 2019): scatter-mean to voxels, two 3³ convolutions, read back between
    voxels.

    Parameters
    ----------
    inputs, outputs
        Channels.
    grid
        Voxels along the cube's edge.
    """

    def __init__(self, inputs: int, outputs: int, grid: int) -> None:
        super().__init__()
        self.grid = grid
        self.voxels = nn.Sequential(
            nn.Conv3d(inputs, outputs, 3, padding=1),
            nn.GroupNorm(GROUPS, outputs),
            nn.SiLU(),
            nn.Conv3d(outputs, outputs, 3, padding=1),
            nn.GroupNorm(GROUPS, outputs),
            nn.SiLU(),
        )
        self.point = nn.Sequential(nn.Linear(inputs, outputs), nn.LayerNorm(outputs), nn.SiLU())

    def forward(
        self,
        features: Float[Tensor, "batch points inputs"],
        places: Float[Tensor, "batch points 3"],
    ) -> Float[Tensor, "batch points outputs"]:
        """Give each point other features."""
        grid = self.voxels(grid_means(features, places, self.grid))
        out: Tensor = grid_samples(grid, places) + self.point(features)
        return out


class FiLM(nn.Module):
    """Feature-wise modulation by the physical scale (Perez et al., AAAI 2018); at first identity.

    Parameters
    ----------
    channels
        Of the features.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        last = nn.Linear(FILM_HIDDEN, 2 * channels)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.network = nn.Sequential(nn.Linear(1, FILM_HIDDEN), nn.SiLU(), last)

    def forward(
        self,
        features: Float[Tensor, "batch views channels *places"],
        half_cm: Float[Tensor, "batch"],
    ) -> Float[Tensor, "batch views channels *places"]:
        """Scale and shift each channel."""
        told = self.network(half_cm.log()[:, None] - USUAL_LOG_CM)
        gain, offset = told.view(len(told), 1, -1, *[1] * (features.ndim - 3)).chunk(2, dim=2)
        out: Tensor = features * (1 + gain) + offset
        return out


class Unscaled(nn.Module):
    """In place of :class:`FiLM`, to see what that is worth: tells nothing."""

    def forward(
        self,
        features: Float[Tensor, "batch views channels *places"],
        half_cm: Float[Tensor, "batch"],
    ) -> Float[Tensor, "batch views channels *places"]:
        """Return the features."""
        return features


class ChannelNorm(nn.LayerNorm):
    """Layer normalisation over the channels of images."""

    def forward(self, images: Float[Tensor, "n channels rows columns"]) -> Tensor:
        """Normalise."""
        normal: Tensor = super().forward(images.movedim(1, -1))
        return normal.movedim(-1, 1)


class ViewBlock(nn.Module):
    """Residual block: 7² depthwise convolution, then a perceptron on each pixel (ConvNeXt)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(width, width, 7, padding=3, groups=width),
            ChannelNorm(width),
            nn.Conv2d(width, 4 * width, 1),
            nn.GELU(),
            nn.Conv2d(4 * width, width, 1),
        )

    def forward(self, images: Float[Tensor, "n channels rows columns"]) -> Tensor:
        """Add what is found."""
        out: Tensor = images + self.body(images)
        return out


class ViewEncoder(nn.Module):
    """Encoder of radiographs.

    Parameters
    ----------
    inputs
        Channels of the images.
    widths
        Channels of the stages, finest first: the first has a quarter of the image's resolution, and
        each other half of that of the one before.
    """

    def __init__(self, inputs: int, widths: Sequence[int]) -> None:
        super().__init__()
        self.stem = nn.Sequential(
            nn.Conv2d(inputs, widths[0], STEM, stride=STEM), ChannelNorm(widths[0])
        )
        self.stages = nn.ModuleList(
            nn.Sequential(ViewBlock(width), ViewBlock(width)) for width in widths
        )
        self.downs = nn.ModuleList(
            nn.Sequential(ChannelNorm(a), nn.Conv2d(a, b, 2, stride=2)) for a, b in pairwise(widths)
        )

    def forward(
        self, images: Float[Tensor, "n inputs rows columns"]
    ) -> list[Float[Tensor, "n _ _ _"]]:
        """Return what each stage gives."""
        levels: list[Tensor] = [self.stages[0](self.stem(images))]
        for down, stage in zip(self.downs, self.stages[1:], strict=True):
            levels.append(stage(down(levels[-1])))
        return levels


class Pyramid(nn.Module):
    """All stages of an encoder, added up at the resolution and with the channels of the first.

    Parameters
    ----------
    widths
        Channels of the stages.
    """

    def __init__(self, widths: Sequence[int]) -> None:
        super().__init__()
        self.lateral = nn.ModuleList(nn.Conv2d(width, widths[0], 1) for width in widths)

    def forward(
        self, levels: Sequence[Float[Tensor, "n _ _ _"]]
    ) -> Float[Tensor, "n channels rows columns"]:
        """Return one map."""
        size = levels[0].shape[-2:]
        same = [
            functional.interpolate(lateral(level), size, mode="bilinear")
            for lateral, level in zip(self.lateral, levels, strict=True)
        ]
        return torch.stack(same).sum(dim=0)


class TokenBlock(nn.Module):
    """Transformer layer, normalised first; with a context, it looks at that too.

    Parameters
    ----------
    width, heads
        Of the tokens.
    context
        Width of the context's tokens; 0 = none.
    """

    def __init__(self, width: int, heads: int, context: int = 0) -> None:
        super().__init__()
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(3 if context else 2))
        self.attention = nn.MultiheadAttention(width, heads, batch_first=True)
        self.cross = (
            nn.MultiheadAttention(width, heads, kdim=context, vdim=context, batch_first=True)
            if context
            else None
        )
        self.perceptron = nn.Sequential(
            nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width)
        )

    def forward(
        self,
        tokens: Float[Tensor, "batch tokens width"],
        context: Float[Tensor, "batch others context"] | None = None,
    ) -> Float[Tensor, "batch tokens width"]:
        """Give each token another value."""
        own = self.norms[0](tokens)
        tokens = tokens + self.attention(own, own, own, need_weights=False)[0]
        if self.cross is not None:
            asked = self.norms[1](tokens)
            tokens = tokens + self.cross(asked, context, context, need_weights=False)[0]
        out: Tensor = tokens + self.perceptron(self.norms[-1](tokens))
        return out


class Head(nn.Sequential):
    """Perceptron of two hidden layers that runs over points."""

    def __init__(self, inputs: int, hidden: int, outputs: int) -> None:
        super().__init__(
            nn.Linear(inputs, hidden),
            nn.GELU(),
            nn.Linear(hidden, hidden),
            nn.GELU(),
            nn.Linear(hidden, outputs),
        )

"""Planes through the cube, in the order xy, yz, xz, and grids in it.

A plane (channels, R, R) has its first axis as rows: texel (i, j) of xy is centred at
x = (2 i + 1) / R - 1, y = (2 j + 1) / R - 1.
"""

from __future__ import annotations

from typing import Final

import torch
from jaxtyping import Float, Int64
from torch import Tensor
from torch.nn import functional

from xden_baselines.xfield.rays import sampled

__all__ = ["PLANES", "grid_means", "grid_samples", "plane_means", "plane_samples"]

PLANES: Final = ((0, 1), (1, 2), (0, 2))
"""Axes of the cube along the rows and the columns of each plane."""

Places = Float[Tensor, "batch points 3"]
Features = Float[Tensor, "batch points channels"]


def plane_means(
    features: Features, places: Places, size: int
) -> Float[Tensor, "batch 3 channels rows columns"]:
    """Mean of the features of the points in each texel; 0 where there is none."""
    texels = _cells(places, size)
    means = [
        _means(features, texels[..., row] * size + texels[..., column], size**2)
        for row, column in PLANES
    ]
    return torch.stack(means, dim=1).reshape(len(places), len(PLANES), -1, size, size)


def plane_samples(
    planes: Float[Tensor, "batch 3 channels rows columns"], places: Places
) -> Features:
    """Sum of what three planes hold where a point lies."""
    axes = [sampled(planes[:, i], places[..., [c, r]]) for i, (r, c) in enumerate(PLANES)]
    return axes[0] + axes[1] + axes[2]


def grid_means(
    features: Features, places: Places, size: int
) -> Float[Tensor, "batch channels x y z"]:
    """Mean of the features of the points in each voxel; 0 where there is none."""
    x, y, z = _cells(places, size).unbind(-1)
    means = _means(features, (x * size + y) * size + z, size**3)
    return means.reshape(len(places), -1, size, size, size)


def grid_samples(grid: Float[Tensor, "batch channels x y z"], places: Places) -> Features:
    """Values of a grid between its voxels, at the edge the edge's."""
    at = places.flip(-1)[:, None, None]
    found = functional.grid_sample(grid, at, padding_mode="border", align_corners=False)
    return found[:, :, 0, 0].transpose(1, 2)


def _cells(places: Places, size: int) -> Int64[Tensor, "batch points 3"]:
    return ((places + 1) * (size / 2)).floor().long().clamp(0, size - 1)


def _means(
    features: Features, cells: Int64[Tensor, "batch points"], count: int
) -> Float[Tensor, "batch channels cells"]:
    """Scatter-mean; in float32, since a sum in bf16 no longer grows by a 256th of itself."""
    batch, _, channels = features.shape
    features = features.float()
    ones = torch.cat([features, torch.ones_like(features[..., :1])], dim=-1)
    sums = features.new_zeros(batch, count, channels + 1)
    sums.scatter_add_(1, cells[..., None].expand_as(ones), ones)
    return (sums[..., :-1] / sums[..., -1:].clamp(min=1)).transpose(1, 2)

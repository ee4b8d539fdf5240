"""Predicting with a trained network."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from xden1k.values.arrays import Grid
from xden1k.values.types import FIELD_SIZE
from xden_baselines.learning.clock import torch_threads
from xden_baselines.pixie.channels import ENVELOPE, Channels
from xden_baselines.pixie.model import VoxelModel
from xden_baselines.pixie.store import at_resolution

__all__ = ["predicted_g_cm3"]


def predicted_g_cm3(
    model: VoxelModel, channels: Channels, category: str, threads: int, device: str
) -> Grid:
    """Density of what is inside the outer surface, on the field grid.

    Parameters
    ----------
    model
        Trained.
    channels
        Shape (channels, 64, 64, 64).
    category
        Its name.
    threads, device
        Of torch.

    Returns
    -------
    array
        Shape (64, 64, 64) float32; to be multiplied by the envelope's share of each voxel.
    """
    coarse = torch.from_numpy(at_resolution(channels, model.resolution))[None].to(device)
    inside = coarse[:, ENVELOPE] > 0
    with torch_threads(threads), torch.inference_mode():
        density = model(coarse, inside, *model.told_of(category)).density_g_cm3
        grid: Grid = _refined(density, inside.float()).cpu().numpy()[0]
    return grid


def _refined(
    density_g_cm3: Float[Tensor, "batch u v w"], inside: Float[Tensor, "batch u v w"]
) -> Float[Tensor, "batch x y z"]:
    """Interpolate between the voxels that hold some of the object, as if there were no others."""
    pair = torch.stack([density_g_cm3 * inside, inside], dim=1)
    size = (FIELD_SIZE,) * 3
    value, weight = functional.interpolate(pair, size, mode="trilinear").unbind(dim=1)
    return value / weight.clamp(min=1e-6)

"""Batches of training objects, and what a network is asked to get right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor
from torch.nn import functional

from xden_baselines.pixie.categories import Kind
from xden_baselines.pixie.channels import VECTORS
from xden_baselines.pixie.model import Outputs
from xden_baselines.pixie.scaling import LogScale
from xden_baselines.pixie.store import UNKNOWN_FAMILY, Stored

__all__ = ["DENSITY_WEIGHT", "Batch", "density_mae_g_cm3", "gathered", "loss", "turned"]

DENSITY_WEIGHT = 2.0
"""Of the density's absolute error in g/cm³, beside the other terms' 1."""
FAINTEST_G_CM3 = 1e-4

Voxels = Float[Tensor, "batch x y z"]


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Objects as dense grids, 0 in the air; see :class:`Stored` and :class:`Kind`."""

    channels: Float[Tensor, "batch channels x y z"]
    envelope: Voxels
    mean_g_cm3: Voxels
    solid: Voxels
    stuff_g_cm3: Voxels
    family: Int64[Tensor, "batch x y z"]
    category: Int64[Tensor, "batch"]
    usual: Float[Tensor, "batch told"]

    @property
    def inside(self) -> Bool[Tensor, "batch x y z"]:
        """Voxels with a share in the envelope."""
        return self.envelope > 0

    @property
    def inputs(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """What a model is called with."""
        return self.channels, self.inside, self.category, self.usual

    def to(self, device: str) -> Batch:
        """Move to a device."""
        return Batch(*(getattr(self, name).to(device) for name in self.__slots__))


def gathered(objects: Sequence[Stored], kinds: Sequence[Kind], resolution: int) -> Batch:
    """Unpack objects into a batch."""
    edge = (resolution,) * 3

    def dense(values: Sequence[np.ndarray], fill: float = 0) -> Tensor:
        lead = values[0].shape[:-1]
        out = np.full((len(objects), *lead, resolution**3), fill, dtype=np.float32)
        for grid, one, value in zip(out, objects, values, strict=True):
            grid[..., one.voxels] = value
        return torch.from_numpy(out.reshape(len(objects), *lead, *edge))

    return Batch(
        channels=dense([one.channels for one in objects]),
        envelope=dense([one.envelope for one in objects]),
        mean_g_cm3=dense([one.mean_g_cm3 for one in objects]),
        solid=dense([one.solid for one in objects]),
        stuff_g_cm3=dense([one.stuff_g_cm3 for one in objects]),
        family=dense([one.family for one in objects], UNKNOWN_FAMILY).long(),
        category=torch.tensor([kind.index for kind in kinds]),
        usual=torch.from_numpy(np.array([kind.usual for kind in kinds])),
    )


def turned(batch: Batch, names: Sequence[str], order: Sequence[int], signs: Sequence[int]) -> Batch:
    """Turn the objects, with the directions that the channels hold.

    Parameters
    ----------
    batch
        Objects.
    names
        Of their channels.
    order
        Which axis becomes the first, the second and the third.
    signs
        -1 turns the new axis round, 1 does not.
    """
    round_ = [axis - 3 for axis in range(3) if signs[axis] < 0]

    def moved(grid: Tensor) -> Tensor:
        axes = [*range(grid.ndim - 3), *(axis - 3 for axis in order)]
        return grid.permute(axes).flip(round_)

    channels = moved(batch.channels)
    source, factors = list(range(len(names))), torch.ones(len(names), device=batch.envelope.device)
    for vector in VECTORS:
        at = [list(names).index(name) for name in vector]
        for axis, old in enumerate(order):
            source[at[axis]] = at[old]
            factors[at[axis]] = signs[axis]
    grids = ("envelope", "mean_g_cm3", "solid", "stuff_g_cm3", "family")
    return replace(
        batch,
        channels=channels[:, source] * factors.view(-1, 1, 1, 1),
        **{name: moved(getattr(batch, name)) for name in grids},
    )


def loss(outputs: Outputs, batch: Batch, scale: LogScale) -> Float[Tensor, ""]:
    """Sum of the terms, each a mean over an object's voxels, then over objects.

    Squared error of the scaled log density where there is material, cross-entropy of the empty
    share, ``DENSITY_WEIGHT`` times the density's absolute error in g/cm³, and the cross-entropy of
    the family where the network names one.
    """
    material = batch.envelope * batch.solid
    target = scale.scaled(batch.stuff_g_cm3.clamp(min=FAINTEST_G_CM3))
    void = functional.binary_cross_entropy_with_logits(
        outputs.void, 1 - batch.solid, reduction="none"
    )
    total = _mean((outputs.scaled - target).square(), material)
    total = total + _mean(void, batch.envelope)
    total = total + DENSITY_WEIGHT * density_mae_g_cm3(outputs.density_g_cm3, batch).mean()
    if outputs.families.shape[1]:
        named = material * (batch.family != UNKNOWN_FAMILY)
        guess = functional.cross_entropy(
            outputs.families, batch.family, ignore_index=UNKNOWN_FAMILY, reduction="none"
        )
        total = total + _mean(guess, named)
    return total


def density_mae_g_cm3(density_g_cm3: Voxels, batch: Batch) -> Float[Tensor, "batch"]:
    """Return the benchmark's density error of each object, at the batch's resolution."""
    # a voxel counts by its share, and its mean over the whole voxel is that share of the value
    weight = batch.envelope.square()
    error = ((density_g_cm3 - batch.mean_g_cm3).abs() * weight).sum((1, 2, 3))
    return error / batch.envelope.sum((1, 2, 3))


def _mean(values: Voxels, weight: Voxels) -> Float[Tensor, ""]:
    """Weighted mean of each object, then over objects; an object without weight counts 0."""
    sums = (values * weight).sum((1, 2, 3)) / weight.sum((1, 2, 3)).clamp(min=1e-6)
    return sums.mean()

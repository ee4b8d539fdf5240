"""What a network is asked to get right."""

from __future__ import annotations

from typing import Final

import torch
from jaxtyping import Float, Int64
from torch import Tensor
from torch.nn import functional

from xden_baselines.xfield.batches import Batch
from xden_baselines.xfield.network import UNIT_G_CM3, Field, Outputs, XField
from xden_baselines.xfield.rays import FLOOR

__all__ = ["contrastive_loss", "loss"]

TEMPERATURE: Final = 0.1
PARTS_WEIGHT: Final = 0.5
"""Of the contrastive loss, beside the density's 1."""
THIRD_WEIGHT: Final = 0.2
CONTRASTED: Final = 192
"""Points of each object between which parts are told apart: the cost grows with their square."""
NOTHING: Final = -1e4
"""A logarithm that no sum notices."""


def loss(model: XField, field: Field, outputs: Outputs, batch: Batch) -> Float[Tensor, ""]:
    """Sum of the terms that the variant has.

    Squared error of the density over ``UNIT_G_CM3``, as a mean over the volume; the contrastive
    loss of the parts, void being one; the squared error of the third radiograph.
    """
    total = outputs.embedding.new_zeros(())
    if model.variant.density:
        error = (outputs.density_g_cm3[..., 0] - batch.density_g_cm3) / UNIT_G_CM3
        total = total + (batch.weight * error.square()).mean()
    if model.variant.parts:
        some = slice(CONTRASTED)
        parts = contrastive_loss(outputs.embedding[:, some], batch.owner[:, some])
        total = total + PARTS_WEIGHT * parts
    if model.third is not None:
        wanted = batch.third.clamp(max=-torch.tensor(FLOOR).log().item()) / 3
        total = total + THIRD_WEIGHT * (model.third(field.shape).float() - wanted).square().mean()
    return total


def contrastive_loss(
    embedding: Float[Tensor, "batch points channels"], owner: Int64[Tensor, "batch points"]
) -> Float[Tensor, ""]:
    """Mean over pairs i, j of one part of softplus(log sum over others n of exp(s_in) - s_ij).

    s is the cosine over the temperature; each object counts alike. Without others, 0.
    """
    with torch.autocast(embedding.device.type, enabled=False):
        similarity = embedding @ embedding.mT / TEMPERATURE
    same = owner[:, :, None] == owner[:, None, :]
    others = similarity.masked_fill(same, NOTHING).logsumexp(dim=-1, keepdim=True)
    itself = torch.eye(same.shape[-1], dtype=torch.bool, device=same.device)
    pairs = (same & ~itself).float()
    terms = functional.softplus(others - similarity) * pairs
    return (terms.sum((1, 2)) / pairs.sum((1, 2)).clamp(min=1)).mean()

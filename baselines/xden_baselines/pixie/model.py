"""A network with all that its predictions depend on, as one checkpoint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from huggingface_hub import PyTorchModelHubMixin
from jaxtyping import Bool, Float, Int64
from torch import Tensor, nn

from xden_baselines.pixie.categories import USUAL
from xden_baselines.pixie.networks import Size, backbone, count_parameters
from xden_baselines.pixie.scaling import LogScale

__all__ = ["Outputs", "VoxelModel"]

CATEGORY_WIDTH, CATEGORY_DEVIATION = 16, 0.3
"""Numbers that are learned of each category, and their deviation at the start."""
EMPTY_SHARES = (0.02, 0.98)
"""The empty share that a category begins with lies between these."""

Voxels = Float[Tensor, "batch x y z"]


@dataclass(frozen=True, slots=True, eq=False)
class Outputs:
    """What a network says of each voxel.

    Parameters
    ----------
    scaled
        Shape (batch, x, y, z): log10 density of the stuff, -1 to 1 for most of the training split.
    void
        Shape (batch, x, y, z): logit of the share of the envelope that is empty.
    families
        Shape (batch, families, x, y, z): logits of the material's family; no family in the CPU
        size.
    density_g_cm3
        Shape (batch, x, y, z): mean over what is inside the outer surface, cavities included.
    """

    scaled: Voxels
    void: Voxels
    families: Float[Tensor, "batch families x y z"]
    density_g_cm3: Voxels


class VoxelModel(nn.Module, PyTorchModelHubMixin):
    """Channels of each voxel in, density out.

    ``save_pretrained`` writes ``model.safetensors`` and ``config.json``; ``from_pretrained`` reads
    them, from a folder or the Hub.

    Parameters
    ----------
    size
        ``cpu`` or ``full``.
    channels
        Names of the inputs.
    resolution
        Voxels along each edge of the grid it was trained on; 64 or a half, a quarter of it.
    log10_density
        What -1 and 1 stand for.
    families
        Names of the material families; empty for none.
    categories
        Names of the categories that it was trained on.
    """

    offset: Tensor
    gain: Tensor
    usual: Tensor

    def __init__(
        self,
        *,
        size: Size,
        channels: Sequence[str],
        resolution: int,
        log10_density: Sequence[float],
        families: Sequence[str] = (),
        categories: Sequence[str] = (),
    ) -> None:
        super().__init__()
        self.channels = tuple(channels)
        self.resolution = resolution
        self.families = tuple(families)
        self.categories = tuple(categories)
        self.scale = LogScale(*log10_density)
        self.register_buffer("offset", torch.zeros(len(channels)))
        self.register_buffer("gain", torch.ones(len(channels)))
        self.register_buffer("usual", torch.zeros(len(categories) + 1, len(USUAL)))
        self.embedding = nn.Embedding(len(categories) + 1, CATEGORY_WIDTH)
        nn.init.normal_(self.embedding.weight, std=CATEGORY_DEVIATION)
        told = len(USUAL) + CATEGORY_WIDTH
        self.network = backbone(size, len(channels), told, 2 + len(families))

    @property
    def summary(self) -> str:
        """What it is, in a few words."""
        millions = count_parameters(self) / 1e6
        return f"U-Net of {millions:.3g} million weights at {self.resolution}³"

    def normalise(self, offset: Float[Tensor, "channels"], gain: Float[Tensor, "channels"]) -> None:
        """Set what the network sees of each channel: (channel - offset) * gain, 0 in the air."""
        self.offset.copy_(offset)
        self.gain.copy_(gain)

    def told_of(self, category: str) -> tuple[Int64[Tensor, "1"], Float[Tensor, "1 told"]]:
        """Index of a category and what is usual in it, as :meth:`forward` takes them."""
        known = category in self.categories
        index = self.categories.index(category) if known else len(self.categories)
        return torch.tensor([index], device=self.usual.device), self.usual[[index]]

    def forward(
        self,
        channels: Float[Tensor, "batch channels x y z"],
        inside: Bool[Tensor, "batch x y z"],
        category: Int64[Tensor, "batch"],
        usual: Float[Tensor, "batch told"],
    ) -> Outputs:
        """Predict, beginning with what is usual in the category.

        Parameters
        ----------
        channels
            See :func:`xden_baselines.pixie.channels.channels`.
        inside
            Voxels with a share in the envelope.
        category
            Index of each object's category; their number where it is none of them.
        usual
            What is told of it: see :data:`xden_baselines.pixie.categories.USUAL`.
        """
        shape = (-1, 1, 1, 1)
        seen = (channels - self.offset.view(shape)) * self.gain.view(shape) * inside[:, None]
        told = torch.cat([usual, self.embedding(category)], dim=1)
        scaled, void, *families = self.network(seen, inside, told).float().unbind(dim=1)
        empty = usual[:, USUAL.index("empty_share")].clamp(*EMPTY_SHARES)
        material = self.scale.scaled_log10(usual[:, USUAL.index("log10_material")])
        scaled = scaled + material.view(shape)
        void = void + torch.logit(empty).view(shape)
        return Outputs(
            scaled=scaled,
            void=void,
            families=torch.stack(families, 1) if families else seen[:, :0],
            density_g_cm3=self.scale.density_g_cm3(scaled) * torch.sigmoid(-void),
        )

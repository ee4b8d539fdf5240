"""The network: one class for all variants and sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, get_args

import torch
from huggingface_hub import PyTorchModelHubMixin
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from xden1k.predictions import Target
from xden_baselines.pixie.networks import Residual, count_parameters
from xden_baselines.xfield.blocks import (
    FiLM,
    Head,
    PointVoxel,
    Pyramid,
    TokenBlock,
    Unscaled,
    ViewEncoder,
)
from xden_baselines.xfield.planes import (
    PLANES,
    grid_means,
    grid_samples,
    plane_means,
    plane_samples,
)
from xden_baselines.xfield.rays import (
    IMAGE_CHANNELS,
    RAY_CHANNELS,
    projected,
    ray_channels,
    sampled,
)
from xden_baselines.xfield.seen import VIEWS
from xden_baselines.xfield.sizes import SIZES, Size
from xden_baselines.xfield.variants import VARIANTS

__all__ = ["EMBEDDING", "FORMAT", "UNIT_G_CM3", "Field", "Inputs", "Outputs", "XField"]

FORMAT: Final = "xfield/1"
EMBEDDING: Final = 16
"""Numbers that say which part a point is of."""
UNIT_G_CM3: Final = 4.0
"""What an output of 1 stands for."""
POINT_CHANNELS: Final = 6


@dataclass(frozen=True, slots=True, eq=False)
class Inputs:
    """Objects as :class:`xden_baselines.xfield.seen.Seen` has them, in a batch."""

    surface: Float[Tensor, "batch n 6"]
    transmission: Float[Tensor, "batch views rows columns"]
    chord: Float[Tensor, "batch views rows columns"]
    projection: Float[Tensor, "batch views 3 4"]
    half_cm: Float[Tensor, "batch"]


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """What a network knows of objects before it is asked about points.

    Parameters
    ----------
    projection
        As the inputs have it.
    shape
        Planes, (batch, 3, channels, rows, columns), or a volume, (batch, channels, x, y, z).
    images
        What points are told of each view: some of its map, and its ray channels.
    """

    projection: Float[Tensor, "batch views 3 4"]
    shape: Tensor
    images: tuple[Float[Tensor, "batch views _ _ _"], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Outputs:
    """What a network says of points. A variant without one of the two has no channel of it.

    Parameters
    ----------
    density_g_cm3
        Shape (batch, points, 1 or 0); a little below 0 at times.
    embedding
        Shape (batch, points, 16 or 0), of length 1: near for points of one part.
    """

    density_g_cm3: Float[Tensor, "batch points _"]
    embedding: Float[Tensor, "batch points _"]


class XField(nn.Module, PyTorchModelHubMixin):
    """Outer surface and radiographs in, density and part embedding at any point out.

    ``save_pretrained`` writes ``model.safetensors`` and ``config.json``; ``from_pretrained`` reads
    them, from a folder or the Hub.

    Parameters
    ----------
    variant, size
        Names in :data:`VARIANTS` and :data:`SIZES`.
    target
        What the density is: ``density`` or ``apparent_density``.
    format, unit_g_cm3, views
        What a checkpoint was written with; nothing else can be loaded.

    Raises
    ------
    ValueError
        If a name is unknown, or the format, unit or views are others.
    """

    def __init__(
        self,
        *,
        variant: str,
        size: str,
        target: str = "density",
        format: str = FORMAT,
        unit_g_cm3: float = UNIT_G_CM3,
        views: Sequence[str] | None = VIEWS,
    ) -> None:
        super().__init__()
        _expect("variant", variant, VARIANTS)
        _expect("size", size, SIZES)
        _expect("target", target, get_args(Target))
        _expect("format", format, [FORMAT])
        _expect("unit_g_cm3", unit_g_cm3, [UNIT_G_CM3])
        _expect("views", list(views or ()), [list(VIEWS)])
        self.variant, self.size, self.target = VARIANTS[variant], SIZES[size], target
        what, how = self.variant, self.size
        self.backbone = Volume(how) if what.volume else Triplane(how, what.cross)
        self.view_encoder = ViewEncoder(IMAGE_CHANNELS, how.view_widths) if what.encodes else None
        self.told = ViewMap(how.view_widths, what.scaled) if what.pixel else None
        self.context = Context(how, what.scaled) if what.cross else None
        self.third = ThirdView(how.channels) if what.third else None
        told = what.pixel * how.view_widths[0] + what.rays * RAY_CHANNELS
        inputs = how.channels + 3 + len(VIEWS) * told
        self.head = Head(inputs, how.hidden, what.density + what.parts * EMBEDDING)

    @property
    def summary(self) -> str:
        """What it is, in a few words."""
        return f"{count_parameters(self) / 1e6:.3g} million weights"

    def forward(self, inputs: Inputs, places: Float[Tensor, "batch points 3"]) -> Outputs:
        """Look at objects and answer for points of each, in units of the cube."""
        return self.at(self.field(inputs), places)

    def field(self, inputs: Inputs) -> Field:
        """Look at objects."""
        rays = None
        if self.variant.xray:
            rays = ray_channels(inputs.transmission, inputs.chord, inputs.half_cm)
        maps, context = self._encoded(rays, inputs.half_cm)
        images = tuple(
            image
            for image, told in ((maps, self.variant.pixel), (rays, self.variant.rays))
            if told and image is not None
        )
        return Field(inputs.projection, self.backbone(inputs, rays, context), images)

    def at(self, field: Field, places: Float[Tensor, "batch points 3"]) -> Outputs:
        """Answer for points."""
        known = [self.backbone.samples(field.shape, places), places]
        known += seen_at(field.images, field.projection, places)
        out = self.head(torch.cat(known, dim=-1)).float()
        first = int(self.variant.density)
        embedding = functional.normalize(out[..., first:], dim=-1)
        return Outputs(out[..., :first] * UNIT_G_CM3, embedding)

    def _encoded(
        self, rays: Tensor | None, half_cm: Float[Tensor, "batch"]
    ) -> tuple[Tensor | None, Tensor | None]:
        """Return the map of each view, and the tokens of all views."""
        if self.view_encoder is None or rays is None:
            return None, None
        levels = [
            level.unflatten(0, rays.shape[:2])
            for level in self.view_encoder(rays[:, :, :IMAGE_CHANNELS].flatten(0, 1))
        ]
        maps = self.told(levels, half_cm) if self.told is not None else None
        context = self.context(levels[-1], half_cm) if self.context is not None else None
        return maps, context


class ViewMap(nn.Module):
    """What points are told of the encoded radiographs: one map of each view.

    Parameters
    ----------
    widths
        Channels of the encoder's stages.
    scaled
        Whether the maps are told the object's scale.
    """

    def __init__(self, widths: Sequence[int], scaled: bool) -> None:
        super().__init__()
        self.pyramid = Pyramid(widths)
        self.film = FiLM(widths[0]) if scaled else Unscaled()

    def forward(
        self, levels: Sequence[Float[Tensor, "batch views _ _ _"]], half_cm: Float[Tensor, "batch"]
    ) -> Float[Tensor, "batch views channels rows columns"]:
        """Give the maps, told of the object's scale."""
        views = levels[0].shape[:2]
        found = self.pyramid([level.flatten(0, 1) for level in levels]).unflatten(0, views)
        out: Tensor = self.film(found, half_cm)
        return out


class Context(nn.Module):
    """Tokens of the radiographs, told of which view they are and, if ``scaled``, of the scale."""

    def __init__(self, size: Size, scaled: bool) -> None:
        super().__init__()
        along = size.crop_px // 2 ** (len(size.view_widths) + 1)
        self.narrow = nn.Linear(size.view_widths[-1], size.context)
        self.film = FiLM(size.context) if scaled else Unscaled()
        self.place = nn.Parameter(0.02 * torch.randn(len(VIEWS), along**2, size.context))

    def forward(
        self, deepest: Float[Tensor, "batch views channels a b"], half_cm: Float[Tensor, "batch"]
    ) -> Float[Tensor, "batch tokens context"]:
        """Give the tokens of all views in a row."""
        tokens = self.narrow(deepest.flatten(3).transpose(2, 3))
        told = self.film(tokens.transpose(2, 3), half_cm).transpose(2, 3)
        out: Tensor = (told + self.place).flatten(1, 2)
        return out


class Triplane(nn.Module):
    """Surface points to three planes, by point-voxel convolutions and a transformer.

    Parameters
    ----------
    size
        How large.
    cross
        Whether tokens attend to those of the radiographs.
    """

    def __init__(self, size: Size, cross: bool) -> None:
        super().__init__()
        self.plane, patch = size.plane, size.plane // size.tokens
        widths = [POINT_CHANNELS, *size.point_widths]
        self.points = nn.ModuleList(
            PointVoxel(a, b, grid)
            for (a, b), grid in zip(pairwise(widths), size.point_grids, strict=True)
        )
        self.gathered = nn.Linear(sum(size.point_widths), size.channels)
        self.split = nn.Conv2d(size.channels, size.width, patch, stride=patch)
        self.place = nn.Parameter(0.02 * torch.randn(len(PLANES) * size.tokens**2, size.width))
        context = size.context if cross else 0
        self.blocks = nn.ModuleList(
            TokenBlock(size.width, size.heads, context) for _ in range(size.layers)
        )
        self.norm = nn.LayerNorm(size.width)
        self.joined = nn.ConvTranspose2d(size.width, size.channels, patch, stride=patch)
        self.texel = nn.Sequential(
            nn.Conv2d(size.channels, 2 * size.channels, 1),
            nn.GELU(),
            nn.Conv2d(2 * size.channels, size.channels, 1),
        )

    def forward(
        self, inputs: Inputs, rays: Tensor | None, context: Tensor | None
    ) -> Float[Tensor, "batch 3 channels rows columns"]:
        """Give the planes."""
        features, places, found = inputs.surface, inputs.surface[..., :3], []
        for block in self.points:
            features = block(features, places)
            found.append(features)
        means = plane_means(self.gathered(torch.cat(found, dim=-1)), places, self.plane)
        planes = means.flatten(0, 1)
        patches = self.split(planes)
        tokens = patches.flatten(2).transpose(1, 2).unflatten(0, means.shape[:2]).flatten(1, 2)
        tokens = tokens + self.place
        for block in self.blocks:
            tokens = block(tokens, context)
        found_by = self.norm(tokens).unflatten(1, (len(PLANES), -1)).flatten(0, 1)
        patches = found_by.transpose(1, 2).unflatten(2, patches.shape[2:])
        out: Tensor = (self.joined(patches) + self.texel(planes)).unflatten(0, means.shape[:2])
        return out

    def samples(self, shape: Tensor, places: Float[Tensor, "batch points 3"]) -> Tensor:
        """Return the features of points."""
        return plane_samples(shape, places)


class Volume(nn.Module):
    """3D U-Net on voxels that know their rays, their place, and the surface through them."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.edge = size.plane
        widths = [size.channels, 2 * size.channels, 4 * size.channels]
        inputs = POINT_CHANNELS + 1 + len(VIEWS) * RAY_CHANNELS
        steps = list(pairwise(widths))
        self.stem = nn.Conv3d(inputs, widths[0], 3, padding=1)
        self.down_blocks = nn.ModuleList(Residual(width, width, nn.SiLU()) for width in widths)
        self.downs = nn.ModuleList(nn.Conv3d(a, b, 2, stride=2) for a, b in steps)
        self.ups = nn.ModuleList(nn.ConvTranspose3d(b, a, 2, stride=2) for a, b in steps)
        self.up_blocks = nn.ModuleList(Residual(a, a, nn.SiLU()) for a, _ in steps)

    def forward(
        self, inputs: Inputs, rays: Tensor | None, context: Tensor | None
    ) -> Float[Tensor, "batch channels x y z"]:
        """Give the volume."""
        levels = [self.down_blocks[0](self.stem(self._voxels(inputs, rays)))]
        for down, block in zip(self.downs, self.down_blocks[1:], strict=True):
            levels.append(block(down(levels[-1])))
        out: Tensor = levels.pop()
        for up, block in zip(reversed(self.ups), reversed(self.up_blocks), strict=True):
            out = block(up(out) + levels.pop())
        return out

    def samples(self, shape: Tensor, places: Float[Tensor, "batch points 3"]) -> Tensor:
        """Return the features of points."""
        return grid_samples(shape, places)

    def _voxels(self, inputs: Inputs, rays: Tensor | None) -> Float[Tensor, "batch channels x y z"]:
        """Surface points in each voxel (their normal, whether any), its place, and its rays."""
        assert rays is not None
        places = voxel_places(self.edge, inputs.surface)
        normals = inputs.surface[..., 3:]
        marked = torch.cat([normals, torch.ones_like(normals[..., :1])], dim=-1)
        surface = grid_means(marked, inputs.surface[..., :3], self.edge)
        told = torch.cat([places, *seen_at((rays,), inputs.projection, places)], dim=-1)
        grid = told.transpose(1, 2).reshape(len(told), -1, *(self.edge,) * 3)
        return torch.cat([surface, grid], dim=1)


class ThirdView(nn.Module):
    """Decodes the line integrals along z from the plane xy, at twice its resolution."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(channels, 32, 3, padding=1),
            nn.GELU(),
            nn.Upsample(scale_factor=2, mode="bilinear"),
            nn.Conv2d(32, 16, 3, padding=1),
            nn.GELU(),
            nn.Conv2d(16, 1, 3, padding=1),
        )

    def forward(
        self, planes: Float[Tensor, "batch 3 channels rows columns"]
    ) -> Float[Tensor, "batch u v"]:
        """Give log attenuation / 3; rows along x, columns along y."""
        out: Tensor = self.body(planes[:, 0])[:, 0]
        return out


def seen_at(
    images: Sequence[Float[Tensor, "batch views _ _ _"]],
    projection: Float[Tensor, "batch views 3 4"],
    places: Float[Tensor, "batch points 3"],
) -> list[Float[Tensor, "batch points _"]]:
    """Return what images of each view hold where points project to, one after the other."""
    if not images:
        return []
    at = projected(projection, places)
    return [sampled(image[:, view], at[:, view]) for image in images for view in range(len(VIEWS))]


def voxel_places(size: int, like: Tensor) -> Float[Tensor, "batch points 3"]:
    """Centres of the voxels of the cube, in C order, for each object."""
    centres = (torch.arange(size, device=like.device, dtype=like.dtype) * 2 + 1) / size - 1
    grid = torch.cartesian_prod(centres, centres, centres)
    return grid.expand(len(like), -1, -1)


def _expect(name: str, given: object, known: object) -> None:
    """Refuse what this network cannot be made with."""
    choices = list(known)  # type: ignore[call-overload]
    if given not in choices:
        raise ValueError(f"{name} must be one of {choices}, got {given!r}")

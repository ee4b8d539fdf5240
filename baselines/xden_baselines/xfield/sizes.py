"""Sizes of the network, from what a CPU trains in minutes to the paper's order of magnitude."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

__all__ = ["SIZES", "Size"]


@dataclass(frozen=True, slots=True)
class Size:
    """How large a network is.

    Parameters
    ----------
    points
        On the outer surface.
    point_widths, point_grids
        Channels of each point-voxel block, and voxels along the edge of its grid.
    plane
        Texels along the edge of a plane; voxels along that of a volume.
    tokens
        Along the edge of a plane.
    channels
        Of planes.
    width, layers, heads
        Of the transformer.
    crop_px
        Rows and columns of the radiographs' crops.
    view_widths
        Channels of the stages of the radiographs' encoder.
    context
        Channels of the radiographs' tokens.
    hidden
        Width of the head.
    """

    points: int
    point_widths: tuple[int, ...]
    point_grids: tuple[int, ...]
    plane: int
    tokens: int
    channels: int
    width: int
    layers: int
    heads: int
    crop_px: int
    view_widths: tuple[int, ...]
    context: int
    hidden: int


SIZES: Final[Mapping[str, Size]] = MappingProxyType(
    {
        "tiny": Size(
            points=1024,
            point_widths=(16, 16),
            point_grids=(8, 8),
            plane=16,
            tokens=8,
            channels=16,
            width=48,
            layers=2,
            heads=4,
            crop_px=64,
            view_widths=(16, 32),
            context=32,
            hidden=64,
        ),
        "small": Size(
            points=4096,
            point_widths=(32, 64),
            point_grids=(16, 8),
            plane=32,
            tokens=16,
            channels=32,
            width=128,
            layers=4,
            heads=4,
            crop_px=128,
            view_widths=(32, 64, 96),
            context=96,
            hidden=128,
        ),
        "medium": Size(
            points=16384,
            point_widths=(64, 64, 128),
            point_grids=(32, 16, 8),
            plane=64,
            tokens=16,
            channels=64,
            width=256,
            layers=4,
            heads=8,
            crop_px=256,
            view_widths=(48, 96, 192),
            context=192,
            hidden=192,
        ),
        "paper-lite": Size(
            points=32768,
            point_widths=(128, 128, 256),
            point_grids=(32, 16, 8),
            plane=128,
            tokens=32,
            channels=128,
            width=512,
            layers=6,
            heads=8,
            crop_px=256,
            view_widths=(64, 128, 256),
            context=256,
            hidden=256,
        ),
        "paper": Size(
            points=32768,
            point_widths=(256, 128, 128, 256),
            point_grids=(32, 16, 16, 8),
            plane=128,
            tokens=32,
            channels=256,
            width=1024,
            layers=6,
            heads=16,
            crop_px=512,
            view_widths=(96, 192, 384, 768),
            context=768,
            hidden=256,
        ),
    }
)
"""By name: ``tiny`` and ``small`` train on a CPU, the others want a CUDA GPU."""

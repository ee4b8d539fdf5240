"""What a network is made of: the variants that are compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

__all__ = ["VARIANTS", "Variant"]


@dataclass(frozen=True, slots=True)
class Variant:
    """Which parts a network has.

    Parameters
    ----------
    density, parts
        What it says of a point: its density, and an embedding in which points of one part are
        near.
    cross
        Tokens of the planes attend to tokens of the radiographs.
    third
        In training, a third radiograph is decoded from the plane that the other two see edge-on.
    pixel
        A point is told what the encoded radiographs hold where it projects to.
    rays
        A point is told what the radiographs themselves say along its two rays.
    volume
        A 3D U-Net on voxels that are told of their rays, in place of planes and transformer.
    scaled
        What is encoded of the radiographs is told the object's scale (FiLM).
    """

    density: bool = True
    parts: bool = False
    cross: bool = False
    third: bool = False
    pixel: bool = False
    rays: bool = False
    volume: bool = False
    scaled: bool = True

    @property
    def encodes(self) -> bool:
        """Whether it has an encoder of radiographs."""
        return self.cross or self.pixel

    @property
    def xray(self) -> bool:
        """Whether it looks at radiographs."""
        return self.encodes or self.rays or self.volume


VARIANTS: Final[Mapping[str, Variant]] = MappingProxyType(
    {
        "geometry-density": Variant(),
        "geometry-contrastive": Variant(density=False, parts=True),
        "cross": Variant(cross=True, third=True),
        "pixel": Variant(parts=True, pixel=True, rays=True),
        "both": Variant(parts=True, cross=True, third=True, pixel=True, rays=True),
        "rays": Variant(parts=True, rays=True),
        "voxel": Variant(parts=True, volume=True),
        "cross-no-scale": Variant(cross=True, third=True, scaled=False),
        "cross-no-attention": Variant(third=True),
        "cross-no-third": Variant(cross=True),
    }
)
"""By name: ``cross`` is the paper's, ``geometry-contrastive`` PartField's; the last three lack one
part of the paper's each."""

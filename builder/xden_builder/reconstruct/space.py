"""Which part owns which space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float64

from xden1k.errors import DataError
from xden1k.rays import disjoint_regions, ownership_order
from xden_builder.capture import CapturePart
from xden_builder.poly.model.size import Size

__all__ = ["Space", "divide"]


@dataclass(frozen=True, slots=True, eq=False)
class Space:
    """The annotated meshes, and what is each part's where they overlap.

    Parameters
    ----------
    meshes
        As annotated.
    order
        Which part owns space first.
    regions
        Of each part, less what stronger parts own: disjoint.
    """

    meshes: tuple[trimesh.Trimesh, ...]
    order: tuple[int, ...]
    regions: tuple[trimesh.Trimesh, ...]

    def enlarged(self, size: Size) -> Space:
        """Give everything another size."""
        return Space(
            tuple(size.enlarged(mesh) for mesh in self.meshes),
            self.order,
            tuple(size.enlarged(region) for region in self.regions),
        )

    @property
    def volumes_cm3(self) -> Float64[np.ndarray, "k"]:
        """Of the regions."""
        return np.array([float(region.volume) for region in self.regions])


def divide(parts: Sequence[CapturePart]) -> Space:
    """Give all space to the strongest part that claims it.

    Raises
    ------
    DataError
        If stronger parts leave nothing of one.
    """
    meshes = [part.mesh for part in parts]
    order = ownership_order(meshes, [part.priority for part in parts])
    regions = disjoint_regions(meshes, order)
    for part, region in zip(parts, regions, strict=True):
        if not len(region.faces):
            raise DataError(
                f"part {part.name}: other parts own all of its space; see priority in parts.csv"
            )
    return Space(tuple(meshes), tuple(order), tuple(regions))

"""Which part owns which space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float64

from xden1k.errors import DataError
from xden1k.rays import disjoint_regions, ownership_order
from xden_builder.capture.parts import CapturePart
from xden_builder.capture.twins import check_twins

__all__ = ["Space", "divide"]


@dataclass(frozen=True, slots=True, eq=False)
class Space:
    """The meshes of all parts, and what is each part's where they overlap.

    Parameters
    ----------
    meshes
        Of the parts, in their order.
    order
        Which part owns space first, see :func:`xden1k.rays.ownership_order`.
    regions
        Of each part, less what stronger parts own: disjoint. The very mesh where that is nothing.
    """

    meshes: tuple[trimesh.Trimesh, ...]
    order: tuple[int, ...]
    regions: tuple[trimesh.Trimesh, ...]

    @classmethod
    def of(cls, meshes: Sequence[trimesh.Trimesh], order: Sequence[int]) -> Space:
        """Give all space to the first part of an order that claims it.

        Raises
        ------
        DataError
            As :func:`xden1k.rays.disjoint_regions`.
        """
        return cls(tuple(meshes), tuple(order), tuple(disjoint_regions(meshes, order)))

    def moved(self, move: Callable[[trimesh.Trimesh], trimesh.Trimesh]) -> Space:
        """Give everything another place or size, or another form."""
        distinct = {id(mesh): mesh for mesh in (*self.meshes, *self.regions)}
        there = {key: move(mesh) for key, mesh in distinct.items()}
        meshes, regions = (
            tuple(there[id(mesh)] for mesh in each) for each in (self.meshes, self.regions)
        )
        return Space(meshes, self.order, regions)

    @property
    def volumes_cm3(self) -> Float64[np.ndarray, "k"]:
        """Of the regions."""
        return np.array([float(region.volume) for region in self.regions])


def divide(parts: Sequence[CapturePart]) -> Space:
    """Give all space to the strongest part that claims it.

    Raises
    ------
    DataError
        If two parts are the same mesh, stronger parts leave nothing of one, or a mesh is not closed
        or wound inwards.
    """
    check_twins(parts)
    meshes = [part.mesh for part in parts]
    space = Space.of(meshes, ownership_order(meshes, [part.priority for part in parts]))
    for part, region in zip(parts, space.regions, strict=True):
        if not len(region.faces):
            raise DataError(
                f"part {part.name}: other parts own all of its space; see priority in parts.csv"
            )
    return space

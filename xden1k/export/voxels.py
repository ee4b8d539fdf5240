"""The grids of an object, as the formats of volumes want them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Shaped

from xden1k.errors import DataError
from xden1k.export.si import Inertial
from xden1k.values.arrays import Vec3
from xden1k.values.mass import mass_of_grid
from xden1k.values.types import DensityObject

__all__ = ["Volume", "field_inertial", "field_volumes", "label_volume", "of_density"]


@dataclass(frozen=True, eq=False)
class Volume:
    """One grid.

    Parameters
    ----------
    name
        What it holds.
    values
        Shape (x, y, z).
    origin_cm
        Shape (3,): centre of voxel (0, 0, 0).
    voxel_size_cm
        Edge of a voxel.
    words
        What the values are, ASCII, under 80 characters.
    """

    name: str
    values: Shaped[np.ndarray, "x y z"]
    origin_cm: Vec3
    voxel_size_cm: float
    words: str


def field_volumes(obj: DensityObject) -> list[Volume]:
    """Grids of 64 voxels an edge; the density comes first.

    Raises
    ------
    DataError
        If there is no density.
    """
    if obj.density is None:
        raise DataError(f"{obj.object_id}: expected a density field, but there is none")
    grids = {
        "density": (obj.density.density_g_cm3, "density, g/cm3, voxel means"),
        "occupancy": (obj.occupancy, "share of the voxel filled with material"),
        "envelope": (obj.envelope, "share of the voxel inside the outer surface"),
    }
    if obj.apparent_density is not None:
        words = "apparent density LAC / 0.17, g/cm3, voxel means"
        grids["apparent_density"] = (obj.apparent_density.density_g_cm3, words)
    return [
        Volume(name, values.astype(np.float32), obj.origin_cm, obj.voxel_size_cm, words)
        for name, (values, words) in grids.items()
    ]


def label_volume(obj: DensityObject) -> Volume:
    """Labels, 128 voxels an edge: half as large, the first one a quarter of a voxel lower."""
    size = obj.voxel_size_cm
    return Volume("labels", obj.labels, obj.origin_cm - size / 4, size / 2, "0 = air, k = part k")


def of_density(volume: Volume) -> Inertial:
    """Integrate a density."""
    return Inertial.of(mass_of_grid(volume.values, volume.origin_cm, volume.voxel_size_cm))


def field_inertial(obj: DensityObject) -> Inertial:
    """Integrate the field of an object."""
    return of_density(field_volumes(obj)[0])

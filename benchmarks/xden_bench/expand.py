"""From one density for each part to a grid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from jaxtyping import Float

from xden1k.arrays import Grid, Vec3
from xden1k.types import FIELD_SIZE

if TYPE_CHECKING:
    from xden1k.rays import CubeGrid, PartFill

__all__ = ["grid_of_parts", "sd_grid_of_parts"]


def grid_of_parts(
    part_density_g_cm3: Float[np.ndarray, "parts"],
    meshes: Sequence[trimesh.Trimesh],
    origin_cm: Vec3,
    voxel_size_cm: float,
) -> Grid:
    """Spread part densities over the field grid, by the share of each voxel that each part fills.

    The dataset's density is made in the same way, so that the true part densities give the true
    field: to a step of float16, as which fields are stored, because meshes are stored as float32.

    Parameters
    ----------
    part_density_g_cm3
        Shape (parts + 1,), entry 0 is air.
    meshes
        One closed mesh for each part, cm.
    origin_cm
        Shape (3,): centre of field voxel (0, 0, 0).
    voxel_size_cm
        Edge of a field voxel.

    Returns
    -------
    Grid
        Shape (64, 64, 64), float32 of float16's values, g/cm³.

    Raises
    ------
    MissingExtraError
        If the extra ``build``, which cuts meshes into voxels, is not installed.

    Examples
    --------
    >>> box = trimesh.creation.box((1, 1, 1))
    >>> round(grid_of_parts(np.array([0.0, 8.0]), [box], np.zeros(3), 2.0)[0, 0, 0].item(), 1)
    1.0
    """
    from xden1k.rays import density_grid

    grid, fills = _shares(meshes, origin_cm, voxel_size_cm)
    values = density_grid(fills, part_density_g_cm3[1:].tolist(), grid)
    field: Grid = values.astype(np.float16).astype(np.float32)
    return field


def sd_grid_of_parts(
    part_sd_g_cm3: Float[np.ndarray, "parts"],
    meshes: Sequence[trimesh.Trimesh],
    origin_cm: Vec3,
    voxel_size_cm: float,
) -> Grid:
    """Spread the standard deviations of part densities over the field grid.

    The errors of two parts are taken for independent: where they share a voxel,
    ``sqrt(sum (share sd)²)``.

    Parameters
    ----------
    part_sd_g_cm3
        Shape (parts + 1,), entry 0 is air.
    meshes, origin_cm, voxel_size_cm
        As in :func:`grid_of_parts`.

    Returns
    -------
    Grid
        Shape (64, 64, 64), g/cm³.

    Raises
    ------
    MissingExtraError
        If the extra ``build`` is not installed.

    Examples
    --------
    >>> box = trimesh.creation.box((1, 1, 1))
    >>> round(sd_grid_of_parts(np.array([0.0, 0.8]), [box], np.zeros(3), 2.0)[0, 0, 0].item(), 2)
    0.1
    """
    grid, fills = _shares(meshes, origin_cm, voxel_size_cm)
    variance = np.zeros((grid.size,) * 3)
    for fill, sd in zip(fills, part_sd_g_cm3[1:].tolist(), strict=True):
        variance[fill.where] += (sd * fill.share.astype(np.float64)) ** 2
    deviation: Grid = np.sqrt(variance).astype(np.float32)
    return deviation


def _shares(
    meshes: Sequence[trimesh.Trimesh], origin_cm: Vec3, voxel_size_cm: float
) -> tuple[CubeGrid, list[PartFill]]:
    """Share of each voxel that each part fills."""
    from xden1k.rays import CubeGrid, column_samples, part_fractions

    grid = CubeGrid(origin_cm, voxel_size_cm, FIELD_SIZE)
    columns = column_samples(meshes, grid)
    return grid, part_fractions(meshes, range(len(meshes)), grid, columns)

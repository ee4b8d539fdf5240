"""From one density for each part to a grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh
from jaxtyping import Float

from xden1k.arrays import Grid, Vec3
from xden1k.types import FIELD_SIZE

__all__ = ["grid_of_parts"]


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
    from xden1k.rays import CubeGrid, column_samples, density_grid, part_fractions

    grid = CubeGrid(origin_cm, voxel_size_cm, FIELD_SIZE)
    columns = column_samples(meshes, grid)
    fills = part_fractions(meshes, range(len(meshes)), grid, columns)
    values = density_grid(fills, part_density_g_cm3[1:].tolist(), grid)
    field: Grid = values.astype(np.float16).astype(np.float32)
    return field

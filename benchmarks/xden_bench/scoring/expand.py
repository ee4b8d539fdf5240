"""From one density for each part to a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from jaxtyping import Float

from xden1k.values.arrays import Grid, Vec3
from xden1k.values.types import FIELD_SIZE

if TYPE_CHECKING:
    from xden1k.rays import CubeGrid, PartFill

__all__ = ["PartShares", "grid_of_parts", "part_shares", "sd_grid_of_parts"]


@dataclass(frozen=True, slots=True, eq=False)
class PartShares:
    """Share of each voxel that each part fills.

    Parameters
    ----------
    grid
        The field grid.
    fills
        One for each part: where it may be, and its shares there.
    """

    grid: CubeGrid
    fills: Sequence[PartFill]


def part_shares(
    meshes: Sequence[trimesh.Trimesh], origin_cm: Vec3, voxel_size_cm: float
) -> PartShares:
    """Cut parts into the voxels of the field grid, as the dataset's own density was made.

    Parameters
    ----------
    meshes
        One closed mesh for each part, cm.
    origin_cm
        Shape (3,): centre of field voxel (0, 0, 0).
    voxel_size_cm
        Edge of a field voxel.

    Raises
    ------
    MissingExtraError
        If the extra ``build``, which cuts meshes into voxels, is not installed.
    """
    from xden1k.rays import CubeGrid, column_samples, part_fractions

    grid = CubeGrid(origin_cm, voxel_size_cm, FIELD_SIZE)
    columns = column_samples(meshes, grid)
    return PartShares(grid, part_fractions(meshes, range(len(meshes)), grid, columns))


def grid_of_parts(part_density_g_cm3: Float[np.ndarray, "parts"], shares: PartShares) -> Grid:
    """Spread part densities over the field grid, by the share of each voxel that each part fills.

    The true part densities give the true field: to a step of float16, as which fields are stored,
    because meshes are stored as float32.

    Parameters
    ----------
    part_density_g_cm3
        Shape (parts + 1,), entry 0 is air.
    shares
        Of the parts.

    Returns
    -------
    Grid
        Shape (64, 64, 64), float32 of float16's values, g/cm³.

    Examples
    --------
    >>> shares = part_shares([trimesh.creation.box((1, 1, 1))], np.zeros(3), 2.0)
    >>> round(grid_of_parts(np.array([0.0, 8.0]), shares)[0, 0, 0].item(), 1)
    1.0
    """
    from xden1k.rays import density_grid

    values = density_grid(shares.fills, part_density_g_cm3[1:].tolist(), shares.grid)
    field: Grid = values.astype(np.float16).astype(np.float32)
    return field


def sd_grid_of_parts(part_sd_g_cm3: Float[np.ndarray, "parts"], shares: PartShares) -> Grid:
    """Spread the standard deviations of part densities over the field grid.

    The errors of two parts are taken for independent: where they share a voxel,
    ``sqrt(sum (share sd)²)``.

    Parameters
    ----------
    part_sd_g_cm3
        Shape (parts + 1,), entry 0 is air.
    shares
        Of the parts.

    Returns
    -------
    Grid
        Shape (64, 64, 64), g/cm³.

    Examples
    --------
    >>> shares = part_shares([trimesh.creation.box((1, 1, 1))], np.zeros(3), 2.0)
    >>> round(sd_grid_of_parts(np.array([0.0, 0.8]), shares)[0, 0, 0].item(), 2)
    0.1
    """
    variance = np.zeros((shares.grid.size,) * 3)
    for fill, sd in zip(shares.fills, part_sd_g_cm3[1:].tolist(), strict=True):
        variance[fill.where] += (sd * fill.share.astype(np.float64)) ** 2
    deviation: Grid = np.sqrt(variance).astype(np.float32)
    return deviation

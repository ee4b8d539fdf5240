"""From one density for each part to a grid."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from xden1k.arrays import Grid, Labels

__all__ = ["grid_of_parts"]


def grid_of_parts(
    part_density_g_cm3: Float[np.ndarray, "parts"], labels: Labels, occupancy: Grid
) -> Grid:
    """Spread part densities over the field grid.

    The labels say which part a voxel's matter belongs to, the occupancy how much of it there is:
    labels alone misplace up to 14 % of a thin part. A field voxel holds eight label voxels; its
    density is the mean over those that are no air, times the occupancy. A voxel with matter but
    no label takes that of the nearest one. For an object of one part this is exact; where parts
    of different density share a voxel it is good to an eighth of the voxel.

    Parameters
    ----------
    part_density_g_cm3
        Shape (parts + 1,), entry 0 is air.
    labels
        Shape (2x, 2y, 2z): 0 = air, k = part k.
    occupancy
        Shape (x, y, z), 0 to 1.

    Returns
    -------
    Grid
        Shape (x, y, z), float32, g/cm³.

    Examples
    --------
    >>> labels = np.ones((2, 2, 2), np.uint8)
    >>> grid_of_parts(np.array([0.0, 8.0]), labels, np.full((1, 1, 1), 0.25)).item()
    2.0
    """
    x, y, z = occupancy.shape
    blocks = labels.reshape(x, 2, y, 2, z, 2)
    labelled = np.count_nonzero(blocks, axis=(1, 3, 5))
    densities = np.where(np.arange(len(part_density_g_cm3)) > 0, part_density_g_cm3, 0)
    total = np.take(densities.astype(np.float32), blocks).sum(axis=(1, 3, 5))
    matter = total / np.maximum(labelled, 1)
    if ((occupancy > 0) & (labelled == 0)).any():
        nearest = ndimage.distance_transform_edt(
            labelled == 0, return_distances=False, return_indices=True
        )
        matter = matter[tuple(nearest)]
    field: Grid = (matter * occupancy).astype(np.float32)
    return field

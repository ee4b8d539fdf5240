"""The grids a dataset stores of one object, all from its part meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from xden1k.rays.regions import outer_surface
from xden1k.rays.voxels import (
    CubeGrid,
    PartFill,
    density_grid,
    fill_grid,
    object_cube,
    part_fractions,
    voxel_labels,
)
from xden1k.values.arrays import Grid, Labels
from xden1k.values.labels import count_label_voxels, labels_err
from xden1k.values.types import DensityField

__all__ = ["COLUMN_SAMPLES", "THINNER_THAN_LABELS", "ObjectGrids", "column_samples", "object_grids"]

COLUMN_SAMPLES = 16
"""Least density of columns through a field voxel."""
THINNER_THAN_LABELS = "thinner_than_labels"
"""Flag of a part that labels show badly, and of an object of which they show nothing."""
SMALL_BASE, DENSEST = 0.5, 4
"""An object on a base below this share of the cube's gets denser columns, up to so many times. So
few of the others meet a ruler on end that its mass is 1 % off; of these, 0.02 %."""


@dataclass(frozen=True, slots=True, eq=False)
class ObjectGrids:
    """What a dataset stores of an object on its grids, but for the densities.

    Parameters
    ----------
    field
        Where the 64³ grid lies.
    fills
        How much of each field voxel each part fills.
    labels
        Shape (128, 128, 128): owner of each label voxel's centre, 0 = air.
    occupancy, envelope
        Shape (64, 64, 64), 0 to 1: share filled with material; share inside the outer surface.
    """

    field: CubeGrid
    fills: Sequence[PartFill]
    labels: Labels
    occupancy: Grid
    envelope: Grid

    def thin(self, regions: Sequence[trimesh.Trimesh]) -> tuple[bool, ...]:
        """Say of each part whether labels err about its volume, by more than a fifth.

        Parameters
        ----------
        regions
            The space each part owns, in cm.

        Examples
        --------
        >>> plate, block = trimesh.creation.box((9, 9, 0.05)), trimesh.creation.box((2, 2, 2))
        >>> block = block.apply_translation((0, 0, 3))
        >>> object_grids([plate, block], [0, 1]).thin([plate, block])
        (True, False)
        """
        counts = count_label_voxels(self.labels, len(regions))
        volumes = [float(region.volume) for region in regions]
        return tuple(labels_err(counts, self.field.voxel_size_cm / 2, volumes).tolist())

    def density(self, densities_g_cm3: Sequence[float]) -> DensityField:
        """Voxel means of a density that is constant over each part."""
        values = density_grid(self.fills, densities_g_cm3, self.field)
        return DensityField(values, self.field.origin_cm, self.field.voxel_size_cm)


def column_samples(
    meshes: Sequence[trimesh.Trimesh], field: CubeGrid, least: int = COLUMN_SAMPLES
) -> int:
    """Density of columns that places an object's faces well: more for what stands on a small base.

    No object gets more columns in all than one on half of the cube's base, so that what is slender
    costs no more than what is broad.

    Parameters
    ----------
    meshes
        Not all empty.
    field
        The 64³ grid of :func:`xden1k.rays.object_cube`.
    least
        Density for the broad ones.

    Examples
    --------
    >>> wall, post = (trimesh.creation.box(size) for size in ((30, 30, 30), (1, 1, 30)))
    >>> [column_samples([mesh], object_cube([mesh])[0]) for mesh in (wall, post)]
    [16, 64]
    """
    boxes = np.array([mesh.bounds[:, :2] for mesh in meshes if len(mesh.faces)])
    sides = (boxes.max(axis=(0, 1)) - boxes.min(axis=(0, 1))) / field.voxel_size_cm + 1
    denser = np.sqrt(SMALL_BASE * field.size**2 / sides.prod())
    return int(np.ceil(least * np.clip(denser, 1, DENSEST)))


def object_grids(
    meshes: Sequence[trimesh.Trimesh],
    order: Sequence[int],
    subsamples: int = COLUMN_SAMPLES,
    outer: trimesh.Trimesh | None = None,
) -> ObjectGrids:
    """Put an object on its grids.

    Parameters
    ----------
    meshes
        Closed, outward-wound, in cm.
    order
        Indices of the meshes, strongest owner first; of no consequence where none overlap.
    subsamples
        Least density of columns through a field voxel; see :func:`column_samples`.
    outer
        Outer surface of all, where it is known; None: see
        :func:`xden1k.rays.regions.outer_surface`.

    Raises
    ------
    DataError
        If a mesh is open or wound inwards, the order is no permutation, or nothing has an extent.

    Examples
    --------
    >>> grids = object_grids([trimesh.creation.box((2, 2, 2))], [0])
    >>> round(grids.density([1.5]).mass_g, 2)
    12.0
    """
    field, label = object_cube(meshes)
    subsamples = column_samples(meshes, field, subsamples)
    fills = part_fractions(meshes, order, field, subsamples)
    occupancy = density_grid(fills, [1.0] * len(fills), field)
    # sampled a little larger than the parts, and never smaller where they are
    surface = outer_surface(meshes) if outer is None else outer
    envelope = fill_grid([surface], field, subsamples).clip(min=occupancy)
    return ObjectGrids(field, fills, voxel_labels(meshes, order, label), occupancy, envelope)

"""Closed solids from labels of points: an outer surface, divided without gap or overlap.

The region of a label is a level set of manifold3d; what of the surface's inside has not been given
away is split by it, exactly, one label after the other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import trimesh
from jaxtyping import Bool, Float32, UInt8
from scipy import ndimage

from xden1k.errors import DataError, require
from xden1k.rays.manifolds import mesh_of, solid_of
from xden1k.rays.voxels import CubeGrid
from xden1k.values.arrays import Labels, Vec3

if TYPE_CHECKING:
    import manifold3d
else:
    manifold3d = require("manifold3d", "build")

__all__ = ["field_solid", "label_solids"]

SOFTENED = 0.5
"""Standard deviation by which labels are smeared, in voxels: it rounds their steps. Less makes a
ball too large, more too small."""
MARGIN = 2
"""Voxels around a label in which its region is looked for."""
SLIVER = 1e-6
"""A piece with a smaller share of the whole is rounding, and left out."""

Field = Float32[np.ndarray, "x y z"]
Mask3D = Bool[np.ndarray, "x y z"]


def label_solids(
    outer: trimesh.Trimesh, labels: Labels, grid: CubeGrid, void: int | None = None
) -> list[trimesh.Trimesh]:
    """Divide the inside of a closed surface among the labels of voxels.

    Surfaces between labels run half-way between voxel centres, rounded. What lies nearest to no
    labelled voxel's centre, such as a wall between them, goes to the nearest of all.

    Parameters
    ----------
    outer
        Closed outer surface, cm.
    labels
        Shape (x, y, z): label of each voxel's centre, 0 = not told, as outside the surface.
    grid
        Where they lie.
    void
        Label of what is left empty.

    Returns
    -------
    list of trimesh.Trimesh
        Of the labels 1, 2, ..., in this order: closed, disjoint, maybe of several pieces. Together
        with what is void they fill the surface, up to slivers of a millionth of its volume. Empty
        where a label is void, has no voxel, or is too thin for a region.

    Raises
    ------
    DataError
        If the surface is not closed or wound inwards, the grid has another size, or no voxel has a
        label.

    Examples
    --------
    >>> grid = CubeGrid(np.full(3, -1.4), voxel_size_cm=0.4, size=8)
    >>> labels = np.ones((8, 8, 8), dtype=np.uint8)
    >>> labels[4:] = 2
    >>> halves = label_solids(trimesh.creation.box((2, 2, 2)), labels, grid)
    >>> [round(float(half.volume), 9) for half in halves]
    [4.0, 4.0]
    """
    if labels.shape != (grid.size,) * 3:
        raise DataError(f"labels: expected a grid of {grid.size} a side, got {labels.shape}")
    rest = whole = solid_of(outer)
    near_cm, told = _everywhere(outer, labels, grid)
    numbers = np.unique(told).tolist()
    fields = [_softened(told == number) for number in numbers]
    owned = {}
    for place, number in enumerate(numbers[:-1]):
        among = fields[place] - np.max(fields[place + 1 :], axis=0)
        region = _region(among, _around(told == number))
        owned[number], rest = rest.split(_in_cm(region, grid.voxel_size_cm, near_cm))
    owned[numbers[-1]] = rest
    return [
        _without_slivers(owned[number], SLIVER * whole.volume())
        if number in owned and number != void
        else trimesh.Trimesh()
        for number in range(1, int(labels.max()) + 1)
    ]


def field_solid(field: Field, grid: CubeGrid) -> trimesh.Trimesh:
    """Close a surface around where a field is positive, between voxel centres.

    Parameters
    ----------
    field
        Shape (x, y, z), at voxel centres; not positive at the border.
    grid
        Where they lie.

    Returns
    -------
    trimesh.Trimesh
        Closed, cm, maybe of several pieces; empty where the field is positive nowhere.

    Raises
    ------
    DataError
        If the grid has another size.

    Examples
    --------
    >>> grid = CubeGrid(np.full(3, -1.4), voxel_size_cm=0.4, size=8)
    >>> height = np.broadcast_to(np.linspace(-1.4, 1.4, 8), (8, 8, 8))
    >>> inside = 1 - np.max(np.abs([height, height.swapaxes(1, 2), height.T]), axis=0)
    >>> 7.5 < float(field_solid(inside.astype(np.float32), grid).volume) < 8
    True
    """
    if field.shape != (grid.size,) * 3:
        raise DataError(f"field: expected a grid of {grid.size} a side, got {field.shape}")
    region = _region(field, tuple(slice(0, size) for size in field.shape))
    return mesh_of(_in_cm(region, grid.voxel_size_cm, grid.origin_cm))


def _in_cm(
    region: manifold3d.Manifold, voxel_size_cm: float, origin_cm: Vec3
) -> manifold3d.Manifold:
    return region.scale((voxel_size_cm,) * 3).translate(tuple(origin_cm.tolist()))


def _everywhere(
    outer: trimesh.Trimesh, labels: Labels, grid: CubeGrid
) -> tuple[Vec3, UInt8[np.ndarray, "near_x near_y near_z"]]:
    """Give labels, each voxel without one that of the nearest, in a box with room around a surface.

    Returns
    -------
    origin_cm
        Centre of the box's first voxel.
    labels
        Its voxels.
    """
    low, high = (outer.bounds - grid.origin_cm) / grid.voxel_size_cm
    start = np.floor(low).astype(int) - MARGIN
    stop = np.ceil(high).astype(int) + MARGIN + 1
    before, after = np.maximum(-start, 0), np.maximum(stop - grid.size, 0)
    padded = np.pad(labels, np.stack([before, after], axis=1))
    near = padded[tuple(map(slice, start + before, stop + before))]
    if not near.any():
        raise DataError("labels: no voxel at the surface has one, so there is nothing to divide")
    nearest = ndimage.distance_transform_edt(near == 0, return_distances=False, return_indices=True)
    return grid.origin_cm + grid.voxel_size_cm * start, near[tuple(nearest)]


def _around(wanted: Mask3D) -> tuple[slice, ...]:
    """Give the box of some voxels with a margin, as far as there are voxels."""
    (box,) = ndimage.find_objects(wanted.astype(np.uint8))
    return tuple(slice(max(side.start - MARGIN, 0), side.stop + MARGIN) for side in box)


def _softened(mine: Mask3D) -> Field:
    return np.asarray(ndimage.gaussian_filter(mine.astype(np.float32), SOFTENED, mode="nearest"))


def _region(field: Field, box: tuple[slice, ...]) -> manifold3d.Manifold:
    """Where a field is positive, in a box of voxels; coordinates are numbers of voxels.

    manifold3d asks for the field at the voxels' centres and at their corners, in Python and one by
    one: both are looked up.
    """
    field = field[box]
    sides = [np.arange(2 * size + 1) / 2 - 0.5 for size in field.shape]
    halves = np.stack(np.meshgrid(*sides, indexing="ij"))
    table = ndimage.map_coordinates(field, halves, order=1, mode="nearest")
    region = manifold3d.Manifold.level_set(
        lambda x, y, z: table.item(int(2 * x + 1.5), int(2 * y + 1.5), int(2 * z + 1.5)),
        [0.0, 0.0, 0.0, *(size - 1.0 for size in field.shape)],
        edgeLength=1.0,
    )
    return region.translate(tuple(float(side.start) for side in box))


def _without_slivers(solid: manifold3d.Manifold, least_cm3: float) -> trimesh.Trimesh:
    """Return the mesh of a solid less the shells, around material or void, of next to no volume."""
    pieces = solid.decompose()
    kept = [mesh_of(one) for one in pieces if abs(one.volume()) > least_cm3]
    if len(kept) == len(pieces):
        return mesh_of(solid)
    return trimesh.Scene(kept).to_mesh() if kept else trimesh.Trimesh()

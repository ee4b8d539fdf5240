"""Part meshes on voxel grids: how much of each voxel a part fills, and who owns its centre.

A grid is scan converted as a parallel projection along z, so that parts which overlap are shared
out by the same walk as in :func:`path_lengths`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float32, Float64, Int64

from xden1k.errors import DataError
from xden1k.rays import kernels
from xden1k.rays.surfaces import Surfaces, Window
from xden1k.values.arrays import Labels, Vec3
from xden1k.values.types import FIELD_SIZE, LABEL_SIZE, MAX_PARTS
from xden1k.values.views import ViewGeometry

__all__ = [
    "CUBE_MARGIN",
    "CubeGrid",
    "PartFill",
    "density_grid",
    "fill_grid",
    "object_cube",
    "part_fractions",
    "voxel_labels",
]

CUBE_MARGIN = 0.03
"""Air on each side of an object's cube, as a share of the object's longest edge."""


@dataclass(frozen=True, slots=True, eq=False)
class CubeGrid:
    """Where the voxels of a cubic grid lie, in the object frame.

    Parameters
    ----------
    origin_cm
        Shape (3,): centre of voxel (0, 0, 0).
    voxel_size_cm
        Edge of one voxel.
    size
        Voxels along each edge of the cube.
    """

    origin_cm: Vec3
    voxel_size_cm: float
    size: int


@dataclass(frozen=True, slots=True, eq=False)
class PartFill:
    """How much of each voxel one part fills, over the voxels its bounding box touches.

    Parameters
    ----------
    start
        Index of the crop's first voxel in the grid.
    share
        Shape (x, y, z), 0 to 1.
    """

    start: tuple[int, int, int]
    share: Float32[np.ndarray, "x y z"]

    @property
    def where(self) -> tuple[slice, ...]:
        """The crop's place in the grid."""
        return tuple(
            slice(first, first + count)
            for first, count in zip(self.start, self.share.shape, strict=True)
        )


def object_cube(meshes: Sequence[trimesh.Trimesh]) -> tuple[CubeGrid, CubeGrid]:
    """Place the field grid (64³) and the label grid (128³) of an object.

    Both fill one cube: centred on the object's bounding box, its edge the box's longest edge plus
    ``CUBE_MARGIN`` of it on either side. Label voxels have half the edge of field voxels, so their
    grid's origin lies a quarter of a field voxel lower on each axis.

    Raises
    ------
    DataError
        If the meshes have no extent.

    Examples
    --------
    >>> field, labels = object_cube([trimesh.creation.box((6.4 / 1.06, 1, 1))])
    >>> round(field.voxel_size_cm, 9), field.origin_cm.round(9).tolist()
    (0.1, [-3.15, -3.15, -3.15])
    >>> round(labels.voxel_size_cm, 9), labels.origin_cm.round(9).tolist()
    (0.05, [-3.175, -3.175, -3.175])
    """
    points = np.concatenate([np.empty((0, 3)), *(mesh.triangles.reshape(-1, 3) for mesh in meshes)])
    if not len(points):
        raise DataError(f"none of {len(meshes)} parts has a face, so there is no cube around them")
    lowest, highest = points.min(axis=0), points.max(axis=0)
    edge = float((highest - lowest).max()) * (1 + 2 * CUBE_MARGIN)
    if not edge > 0:
        raise DataError("all parts are one point, so there is no cube around them")
    corner = (lowest + highest) / 2 - edge / 2

    def grid(size: int) -> CubeGrid:
        return CubeGrid(corner + edge / size / 2, edge / size, size)

    return grid(FIELD_SIZE), grid(LABEL_SIZE)


def part_fractions(
    meshes: Sequence[trimesh.Trimesh],
    order: Sequence[int],
    grid: CubeGrid,
    subsamples: int = 8,
) -> list[PartFill]:
    """Share of each voxel owned by each part.

    Exact along z. Across it, N = ``subsamples**2 + 1`` rays run through each column of voxels, on
    a square lattice turned by atan(1 / subsamples): all N have different x and different y, so a
    face along an axis is placed to 1 / N of a voxel, where an upright lattice gives 1 / sqrt(N).

    Parameters
    ----------
    meshes
        Closed, outward-wound, in cm.
    order
        Indices of the meshes, strongest owner first.
    grid
        What lies outside is left out.
    subsamples
        At least 1.

    Returns
    -------
    list of PartFill
        One for each mesh; shares of one voxel sum to at most 1.

    Raises
    ------
    DataError
        If the order is not a permutation, or a mesh is open.
    """
    if subsamples < 1:
        raise DataError(f"subsamples must be at least 1, got {subsamples}")
    surfaces = Surfaces.seen(meshes, order, _lattice(grid, subsamples))
    # the grid, seen in the lattice's turned frame, lies within these rows and columns
    rows = (-grid.size - subsamples, subsamples * grid.size)
    columns = (-subsamples, (subsamples + 1) * grid.size)
    window = _cut(surfaces.bounds(), rows, columns)
    starts = surfaces.count(window)
    depths, crossed = surfaces.cross(window, starts)
    boxes = np.array([_touched_voxels(mesh, grid) for mesh in meshes]).reshape(-1, 2, 3)
    shapes = boxes[:, 1] - boxes[:, 0]
    ends = np.cumsum(shapes.prod(axis=1))
    fill = np.zeros(int(ends[-1]) if len(ends) else 0)
    broken = kernels.walk_fill(
        window,
        subsamples,
        grid.voxel_size_cm,
        np.array(order, dtype=np.int64),
        boxes,
        starts,
        depths,
        crossed,
        fill,
    )
    _refuse_open(broken)
    shares = (fill / (subsamples**2 + 1)).astype(np.float32)
    return [
        PartFill(tuple(box[0].tolist()), crop.reshape(shape))
        for box, crop, shape in zip(boxes, np.split(shares, ends[:-1]), shapes, strict=True)
    ]


def voxel_labels(meshes: Sequence[trimesh.Trimesh], order: Sequence[int], grid: CubeGrid) -> Labels:
    """Which part owns the centre of each voxel: 0 = air, k + 1 = ``meshes[k]``.

    Raises
    ------
    DataError
        If there are more than 255 parts, the order is not a permutation, or a mesh is open.
    """
    if len(meshes) > MAX_PARTS:
        raise DataError(f"labels tell {MAX_PARTS} parts apart, got {len(meshes)}")
    step = grid.voxel_size_cm
    across, up = np.array([step, 0.0, 0.0]), np.array([0.0, step, 0.0])
    surfaces = Surfaces.seen(meshes, order, _along_z(grid.origin_cm, across, up))
    window = _cut(surfaces.bounds(), (0, grid.size), (0, grid.size))
    starts = surfaces.count(window)
    depths, crossed = surfaces.cross(window, starts)
    labels = np.zeros((grid.size,) * 3, dtype=np.uint8)
    broken = kernels.walk_labels(
        window, step, np.array(order, dtype=np.int64), starts, depths, crossed, labels
    )
    _refuse_open(broken)
    return labels


def density_grid(
    fills: Sequence[PartFill], densities_g_cm3: Sequence[float], grid: CubeGrid
) -> Float64[np.ndarray, "x y z"]:
    """Voxel means of a density that is constant over each part; densities of 1 give occupancy.

    Raises
    ------
    DataError
        If the counts differ.
    """
    if len(fills) != len(densities_g_cm3):
        raise DataError(f"{len(fills)} parts need as many densities, got {len(densities_g_cm3)}")
    total = np.zeros((grid.size,) * 3)
    for fill, density in zip(fills, densities_g_cm3, strict=True):
        total[fill.where] += float(density) * fill.share.astype(np.float64)
    return total


def fill_grid(
    meshes: Sequence[trimesh.Trimesh], grid: CubeGrid, subsamples: int = 8
) -> Float64[np.ndarray, "x y z"]:
    """Share of each voxel inside any of some closed meshes, which may nest and overlap.

    Sampled as in :func:`part_fractions`.

    Raises
    ------
    DataError
        If a mesh is open.
    """
    fills = part_fractions(meshes, range(len(meshes)), grid, subsamples)
    return density_grid(fills, [1.0] * len(fills), grid)


def _lattice(grid: CubeGrid, subsamples: int) -> ViewGeometry:
    """Rays along z on a square lattice turned against the voxels, N to each column of them."""
    rays = subsamples**2 + 1
    step = grid.voxel_size_cm / rays
    centred = (1 - rays % 2) / 2  # an even number of rays lies beside the voxel's centre
    return _along_z(
        grid.origin_cm + step * centred * np.array([1.0, 1.0, 0.0]),
        step * np.array([subsamples, 1.0, 0.0]),
        step * np.array([-1.0, subsamples, 0.0]),
    )


def _cut(window: Window, rows: tuple[int, int], columns: tuple[int, int]) -> Window:
    """Cut a window to some rows and columns."""
    first_row, end_row = np.clip(window[:2], *rows).tolist()
    first_column, end_column = np.clip(window[2:], *columns).tolist()
    return (first_row, end_row, first_column, end_column)


def _along_z(origin_cm: Vec3, column_step_cm: Vec3, row_step_cm: Vec3) -> ViewGeometry:
    """View the object along z; depth is the height above the origin in cm."""
    return ViewGeometry(
        beam="parallel",
        pixel00_cm=origin_cm,
        column_step_cm=column_step_cm,
        row_step_cm=row_step_cm,
        shape=(1, 1),  # rays of a grid are bounded by the object alone
        direction=np.array([0.0, 0.0, 1.0]),
    )


def _touched_voxels(mesh: trimesh.Trimesh, grid: CubeGrid) -> Int64[np.ndarray, "2 3"]:
    """First and end voxel of a mesh's bounding box, inside the grid."""
    if not len(mesh.faces):
        return np.zeros((2, 3), dtype=np.int64)
    corners = mesh.triangles.reshape(-1, 3)
    limits = np.stack([corners.min(axis=0), corners.max(axis=0)])
    touched = np.floor((limits - grid.origin_cm) / grid.voxel_size_cm + 0.5).astype(np.int64)
    touched[1] += 1
    return np.asarray(touched.clip(0, grid.size))


def _refuse_open(broken: int) -> None:
    if broken:
        raise DataError(
            f"{broken} rays along z leave a part they never entered, or the contrary: "
            "a part is not closed"
        )

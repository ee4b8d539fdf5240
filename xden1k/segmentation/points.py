"""Drawing the points of an object, and who owns them. Needs the extra ``build``."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np
import trimesh
from jaxtyping import Bool, Float64, UInt8

from xden1k.errors import DataError
from xden1k.rays import CubeGrid, sealed, voxel_labels
from xden1k.segmentation.values import GRID_SIZE, MAX_POINTS, SegmentPoints
from xden1k.values.arrays import Vec3
from xden1k.values.types import FIELD_SIZE

__all__ = ["draw_points", "inside_voxels", "owner_voxels", "point_owners", "segment_grid"]


def segment_grid(origin_cm: Vec3, voxel_size_cm: float) -> CubeGrid:
    """Grid at whose voxel centres points lie: it fills the cube of the object's field grid.

    Parameters
    ----------
    origin_cm, voxel_size_cm
        Of the field grid, as the dataset has them.

    Examples
    --------
    >>> grid = segment_grid(np.zeros(3), 0.4)
    >>> grid.voxel_size_cm, grid.origin_cm.round(9).tolist()
    (0.1, [-0.15, -0.15, -0.15])
    """
    finer = voxel_size_cm * FIELD_SIZE / GRID_SIZE
    return CubeGrid(origin_cm - voxel_size_cm / 2 + finer / 2, finer, GRID_SIZE)


def draw_points(outer: trimesh.Trimesh, grid: CubeGrid, object_id: str, seed: int) -> SegmentPoints:
    """Draw voxel centres inside an outer surface, enclosed cavities included.

    Every voxel of the grid has a random number, and of those inside the smallest numbers win: who
    is drawn depends on the id, the seed and the outer surface alone, and a voxel more or less
    changes one point.

    Parameters
    ----------
    outer
        Closed outer surface, cm, object frame.
    grid
        From :func:`segment_grid`.
    object_id
        Whose CRC-32 goes into the seed.
    seed
        Of the protocol.

    Returns
    -------
    SegmentPoints
        ``MAX_POINTS``, or all that there are.

    Raises
    ------
    DataError
        If the surface is not closed, or so thin that no voxel's centre lies inside.
    """
    inside = inside_voxels(outer, grid)
    if not inside.any():
        raise DataError(
            "expected an object with voxels' centres inside, got one thinner than a voxel of "
            f"{10 * grid.voxel_size_cm:.2g} mm: its segments cannot be compared"
        )
    random = np.random.Generator(np.random.PCG64((seed, zlib.crc32(object_id.encode()))))
    # twice as many as are wanted, or all: to sort millions would take memory for nothing
    below = 2 * MAX_POINTS / max(int(inside.sum()), 1)
    layers = [_candidates(layer, random.random(layer.shape), below) for layer in inside]
    places = np.repeat(np.arange(len(layers)), [len(one) for one in layers])
    candidates = np.column_stack([places, np.concatenate(layers)])
    if len(candidates) > MAX_POINTS:
        lowest = np.argpartition(candidates[:, -1], MAX_POINTS)[:MAX_POINTS]
        candidates = candidates[np.sort(lowest)]
    voxels = candidates[:, :-1]
    return SegmentPoints(voxels.astype(np.uint8), grid.origin_cm + grid.voxel_size_cm * voxels)


def _candidates(
    inside: Bool[np.ndarray, "y z"], chances: Float64[np.ndarray, "y z"], below: float
) -> Float64[np.ndarray, "candidates 3"]:
    """Return y, z and number of the voxels of a layer that are inside and have a low number."""
    y, z = np.nonzero(inside & (chances < below))
    return np.column_stack([y, z, chances[y, z]])


def inside_voxels(outer: trimesh.Trimesh, grid: CubeGrid) -> Bool[np.ndarray, "x y z"]:
    """Whether the centre of each voxel lies inside a closed surface.

    Raises
    ------
    DataError
        If the surface is not closed.
    """
    return np.asarray(voxel_labels([outer], [0], grid) > 0)


def owner_voxels(parts: Sequence[trimesh.Trimesh], grid: CubeGrid) -> UInt8[np.ndarray, "x y z"]:
    """Which part owns the centre of each voxel, by the meshes: k = part k - 1, 0 = void or air.

    The film that :func:`xden1k.rays.outer_surface` adds belongs to the part that it was added to.

    Parameters
    ----------
    parts
        Disjoint, closed, cm.
    grid
        From :func:`segment_grid`.

    Raises
    ------
    DataError
        If a mesh is not closed.
    """
    order = range(len(parts))
    owners = voxel_labels(parts, order, grid)
    return np.where(owners > 0, owners, voxel_labels(sealed(parts), order, grid))


def point_owners(
    parts: Sequence[trimesh.Trimesh], grid: CubeGrid, points: SegmentPoints
) -> UInt8[np.ndarray, "points"]:
    """Which part owns each point: see :func:`owner_voxels`."""
    at, order = tuple(points.voxels.T), range(len(parts))
    owners: UInt8[np.ndarray, "points"] = voxel_labels(parts, order, grid)[at]
    if owners.all():  # none in a void, or in the film
        return owners
    return np.where(owners > 0, owners, voxel_labels(sealed(parts), order, grid)[at])

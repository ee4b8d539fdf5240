"""What lies inside a surface that need not close: wherever air from afar does not come.

Air does not pass a surface, nor a hole narrower than a voxel. Depths are voxels, positive inside.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from scipy import ndimage

from xden_builder.phantoms.partnext.surface import SPACING, Surface

__all__ = ["REACH", "depths", "flooded", "near_voxels", "sides"]

REACH: Final = 2.0
"""Depths are exact up to this."""
STOPPED: Final = 0.5 + SPACING**2 / 2
"""Air does not reach the centre of a voxel as near as this to a surface. Of two neighbours to both
sides of one, half a voxel would keep out one; the rest is for distances that points on the surface
overrate."""
BESIDE: Final = 1.25
"""How far from a surface it is looked whether there is air."""

Grid3 = Bool[np.ndarray, "x y z"]
Depths = Float32[np.ndarray, "x y z"]


def near_voxels(surface: Surface, shape: tuple[int, ...], reach: float) -> Int64[np.ndarray, "k 3"]:
    """List the voxels of a grid that may be as near as this to a surface's points."""
    at = np.round(surface.points).astype(np.int64)
    at = at[((at >= 0) & (at < shape)).all(axis=1)]
    touched = np.zeros(shape, dtype=np.bool_)
    touched[tuple(at.T)] = True
    grown = ndimage.binary_dilation(
        touched, np.ones((3, 3, 3), dtype=np.bool_), iterations=int(np.ceil(reach)) + 1
    )
    return np.argwhere(grown)


def flooded(surface: Surface, shape: tuple[int, ...]) -> Grid3:
    """Which voxels air reaches that begins at the corner of the grid, which must be free."""
    voxels = near_voxels(surface, shape, 1.0)
    hit, feet, _ = surface.nearest(voxels.astype(np.float64), 1.0)
    near = voxels[hit]
    stopped = np.zeros(shape, dtype=np.bool_)
    stopped[tuple(near.T)] = np.linalg.norm(near - feet, axis=1) <= STOPPED
    regions, _ = ndimage.label(~stopped)
    return np.asarray((regions == regions[0, 0, 0]) & ~stopped)


def _airy(air: Grid3, points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
    """Whether there is air at some points, which may lie between voxels."""
    share = ndimage.map_coordinates(air.astype(np.float32), points.T, order=1, mode="nearest")
    return np.asarray(share > 0.5)


def sides(surface: Surface, air: Grid3) -> tuple[Bool[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Whether there is air before and behind each point of a surface."""
    step = BESIDE * surface.normals
    return _airy(air, surface.points + step), _airy(air, surface.points - step)


def depths(surface: Surface, air: Grid3) -> Depths:
    """How deep each voxel is below the surface, negative in air, REACH at most either way.

    Next to the surface, where air was stopped on either side, a voxel is in the air if that is
    where one comes to who leaves the surface by way of it.

    Parameters
    ----------
    surface
        Points next to air alone.
    air
        Of :func:`flooded`.
    """
    voxels = near_voxels(surface, air.shape, REACH)
    hit, feet, _ = surface.nearest(voxels.astype(np.float64), REACH)
    near = voxels[hit]
    away = near - feet
    distance = np.linalg.norm(away, axis=1)
    ahead = feet + BESIDE * away / distance.clip(min=1e-9)[:, None]
    outside = air[tuple(near.T)] | _airy(air, ahead)
    depth = np.where(air, np.float32(-REACH), np.float32(REACH))
    depth[tuple(near.T)] = np.where(outside, -distance, distance).clip(-REACH, REACH)
    return np.asarray(depth)

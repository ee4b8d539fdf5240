"""A cloud of surface points, each with the area it stands for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Bool, Float

from xden1k.values.arrays import Points

__all__ = ["SurfaceCloud", "surface_cloud"]

SAMPLES = 100_000
"""As many as NeRF2Physics exports."""
CELL = 0.01
"""Edge of the cells that keep one point each, as a share of the box's longest edge."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceCloud:
    """Points on a surface.

    Parameters
    ----------
    points_cm, normals
        Shape (points, 3); normals point outwards.
    areas_cm2
        Shape (points,): they add up to the surface's area.
    cell_cm
        About their distance from each other.
    """

    points_cm: Points
    normals: Float[np.ndarray, "points 3"]
    areas_cm2: Float[np.ndarray, "points"]
    cell_cm: float

    def __len__(self) -> int:
        return len(self.points_cm)

    def take(self, chosen: Bool[np.ndarray, "points"]) -> SurfaceCloud:
        """Return some of the points; what the others stood for is shared out evenly."""
        areas = self.areas_cm2[chosen]
        areas = areas * (self.areas_cm2.sum() / areas.sum())
        return SurfaceCloud(self.points_cm[chosen], self.normals[chosen], areas, self.cell_cm)


def surface_cloud(mesh: trimesh.Trimesh, *, seed: int) -> SurfaceCloud:
    """Draw points evenly by area and keep one in each cell of a cubic grid.

    NeRF2Physics takes a cell's mean point and its squared edge as area. The mean of the two sides
    of a thin wall lies inside it, and a slanted surface crosses up to 1.7 cells for each squared
    edge of it (a sphere 1.5); so here the first point drawn stays, and stands for the share of
    the area that was drawn into its cell.
    """
    points, faces = trimesh.sample.sample_surface(mesh, SAMPLES, seed=seed)
    cell_cm = CELL * float(mesh.extents.max())
    cells = np.floor((points - mesh.bounds[0]) / cell_cm).astype(np.int64)
    per_axis = np.int64(cells.max() + 1)
    flat = (cells[:, 0] * per_axis + cells[:, 1]) * per_axis + cells[:, 2]
    _, first, count = np.unique(flat, return_index=True, return_counts=True)
    return SurfaceCloud(
        np.asarray(points[first], dtype=np.float64),
        np.asarray(mesh.face_normals[faces[first]], dtype=np.float64),
        count * (float(mesh.area) / SAMPLES),
        cell_cm,
    )

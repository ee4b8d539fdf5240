"""Triangles that need not close, and points all over them.

Lengths are voxels, and voxel (i, j, k) has its centre at (i, j, k).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.spatial import cKDTree
from trimesh.triangles import closest_point

__all__ = ["SPACING", "Surface"]

SPACING: Final = 0.5
"""Between points, at most."""

Triangles = Float64[np.ndarray, "t 3 3"]


@dataclass(frozen=True, eq=False)
class Surface:
    """Some triangles and points on them.

    Parameters
    ----------
    triangles
        Shape (t, 3, 3).
    points
        Shape (n, 3): none of a triangle is farther than ``SPACING`` from the next.
    triangle
        Shape (n,): which one each point is on.
    """

    triangles: Triangles
    points: Float64[np.ndarray, "n 3"]
    triangle: Int64[np.ndarray, "n"]

    @classmethod
    def of(cls, triangles: Triangles) -> Surface:
        """Put points on triangles: rows along the longest edge, up to the corner across.

        Examples
        --------
        >>> corner = np.array([[[0.0, 0, 0], [2, 0, 0], [0, 2, 0]]])
        >>> len(Surface.of(corner).points)
        28
        """
        edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        first = edges.argmax(axis=1)
        turned = np.take_along_axis(
            triangles, ((first[:, None] + np.arange(3)) % 3)[:, :, None], axis=1
        )
        longest = edges.max(axis=1)
        area = np.linalg.norm(
            np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
        )
        height = area / longest.clip(min=1e-12)
        along = np.ceil(longest / SPACING).astype(np.int64).clip(min=1)
        up = np.ceil(height / SPACING).astype(np.int64).clip(min=1)
        counts = (along + 1) * (up + 1)
        triangle = np.repeat(np.arange(len(triangles)), counts)
        number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        u = (number % (along + 1)[triangle]) / along[triangle]
        v = (number // (along + 1)[triangle]) / up[triangle]
        shares = np.stack([(1 - u) * (1 - v), u * (1 - v), v], axis=1)
        points = np.einsum("ni,nij->nj", shares, turned[triangle])
        return cls(triangles, points, triangle)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    @cached_property
    def normals(self) -> Float64[np.ndarray, "n 3"]:
        """Of the triangle at each point, to either side; zero of a triangle without area."""
        a, b, c = self.triangles.transpose(1, 0, 2)
        across = np.cross(b - a, c - a)
        length = np.linalg.norm(across, axis=1, keepdims=True)
        return np.asarray((across / length.clip(min=1e-12))[self.triangle])

    def only(self, kept: Bool[np.ndarray, "n"]) -> Surface:
        """Keep some points; nothing is near the others."""
        return replace(self, points=self.points[kept], triangle=self.triangle[kept])

    def nearest(
        self, points: Float64[np.ndarray, "k 3"], reach: float
    ) -> tuple[Bool[np.ndarray, "k"], Float64[np.ndarray, "h 3"], Int64[np.ndarray, "h"]]:
        """Find what is nearest to some points.

        Parameters
        ----------
        points
            Shape (k, 3).
        reach
            How far to look for one of the surface's points.

        Returns
        -------
        hit
            Shape (k,): which have anything near.
        foot
            Shape (h, 3): where on the triangle of the nearest point, for these alone.
        which
            Shape (h,): that point.
        """
        if not len(self.points):
            none = np.empty(0, dtype=np.int64)
            return np.zeros(len(points), dtype=np.bool_), np.empty((0, 3)), none
        distance, which = self._tree.query(points, distance_upper_bound=reach)
        hit = np.isfinite(distance)
        triangles = self.triangles[self.triangle[which[hit]]]
        with np.errstate(divide="ignore", invalid="ignore"):
            feet = closest_point(triangles, points[hit])  # type: ignore[no-untyped-call]
        # of a triangle without area, a point on it is as near as can be told
        feet = np.where(np.isfinite(feet), feet, self.points[which[hit]])
        return hit, feet, which[hit].astype(np.int64)

"""Triangles of all parts as a detector sees them, and the crossings of its rays with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np
import trimesh
from jaxtyping import Float64, Int16, Int32

from xden1k.errors import DataError
from xden1k.rays import kernels
from xden1k.rays.priority import check_order
from xden1k.values.views import ViewGeometry

__all__ = ["Surfaces", "Window"]

Window = kernels.Window
"""First and end row, first and end column."""


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """The triangles of all parts in a detector's frame.

    Parameters
    ----------
    triangles
        Shape (n, 3, 3): column, row and depth of each vertex, vertices ordered by row. For a cone
        the third is 1 / depth, which, unlike depth, is affine over the detector.
    labels
        Shape (n,): rank of the part, 1 = strongest; the sign holds the winding.
    inverse_depth
        Whether the third coordinate is 1 / depth.
    """

    triangles: Float64[np.ndarray, "n 3 3"]
    labels: Int16[np.ndarray, "n"]
    inverse_depth: bool

    @classmethod
    def seen(
        cls, meshes: Sequence[trimesh.Trimesh], order: Sequence[int], geometry: ViewGeometry
    ) -> Surfaces:
        """Project meshes; ``order`` holds their indices, strongest owner first.

        Raises
        ------
        DataError
            If the order is not a permutation, a vertex is not finite, or one of a cone beam is
            not in front of the source.
        """
        check_order(order, len(meshes))
        ends = np.cumsum([0, *(len(meshes[part].faces) for part in order)]).tolist()
        triangles, labels = np.empty((ends[-1], 3, 3)), np.empty(ends[-1], dtype=np.int16)
        inverse, sign = np.linalg.inv(geometry.matrix), -1 if geometry.mirrored else 1
        for rank, (part, (begin, end)) in enumerate(zip(order, pairwise(ends), strict=True), 1):
            mine = triangles[begin:end], labels[begin:end]
            _see(meshes[part], part, geometry, inverse, sign * rank, *mine)
        return cls(triangles, labels, geometry.beam == "cone")

    def bounds(self) -> Window:
        """Smallest window with every ray that can cross a surface; all zero without triangles."""
        if not len(self.triangles):
            return (0, 0, 0, 0)
        huge = 2.0**30  # next to the source a projection may leave the integers
        first_row, end_row, first_column, end_column = (
            ceil(min(max(edge, -huge), huge)) for edge in kernels.extent(self.triangles)
        )
        return (first_row, end_row, first_column, end_column)

    def count(self, window: Window) -> Int32[np.ndarray, "rows columns"]:
        """Count the crossings of each ray of a window."""
        first_row, end_row, first_column, end_column = window
        cells = np.zeros((end_row - first_row, end_column - first_column), dtype=np.int32)
        kernels.count(self.triangles, window, cells)
        return cells

    def cross(
        self, window: Window, counts: Int32[np.ndarray, "rows columns"]
    ) -> tuple[Float64[np.ndarray, "crossings"], Int16[np.ndarray, "crossings"]]:
        """Depth and signed rank of each crossing, ray by ray, unsorted within a ray.

        ``counts``, contiguous, as :meth:`count` gave them, become the start of each ray's list.
        """
        ends = counts.reshape(-1)
        np.cumsum(ends, out=ends)
        total = int(ends[-1]) if len(ends) else 0
        depths, crossed = np.empty(total), np.empty(total, dtype=np.int16)
        kernels.scan(
            self.triangles, self.labels, self.inverse_depth, window, counts, depths, crossed
        )
        return depths, crossed

    def depths(self, window: Window) -> Float64[np.ndarray, "rows columns"]:
        """Depth of each ray of a window through one part, all of whose triangles these are.

        That of a cone counts in ways from the source to the detector's plane.
        """
        first_row, end_row, first_column, end_column = window
        depths = np.zeros((end_row - first_row, end_column - first_column))
        kernels.add_depths(self.triangles, self.labels, self.inverse_depth, window, depths)
        return depths


def _see(
    mesh: trimesh.Trimesh,
    part: int,
    geometry: ViewGeometry,
    inverse: Float64[np.ndarray, "3 3"],
    rank: int,
    triangles: Float64[np.ndarray, "n 3 3"],
    labels: Int16[np.ndarray, "n"],
) -> None:
    """Write the triangles of one mesh as the detector sees them."""
    cone = geometry.source_cm is not None
    origin = geometry.pixel00_cm if geometry.source_cm is None else geometry.source_cm
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
    projected = np.empty_like(vertices)
    if not kernels.project(vertices, origin, inverse, cone, projected):
        raise DataError(f"part {part}: a vertex is not finite")
    behind = kernels.gather(projected, faces, rank, triangles, labels)
    if cone and behind:
        raise DataError(
            f"part {part}: {behind} of {len(faces)} triangles reach behind the X-ray "
            f"source at {origin.tolist()} cm"
        )

"""The polygon on which an object stands, and how far a point of it is from tipping over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from xden_bench.manip.pose import Pose

__all__ = ["Plane", "Support", "support_of"]

Plane = Float[np.ndarray, "2"]
"""A point or a direction on the table, cm."""


@dataclass(frozen=True, slots=True, eq=False)
class Support:
    """A convex polygon on the table.

    Parameters
    ----------
    corners_cm
        Shape (corners, 2), counter-clockwise.
    """

    corners_cm: Float[np.ndarray, "corners 2"]

    @property
    def normals(self) -> Float[np.ndarray, "corners 2"]:
        """Unit vectors that point out of each edge, which leads from its corner to the next."""
        x, y = (np.roll(self.corners_cm, -1, axis=0) - self.corners_cm).T
        return np.stack([y, -x], axis=1) / np.hypot(x, y)[:, None]

    def insets_cm(self, point_cm: Plane) -> Float[np.ndarray, "corners"]:
        """How far a point lies inside the line of each edge."""
        insets: Float[np.ndarray, "corners"] = np.einsum(
            "ij,ij->i", self.corners_cm - point_cm, self.normals
        )
        return insets

    def margin_cm(self, point_cm: Plane) -> float:
        """How far a point is from the nearest edge; negative outside.

        Examples
        --------
        >>> square = Support(np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]]))
        >>> square.margin_cm(np.array([1.0, 2.0]))
        1.0
        """
        return float(self.insets_cm(point_cm).min())

    def nearest_normal(self, point_cm: Plane) -> Plane:
        """Return the unit vector from a point inside to the nearest edge."""
        normal: Plane = self.normals[self.insets_cm(point_cm).argmin()]
        return normal

    def reach_cm(self, point_cm: Plane, direction: Plane) -> float:
        """How far it is from a point inside to the rim, in a direction.

        Examples
        --------
        >>> square = Support(np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]]))
        >>> square.reach_cm(np.array([1.0, 2.0]), np.array([1.0, 0.0]))
        3.0
        """
        speeds = self.normals @ direction
        ahead = speeds > 0
        return float((self.insets_cm(point_cm)[ahead] / speeds[ahead]).min())

    def clipped(self, normal: Plane, at_cm: float) -> Support | None:
        """Return the part behind a line; None if there is none.

        Parameters
        ----------
        normal
            Unit vector across the line.
        at_cm
            Where along it the line is.
        """
        over = self.corners_cm @ normal - at_cm
        nexts = np.roll(over, -1)
        crossed = (over < 0) != (nexts < 0)
        shares = (over[crossed] / (over - nexts)[crossed])[:, None]
        ways = (np.roll(self.corners_cm, -1, axis=0) - self.corners_cm)[crossed]
        return _polygon(
            np.concatenate([self.corners_cm[over < 0], self.corners_cm[crossed] + shares * ways])
        )


def _polygon(points_cm: Float[np.ndarray, "points 2"]) -> Support | None:
    """Convex polygon around points; None if they are on one line, or too few."""
    if len(points_cm) < 3:
        return None
    try:
        return Support(points_cm[ConvexHull(points_cm).vertices])
    except QhullError:
        return None


def support_of(
    hulls: Sequence[trimesh.Trimesh], rest: Pose, max_height_cm: float
) -> Support | None:
    """Polygon around all corners of hulls that are on the table; None if it has no area.

    Parameters
    ----------
    hulls
        Convex, cm, in the object's frame.
    rest
        Of the object on the table, z = 0.
    max_height_cm
        Above the table, up to which a corner counts as on it.
    """
    corners = rest.to_world(np.concatenate([np.asarray(hull.vertices) for hull in hulls]))
    return _polygon(corners[corners[:, 2] <= max_height_cm, :2])

"""The polygon on which an object stands, and how far a point of it is from tipping over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from xden_bench.manip.pose import Pose

__all__ = ["Flat", "Plane", "Support", "support_around", "support_of"]

Plane = Float[np.ndarray, "2"]
"""A point or a direction on the table, cm."""
Flat = Float[np.ndarray, "_ 2"]
"""Points on the table, cm: as many as there are."""

NEAR_CM: Final = 1e-3
"""To which the place of an edge is found."""


@dataclass(frozen=True, slots=True, eq=False)
class Support:
    """A convex polygon on the table.

    Parameters
    ----------
    corners_cm
        Shape (corners, 2), counter-clockwise.
    pieces_cm
        What touches the table inside it, each convex: shapes (points, 2).
    """

    corners_cm: Float[np.ndarray, "corners 2"]
    pieces_cm: tuple[Flat, ...]

    @property
    def normals(self) -> Float[np.ndarray, "corners 2"]:
        """Unit vectors that point out of each edge, which leads from its corner to the next."""
        x, y = (np.roll(self.corners_cm, -1, axis=0) - self.corners_cm).T
        normals: Float[np.ndarray, "corners 2"] = (
            np.stack([y, -x], axis=1) / np.hypot(x, y)[:, None]
        )
        return normals

    def insets_cm(self, point_cm: Plane) -> Float[np.ndarray, "corners"]:
        """How far a point lies inside the line of each edge."""
        insets: Float[np.ndarray, "corners"] = np.einsum(
            "ij,ij->i", self.corners_cm - point_cm, self.normals
        )
        return insets

    def margin_cm(self, point_cm: Plane) -> float:
        """How far a point is from the nearest edge; negative outside."""
        return float(self.insets_cm(point_cm).min())

    def nearest_normal(self, point_cm: Plane) -> Plane:
        """Return the unit vector from a point inside to the nearest edge."""
        normal: Plane = self.normals[self.insets_cm(point_cm).argmin()]
        return normal

    def reach_cm(self, point_cm: Plane, direction: Plane) -> float:
        """How far it is from a point inside to the rim, in a direction.

        Examples
        --------
        >>> square = support_around([np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]])])
        >>> square.reach_cm(np.array([1.0, 2.0]), np.array([1.0, 0.0]))
        3.0
        """
        speeds = self.normals @ direction
        ahead = speeds > 0
        return float((self.insets_cm(point_cm)[ahead] / speeds[ahead]).min())

    def clipped(self, normal: Plane, at_cm: float) -> Support | None:
        """Return what is left of it behind a line, by what touches the table; None if nothing.

        Parameters
        ----------
        normal
            Unit vector across the line.
        at_cm
            Where along it the line is.
        """
        return support_around([_behind(piece, normal, at_cm) for piece in self.pieces_cm])

    def edge_cm(self, point_cm: Plane, normal: Plane, inside_cm: float) -> float | None:
        """Where a table may end for what is left of the support to reach just beyond a point.

        Parameters
        ----------
        point_cm
            Which must stay inside.
        normal
            Unit vector that leads off the table.
        inside_cm
            How far the support must reach beyond the point, towards the edge.

        Returns
        -------
        float or None
            Along the normal; None if all of the support does not do.
        """

        def does(at_cm: float) -> bool:
            left = self.clipped(normal, at_cm)
            return (
                left is not None
                and left.margin_cm(point_cm) > 0
                and left.reach_cm(point_cm, normal) >= inside_cm
            )

        low_cm, high_cm = (
            float(point_cm @ normal),
            float((self.corners_cm @ normal).max()) + NEAR_CM,
        )
        if not does(high_cm):
            return None
        while high_cm - low_cm > NEAR_CM:
            middle_cm = (low_cm + high_cm) / 2
            low_cm, high_cm = (low_cm, middle_cm) if does(middle_cm) else (middle_cm, high_cm)
        return high_cm


def _behind(piece_cm: Flat, normal: Plane, at_cm: float) -> Flat:
    """Points of a convex piece behind a line, and where its chords cross that."""
    over = piece_cm @ normal - at_cm
    behind, ahead = piece_cm[over < 0], piece_cm[over >= 0]
    depths, heights = over[over < 0][:, None], over[over >= 0][None]
    shares = (depths / (depths - heights))[..., None]
    crossings = behind[:, None] + shares * (ahead[None] - behind[:, None])
    return np.concatenate([behind, crossings.reshape(-1, 2)])


def support_around(pieces_cm: Sequence[Flat]) -> Support | None:
    """Polygon around what touches the table; None if that is on one line, or nothing.

    Examples
    --------
    >>> legs = [np.array([[x, y]]) for x in (0.0, 4.0) for y in (0.0, 4.0)]
    >>> support_around(legs).margin_cm(np.array([1.0, 2.0]))
    1.0
    >>> support_around(legs[:2]) is None
    True
    """
    points = np.concatenate([np.zeros((0, 2)), *pieces_cm])
    if len(points) < 3:
        return None
    try:
        return Support(points[ConvexHull(points).vertices], tuple(pieces_cm))
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
    placed = [rest.to_world(np.asarray(hull.vertices)) for hull in hulls]
    return support_around([points[points[:, 2] <= max_height_cm, :2] for points in placed])

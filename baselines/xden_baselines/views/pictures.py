"""What a method that reads pictures is given, and which points a picture shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int64, UInt8

from xden1k.errors import DataError
from xden1k.values.arrays import Points
from xden_baselines.views.cameras import Camera

__all__ = ["BACKGROUND", "Pictures", "visible"]

BACKGROUND = 255
"""Grey of every pixel off the object."""


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """Posed colour pictures of one object. Nothing in them tells parts or insides.

    Parameters
    ----------
    colors
        Shape (views, rows, columns, 3) uint8, white off the object.
    masks
        Shape (views, rows, columns): True on the object.
    distance_cm
        Shape (views, rows, columns): from the camera along the ray to the surface; inf off the
        object.
    cameras
        One for each view.

    Raises
    ------
    DataError
        If there is no view, or shapes differ, or a distance on the object is not positive and
        finite.
    """

    colors: UInt8[np.ndarray, "views rows columns 3"]
    masks: Bool[np.ndarray, "views rows columns"]
    distance_cm: Float32[np.ndarray, "views rows columns"]
    cameras: tuple[Camera, ...]

    def __post_init__(self) -> None:
        if not self.cameras:
            raise DataError("pictures: at least one view, got none")
        shapes = {self.colors.shape[:3], self.masks.shape, self.distance_cm.shape}
        shapes |= {(len(self.cameras), *camera.shape) for camera in self.cameras}
        if len(shapes) > 1:
            raise DataError(
                "pictures: colors, masks, distances and cameras must have one shape, "
                f"got {sorted(shapes)}"
            )
        seen = self.distance_cm[self.masks]
        if not (np.isfinite(seen) & (seen > 0)).all():
            raise DataError("pictures: distances on the object must be positive and finite")

    def __len__(self) -> int:
        return len(self.cameras)

    def take(self, views: Sequence[int]) -> Pictures:
        """Return some of the views, in this order."""
        chosen = list(views)
        return Pictures(
            self.colors[chosen],
            self.masks[chosen],
            self.distance_cm[chosen],
            tuple(self.cameras[view] for view in chosen),
        )


def visible(
    points_cm: Points, pictures: Pictures, view: int, *, tolerance_cm: float, margin_px: int = 0
) -> tuple[Bool[np.ndarray, "points"], Int64[np.ndarray, "seen 2"]]:
    """Which points a view shows, and where.

    Parameters
    ----------
    points_cm
        Near the surface.
    pictures, view
        One of the pictures.
    tolerance_cm
        How far behind the surface that the view sees a point may lie.
    margin_px
        Points nearer to the picture's edge do not count: half a patch, for patches that must lie
        wholly inside.

    Returns
    -------
    seen
        Shape (points,).
    pixels
        Shape (seen, 2): row and column of the pixel of each point that is seen.
    """
    camera = pictures.cameras[view]
    place = camera.project(points_cm)
    rows, columns = camera.shape
    inside = (
        (place[:, 0] >= margin_px)
        & (place[:, 0] < columns - margin_px)
        & (place[:, 1] >= margin_px)
        & (place[:, 1] < rows - margin_px)
    )
    pixels = np.floor(place[inside, 1::-1]).astype(np.int64)
    at = (view, pixels[:, 0], pixels[:, 1])
    distance = np.linalg.norm(points_cm[inside] - camera.position_cm, axis=1)
    shown = pictures.masks[at] & (distance <= pictures.distance_cm[at] + tolerance_cm)
    seen = np.zeros(len(points_cm), dtype=bool)
    seen[np.flatnonzero(inside)[shown]] = True
    return seen, pixels[shown]

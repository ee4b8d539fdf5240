"""Where an object is in its radiographs."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from xden1k.values.types import DensityObject
from xden1k.values.views import XRayView

__all__ = ["Window", "object_window", "pixel_aspect"]

Window: TypeAlias = tuple[slice, slice]
"""Rows and columns."""


def object_window(obj: DensityObject, view: XRayView) -> Window:
    """Rows and columns of the object and a margin: square in cm, but for the image's edges."""
    points = np.concatenate([part.mesh.vertices for part in obj.parts])
    columns, rows, _ = view.geometry.project(points).T
    aspect = pixel_aspect(view)
    side = 1.2 * max(float(np.ptp(rows)) * aspect, float(np.ptp(columns))) + 1
    height, width = view.geometry.shape
    return _span(rows, side / aspect, height), _span(columns, side, width)


def _span(positions: Float[np.ndarray, "n"], side: float, size: int) -> slice:
    length = int(np.ceil(side))
    first = round((positions.min() + positions.max() - length) / 2)
    return slice(min(max(0, first), size - 1), max(1, min(size, first + length)))


def pixel_aspect(view: XRayView) -> float:
    """Height of a pixel over its width."""
    place = view.geometry
    return float(np.linalg.norm(place.row_step_cm) / np.linalg.norm(place.column_step_cm))

"""One tube and one panel: an object is turned by hand before its second exposure.

``scanner.toml`` tells the second view as if the turn had been of 90 degrees about the vertical
through the origin. In truth the angle, the axis and the place are a little off.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from xden1k.values.arrays import Vec3
from xden1k.values.views import ViewGeometry

__all__ = ["draw_turn", "seen_by_object"]

MEANT_DEG: Final = 90.0
MOST_ANGLE_OFF_DEG: Final = 5.0
"""Evenly drawn, which is a standard deviation of 2.9 degrees."""
TILT_SD_DEG: Final = 2.5
"""Of the axis, towards x and towards y."""
MOST_SHIFT_CM: Final = 2.0

Matrix = Float[np.ndarray, "4 4"]


def draw_turn(rng: np.random.Generator) -> Matrix:
    """Draw how an object stands that was turned by hand, against one that was turned as told.

    Returns
    -------
    array of shape (4, 4)
        Rigid. A point x of the object, in the frame of the first view, is in the image where the
        told geometry of the second has the point ``matrix`` x.
    """
    angle_deg = MEANT_DEG + rng.uniform(-MOST_ANGLE_OFF_DEG, MOST_ANGLE_OFF_DEG)
    axis = np.append(np.tan(np.radians(rng.normal(0.0, TILT_SD_DEG, 2))), 1.0)
    turned = Rotation.from_rotvec(angle_deg * axis / np.linalg.norm(axis), degrees=True)
    way = rng.normal(size=3)
    shift_cm = rng.uniform(0.0, MOST_SHIFT_CM) * way / np.linalg.norm(way)
    meant = Rotation.from_euler("z", MEANT_DEG, degrees=True)
    matrix = np.eye(4)
    matrix[:3, :3] = (meant.inv() * turned).as_matrix()
    matrix[:3, 3] = meant.inv().apply(shift_cm)
    return matrix


def seen_by_object(geometry: ViewGeometry, matrix: Matrix) -> ViewGeometry:
    """Place a cone beam and its panel in the frame of an object that is not where it should be.

    Parameters
    ----------
    geometry
        Of an object that is.
    matrix
        Rigid: where a point of the object is instead.
    """
    assert geometry.source_cm is not None
    back, shift = matrix[:3, :3].T, matrix[:3, 3]

    def point(place_cm: Vec3) -> Vec3:
        return np.asarray(back @ (place_cm - shift))

    return replace(
        geometry,
        source_cm=point(geometry.source_cm),
        pixel00_cm=point(geometry.pixel00_cm),
        column_step_cm=back @ geometry.column_step_cm,
        row_step_cm=back @ geometry.row_step_cm,
    )

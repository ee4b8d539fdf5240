"""Square windows of radiographs around an object's cube, and where its points lie in them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64

from xden1k.access.samples import SampleView
from xden1k.values.arrays import Image, Mask, Points, Vec3
from xden1k.values.types import FIELD_SIZE
from xden1k.values.views import ViewGeometry

__all__ = ["Crop", "Cube", "projection"]

MARGIN: Final = 0.05
"""Of a crop around the projected cube, as a share of its side, both sides together."""


@dataclass(frozen=True, slots=True, eq=False)
class Cube:
    """The cube of an object's grids: -1 to 1 on each axis is its extent.

    Parameters
    ----------
    centre_cm
        Shape (3,), object frame.
    half_cm
        Half its edge.
    """

    centre_cm: Vec3
    half_cm: float

    @classmethod
    def of(cls, sample: SampleView) -> Cube:
        """Return the cube of a sample's field grid."""
        half_cm = sample.voxel_size_cm * FIELD_SIZE / 2
        return cls(sample.origin_cm + half_cm - sample.voxel_size_cm / 2, half_cm)

    def places(self, points_cm: Points) -> Points:
        """Return points in units of the cube."""
        return np.asarray((points_cm - self.centre_cm) / self.half_cm)


@dataclass(frozen=True, slots=True)
class Crop:
    """A square window of a radiograph, cut into ``size * size`` pixels of its own.

    Pixel i of the radiograph reaches from i - 1/2 to i + 1/2.

    Parameters
    ----------
    left, top
        First column and row, in pixels of the radiograph.
    side
        Of the window, in the same.
    size
        Rows and columns of the crop.
    """

    left: float
    top: float
    side: float
    size: int

    @classmethod
    def around(cls, cube: Cube, geometry: ViewGeometry, size: int) -> Crop:
        """Enclose the projection of a cube.

        Raises
        ------
        DataError
            If a corner of the cube is not in front of the source.
        """
        corners = cube.centre_cm + cube.half_cm * np.array(list(product((-1, 1), repeat=3)))
        shadow = geometry.project(corners)[:, :2]
        lowest, highest = shadow.min(axis=0), shadow.max(axis=0)
        side = float((highest - lowest).max()) * (1 + MARGIN)
        left, top = ((lowest + highest - side) / 2).tolist()
        return cls(left, top, side, size)

    @property
    def width(self) -> float:
        """Edge of a pixel of the crop, in pixels of the radiograph."""
        return self.side / self.size

    def averaged(
        self, image: Image, valid: Mask
    ) -> tuple[Float32[np.ndarray, "size size"], Bool[np.ndarray, "size size"]]:
        """Mean over the area of each pixel, of valid pixels alone, and where there is one.

        Values are averaged as they come: transmissions, not their logarithms.
        """
        rows, columns = (
            _overlaps(first, self.width, self.size, length)
            for first, length in zip((self.top, self.left), image.shape, strict=True)
        )
        weight = rows @ valid @ columns.T
        total = rows @ np.where(valid, image, 0) @ columns.T
        covered = weight > 1e-6 * self.width**2
        means = np.divide(total, weight, out=np.zeros_like(total), where=covered)
        return means.astype(np.float32), covered

    def geometry(self, geometry: ViewGeometry) -> ViewGeometry:
        """Return the view as if its detector had the crop's pixels."""
        row, column = (np.array(edge + self.width / 2) for edge in (self.top, self.left))
        return replace(
            geometry,
            pixel00_cm=geometry.pixel_centres_cm(row, column),
            column_step_cm=geometry.column_step_cm * self.width,
            row_step_cm=geometry.row_step_cm * self.width,
            shape=(self.size, self.size),
        )


def projection(geometry: ViewGeometry, cube: Cube) -> Float64[np.ndarray, "3 4"]:
    """Matrix from points of the cube to a view: -1 to 1 is its width, and its height.

    (u w, v w, w) = matrix (x, y, z, 1): u grows with the column, v with the row.

    Parameters
    ----------
    geometry
        Of the crop: see :meth:`Crop.geometry`.
    cube
        The object's.
    """
    origin = geometry.pixel00_cm if geometry.source_cm is None else geometry.source_cm
    inverse = np.linalg.inv(geometry.matrix)
    at = inverse @ np.column_stack([cube.half_cm * np.eye(3), cube.centre_cm - origin])
    if geometry.source_cm is None:
        at[2] = [0, 0, 0, 1]  # parallel rays: column and row do not depend on the depth
    rows, columns = geometry.shape
    u, v = ((2 * at[axis] + at[2]) / size - at[2] for axis, size in enumerate((columns, rows)))
    return np.stack([u, v, at[2]])


def _overlaps(
    first: float, width: float, count: int, length: int
) -> Float[np.ndarray, "crop pixels"]:
    """How much of each pixel of the radiograph lies in each pixel of the crop, along one axis."""
    low = first + width * np.arange(count)[:, None]
    pixel = np.arange(length) - 0.5
    return np.asarray(np.clip(np.minimum(low + width, pixel + 1) - np.maximum(low, pixel), 0, None))

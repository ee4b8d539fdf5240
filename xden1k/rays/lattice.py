"""Where the rays of a pixel stand: on a square lattice that is the same in each pixel.

A lattice along the pixels' raster sees an edge that runs along it, as those of most things that
stand upright do, in steps of a ray: all rays of a row or a column cross it at once. One that is
turned against the raster has no two rays of a pixel in one row or column.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from jaxtyping import Bool, Float64, Int32, Int64, Shaped

from xden1k.rays import kernels
from xden1k.rays.surfaces import Window
from xden1k.values.views import ViewGeometry

__all__ = ["Lattice"]


@dataclass(frozen=True)
class Lattice:
    """Rays of a raster of pixels.

    Parameters
    ----------
    along, across
        The next pixel of a row is so many columns of the lattice farther, and so many rows back;
        the next of a column so many rows farther, and so many columns. Its side is one over the
        root of the sum of their squares, in pixels.
    """

    along: int
    across: int

    @classmethod
    @cache
    def of(cls, subrays: int, *, turned: bool) -> Lattice:
        """Put as many rays along the sides of a pixel, or about as many along the lattice's own.

        One of a kind is made once: to find :attr:`places` takes as long as a coarse image.
        """
        return cls(subrays, 1 if turned and subrays > 1 else 0)

    @property
    def rays(self) -> int:
        """In a pixel.

        Examples
        --------
        >>> [Lattice.of(4, turned=turned).rays for turned in (False, True)]
        [16, 17]
        """
        return self.along**2 + self.across**2

    def seen(self, geometry: ViewGeometry) -> ViewGeometry:
        """Give a view whose pixels are the rays; those of a pixel lie evenly about its centre."""
        if not self.across:
            return geometry.refined(self.along)
        column, row = geometry.column_step_cm, geometry.row_step_cm
        fine_column = (self.along * column + self.across * row) / self.rays
        fine_row = (self.along * row - self.across * column) / self.rays
        start = fine_column / 2 if self.rays % 2 == 0 else np.zeros(3)
        return replace(
            geometry,
            pixel00_cm=geometry.pixel00_cm + start,
            column_step_cm=fine_column,
            row_step_cm=fine_row,
        )

    @cached_property
    def places(self) -> Int64[np.ndarray, "s 2"]:
        """Row and column of each ray of the first pixel."""
        if not self.across:
            return np.argwhere(np.ones((self.along,) * 2)).astype(np.int64)
        reach = self.along + self.across
        near = np.argwhere(np.ones((2 * reach + 1,) * 2)) - reach
        mine = [tuple(self.pixel(row, column)) == (0, 0) for row, column in near.tolist()]
        return near[mine].astype(np.int64)

    @cached_property
    def offsets_px(self) -> Float64[np.ndarray, "s 2"]:
        """Row and column of each ray of a pixel from the pixel's centre, in the order of places.

        Examples
        --------
        >>> Lattice(2, 1).offsets_px.T.tolist()
        [[-0.4, -0.2, 0.0, 0.2, 0.4], [0.2, -0.4, 0.0, 0.4, -0.2]]
        """
        places = self.places.astype(np.float64)
        if not self.across:
            return (places + 0.5) / self.along - 0.5
        turn = np.array([[self.along, -self.across], [self.across, self.along]])
        return np.asarray((places + (self.rays % 2 == 0) * np.array([0.0, 0.5])) @ turn / self.rays)

    @cached_property
    def numbers(self) -> Int64[np.ndarray, "keys"]:
        """Number of each ray of a pixel, by the key of its place: see ``kernels.key_of``."""
        numbers = np.zeros(2 * self.rays, dtype=np.int64)
        for ray, (row, column) in enumerate(self.places.tolist()):
            places = kernels.over_pixel(row, column, self.along, self.across)
            below, beside = (place % (2 * self.rays) for place in places)
            numbers[kernels.key_of(below, beside, self.along, self.across)] = ray
        return numbers

    def pixel(self, row: int, column: int) -> tuple[int, int]:
        """Row and column of the pixel in which a ray stands.

        Examples
        --------
        >>> Lattice(4, 0).pixel(4, 7), Lattice(4, 1).pixel(4, 7)
        ((1, 1), (1, 1))
        """
        below, beside = kernels.pixel_of(row, column, self.along, self.across)
        return below, beside

    def window(self, bounds: Window, shape: tuple[int, int]) -> Window:
        """Cut a window of rays to the detector; along the raster, grow it to whole pixels."""
        if not self.across:
            return (
                *_whole(bounds[:2], self.along, shape[0]),
                *_whole(bounds[2:], self.along, shape[1]),
            )
        corners = [
            (self.along * row - self.across * column, self.along * column + self.across * row)
            for row in (-1, shape[0])
            for column in (-1, shape[1])
        ]
        rows, columns = zip(*corners, strict=True)
        return (*_cut(bounds[:2], rows), *_cut(bounds[2:], columns))

    def met(
        self, counts: Int32[np.ndarray, "rows columns"], window: Window, shape: tuple[int, int]
    ) -> Int64[np.ndarray, "n"]:
        """Flat indices of the pixels with a crossing on any ray of a window."""
        met: Bool[np.ndarray, "..."] = np.zeros(shape, dtype=np.bool_)
        self.mark(counts, window, met)
        return np.flatnonzero(met)

    def mark(
        self,
        counts: Shaped[np.ndarray, "rows columns"],
        window: Window,
        met: Bool[np.ndarray, "image_rows image_columns"],
    ) -> None:
        """Mark the pixels with a crossing, or true, on any ray of a window."""
        kernels.mark(counts, window, self.along, self.across, met)


def _whole(window: tuple[int, int], subrays: int, size: int) -> tuple[int, int]:
    first, end = max(window[0] // subrays, 0), min(-(-window[1] // subrays), size)
    return first * subrays, max(first, end) * subrays


def _cut(window: tuple[int, int], ends: Sequence[int]) -> tuple[int, int]:
    first = max(window[0], min(ends))
    return first, max(first, min(window[1], max(ends) + 1))

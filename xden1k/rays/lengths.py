"""Exact path lengths of rays through closed meshes, and the transmission they give.

For one view, all triangles of all parts are scan converted into a sorted list of crossings for
each ray. Walking along a list with a winding counter for each part gives every stretch to the
strongest open part, so that lengths are disjoint where parts overlap.

Memory, beside the result (``4 K`` bytes for each ray of an active pixel): 4 bytes for each ray of
the object's bounding box on the detector, and 10 for each crossing of a band of at most
``CROSSINGS_AT_ONCE``, 84 MB.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Float32, Float64, Int32, Int64

from xden1k.errors import DataError
from xden1k.rays import kernels
from xden1k.rays.lattice import Lattice
from xden1k.rays.surfaces import Surfaces, Window
from xden1k.values.arrays import Image
from xden1k.values.views import ViewGeometry

__all__ = ["PathLengths", "path_lengths", "ray_frame"]

CROSSINGS_AT_ONCE = 1 << 23


@dataclass(frozen=True, slots=True, eq=False)
class PathLengths:
    """What the rays of one view pass through.

    Parameters
    ----------
    pixels
        Shape (n,): flat indices (row * columns + column) of the pixels with a ray that meets a
        part, ascending.
    lengths_cm
        Shape (n, s, K): way through space owned by part k, for each of the s rays of a pixel.
    shared_cm
        Shape (n,): way covered by two or more parts, mean over the rays.
    broken
        Shape (n,): a ray left a part it never entered, or the contrary, so a mesh is open there
        and the lengths are worthless. Closed meshes never give one.
    shape
        Rows and columns of the image.
    """

    pixels: Int64[np.ndarray, "n"]
    lengths_cm: Float32[np.ndarray, "n s k"]
    shared_cm: Float32[np.ndarray, "n"]
    broken: Bool[np.ndarray, "n"]
    shape: tuple[int, int]

    def transmission(
        self, lac_per_cm: Float[np.ndarray, "k"], gain: float = 1.0
    ) -> Float64[np.ndarray, "n"]:
        """Transmission of each listed pixel, monochromatic: Eq. 6 averaged over the pixel's rays.

        Intensities are averaged, not lengths, as a pixel does.

        Raises
        ------
        DataError
            If there is not one coefficient for each part.
        """
        if lac_per_cm.shape != self.lengths_cm.shape[2:]:
            raise DataError(
                f"{self.lengths_cm.shape[2]} parts need as many coefficients, got {len(lac_per_cm)}"
            )
        lac = np.ascontiguousarray(lac_per_cm, dtype=np.float64)
        return np.asarray(gain * kernels.mean_transmission(self.lengths_cm, lac))

    def image(self, lac_per_cm: Float[np.ndarray, "k"], gain: float = 1.0) -> Image:
        """:meth:`transmission` of the whole view; ``gain`` where no part is hit."""
        image = np.full(self.shape, gain, dtype=np.float32)
        image.flat[self.pixels] = self.transmission(lac_per_cm, gain)
        return image


def path_lengths(
    meshes: Sequence[trimesh.Trimesh],
    order: Sequence[int],
    geometry: ViewGeometry,
    subrays: int = 1,
    *,
    turned: bool = False,
) -> PathLengths:
    """Path lengths of one view through parts that may nest and overlap.

    Computed in float64; exact for the polyhedra but for rounding.

    Parameters
    ----------
    meshes
        One for each part: closed, outward-wound, in cm. Vertices need not be merged if duplicates
        are equal. An empty mesh is met by no ray.
    order
        Indices of the meshes, strongest owner first (see :func:`ownership_order`).
    geometry
        The view.
    subrays
        Rays along each side of a pixel: ``subrays**2`` for each pixel, at the centres of its
        equal squares, row by row.
    turned
        Whether they stand on a lattice that is turned against the raster instead, one more for
        each pixel where there are several: no two of a pixel in one row or column. Edges along the
        raster are seen as finely as if there were ``subrays**2`` rays along each side. All
        crossings are held at once.

    Raises
    ------
    DataError
        If the order is not a permutation, there are no rays, or a mesh reaches behind the source.

    Examples
    --------
    >>> view = ViewGeometry.from_dict(
    ...     {"beam": "parallel", "direction": [0, 1, 0], "pixel00_cm": [-0.75, 0, 0.75],
    ...      "column_step_cm": [0.5, 0, 0], "row_step_cm": [0, 0, -0.5], "shape": [4, 4]})
    >>> lengths = path_lengths([trimesh.creation.box((1, 3, 1))], [0], view)
    >>> lengths.pixels.tolist(), lengths.lengths_cm.ravel().tolist()
    ([5, 6, 9, 10], [3.0, 3.0, 3.0, 3.0])
    """
    if subrays < 1:
        raise DataError(f"subrays must be at least 1, got {subrays}")
    lattice = Lattice.of(subrays, turned=turned)
    fine = lattice.seen(geometry)
    surfaces = Surfaces.seen(meshes, order, fine)
    window = lattice.window(surfaces.bounds(), geometry.shape)
    counts = surfaces.count(window)
    pixels = lattice.met(counts, window, geometry.shape)
    lengths = np.zeros((len(pixels), lattice.rays, len(meshes)), dtype=np.float32)
    shared = np.zeros(len(pixels))
    broken = np.zeros(len(pixels), dtype=np.bool_)
    for band, mine in _bands(counts, window, lattice, pixels, geometry.shape[1]):
        rows = slice(band[0] - window[0], band[1] - window[0])
        depths, crossed = surfaces.cross(band, counts[rows])
        kernels.walk_lengths(
            pixels[mine],
            geometry.shape[1],
            lattice.along,
            lattice.across,
            lattice.places,
            band,
            ray_frame(fine),
            np.array(order, dtype=np.int64),
            counts[rows],
            depths,
            crossed,
            lengths[mine],
            shared[mine],
            broken[mine],
        )
    return PathLengths(pixels, lengths, shared.astype(np.float32), broken, geometry.shape)


def _bands(
    counts: Int32[np.ndarray, "rows columns"],
    window: Window,
    lattice: Lattice,
    pixels: Int64[np.ndarray, "n"],
    columns: int,
) -> Iterator[tuple[Window, slice]]:
    """Cut a window into bands of whole pixel rows of about ``CROSSINGS_AT_ONCE`` each.

    Yields each with its pixels; a turned lattice is not cut.
    """
    if lattice.across:
        yield window, slice(len(pixels))
        return
    first, _, *ends = window
    subrays = lattice.along
    rows = counts.sum(axis=1, dtype=np.int64).reshape(-1, subrays).sum(axis=1)
    band = np.cumsum(rows) // CROSSINGS_AT_ONCE
    edges = [0, *(np.flatnonzero(np.diff(band)) + 1).tolist(), len(rows)]
    for start, stop in pairwise(edges):
        told = np.array([start, stop]) * columns + first // subrays * columns
        mine = slice(*np.searchsorted(pixels, told).tolist())
        yield (first + start * subrays, first + stop * subrays, ends[0], ends[1]), mine


def ray_frame(geometry: ViewGeometry) -> Float64[np.ndarray, "3 3"]:
    """Give what a column, a row and no step add to a ray's vector per unit of depth."""
    # the rays of a parallel beam are all one vector
    steps = 1.0 if geometry.beam == "cone" else 0.0
    return np.ascontiguousarray(geometry.matrix * [steps, steps, 1.0])

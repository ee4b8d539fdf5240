"""A plane through an object: its true regions, and clusters that are known at points alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Int16, Integer
from scipy.spatial import cKDTree

from xden1k.rays import CubeGrid, outer_surface
from xden1k.segmentation import SegmentPoints, material_regions
from xden1k.segmentation.points import inside_voxels, owner_voxels
from xden_bench.scoring.regions import DrawnObject

__all__ = ["OUTSIDE", "Cut", "best_plane", "widest_cut"]

OUTSIDE = -1
"""In place of a region or cluster where the object is not."""
ROOM_VOXELS = 4
"""Around the object in a cut."""
THICK_VOXELS = 3
"""Both ways: about as far as the nearest point is."""

Plane = Int16[np.ndarray, "across up"]


@dataclass(frozen=True, eq=False)
class Cut:
    """The voxels of one plane of the grid at whose voxel centres points lie, about the object.

    Parameters
    ----------
    axis, place
        That the plane is perpendicular to, and its number along it.
    across, up
        Voxels that it shows along the two other axes, in their order.
    regions
        Shape (across, up): true material region, ``OUTSIDE`` where the object is not.
    grid
        Of all voxels.
    """

    axis: int
    place: int
    across: slice
    up: slice
    regions: Plane
    grid: CubeGrid

    @property
    def place_cm(self) -> float:
        """Where on its axis the plane is."""
        return float(self.grid.origin_cm[self.axis] + self.grid.voxel_size_cm * self.place)

    @cached_property
    def inside(self) -> Bool[np.ndarray, "across up"]:
        """Where the object is."""
        return np.asarray(self.regions != OUTSIDE)

    def nearest(self, points: SegmentPoints, labels: Integer[np.ndarray, "points"]) -> Plane:
        """Spread labels of points over the plane: each voxel takes the nearest point's.

        Parameters
        ----------
        points
            Of the object, on the plane or not.
        labels
            Shape (points,).
        """
        across, up = np.nonzero(self.inside)
        voxels = np.empty((len(across), 3))
        first, second = (other for other in range(3) if other != self.axis)
        voxels[:, self.axis] = self.place
        voxels[:, first], voxels[:, second] = across + self.across.start, up + self.up.start
        _, owners = cKDTree(points.voxels).query(voxels)
        spread = np.full(self.regions.shape, OUTSIDE, dtype=np.int16)
        spread[self.inside] = labels[owners]
        return spread


def widest_cut(drawn: DrawnObject, gap_g_cm3: float) -> Cut:
    """Cut an object where most of its regions show most.

    Parameters
    ----------
    drawn
        The object.
    gap_g_cm3
        Between densities of two regions, as in :meth:`DrawnObject.regions`.
    """
    owners = owner_voxels(drawn.meshes, drawn.grid)
    regions = material_regions(drawn.densities_g_cm3, gap_g_cm3)[owners].astype(np.int16)
    inside = inside_voxels(outer_surface(drawn.meshes), drawn.grid)
    regions[~inside] = OUTSIDE
    spans = [_span(inside, axis) for axis in range(3)]
    axis, place = best_plane(regions[tuple(spans)])
    place += spans[axis].start
    shown = [_roomy(span, len(inside)) for span in spans]
    across, up = (shown[other] for other in range(3) if other != axis)
    plane = np.take(regions, place, axis)[across, up]
    return Cut(axis, place, across, up, plane, drawn.grid)


def best_plane(regions: Int16[np.ndarray, "x y z"]) -> tuple[int, int]:
    """Axis and number of the plane that shows most regions largest: the sum of square roots.

    Only what is thick behind and before the plane counts: points of a thin sheet are seldom the
    nearest to a plane that lies in it.

    Parameters
    ----------
    regions
        Of each voxel, or ``OUTSIDE``.

    Examples
    --------
    >>> regions = np.zeros((20, 20, 20), dtype=np.int16)
    >>> regions[:, 10] = 1  # a sheet
    >>> regions[:, :, 12:] = 2
    >>> best_plane(regions)
    (0, 3)
    """
    found = []
    for axis in range(3):
        others = tuple(other for other in range(3) if other != axis)
        thick = _thick(regions, axis)
        shown = sum(
            np.sqrt(((regions == region) & thick).sum(axis=others))
            for region in np.unique(regions[regions != OUTSIDE])
        )
        place = int(np.argmax(shown))
        found.append((float(shown[place]), -axis, place))
    _, axis, place = max(found)
    return -axis, place


def _thick(regions: Int16[np.ndarray, "x y z"], axis: int) -> Bool[np.ndarray, "x y z"]:
    """Whether a voxel's region goes on behind and before it."""
    along = np.moveaxis(regions, axis, 0)
    thick = np.zeros(along.shape, dtype=np.bool_)
    middle = along[THICK_VOXELS:-THICK_VOXELS]
    before, behind = along[: len(middle)], along[2 * THICK_VOXELS :]
    thick[THICK_VOXELS:-THICK_VOXELS] = (middle == before) & (middle == behind)
    return np.moveaxis(thick, 0, axis)


def _span(inside: Bool[np.ndarray, "x y z"], axis: int) -> slice:
    """First and end voxel of what is inside, along an axis."""
    places = np.unique(np.nonzero(inside)[axis])
    return slice(int(places[0]), int(places[-1]) + 1)


def _roomy(span: slice, size: int) -> slice:
    return slice(max(span.start - ROOM_VOXELS, 0), min(span.stop + ROOM_VOXELS, size))

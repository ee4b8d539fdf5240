"""From densities at points to a grid, with the checks that catch a wrong frame or scale."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage
from scipy.spatial import cKDTree

from xden1k.access.samples import SampleView
from xden1k.errors import DataError
from xden1k.values.arrays import Grid, Points
from xden1k.values.types import FIELD_SIZE
from xden_baselines.adapters.cloud import Cloud, box_of, density_g_cm3, floaters
from xden_baselines.adapters.frames import Similarity
from xden_baselines.geometry import voxel_centres_cm

__all__ = ["MIN_IOU", "MIN_NEAR", "REACH", "Filled", "box_iou", "fill"]

MIN_IOU: Final = 0.8
"""Of the bounding boxes of the points and of the object."""
MIN_NEAR: Final = 0.8
"""Share of the points that must lie in the object or no further off than :data:`REACH`."""
REACH: Final = 2.0
"""Voxels to which a point speaks for the object."""


@dataclass(frozen=True, slots=True, eq=False)
class Filled:
    """A grid made from points, and how well they covered it.

    Parameters
    ----------
    density_g_cm3
        Shape (64, 64, 64), voxel means, 0 outside the envelope.
    coverage
        Share of the object's voxels with a point within :data:`REACH`.
    iou
        Of the bounding boxes, 1 where they agree to within a voxel.
    floaters
        Points left out, because they lie far from all others and from the object.
    """

    density_g_cm3: Grid
    coverage: float
    iou: float
    floaters: int


def fill(cloud: Cloud, similarity: Similarity, sample: SampleView) -> Filled:
    """Give each voxel of the object the density of its nearest point, times the envelope.

    Parameters
    ----------
    cloud
        What the run says.
    similarity
        From its frame to the object's, cm.
    sample
        The object; its geometry is read.

    Raises
    ------
    DataError
        If densities are out of range or in another unit, or the points lie elsewhere than the
        object.
    """
    where = sample.object_id
    points_cm = similarity(cloud.points)
    cell_cm = max(cloud.cell * similarity.scale, sample.voxel_size_cm)
    lost = floaters(points_cm, few=cloud.few) & ~_in_box(
        points_cm, sample.outer_mesh.bounds, cell_cm
    )
    kept = replace(cloud, points=cloud.points[~lost], density=cloud.density[~lost])
    points_cm, density = points_cm[~lost], density_g_cm3(kept, where)
    iou = _checked_iou(box_of(points_cm, cloud.cell * similarity.scale), cell_cm, sample)
    inside = sample.envelope > 0
    if (near := _share_near(points_cm, inside, sample, cell_cm)) < MIN_NEAR:
        raise DataError(
            f"{where}: {near:.0%} of the points lie at the object, expected at least "
            f"{MIN_NEAR:.0%}: the frame is turned or mirrored"
        )
    distance_cm, nearest = cKDTree(points_cm).query(voxel_centres_cm(sample, inside))
    field = np.zeros(inside.shape, dtype=np.float32)
    field[inside] = density[nearest] * sample.envelope[inside]
    coverage = float((distance_cm <= REACH * sample.voxel_size_cm).mean())
    return Filled(field, coverage, iou, int(lost.sum()))


def box_iou(one: Float[np.ndarray, "2 3"], other: Float[np.ndarray, "2 3"]) -> float:
    """Intersection over union of two boxes, each its lowest and highest corner.

    Examples
    --------
    >>> box_iou(np.array([[0.0, 0, 0], [1, 1, 1]]), np.array([[0.5, 0, 0], [1.5, 1, 1]]))
    0.3333333333333333
    """
    shared = np.minimum(one[1], other[1]) - np.maximum(one[0], other[0])
    common = float(np.prod(shared.clip(min=0)))
    return common / float(np.prod(one[1] - one[0]) + np.prod(other[1] - other[0]) - common)


def _in_box(
    points_cm: Points, box_cm: Float[np.ndarray, "2 3"], margin_cm: float
) -> Bool[np.ndarray, "points"]:
    low, high = box_cm
    inside = (points_cm >= low - margin_cm) & (points_cm <= high + margin_cm)
    return np.asarray(inside.all(axis=1))


def _checked_iou(
    source: Float[np.ndarray, "2 3"], tolerance_cm: float, sample: SampleView
) -> float:
    """Compare the box of the points with the object's. Sides within a voxel of each other agree."""
    target = np.asarray(sample.outer_mesh.bounds, dtype=np.float64)
    # thin things: a voxel more or less of a plate is no other frame
    agreed = np.where(np.abs(source - target) <= tolerance_cm, target, source)
    if (iou := box_iou(agreed, target)) < MIN_IOU:
        raise DataError(
            f"{sample.object_id}: the points' box {_shown(source)} and the object's "
            f"{_shown(target)} overlap by {iou:.2f} (IoU), expected at least {MIN_IOU}: "
            "frame, scale or length unit is wrong, or more points float than --floaters says"
        )
    return iou


def _share_near(points_cm: Points, inside: np.ndarray, sample: SampleView, cell_cm: float) -> float:
    """Share of the points whose voxel is the object's or within reach of one."""
    reach = REACH * cell_cm / sample.voxel_size_cm
    at_object = ndimage.distance_transform_edt(~inside) <= reach
    voxels = np.rint((points_cm - sample.origin_cm) / sample.voxel_size_cm).astype(np.int64)
    in_grid = ((voxels >= 0) & (voxels < FIELD_SIZE)).all(axis=1)
    return float(at_object[tuple(voxels[in_grid].T)].sum() / len(points_cm))


def _shown(box_cm: Float[np.ndarray, "2 3"]) -> str:
    low, high = np.round(box_cm, 2).tolist()
    return f"{low} to {high} cm"

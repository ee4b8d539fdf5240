"""What the radiographs say of each voxel: the mean attenuation along the rays through it.

Needs the extra ``build``.
"""

from __future__ import annotations

import numpy as np
import trimesh
from jaxtyping import Float32, Float64
from scipy import ndimage
from scipy.spatial import KDTree

from xden1k.access.samples import SampleView
from xden1k.errors import DataError
from xden1k.rays import path_lengths
from xden1k.values.arrays import Image, Points
from xden1k.values.views import ViewGeometry, XRayView
from xden_baselines.geometry import nearest_filled, voxel_centres_cm

__all__ = [
    "OPAQUE",
    "back_projected_lac_per_cm",
    "lac_along_rays_per_cm",
    "mean_lac_per_cm",
    "mean_lengths_cm",
]

OPAQUE = 1e-4
"""Transmission below which a pixel tells no more."""
SHORTEST = 0.5
"""Ways through the object shorter than this share of a voxel's edge, or of the longest way, tell
nothing of it."""
SUBRAYS = 2


def back_projected_lac_per_cm(sample: SampleView) -> Float32[np.ndarray, "2 64 64 64"]:
    """Mean attenuation coefficient along the ray through each voxel, for each radiograph.

    Line integral over the way inside the outer surface, cavities included. A voxel without a
    usable ray takes its nearest neighbour's value; outside the envelope all is 0.

    Parameters
    ----------
    sample
        Needs ``GEOMETRY`` and ``XRAY``.

    Raises
    ------
    DataError
        If no ray of a view tells anything of the object.
    """
    inside = sample.envelope > 0
    centres = voxel_centres_cm(sample, inside)
    grids = np.zeros((2, *inside.shape), dtype=np.float32)
    for grid, view in zip(grids, sample.views, strict=True):
        grid[inside] = lac_along_rays_per_cm(view, sample.outer_mesh, centres, sample.voxel_size_cm)
        known = inside & np.isfinite(grid)
        if not known.any():
            raise DataError(f"{sample.object_id}: view {view.name} does not show the object")
        grid[inside] = nearest_filled(grid, known)[inside]
    return grids


def lac_along_rays_per_cm(
    view: XRayView, outer: trimesh.Trimesh, points_cm: Points, blur_cm: float
) -> Float32[np.ndarray, "points"]:
    """Line integral over path length, averaged over what a voxel covers of the view.

    Both are averaged over the same valid pixels, ``blur_cm`` wide at the points, before one is
    divided by the other.

    Parameters
    ----------
    view
        The radiograph.
    outer
        Closed surface.
    points_cm
        Shape (points, 3): where.
    blur_cm
        Edge of a voxel.

    Returns
    -------
    array
        Shape (points,): 1/cm, never negative; not a number where the rays miss the surface, or
        no pixel is valid.
    """
    usable = view.valid.astype(np.float32)
    integral = -np.log(np.where(view.valid, view.transmission, 1).clip(OPAQUE, None))
    lengths = mean_lengths_cm(outer, view.geometry)
    column, row, _ = view.geometry.project(points_cm).T
    size = _pixels_across(view.geometry, points_cm, blur_cm)
    total, way, share = (
        ndimage.map_coordinates(
            ndimage.uniform_filter(image, size, mode="constant"), (row, column), order=1
        )
        for image in (integral * usable, lengths * usable, usable)
    )
    shortest = SHORTEST * min(blur_cm, float(way.max()))  # a thin plate has only short ways
    known = way > shortest * np.maximum(share, 1e-3)
    lac = np.divide(total, way, out=np.full_like(way, np.nan), where=known)
    lac[known] = lac[known].clip(0, None)
    return np.asarray(lac, dtype=np.float32)


def mean_lac_per_cm(sample: SampleView, points_cm: Points) -> Float64[np.ndarray, "points"]:
    """Mean attenuation along the rays of all views through each point.

    Where a view's ray tells nothing, the nearest point's of which one does is taken.

    Parameters
    ----------
    sample
        Needs ``GEOMETRY`` and ``XRAY``.
    points_cm
        Shape (points, 3), at least one: inside the outer surface.

    Raises
    ------
    DataError
        If no ray of a view tells anything of the object, or nothing of it is absorbed.
    """
    views = [_filled_lac_per_cm(sample, view, points_cm) for view in sample.views]
    mean: Float64[np.ndarray, "points"] = np.mean(views, axis=0)
    return mean


def _filled_lac_per_cm(
    sample: SampleView, view: XRayView, points_cm: Points
) -> Float64[np.ndarray, "points"]:
    lac = lac_along_rays_per_cm(view, sample.outer_mesh, points_cm, sample.voxel_size_cm)
    known = np.isfinite(lac)
    if not known.any():
        raise DataError(f"{sample.object_id}: view {view.name} does not show the object")
    if not lac[known].any():
        raise DataError(f"{sample.object_id}: view {view.name} shows nothing where the object is")
    _, nearest = KDTree(points_cm[known]).query(points_cm)
    filled: Float64[np.ndarray, "points"] = lac[known].astype(np.float64)[nearest]
    return filled


def mean_lengths_cm(outer: trimesh.Trimesh, geometry: ViewGeometry) -> Image:
    """Mean way of each pixel's rays inside a closed surface."""
    paths = path_lengths([outer], [0], geometry, SUBRAYS)
    lengths = np.zeros(geometry.shape, dtype=np.float32)
    lengths.flat[paths.pixels] = paths.lengths_cm.mean(axis=(1, 2))
    return lengths


def _pixels_across(geometry: ViewGeometry, points_cm: Points, width_cm: float) -> tuple[int, int]:
    """Rows and columns that a width covers on the detector, at least 1, at the points' middle."""
    middle = points_cm.mean(axis=0)
    steps = np.stack([geometry.row_step_cm, geometry.column_step_cm])
    along = middle + width_cm * steps / np.linalg.norm(steps, axis=1, keepdims=True)
    (column, row, _), (_, below, _), (right, _, _) = geometry.project(np.stack([middle, *along]))
    return max(1, round(abs(below - row))), max(1, round(abs(right - column)))

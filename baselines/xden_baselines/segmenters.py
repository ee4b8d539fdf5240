"""Rows to read other segmenters by: what nothing, the place, the surface or the truth would give.

They learn nothing and have no rank. They need the extra ``build``, as drawing points does.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Float64, UInt8
from scipy import ndimage
from scipy.spatial import KDTree

from xden1k.access.samples import Examples, SampleView
from xden1k.errors import DataError
from xden1k.rays import CubeGrid
from xden1k.segmentation import CLUSTER_COUNTS, Segmentation, SegmentPoints, numbered
from xden1k.segmentation.points import inside_voxels, owner_voxels, point_owners, segment_grid
from xden1k.values.modality import Modality
from xden_baselines.clustering import cluster_places, segmentation_by_value
from xden_baselines.xray import mean_lac_per_cm

__all__ = [
    "DensityClusters",
    "OneRegion",
    "PositionClusters",
    "SurfaceParts",
    "XrayClusters",
]

PLACES_FREE: Final = 3
"""Clusters by place where the number is free: about as many as objects have material regions."""


class _Untrained:
    """What all have in common."""

    version = "1"
    trainable = False
    external_data = False

    @property
    def notes(self) -> str:
        """Nothing."""
        return ""

    def fit(self, train: Examples, *, seed: int) -> None:
        """Learn nothing."""


class OneRegion(_Untrained):
    """All of an object is one region: what predicting nothing is worth."""

    name = "one-region"
    reads = Modality.GEOMETRY

    def segment(self, sample: SampleView, points: SegmentPoints) -> Segmentation:
        """Give every point the same label."""
        shape = (len(CLUSTER_COUNTS), len(points))
        return Segmentation(np.zeros(shape, np.uint8), np.zeros(len(points), np.uint8))


class PositionClusters(_Untrained):
    """Clusters of the points by where they are (k-means): what compact regions alone are worth."""

    name = "position-clusters"
    reads = Modality.GEOMETRY

    def segment(self, sample: SampleView, points: SegmentPoints) -> Segmentation:
        """Divide the points by their places."""
        rows = [cluster_places(points.points_cm, count, seed=count) for count in CLUSTER_COUNTS]
        return Segmentation(np.stack(rows), rows[CLUSTER_COUNTS.index(PLACES_FREE)])


class SurfaceParts(_Untrained):
    """Oracle of the surface: its true parts, each point being of the part that is nearest.

    What a perfect segmentation of the surface is worth, extended inwards. Of more parts than k, all
    but the largest are one cluster.
    """

    name = "surface-parts"
    reads = Modality.GEOMETRY | Modality.TRUTH

    def segment(self, sample: SampleView, points: SegmentPoints) -> Segmentation:
        """Give each point the part of the nearest voxel at the surface."""
        parts = _by_size(_surface_owners(sample, points))
        rows = [np.minimum(parts, count - 1) for count in CLUSTER_COUNTS]
        return Segmentation(np.stack(rows).astype(np.uint8), parts)


class XrayClusters(_Untrained):
    """Clusters of the mean attenuation along the two rays through each point."""

    name = "xray-clusters"
    reads = Modality.GEOMETRY | Modality.XRAY

    def segment(self, sample: SampleView, points: SegmentPoints) -> Segmentation:
        """Divide the points by attenuation.

        Raises
        ------
        DataError
            If no ray of a view tells anything of the object.
        """
        return segmentation_by_value(mean_lac_per_cm(sample, points.points_cm))


class DensityClusters(_Untrained):
    """Oracle of the density: clusters of its true value at each point."""

    name = "density-clusters"
    reads = Modality.GEOMETRY | Modality.TRUTH

    def segment(self, sample: SampleView, points: SegmentPoints) -> Segmentation:
        """Divide the points by their true densities.

        Raises
        ------
        DataError
            If a part has no density.
        """
        meshes, grid = [part.mesh for part in sample.truth.parts], _grid(sample)
        owners = point_owners(meshes, grid, points)
        return segmentation_by_value(_owner_densities_g_cm3(sample)[owners])


def _grid(sample: SampleView) -> CubeGrid:
    return segment_grid(sample.origin_cm, sample.voxel_size_cm)


def _by_size(labels: UInt8[np.ndarray, "points"]) -> UInt8[np.ndarray, "points"]:
    """Return labels numbered by how many points have them, the most first."""
    own = numbered(labels)
    ranks = np.argsort(np.argsort(-np.bincount(own), kind="stable"))
    found: UInt8[np.ndarray, "points"] = ranks[own].astype(np.uint8)
    return found


def _surface_owners(sample: SampleView, points: SegmentPoints) -> UInt8[np.ndarray, "points"]:
    """Part of the nearest voxel that has air beside it."""
    grid = _grid(sample)
    inside = inside_voxels(sample.outer_mesh, grid)
    owners = owner_voxels([part.mesh for part in sample.truth.parts], grid)
    skin = inside & ~ndimage.binary_erosion(inside) & (owners > 0)
    _, nearest = KDTree(np.argwhere(skin)).query(points.voxels)
    found: UInt8[np.ndarray, "points"] = owners[skin][nearest]
    return found


def _owner_densities_g_cm3(sample: SampleView) -> Float64[np.ndarray, "owners"]:
    """Density of void and of each part."""
    densities = np.array([0.0, *(part.density_g_cm3 for part in sample.truth.parts)])
    if np.isnan(densities).any():
        raise DataError(f"{sample.object_id}: a part has no known density")
    return densities

"""The volume of attenuation coefficients, as the published ones: one value for each part."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float32

from xden1k.rays import CubeGrid, PartFill, density_grid, part_fractions, voxel_labels
from xden_builder.published.twin.conventions import Conventions
from xden_builder.published.twin.pose import Pose

__all__ = ["lac_volume"]

COLUMNS: Final = 3
"""Density of columns through a voxel in x and y; along z the share is exact."""


def lac_volume(
    meshes: Sequence[trimesh.Trimesh],
    lac_per_cm: Sequence[float],
    pose: Pose,
    conventions: Conventions,
) -> Float32[np.ndarray, "x y z"]:
    """Fill the volume of an object.

    Parameters
    ----------
    meshes
        Of its parts, cm, phantom's frame, disjoint.
    lac_per_cm
        Of each part.
    pose, conventions
        Where it lies, and how edges look.
    """
    grid = CubeGrid(np.zeros(3), 1.0, conventions.voxels)
    placed = [mesh.copy().apply_transform(pose.volume) for mesh in meshes]
    order = range(len(meshes))
    if conventions.soft_edges:
        fills = part_fractions(placed, order, grid, COLUMNS)
        if steps := conventions.share_steps:
            fills = [PartFill(fill.start, np.round(fill.share * steps) / steps) for fill in fills]
        return density_grid(fills, lac_per_cm, grid).astype(np.float32)
    values = np.array([0.0, *lac_per_cm], dtype=np.float32)
    return np.asarray(values[voxel_labels(placed, order, grid)])

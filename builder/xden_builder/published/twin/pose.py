"""From the phantom's frame to the mesh file, and on to the voxels of the volume."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from xden1k.values.arrays import Vec3
from xden_builder.phantoms.phantom import Plan
from xden_builder.published.twin.conventions import Conventions

__all__ = ["LONGEST", "UPRIGHT", "Pose", "pose_of"]

LONGEST: Final = 2.0
"""Longest extent of the published meshes."""
UPRIGHT: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From z up to glTF's y up."""

Matrix = Float[np.ndarray, "4 4"]


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Where an object lies in its files.

    Parameters
    ----------
    mesh
        Shape (4, 4): from cm in the phantom's frame to the coordinates of the mesh file.
    volume
        Shape (4, 4): from cm in the phantom's frame to indices of voxels.
    extents_cm
        Shape (3,): along the axes of the mesh file.
    """

    mesh: Matrix
    volume: Matrix
    extents_cm: Vec3


def pose_of(bounds_cm: Float[np.ndarray, "2 3"], plan: Plan, conventions: Conventions) -> Pose:
    """Place an object by its bounding box.

    Parameters
    ----------
    bounds_cm
        Shape (2, 3): lowest and highest corner, phantom's frame.
    plan
        Which object it is.
    conventions
        Of the release.
    """
    extents_cm = np.abs(UPRIGHT @ (bounds_cm[1] - bounds_cm[0]))
    to_mesh = np.eye(4)
    to_mesh[:3, :3] = UPRIGHT * LONGEST / extents_cm.max()
    to_mesh[:3, 3] = -to_mesh[:3, :3] @ bounds_cm.mean(axis=0)
    to_volume = _volume_of_mesh(extents_cm * LONGEST / extents_cm.max(), plan, conventions)
    return Pose(to_mesh, to_volume @ to_mesh, extents_cm)


def _volume_of_mesh(extents: Vec3, plan: Plan, conventions: Conventions) -> Matrix:
    """From a mesh file of these extents about the origin to indices of voxels."""
    across = np.abs(conventions.axes) @ extents
    used = conventions.voxels * (1 - 2 * conventions.padding)
    scale = used / (across if conventions.stretched else np.full(3, LONGEST))
    matrix = np.eye(4)
    matrix[:3, :3] = scale[:, None] * conventions.axes
    matrix[:3, 3] = (conventions.voxels - 1) / 2 + _wandering(plan, conventions)
    return matrix


def _wandering(plan: Plan, conventions: Conventions) -> Vec3:
    """Draw how far an object lies off the centre, in voxels."""
    most = conventions.padding * conventions.voxels / 2 if conventions.wandering else 0.0
    return plan.rng("twin place").uniform(-most, most, 3)

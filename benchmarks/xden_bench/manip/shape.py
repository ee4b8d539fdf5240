"""An object as a gripper meets it: its outer surface, and how far its mass is out of the middle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from xden1k.values.arrays import Vec3

__all__ = ["Shape", "shape_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """The outer surface of an object, cm, in its frame.

    Parameters
    ----------
    surface
        Closed, enclosed cavities filled.
    centroid_cm
        Shape (3,): of the volume inside it, where a homogeneous object has its centre of mass.
    long_axis
        Shape (3,): unit vector along which that volume is longest, by its second moments; its
        largest component is positive.
    """

    surface: trimesh.Trimesh
    centroid_cm: Vec3
    long_axis: Vec3

    @property
    def volume_cm3(self) -> float:
        """Inside the surface."""
        return float(self.surface.volume)

    @property
    def thickness_cm(self) -> float:
        """Least extent along a principal axis of the volume."""
        _, axes = np.linalg.eigh(np.asarray(self.surface.moment_inertia))
        return float(np.ptp(np.asarray(self.surface.vertices) @ axes, axis=0).min())

    def along_cm(self, point_cm: Vec3) -> float:
        """Where a point lies along the longest axis, from the centroid.

        Examples
        --------
        >>> bar = shape_of([trimesh.creation.box((1, 1, 9))])
        >>> bar.along_cm(np.array([0.4, 0.0, -2.0]))
        -2.0
        """
        return float((point_cm - self.centroid_cm) @ self.long_axis)


def shape_of(meshes: Sequence[trimesh.Trimesh]) -> Shape:
    """Take the outer surface of closed part meshes, in cm.

    Raises
    ------
    DataError
        If a mesh is not closed or wound inwards.
    MissingExtraError
        If the extra ``build``, which joins meshes, is not installed.
    """
    from xden1k.rays import outer_surface

    surface = outer_surface(meshes)
    _, axes = np.linalg.eigh(np.asarray(surface.moment_inertia))
    axis = axes[:, 0]  # least moment of inertia: the mass is far along it
    return Shape(
        surface, np.asarray(surface.center_mass), axis * np.sign(axis[np.abs(axis).argmax()])
    )

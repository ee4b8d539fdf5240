"""Mass, centre of mass and inertia, from meshes or from grids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float

from xden1k.errors import DataError
from xden1k.values.arrays import Grid, Vec3

__all__ = ["MassProperties", "mass_of_grid", "mass_of_meshes"]


@dataclass(frozen=True, slots=True, eq=False)
class MassProperties:
    """Mass, centre of mass and inertia tensor of a rigid body.

    Parameters
    ----------
    mass_g
        Total mass.
    com_cm
        Shape (3,): centre of mass in the object frame; not a number where the mass is zero.
    inertia_g_cm2
        Shape (3, 3): inertia tensor about the centre of mass, along the object frame's axes.
    """

    mass_g: float
    com_cm: Vec3
    inertia_g_cm2: Float[np.ndarray, "3 3"]


def mass_of_meshes(
    meshes: Sequence[trimesh.Trimesh], densities_g_cm3: Sequence[float]
) -> MassProperties:
    """Exact mass properties of closed meshes that do not overlap.

    Each mesh is homogeneous; the polyhedron's integrals are exact (Mirtich, 1996,
    doi:10.1080/10867651.1996.10487458, as in trimesh) and are joined by the parallel-axis theorem.

    Parameters
    ----------
    meshes
        Closed, outward-wound, in cm, disjoint.
    densities_g_cm3
        One for each mesh.

    Raises
    ------
    DataError
        If the counts differ.

    Examples
    --------
    >>> box = trimesh.creation.box((1, 2, 3))
    >>> mass_of_meshes([box], [2.0]).mass_g
    12.0
    """
    if len(meshes) != len(densities_g_cm3):
        raise DataError(f"{len(meshes)} meshes need as many densities, got {len(densities_g_cm3)}")
    with np.errstate(divide="ignore", invalid="ignore"):  # trimesh divides by a volume of nothing
        bodies = [
            (
                float(mesh.volume) * density,
                np.asarray(mesh.center_mass),
                # trimesh integrates with density 1 unless a mesh says otherwise
                np.asarray(mesh.moment_inertia) / mesh.density * density,
            )
            for mesh, density in zip(meshes, densities_g_cm3, strict=True)
            if float(mesh.volume) != 0.0
        ]
    return _joined(
        np.array([mass for mass, _, _ in bodies]),
        np.array([com for _, com, _ in bodies]).reshape(-1, 3),
        sum((inertia for _, _, inertia in bodies), np.zeros((3, 3))),
    )


def mass_of_grid(density_g_cm3: Grid, origin_cm: Vec3, voxel_size_cm: float) -> MassProperties:
    """Mass properties of a voxel grid whose values are voxel means.

    Parameters
    ----------
    density_g_cm3
        Shape (x, y, z).
    origin_cm
        Shape (3,): centre of voxel (0, 0, 0).
    voxel_size_cm
        Edge of the cubic voxels.

    Examples
    --------
    >>> water = mass_of_grid(np.ones((2, 2, 2)), np.zeros(3), voxel_size_cm=0.5)
    >>> water.mass_g, water.com_cm.tolist()
    (1.0, [0.25, 0.25, 0.25])
    """
    axes = [
        start + voxel_size_cm * np.arange(size)
        for start, size in zip(origin_cm, density_g_cm3.shape, strict=True)
    ]
    # Every moment up to the second is one of the three projections along an axis.
    values = density_g_cm3.astype(np.promote_types(density_g_cm3.dtype, np.float32), copy=False)
    yz, xz, xy = (values.sum(axis, dtype=np.float64) * voxel_size_cm**3 for axis in range(3))
    profiles = (xy.sum(1), xy.sum(0), xz.sum(0))
    mass_g = float(profiles[0].sum())
    if mass_g == 0.0:
        return MassProperties(0.0, np.full(3, np.nan), np.zeros((3, 3)))
    com = np.array([profile @ axis for profile, axis in zip(profiles, axes, strict=True)]) / mass_g
    x, y, z = (axis - middle for axis, middle in zip(axes, com, strict=True))
    second = np.diag([profile @ arm**2 for profile, arm in zip(profiles, (x, y, z), strict=True)])
    second[0, 1], second[0, 2], second[1, 2] = x @ xy @ y, x @ xz @ z, y @ yz @ z
    second += np.triu(second, 1).T
    own = np.eye(3) * mass_g * voxel_size_cm**2 / 6  # a cube about its own centre
    return MassProperties(mass_g, com, own + np.trace(second) * np.eye(3) - second)


def _joined(
    masses: Float[np.ndarray, "n"],
    points: Float[np.ndarray, "n 3"],
    own_inertia: Float[np.ndarray, "3 3"],
) -> MassProperties:
    """Bodies joined by the parallel-axis theorem."""
    total = float(masses.sum())
    if total == 0.0:
        return MassProperties(0.0, np.full(3, np.nan), np.zeros((3, 3)))
    com = masses @ points / total
    arms = points - com
    second = (arms * masses[:, None]).T @ arms
    return MassProperties(total, com, own_inertia + np.trace(second) * np.eye(3) - second)

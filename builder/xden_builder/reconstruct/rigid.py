"""Standard deviations of mass, centre of mass and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float, Float64

from xden1k.values.arrays import Vec3
from xden1k.values.mass import mass_of_meshes

__all__ = ["SCALE_SD", "RigidSD", "rigid_sd"]

SCALE_SD: Final = 0.005
"""Relative standard deviation of the size of the meshes: an assumption."""
SURFACE_SD_CM: Final = 0.005
"""How well meshes know where the middle of the space they enclose is: an assumption."""


@dataclass(frozen=True, slots=True, eq=False)
class RigidSD:
    """Standard deviations of a body's mass properties.

    Parameters
    ----------
    mass_g
        Of the mass.
    com_cm
        Shape (3,): of the centre of mass.
    inertia_g_cm2
        Shape (3, 3): of the inertia tensor about it.
    """

    mass_g: float
    com_cm: Vec3
    inertia_g_cm2: Float[np.ndarray, "3 3"]


def rigid_sd(
    meshes: Sequence[trimesh.Trimesh],
    density_g_cm3: Float64[np.ndarray, "k"],
    covariance: Float64[np.ndarray, "k k"],
    scale_sd: float = SCALE_SD,
    weighed_sd_g: float | None = None,
) -> RigidSD:
    """Carry the uncertainty of the densities over to the body, to first order.

    Meshes larger by a share s than the object make densities smaller by s, as X-rays see their
    product with a length; so mass is off by 2 s and inertia by 4 s.

    Parameters
    ----------
    meshes
        Closed, in cm, disjoint.
    density_g_cm3, covariance
        Shape (K,) and (K, K).
    scale_sd
        Relative, of the meshes' size.
    weighed_sd_g
        Standard deviation of the mass, if the densities were fitted to a weighed one: whatever
        else is not known, they are not free to change the mass by more.
    """
    units = [mass_of_meshes([mesh], [1.0]) for mesh in meshes]
    volumes = np.array([unit.mass_g for unit in units])
    centres = np.stack([unit.com_cm for unit in units])
    mass = float(volumes @ density_g_cm3)
    com = (volumes * density_g_cm3) @ centres / mass
    off = centres - com
    scales = (2 * scale_sd, 4 * scale_sd)
    if weighed_sd_g is not None:
        slope = covariance @ volumes
        known = volumes @ slope + weighed_sd_g**2
        covariance = covariance - np.outer(slope, slope) / known
        scales = (0.0, 2 * scale_sd)
    squares = (off**2).sum(axis=1)[:, None, None] * np.eye(3) - off[:, :, None] * off[:, None, :]
    inertias = np.stack([unit.inertia_g_cm2 for unit in units])
    inertias = inertias + volumes[:, None, None] * squares
    inertia = np.einsum("k,kij->ij", density_g_cm3, inertias)
    slopes = volumes[:, None] * off / mass
    return RigidSD(
        float(np.hypot(np.sqrt(volumes @ covariance @ volumes), scales[0] * mass)),
        np.hypot(
            np.sqrt(np.einsum("ki,kl,li->i", slopes, covariance, slopes).clip(min=0)), SURFACE_SD_CM
        ),
        np.hypot(
            np.sqrt(np.einsum("kij,kl,lij->ij", inertias, covariance, inertias).clip(min=0)),
            scales[1] * np.abs(inertia),
        ),
    )

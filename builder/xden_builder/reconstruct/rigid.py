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

__all__ = ["RigidSD", "Weighed", "rigid_sd"]

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


@dataclass(frozen=True, slots=True, eq=False)
class Weighed:
    """What a scale has narrowed already.

    Parameters
    ----------
    sd_g
        Of the mass on it.
    fitted
        Shape (K, K): the share of the densities' covariance that images, priors and scale leave
        together.
    """

    sd_g: float
    fitted: Float64[np.ndarray, "k k"]


def rigid_sd(
    meshes: Sequence[trimesh.Trimesh],
    density_g_cm3: Float64[np.ndarray, "k"],
    covariance: Float64[np.ndarray, "k k"],
    by_size_g_cm3: Float64[np.ndarray, "k"],
    size_sd: float,
    weighing: Weighed | None = None,
) -> RigidSD:
    """Carry the uncertainty of the densities over to the body, to first order.

    An object larger by a share s than its meshes has densities smaller by s where X-rays tell them,
    since they see the product with a length; so mass is off by 2 s and inertia by 4 s. Where labels
    tell densities it is 3 s and 5 s.

    Parameters
    ----------
    meshes
        Closed, in cm, disjoint.
    density_g_cm3, covariance
        Shape (K,) and (K, K).
    by_size_g_cm3, size_sd
        Shape (K,): the share of the covariance that comes with the object's size, for one that is
        so much larger (relative, a standard deviation).
    weighing
        If the densities were fitted to a weighed mass: what they are off beside that fit is not
        free to change the mass by more than the scale may be off.
    """
    units = [mass_of_meshes([mesh], [1.0]) for mesh in meshes]
    volumes = np.array([unit.mass_g for unit in units])
    centres = np.stack([unit.com_cm for unit in units])
    mass = float(volumes @ density_g_cm3)
    com = (volumes * density_g_cm3) @ centres / mass
    off = centres - com
    known = _with_size(covariance, by_size_g_cm3, size_sd)
    of_mass = np.append(volumes, 3 * mass)
    if weighing is not None:
        fitted = np.pad(weighing.fitted, (0, 1))
        beside = known - fitted
        slope = beside @ of_mass
        beside = beside - np.outer(slope, slope) / (of_mass @ slope + weighing.sd_g**2)
        known = fitted + beside
    squares = (off**2).sum(axis=1)[:, None, None] * np.eye(3) - off[:, :, None] * off[:, None, :]
    inertias = np.stack([unit.inertia_g_cm2 for unit in units])
    inertias = inertias + volumes[:, None, None] * squares
    inertia = np.einsum("k,kij->ij", density_g_cm3, inertias)
    of_com = np.concatenate([volumes[:, None] * off / mass, np.zeros((1, 3))])
    of_inertia = np.concatenate([inertias, 5 * inertia[None]])
    variances = (
        np.einsum("k...,kl,l...->...", slopes, known, slopes).clip(min=0)
        for slopes in (of_mass, of_com, of_inertia)
    )
    mass_sd_g, com_sd_cm, inertia_sd_g_cm2 = map(np.sqrt, variances)
    return RigidSD(float(mass_sd_g), np.hypot(com_sd_cm, SURFACE_SD_CM), inertia_sd_g_cm2)


def _with_size(
    covariance: Float64[np.ndarray, "k k"], by_size: Float64[np.ndarray, "k"], size_sd: float
) -> Float64[np.ndarray, "k+1 k+1"]:
    """Covariance of the densities and the logarithm of the object's size."""
    both = size_sd * by_size[:, None]
    return np.block([[covariance, both], [both.T, np.array([[size_sd**2]])]])

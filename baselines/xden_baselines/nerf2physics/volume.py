"""From shares at surface points to a density field and to NeRF2Physics' own masses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from xden1k.values.arrays import Grid
from xden_baselines.chat.candidates import Candidate
from xden_baselines.nerf2physics.kernel import areal_density_g_cm2, ranges
from xden_baselines.nerf2physics.surface import SurfaceCloud

__all__ = ["MASS_FACTOR", "Rule", "carved_mass_g", "density_field", "shell_mass_g"]

Rule = Literal["solid", "thickness"]
MASS_FACTOR = 0.6
"""NeRF2Physics multiplies its masses by it; no field is."""

Shares = Float[np.ndarray, "points materials"]


def density_field(
    cloud: SurfaceCloud,
    shares: Shares,
    candidates: Sequence[Candidate],
    *,
    rule: Rule,
    envelope: Grid,
    origin_cm: Float[np.ndarray, "3"],
    voxel_size_cm: float,
) -> Grid:
    """Give each voxel the mixture of its nearest surface point.

    Parameters
    ----------
    cloud, shares, candidates
        How much of each candidate each surface point is.
    rule
        ``solid``: the whole envelope is filled; ``thickness``: only what lies within the
        mixture's thickness of the surface, the rest is empty.
    envelope, origin_cm, voxel_size_cm
        The sample's.

    Returns
    -------
    Grid
        Voxel means, g/cm³, float32. A voxel that the shell fills in part gets the share of it
        that the shell takes along the normal.
    """
    inside = envelope > 0
    centres = origin_cm + voxel_size_cm * np.argwhere(inside)
    _, nearest = cKDTree(cloud.points_cm).query(centres)
    filled = envelope[inside].astype(np.float64)
    density = shares @ ranges([one.density_g_cm3 for one in candidates]).mean(axis=1)
    if rule == "thickness":
        thickness = shares @ ranges([one.thickness_cm for one in candidates]).mean(axis=1)
        below = ((cloud.points_cm[nearest] - centres) * cloud.normals[nearest]).sum(axis=1)
        filled = np.minimum(filled, _shell_share(below, thickness[nearest], voxel_size_cm))
    field = np.zeros(envelope.shape, dtype=np.float32)
    field[inside] = density[nearest] * filled
    return field


def _shell_share(
    below_cm: Float[np.ndarray, "voxels"],
    thickness_cm: Float[np.ndarray, "voxels"],
    voxel_size_cm: float,
) -> Float[np.ndarray, "voxels"]:
    """Share of a voxel's edge, set along the normal, that lies from 0 to the thickness below."""
    top = np.maximum(below_cm - voxel_size_cm / 2, 0)
    bottom = np.minimum(below_cm + voxel_size_cm / 2, thickness_cm)
    return np.asarray((bottom - top).clip(min=0) / voxel_size_cm)


def carved_mass_g(field: Grid, voxel_size_cm: float) -> float:
    """NeRF2Physics' mass of a solid: its factor times the integral of the density."""
    return MASS_FACTOR * float(field.sum(dtype=np.float64)) * voxel_size_cm**3


def shell_mass_g(
    cloud: SurfaceCloud,
    shares: Shares,
    candidates: Sequence[Candidate],
    *,
    volume_cm3: float,
) -> float:
    """NeRF2Physics' mass of a shell: its factor times area, thickness and density, summed.

    The middle of its low and high value. Where the shell at its thickest would be more than the
    object's volume, both shrink by the ratio.
    """
    low, high = cloud.areas_cm2 @ (shares @ areal_density_g_cm2(candidates))
    thickest = shares @ ranges([one.thickness_cm for one in candidates])[:, 1]
    shell_cm3 = float(cloud.areas_cm2 @ thickest)
    cap = min(1.0, volume_cm3 / shell_cm3)
    return MASS_FACTOR * cap * float(low + high) / 2

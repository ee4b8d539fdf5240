"""How surfaces reflect: Fresnel's law, the width of a microfacet lobe, its share of light."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

__all__ = [
    "dot",
    "facing",
    "fresnel",
    "lobe_width_rad",
    "mirrored",
    "refracted",
    "specular_share",
    "unit",
]

Vectors = Float[np.ndarray, "n 3"]
Values = Float[np.ndarray, "n"]

GRAZING = 0.02
"""Least cosine between a normal that is seen and the ray that sees it."""
MEDIAN_OF_RAYLEIGH = 1.1774
"""Median angle of a round Gaussian spot, in its standard deviations."""


def dot(one: Vectors, other: Vectors) -> Values:
    """Scalar products, row by row."""
    return np.asarray(np.einsum("ij,ij->i", one, other))


def unit(vectors: Vectors) -> Vectors:
    """Vectors scaled to unit length."""
    return np.asarray(vectors / np.sqrt(dot(vectors, vectors))[:, None])


def facing(normals: Vectors, rays: Vectors) -> Vectors:
    """Turn normals towards where the rays come from, if they face away from it."""
    away = (dot(normals, rays) + GRAZING).clip(min=0)
    return unit(normals - away[:, None] * rays)


def mirrored(rays: Vectors, normals: Vectors) -> Vectors:
    """Directions after reflection by a mirror."""
    return np.asarray(rays - 2 * dot(rays, normals)[:, None] * normals)


def refracted(rays: Vectors, normals: Vectors, ratio: Values) -> tuple[Vectors, Values]:
    """Directions behind an interface by Snell's law, and the share of light reflected there.

    Parameters
    ----------
    rays
        Unit vectors.
    normals
        Unit vectors towards where the rays come from.
    ratio
        Refractive index before the interface over that behind it.

    Returns
    -------
    directions
        Behind the interface; mirrored where reflection is total.
    reflectance
        By Fresnel, unpolarised; 1 where reflection is total.
    """
    cosine = -dot(rays, normals)
    squared = 1 - ratio**2 * (1 - cosine**2)
    behind = np.sqrt(squared.clip(min=0))
    bent = ratio[:, None] * rays + (ratio * cosine - behind)[:, None] * normals
    total = squared <= 0
    directions = np.where(total[:, None], mirrored(rays, normals), bent)
    return unit(directions), np.where(total, 1.0, fresnel(cosine, behind, ratio))


def fresnel(cosine: Values, behind: Values, ratio: Values) -> Values:
    """Reflectance of an interface for unpolarised light, from the cosines on both sides."""
    across = (ratio * cosine - behind) / (ratio * cosine + behind).clip(min=1e-9)
    along = (cosine - ratio * behind) / (cosine + ratio * behind).clip(min=1e-9)
    return np.asarray((across**2 + along**2) / 2)


def lobe_width_rad(roughness: Values) -> Values:
    """Return the standard deviation of a round Gaussian of the median angle of a GGX lobe.

    Half of GGX's microfacets are tilted by less than atan(alpha), alpha = roughness squared (Walter
    et al. 2007, eq. 35); a tilt turns the reflection by twice as much.
    """
    return np.asarray(2 * np.arctan(roughness**2) / MEDIAN_OF_RAYLEIGH)


def specular_share(normal_reflectance: Vectors, roughness: Values, cosine: Values) -> Vectors:
    """Share of even light that a GGX surface reflects, for each colour.

    Karis' fit, "Physically Based Shading on Mobile" (2014), to the integral over the hemisphere.
    """
    first = 1 - roughness
    tail = np.minimum(first**2, np.exp2(-9.28 * cosine)) * first + 0.0425 - 0.0275 * roughness
    scale = -1.04 * tail + 1.04 - 0.572 * roughness
    offset = 1.04 * tail - 0.04 + 0.022 * roughness
    return np.asarray(normal_reflectance * scale[:, None] + offset[:, None].clip(min=0))

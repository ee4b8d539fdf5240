"""Whether the mass on the scale and the mass that the images alone give can both be right."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float64

from xden_builder.poly.posterior.problem import Mass

__all__ = ["Weighing", "compare"]

COMMON_SHARE: Final = 0.03
"""Error that all densities of an object share: spectrum, composition, scale of the meshes."""
SIGMAS: Final = 3.0
LEAST_SHARE: Final = 0.05
"""Masses that differ by less are not said to disagree."""


@dataclass(frozen=True, slots=True)
class Weighing:
    """Two masses of one object.

    Parameters
    ----------
    weighed_g
        On the scale.
    by_images_g, by_images_sd_g
        Without it.
    """

    weighed_g: float
    by_images_g: float
    by_images_sd_g: float

    @property
    def disagrees(self) -> bool:
        """Whether the two are apart by more than their errors, and by more than a twentieth.

        Examples
        --------
        >>> [Weighing(scale_g, 100.0, 3.0).disagrees for scale_g in (108.0, 112.0)]
        [False, True]
        >>> Weighing(104.0, 100.0, 1.0).disagrees
        False
        """
        apart_g = abs(self.weighed_g - self.by_images_g)
        return apart_g > max(SIGMAS * self.by_images_sd_g, LEAST_SHARE * self.weighed_g)

    def contradiction(self, mass_g: float) -> float:
        """Share by which a mass is off the farther of the two; 0 where they do not disagree.

        Examples
        --------
        >>> Weighing(200.0, 100.0, 3.0).contradiction(160.0)
        0.375
        >>> Weighing(100.0, 103.0, 3.0).contradiction(100.0)
        0.0
        """
        off_g = max(abs(mass_g - self.weighed_g), abs(mass_g - self.by_images_g))
        return off_g / mass_g if self.disagrees else 0.0

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return asdict(self) | {"disagrees": self.disagrees}


def compare(
    mass: Mass,
    density_g_cm3: Float64[np.ndarray, "k"],
    covariance: Float64[np.ndarray, "k k"],
    by_size_g_cm3: Float64[np.ndarray, "k"],
    size_sd: float,
) -> Weighing:
    """Put the mass on the scale beside that of a fit which did not know it.

    Parameters
    ----------
    mass
        From the scale, with the volumes of the parts.
    density_g_cm3, covariance
        Of the parts by images alone, and their covariance in g²/cm⁶.
    by_size_g_cm3, size_sd
        How densities change for an object that is so much larger than its meshes (relative, a
        standard deviation); that change is in the covariance. Volumes grow by thrice as much.
    """
    volumes, by_images_g = mass.volumes_cm3, float(mass.volumes_cm3 @ density_g_cm3)
    by_size_g = float(volumes @ by_size_g_cm3)
    larger_g = by_size_g + 3 * size_sd * by_images_g
    variance = float(volumes @ covariance @ volumes) - by_size_g**2 + larger_g**2
    common = np.hypot(COMMON_SHARE, mass.volume_sd)
    sd_g = float(np.hypot(np.sqrt(variance), common * by_images_g))
    return Weighing(mass.mass_g, by_images_g, sd_g)

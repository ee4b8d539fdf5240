"""The densities of an object's parts, by whichever fit tells them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from xden_builder.fit.density import PartDensity, part_densities
from xden_builder.fit.spread import spread
from xden_builder.reconstruct.explained import Explained

__all__ = ["Densities", "densities_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Densities:
    """What is known of the densities.

    Parameters
    ----------
    parts
        In the order of the capture's.
    covariance
        Shape (K, K): of the densities, in g²/cm⁶; not a number where one is not known.
    """

    parts: tuple[PartDensity, ...]
    covariance: Float64[np.ndarray, "k k"]


def densities_of(explained: Explained) -> Densities:
    """Take the spectrum's fit if there is one, and as unsure as the pose leaves it.

    Raises
    ------
    DataError
        If the photon energy of a monochromatic source lies outside the tables.
    """
    known, registration = _by_fit(explained), explained.registration
    if registration is None:
        return known
    return Densities(*spread(known.parts, known.covariance, registration.density_spread()))


def _by_fit(explained: Explained) -> Densities:
    capture, poly = explained.capture, explained.poly
    if poly is not None:
        return Densities(poly.parts, poly.covariance)
    parts = part_densities(explained.fit, capture.parts, capture.tube)
    return Densities(parts, np.diag(np.array([part.sd_g_cm3 for part in parts]) ** 2))

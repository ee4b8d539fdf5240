"""The densities of an object's parts, by whichever fit tells them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from xden_builder.fit.density import PartDensity, part_densities
from xden_builder.fit.diagnostics import UNCERTAIN_SHARE
from xden_builder.fit.spread import spread
from xden_builder.poly.judgement import UNCERTAIN
from xden_builder.poly.model.size import SIZE_SDS
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
    by_size_g_cm3, size_sd
        Shape (K,): the share of it that comes with the object's size, for one that is so much
        larger (relative, a standard deviation).
    """

    parts: tuple[PartDensity, ...]
    covariance: Float64[np.ndarray, "k k"]
    by_size_g_cm3: Float64[np.ndarray, "k"]
    size_sd: float


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
    uncertain = UNCERTAIN_SHARE if explained.poly is None else UNCERTAIN
    parts, covariance = spread(
        known.parts, known.covariance, registration.density_spread(), uncertain
    )
    return replace(known, parts=parts, covariance=covariance)


def _by_fit(explained: Explained) -> Densities:
    capture, poly = explained.capture, explained.poly
    if poly is not None:
        return Densities(poly.parts, poly.covariance, poly.by_size_g_cm3, poly.size.sd)
    parts = part_densities(explained.fit, capture.parts, capture.tube)
    size_sd = SIZE_SDS["known"] if explained.size is None else explained.size.sd
    seen_g_cm3 = [0.0 if part.source == "prior" else part.density_g_cm3 for part in parts]
    by_size = -size_sd * np.array(seen_g_cm3)
    alone = np.diag(np.array([part.sd_g_cm3 for part in parts]) ** 2)
    covariance = alone + np.outer(by_size, by_size)
    sds = np.sqrt(covariance.diagonal()).tolist()
    parts = tuple(replace(part, sd_g_cm3=sd) for part, sd in zip(parts, sds, strict=True))
    return Densities(parts, covariance, by_size, size_sd)

"""What the points of an object are divided into: regions of one material, and parts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Integer, UInt8

__all__ = ["material_regions", "numbered"]

ROUNDING_G_CM3 = 1e-6
"""Densities are decimals in binary: a gap of 1.15 - 1.0 must not be taken for more than 0.15."""


def material_regions(
    densities_g_cm3: Sequence[float], gap_g_cm3: float
) -> UInt8[np.ndarray, "owners"]:
    """Region of each owner: a new one begins where the next density is more than a gap higher.

    Parameters
    ----------
    densities_g_cm3
        Of void, 0, and of each part.
    gap_g_cm3
        Two owners are of one region if no gap between their densities, in the order of all, is
        larger.

    Returns
    -------
    array
        Shape (owners,): 0 is the lightest region.

    Examples
    --------
    >>> material_regions([0.0, 7.8, 0.95, 1.1, 7.9], gap_g_cm3=0.15).tolist()
    [0, 2, 1, 1, 2]
    """
    densities = np.asarray(densities_g_cm3, dtype=np.float64)
    order = np.argsort(densities, kind="stable")
    begins = np.diff(densities[order]) > gap_g_cm3 + ROUNDING_G_CM3
    regions = np.zeros(len(densities), dtype=np.uint8)
    regions[order[1:]] = np.cumsum(begins)
    return regions


def numbered(labels: Integer[np.ndarray, "points"]) -> UInt8[np.ndarray, "points"]:
    """Return labels numbered 0, 1, 2, ..., in the order of their values.

    Examples
    --------
    >>> numbered(np.array([7, 3, 7, 200])).tolist()
    [1, 0, 1, 2]
    """
    places: UInt8[np.ndarray, "points"] = np.unique(labels, return_inverse=True)[1].astype(np.uint8)
    return places

"""Densities that something moves all together, such as another pose of the object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float64

from xden_builder.fit.density import PartDensity

__all__ = ["spread"]

Density = TypeVar("Density", bound=PartDensity)


def spread(
    parts: Sequence[Density],
    covariance: Float64[np.ndarray, "k k"],
    shares: Float64[np.ndarray, "k"],
    uncertain_share: float,
) -> tuple[tuple[Density, ...], Float64[np.ndarray, "k k"]]:
    """Make densities less sure by a change that concerns all of them at once.

    Parameters
    ----------
    parts, covariance
        The densities; shape (K, K), in g²/cm⁶.
    shares
        Shape (K,): standard deviation of that change, as a share of each density.
    uncertain_share
        Of a density: one that the change makes less sure than that is ``uncertain``.

    Returns
    -------
    parts, covariance
        The same densities with larger deviations, flagged ``uncertain`` where that makes them so.
    """
    off_g_cm3 = shares * np.array([part.density_g_cm3 for part in parts])
    wider = tuple(
        _spread(part, off, uncertain_share)
        for part, off in zip(parts, off_g_cm3.tolist(), strict=True)
    )
    return wider, covariance + np.outer(off_g_cm3, off_g_cm3)


def _spread(part: Density, off_g_cm3: float, uncertain_share: float) -> Density:
    sd = float(np.hypot(part.sd_g_cm3, off_g_cm3))
    uncertain = sd > uncertain_share * part.density_g_cm3 and off_g_cm3 > 0
    flags = {*part.flags, *(("uncertain",) if uncertain else ())}
    return replace(part, sd_g_cm3=sd, flags=tuple(sorted(flags)))

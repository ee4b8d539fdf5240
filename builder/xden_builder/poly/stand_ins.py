"""What each part is taken for while the rest is fitted: one material, or a mixture of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden_builder.poly.candidates import CandidateTable
from xden_builder.poly.evidence import MaterialPosterior

__all__ = ["StandIns", "certain", "loosened", "mixtures"]

NEGLIGIBLE: Final = 0.02
"""Candidates less probable than this share of the best are left out of a mixture."""


@dataclass(frozen=True, slots=True, eq=False)
class StandIns:
    """Coefficients and prior densities of what the parts are taken for.

    Parameters
    ----------
    mac_cm2_g, scattering_cm2_g
        Shape (K, groups).
    mean_g_cm3, sd_g_cm3, low_g_cm3, high_g_cm3
        Shape (K,): density to be expected, and its bounds.
    """

    mac_cm2_g: Float64[np.ndarray, "k groups"]
    scattering_cm2_g: Float64[np.ndarray, "k groups"]
    mean_g_cm3: Float64[np.ndarray, "k"]
    sd_g_cm3: Float64[np.ndarray, "k"]
    low_g_cm3: Float64[np.ndarray, "k"]
    high_g_cm3: Float64[np.ndarray, "k"]


def certain(tables: Sequence[CandidateTable], choice: Sequence[int]) -> StandIns:
    """Take each part for one of its candidates."""
    pairs = list(zip(tables, choice, strict=True))
    priors = np.stack([table.priors[index] for table, index in pairs])
    return StandIns(
        np.stack([table.mac_cm2_g[index] for table, index in pairs]),
        np.stack([table.scattering_cm2_g[index] for table, index in pairs]),
        *(np.ascontiguousarray(column) for column in priors.T),
    )


def loosened(stand_ins: StandIns) -> StandIns:
    """Let densities leave their materials' ranges, so that a wrong material shows itself."""
    return StandIns(
        stand_ins.mac_cm2_g,
        stand_ins.scattering_cm2_g,
        stand_ins.mean_g_cm3,
        stand_ins.mean_g_cm3,
        0.05 * stand_ins.mean_g_cm3,
        5.0 * stand_ins.high_g_cm3,
    )


def mixtures(tables: Sequence[CandidateTable], posteriors: Sequence[MaterialPosterior]) -> StandIns:
    """Take each part for all candidates that are still possible, in proportion.

    Where one is certain that is the material itself. Where nothing decides, it is a point on the
    line through the materials: density and attenuation of the mixture, and how far they scatter.
    """
    rows = [_mixture(*pair) for pair in zip(tables, posteriors, strict=True)]
    macs, scatterings, priors = (np.stack(column) for column in zip(*rows, strict=True))
    return StandIns(macs, scatterings, *(np.ascontiguousarray(column) for column in priors.T))


def _mixture(
    table: CandidateTable, posterior: MaterialPosterior
) -> tuple[Float64[np.ndarray, "b"], Float64[np.ndarray, "b"], Float64[np.ndarray, "4"]]:
    """Coefficients, and mean, standard deviation and bounds of the density."""
    chance = posterior.probability
    possible = chance > NEGLIGIBLE * chance.max()
    share = np.where(possible, chance, 0.0) / chance[possible].sum()
    weights = share * posterior.density_g_cm3
    weights /= weights.sum()
    means, sds, lows, highs = table.priors.T
    mean = float(share @ means)
    sd = float(np.sqrt(share @ (sds**2 + (means - mean) ** 2)))
    bounds = lows[possible].min(), highs[possible].max()
    return (
        weights @ table.mac_cm2_g,
        weights @ table.scattering_cm2_g,
        np.array([mean, sd, *bounds]),
    )

"""Density of a part from its published attenuation, its thickness and an effective beam."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.values.materials import load_materials
from xden1k.values.types import DensitySource
from xden_builder.published.beam import Beam, PartRays, fitted_depth
from xden_builder.published.hypotheses import Hypotheses, families_of, hypotheses

__all__ = ["PartEstimate", "estimate", "log_evidence", "log_sd", "saturated"]

LIGHT_SD: Final = 0.04
"""Standard deviation of the logarithm of a coefficient that nothing disturbs."""
DEPTH_SD: Final = 0.09
"""What each unit of depth, coefficient times way, adds, times the beam's ``spread``."""
HIDDEN_SD: Final = 0.19
"""What other parts on the way add, for each unit of their depth."""
FAINT_SD: Final = 0.03
"""What scatter and the open field add, as a depth."""
USUAL_G: Final = 1000.0
"""Few parts of what people own and scan weigh more (assumed): their masses fall off exponentially,
so that a large body is rather foam or water than steel, whose attenuation looks alike where hardly
a ray comes through."""
COMMON: Final = 0.3
"""Correlation of the errors of two copies: they lie in the same radiographs."""
TOO_LOW: Final = 0.016
TOO_HIGH: Final = 0.004
"""Share of parts whose coefficient is far below or above what any material explains: what lies
wrong is found too light, seldom too heavy."""
OUTLIER_RANGE: Final = 3.0
"""Of the logarithms they fall into, on either side."""
LOST_CM: Final = 0.1
LEAST_LOST: Final = 0.1
MOST_LOST: Final = 0.5
"""Share of strong absorbers that the fit hardly found, by the ratio of how far meshes lie off
their shadows to the mean way, at least and at most."""
LOST_RANGE: Final = 4.0
BEND: Final = 3.0
"""How sharply depth is limited."""
LEAST_SD: Final = 0.03
"""Of a density, as a share of it."""
INFORMED: Final = 0.5
"""A density whose deviation is below this share of the prior's is measured."""
CLEAR: Final = 0.8
"""Probability from which a material, or a family, is named."""
UNCERTAIN: Final = 0.10
UNLIKE_SD: Final = 3.0
"""Standard deviations that a coefficient may be off the chosen material's."""


@dataclass(frozen=True, slots=True)
class PartEstimate:
    """What a part is.

    Parameters
    ----------
    density_g_cm3, sd_g_cm3
        Median of all that is possible, and half of the range of 68 %.
    source
        ``xray`` where the attenuation says more than the name, else ``prior``.
    material
        The likeliest, if it is clear; else its family, if that is; else empty.
    likeliest
        Three materials and their probability.
    flags
        What to know of it.
    """

    density_g_cm3: float
    sd_g_cm3: float
    source: DensitySource
    material: str
    likeliest: Mapping[str, float]
    flags: tuple[str, ...]


def saturated(depth: Float64[np.ndarray, "h"], deepest: float) -> Float64[np.ndarray, "h"]:
    """Depth that the fit reaches: a squared loss does not see what is darker than its errors.

    Examples
    --------
    >>> saturated(np.array([0.1, 4.0, 100.0]), 4.0).round(2).tolist()
    [0.1, 3.17, 4.0]
    """
    return np.asarray(depth / (1 + (depth / deepest) ** BEND) ** (1 / BEND))


def log_sd(
    depth: Float64[np.ndarray, "h"], clear: float, spread: float
) -> Float64[np.ndarray, "h"]:
    """Return the standard deviation of the logarithm of a coefficient.

    Parameters
    ----------
    depth
        Coefficient times mean way.
    clear
        Transmission of all else on the way.
    spread
        Of the beam.

    Examples
    --------
    >>> log_sd(np.array([0.2, 3.0]), 1.0, 1.0).round(2).tolist()
    [0.16, 0.27]
    """
    disturbed = np.hypot(LIGHT_SD, HIDDEN_SD * np.log(clear))
    return np.asarray(np.hypot(np.hypot(disturbed, DEPTH_SD * spread * depth), FAINT_SD / depth))


def log_evidence(
    lac_per_cm: float,
    rays: PartRays,
    tried: Hypotheses,
    depth: Float64[np.ndarray, "h"],
    beam: Beam,
) -> float:
    """Logarithm of how probable a beam makes a part's coefficient.

    Parameters
    ----------
    lac_per_cm
        As published, positive.
    rays
        Through the part.
    tried, depth
        What it may be, and :func:`xden_builder.published.beam.fitted_depth` of each.
    beam
        Of the same filter and stray light.
    """
    likelihood, _ = _log_likelihood(lac_per_cm, rays, depth, beam)
    return float(np.logaddexp.reduce(_log_prior(tried, rays) + likelihood))


def _log_likelihood(
    lac_per_cm: float, rays: PartRays, depth: Float64[np.ndarray, "h"], beam: Beam
) -> tuple[Float64[np.ndarray, "h"], Float64[np.ndarray, "h"]]:
    """Of each hypothesis, outliers included, and how many standard deviations it is off."""
    reached = saturated(depth, beam.deepest)
    sd = log_sd(reached, rays.clear, beam.spread)
    ratio = np.log(lac_per_cm * rays.mean_cm / reached)
    off = ratio / sd
    normal = np.exp(-(off**2) / 2) / (sd * np.sqrt(2 * np.pi))
    lost = np.clip(LOST_CM / rays.mean_cm, LEAST_LOST, MOST_LOST) * -np.expm1(-depth / 2)
    missing = np.log(depth / (lac_per_cm * rays.mean_cm))
    dim = (missing > 0) & (missing < LOST_RANGE)
    outside = np.where(ratio < 0, TOO_LOW, TOO_HIGH) / OUTLIER_RANGE
    chance = (1 - TOO_LOW - TOO_HIGH - lost) * normal + lost * dim / LOST_RANGE + outside
    return np.log(chance), off


def estimate(
    lac_per_cm: float,
    name: str,
    rays: PartRays,
    beam: Beam,
    copies: Sequence[tuple[float, PartRays]] = (),
) -> PartEstimate:
    """Weigh what a part may be.

    Parameters
    ----------
    lac_per_cm
        As published, positive.
    name
        Of the part; empty where nothing is told.
    rays, beam
        Ways through the part, and what they met.
    copies
        Coefficient and rays of other parts of the object that are of the same material.
    """
    tried = hypotheses(families_of(name))
    own, off = _weighed(lac_per_cm, rays, tried, beam)
    others = [_weighed(*copy, tried, beam)[0] for copy in copies]
    log_likelihood = sum(others, own) / (1 + COMMON * len(others))
    prior = np.exp(_log_prior(tried, rays))
    chance = prior * np.exp(log_likelihood - log_likelihood.max())
    chance /= chance.sum()
    low, density, high = _quantiles(tried.density_g_cm3, chance)
    prior_low, _, prior_high = _quantiles(tried.density_g_cm3, prior)
    sd = max((high - low) / 2, LEAST_SD * density)
    by_material = _summed(tried, chance)
    return PartEstimate(
        density,
        sd,
        "xray" if sd < INFORMED * (prior_high - prior_low) / 2 else "prior",
        _named(by_material),
        dict(list(by_material.items())[:3]),
        _flags(sd / density, float(off[chance.argmax()])),
    )


def _log_prior(tried: Hypotheses, rays: PartRays) -> Float64[np.ndarray, "h"]:
    """Logarithm of the share of each hypothesis among parts of this volume."""
    weight = tried.log_prior - tried.density_g_cm3 * rays.volume_cm3 / USUAL_G
    return np.asarray(weight - np.logaddexp.reduce(weight))


def _weighed(
    lac_per_cm: float, rays: PartRays, tried: Hypotheses, beam: Beam
) -> tuple[Float64[np.ndarray, "h"], Float64[np.ndarray, "h"]]:
    """Log likelihood of each hypothesis behind a beam, and how far it is off."""
    depth = fitted_depth(rays, tried, beam.filter_mm_al, beam.stray)
    return _log_likelihood(lac_per_cm, rays, depth, beam)


def _flags(relative_sd: float, off_sd: float) -> tuple[str, ...]:
    """Of a density, and of how far the coefficient is off the likeliest hypothesis."""
    raised = {
        "material_guessed": True,
        "uncertain": relative_sd > UNCERTAIN,
        "unlike_lac": abs(off_sd) > UNLIKE_SD,
    }
    return tuple(flag for flag, is_raised in raised.items() if is_raised)


def _quantiles(
    values: Float64[np.ndarray, "h"], weights: Float64[np.ndarray, "h"]
) -> tuple[float, float, float]:
    """Where 16, 50 and 84 % of the weight lie below, each value standing for half of its own."""
    order = np.argsort(values)
    reached = np.cumsum(weights[order]) - weights[order] / 2
    low, median, high = np.interp([0.16, 0.5, 0.84], reached / weights.sum(), values[order])
    return float(low), float(median), float(high)


def _summed(tried: Hypotheses, chance: Float64[np.ndarray, "h"]) -> dict[str, float]:
    """Probability of each material, the likeliest first."""
    total = np.bincount(tried.material, chance, len(tried.names))
    order = np.argsort(-total, kind="stable")
    return {tried.names[place]: round(float(total[place]), 4) for place in order}


def _named(by_material: Mapping[str, float]) -> str:
    first, chance = next(iter(by_material.items()))
    if chance > CLEAR:
        return first
    families: dict[str, float] = {}
    for name, share in by_material.items():
        family = load_materials()[name].family
        families[family] = families.get(family, 0.0) + share
    likeliest = max(families, key=lambda family: families[family])
    return likeliest if families[likeliest] > CLEAR else ""

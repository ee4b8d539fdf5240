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
from xden_builder.published.hypotheses import (
    Hypotheses,
    families_of,
    hypotheses,
    log_prior,
    usual_families,
)
from xden_builder.published.likelihood import log_likelihood

__all__ = ["PartEstimate", "estimate"]

COMMON: Final = 0.3
"""Correlation of the errors of two copies: they lie in the same radiographs."""
LEAST_SD: Final = 0.03
"""Of a density, as a share of it."""
INFORMED: Final = 0.5
"""A density whose deviation is below this share of the prior's is measured."""
CLEAR: Final = 0.8
"""Probability from which a material, or a family, is named."""
UNCERTAIN: Final = 0.10
FAR: Final = 0.2
FAR_CHANCE: Final = 0.1
"""Share by which a density must be off, and how likely, for its material to be ambiguous."""
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


def estimate(
    lac_per_cm: float,
    name: str,
    rays: PartRays,
    beams: Sequence[tuple[Beam, float]],
    copies: Sequence[tuple[float, PartRays]] = (),
    category: str = "",
) -> PartEstimate:
    """Weigh what a part may be.

    Parameters
    ----------
    lac_per_cm
        As published, positive.
    name
        Of the part; empty where nothing is told.
    rays
        Ways through the part, and what they met.
    beams
        That the radiographs may have been taken with, the likeliest first, and the probability of
        each.
    copies
        Coefficient and rays of other parts of the object that are of the same material.
    category
        Of the object; empty where nothing is told.
    """
    tried = hypotheses(families_of(name), usual_families(category))
    prior = np.exp(log_prior(tried, rays.volume_cm3))
    chance = np.zeros(len(prior))
    for beam, share in beams:
        seen = _seen(lac_per_cm, rays, copies, tried, beam)
        behind = prior * np.exp(seen - seen.max())
        chance += share * behind / behind.sum()
    _, off = _weighed(lac_per_cm, rays, tried, beams[0][0])
    low, density, high = _quantiles(tried.density_g_cm3, chance)
    prior_low, _, prior_high = _quantiles(tried.density_g_cm3, prior)
    sd = max((high - low) / 2, LEAST_SD * density)
    far = np.abs(tried.density_g_cm3 / density - 1) > FAR
    by_material = _summed(tried, chance)
    return PartEstimate(
        density,
        sd,
        "xray" if sd < INFORMED * (prior_high - prior_low) / 2 else "prior",
        _named(by_material),
        dict(list(by_material.items())[:3]),
        _flags(sd / density, float(chance[far].sum()), float(off[chance.argmax()])),
    )


def _seen(
    lac_per_cm: float,
    rays: PartRays,
    copies: Sequence[tuple[float, PartRays]],
    tried: Hypotheses,
    beam: Beam,
) -> Float64[np.ndarray, "h"]:
    """Log likelihood of each hypothesis behind a beam, by a part and its copies."""
    own, _ = _weighed(lac_per_cm, rays, tried, beam)
    others = [_weighed(*copy, tried, beam)[0] for copy in copies]
    return np.asarray(sum(others, own) / (1 + COMMON * len(others)))


def _weighed(
    lac_per_cm: float, rays: PartRays, tried: Hypotheses, beam: Beam
) -> tuple[Float64[np.ndarray, "h"], Float64[np.ndarray, "h"]]:
    """Log likelihood of each hypothesis behind a beam, and how far it is off."""
    depth = fitted_depth(rays, tried, beam.filter_mm_al, beam.stray)
    return log_likelihood(lac_per_cm, rays, depth, beam)


def _flags(relative_sd: float, far: float, off_sd: float) -> tuple[str, ...]:
    """Of a density, how likely it is far off, and how far the coefficient is off the likeliest."""
    raised = {
        "material_guessed": True,
        "uncertain": relative_sd > UNCERTAIN,
        "material_ambiguous": far > FAR_CHANCE,
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

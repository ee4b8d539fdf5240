"""How probable a published coefficient is, were the part of some material and density."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden_builder.published.beam import Beam, PartRays
from xden_builder.published.hypotheses import Hypotheses, log_prior

__all__ = ["log_evidence", "log_likelihood", "log_sd", "reached"]

BEND: Final = 3.0
"""How sharply depth bends at the knee."""
BEYOND: Final = 0.4
"""Power of the depth with which the fit's grows beyond it."""
DARKER: Final = 0.25
"""Power of the transmission of all else with which the knee sinks: less light is left to see by."""
THICKER: Final = 0.3
"""Power of the mean way, in cm, with which it rises: meshes lie off their shadows by as much
everywhere, which leaves less of thin parts."""
LIGHT_SD: Final = 0.03
"""Standard deviation of the logarithm of a coefficient that nothing disturbs."""
DEPTH_SD: Final = 0.10
"""What each unit of depth, coefficient times way, adds, times the beam's ``spread``."""
HIDDEN_SD: Final = 0.17
"""What other parts on the way add, for each unit of their depth."""
FAINT_SD: Final = 0.016
"""What scatter and the open field add, as a depth."""
FREEDOM: Final = 2.5
"""Degrees of freedom of Student's t, which the errors follow: a few are gross, and the others
smaller than a normal distribution with these would have them."""
LOST_CM: Final = 0.1
LEAST_LOST: Final = 0.1
MOST_LOST: Final = 0.5
"""Share of strong absorbers that the fit hardly found, by the ratio of how far meshes lie off
their shadows to the mean way, at least and at most."""
LOST_RANGE: Final = 4.0
"""Of the logarithms that their coefficients fall below what is expected."""


def reached(
    depth: Float64[np.ndarray, "h"], mean_cm: float, clear: float, knee: float
) -> Float64[np.ndarray, "h"]:
    """Depth that the fit reaches: a squared loss hardly sees what is darker than its errors.

    Parameters
    ----------
    depth
        Of a perfect fit: coefficient times mean way.
    mean_cm
        Mean way.
    clear
        Transmission of all else on the way.
    knee
        Of the beam.

    Examples
    --------
    >>> reached(np.array([0.1, 2.0, 8.0, 32.0]), 1.0, 1.0, 2.0).round(2).tolist()
    [0.1, 1.74, 3.47, 6.06]
    """
    knee *= clear**DARKER * mean_cm**THICKER
    return np.asarray(depth / (1 + (depth / knee) ** BEND) ** ((1 - BEYOND) / BEND))


def log_sd(
    depth: Float64[np.ndarray, "h"], clear: float, spread: float
) -> Float64[np.ndarray, "h"]:
    """Return the scale by which logarithms of a coefficient scatter.

    Parameters
    ----------
    depth
        That the fit reaches.
    clear
        Transmission of all else on the way.
    spread
        Of the beam.

    Examples
    --------
    >>> log_sd(np.array([0.2, 3.0]), 1.0, 1.0).round(2).tolist()
    [0.09, 0.3]
    """
    disturbed = np.hypot(LIGHT_SD, HIDDEN_SD * np.log(clear))
    return np.asarray(np.hypot(np.hypot(disturbed, DEPTH_SD * spread * depth), FAINT_SD / depth))


def log_likelihood(
    lac_per_cm: float, rays: PartRays, depth: Float64[np.ndarray, "h"], beam: Beam
) -> tuple[Float64[np.ndarray, "h"], Float64[np.ndarray, "h"]]:
    """Of each hypothesis, and by how many scales the coefficient is off.

    Parameters
    ----------
    lac_per_cm
        As published, positive.
    rays
        Through the part.
    depth
        :func:`xden_builder.published.beam.fitted_depth` of each.
    beam
        Of the same filter and stray light.
    """
    found = lac_per_cm * rays.mean_cm
    expected = reached(depth, rays.mean_cm, rays.clear, beam.knee)
    sd = log_sd(expected, rays.clear, beam.spread)
    off = np.log(found / expected) / sd
    lost = np.clip(LOST_CM / rays.mean_cm, LEAST_LOST, MOST_LOST) * -np.expm1(-depth / 2)
    missing = np.log(depth / found)
    dim = (missing > 0) & (missing < LOST_RANGE)
    return np.log((1 - lost) * _student(off) / sd + lost * dim / LOST_RANGE), off


def _student(off: Float64[np.ndarray, "h"]) -> Float64[np.ndarray, "h"]:
    """Probability density of Student's t."""
    power = (FREEDOM + 1) / 2
    height = math.gamma(power) / math.gamma(FREEDOM / 2) / math.sqrt(FREEDOM * math.pi)
    return np.asarray(height * (1 + off**2 / FREEDOM) ** -power)


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
    likelihood, _ = log_likelihood(lac_per_cm, rays, depth, beam)
    return float(np.logaddexp.reduce(log_prior(tried, rays.volume_cm3) + likelihood))

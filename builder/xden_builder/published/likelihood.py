"""How probable a published coefficient is, were the part of some material and density."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden_builder.published.beam import Beam, PartRays
from xden_builder.published.hypotheses import Hypotheses, log_prior

__all__ = ["beside", "log_evidence", "log_likelihood", "log_sd", "reached"]

BEND: Final = 3.0
"""How sharply depth bends at the knee."""
BEYOND: Final = 0.4
"""Power of the depth with which the fit's grows beyond it."""
WIDER: Final = 0.75
"""Power of the width of the shadow, in cm, with which the knee rises: meshes lie off their shadows
by as much everywhere, and the light beside a narrow one is then taken to have come through it."""
KNEES: Final = ((0.6, 0.45), (1.4, 0.45), (4.0, 0.1))
"""Factors of the knee, and their shares: some meshes lie farther off than others, and some hardly
at all."""
LIGHT_SD: Final = 0.04
"""Standard deviation of the logarithm of a coefficient that nothing disturbs."""
DEPTH_SD: Final = 0.045
"""What each unit of depth, coefficient times way, adds, times the beam's ``spread``."""
HIDDEN_SD: Final = 0.14
"""What other parts on the way add, for each unit of their depth."""
FAINT_SD: Final = 0.015
"""What scatter and the open field add, as a depth."""
OFF_CM: Final = 0.08
"""How far a mesh lies off its shadow, as a part of whose width it adds."""
FREEDOM: Final = 2.5
"""Degrees of freedom of Student's t, which the errors follow: a few are gross, and the others
smaller than a normal distribution with these would have them."""
LEAST_HIDDEN: Final = 0.3
"""Share of the light that others take, at least, by which the freedom of errors upwards is divided:
where nothing else is on the way, little can add to what a part attenuates but a mesh that is
thinner than the part."""
NEAR: Final = 1e-9
MISSED_CM: Final = 0.02
LEAST_MISSED: Final = 0.02
MOST_MISSED: Final = 0.5
"""Share of parts of which the mesh misses the shadow by any part of its width, by the ratio of the
first to that width, at least and at most."""

LEAST_CHANCE: Final = 1e-200
"""Of anything: its logarithm is a number."""


def reached(
    depth: Float64[np.ndarray, "h"], narrow_cm: float, knee: float
) -> Float64[np.ndarray, "h"]:
    """Depth that the fit reaches: a squared loss hardly sees what is darker than its errors.

    Parameters
    ----------
    depth
        Of a perfect fit: coefficient times mean way.
    narrow_cm
        Width of the shadow.
    knee
        Of the beam.

    Examples
    --------
    >>> reached(np.array([0.1, 2.0, 8.0, 32.0]), 1.0, 2.0).round(2).tolist()
    [0.1, 1.74, 3.47, 6.06]
    """
    return np.asarray(
        depth / (1 + (depth / (knee * narrow_cm**WIDER)) ** BEND) ** ((1 - BEYOND) / BEND)
    )


def log_sd(
    depth: Float64[np.ndarray, "h"], found: float, rays: PartRays, spread: float
) -> Float64[np.ndarray, "h"]:
    """Return the scale by which logarithms of a coefficient scatter.

    Parameters
    ----------
    depth
        That the fit reaches.
    found
        Depth that was found.
    rays
        Through the part.
    spread
        Of the beam.

    Examples
    --------
    >>> wide = PartRays(np.ones(1), np.ones(1), np.ones(1), 1.0, 10.0)
    >>> log_sd(np.array([0.2, 3.0]), 0.2, wide, 1.0).round(2).tolist()
    [0.09, 0.14]
    """
    disturbed = math.hypot(LIGHT_SD, HIDDEN_SD * math.log(rays.clear), OFF_CM / rays.narrow_cm)
    # of an error that adds, the same number of deviations as the difference itself has
    added = FAINT_SD * _log_slope(depth, found)
    return np.asarray(np.hypot(np.hypot(disturbed, DEPTH_SD * spread * depth), added))


def _log_slope(depth: Float64[np.ndarray, "h"], found: float) -> Float64[np.ndarray, "h"]:
    """Mean slope of the logarithm between two depths.

    Examples
    --------
    >>> _log_slope(np.array([1.0, 2.0]), 1.0).round(3).tolist()
    [1.0, 0.693]
    """
    apart = found / depth - 1
    near = np.abs(apart) < NEAR
    return np.asarray(np.where(near, 1.0, np.log1p(apart) / np.where(near, 1.0, apart)) / depth)


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
    each, off = zip(
        *(_seen(found, rays, depth, beam.knee * factor, beam.spread) for factor, _ in KNEES),
        strict=True,
    )
    seen = np.stack(each) * np.array([[share] for _, share in KNEES])
    likeliest = seen.argmax(axis=0)
    missed = float(np.clip(MISSED_CM / rays.narrow_cm, LEAST_MISSED, MOST_MISSED))
    chance = (1 - missed) * seen.sum(axis=0) + missed * beside(found, depth)
    return (
        np.log(np.maximum(chance, LEAST_CHANCE)),
        np.take_along_axis(np.stack(off), likeliest[None], axis=0)[0],
    )


def _seen(
    found: float, rays: PartRays, depth: Float64[np.ndarray, "h"], knee: float, spread: float
) -> tuple[Float64[np.ndarray, "h"], Float64[np.ndarray, "h"]]:
    """Probability density of the logarithm of a depth, and how many scales it is off."""
    expected = reached(depth, rays.narrow_cm, knee)
    sd = log_sd(expected, found, rays, spread)
    off = np.log(found / expected) / sd
    upwards = FREEDOM / max(1 - rays.clear, LEAST_HIDDEN)
    return np.where(off > 0, _student(off, upwards), _student(off, FREEDOM)) / sd, off


def beside(found: float, depth: Float64[np.ndarray, "h"]) -> Float64[np.ndarray, "h"]:
    """Probability density of the logarithm of a depth where the mesh misses some of the shadow.

    Of a share f of the mesh's shadow the light is not that of the part, but all of it: the mean
    transmission is f + (1 - f) exp(-depth), and any f is as likely.
    """
    return np.where(found < depth, found * math.exp(-found) / -np.expm1(-depth), 0.0)


def _student(off: Float64[np.ndarray, "h"], freedom: float) -> Float64[np.ndarray, "h"]:
    """Probability density of Student's t."""
    power = (freedom + 1) / 2
    height = math.exp(math.lgamma(power) - math.lgamma(freedom / 2)) / math.sqrt(freedom * math.pi)
    return np.asarray(height * (1 + off**2 / freedom) ** -power)


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

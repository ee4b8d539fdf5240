"""Stage 5 of the fit, of an object that was on a scale: what its mass says beside the images.

Comes from :mod:`estimate`, leads to :mod:`judgement`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.special import logsumexp
from scipy.stats import norm

from xden_builder.poly.estimate import Solution, problem_of, veils_of
from xden_builder.poly.materials.evidence import MaterialPosterior
from xden_builder.poly.materials.stand_ins import mixtures
from xden_builder.poly.posterior.problem import Mass, solve

__all__ = ["by_mass", "weighed"]

ASTRAY_SHARE: Final = 0.02
ASTRAY_SD: Final = 0.5
"""Share of masses that are not the object's (assumed), and how far off these are, as a share of the
larger of it and the images': a scale that was misread shall not change what images tell well."""


def weighed(solution: Solution, mass: Mass) -> Solution:
    """Weigh materials by the mass, too, and fit densities to images and mass together.

    Parameters
    ----------
    solution
        By the images alone.
    mass
        From the scale.
    """
    settings = solution.problem.settings
    posteriors = by_mass(solution, mass)
    stand_ins = mixtures(solution.scene.light.tables, posteriors, settings.mixture_share)
    veils = veils_of(solution.problem, solution.minimum)
    density = np.array([each.probability @ each.density_g_cm3 for each in posteriors])
    problem = problem_of(solution.samples, stand_ins, density, veils, mass, settings)
    nuisances = solution.minimum.unknowns[problem.parts :]
    minimum = solve(problem, np.concatenate([density, nuisances]))
    return replace(solution, posteriors=posteriors, problem=problem, minimum=minimum)


def by_mass(solution: Solution, mass: Mass) -> tuple[MaterialPosterior, ...]:
    """Weigh what each part may be made of by the mass that the others leave for it.

    Each candidate's density is as the images leave it; that of the others is as sure as images and
    their own candidates make it.
    """
    return tuple(
        replace(posterior, probability=probability)
        for posterior, probability in zip(
            solution.posteriors, _probabilities(solution, mass), strict=True
        )
    )


def _probabilities(solution: Solution, mass: Mass) -> Iterator[Float64[np.ndarray, "_c"]]:
    volumes, posteriors = mass.volumes_cm3, solution.posteriors
    parts = len(volumes)
    covariance = np.linalg.inv(solution.minimum.evaluation.hessian)[:parts, :parts]
    covariance = covariance + np.diag([each.between_g_cm3**2 for each in posteriors])
    masses_g = volumes * solution.density_g_cm3
    most_g = max(mass.mass_g, float(masses_g.sum()))
    own = mass.sd**2 + (2 * solution.samples.size.sd) ** 2
    for part, (posterior, table) in enumerate(
        zip(posteriors, solution.scene.light.tables, strict=True)
    ):
        others = np.where(np.arange(parts) == part, 0.0, volumes)
        variance = own * mass.mass_g**2 + others @ covariance @ others
        left_g = mass.mass_g - masses_g.sum() + masses_g[part]
        expected_g = volumes[part] * posterior.density_g_cm3
        sd_g = np.hypot(volumes[part] * table.density_sds(posterior.sd_g_cm3), np.sqrt(variance))
        astray_g = np.hypot(sd_g, ASTRAY_SD * most_g)
        log_likelihood = np.logaddexp(
            np.log(1 - ASTRAY_SHARE) + norm.logpdf(left_g, expected_g, sd_g),
            np.log(ASTRAY_SHARE) + norm.logpdf(left_g, expected_g, astray_g),
        )
        with np.errstate(divide="ignore"):
            log_chance = np.log(posterior.probability) + log_likelihood
        yield np.exp(log_chance - logsumexp(log_chance))

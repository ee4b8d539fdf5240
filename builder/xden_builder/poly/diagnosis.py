"""Numbers that tell how a solution knows what it says: what :mod:`judgement` goes by."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from jaxtyping import Bool, Float64

from xden_builder.poly.estimate import Solution
from xden_builder.poly.model.pixels import hardening_per_mm_cu
from xden_builder.poly.posterior.problem import Problem

__all__ = ["Diagnosis", "diagnose", "information_shares"]

DARK: Final = 0.02
"""Transmission of the direct beam below which a sample tells more of stray light than of what
stands in the beam."""
POSTERIOR_SCALE: Final = 0.7
"""Of the posterior's standard deviation: what the samples are worth is a cautious guess, and so is
how far densities of a material scatter; this makes the deviations right on simulated objects (48 of
them, which are not in the evaluation)."""
PRIOR_OF_ONE_VIEW: Final = 0.02
"""Weight of the priors where a view is asked alone: enough to keep unseen parts in place."""


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """Where the knowledge of each density comes from.

    Parameters
    ----------
    covariance
        Shape (K, K), in g²/cm⁶: by images, priors and scale, if materials and model are right;
        smaller than the posterior's by :data:`POSTERIOR_SCALE`, but for what composition and the
        scale leave.
    by_filter_g_cm3
        Shape (K,): how far a filter that is one standard deviation off moves each density.
    by_size_g_cm3
        Shape (K,): how far an object that is one standard deviation larger moves each density.
    told_by_images, told_by_scale
        Shape (K,): share by which each lowered the variance, 0 to 1.
    between_g_cm3
        Shape (K,): standard deviation of the best densities of the possible materials.
    apart_g_cm3, apart_sd_g_cm3
        Shape (K,): how far the densities by each view alone are apart, and its standard deviation:
        the difference of two; of more views, what has the same standard error of the mean.
    outline_share, dark_share
        Shape (K,): of the information, from outlines and thin parts, and from dark samples.
    met
        Shape (K,): whether a usable sample meets the part.
    """

    covariance: Float64[np.ndarray, "k k"]
    by_filter_g_cm3: Float64[np.ndarray, "k"]
    by_size_g_cm3: Float64[np.ndarray, "k"]
    told_by_images: Float64[np.ndarray, "k"]
    told_by_scale: Float64[np.ndarray, "k"]
    between_g_cm3: Float64[np.ndarray, "k"]
    apart_g_cm3: Float64[np.ndarray, "k"]
    apart_sd_g_cm3: Float64[np.ndarray, "k"]
    outline_share: Float64[np.ndarray, "k"]
    dark_share: Float64[np.ndarray, "k"]
    met: Bool[np.ndarray, "k"]


def diagnose(solution: Solution) -> Diagnosis:
    """Ask a solution where it knows its densities from."""
    problem, parts = solution.problem, solution.problem.parts
    hessian = solution.minimum.evaluation.hessian
    every = np.linalg.inv(hessian)
    variance = every.diagonal()[:parts]
    without_scale = np.linalg.inv(hessian - _scale(problem)).diagonal()[:parts]
    prior = problem.prior.sd[:parts] ** 2
    apart, apart_sd = _views_apart(solution)
    outline_share, dark_share = information_shares(problem, solution.minimum.unknowns)
    return Diagnosis(
        covariance=_covariance(problem, hessian),
        by_filter_g_cm3=-(every @ _slope_by_filter(solution))[:parts],
        by_size_g_cm3=-(every @ _slope_by_size(solution))[:parts],
        told_by_images=(1 - without_scale / prior).clip(0, 1),
        told_by_scale=(1 - variance / without_scale).clip(0, 1),
        between_g_cm3=np.array([each.between_g_cm3 for each in solution.posteriors]),
        apart_g_cm3=apart,
        apart_sd_g_cm3=apart_sd,
        outline_share=outline_share,
        dark_share=dark_share,
        met=np.any([view.samples.meets.any(axis=0) for view in solution.seen], axis=0),
    )


def _covariance(
    problem: Problem, hessian: Float64[np.ndarray, "u u"]
) -> Float64[np.ndarray, "k k"]:
    """Covariance of the densities; how far compositions and scales err is no cautious guess."""
    scaled = hessian / POSTERIOR_SCALE**2
    off = np.arange(len(hessian))[problem.off]
    scaled[off, off] -= (POSTERIOR_SCALE**-2 - 1) * problem.prior.sd[off] ** -2.0
    scaled -= (POSTERIOR_SCALE**-2 - 1) * _scale(problem)
    return np.linalg.inv(scaled)[: problem.parts, : problem.parts]


def _slope_by_filter(solution: Solution) -> Float64[np.ndarray, "u"]:
    """Return the slope of the gradient by a filter, for one standard deviation of it."""
    problem, unknowns = solution.problem, solution.minimum.unknowns
    density, slope = solution.seen_density_g_cm3, np.zeros(len(problem.prior.mean))
    for number, seen in enumerate(solution.seen):
        hardened = replace(seen.samples, weights=hardening_per_mm_cu(seen.samples, seen.beam))
        change, _ = hardened.predict(problem.stand_ins.mac_cm2_g, density)
        change *= problem.settings.filter_sd_mm_cu * solution.nuisances(number)[0]
        _, jacobian, weights = problem.scaled(unknowns, number)
        slope += jacobian.T @ (weights * change / problem.sds[number])
    return slope


def _slope_by_size(solution: Solution) -> Float64[np.ndarray, "u"]:
    """Return the slope of the gradient by the object's size, for one standard deviation of it.

    All ways become longer by the same share, as if all densities grew by it; volumes grow by three
    times as much.
    """
    problem = solution.problem
    density = np.zeros(len(problem.prior.mean))
    density[: problem.parts] = solution.density_g_cm3
    scale = _scale(problem)
    by_images = solution.minimum.evaluation.hessian - scale - np.diag(problem.prior.sd**-2.0)
    return np.asarray(solution.samples.size.sd * (by_images + 3 * scale) @ density)


def _scale(problem: Problem) -> Float64[np.ndarray, "u u"]:
    """Return what a weighed mass adds to the curvature."""
    slope = np.zeros(len(problem.prior.mean))
    if problem.mass is not None:
        slope[: problem.parts] = problem.mass.volumes_cm3 / (problem.mass.sd * problem.mass.mass_g)
    return np.outer(slope, slope)


def _views_apart(
    solution: Solution,
) -> tuple[Float64[np.ndarray, "k"], Float64[np.ndarray, "k"]]:
    """Densities that each view alone would move to, in one Gauss-Newton step: how far apart.

    The standard error of the mean of V views is half of it, whatever V.
    """
    problem, unknowns = solution.problem, solution.minimum.unknowns
    steps, variances = [], []
    for number in range(len(problem.views)):
        residuals, jacobian, weights = problem.scaled(unknowns, number)
        jacobian = jacobian[:, : problem.off.start]  # batches and widths are the same in all views
        weighted = jacobian * weights[:, None]
        sd = problem.prior.sd[: problem.off.start]
        curvature = weighted.T @ jacobian + PRIOR_OF_ONE_VIEW * np.diag(sd**-2.0)
        inverse = np.linalg.inv(curvature)
        steps.append(-(inverse @ (weighted.T @ residuals))[: problem.parts])
        variances.append(inverse.diagonal()[: problem.parts])
    count = len(steps)
    squares = np.sum([(one - other) ** 2 for one, other in combinations(steps, 2)], axis=0)
    return (
        2 / count * np.sqrt(squares / (count - 1)),
        2 / count * np.sqrt(np.sum(variances, axis=0)),
    )


def information_shares(
    problem: Problem, unknowns: Float64[np.ndarray, "u"]
) -> tuple[Float64[np.ndarray, "k"], Float64[np.ndarray, "k"]]:
    """Share of each density's Fisher information from outlines, and from dark samples.

    Dark is what direct light leaves dark: scatter tells nothing of what stands in the beam.
    """
    density = unknowns[: problem.parts] * problem.factors(unknowns)
    macs = problem.stand_ins.mac_cm2_g
    totals = np.zeros((3, problem.parts))
    for number, view in enumerate(problem.views):
        _, jacobian, weights = problem.scaled(unknowns, number)
        information = weights[:, None] * jacobian[:, : problem.parts] ** 2
        direct, _ = view.predict(macs, density)
        kinds = (np.ones(len(weights), dtype=bool), view.is_block, direct < DARK)
        totals += [information[kind].sum(axis=0) for kind in kinds]
    whole = totals[0].clip(min=1e-30)
    return totals[1] / whole, totals[2] / whole

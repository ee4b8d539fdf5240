"""How sure a fit is: standard deviations, flags, and the report."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float64, Int64

from xden_builder.fit import kernels
from xden_builder.fit.crops import Crop, neighbours
from xden_builder.fit.levenberg import NO_CURVATURE
from xden_builder.fit.problem import Evaluation, Problem, ViewData, Weighting
from xden_builder.fit.values import FitSettings, LacFit
from xden_builder.fit.weighting import variances

__all__ = ["finish"]

BLOCK_PX: Final = 8
"""Residuals of one block of so many pixels each way are taken as one; errors of shape, pose and
scatter are alike over several pixels."""
UNCERTAIN_SHARE: Final = 0.1
MOST: Final = 0.5
NEAR_BOUND: Final = 1e-6
FLAT_DIRECTION: Final = 1e-10
"""Eigenvalue of the curvature, scaled to a unit diagonal, that is rounding alone."""
LITTLE: Final = 1e-6
PLAIN, OUTLINE, STARVED = range(3)

Unknowns = Float64[np.ndarray, "u"]
Matrix = Float64[np.ndarray, "u u"]


def finish(
    problem: Problem,
    unknowns: Unknowns,
    evaluation: Evaluation,
    weighting: Weighting,
    settings: FitSettings,
    report: dict[str, Any],
) -> LacFit:
    """Judge a fit and wrap it up.

    Parameters
    ----------
    problem, unknowns, evaluation, weighting, settings
        What was fitted, where it ended, and how.
    report
        What the solver says: at least ``iterations``.
    """
    lower, upper = problem.bounds(settings)
    fitted, parts = upper > lower, problem.parts
    seen = fitted[:parts]
    lac = np.where(seen, unknowns[:parts], np.nan)
    sd = _standard_deviations(problem, unknowns, evaluation, weighting, settings, fitted)
    lac_sd = np.where(seen, np.minimum(sd[:parts], settings.upper_per_cm / np.sqrt(12)), np.nan)
    shares = _information_shares(problem, unknowns, evaluation, settings)
    views = {
        view.name: _view_report(problem, number, unknowns, evaluation, settings, sd)
        for number, view in enumerate(problem.views)
    }
    return LacFit(
        lac_per_cm=lac,
        lac_sd_per_cm=lac_sd,
        gain=unknowns[parts:].copy(),
        loss=evaluation.loss,
        iterations=report["iterations"],
        flags=_flags(lac, lac_sd, shares, settings.upper_per_cm),
        report={**report, "loss": evaluation.loss, "views": views},
    )


def _standard_deviations(
    problem: Problem,
    unknowns: Unknowns,
    evaluation: Evaluation,
    weighting: Weighting,
    settings: FitSettings,
    fitted: Bool[np.ndarray, "u"],
) -> Unknowns:
    """Return the larger of two sandwich estimates H⁻¹ B H⁻¹ with H = JᵀWJ.

    B is what the noise alone would give, JᵀWVWJ, and what the residuals give when those of one
    block of pixels are added up first, so that errors with a shape are not averaged away.
    """
    from_noise = _noise_scores(problem, unknowns, evaluation, weighting)
    scores = _block_scores(problem, unknowns, evaluation, weighting)
    inverse, told = _inverse(evaluation.hessian, fitted)
    variances_by = [
        np.einsum("ij,jk,ik->i", inverse, middle, inverse)
        for middle in (from_noise, scores.T @ scores)
    ]
    spread = np.sqrt(np.maximum.reduce([*variances_by, np.zeros(len(told))]))
    return np.where(told, spread, np.where(fitted, np.inf, 0.0))


def _inverse(
    hessian: Matrix, fitted: Bool[np.ndarray, "u"]
) -> tuple[Matrix, Bool[np.ndarray, "u"]]:
    """Inverse among the fitted unknowns, and which of them the images tell.

    Not told are those without curvature, and those that share a direction without any, such as
    two parts that every ray meets alike.
    """
    inverse, told = np.zeros_like(hessian), np.zeros(len(fitted), dtype=bool)
    diagonal = np.diag(hessian)
    kept = np.flatnonzero(fitted & (diagonal > NO_CURVATURE * diagonal.max()))
    scale = 1 / np.sqrt(diagonal[kept])
    values, vectors = np.linalg.eigh(hessian[np.ix_(kept, kept)] * np.outer(scale, scale))
    flat = values < FLAT_DIRECTION
    told[kept] = (vectors[:, flat] ** 2).sum(axis=1) < LITTLE
    bent = vectors[:, ~flat]
    inverse[np.ix_(kept, kept)] = (bent / values[~flat]) @ bent.T * np.outer(scale, scale)
    return inverse, told


def _noise_scores(
    problem: Problem, unknowns: Unknowns, evaluation: Evaluation, weighting: Weighting
) -> Matrix:
    """JᵀWVWJ with the variance V of the noise."""
    squared = []
    for number, (view, (weights, air_weight)) in enumerate(
        zip(problem.views, weighting, strict=True)
    ):
        gain = unknowns[problem.parts + number]
        variance = view.noise_variance(gain * evaluation.transmissions[number])
        air_variance = float(view.noise_variance(np.ones(1))[0])
        squared.append((weights**2 * variance, air_weight**2 * air_variance))
    return problem.evaluate(unknowns, squared).hessian


def _block_scores(
    problem: Problem, unknowns: Unknowns, evaluation: Evaluation, weighting: Weighting
) -> Float64[np.ndarray, "blocks u"]:
    """Jᵀ W r of each block of pixels of each view."""
    parts, collected = problem.parts, []
    for number, (view, (weights, _)) in enumerate(zip(problem.views, weighting, strict=True)):
        gain = float(unknowns[parts + number])
        residuals = gain * evaluation.transmissions[number] - view.measured
        blocks = _blocks(view)
        scores = np.zeros((int(blocks.max(initial=-1)) + 1, parts + 1))
        kernels.block_scores(
            view.lengths.lengths_cm, weights * residuals, blocks, unknowns[:parts], gain, scores
        )
        wide = np.zeros((len(scores), len(unknowns)))
        wide[:, :parts] = scores[:, :parts]
        wide[:, parts + number] = scores[:, parts]
        collected.append(wide)
    return np.concatenate(collected)


def _blocks(view: ViewData) -> Int64[np.ndarray, "n"]:
    """Give each pixel the number of its block."""
    if not len(view.measured):
        return np.zeros(0, dtype=np.int64)
    crop = Crop.around(view.lengths.pixels, view.lengths.shape, margin_px=0)
    across = int(crop.columns.max()) // BLOCK_PX + 1
    return np.asarray(crop.rows // BLOCK_PX * across + crop.columns // BLOCK_PX)


def _information_shares(
    problem: Problem, unknowns: Unknowns, evaluation: Evaluation, settings: FitSettings
) -> Float64[np.ndarray, "3 k"]:
    """Share of each part's Fisher information that comes from each kind of pixel."""
    totals = np.zeros((3, problem.parts))
    for number, view in enumerate(problem.views):
        gain = float(unknowns[problem.parts + number])
        transmission = evaluation.transmissions[number]
        variance, _ = variances(view, transmission, gain, settings)
        kinds = np.where(_on_outline(view), OUTLINE, PLAIN).astype(np.uint8)
        kinds[gain * transmission < 3 * view.dark_sd] = STARVED
        kernels.information(
            view.lengths.lengths_cm,
            np.where(view.usable, 1 / variance, 0.0),
            kinds,
            unknowns[: problem.parts],
            gain,
            totals,
        )
    whole = totals.sum(axis=0)
    shares = np.zeros_like(totals)
    np.divide(totals, whole, out=shares, where=whole > 0)
    return shares


def _on_outline(view: ViewData) -> Bool[np.ndarray, "n"]:
    """Whether a neighbour's rays meet other parts than the pixel's own."""
    if not len(view.measured):
        return np.zeros(0, dtype=bool)
    sets = np.zeros(len(view.measured), dtype=np.uint64)
    keys = np.random.default_rng(0).integers(1, 2**63, view.parts, dtype=np.uint64)
    kernels.hit_sets(view.lengths.lengths_cm, keys, sets)
    crop = Crop.around(view.lengths.pixels, view.lengths.shape, margin_px=1)
    image = crop.image(sets, background=0.0)
    return np.asarray((neighbours(image) != image).any(axis=0)[crop.rows, crop.columns])


def _flags(
    lac: Float64[np.ndarray, "k"],
    sd: Float64[np.ndarray, "k"],
    shares: Float64[np.ndarray, "3 k"],
    upper_per_cm: float,
) -> tuple[frozenset[str], ...]:
    seen = ~np.isnan(lac)
    raised = {
        "hidden": ~seen,
        "uncertain": seen & ~(sd <= UNCERTAIN_SHARE * lac),
        "starved": seen & (shares[STARVED] > MOST),
        "edge_only": seen & (shares[OUTLINE] > MOST),
        "at_bound": seen & ((lac <= 0) | (lac >= upper_per_cm * (1 - NEAR_BOUND))),
    }
    return tuple(
        frozenset(name for name, parts in raised.items() if parts[part]) for part in range(len(lac))
    )


def _view_report(
    problem: Problem,
    number: int,
    unknowns: Unknowns,
    evaluation: Evaluation,
    settings: FitSettings,
    sd: Unknowns,
) -> dict[str, Any]:
    view, gain = problem.views[number], float(unknowns[problem.parts + number])
    transmission = evaluation.transmissions[number]
    variance, _ = variances(view, transmission, gain, settings)
    residuals = (gain * transmission - view.measured)[view.usable]
    pixels = int(view.usable.sum())
    return {
        "gain": gain,
        "gain_sd": float(sd[problem.parts + number]),
        "chi2_per_pixel": float((residuals**2 / variance[view.usable]).mean()) if pixels else None,
        "residual_rms": float(np.sqrt((residuals**2).mean())) if pixels else None,
        "pixels": pixels,
        "masked_pixels": len(view.usable) - pixels,
        "air_pixels": view.air.count,
        "noise_sd": view.air.sd,
        "dark_sd": view.dark_sd,
    }

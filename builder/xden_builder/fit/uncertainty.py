"""Standard deviations of coefficients and gains."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Bool, Float64, Int64

from xden_builder.fit import kernels
from xden_builder.fit.crops import Crop
from xden_builder.fit.levenberg import NO_CURVATURE
from xden_builder.fit.observed import ViewData
from xden_builder.fit.problem import Fitted

__all__ = ["standard_deviations"]

BLOCK_PX: Final = 8
"""Residuals of one block of so many pixels each way are taken as one; errors of shape, pose and
scatter are alike over several pixels."""
FLAT_DIRECTION: Final = 1e-10
"""Eigenvalue of the curvature, scaled to a unit diagonal, that is rounding alone."""
LITTLE: Final = 1e-6

Unknowns = Float64[np.ndarray, "u"]
Matrix = Float64[np.ndarray, "u u"]


def standard_deviations(fitted: Fitted, moving: Bool[np.ndarray, "u"]) -> Unknowns:
    """Return the larger of two sandwich estimates H⁻¹ B H⁻¹ with H = JᵀWJ.

    B is what the noise alone would give, JᵀWVWJ, and what the residuals give when those of one
    block of pixels are added up first, so that errors with a shape are not averaged away.

    Parameters
    ----------
    fitted
        The end of the fit.
    moving
        Shape (K + V,): which unknowns were fitted; the others have no deviation.

    Returns
    -------
    ndarray
        Shape (K + V,); infinite where the images do not tell an unknown.
    """
    scores = _block_scores(fitted)
    inverse, told = _inverse(fitted.evaluation.hessian, moving)
    estimates = [
        np.einsum("ij,jk,ik->i", inverse, middle, inverse)
        for middle in (_noise_scores(fitted), scores.T @ scores)
    ]
    spread = np.sqrt(np.maximum.reduce([*estimates, np.zeros(len(told))]))
    return np.where(told, spread, np.where(moving, np.inf, 0.0))


def _inverse(
    hessian: Matrix, moving: Bool[np.ndarray, "u"]
) -> tuple[Matrix, Bool[np.ndarray, "u"]]:
    """Inverse among the fitted unknowns, and which of them the images tell.

    Not told are those without curvature, and those that share a direction without any, such as
    two parts that every ray meets alike.
    """
    inverse, told = np.zeros_like(hessian), np.zeros(len(moving), dtype=bool)
    diagonal = np.diag(hessian)
    kept = np.flatnonzero(moving & (diagonal > NO_CURVATURE * diagonal.max()))
    scale = 1 / np.sqrt(diagonal[kept])
    values, vectors = np.linalg.eigh(hessian[np.ix_(kept, kept)] * np.outer(scale, scale))
    flat = values < FLAT_DIRECTION
    told[kept] = (vectors[:, flat] ** 2).sum(axis=1) < LITTLE
    bent = vectors[:, ~flat]
    inverse[np.ix_(kept, kept)] = (bent / values[~flat]) @ bent.T * np.outer(scale, scale)
    return inverse, told


def _noise_scores(fitted: Fitted) -> Matrix:
    """JᵀWVWJ with the variance V of the noise."""
    squared = []
    for fit in fitted.views():
        variance = fit.view.noise_variance(fit.gain * fit.transmission)
        air_variance = float(fit.view.noise_variance(np.ones(1))[0])
        squared.append((fit.weights**2 * variance, fit.air_weight**2 * air_variance))
    return fitted.problem.evaluate(fitted.unknowns, squared).hessian


def _block_scores(fitted: Fitted) -> Float64[np.ndarray, "blocks u"]:
    """Jᵀ W r of each block of pixels of each view."""
    parts, collected = fitted.problem.parts, []
    for fit in fitted.views():
        blocks = _blocks(fit.view)
        scores = np.zeros((int(blocks.max(initial=-1)) + 1, parts + 1))
        kernels.block_scores(
            fit.view.ways,
            fit.weights * fit.residuals,
            blocks,
            fitted.lac_per_cm,
            fit.gain,
            scores,
        )
        wide = np.zeros((len(scores), len(fitted.unknowns)))
        wide[:, :parts] = scores[:, :parts]
        wide[:, parts + fit.number] = scores[:, parts]
        collected.append(wide)
    return np.concatenate(collected)


def _blocks(view: ViewData) -> Int64[np.ndarray, "n"]:
    """Give each pixel the number of its block."""
    if not len(view.measured):
        return np.zeros(0, dtype=np.int64)
    crop = Crop.around(view.lengths.pixels, view.lengths.shape, margin_px=0)
    across = int(crop.columns.max()) // BLOCK_PX + 1
    return np.asarray(crop.rows // BLOCK_PX * across + crop.columns // BLOCK_PX)

"""How sure a fit is: deviations, flags, and the report."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from jaxtyping import Float64

from xden_builder.fit import kernels
from xden_builder.fit.outline import on_outline
from xden_builder.fit.problem import Fitted, ViewFit
from xden_builder.fit.uncertainty import standard_deviations
from xden_builder.fit.values import FitSettings, LacFit
from xden_builder.fit.weighting import variances

__all__ = ["finish"]

UNCERTAIN_SHARE: Final = 0.1
MOST: Final = 0.5
NEAR_BOUND: Final = 1e-6
CONSTANT: Final = 1e-7
"""Standard deviation of transmissions that are single-precision rounding alone."""
PLAIN, OUTLINE, STARVED = range(3)


def finish(fitted: Fitted, solver: str, iterations: int, *, converged: bool) -> LacFit:
    """Judge a fit and wrap it up.

    Parameters
    ----------
    fitted
        The end of the fit.
    solver, iterations, converged
        How it came there.
    """
    settings, parts = fitted.settings, fitted.problem.parts
    lower, upper = fitted.problem.bounds(settings)
    moving = upper > lower
    seen = moving[:parts]
    sd = standard_deviations(fitted, moving)
    lac = np.where(seen, fitted.lac_per_cm, np.nan)
    # knowing nothing but the bounds leaves a uniform distribution between them
    lac_sd = np.where(seen, np.minimum(sd[:parts], settings.upper_per_cm / np.sqrt(12)), np.nan)
    return LacFit(
        lac_per_cm=lac,
        lac_sd_per_cm=lac_sd,
        gain=fitted.gain.copy(),
        loss=fitted.evaluation.loss,
        iterations=iterations,
        flags=_flags(lac, lac_sd, _information_shares(fitted), settings.upper_per_cm),
        report={
            "solver": solver,
            "weights": settings.weights,
            "gain": settings.gain,
            "iterations": iterations,
            "converged": converged,
            "loss": _or_none(fitted.evaluation.loss),
            "views": {
                fit.view.name: _view_report(fit, settings, float(sd[parts + fit.number]))
                for fit in fitted.views()
            },
        },
    )


def _information_shares(fitted: Fitted) -> Float64[np.ndarray, "3 k"]:
    """Share of each part's Fisher information that comes from each kind of pixel."""
    totals = np.zeros((3, fitted.problem.parts))
    for fit in fitted.views():
        variance, _ = variances(fit.view, fit.transmission, fit.gain, fitted.settings)
        kinds = np.where(on_outline(fit.view.lengths), OUTLINE, PLAIN).astype(np.uint8)
        kinds[fit.gain * fit.transmission < 3 * fit.view.dark_sd] = STARVED
        kernels.information(
            fit.view.ways,
            np.where(fit.view.usable, 1 / variance, 0.0),
            kinds,
            fitted.lac_per_cm,
            fit.gain,
            totals,
        )
    whole = totals.sum(axis=0)
    return totals / np.where(whole > 0, whole, 1.0)


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


def _view_report(fit: ViewFit, settings: FitSettings, gain_sd: float) -> dict[str, Any]:
    usable, air = fit.view.usable, fit.view.air
    variance, _ = variances(fit.view, fit.transmission, fit.gain, settings)
    squares = fit.residuals[usable] ** 2
    numbers = {
        "gain": fit.gain,
        "gain_sd": gain_sd,
        "chi2_per_pixel": _mean(squares / variance[usable]),
        "residual_rms": math.sqrt(_mean(squares)),
        "correlation": _correlation(fit.transmission[usable], fit.view.measured[usable]),
        "noise_sd": air.sd,
        "dark_sd": fit.view.dark_sd,
    }
    return {name: _or_none(value) for name, value in numbers.items()} | {
        "pixels": squares.size,
        "masked_pixels": len(usable) - squares.size,
        "air_pixels": air.count,
    }


def _or_none(value: float) -> float | None:
    """Keep what JSON can say."""
    return value if math.isfinite(value) else None


def _mean(values: Float64[np.ndarray, "n"]) -> float:
    return float(values.mean()) if values.size else math.nan


def _correlation(one: Float64[np.ndarray, "n"], other: Float64[np.ndarray, "n"]) -> float:
    """Pearson's; nan where either is constant."""
    pair = np.stack([one, other])
    if not len(one) or (pair.std(axis=1) <= CONSTANT).any():
        return math.nan
    return float(np.corrcoef(pair)[0, 1])

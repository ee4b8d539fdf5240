"""Projected Levenberg-Marquardt on normal equations, with bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float64

from xden_builder.fit.box import box_minimum
from xden_builder.fit.problem import Evaluation

__all__ = ["SMALL_GAIN", "Minimum", "minimise"]

FIRST_DAMPING: Final = 1e-6
LEAST_DAMPING: Final = 1e-9
SMALL_STEP: Final = 1e-7
"""Relative to the unknown."""
SMALL_GAIN: Final = 1e-10
"""Relative to the loss: for a million pixels 1 % of a standard deviation."""
NO_CURVATURE: Final = 1e-30
"""Relative to the largest; an unknown below it leaves no trace in the images."""

Unknowns = Float64[np.ndarray, "u"]


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """Where the loss is least, what it is there, and how many steps it took."""

    unknowns: Unknowns
    evaluation: Evaluation
    iterations: int
    converged: bool


def minimise(
    evaluate: Callable[[Unknowns], Evaluation],
    start: Unknowns,
    lower: Unknowns,
    upper: Unknowns,
    max_iterations: int,
    small_gain: float = SMALL_GAIN,
) -> Minimum:
    """Find the least loss between the bounds.

    Each step is the damped Gauss-Newton step, which is the least of the model between the bounds:
    where it meets a bound the others are solved for again. Damping follows how much of the
    promised gain came true (Nielsen, 1999, "Damping parameter in Marquardt's method"). Strong
    damping makes any step small, so that alone it is no convergence: there, no unknown must gain
    by itself either. A gain of less than ``small_gain`` of the loss is none.
    """
    point = np.clip(start, lower, upper)
    here = evaluate(point)
    damping, growth = FIRST_DAMPING, 2.0
    for iteration in range(max_iterations):
        ahead = _damped(point, here, lower, upper, damping)
        step = ahead - point
        promised = -step @ (2 * here.gradient + here.hessian @ step)
        settled = (np.abs(step) <= SMALL_STEP * np.maximum(np.abs(point), SMALL_STEP)).all()
        if (settled or promised <= small_gain * here.loss) and (
            damping <= FIRST_DAMPING
            or _best_gain(point, here, lower, upper) <= small_gain * here.loss
        ):
            return Minimum(point, here, iteration, converged=True)
        there = evaluate(ahead)
        if there.loss < here.loss:
            came_true = (here.loss - there.loss) / promised
            damping = max(damping * max(0.1, 1 - (2 * came_true - 1) ** 3), LEAST_DAMPING)
            point, here, growth = ahead, there, 2.0
        else:
            damping, growth = damping * growth, growth * 2
    return Minimum(point, here, max_iterations, converged=False)


def _damped(
    point: Unknowns, here: Evaluation, lower: Unknowns, upper: Unknowns, damping: float
) -> Unknowns:
    """Solve with each unknown scaled to unit curvature, so that damping means the same for all."""
    told = _told(here)
    scale = 1 / np.sqrt(np.diag(here.hessian)[told])
    scaled = here.hessian[np.ix_(told, told)] * np.outer(scale, scale)
    scaled += damping * np.eye(len(scale))
    low, high = (lower - point)[told] / scale, (upper - point)[told] / scale
    step = box_minimum(scaled, scale * here.gradient[told], low, high)
    ahead = point.copy()
    ahead[told] += scale * step
    # exactly at the bounds, whatever the rounding
    ahead[told] = np.where(
        step <= low, lower[told], np.where(step >= high, upper[told], ahead[told])
    )
    return ahead


def _best_gain(point: Unknowns, here: Evaluation, lower: Unknowns, upper: Unknowns) -> float:
    """Most that the model's loss falls by moving one unknown alone, whatever the damping."""
    told = _told(here)
    slope, curvature = here.gradient[told], np.diag(here.hessian)[told]
    move = np.clip(-slope / curvature, (lower - point)[told], (upper - point)[told])
    return float((-move * (2 * slope + curvature * move)).max(initial=0.0))


def _told(here: Evaluation) -> Bool[np.ndarray, "u"]:
    curvature = np.diag(here.hessian)
    return np.asarray(curvature > NO_CURVATURE * curvature.max())

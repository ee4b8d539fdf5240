"""Projected Levenberg-Marquardt on normal equations, with bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float64

from xden_builder.fit.problem import Evaluation

__all__ = ["Minimum", "minimise"]

FIRST_DAMPING: Final = 1e-6
LEAST_DAMPING: Final = 1e-9
SMALL_STEP: Final = 1e-7
"""Relative to the unknown."""
SMALL_GAIN: Final = 1e-13
"""Relative to the loss; a step that promises less cannot be told from rounding."""
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
) -> Minimum:
    """Find the least loss between the bounds.

    Unknowns at a bound whose gradient points outwards rest; the others take the damped
    Gauss-Newton step, cut at the bounds. Damping falls tenfold after a success and rises tenfold
    after a failure. Unknowns of equal bounds never move.
    """
    point = np.clip(start, lower, upper)
    here = evaluate(point)
    damping = FIRST_DAMPING
    for iteration in range(max_iterations):
        free = _free(point, here, lower, upper)
        step = np.clip(point + _damped_step(here, free, damping), lower, upper) - point
        promised = -step @ (2 * here.gradient + here.hessian @ step)
        settled = (np.abs(step) <= SMALL_STEP * np.maximum(np.abs(point), SMALL_STEP)).all()
        if settled or promised <= SMALL_GAIN * here.loss:
            return Minimum(point, here, iteration, converged=True)
        there = evaluate(point + step)
        if there.loss < here.loss:
            point, here, damping = point + step, there, max(damping / 10, LEAST_DAMPING)
        else:
            damping *= 10
    return Minimum(point, here, max_iterations, converged=False)


def _free(
    point: Unknowns, here: Evaluation, lower: Unknowns, upper: Unknowns
) -> Bool[np.ndarray, "u"]:
    outwards = (point <= lower) & (here.gradient >= 0) | (point >= upper) & (here.gradient <= 0)
    curvature = np.diag(here.hessian)
    return np.asarray(~outwards & (curvature > NO_CURVATURE * curvature.max()))


def _damped_step(here: Evaluation, free: Bool[np.ndarray, "u"], damping: float) -> Unknowns:
    """Solve with each unknown scaled to unit curvature, so that damping means the same for all."""
    step = np.zeros(len(free))
    scale = 1 / np.sqrt(np.diag(here.hessian)[free])
    scaled = here.hessian[np.ix_(free, free)] * np.outer(scale, scale)
    scaled += damping * np.eye(len(scale))
    step[free] = -scale * np.linalg.solve(scaled, scale * here.gradient[free])
    return step

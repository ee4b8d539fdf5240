"""The steps of the search for the pose on one resolution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float64

from xden_builder.fit.box import box_minimum
from xden_builder.fit.problem import Evaluation
from xden_builder.poly.pyramid import Level

__all__ = ["Descent", "descend"]

FIRST_DAMPING: Final = 1e-3
FELT_DAMPING: Final = 0.05
"""Less hardly changes a step that was refused: unknowns are scaled to unit curvature."""
MOST_STEPS: Final = 5
"""Between two derivatives."""
SETTLED_SHARE: Final = 1e-3
"""Of the loss: a step that gains less is the last of a round."""
SETTLED_ROUND: Final = 0.05
"""Of the loss: a round, the steps that share derivatives, that gains less ends a resolution."""


class Descent(NamedTuple):
    """Where a descent ended.

    Parameters
    ----------
    unknowns
        The best that were found.
    there
        The loss, and half its derivatives.
    before, residuals
        Of each view: residuals where it began, and where it ended.
    level
        The images as they are believed there.
    """

    unknowns: Float64[np.ndarray, "u"]
    there: Evaluation
    before: Sequence[Float64[np.ndarray, "_n"]]
    residuals: Sequence[Float64[np.ndarray, "_n"]]
    level: Level


def descend(
    level: Level,
    unknowns: Float64[np.ndarray, "u"],
    most: int,
    low: Float64[np.ndarray, "u"],
    high: Float64[np.ndarray, "u"],
) -> Descent:
    """Take damped Gauss-Newton steps.

    Derivatives cost a dozen times as much as residuals, so several steps share them. A step that
    gains nothing is refused; the same with more damping, which it would not feel, is passed over.
    The images are believed anew with each derivative; the loss is as they are believed last.
    """
    damping, before = FIRST_DAMPING, None
    for _ in range(most):
        residuals, slopes = level.residuals_and_slopes(unknowns)
        before, level = before or residuals, level.believed(residuals)
        here = first = level.evaluate(unknowns, residuals, slopes)
        refused = False
        for _ in range(MOST_STEPS):
            if refused and damping < FELT_DAMPING:
                damping *= 10
                continue
            ahead = _ahead(unknowns, here, damping, low, high)
            seen = level.residuals(ahead)
            gained = here.loss - level.loss(ahead, seen)
            refused = gained <= 0
            if refused:
                damping *= 10
                continue
            unknowns, residuals, here = ahead, seen, level.evaluate(ahead, seen, slopes)
            damping = max(damping / 10, 1e-6)
            if gained < SETTLED_SHARE * here.loss:
                break
        if first.loss - here.loss < SETTLED_ROUND * here.loss:
            break
    assert before is not None
    return Descent(unknowns, here, before, residuals, level)


def _ahead(
    unknowns: Float64[np.ndarray, "u"],
    here: Evaluation,
    damping: float,
    low: Float64[np.ndarray, "u"],
    high: Float64[np.ndarray, "u"],
) -> Float64[np.ndarray, "u"]:
    """Solve between bounds, with each unknown scaled to unit curvature."""
    scale = 1 / np.sqrt(here.hessian.diagonal().clip(min=1e-12))
    scaled = here.hessian * np.outer(scale, scale) + damping * np.eye(len(scale))
    step = box_minimum(
        scaled, scale * here.gradient, (low - unknowns) / scale, (high - unknowns) / scale
    )
    return np.asarray((unknowns + scale * step).clip(low, high))

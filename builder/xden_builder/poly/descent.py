"""The steps of the search for the pose on one resolution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64

from xden_builder.fit.box import box_minimum
from xden_builder.fit.problem import Evaluation

__all__ = ["Compared", "Descent", "descend"]

FIRST_DAMPING: Final = 1e-3
FELT_DAMPING: Final = 0.05
"""Less hardly changes a step that was refused: unknowns are scaled to unit curvature."""
MOST_STEPS: Final = 5
"""Between two derivatives."""
SETTLED_SHARE: Final = 0.01
"""Of the loss: a step that gains less is the last of a round. A tenth of this share
costs a fifth more renderings, and gains a thousandth of the loss."""
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
    slopes
        Of each view: derivatives of the residuals by all unknowns, where they were taken last.
    """

    unknowns: Float64[np.ndarray, "u"]
    there: Evaluation
    before: Sequence[Float64[np.ndarray, "_n"]]
    residuals: Sequence[Float64[np.ndarray, "_n"]]
    slopes: Sequence[Float64[np.ndarray, "_n u"]]


@runtime_checkable
class Compared(Protocol):
    """Images of a model and measured ones, compared by residuals of each view."""

    def believed(self, residuals: Sequence[Float64[np.ndarray, "_n"]], /) -> Compared:
        """Weigh the images by what a model leaves of them."""
        ...

    def residuals(self, unknowns: Float64[np.ndarray, "u"]) -> Sequence[Float64[np.ndarray, "_n"]]:
        """Model less measurement of each view, in standard deviations."""
        ...

    def residuals_and_slopes(
        self, unknowns: Float64[np.ndarray, "u"]
    ) -> tuple[Sequence[Float64[np.ndarray, "_n"]], Sequence[Float64[np.ndarray, "_n u"]]]:
        """Give the residuals of each view, and their derivatives by all unknowns."""
        ...

    def loss(
        self, unknowns: Float64[np.ndarray, "u"], residuals: Sequence[Float64[np.ndarray, "_n"]]
    ) -> float:
        """Loss of residuals, with priors of the unknowns."""
        ...

    def evaluate(
        self,
        unknowns: Float64[np.ndarray, "u"],
        residuals: Sequence[Float64[np.ndarray, "_n"]],
        slopes: Sequence[Float64[np.ndarray, "_n u"]],
    ) -> Evaluation:
        """Loss, and half its derivatives."""
        ...


def descend(
    level: Compared,
    unknowns: Float64[np.ndarray, "u"],
    most: int,
    low: Float64[np.ndarray, "u"],
    high: Float64[np.ndarray, "u"],
) -> Descent:
    """Take damped Gauss-Newton steps.

    Derivatives cost two to six times as much as residuals, so several steps share them. A step that
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
    return Descent(unknowns, here, before, residuals, slopes)


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

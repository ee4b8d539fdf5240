"""The paper's solver: Adam on automatic gradients over dense full frames (Eq. 5 to 7).

Kept as the reference that :func:`xden_builder.fit.fit_lac` is compared with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from xden1k.errors import DataError
from xden1k.rays import PathLengths
from xden1k.values.views import XRayView
from xden_builder.fit.diagnostics import finish
from xden_builder.fit.problem import Fitted, Problem
from xden_builder.fit.values import PAPER_OBJECTIVE, LacFit
from xden_builder.fit.weighting import uniform

__all__ = ["DEFAULT_ADAM", "AdamSettings", "fit_lac_adam"]


@dataclass(frozen=True, slots=True)
class AdamSettings:
    """Choices of the Adam solver; the paper names none of them.

    Parameters
    ----------
    gain
        Whether each view has an open-field factor; the paper's have none.
    start_per_cm
        Coefficient every part starts from.
    learning_rate_per_cm
        First step of each coefficient. It is halved whenever the loss has not fallen for
        ``patience`` steps, since a constant one circles the optimum at its own size.
    patience
        Steps.
    tolerance
        The fit ends when the loss has changed by less than this share over ``patience`` steps.
    max_steps
        Or after so many steps.
    target_loss
        Or as soon as the loss is at most this: to measure the time to an equal loss.
    upper_per_cm
        Bound on every coefficient; 0 is the lower one.

    Raises
    ------
    DataError
        If a number is not positive.
    """

    gain: bool = False
    start_per_cm: float = 0.2
    learning_rate_per_cm: float = 0.1
    patience: int = 10
    tolerance: float = 1e-7
    max_steps: int = 2000
    target_loss: float | None = None
    upper_per_cm: float = PAPER_OBJECTIVE.upper_per_cm

    def __post_init__(self) -> None:
        for name in (
            "start_per_cm",
            "learning_rate_per_cm",
            "patience",
            "tolerance",
            "max_steps",
            "upper_per_cm",
        ):
            if not getattr(self, name) > 0:
                raise DataError(f"{name} must be positive, got {getattr(self, name)}")


DEFAULT_ADAM: Final = AdamSettings()


def fit_lac_adam(
    views: Sequence[tuple[PathLengths, XRayView]], settings: AdamSettings = DEFAULT_ADAM
) -> LacFit:
    """Fit one linear attenuation coefficient for each part the paper's way.

    All pixels of the frames count alike, a pixel has one path length for each part (the mean over
    its rays, where there are several), and there is no gain unless asked for. Takes 4 bytes of
    memory for each part and pixel of the frames, several times over.

    Parameters
    ----------
    views
        Path lengths and image of each view, all of the same parts.
    settings
        Learning rate, when to stop.

    Raises
    ------
    DataError
        If a view's path lengths are of another shape or of other parts.
    """
    from xden_builder.fit.descent import descend  # torch takes seconds to load

    objective = replace(
        PAPER_OBJECTIVE,
        gain="free" if settings.gain else "fixed",
        upper_per_cm=settings.upper_per_cm,
    )
    problem = Problem.of([(_one_ray(lengths), view) for lengths, view in views], objective, {})
    unknowns, steps, converged = descend(problem, [view for _, view in views], settings)
    weighting = uniform(problem.views)
    evaluation = problem.evaluate(unknowns, weighting)
    fitted = Fitted(problem, objective, weighting, unknowns, evaluation)
    return finish(fitted, "adam", steps, converged=converged)


def _one_ray(lengths: PathLengths) -> PathLengths:
    """One path length for each part and pixel."""
    return replace(lengths, lengths_cm=lengths.lengths_cm.mean(axis=1, keepdims=True))

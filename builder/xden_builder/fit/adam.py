"""The paper's solver: Adam on automatic gradients over dense full frames (Eq. 5 to 7).

Kept as the reference that :func:`xden_builder.fit.fit_lac` is compared with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from xden1k.rays import PathLengths
from xden1k.values.views import XRayView
from xden_builder.fit.diagnostics import finish
from xden_builder.fit.problem import Fitted, Problem
from xden_builder.fit.values import DEFAULT_ADAM, PAPER_OBJECTIVE, AdamSettings, LacFit
from xden_builder.fit.weighting import uniform

__all__ = ["fit_lac_adam"]


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

"""Whether an object's images are explained as well as its folder's errors let expect.

What a folder's labels say of errors is of most of its objects. One that moved, whose mesh is of
another shape or whose part nobody drew leaves more, and its images must not be believed as theirs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from xden_builder.fit.huber import tempered
from xden_builder.poly.estimate import Solution
from xden_builder.poly.settings import PolySettings

__all__ = ["as_far_off", "misfit"]

SOUND: Final = 0.08
"""Mean square of residuals, in the standard deviations expected, that objects of a folder leave
whose errors are told by its labels: of 125 simulated ones half leave less. It is no 1, since
errors that hang together over an object move its densities rather than leave residuals."""
WORTH_IT: Final = 1.1
"""Errors that are larger by less change no density by anything."""


def misfit(solution: Solution) -> float:
    """Mean square of the residuals of samples that meet the object, large ones tempered.

    In the standard deviations that were expected; 0 where no sample meets it.
    """
    problem, unknowns = solution.problem, solution.minimum.unknowns
    residuals = np.concatenate(
        [
            problem.scaled(unknowns, number)[0][view.lengths_cm.any(axis=(1, 2))]
            for number, view in enumerate(problem.views)
        ]
    )
    return float(tempered(residuals)) / max(len(residuals), 1)


def as_far_off(solution: Solution) -> PolySettings | None:
    """Return the settings by which errors are as large as the residuals say.

    After Birge (doi:10.1103/PhysRev.40.207), who scales standard errors by the root of the reduced
    chi-squared, but never below what the folder says nor above what is assumed of any.

    Returns
    -------
    PolySettings or None
        None where they are as large as they were told to be.
    """
    settings = solution.problem.settings
    times = min(math.sqrt(misfit(solution) / SOUND), settings.most_image_errors)
    return replace(settings, image_errors=times) if times > WORTH_IT else None

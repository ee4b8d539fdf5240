"""One attenuation coefficient per part from both views, by Levenberg-Marquardt."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.rays import PathLengths
from xden1k.values.views import XRayView
from xden_builder.capture.saturation import GainBounds
from xden_builder.fit.diagnostics import finish
from xden_builder.fit.levenberg import SMALL_GAIN, Minimum, minimise
from xden_builder.fit.problem import NOT_KNOWN, Fitted, Problem, Weighting
from xden_builder.fit.start import starting_point
from xden_builder.fit.values import DEFAULT, FitSettings, LacFit
from xden_builder.fit.weighting import uniform, variances, weights_of

__all__ = ["fit_lac"]

ROUGH_GAIN: Final = 1e-6
"""Relative to the loss, of all rounds but the last: for a million pixels a standard deviation, by
which the weights of the next round hardly change."""


def fit_lac(
    views: Sequence[tuple[PathLengths, XRayView]],
    settings: FitSettings = DEFAULT,
    dark_sd: Mapping[str, float] = NOT_KNOWN,
    gain_bounds: Mapping[str, GainBounds] = NOT_KNOWN,
) -> LacFit:
    """Fit one linear attenuation coefficient for each part to all views at once.

    The objective is Eq. 7 with weights and gains, ``sum w (g_v T_p - I_p)²``, on transmission
    (its logarithm would give the darkest pixels, which know nothing, the largest say).

    Parameters
    ----------
    views
        Path lengths and image of each view, all of the same parts.
    settings
        Gains, weights, bounds.
    dark_sd
        Noise at transmission 0 by the name of the view, where it was measured.
    gain_bounds
        Least and most gain, by the name of the view, where its air is saturated and not looked at.

    Raises
    ------
    DataError
        If a view's path lengths are of another shape or of other parts, or its air is dark.
    """
    problem = Problem.of(views, settings, dark_sd, gain_bounds)
    lower, upper = problem.bounds(settings)
    point = np.clip(starting_point(problem), lower, upper)
    rounds: list[Minimum] = []
    count = 1 if settings.weights == "none" else settings.reweightings
    for further in reversed(range(count)):
        weighting = _weighting(problem, point, settings)
        evaluate = partial(problem.evaluate, weighting=weighting)
        small_gain = ROUGH_GAIN if further else SMALL_GAIN
        rounds.append(minimise(evaluate, point, lower, upper, settings.max_iterations, small_gain))
        point = rounds[-1].unknowns
    fitted = Fitted(problem, settings, weighting, point, rounds[-1].evaluation)
    steps = sum(minimum.iterations for minimum in rounds)
    return finish(fitted, "levenberg-marquardt", steps, converged=rounds[-1].converged)


def _weighting(
    problem: Problem, point: Float64[np.ndarray, "u"], settings: FitSettings
) -> Weighting:
    """Weights of the pixels, from the model image at a point where they depend on it."""
    if settings.weights == "none":
        return uniform(problem.views)
    weighting = []
    for view, gain in zip(problem.views, point[problem.parts :].tolist(), strict=True):
        transmission = view.lengths.transmission(point[: problem.parts])
        weighting.append(weights_of(view, variances(view, transmission, gain, settings)))
    return weighting

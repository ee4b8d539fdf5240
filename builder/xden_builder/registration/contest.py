"""Poses that few pixels hardly tell apart, told by the whole fit.

What tells a padlock from the padlock turned by half is a pin behind millimetres of steel: a
thousandth of the light. Residuals in units of a twentieth do not see it; the fit of densities does,
which knows the noise of every pixel, stray light, and what the labels let expect. It does so in the
pose as it was found; where that is a tenth of a millimetre off, the strings of a racket are beside
themselves in either of its poses. So those that the fit hardly tells apart are moved once more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from xden_builder.capture import Capture
from xden_builder.poly.estimate import estimate
from xden_builder.poly.line import sampled
from xden_builder.poly.model.size import Size
from xden_builder.poly.pyramid import WORTH
from xden_builder.poly.settings import PolySettings
from xden_builder.registration.kinds import loss_of, most_of_rivals
from xden_builder.registration.placement import Found
from xden_builder.registration.reduced import reduced
from xden_builder.registration.shadow import Shadow

__all__ = ["told_apart"]

WIDE_PX: Final = 240
"""Width of the shadow, in averaged pixels."""
MOST: Final = 5
FITS_A_PART: Final = 120.0
"""Deviance for each part, of a fit that tells poses apart: four times what its pixels are worth.
More is left where something is missing, a part perhaps; large residuals count least in the loss.
"""
HARDLY_TOLD: Final = 1.1
"""Times the least improbability: less do not tell poses apart."""
SETTINGS: Final = PolySettings(pose=False, size=False)
"""The pose is judged as it was found."""


def told_apart(
    capture: Capture,
    order: Sequence[int],
    shadows: Sequence[Shadow],
    found: Sequence[Found],
    moved: Callable[[Found], Found],
) -> list[Found]:
    """Fit the object in every pose that may be right, where there are several.

    Parameters
    ----------
    capture
        Its meshes in any frame.
    order
        Which part owns space first.
    shadows
        Of its views.
    found
        The least loss first.
    moved
        Moves a pose by many rays: by what that leaves those are told that the fits do not tell.

    Returns
    -------
    list of Found
        The most probable first, of those that fits hardly tell what is least once moved, and where
        none fits the least loss first; after them those that were not fitted. As they came where
        there is one alone, or the source is not told.
    """
    rivals = [each for each in found if each.loss <= most_of_rivals(found[0])][:MOST]
    if len(rivals) < 2 or capture.tube is None:
        return list(found)
    small, _ = reduced(capture, shadows, WIDE_PX)
    fitted = [_fitted(small, order, each) for each in rivals]
    if min(map(_deviance, fitted)) > FITS_A_PART * len(small.parts):
        return [*sorted(fitted, key=loss_of), *found[len(rivals) :]]
    pairs = sorted(zip(fitted, rivals, strict=True), key=lambda pair: _improbability(pair[0]))
    most = HARDLY_TOLD * _improbability(pairs[0][0])
    close = sum(_improbability(each) <= most for each, _ in pairs)
    if close > 1:  # moved with the densities that the search gave them
        pairs[:close] = sorted(pairs[:close], key=lambda pair: moved(pair[1]).loss)
    return [*(each for each, _ in pairs), *found[len(rivals) :]]


def _fitted(capture: Capture, order: Sequence[int], found: Found) -> Found:
    """Fit densities, materials and stray light in a pose, with the size that was found there."""
    parts = found.placement.of_parts(capture.parts)
    points = np.concatenate([np.asarray(part.mesh.vertices) for part in parts])
    size = Size(float(np.exp(found.growth)), 0.0, (points.min(axis=0) + points.max(axis=0)) / 2)
    grown = tuple(replace(part, mesh=size.enlarged(part.mesh)) for part in parts)
    samples = sampled(replace(capture, parts=grown), order, SETTINGS)
    solution = estimate(samples, None, SETTINGS)
    inside = solution.problem.evaluate(solution.minimum.unknowns).loss
    deviance = inside + WORTH * found.loss
    return replace(found, density_g_cm3=solution.density_g_cm3, deviance=deviance)


def _deviance(found: Found) -> float:
    assert found.deviance is not None
    return found.deviance


def _improbability(found: Found) -> float:
    """Give what fitted poses are sorted by.

    Neither what the fit leaves nor what the outlines leave has a known scale, since what is left of
    both is what is not modelled. So they are compared by their shares, which multiply.
    """
    return _deviance(found) * found.loss

"""Poses that few pixels hardly tell apart, told by the whole fit.

What tells a padlock from the padlock turned by half is a pin behind millimetres of steel: a
thousandth of the light. Residuals in units of a twentieth do not see it; the fit of densities does,
which knows the noise of every pixel, stray light, and what the labels let expect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from xden_builder.capture import Capture
from xden_builder.poly.estimate import estimate
from xden_builder.poly.line import sampled
from xden_builder.poly.pyramid import PIXEL_SD, WORTH
from xden_builder.poly.settings import PolySettings
from xden_builder.registration.kinds import loss_of, most_of_rivals
from xden_builder.registration.placement import Found
from xden_builder.registration.reduced import reduced
from xden_builder.registration.shadow import Shadow

__all__ = ["told_apart"]

WIDE_PX: Final = 240
"""Width of the shadow, in averaged pixels."""
MOST: Final = 3
FITS_A_PART: Final = 120.0
"""Deviance for each part, of a fit that tells poses apart: four times what its pixels are worth.
More is left where something is missing, a part perhaps; large residuals count least in the loss.
"""
SETTINGS: Final = PolySettings(size=False)
"""An object gets its size where it stands."""


def told_apart(
    capture: Capture, order: Sequence[int], shadows: Sequence[Shadow], found: Sequence[Found]
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

    Returns
    -------
    list of Found
        The most probable first, or where none fits the least loss first; after them those that
        were not fitted. As they came where there is one alone, or the source is not told.
    """
    rivals = [each for each in found if each.loss <= most_of_rivals(found[0])][:MOST]
    if len(rivals) < 2 or capture.tube is None:
        return list(found)
    small, _ = reduced(capture, shadows, WIDE_PX)
    fitted = [_fitted(small, order, each) for each in rivals]
    fits = min(map(_deviance, fitted)) <= FITS_A_PART * len(small.parts)
    return [*sorted(fitted, key=_deviance if fits else loss_of), *found[len(rivals) :]]


def _fitted(capture: Capture, order: Sequence[int], found: Found) -> Found:
    """Refine a pose and fit densities, materials and stray light in it."""
    placed = replace(capture, parts=found.placement.of_parts(capture.parts))
    samples = sampled(placed, order, SETTINGS)
    assert samples.pose is not None
    placement = found.placement.followed_by(samples.pose.pose)
    solution = estimate(samples, None, SETTINGS)
    inside = solution.problem.evaluate(solution.minimum.unknowns).loss
    outlines = WORTH * (samples.pose.rms_after / PIXEL_SD) ** 2
    return Found(placement, found.loss, solution.density_g_cm3, inside + outlines)


def _deviance(found: Found) -> float:
    assert found.deviance is not None
    return found.deviance

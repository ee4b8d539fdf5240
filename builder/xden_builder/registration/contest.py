"""Poses that explain the images equally well, told by what the labels let expect.

Where poses are compared, densities are free: halves of one shape swap theirs in the box turned by
half. The whole fit knows what the parts are said to be, stray light, and the noise of every pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from xden_builder.capture import Capture
from xden_builder.capture.space import Space
from xden_builder.poly.estimate import estimate
from xden_builder.poly.line import sampled
from xden_builder.poly.model.size import Size
from xden_builder.poly.settings import PolySettings
from xden_builder.registration.placement import Found
from xden_builder.registration.reduced import reduced
from xden_builder.registration.shadow import Shadow

__all__ = ["told_by_labels"]

WIDE_PX: Final = 240
"""Width of the shadow, in averaged pixels."""
SETTINGS: Final = PolySettings(pose=False, size=False)
"""The pose is judged as it was found."""


def told_by_labels(
    capture: Capture, space: Space, shadows: Sequence[Shadow], found: Sequence[Found]
) -> list[Found]:
    """Fit the object in every pose that the images do not tell from the best.

    Parameters
    ----------
    capture
        Its meshes in any frame.
    space
        What is each part's.
    shadows
        Of its views.
    found
        The best first.

    Returns
    -------
    list of Found
        Those that were fitted, the most probable first; after them the others. As they came where
        there is one alone, the source is not told, or a view was turned by hand, which needs a pose
        of its own.
    """
    rivals = [each for each in found if each.as_good_as(found[0])]
    if len(rivals) < 2 or capture.tube is None or capture.turned:
        return list(found)
    small, fewer, _ = reduced(capture, space, shadows, WIDE_PX)
    fitted = [_fitted(small, fewer, each) for each in rivals]
    others = [each for each in found if each not in rivals]
    return [*sorted(fitted, key=lambda each: each.improbability), *others]


def _fitted(capture: Capture, space: Space, found: Found) -> Found:
    """Fit densities, materials and stray light in a pose, with the size that was found there."""
    there = space.moved(found.placement.moved)
    points = np.concatenate([np.asarray(mesh.vertices) for mesh in there.meshes])
    size = Size(float(np.exp(found.growth)), 0.0, (points.min(axis=0) + points.max(axis=0)) / 2)
    samples = sampled(capture, there.moved(size.enlarged), SETTINGS)
    solution = estimate(samples, SETTINGS)
    deviance = solution.problem.evaluate(solution.minimum.unknowns).loss
    return replace(found, density_g_cm3=solution.density_g_cm3, deviance=deviance)

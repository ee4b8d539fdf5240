"""Whether an object's images are explained as well as its folder's errors let expect.

What a folder's labels say of errors is of most of its objects. One that moved, whose mesh is of
another shape or whose part nobody drew leaves more, and its images must not be believed as theirs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.stats import median_abs_deviation

from xden1k.values.arrays import Mask
from xden_builder.fit.huber import of_noise, tempered
from xden_builder.poly.estimate import Solution
from xden_builder.poly.model.pixels import block_width
from xden_builder.poly.samples import Seen
from xden_builder.poly.settings import PolySettings

__all__ = ["as_far_off", "misfit"]

SOUND: Final = 0.08
"""Mean square of residuals, in the standard deviations expected: the median of 125 simulated
objects of a folder whose images err by 0.15 of what is assumed. It is not 1, since errors that hang
together over an object move its densities rather than leave residuals."""
NOISE_SHARE: Final = 0.1
"""Of what noise leaves of the images: it is known to that."""
WORTH_IT: Final = 1.1
"""Errors that are larger by less are not worth a second fit (assumed)."""


def misfit(solution: Solution) -> float:
    """Mean square of the residuals of samples that meet the object, less that of their noise.

    In the standard deviations that were expected, large ones tempered; at least 0, and 0 where no
    sample meets it.
    """
    problem, unknowns = solution.problem, solution.minimum.unknowns
    left = noise = count = 0.0
    for number, (seen, view, sd) in enumerate(
        zip(solution.seen, problem.views, problem.sds, strict=True)
    ):
        mine = view.lengths_cm.any(axis=(1, 2)) & ~view.at_least
        residuals, _, _ = problem.scaled(unknowns, number)
        left += tempered(residuals[mine])
        averaged = np.where(view.is_block, block_width(seen.lengths, seen.blocks) ** 2, 1)
        quanta = max(_air_variance(seen, solution.scene.saturated[number]) - seen.noise_sd**2, 0.0)
        variance = (seen.noise_sd**2 + quanta * view.measured.clip(0, 1)) / averaged
        noise += of_noise((variance / sd**2)[mine])
        count += float(mine.sum())
    return max(left - (1 + NOISE_SHARE) * noise, 0.0) / max(count, 1.0)


def _air_variance(seen: Seen, saturated: Mask) -> float:
    """Return that of a pixel's noise beside the object, by differences of neighbours.

    The noise of a panel that blurs it is underestimated, most so in blocks.
    """
    air = seen.view.valid & ~saturated
    air.flat[seen.lengths.pixels] = False
    both = air[:, 1:] & air[:, :-1]
    if not both.any():
        return 0.0
    steps = np.diff(seen.view.transmission, axis=1)[both]
    return float(median_abs_deviation(steps, scale="normal")) ** 2 / 2


def as_far_off(solution: Solution) -> PolySettings | None:
    """Return the settings by which errors of images are as large as the residuals say.

    After Birge (doi:10.1103/PhysRev.40.207), who scales standard errors by the root of the reduced
    chi-squared, but in one step, never below what the folder says nor above what is assumed of any.
    How far apart materials are told, and compositions, stay as the folder says.

    Returns
    -------
    PolySettings or None
        None where they are as large as they were told to be.
    """
    settings = solution.problem.settings
    if settings.most_image_errors <= WORTH_IT:
        return None
    times = min(math.sqrt(misfit(solution) / SOUND), settings.most_image_errors)
    larger = times * settings.image_errors
    return replace(settings, image_errors=larger) if times > WORTH_IT else None

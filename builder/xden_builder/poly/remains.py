"""What a pose leaves of the images: by that one is told from another, or doubted.

What neighbouring pixels differ by tells poses as well: :func:`xden_builder.poly.edges.edge_doubt`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden_builder.poly.pyramid import PIXEL_SD, SHADED, Level

__all__ = ["all_left", "doubt", "much_left"]

DOUBT_SCALE: Final = 0.1
"""Of residuals where poses are doubted: half a hundredth of the light, whole objects leave as much.
"""
MUCH_LEFT, MUCH_LEFT_THERE = 0.05, 0.15
"""Mean square of residuals in the windows, and where the object is: of whole objects one in
forty leaves as much in either, of another simulator's one in thirteen, of those a part of which has
no mesh nine in ten."""


def much_left(
    level: Level,
    unknowns: Float64[np.ndarray, "u"],
    residuals: Sequence[Float64[np.ndarray, "_n"]],
    times: float = 1.0,
) -> bool:
    """Whether so much is left that something may have no mesh, beside the object or in it.

    With ``times`` whether so many times as much is.
    """
    pairs = zip(level.counted(residuals), level.met(unknowns), strict=True)
    there = np.concatenate([off[counts & met] for (counts, off), met in pairs])
    left_there = level.tempered(there) / max(len(there), 1)
    left = level.mean_left(residuals)
    return left_there > times * MUCH_LEFT_THERE or left > times * MUCH_LEFT


def doubt(
    level: Level, unknowns: Float64[np.ndarray, "u"], residuals: Sequence[Float64[np.ndarray, "_n"]]
) -> float:
    """Mean of Cauchy's loss where the object is or something else takes light.

    Of unlike poses the right one leaves least of this: it explains most pixels well, whatever it
    leaves of the others, of a part of a wrong label perhaps or of one without a mesh. All pixels
    count, also those that are not compared, since each pose has windows of its own.
    """
    gains, _ = level.lights(unknowns)
    there = level.counted(residuals), level.met(unknowns), gains, level.measured
    inside = [
        off[counts & (met | (seen < SHADED * gain))]
        for (counts, off), met, gain, seen in zip(*there, strict=True)
    ]
    off = np.concatenate([*inside, *_shade_beside(level, gains)]) / DOUBT_SCALE
    return float(np.log1p(off**2).sum() / max(len(off), 1))


def all_left(
    level: Level, unknowns: Float64[np.ndarray, "u"], residuals: Sequence[Float64[np.ndarray, "_n"]]
) -> float:
    """Sum of squares as of :meth:`Level.left`, and those of shade that is not compared."""
    gains, _ = level.lights(unknowns)
    return level.left(residuals) + sum(map(level.tempered, _shade_beside(level, gains)))


def _shade_beside(level: Level, gains: Sequence[float]) -> Iterator[Float64[np.ndarray, "_b"]]:
    """Yield the residuals of each view where something shades pixels that are not compared."""
    for gain, whole, mask in zip(gains, level.whole, level.masks, strict=True):
        seen = whole.image[whole.known & ~whole.at_least & ~mask].astype(np.float64)
        yield (gain - seen[seen < SHADED * gain]) / PIXEL_SD

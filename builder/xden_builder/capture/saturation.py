"""Saturated pixels: brighter than the panel can tell, so known from below alone."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import median_abs_deviation

from xden1k.values.arrays import Image, Mask
from xden1k.values.views import XRayView
from xden_builder.capture.borders import BORDERS

__all__ = ["MOST_GAIN", "GainBounds", "brighter_than_light", "completed", "gain_bounds"]

MOST_GAIN: Final = 2.0
"""No view is exposed more than so many times as long as its open field."""
NEARLY: Final = 0.95
"""Of the saturation: what is as bright is air, or next to none stands before it."""
TOP: Final = 0.95
"""Quantile of the saturation that stands for the brightest one: dust on the flat is left out."""
FEWEST: Final = 50
"""Pixels that tell the level of air."""
ALIKE: Final = 0.1
"""Pixels that differ from air by less are air, too."""
FEW: Final = 0.1
"""Beside so many, fewer saturated ones by this factor are faults or letters, and air is not
saturated."""
LEAST_AIR: Final = 1 / MOST_GAIN
"""Transmission: along a border, what is darker is no air."""
BRIGHTEST: Final = 1.25
"""Times air and times the open field: no light is as bright."""
NOISE_SIGMAS: Final = 8.0
"""Above air, pixels that are saturated and as bright are no noise of it."""

Field = Float[np.ndarray, "rows columns"]

GainBounds = tuple[float, float]
"""Least and most factor on the open field; equal where air tells it."""


class Air(NamedTuple):
    """Air within the panel's range: its transmission, its noise's deviation, and its pixels."""

    level: float
    noise_sd: float
    pixels: int


def brighter_than_light(transmission: Field, saturated: Mask) -> Mask:
    """Return pixels that are brighter than air can be: hot ones, and letters drawn into an image.

    Parameters
    ----------
    transmission
        Not a number where nothing was measured.
    saturated
        Known from below alone.

    Returns
    -------
    array
        Shape (rows, columns). Nowhere if no border tells that air is within the panel's range, or
        they are no exceptions.
    """
    air = _air(transmission, saturated)
    if air is None:
        return np.zeros_like(saturated)
    full = saturated & (transmission > air.level + NOISE_SIGMAS * air.noise_sd)
    above = full | (np.isfinite(transmission) & (transmission > BRIGHTEST * max(air.level, 1.0)))
    return above if above.sum() < FEW * air.pixels else np.zeros_like(saturated)


def _air(transmission: Field, saturated: Mask) -> Air | None:
    """Tell air by the border that is brightest in its median; None where it is saturated."""
    found = [_along(transmission[border], saturated[border]) for border in BORDERS.values()]
    level, noise_sd = max(found)
    if not LEAST_AIR <= level < np.inf:
        return None
    alike = ~saturated & (np.abs(transmission - level) < ALIKE * level)
    return Air(level, noise_sd, int(alike.sum()))


def _along(transmission: Field, saturated: Mask) -> tuple[float, float]:
    """Return median and deviation of what was measured along a border."""
    measured = np.isfinite(transmission)
    if not measured.any():
        return 0.0, 0.0
    seen = np.where(saturated, np.inf, transmission)[measured]
    level = float(np.median(seen))
    if not np.isfinite(level):
        return level, 0.0
    return level, float(median_abs_deviation(seen, scale="normal"))


def completed(view: XRayView, at_least: Image | None) -> tuple[XRayView, Mask]:
    """Give saturated pixels the least transmission they can have, and say which they are.

    Parameters
    ----------
    view
        The radiograph; saturated pixels are not valid.
    at_least
        As of :class:`xden_builder.capture.Capture`; None where no pixel is saturated.

    Returns
    -------
    view
        With saturated pixels valid.
    saturated
        Shape (rows, columns).
    """
    if at_least is None:
        return view, np.zeros(view.valid.shape, dtype=np.bool_)
    saturated = np.isfinite(at_least)
    image = np.where(saturated, at_least, view.transmission)
    whole = XRayView(view.name, image, view.valid | saturated, view.geometry)
    return whole, saturated


def gain_bounds(view: XRayView, at_least: Image | None) -> GainBounds | None:
    """Tell between what bounds the gain of a view lies whose air is saturated.

    An open field is not even, so that some air may be within the panel's range where most is not:
    whatever is as bright as the brightest saturation.

    Returns
    -------
    tuple or None
        None where most air is not saturated, so that it tells the gain by itself.
    """
    if at_least is None:
        return None
    limits = at_least[np.isfinite(at_least)]
    low, top = (float(each) for each in np.quantile(limits, (1 - TOP, TOP)))
    seen = view.transmission[view.valid]
    if (seen > NEARLY * low).sum() >= len(limits):
        return None
    whole, saturated = completed(view, at_least)
    air = _air(np.where(whole.valid, whole.transmission, np.nan), saturated)
    if air is not None and len(limits) < FEW * air.pixels:
        return None
    bright = seen[seen >= top]
    if len(bright) >= FEWEST:
        level = float(np.median(bright))
        return level, level
    return top, max(MOST_GAIN, top)

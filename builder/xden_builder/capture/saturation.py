"""Saturated pixels: brighter than the panel can tell, so known from below alone."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Float

from xden1k.values.arrays import Image, Mask
from xden1k.values.views import XRayView

__all__ = ["MOST_GAIN", "GainBounds", "brighter_than_light", "completed", "gain_bounds"]

MOST_GAIN: Final = 2.0
"""No view is exposed more than so many times as long as its open field."""
NEARLY: Final = 0.95
"""Of the saturation: what is as bright is air, or next to none stands before it."""
TOP: Final = 0.95
"""Quantile of the saturation that stands for the brightest one: dust on the flat is left out."""
FEWEST: Final = 50
"""Pixels that tell the level of air."""
AIR: Final = 0.99
"""Quantile of pixels within the panel's range that stands for air, where they tell it."""
ALIKE: Final = 0.1
"""Pixels that differ from it by less are air, too."""
FEW: Final = 0.1
"""Beside so many, fewer saturated ones by this factor are faults or letters, and air is not
saturated."""
BRIGHTEST: Final = 1.25
"""Times air and times the open field: no light is as bright."""

Field = Float[np.ndarray, "rows columns"]

GainBounds = tuple[float, float]
"""Least and most factor on the open field; equal where air tells it."""


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
        Shape (rows, columns). Nowhere if air is saturated, or they are no exceptions.
    """
    seen = transmission[~saturated & np.isfinite(transmission)]
    if not seen.size:
        return np.zeros_like(saturated)
    air, level = _air(seen)
    above = np.isfinite(transmission) & (transmission > BRIGHTEST * max(level, 1.0))
    few = max(above.sum(), saturated.sum()) < FEW * air
    return above if few else np.zeros_like(saturated)


def _air(seen: Float[np.ndarray, "n"]) -> tuple[int, float]:
    """Count pixels like the brightest within the panel's range, and give their level."""
    level = float(np.quantile(seen, AIR))
    return int((np.abs(seen - level) < ALIKE * level).sum()), level


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
    if (seen > NEARLY * low).sum() >= len(limits) or len(limits) < FEW * _air(seen)[0]:
        return None
    bright = seen[seen >= top]
    if len(bright) >= FEWEST:
        level = float(np.median(bright))
        return level, level
    return top, max(MOST_GAIN, top)

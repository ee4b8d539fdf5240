"""Saturated pixels: brighter than the panel can tell, so known from below alone."""

from __future__ import annotations

from typing import Final

import numpy as np

from xden1k.values.arrays import Image, Mask
from xden1k.values.views import XRayView

__all__ = ["MOST_GAIN", "GainBounds", "completed", "gain_bounds"]

MOST_GAIN: Final = 2.0
"""No view is exposed more than so many times as long as its open field."""
NEARLY: Final = 0.95
"""Of the saturation: what is as bright is air, or next to none stands before it."""
TOP: Final = 0.95
"""Quantile of the saturation that stands for the brightest one: dust on the flat is left out."""
FEWEST: Final = 50
"""Pixels that tell the level of air."""

GainBounds = tuple[float, float]
"""Least and most factor on the open field; equal where air tells it."""


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
    bright = seen[seen >= top]
    if len(bright) >= FEWEST:
        level = float(np.median(bright))
        return level, level
    return top, max(MOST_GAIN, top)

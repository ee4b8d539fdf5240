"""How a radiograph is drawn: its attenuation, in greys, at a height that can be read."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import PowerNorm

from xden1k.values.arrays import Image
from xden1k.values.views import XRayView
from xden1k.values.windows import Window, pixel_aspect

__all__ = ["NO_VALUE", "attenuation", "grey_scale", "readable_aspect", "reduced"]

NO_VALUE: Final = "#e9a23b"
"""Colour of pixels without a value: invalid, or seen through a part of unknown attenuation."""
OPAQUE: Final = 1e-4
"""Transmission below which a picture makes no difference."""
SMALL_PX: Final = 256
"""So many pixels along each edge are enough for a small picture."""
SLENDER: Final = 0.25
"""Height over width below which a radiograph is stretched."""


def attenuation(transmission: Image) -> Image:
    """Return -ln T: what light and heavy matter both show in. Not a number stays so."""
    return np.asarray(-np.log(transmission.clip(OPAQUE, 1.0)))


def grey_scale(*images: Image) -> ScalarMappable:
    """Greys for one or several attenuations: air is black.

    By the root, so that plastic beside metal is not black too.
    """
    highest = max(float(np.nanmax(image, initial=1e-3)) for image in images)
    return ScalarMappable(PowerNorm(0.5, 0, highest), colormaps["gray"].with_extremes(bad=NO_VALUE))


def readable_aspect(shape: tuple[int, ...], aspect: float) -> tuple[float, float]:
    """Height of a pixel over its width to draw it with, and how many times the true one that is.

    What would be a hairline is drawn a quarter as high as it is wide, or as wide as it is high.

    Parameters
    ----------
    shape
        Rows and columns of the radiograph.
    aspect
        True height of a pixel over its width.

    Examples
    --------
    >>> readable_aspect((4, 400), 1.0)
    (25.0, 25.0)
    """
    slender = shape[0] * aspect / shape[1]
    times = min(max(slender, SLENDER), 1 / SLENDER) / slender
    return aspect * times, times


def reduced(view: XRayView, window: Window) -> tuple[Image, float]:
    """Attenuation at some pixels of a radiograph, and the height over width to draw each with.

    Parameters
    ----------
    view
        The radiograph.
    window
        Rows and columns to show.
    """
    image = np.where(view.valid, view.transmission, np.float32(np.nan))[window]
    rows, columns = (-(-size // SMALL_PX) for size in image.shape)
    image = attenuation(image[::rows, ::columns])
    return image, readable_aspect(image.shape, pixel_aspect(view) * rows / columns)[0]

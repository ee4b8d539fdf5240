"""Centres of the shadows of balls in a radiograph."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import center_of_mass, find_objects, label, median_filter

from xden1k.errors import DataError
from xden1k.values.views import XRayView
from xden_builder.capture.gaps import without_gaps

__all__ = ["shadow_centres"]

Light = Float64[np.ndarray, "rows columns"]

DARK: Final = 0.5
"""Share of the light around it below which a pixel is a ball's."""
BACKGROUND: Final = 5.0
"""Side of the square whose median is the light around a ball, in diameters of its shadow."""
COARSE: Final = 2.0
"""Pixels along a diameter that are enough for that median."""
MARGIN: Final = 0.35
"""Around a shadow, in diameters: where the light around it is read, beyond blur."""
LEAST_SHARE: Final = 0.4
"""Of a ball's area that a shadow covers at least: less is dust."""
LEAST_DIAMETER_PX: Final = 4.0


def shadow_centres(view: XRayView, diameter_px: float) -> Float64[np.ndarray, "balls 2"]:
    """Find the centre of mass of the shadow of every ball: column and row.

    Light is compared with that above and below, between which a tube or a plate changes evenly.

    Parameters
    ----------
    view
        The radiograph.
    diameter_px
        About what the shadow of a ball measures.

    Raises
    ------
    DataError
        If shadows are smaller than a few pixels.
    """
    if diameter_px < LEAST_DIAMETER_PX:
        raise DataError(
            f"view {view.name}: shadows of balls are {diameter_px:.1f} pixels wide, expected "
            f"{LEAST_DIAMETER_PX:g} or more: larger balls, or a finer image"
        )
    image = np.nan_to_num(without_gaps(view), nan=1.0)
    around = _light_around(image, diameter_px)
    blobs, _ = label(image < DARK * around)
    margin = max(round(MARGIN * diameter_px), 2)
    least = LEAST_SHARE * np.pi / 4 * diameter_px**2
    centres = [
        _centre(image, blob, margin)
        for number, blob in enumerate(find_objects(blobs), start=1)
        if (blobs[blob] == number).sum() >= least and _is_round(blob)
    ]
    return np.array(centres).reshape(-1, 2)


def _light_around(image: Light, diameter_px: float) -> Light:
    """Median of a square about each pixel, of a few pixels for each shadow."""
    coarse = max(int(diameter_px / COARSE), 1)
    medians = median_filter(image[::coarse, ::coarse], size=2 * round(BACKGROUND * COARSE / 2) + 1)
    rows, columns = (np.arange(side) // coarse for side in image.shape)
    return np.asarray(medians[np.ix_(rows, columns)])


def _is_round(blob: tuple[slice, slice]) -> bool:
    """Whether a box is as high as wide: the edge of a tube is not."""
    height, width = (int(side.stop - side.start) for side in blob)
    return max(height, width) <= 1.5 * min(height, width)


def _centre(image: Light, blob: tuple[slice, slice], margin: int) -> tuple[float, float]:
    """Centre of what a ball takes away from the light between the rows above and below it."""
    rows, columns = (slice(max(side.start - margin, 0), side.stop + margin) for side in blob)
    patch = image[rows, columns]
    share = np.linspace(0.0, 1.0, len(patch))[:, None]
    above, below = patch[:2].mean(axis=0), patch[-2:].mean(axis=0)
    taken = 1 - patch / ((1 - share) * above + share * below)
    row, column = center_of_mass(taken)
    return columns.start + float(column), rows.start + float(row)

"""How much softer the edges of a radiograph are than those of a model image."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import binary_dilation, gaussian_filter1d
from scipy.optimize import lsq_linear

from xden1k.values.arrays import Image, Mask
from xden_builder.fit.crops import Crop

__all__ = ["MOST_BLUR", "NONE", "Blur", "blur_of"]

MOST_BLUR: Final = 0.07
"""Of an object's shadow, light that blur moved: of 237 simulated objects with the focal spot and
the panel of a usual scanner one has more, a comb with teeth a pixel wide; 0.13 to 0.21 of a pencil
blurred by 0.7 to 1 pixel, whose lead is read a half to two thirds too light."""
NEAR_PX: Final = 4
"""Beside the object: light that left the shadow is found there."""
TRIED_PX: Final = 1.0
"""Standard deviation of the blur that is tried; narrower and wider ones look like some share of
it."""
CLEARLY: Final = 0.5
"""Of the squares that the object beside its place would leave, blur must leave less than this."""
EDGE: Final = 0.1
"""Of what the tried blur moves at the sharpest edge: elsewhere an image says nothing of it."""
LEAST: Final = 1e-4
"""Of the open field: what moves less is no edge."""

Values = Float64[np.ndarray, "*shape"]


@dataclass(frozen=True, slots=True)
class Blur:
    """Blur beyond that of the model, whose edges are as sharp as its pixels.

    Parameters
    ----------
    rows_px, columns_px
        Standard deviation from row to row, and from column to column.
    share
        Root mean square of the light that it moves, over that of the object's shadow.
    is_clear
        Whether it explains the edges far better than an object that lies beside its place.
    """

    rows_px: float
    columns_px: float
    share: float
    is_clear: bool

    @property
    def harms(self) -> bool:
        """Whether densities of thin parts suffer."""
        return self.is_clear and self.share > MOST_BLUR


NONE: Final = Blur(0.0, 0.0, 0.0, is_clear=False)


def blur_of(measured: Image, valid: Mask, on_object: Mask, model: Image, gain: float) -> Blur:
    """Find the blur that takes a model image nearest to a radiograph.

    A blur of standard deviation s changes an image by s² / 2 times its second derivative: what a
    small one changes is its square times what one of a pixel does. That square is found by least
    squares over residuals at the object's edges, together with another brightness of the object,
    and compared with a shift by part of a pixel. Wide blurs come out too narrow.

    Parameters
    ----------
    measured, valid
        Shape (rows, columns): transmission of the radiograph, and where it is one.
    on_object
        Shape (rows, columns): valid pixels whose ray meets a part.
    model
        Shape (rows, columns): transmission.
    gain
        Open-field factor of the model.

    Examples
    --------
    >>> model = np.ones((40, 40), dtype=np.float32)
    >>> model[10:30, 15:25] = 0.5
    >>> softer = gaussian_filter1d(model, 1.0, axis=0)
    >>> blur = blur_of(softer, np.full((40, 40), True), model < 1, model, gain=1.0)
    >>> round(blur.rows_px, 2), round(blur.columns_px, 2), blur.harms
    (1.0, 0.0, True)
    """
    if not on_object.any():
        return NONE
    box = Crop.around(np.flatnonzero(on_object), on_object.shape, 2 * NEAR_PX).box
    sharp = model[box].astype(np.float64)
    near = binary_dilation(on_object[box], iterations=NEAR_PX) & valid[box]
    softer = [gaussian_filter1d(sharp, TRIED_PX, axis=axis) - sharp for axis in (0, 1)]
    strength = np.where(near, np.hypot(*softer), 0.0)
    edges = strength > max(EDGE * strength.max(), LEAST)
    if not edges.any():
        return NONE
    residual = (measured[box].astype(np.float64) - sharp)[edges]

    def explained(*changes: Values) -> tuple[Values, float]:
        columns = np.stack([each[edges] for each in (*changes, gain - sharp)], axis=1)
        least = [0.0] * len(changes) + [-np.inf]  # an object may be brighter or darker
        best = lsq_linear(columns, residual, (least, np.inf), method="bvls")
        return best.x[: len(changes)], 2 * float(best.cost)

    squares, left = explained(*softer)
    beside = min(explained(*shifts)[1] for shifts in product(*map(_shifts, (sharp, sharp), (0, 1))))
    light = float(np.square(np.tensordot(squares, softer, axes=1)[near]).mean())
    shadow = float(np.square(gain - sharp[near]).mean())
    rows_px, columns_px = (TRIED_PX * np.sqrt(squares)).tolist()
    return Blur(rows_px, columns_px, float(np.sqrt(light / shadow)), left < CLEARLY * beside)


def _shifts(image: Values, axis: int) -> tuple[Values, Values]:
    """Return what a shift by a pixel changes, either way along an axis."""
    forth, back = (np.roll(image, step, axis) - image for step in (1, -1))
    return forth, back

"""How much softer the edges of a radiograph are than those of a model image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import binary_dilation, gaussian_filter1d

from xden1k.values.arrays import Image, Mask
from xden_builder.fit.crops import Crop

__all__ = ["MOST_BLUR", "Blur", "blur_of"]

MOST_BLUR: Final = 0.07
"""Of an object's shadow, light that blur moved: at most 0.04 in 18 simulated objects with the
focal spot and the panel of a usual scanner; 0.1 to 0.19 of a pencil blurred by 0.7 to 1 pixel,
whose lead is read a half to two thirds too light."""
NEAR_PX: Final = 4
"""Beside the object: light that left the shadow is found there."""
TRIED_PX: Final = 1.0
"""Standard deviation of the blur that is tried; narrower and wider ones look like some share of
it."""
ROUNDS: Final = 5
TAIL: Final = 2.0
"""Residuals of more than so many times the usual are of something else, and count less."""
LEAST: Final = 1e-4
"""Of the open field: no residual is smaller for sure."""
EDGE: Final = 0.1
"""Of what the tried blur moves at the sharpest edge: elsewhere an image says nothing of it."""


@dataclass(frozen=True, slots=True)
class Blur:
    """Blur beyond that of the model, whose edges are as sharp as its pixels.

    Parameters
    ----------
    rows_px, columns_px
        Standard deviation from row to row, and from column to column.
    share
        Root mean square of the light that it moves, over that of the object's shadow.
    """

    rows_px: float
    columns_px: float
    share: float

    @property
    def harms(self) -> bool:
        """Whether densities of thin parts suffer."""
        return self.share > MOST_BLUR


def blur_of(measured: Image, valid: Mask, on_object: Mask, model: Image, gain: float) -> Blur:
    """Find the blur that takes a model image nearest to a radiograph.

    A blur of standard deviation s changes an image by s² / 2 times its second derivative: what a
    small one changes is its square times what one of a pixel does. That square is found by least
    squares over residuals at the object's edges, reweighted by Cauchy's loss. Wide blurs come out
    too narrow. Edges that lie elsewhere hardly look like any: they are brighter on one side of the
    object and darker on the other.

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
        return Blur(0.0, 0.0, 0.0)
    box = Crop.around(np.flatnonzero(on_object), on_object.shape, 2 * NEAR_PX).box
    sharp = model[box].astype(np.float64)
    near = binary_dilation(on_object[box], iterations=NEAR_PX) & valid[box]
    residual = (measured[box].astype(np.float64) - sharp)[near]
    moved = np.stack(
        [(gaussian_filter1d(sharp, TRIED_PX, axis=axis) - sharp)[near] for axis in (0, 1)], axis=1
    )
    squares = _reweighted(moved, residual)
    shadow = float(np.square(gain - sharp[near]).mean())
    light = float(np.square(moved @ squares).mean())
    rows_px, columns_px = (TRIED_PX * np.sqrt(squares)).tolist()
    return Blur(rows_px, columns_px, float(np.sqrt(light / shadow)) if shadow > 0 else 0.0)


def _reweighted(
    moved: Float64[np.ndarray, "n 2"], residual: Float64[np.ndarray, "n"]
) -> Float64[np.ndarray, "2"]:
    """Return how many times each column explains the residuals, no less than 0."""
    strength = np.linalg.norm(moved, axis=1)
    edges = strength > EDGE * strength.max()
    moved, residual, times = moved[edges], residual[edges], np.zeros(2)
    for _ in range(ROUNDS):
        left = residual - moved @ times
        usual = 1.4826 * float(np.median(np.abs(left))) + LEAST
        root = 1 / np.sqrt(1 + np.square(left / (TAIL * usual)))
        times = np.linalg.lstsq(moved * root[:, None], residual * root, rcond=None)[0].clip(min=0.0)
    return np.asarray(times)

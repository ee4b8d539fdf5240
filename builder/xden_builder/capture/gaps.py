"""Dead pixels and lines of an image, filled in where the whole image is looked at."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import binary_dilation, uniform_filter
from scipy.sparse import csc_array
from scipy.sparse.linalg import spsolve

from xden1k.values.views import XRayView

__all__ = ["without_gaps"]

AROUND_PX, SHARE = 7, 0.5
"""A pixel that is not valid is filled in where more than such a share of a square around it is:
lines two pixels wide are, and what a mask or saturation leaves out is not."""
AIR: Final = 1.0
"""Transmission of what is not valid beside a gap."""
LAPLACIAN_AT: Final = np.array([[0, 0], [0, 1], [0, -1], [1, 0], [-1, 0]])
LAPLACIAN: Final = np.array([-4.0, 1.0, 1.0, 1.0, 1.0])
"""Pixels from a pixel, rows and columns, and their weights in its Laplacian."""


def without_gaps(view: XRayView) -> Float64[np.ndarray, "rows columns"]:
    """Fill dead pixels and lines in so that the image is as smooth as it can be.

    The squares of its Laplacian are least. A fit leaves such pixels out; where a shadow is
    measured as a whole, its middle or its outline, they would count as light.

    Parameters
    ----------
    view
        The radiograph.

    Returns
    -------
    array
        Shape (rows, columns): transmission, not a number where more than a gap is not valid.
    """
    image = np.where(view.valid, view.transmission.astype(np.float64), np.nan)
    gaps = ~view.valid & (uniform_filter(view.valid.astype(np.float64), AROUND_PX) > SHARE)
    if not gaps.any():
        return image
    near = np.argwhere(binary_dilation(gaps))
    places = (near[:, None] + LAPLACIAN_AT).clip(0, np.array(image.shape) - 1)  # rims go on
    flat = np.ravel_multi_index((places[..., 0], places[..., 1]), image.shape)
    number = np.full(image.size, -1)
    number[gaps.ravel()] = np.arange(gaps.sum())
    is_gap = number[flat] >= 0
    weights = np.broadcast_to(LAPLACIAN, flat.shape)
    known = np.where(view.valid, image, AIR).ravel()[flat]
    rest = (weights * np.where(is_gap, 0.0, known)).sum(axis=1)
    entries = np.nonzero(is_gap)[0], number[flat][is_gap]
    unknown = csc_array((weights[is_gap], entries), shape=(len(near), gaps.sum()))
    image[gaps] = spsolve((unknown.T @ unknown).tocsc(), -unknown.T @ rest)
    return image

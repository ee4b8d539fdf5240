"""Dead pixels and lines of an image, filled in where the whole image is looked at."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import binary_closing, binary_dilation, distance_transform_edt
from scipy.sparse import csc_array
from scipy.sparse.linalg import spsolve

from xden1k.values.arrays import Mask
from xden1k.values.views import XRayView

__all__ = ["without_gaps"]

WIDEST_PX: Final = 3
"""Between pixels that are valid, in a row or in a column: a dead pixel or line, and no mask."""
MOST: Final = 200_000
"""Pixels that are filled in, of any image: more are no panel's faults, and take long."""
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
        Shape (rows, columns): transmission, not a number where more than :data:`WIDEST_PX` pixels
        in a row and in a column are not valid, or where there are too many gaps.
    """
    image = np.where(view.valid, view.transmission.astype(np.float64), np.nan)
    gaps = _gaps(view.valid)
    if not 0 < gaps.sum() <= MOST:
        return image
    near = np.argwhere(binary_dilation(gaps))
    places = (near[:, None] + LAPLACIAN_AT).clip(0, np.array(image.shape) - 1)  # rims go on
    flat = np.ravel_multi_index((places[..., 0], places[..., 1]), image.shape)
    number = np.full(image.size, -1)
    number[gaps.ravel()] = np.arange(gaps.sum())
    is_gap = number[flat] >= 0
    weights = np.broadcast_to(LAPLACIAN, flat.shape)
    rest = (weights * np.where(is_gap, 0.0, _nearest(image).ravel()[flat])).sum(axis=1)
    entries = np.nonzero(is_gap)[0], number[flat][is_gap]
    unknown = csc_array((weights[is_gap], entries), shape=(len(near), gaps.sum()))
    image[gaps] = spsolve((unknown.T @ unknown).tocsc(), -unknown.T @ rest)
    return image


def _gaps(valid: Mask) -> Mask:
    """Say what lies close between valid pixels, and, where lines cross, between what does."""
    beyond = WIDEST_PX + 1
    known = np.pad(valid, beyond, constant_values=True)
    for _ in range(2):
        closed = [binary_closing(known, np.ones(side)) for side in ((1, beyond), (beyond, 1))]
        known = known | closed[0] | closed[1]
    return np.asarray(known[beyond:-beyond, beyond:-beyond] & ~valid)


def _nearest(
    image: Float64[np.ndarray, "rows columns"],
) -> Float64[np.ndarray, "rows columns"]:
    """Give each pixel that is not a number the value of the nearest that is one."""
    unknown = np.isnan(image)
    rows, columns = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    return np.asarray(image[rows, columns])

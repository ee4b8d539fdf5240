"""The picture a chat model is shown of each region: the whole, where it is, and close up."""

from __future__ import annotations

import numpy as np
import PIL.Image
from jaxtyping import Bool, UInt8
from scipy import ndimage

from xden1k.values.arrays import Mask
from xden_baselines.chat.candidates import Picture

__all__ = ["TILE_PX", "three_tiles"]

TILE_PX = 224
"""Edge of each tile."""
OVERLAY = 0.4
"""How much of the second tile's red hides what is below."""
RED = np.array([255.0, 0.0, 0.0])


def three_tiles(picture: Picture, region: Mask) -> UInt8[np.ndarray, "224 672 3"]:
    """Put three tiles side by side: the picture; the region in red; its largest piece, cut out.

    Tiles keep their proportions on black. The original's prompt calls the overlay red, its code
    paints any colour; here it is red.

    Parameters
    ----------
    picture
        The view.
    region
        True on at least one pixel.

    Returns
    -------
    array
        Shape (224, 672, 3).
    """
    red = picture.copy()
    red[region] = np.rint((1 - OVERLAY) * picture[region] + OVERLAY * RED)
    return np.concatenate([_tile(picture), _tile(red), _tile(_cut_out(picture, region))], axis=1)


def _cut_out(
    picture: Picture, region: Bool[np.ndarray, "rows columns"]
) -> UInt8[np.ndarray, "height width 3"]:
    """Return the region's largest connected piece in its box, all else black."""
    pieces, _ = ndimage.label(region)
    largest = 1 + int(np.argmax(np.bincount(pieces.ravel())[1:]))
    box = ndimage.find_objects(pieces)[largest - 1]
    return np.where((pieces[box] == largest)[..., None], picture[box], 0).astype(np.uint8)


def _tile(picture: Picture) -> UInt8[np.ndarray, "224 224 3"]:
    edge = max(picture.shape[:2])
    square = np.zeros((edge, edge, 3), dtype=np.uint8)
    top, left = (edge - picture.shape[0]) // 2, (edge - picture.shape[1]) // 2
    square[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return np.asarray(PIL.Image.fromarray(square).resize((TILE_PX, TILE_PX)))

"""How far outlines of parts and of a shadow lie apart."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import binary_dilation

from xden1k.values.arrays import Mask
from xden_builder.poly.pyramid import AIR
from xden_builder.registration.shadow import Shadow

__all__ = ["OUTLINE_PX", "apart_share", "lit"]

UNLIT, OF_TYPICAL = 0.04, 0.5
"""Opacity of a shadow, since scatter is not modelled; less, as a share of what is
typical of the object, where that is faint."""
OUTLINE_PX: Final = 2
"""By which outlines may differ, of the pixels of a large shadow."""


def lit(shadow: Shadow) -> float:
    """Give the least transmission of what is no shadow."""
    return 1 - min(UNLIT, OF_TYPICAL * -float(np.expm1(-shadow.own_depth)))


def apart_share(
    mask: Mask,
    model: Float64[np.ndarray, "n"],
    seen: Float64[np.ndarray, "n"],
    lit_from: float,
    px: int,
) -> float:
    """Give the share of pixels in either outline that lie more than some pixels outside the other.

    Parameters
    ----------
    mask
        Shape (rows, columns): which pixels are compared.
    model, seen
        Shape (n,): light of these, by the model as a share of the open field.
    lit_from
        Least transmission outside an outline.
    px
        By so many pixels outlines may differ.
    """
    outlines = np.zeros((2, *mask.shape), dtype=np.bool_)
    outlines[:, mask] = np.stack([model, seen / np.quantile(seen, AIR)]) < lit_from
    grown = [binary_dilation(each, iterations=px) for each in outlines]
    apart = (outlines[0] & ~grown[1]) | (outlines[1] & ~grown[0])
    return float(apart.sum() / max(outlines.any(axis=0).sum(), 1))

"""Whether two bodies look alike from all six sides, as a scanner of surfaces sees them."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Bool, Float32, Int64

__all__ = ["six_side_agreement"]

SEEN: Final = 0.35
"""Least share of a voxel that stops the eye: thin sheets fill no more."""
ALIKE: Final = 1
"""Cells by which depths may differ."""


def six_side_agreement(
    one: Float32[np.ndarray, "x y z"], other: Float32[np.ndarray, "x y z"]
) -> float:
    """Share of the rays that meet either body whose depths agree within a cell.

    Blind to cavities that nothing opens, which a scan of the surface does not see either.

    Examples
    --------
    >>> body = np.zeros((8, 8, 8), dtype=np.float32)
    >>> body[2:6, 2:6, 2:6] = 1
    >>> hollow = body.copy()
    >>> hollow[3:5, 3:5, 3:5] = 0
    >>> six_side_agreement(body, hollow), six_side_agreement(body, np.roll(body, 2, axis=0))
    (1.0, 0.2...)
    """
    agree, met = 0, 0
    for axis in range(3):
        for step in (1, -1):
            depths = [_depth(body > SEEN, axis, step) for body in (one, other)]
            either = np.minimum(*depths) < one.shape[axis]
            met += int(either.sum())
            agree += int((np.abs(depths[0] - depths[1])[either] <= ALIKE).sum())
    return agree / met if met else 0.0


def _depth(body: Bool[np.ndarray, "x y z"], axis: int, step: int) -> Int64[np.ndarray, "u v"]:
    """Cells before the first one met; beyond all of them and far off where none is."""
    seen = np.flip(body, axis) if step < 0 else body
    miss = 2 * body.shape[axis]
    return np.asarray(np.where(seen.any(axis=axis), seen.argmax(axis=axis), miss))

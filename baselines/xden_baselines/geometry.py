"""Voxels, and filling what is known of some of them into the others."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from xden1k.access.samples import SampleView
from xden1k.errors import DataError
from xden1k.values.arrays import Points
from xden1k.values.types import FIELD_SIZE

__all__ = ["SKIN", "near_surface", "nearest_filled", "voxel_centres_cm"]

SKIN = 2.0
"""How deep below the surface a voxel's centre may lie and still be seen, in voxels."""


def voxel_centres_cm(
    sample: SampleView, inside: Bool[np.ndarray, "64 64 64"] | None = None
) -> Points:
    """Centres of the field voxels, object frame, in C order; of those that are True, if given."""
    shape = (FIELD_SIZE,) * 3
    chosen = np.ones(shape, dtype=bool) if inside is None else inside
    return np.asarray(sample.origin_cm + sample.voxel_size_cm * np.argwhere(chosen))


def near_surface(sample: SampleView) -> Bool[np.ndarray, "64 64 64"]:
    """Voxels of the envelope that may be seen from outside, within :data:`SKIN` of the air."""
    inside = sample.envelope > 0
    return np.asarray(inside & (ndimage.distance_transform_edt(inside) <= SKIN))


def nearest_filled(
    values: Float[np.ndarray, "*channels x y z"], known: Bool[np.ndarray, "x y z"]
) -> Float[np.ndarray, "*channels x y z"]:
    """Give each voxel the values of the nearest known one.

    Raises
    ------
    DataError
        If none is known.

    Examples
    --------
    >>> line = np.array([5.0, 0.0, 0.0, 7.0]).reshape(4, 1, 1)
    >>> nearest_filled(line, line > 0).ravel().tolist()
    [5.0, 5.0, 7.0, 7.0]
    """
    if not known.any():
        raise DataError("there is no known voxel to fill the others from")
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    filled: np.ndarray = values[..., nearest[0], nearest[1], nearest[2]]
    return filled

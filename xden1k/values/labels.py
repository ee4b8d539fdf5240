"""Label voxels of each part, and how well they show its volume."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Bool, Integer

from xden1k.values.arrays import Labels

__all__ = ["THIN", "count_label_voxels", "labels_err"]

THIN: Final = 0.2
"""Of a part's volume: label voxels that err by more do not show it well."""


def count_label_voxels(labels: Labels, parts: int) -> Integer[np.ndarray, "parts"]:
    """Count the label voxels of each part, in the order of the parts.

    Examples
    --------
    >>> count_label_voxels(np.array([[[0, 2, 2, 0]]], dtype=np.uint8), parts=3).tolist()
    [0, 2, 0]
    """
    some = labels[labels != 0]  # most voxels are of no part
    counts = np.bincount(some, minlength=parts + 1)
    return np.asarray(counts[1 : max(parts, int(some.max(initial=0))) + 1])


def labels_err(
    counts: Integer[np.ndarray, "parts"], label_voxel_cm: float, volumes_cm3: Sequence[float]
) -> Bool[np.ndarray, "parts"]:
    """Say of each part whether its label voxels err about its volume by more than :data:`THIN`.

    Parameters
    ----------
    counts
        From :func:`count_label_voxels`.
    label_voxel_cm
        Edge of a label voxel.
    volumes_cm3
        Of the parts' meshes.

    Examples
    --------
    >>> labels_err(np.array([7, 0]), 1.0, [8.0, 0.1]).tolist()
    [False, True]
    """
    volumes = np.asarray(volumes_cm3, dtype=np.float64)
    return np.abs(counts * label_voxel_cm**3 - volumes) > THIN * volumes

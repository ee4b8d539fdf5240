"""Rotations spread evenly over all there are."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

__all__ = ["spread_rotations"]

PHI: Final = 2.0**0.5
PSI: Final = 1.533751168755204288118041
"""Solution of x^4 = x + 4."""


def spread_rotations(count: int) -> Rotation:
    """Give the super-Fibonacci spiral of unit quaternions.

    Alexa, Super-Fibonacci Spirals: Fast, Low-Discrepancy Sampling of SO(3), CVPR 2022,
    doi:10.1109/CVPR52688.2022.00811.

    Examples
    --------
    >>> len(spread_rotations(8))
    8
    """
    place = np.arange(count) + 0.5
    low, high = np.sqrt(place / count), np.sqrt(1 - place / count)
    one, other = 2 * np.pi * place / PHI, 2 * np.pi * place / PSI
    return Rotation.from_quat(
        np.stack(
            [low * np.sin(one), low * np.cos(one), high * np.sin(other), high * np.cos(other)],
            axis=1,
        )
    )

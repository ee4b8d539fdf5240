"""A loss that large residuals do not rule (Huber, 1964, doi:10.1214/aoms/1177703732)."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Bool, Float64

__all__ = ["HUBER", "one_sided", "tempered", "weights"]

HUBER: Final = 2.0
"""Standard deviations beyond which a residual counts linearly."""


def one_sided(
    residuals: Float64[np.ndarray, "n"], at_least: Bool[np.ndarray, "n"]
) -> Bool[np.ndarray, "n"]:
    """Return which residuals of a model count: not those above a measurement from below.

    Examples
    --------
    >>> one_sided(np.array([0.5, 0.5, -0.5]), np.array([False, True, True])).tolist()
    [True, False, True]
    """
    return np.asarray(~at_least | (residuals < 0))


def tempered(residuals: Float64[np.ndarray, "n"]) -> float:
    """Sum of squares of residuals in standard deviations, large ones linear.

    Examples
    --------
    >>> tempered(np.array([1.0, -3.0]))
    9.0
    """
    size = np.abs(residuals)
    return float(np.where(size <= HUBER, size**2, 2 * HUBER * size - HUBER**2).sum())


def weights(residuals: Float64[np.ndarray, "n"]) -> Float64[np.ndarray, "n"]:
    """Weight of each residual, with which least squares has the same gradient.

    Examples
    --------
    >>> weights(np.array([1.0, -4.0])).tolist()
    [1.0, 0.5]
    """
    return np.asarray(HUBER / np.maximum(np.abs(residuals), HUBER))

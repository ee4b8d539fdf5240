"""A loss that large residuals do not rule (Huber, 1964, doi:10.1214/aoms/1177703732)."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Bool, Float64
from scipy.stats import norm

__all__ = ["HUBER", "of_noise", "one_sided", "tempered", "weights"]

HUBER: Final = 2.0
"""Standard deviations beyond which a residual counts linearly."""
LOST_SD: Final = 1.0
"""How fast a residual counts hardly more, beyond where light is taken for lost."""


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


def tempered(residuals: Float64[np.ndarray, "n"], lost_from: float = np.inf) -> float:
    """Sum of squares of residuals in standard deviations, large ones linear.

    Light that a model has and an image lacks may have been lost in what no mesh tells of: from
    some residual on such light counts hardly more, in all by no more than pi HUBER LOST_SD.

    Parameters
    ----------
    residuals
        Shape (n,): model less measurement, in standard deviations or another scale.
    lost_from
        At least HUBER: from where on light is taken for lost; nowhere by default.

    Examples
    --------
    >>> tempered(np.array([1.0, -3.0]))
    9.0
    >>> [round(tempered(np.array([off]), lost_from=2.0), 1) for off in (2.0, 3.0, 20.0, -20.0)]
    [4.0, 7.1, 10.1, 76.0]
    """
    size, beyond = _split(residuals, lost_from)
    inside = np.where(size <= HUBER, size**2, 2 * HUBER * size - HUBER**2)
    return float((inside + 2 * HUBER * LOST_SD * np.arctan(beyond / LOST_SD)).sum())


def of_noise(variances: Float64[np.ndarray, "n"]) -> float:
    """Return what :func:`tempered` is expected to be of normally distributed residuals.

    Parameters
    ----------
    variances
        Shape (n,): in the units of the residuals, squared.

    Examples
    --------
    >>> round(of_noise(np.array([0.01, 0.01])), 6)
    0.02
    >>> round(of_noise(np.array([0.0, 9.0])), 3)
    6.269
    """
    sd = np.sqrt(variances).clip(min=1e-9)
    far = HUBER / sd
    inside = sd**2 * (1 - 2 * norm.sf(far) - 2 * far * norm.pdf(far))
    beyond = 4 * HUBER * sd * norm.pdf(far) - 2 * HUBER**2 * norm.sf(far)
    return float((inside + beyond).sum())


def weights(
    residuals: Float64[np.ndarray, "n"], lost_from: float = np.inf
) -> Float64[np.ndarray, "n"]:
    """Weight of each residual, with which least squares has the gradient of :func:`tempered`.

    Examples
    --------
    >>> weights(np.array([1.0, -4.0])).tolist()
    [1.0, 0.5]
    >>> weights(np.array([4.0]), lost_from=2.0).tolist()
    [0.1]
    """
    _, beyond = _split(residuals, lost_from)
    huber = HUBER / np.maximum(np.abs(residuals), HUBER)
    return np.asarray(huber / (1 + (beyond / LOST_SD) ** 2))


def _split(
    residuals: Float64[np.ndarray, "n"], lost_from: float
) -> tuple[Float64[np.ndarray, "n"], Float64[np.ndarray, "n"]]:
    """Size of residuals up to where light is taken for lost, and what is beyond."""
    return np.abs(np.minimum(residuals, lost_from)), np.maximum(residuals - lost_from, 0.0)

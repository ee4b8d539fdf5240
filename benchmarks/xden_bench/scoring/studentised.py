"""The symmetric studentised bootstrap, for any way in which objects were drawn."""

from __future__ import annotations

from typing import Final, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float64

__all__ = ["Sampled", "studentised_intervals"]

LEVEL: Final = 0.95


@runtime_checkable
class Sampled(Protocol):
    """Scores of objects, and how the objects were drawn."""

    @property
    def means(self) -> Float64[np.ndarray, "columns"]:
        """Means over objects."""

    @property
    def influences(self) -> Float64[np.ndarray, "draws columns"]:
        """How much each draw moves the mean: the norm of a column is its standard error."""

    @property
    def errors(self) -> Float64[np.ndarray, "columns"]:
        """Standard errors of the means."""

    @property
    def degrees_of_freedom(self) -> int:
        """Of the standard errors."""

    @property
    def is_positive(self) -> Bool[np.ndarray, "columns"]:
        """Which columns have a positive mean in every resample."""

    def resampled(
        self, resamples: int, seed: int
    ) -> tuple[Float64[np.ndarray, "resamples columns"], Float64[np.ndarray, "resamples columns"]]:
        """Mean and standard error of every resample."""


def studentised_intervals(
    sample: Sampled, resamples: int, seed: int
) -> Float64[np.ndarray, "2 columns"]:
    """Both ends of the 95 % interval of each mean.

    Objects are drawn anew as they were drawn. Of every resample the distance of its mean from the
    mean is taken in units of the resample's own standard error; the 95 % quantile of the distances
    times the standard error is the half width (bootstrap-t with a symmetric interval: Hall, 1992,
    *The Bootstrap and Edgeworth Expansion*, 3.5 and 3.6; with clusters: Cameron, Gelbach & Miller,
    2008, doi:10.1162/rest.90.3.414). Columns that are positive throughout are treated so on the
    scale of the logarithm.

    Parameters
    ----------
    sample
        At least two draws. How many it takes until the intervals cover is in
        docs/method/scoring.md.
    resamples
        How many times to draw.
    seed
        Of the draws.
    """
    positive = sample.is_positive
    centre, error = _on_scale(sample.means, sample.errors, positive)
    drawn, errors = _on_scale(*sample.resampled(resamples, seed), positive)
    apart = np.abs(drawn - centre)
    away = np.full_like(apart, np.inf)  # a resample of no spread beside the mean
    distances = np.divide(apart, errors, out=np.where(apart > 0, away, 0.0), where=errors > 0)
    half = error * np.quantile(distances, LEVEL, axis=0, method="higher")
    ends: Float64[np.ndarray, "2 columns"] = np.stack([centre - half, centre + half])
    with np.errstate(over="ignore"):  # of few draws an end may be infinite
        ends[:, positive] = np.exp(ends[:, positive])
    return ends


def _on_scale(
    means: Float64[np.ndarray, "*draws columns"],
    errors: Float64[np.ndarray, "*draws columns"],
    positive: Bool[np.ndarray, "columns"],
) -> tuple[Float64[np.ndarray, "*draws columns"], Float64[np.ndarray, "*draws columns"]]:
    """Logarithms of the positive columns' means, and their errors by the delta method."""
    centres, scaled = means.copy(), errors.copy()
    centres[..., positive] = np.log(means[..., positive])
    scaled[..., positive] /= means[..., positive]
    return centres, scaled

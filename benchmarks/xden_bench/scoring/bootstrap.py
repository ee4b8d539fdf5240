"""Means over objects and how far they can be trusted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

__all__ = ["CI95", "SAME", "Estimate", "estimate", "resampled_means"]

CI95 = (0.025, 0.975)
"""Quantiles that bound the interval."""
SAME = 1e-6
"""Values no further apart are equal: submissions are float32, which rounds by as much."""
CHUNK = 1000
"""Resamples drawn at a time: memory does not grow with their number."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean over objects and its interval.

    Parameters
    ----------
    mean
        Over the objects.
    low, high
        Ends of the 95 % interval.
    """

    mean: float
    low: float
    high: float

    def to_json(self) -> dict[str, float | list[float]]:
        """Return it as results store it."""
        return {"mean": self.mean, "ci95": [self.low, self.high]}


def resampled_means(
    values: Float[np.ndarray, "objects metrics"], resamples: int, seed: int
) -> Float64[np.ndarray, "resamples metrics"]:
    """Means over objects drawn with replacement.

    Every metric sees the same draws, and so do two methods scored on the same objects, which
    makes their differences paired.

    Parameters
    ----------
    values
        Shape (objects, metrics).
    resamples
        How many times to draw.
    seed
        The same seed and number of objects give the same draws.
    """
    objects = len(values)
    rng = np.random.default_rng(seed)

    def counts() -> Iterator[Float64[np.ndarray, "chunk objects"]]:
        for first in range(0, resamples, CHUNK):
            rows = min(CHUNK, resamples - first)
            drawn = rng.integers(objects, size=(rows, objects))
            places = (drawn + objects * np.arange(rows)[:, None]).ravel()
            counted = np.bincount(places, minlength=rows * objects).reshape(rows, objects)
            yield counted.astype(np.float64)

    return np.concatenate([chunk @ values / objects for chunk in counts()])


def estimate(
    values: Float[np.ndarray, "objects metrics"], resamples: int, seed: int
) -> tuple[Estimate, ...]:
    """Mean of each metric with its 95 % percentile bootstrap interval (Efron, 1979).

    One object gives an interval of no width: read the number of objects beside it.

    Parameters
    ----------
    values
        Shape (objects, metrics), at least one object.
    resamples, seed
        See :func:`resampled_means`.

    Examples
    --------
    >>> (one,) = estimate(np.array([[1.0], [3.0]]), resamples=2000, seed=0)
    >>> one.mean, one.low, one.high
    (2.0, 1.0, 3.0)
    """
    lows, highs = np.quantile(resampled_means(values, resamples, seed), CI95, axis=0)
    return tuple(
        Estimate(float(mean), float(low), float(high))
        for mean, low, high in zip(values.mean(axis=0), lows, highs, strict=True)
    )

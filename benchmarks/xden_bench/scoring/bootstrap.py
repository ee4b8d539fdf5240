"""Means over objects with the percentile intervals of the protocols before v2.

These cover less than they say, most of all with few objects, heavy tails and objects that hang
together: :mod:`xden_bench.scoring.clusters` has those that hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float, Float64

__all__ = ["CI95", "SAME", "Estimate", "estimate", "resampled_means"]

CI95 = (0.025, 0.975)
"""Quantiles that bound the interval."""
SAME = 1e-6
"""Values no further apart are equal: submissions are float32, which rounds by as much."""
CHUNK = 1000
"""Resamples drawn at a time."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean over objects and how far it can be trusted.

    Parameters
    ----------
    mean
        Over the objects: the micro mean.
    interval
        Ends of the 95 % interval of the mean; None where none can be trusted.
    macro_mean
        Mean over categories of the means of their objects; None where it is not asked for.
    """

    mean: float
    interval: tuple[float, float] | None = None
    macro_mean: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Return it as results store it."""
        macro = {} if self.macro_mean is None else {"macro_mean": self.macro_mean}
        return {"mean": self.mean, **macro, "ci95": self.interval and list(self.interval)}


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
    parts = [counts @ values for counts in _counts(len(values), resamples, seed)]
    return np.concatenate(parts) / len(values)


@lru_cache(maxsize=8)
def _counts(
    objects: int, resamples: int, seed: int
) -> tuple[Float64[np.ndarray, "chunk objects"], ...]:
    """How often each resample takes each object: the same for every group of one size."""
    rng = np.random.default_rng(seed)
    parts = []
    for first in range(0, resamples, CHUNK):
        rows = min(CHUNK, resamples - first)
        drawn = rng.integers(objects, size=(rows, objects))
        places = (drawn + objects * np.arange(rows)[:, None]).ravel()
        counted = np.bincount(places, minlength=rows * objects).reshape(rows, objects)
        parts.append(counted.astype(np.float64))
    return tuple(parts)


def estimate(
    values: Float[np.ndarray, "objects metrics"], resamples: int, seed: int
) -> tuple[Estimate, ...]:
    """Mean of each metric with its percentile bootstrap interval (Efron, 1979), 95 % in name.

    One object gives an interval of no width.

    Parameters
    ----------
    values
        Shape (objects, metrics), at least one object.
    resamples, seed
        See :func:`resampled_means`.

    Examples
    --------
    >>> (one,) = estimate(np.array([[1.0], [3.0]]), resamples=2000, seed=0)
    >>> one.mean, one.interval
    (2.0, (1.0, 3.0))
    """
    lows, highs = np.quantile(resampled_means(values, resamples, seed), CI95, axis=0)
    return tuple(
        Estimate(float(mean), (float(low), float(high)))
        for mean, low, high in zip(values.mean(axis=0), lows, highs, strict=True)
    )

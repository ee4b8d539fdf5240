"""Clusters of points: by one value of each, and by where they are."""

from __future__ import annotations

import warnings
from typing import Final

import numpy as np
from jaxtyping import Float, Float64, UInt8
from scipy.cluster.vq import kmeans2

from xden1k.segmentation import CLUSTER_COUNTS, Segmentation
from xden1k.values.arrays import Points

__all__ = ["cluster_places", "cluster_values", "segmentation_by_value"]

ITERATIONS: Final = 25
UNEXPLAINED: Final = 0.05
"""Share of the variance of values that clusters may leave, if a method says how many there are."""

Values = Float64[np.ndarray, "points"]
Clusters = UInt8[np.ndarray, "points"]


def cluster_values(values: Values, count: int) -> Clusters:
    """Divide values into at most so many clusters, such that their squared spread is small.

    Lloyd's iteration in one dimension (doi:10.1109/TIT.1982.1056489) from two starts, the means of
    equal shares of the values and of equal shares of their range; the better end is taken. A
    cluster that loses all its values keeps its centre.

    Parameters
    ----------
    values
        Shape (points,), finite, at least one.
    count
        At least 1.

    Examples
    --------
    >>> cluster_values(np.array([0.0, 7.8, 0.9, 7.9, 1.0]), 3).tolist()
    [0, 2, 1, 2, 1]
    """
    shares = (np.arange(count) + 0.5) / count
    evenly = np.linspace(values.min(), values.max(), count)
    ends = [_lloyd(values, start) for start in (np.quantile(values, shares), evenly)]
    return min(ends, key=lambda clusters: _spread(values, clusters))


def cluster_places(points_cm: Points, count: int, seed: int) -> Clusters:
    """Divide points into at most so many clusters by where they are.

    k-means with the starts of k-means++ (Arthur & Vassilvitskii, 2007).

    Parameters
    ----------
    points_cm
        Shape (points, 3), at least one.
    count
        At least 1.
    seed
        Of the starts.
    """
    starts = min(count, len(points_cm))
    with warnings.catch_warnings(category=UserWarning, action="ignore"):  # an empty cluster stays
        _, clusters = kmeans2(points_cm, starts, ITERATIONS, minit="++", seed=seed)
    return np.asarray(clusters, dtype=np.uint8)


def segmentation_by_value(values: Float[np.ndarray, "points"]) -> Segmentation:
    """Divide points by one value of each, ``free`` into as few clusters as tell enough.

    That is the fewest that leave at most 5 % of the variance.

    Parameters
    ----------
    values
        Shape (points,), finite, at least one.
    """
    exact = np.asarray(values, dtype=np.float64)
    rows = [cluster_values(exact, count) for count in (1, *CLUSTER_COUNTS)]
    most = UNEXPLAINED * _spread(exact, rows[0])
    free = next((row for row in rows if _spread(exact, row) <= most), rows[-1])
    return Segmentation(np.stack(rows[1:]), free)


def _lloyd(values: Values, centres: Float64[np.ndarray, "clusters"]) -> Clusters:
    """Move centres, ascending, to the means of the values that are nearest to them."""
    clusters = _nearest(values, centres)
    for _ in range(ITERATIONS):
        sizes = np.bincount(clusters, minlength=len(centres))
        sums = np.bincount(clusters, values, len(centres))
        centres = np.sort(np.divide(sums, sizes, out=centres.copy(), where=sizes > 0))
        clusters = _nearest(values, centres)
    return clusters


def _nearest(values: Values, centres: Float64[np.ndarray, "clusters"]) -> Clusters:
    return np.searchsorted((centres[1:] + centres[:-1]) / 2, values).astype(np.uint8)


def _spread(values: Values, clusters: Clusters) -> float:
    """Sum of the squared distances of values from the means of their clusters."""
    sizes = np.maximum(np.bincount(clusters), 1)
    means = np.bincount(clusters, values) / sizes
    return float(((values - means[clusters]) ** 2).sum())

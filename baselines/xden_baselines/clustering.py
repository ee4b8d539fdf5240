"""Clusters of points: by one value of each, and by where they are."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
from jaxtyping import Float, Float64, Int64, UInt8
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.cluster.vq import kmeans2

from xden1k.segmentation import CLUSTER_COUNTS, Segmentation
from xden1k.values.arrays import Points

__all__ = [
    "cluster_places",
    "cluster_values",
    "free_by_features",
    "free_by_value",
    "segmentation_by_features",
    "segmentation_by_value",
]

ITERATIONS: Final = 25
UNEXPLAINED: Final = 0.05
"""Share of the variance of values that clusters may leave, if a method says how many there are."""

WORTH: Final = 0.2
"""By how much another cluster must lower the mean squared distance of points from their centres."""
TREE_POINTS: Final = 512
"""On ``val`` as good as twice as many, and as all points for k-means."""
TREE_ITERATIONS: Final = 10

Features = Float64[np.ndarray, "points values"]
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
    rows = list(_rows_of_values(exact))
    return Segmentation(np.stack(rows[1:]), _as_told(exact, rows))


def free_by_value(values: Float[np.ndarray, "points"]) -> Clusters:
    """Return ``free`` of :func:`segmentation_by_value` alone; no more clusters are tried."""
    exact = np.asarray(values, dtype=np.float64)
    return _as_told(exact, _rows_of_values(exact))


def segmentation_by_features(features: Float[np.ndarray, "points values"]) -> Segmentation:
    """Divide points by several values of each, ``free`` into as many clusters as are worth it.

    k-means of 512 of the points for each number of clusters, from where Ward's tree of them
    (doi:10.1080/01621459.1963.10500845) puts that many; each point is then of the nearest centre.
    ``free`` begins with one cluster and stops
    before the first that lowers the points' mean squared distance from their centres by less than
    0.2: between vectors of length 1, as embeddings are, a share p of all points apart from the rest
    by an angle lowers it by 2 p (1 - p) (1 - cos).

    Parameters
    ----------
    features
        Shape (points, values), finite, at least one point; such that distances are those of
        embeddings of length 1.
    """
    exact = np.asarray(features, dtype=np.float64)
    rows = list(_rows_of_features(exact))
    return Segmentation(np.stack(rows[1:]), _as_worth(exact, rows))


def free_by_features(features: Float[np.ndarray, "points values"]) -> Clusters:
    """Return ``free`` of :func:`segmentation_by_features` alone; no more clusters are tried."""
    exact = np.asarray(features, dtype=np.float64)
    return _as_worth(exact, _rows_of_features(exact))


def _rows_of_values(values: Values) -> Iterator[Clusters]:
    """Yield one cluster, then two, three, ..."""
    for count in (1, *CLUSTER_COUNTS):
        yield cluster_values(values, count)


def _rows_of_features(features: Features) -> Iterator[Clusters]:
    """Yield one cluster, then two, three, ..."""
    yield np.zeros(len(features), dtype=np.uint8)
    some = features[np.unique(np.linspace(0, len(features) - 1, TREE_POINTS).astype(int))]
    tree = linkage(some, "ward") if len(some) > 1 else np.zeros((0, 4))
    for count in CLUSTER_COUNTS:
        yield _nearest_centre(features, _centres(some, tree, count)).astype(np.uint8)


def _as_told(values: Values, rows: Iterable[Clusters]) -> Clusters:
    """Return the first row that leaves little enough of the variance, else the last."""
    row = np.zeros(len(values), dtype=np.uint8)
    most = UNEXPLAINED * _spread(values, row)
    for row in rows:
        if _spread(values, row) <= most:
            return row
    return row


def _as_worth(features: Features, rows: Iterable[Clusters]) -> Clusters:
    """Return the last row before one that is not worth its cluster."""
    counted = iter(rows)
    last = next(counted)
    for row in counted:
        lower = (_spread_of(features, last) - _spread_of(features, row)) / len(features)
        if lower < WORTH:
            return last
        last = row
    return last


def _centres(
    some: Features, tree: Float64[np.ndarray, "merges 4"], count: int
) -> Float64[np.ndarray, "clusters values"]:
    """Centres of at most so many clusters of some points: those of the tree, moved by k-means."""
    _, clusters = np.unique(
        fcluster(tree, count, "maxclust") if len(some) > 1 else [1], return_inverse=True
    )
    centres = _means(some, clusters, np.zeros((clusters.max() + 1, 1)))
    for _ in range(TREE_ITERATIONS):
        centres = _means(some, _nearest_centre(some, centres), centres)
    return centres


def _nearest_centre(
    features: Features, centres: Float64[np.ndarray, "clusters values"]
) -> Int64[np.ndarray, "points"]:
    """Which centre is nearest: the c of the largest x c - c² / 2."""
    nearest: Int64[np.ndarray, "points"] = np.argmax(
        features @ centres.T - (centres**2).sum(axis=1) / 2, axis=1
    )
    return nearest


def _means(
    features: Features,
    clusters: Int64[np.ndarray, "points"],
    centres: Float64[np.ndarray, "clusters _"],
) -> Float64[np.ndarray, "clusters values"]:
    """Means of clusters; one that lost all its points keeps the centre that it had."""
    members = (clusters[:, None] == np.arange(len(centres))).astype(np.float64)
    sizes = members.sum(axis=0)[:, None]
    return np.where(sizes > 0, members.T @ features / np.maximum(sizes, 1), centres)


def _spread_of(features: Features, clusters: Clusters) -> float:
    """Sum of the squared distances of points from the means of their clusters."""
    return sum(_spread(values, clusters) for values in features.T)


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

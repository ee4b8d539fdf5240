"""How well clusters of points are the regions of an object: intersection over union, in percent.

Names of regions and of clusters mean nothing; what counts is which points are together.

- :func:`one_to_one`: each region has at most one cluster, each cluster at most one region, such
  that the sum of IoU is largest (Kuhn, 1955, doi:10.1002/nav.3800020109). A region without a
  cluster counts 0.
- :func:`many_to_one`: each region has the cluster that fits it best, whichever others have it too,
  as PartField is scored (Liu et al., 2025, arXiv:2504.11451). Optimistic.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import nan

import numpy as np
from jaxtyping import Float64, Int64, Integer, UInt8
from scipy.optimize import linear_sum_assignment

from xden1k.segmentation import CLUSTER_COUNTS, Segmentation

__all__ = [
    "assignment",
    "iou_matrix",
    "many_to_one",
    "one_to_one",
    "oracle_clusters",
    "score_segments",
]

PERCENT = 100.0
Ids = Integer[np.ndarray, "points"]


def iou_matrix(regions: Ids, clusters: Ids) -> Float64[np.ndarray, "regions clusters"]:
    """Intersection over union of each region that is there with each cluster that is there.

    Parameters
    ----------
    regions, clusters
        Shape (points,), at least one point: of each point.

    Examples
    --------
    >>> iou_matrix(np.array([0, 0, 0, 1]), np.array([5, 5, 9, 9])).round(2).tolist()
    [[0.67, 0.25], [0.0, 0.5]]
    """
    rows, columns = (np.unique(one, return_inverse=True)[1] for one in (regions, clusters))
    width = int(columns.max()) + 1
    shared = np.bincount(rows * width + columns, minlength=(int(rows.max()) + 1) * width)
    shared = shared.reshape(-1, width)
    union = shared.sum(axis=1, keepdims=True) + shared.sum(axis=0) - shared
    return np.asarray(shared / union, dtype=np.float64)


def assignment(
    iou: Float64[np.ndarray, "regions clusters"],
) -> tuple[Int64[np.ndarray, "pairs"], Int64[np.ndarray, "pairs"]]:
    """Return regions and clusters, pair by pair, of the largest sum of IoU, one to one."""
    regions, clusters = linear_sum_assignment(iou, maximize=True)
    return regions, clusters


def one_to_one(iou: Float64[np.ndarray, "regions clusters"]) -> float:
    """Sum of IoU of the best assignment of clusters to regions.

    Examples
    --------
    >>> one_to_one(np.array([[0.6, 0.5], [0.5, 0.1]]))
    1.0
    """
    return float(iou[assignment(iou)].sum())


def many_to_one(iou: Float64[np.ndarray, "regions clusters"]) -> float:
    """Mean over regions of the IoU with the cluster that fits best.

    Examples
    --------
    >>> many_to_one(np.array([[0.6, 0.5], [0.5, 0.1]]))
    0.55
    """
    return float(iou.max(axis=1).mean())


def oracle_clusters(regions: int, answer: Segmentation) -> UInt8[np.ndarray, "points"]:
    """Clusters that protocol A scores: as many as there are regions, from 2 to 19.

    Parameters
    ----------
    regions
        True number of material regions.
    answer
        Of the method.
    """
    return answer.of(min(max(regions, CLUSTER_COUNTS[0]), CLUSTER_COUNTS[-1]))


def score_segments(materials: Ids, parts: Ids, answer: Segmentation) -> Mapping[str, float]:
    """Every metric of one object, percent; A and B are not a number where there is one region.

    Parameters
    ----------
    materials, parts
        Shape (points,): material region of each point, and part instance, void being one.
    answer
        Of the method, for the same points.
    """
    count = len(np.unique(materials))
    oracle = oracle_clusters(count, answer)
    free = iou_matrix(materials, answer.free)
    several = count > 1
    return {
        "iou_a": PERCENT * one_to_one(iou_matrix(materials, oracle)) / count if several else nan,
        "iou_b_material": _best(materials, answer),
        "iou_b_part": _best(parts, answer),
        "iou_c": PERCENT * one_to_one(free) / max(free.shape),
    }


def _best(regions: Ids, answer: Segmentation) -> float:
    """Return the best mean IoU of any number of clusters, many to one."""
    if len(np.unique(regions)) == 1:
        return nan
    return PERCENT * max(many_to_one(iou_matrix(regions, row)) for row in answer.labels)

"""Clusters of points by what a network says of them: embedding and density, or either alone."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Float32, UInt8

from xden1k.segmentation import Segmentation
from xden_baselines.clustering import (
    free_by_features,
    free_by_value,
    segmentation_by_features,
    segmentation_by_value,
)

__all__ = ["free_clusters", "segmentation"]

DENSITY_WEIGHT: Final = 0.5
"""Of a density in g/cm³ beside an embedding of length 1, where points are clustered by both."""

Density = Float32[np.ndarray, "points densities"]
Embedding = Float32[np.ndarray, "points embedding"]


def segmentation(density_g_cm3: Density, embedding: Embedding) -> Segmentation:
    """Divide points into 2 to 19 clusters, and into as many as tell enough.

    Parameters
    ----------
    density_g_cm3
        Shape (points, 1), or (points, 0) where the network gives none.
    embedding
        Shape (points, 16), or (points, 0) where the network gives none. At least one point.
    """
    if not embedding.shape[1]:
        return segmentation_by_value(density_g_cm3[:, 0])
    return segmentation_by_features(_features(density_g_cm3, embedding))


def free_clusters(density_g_cm3: Density, embedding: Embedding) -> UInt8[np.ndarray, "points"]:
    """Return ``free`` of :func:`segmentation` alone."""
    if not embedding.shape[1]:
        return free_by_value(density_g_cm3[:, 0])
    return free_by_features(_features(density_g_cm3, embedding))


def _features(density_g_cm3: Density, embedding: Embedding) -> Float32[np.ndarray, "points values"]:
    return np.concatenate([embedding, np.float32(DENSITY_WEIGHT) * density_g_cm3], axis=1)

"""Kernel regression: how much of each candidate material a point is, and what follows from it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float32

from xden_baselines.chat.candidates import Candidate, Range

__all__ = ["TEMPERATURE", "areal_density_g_cm2", "mixture", "ranges"]

TEMPERATURE = 0.1
"""NeRF2Physics' value."""


def mixture(
    similarity: Float32[np.ndarray, "points materials"], temperature: float = TEMPERATURE
) -> Float[np.ndarray, "points materials"]:
    """Softmax of cosine over temperature: shares that add up to 1.

    Examples
    --------
    >>> mixture(np.float32([[0.3, 0.1]]), temperature=0.1).round(3).tolist()
    [[0.881, 0.119]]
    """
    scaled = similarity.astype(np.float64) / temperature
    shares = np.exp(scaled - scaled.max(axis=1, keepdims=True))
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


def ranges(values: Sequence[Range]) -> Float[np.ndarray, "materials 2"]:
    """Stack low and high of each candidate, to be mixed by ``shares @ ranges``."""
    return np.array(values, dtype=np.float64)


def areal_density_g_cm2(candidates: Sequence[Candidate]) -> Float[np.ndarray, "materials 2"]:
    """Density times thickness of each candidate, low with low and high with high."""
    density = ranges([candidate.density_g_cm3 for candidate in candidates])
    thickness = ranges([candidate.thickness_cm for candidate in candidates])
    return np.asarray(density * thickness)

"""Light and photons that land elsewhere on the panel, and those lost beyond its edges."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32
from scipy.special import ndtr

from xden1k.values.arrays import Image

__all__ = ["gaussian_spread"]


def gaussian_spread(image: Image, sd_px: float) -> Image:
    """Spread what each pixel holds by a Gaussian, integrated over the pixels it falls on.

    Nothing is made and nothing becomes negative; what falls beyond an edge is lost.
    """
    rows, columns = (_shares(size, sd_px) for size in image.shape)
    return np.asarray(rows @ image @ columns)


def _shares(size: int, sd_px: float) -> Float32[np.ndarray, "size size"]:
    """Share of one pixel's content that falls on another; symmetric."""
    edges = np.arange(-size, size + 1) + 0.5
    shares = np.diff(ndtr(edges / sd_px))  # at distance 1 - size, ..., size - 1, size
    distance = np.subtract.outer(np.arange(size), np.arange(size))
    return np.asarray(shares[distance + size - 1], dtype=np.float32)

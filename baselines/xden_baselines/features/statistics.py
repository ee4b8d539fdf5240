"""Colour and texture of patches: means and deviations over nested windows, by summed areas."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, UInt8

from xden_baselines.features.encoder import PATCH_SHARE, half_px

__all__ = ["STATISTICS", "patch_statistics"]

WINDOW_SHARES = (PATCH_SHARE, 0.05, 0.02)
"""Edges of the windows around a patch's centre over the picture's, the widest the patch itself."""
STATISTICS = 2 + 7 * len(WINDOW_SHARES)
"""Values for each patch."""


def patch_statistics(
    picture: UInt8[np.ndarray, "rows columns 3"],
    mask: Bool[np.ndarray, "rows columns"],
    pixels: Int64[np.ndarray, "patches 2"],
) -> Float32[np.ndarray, "patches 23"]:
    """Statistics of the object's pixels in windows around pixels (row, column).

    For each window the share of it that is object, and mean and standard deviation of red, green
    and blue, 0 to 1; last, the share of red and of green in the smallest window's colour, which
    no light changes. A window without object takes the values of the next wider one, the widest
    then 0.
    """
    halves = [half_px(mask.shape, share) for share in WINDOW_SHARES]
    top, left = (pixels.min(axis=0) - halves[0]).clip(min=0)
    bottom, right = pixels.max(axis=0) + halves[0]
    sums = _summed_areas(picture[top:bottom, left:right], mask[top:bottom, left:right])
    pixels = pixels - [top, left]
    found = np.zeros((len(pixels), STATISTICS), dtype=np.float64)
    mean = deviation = np.zeros((len(pixels), 3))
    for which, half in enumerate(halves):
        total = _window_sums(sums, pixels, half)
        count = total[:, :1]
        some, share = count > 0, count / (2 * half) ** 2
        inside = total / np.where(some, count, 1)
        spread = np.sqrt((inside[:, 4:] - inside[:, 1:4] ** 2).clip(min=0))
        mean, deviation = np.where(some, inside[:, 1:4], mean), np.where(some, spread, deviation)
        found[:, 7 * which : 7 * which + 7] = np.concatenate([share, mean, deviation], axis=1)
    brightness = mean.sum(axis=1, keepdims=True)
    found[:, -2:] = mean[:, :2] / np.where(brightness > 0, brightness, 1)
    return found.astype(np.float32)


def _summed_areas(
    picture: UInt8[np.ndarray, "rows columns 3"], mask: Bool[np.ndarray, "rows columns"]
) -> Float64[np.ndarray, "down across 7"]:
    """Sum over all that is above and to the left: object, colours, squares of colours."""
    colors = np.where(mask[..., None], picture / 255.0, 0)
    channels = np.concatenate([mask[..., None], colors, colors**2], axis=-1)
    sums = np.zeros((mask.shape[0] + 1, mask.shape[1] + 1, 7))
    sums[1:, 1:] = channels.cumsum(axis=0).cumsum(axis=1)
    return sums


def _window_sums(
    sums: Float64[np.ndarray, "down across 7"], pixels: Int64[np.ndarray, "patches 2"], half: int
) -> Float64[np.ndarray, "patches 7"]:
    """Sum over [r - half, r + half), as far as it lies inside the picture."""
    last = np.array(sums.shape[:2]) - 1
    top, left = (pixels - half).clip(0, last).T
    bottom, right = (pixels + half).clip(0, last).T
    return np.asarray(sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left])

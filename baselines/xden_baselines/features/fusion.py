"""Features of surface points: the mean over the views that see them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int64

from xden1k.values.arrays import Points
from xden_baselines.features.encoder import PatchEncoder, half_px
from xden_baselines.views.pictures import Pictures, visible

__all__ = ["fused_features"]


def fused_features(
    points_cm: Points, pictures: Pictures, encoder: PatchEncoder, *, tolerance_cm: float
) -> tuple[Float32[np.ndarray, "points features"], Int64[np.ndarray, "points"]]:
    """Average each point's patch features over the views in which nothing hides it.

    Parameters
    ----------
    points_cm
        On the surface.
    pictures, encoder
        What is seen, and what makes features of it.
    tolerance_cm
        How far behind the surface that a view sees a point may lie.

    Returns
    -------
    features
        0 for points that no view sees.
    views
        How many views see each point.
    """
    views = np.zeros(len(points_cm), dtype=np.int64)
    margin_px = half_px(pictures.masks.shape[1:])
    total = np.zeros((len(points_cm), encoder.width))
    for view in range(len(pictures)):
        seen, pixels = visible(
            points_cm, pictures, view, tolerance_cm=tolerance_cm, margin_px=margin_px
        )
        if seen.any():
            total[seen] += _encoded(pictures, view, pixels, encoder)
            views[seen] += 1
    return (total / views.clip(min=1)[:, None]).astype(np.float32), views


def _encoded(
    pictures: Pictures, view: int, pixels: Int64[np.ndarray, "seen 2"], encoder: PatchEncoder
) -> Float32[np.ndarray, "seen features"]:
    """Encode the patch of each pixel; pixels of one stride share theirs."""
    shape = pictures.masks.shape[1:]
    half, stride = half_px(shape), encoder.stride_px
    last = np.array(shape) - half
    snapped = (pixels // stride * stride + stride // 2).clip(half, last)
    flat = snapped[:, 0] * pictures.masks.shape[2] + snapped[:, 1]
    _, first, which = np.unique(flat, return_index=True, return_inverse=True)
    found = encoder.patches(pictures.colors[view], pictures.masks[view], snapped[first])
    return np.asarray(found[which])

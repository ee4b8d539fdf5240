"""How much of each voxel of a body's own bounding box is filled: what registration compares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float32, Float64
from scipy import ndimage

from xden_builder.published import kernels
from xden_builder.published.labels import LabelVolume

__all__ = ["FINE_SIZE", "SHARE_SIZE", "BoxShares", "enclosed", "pooled", "volume_shares"]

FINE_SIZE: Final = 128
"""Voxels along each edge on which a body is filled."""
SHARE_SIZE: Final = FINE_SIZE // 2
"""Voxels along each edge on which shares are compared."""
WALL: Final = 0.3
"""Least share of a voxel that keeps the outside out."""


@dataclass(frozen=True, slots=True, eq=False)
class BoxShares:
    """A body on a grid stretched over its bounding box.

    Parameters
    ----------
    low, high
        Shape (3,): corners of the box.
    raw, solid
        Shape (64, 64, 64), 0 to 1: share of each voxel inside; as the body is, and with enclosed
        cavities filled.
    """

    low: Float64[np.ndarray, "3"]
    high: Float64[np.ndarray, "3"]
    raw: Float32[np.ndarray, "n n n"]
    solid: Float32[np.ndarray, "n n n"]

    @property
    def extent(self) -> Float64[np.ndarray, "3"]:
        """Sides of the box."""
        return np.asarray(self.high - self.low)

    @property
    def versions(self) -> tuple[Float32[np.ndarray, "n n n"], Float32[np.ndarray, "n n n"]]:
        """Both of them."""
        return self.raw, self.solid


def volume_shares(volume: LabelVolume) -> BoxShares:
    """Put a labelled volume on the grid of its box, in published voxels: voxel i is i to i + 1."""
    values, bounds = volume.share, []
    for axis in range(3):
        low, high = _bounds(volume.share, axis)
        overlap = _overlap(values.shape[axis], low, high)
        values = np.moveaxis(np.tensordot(overlap, values, (1, axis)), 0, axis)
        bounds.append((low, high))
    wall = values > WALL
    solid = np.where(enclosed(wall) & ~wall, np.float32(1), values)
    low_corner, high_corner = np.array(bounds).T + np.array(volume.start)
    return BoxShares(low_corner, high_corner, pooled(values), pooled(solid))


def _bounds(share: Float32[np.ndarray, "x y z"], axis: int) -> tuple[float, float]:
    """Where a body begins and ends: the fullest voxel of the outermost layers says how far."""
    most = share.max(axis=tuple({0, 1, 2} - {axis}))
    first, last = np.flatnonzero(most)[[0, -1]]
    return float(first + 1 - most[first]), float(last + most[last])


def _overlap(count: int, low: float, high: float) -> Float32[np.ndarray, "fine count"]:
    """Share of each fine cell that each voxel covers.

    The outermost voxels reach no farther than the body, and are as much fuller.
    """
    edges = np.linspace(low, high, FINE_SIZE + 1)
    starts, ends = np.arange(count).clip(low, high), np.arange(1, count + 1).clip(low, high)
    shared = np.minimum(edges[1:, None], ends) - np.maximum(edges[:-1, None], starts)
    fuller = 1 / np.where(ends > starts, ends - starts, 1.0)
    return np.asarray(shared.clip(0) * fuller * FINE_SIZE / (high - low), dtype=np.float32)


def enclosed(inside: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x y z"]:
    """Fill what the outside does not reach."""
    outside, _ = ndimage.label(~np.pad(inside, 1))
    return np.asarray((outside != outside[0, 0, 0])[1:-1, 1:-1, 1:-1])


def pooled(values: np.ndarray) -> Float32[np.ndarray, "i j k"]:
    """Means over blocks of 2 x 2 x 2.

    Examples
    --------
    >>> pooled(np.arange(8.0).reshape(2, 2, 2)).item()
    3.5
    """
    means = np.zeros([side // 2 for side in values.shape], dtype=np.float32)
    kernels.pool(values.astype(np.float32, copy=False), means)
    return means

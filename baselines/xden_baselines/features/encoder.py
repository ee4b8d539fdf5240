"""What turns a patch of a picture, and the name of a material, into features to compare."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float32, Int64, UInt8

__all__ = ["PATCH_SHARE", "PatchEncoder", "cosines", "half_px"]

PATCH_SHARE = 56 / 512
"""Edge of a patch over the shorter edge of its picture: NeRF2Physics takes 56 pixels of ABO's
pictures, which have 512 (Collins et al., CVPR 2022)."""


def half_px(shape: tuple[int, ...], share: float = PATCH_SHARE) -> int:
    """Half the edge of a window that is a share of a picture's shorter edge, at least one pixel.

    The window around pixel r holds the pixels [r - half, r + half).

    Examples
    --------
    >>> half_px((512, 512)), half_px((320, 320)), half_px((256, 384))
    (28, 18, 14)
    """
    return max(1, round(share * min(shape) / 2))


@runtime_checkable
class PatchEncoder(Protocol):
    """Encodes patches and names so that a patch is near the names of what it shows."""

    @property
    def source(self) -> str:
        """Where its knowledge comes from, as a row says it: ``fitted encoder``."""
        ...

    @property
    def width(self) -> int:
        """How many features there are."""
        ...

    @property
    def stride_px(self) -> int:
        """Patches are centred on every so many pixels only; those between share one."""
        ...

    def patches(
        self,
        picture: UInt8[np.ndarray, "rows columns 3"],
        mask: Bool[np.ndarray, "rows columns"],
        pixels: Int64[np.ndarray, "patches 2"],
    ) -> Float32[np.ndarray, "patches features"]:
        """Features of the patches around pixels (row, column), each wholly inside the picture."""
        ...

    def texts(self, names: Sequence[str]) -> Float32[np.ndarray, "texts features"]:
        """Features of names of materials, without a template."""
        ...


def cosines(
    one: Float32[np.ndarray, "ones features"], other: Float32[np.ndarray, "others features"]
) -> Float32[np.ndarray, "ones others"]:
    """Cosine of the angle between each of one and each of the others; 0 where one is zero.

    Examples
    --------
    >>> cosines(np.float32([[3, 4]]), np.float32([[1, 0], [0, 2], [0, 0]])).tolist()
    [[0.6000000238418579, 0.800000011920929, 0.0]]
    """
    return np.asarray(_unit(one) @ _unit(other).T)


def _unit(rows: Float32[np.ndarray, "rows features"]) -> Float32[np.ndarray, "rows features"]:
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(rows / np.where(lengths > 0, lengths, 1), dtype=np.float32)

"""Features that were computed once are read from the user's cache afterwards."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float32, Int64, UInt8

from xden1k.format.cache import PieceCache, cache_folder, cache_limit
from xden_baselines.features.encoder import PatchEncoder

__all__ = ["Identified", "KeptFeatures", "feature_cache"]

FOLDER = "features"
"""In the user's cache of this package."""


@runtime_checkable
class Identified(PatchEncoder, Protocol):
    """An encoder that can tell itself from every other."""

    @property
    def identity(self) -> str:
        """All that its features depend on besides the picture: weights, settings, device."""
        ...


class KeptFeatures:
    """An encoder whose features of patches are kept by what they are made of.

    The key is the SHA-256 of the encoder's identity, the picture, the mask and the patches' pixels,
    so nothing that is kept can go stale. A cache that is full, damaged or cannot be written costs
    time alone, and several processes may share it.

    Parameters
    ----------
    encoder
        Worth keeping features of: one that computes longer than a disk reads.
    cache
        Where they are kept.
    """

    def __init__(self, encoder: Identified, cache: PieceCache) -> None:
        self._encoder, self._cache = encoder, cache
        self.source, self.width, self.stride_px = encoder.source, encoder.width, encoder.stride_px

    def patches(
        self,
        picture: UInt8[np.ndarray, "rows columns 3"],
        mask: Bool[np.ndarray, "rows columns"],
        pixels: Int64[np.ndarray, "patches 2"],
    ) -> Float32[np.ndarray, "patches features"]:
        """Return the features that are kept, else compute and keep them."""
        name = _name(self._encoder.identity, picture, mask, pixels)
        if (kept := self._cache.get(name)) is None:
            kept = self._encoder.patches(picture, mask, pixels).astype("<f4").tobytes()
            self._cache.put(name, kept)
        features = np.frombuffer(kept, dtype="<f4").astype(np.float32)
        return features.reshape(len(pixels), self.width)

    def texts(self, names: Sequence[str]) -> Float32[np.ndarray, "texts features"]:
        """Return the features of names, which are computed in no time."""
        return self._encoder.texts(names)


def feature_cache() -> PieceCache:
    """Return the user's cache of features; it keeps at most ``XDEN1K_CACHE_GB`` gigabytes.

    Raises
    ------
    DataError
        If that is no number.
    """
    return PieceCache(cache_folder() / FOLDER, cache_limit())


def _name(identity: str, *arrays: np.ndarray) -> str:
    """Name a piece by a digest, in one of 256 folders."""
    digest = hashlib.sha256(identity.encode())
    for array in arrays:
        digest.update(f"{array.dtype.str} {array.shape}".encode())
        digest.update(array.tobytes())
    name = digest.hexdigest()
    return f"{name[:2]}/{name[2:]}"

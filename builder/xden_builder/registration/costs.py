"""What coarse images of a cloud leave of what was measured."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float32, Float64

__all__ = ["Explained", "explained", "explained_in_part"]

LOST: Final = 0.3
"""In features: what is more than that too dark in an image, something without a mesh has made."""
GAINS: Final = (0.5, 1.5)
"""Where not all is explained: free, the gain would fill with the object what it leaves out."""
ROUNDS: Final = 3


class Explained(NamedTuple):
    """How poses explain images.

    Parameters
    ----------
    costs
        What is left, as a share of what an empty image leaves.
    gains
        By which features are multiplied, of each pose.
    """

    costs: Float64[np.ndarray, "b"]
    gains: Float64[np.ndarray, "b"]


def explained(images: Float32[np.ndarray, "b n"], wanted: Float32[np.ndarray, "n"]) -> Explained:
    """Find the best gain of each image, and the share of the wanted features that it leaves."""
    alike = (images @ wanted).astype(np.float64)
    own = np.einsum("bn,bn->b", images, images).astype(np.float64) + 1e-12
    return Explained(1 - alike**2 / (own * float(wanted @ wanted)), alike / own)


def explained_in_part(
    images: Float32[np.ndarray, "b n"], wanted: Float32[np.ndarray, "n"]
) -> Explained:
    """Do the same of an object of which a part may have no mesh.

    What is missing where the object would be counts as ever; what is there beside it counts by
    Geman and McClure's loss (doi:10.1111/j.2517-6161.1985.tb01346.x), which has a limit.
    """
    gains = np.ones(len(images))
    for _ in range(ROUNDS):
        weights = _lost_share(gains, images, wanted) ** 2
        alike = np.einsum("bn,bn,n->b", weights, images, wanted)
        gains = (alike / (np.einsum("bn,bn,bn->b", weights, images, images) + 1e-12)).clip(*GAINS)
    off, share = gains[:, None] * images - wanted, _lost_share(gains, images, wanted)
    left = np.einsum("bn,bn,bn->b", share, off, off)
    empty = float((LOST**2 * wanted**2 / (LOST**2 + wanted**2)).sum())
    return Explained(left / empty, gains)


def _lost_share(
    gains: Float64[np.ndarray, "b"],
    images: Float32[np.ndarray, "b n"],
    wanted: Float32[np.ndarray, "n"],
) -> Float64[np.ndarray, "b n"]:
    """By how much less than its square a residual counts: 1 where the object is too dark."""
    lost = np.minimum(gains[:, None] * images - wanted, 0.0)
    return np.asarray(LOST**2 / (LOST**2 + lost**2))

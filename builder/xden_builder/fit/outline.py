"""Which pixels lie on the outline of a part."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool

from xden1k.rays import PathLengths
from xden_builder.fit import kernels
from xden_builder.fit.crops import Crop, neighbours

__all__ = ["on_outline"]


def on_outline(lengths: PathLengths) -> Bool[np.ndarray, "n"]:
    """Whether a neighbour's rays meet other parts than the pixel's own, shape (n,)."""
    count = len(lengths.pixels)
    if not count:
        return np.zeros(0, dtype=bool)
    sets = np.zeros(count, dtype=np.uint64)
    parts = lengths.lengths_cm.shape[2]
    keys = np.random.default_rng(0).integers(1, 2**63, parts, dtype=np.uint64)
    kernels.hit_sets(lengths.lengths_cm, keys, sets)
    crop = Crop.around(lengths.pixels, lengths.shape, margin_px=1)
    image = crop.image(sets, background=0.0)
    return np.asarray((neighbours(image) != image).any(axis=0)[crop.rows, crop.columns])

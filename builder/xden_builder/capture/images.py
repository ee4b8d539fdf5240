"""One grey image as a file holds it, and what its header says of the values."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Shaped

from xden1k.errors import DataError

__all__ = ["ImageFile", "Polarity"]

Polarity = Literal["linear", "inverted"]
"""``linear``: more photons, larger value; ``inverted``: the contrary."""


@dataclass(frozen=True, eq=False)
class ImageFile:
    """The pixels of an image and what its header says of them.

    Parameters
    ----------
    path
        Where it was read from.
    pixels
        Shape (rows, columns), integers or floats, finite.
    polarity
        What a DICOM header says; None for every other format.
    intensity_relation
        PixelIntensityRelationship of a DICOM header: ``LIN``, ``LOG``, ``DISP`` or empty.
    bits
        BitsStored of a DICOM header; None for every other format.
    rescale
        Slope and intercept of a DICOM header, already applied.

    Raises
    ------
    DataError
        If there is more than one frame or colour, or a pixel is not a finite number.
    """

    path: Path
    pixels: Shaped[np.ndarray, "..."]
    polarity: Polarity | None = None
    intensity_relation: str = ""
    bits: int | None = None
    rescale: tuple[float, float] = (1.0, 0.0)

    def __post_init__(self) -> None:
        shape, dtype = self.pixels.shape, self.pixels.dtype
        if len(shape) != 2 or 0 in shape or dtype.kind not in "iuf":
            raise DataError(
                f"{self.path}: expected rows x columns of numbers, got shape {shape} of {dtype}"
            )
        bad = ~np.isfinite(self.pixels)
        if bad.any():
            first = tuple(int(i) for i in np.argwhere(bad)[0])
            raise DataError(
                f"{self.path}: {int(bad.sum())} pixels are not finite, first at {first}"
            )

    def converter_range(self, bits: int) -> tuple[float, float]:
        """Return lowest and highest value a converter of so many bits can give."""
        slope, intercept = self.rescale
        low, high = sorted((intercept, slope * (2**bits - 1) + intercept))
        return low, high

"""The part of a frame that holds the object, as a small image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Int64, Shaped

__all__ = ["Crop", "neighbours"]

Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True, slots=True, eq=False)
class Crop:
    """Bounding box of some pixels, and where they lie in it.

    Parameters
    ----------
    box
        Rows and columns of the frame.
    rows, columns
        Shape (n,): of each pixel, in the box.
    """

    box: tuple[slice, slice]
    rows: Int64[np.ndarray, "n"]
    columns: Int64[np.ndarray, "n"]

    @classmethod
    def around(cls, pixels: Int64[np.ndarray, "n"], shape: tuple[int, int], margin_px: int) -> Crop:
        """Return the box around at least one pixel, given by flat indices, cut to the frame."""
        places = np.divmod(pixels, shape[1])
        starts = [max(int(place.min()) - margin_px, 0) for place in places]
        stops = [
            min(int(place.max()) + margin_px + 1, size)
            for place, size in zip(places, shape, strict=True)
        ]
        box = (slice(starts[0], stops[0]), slice(starts[1], stops[1]))
        return cls(box, places[0] - starts[0], places[1] - starts[1])

    def image(
        self, values: Shaped[np.ndarray, "n"], background: float
    ) -> Shaped[np.ndarray, "rows columns"]:
        """Put the pixels' values into an image of the box."""
        shape = tuple(part.stop - part.start for part in self.box)
        image = np.full(shape, background, dtype=values.dtype)
        image[self.rows, self.columns] = values
        return image


def neighbours(image: Shaped[np.ndarray, "rows columns"]) -> Shaped[np.ndarray, "4 rows columns"]:
    """Return the neighbour above, below, left and right; beyond the border the pixel itself."""
    padded = np.pad(image, 1, mode="edge")
    return np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])

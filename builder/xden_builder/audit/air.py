"""Air along the borders of a radiograph, which an open field makes even."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np

from xden1k.values.arrays import Image, Mask

__all__ = ["BORDERS", "OPAQUE", "Uneven", "border_air", "uneven_air"]

MOST_UNEVEN: Final = 1.1
"""Ratio of air at opposite borders: an open field divides it away, whatever the heel effect."""
OPAQUE: Final = 0.02
"""Transmission at a border below which something stands before it that is no air."""
BORDERS: Final = {
    "top": (slice(None, 2), slice(None)),
    "bottom": (slice(-2, None), slice(None)),
    "left": (slice(None), slice(None, 2)),
    "right": (slice(None), slice(-2, None)),
}
"""By name, the outermost pixels."""
OPPOSITE: Final = (("top", "bottom"), ("left", "right"))


class Uneven(NamedTuple):
    """Two opposite borders, and the transmission of air along each."""

    one: str
    other: str
    level: float
    other_level: float


def border_air(image: Image, drawn: Mask, known: Mask) -> dict[str, float]:
    """Return the median transmission along each border that was measured and no part reaches.

    Parameters
    ----------
    image, drawn, known
        Shape (rows, columns): transmission, where parts are, and where it was measured.
    """
    return {
        name: float(np.median(image[border][known[border]]))
        for name, border in BORDERS.items()
        if known[border].any() and not drawn[border].any()
    }


def uneven_air(levels: Mapping[str, float]) -> Iterator[Uneven]:
    """Yield opposite borders of which one is brighter by more than a tenth, by :func:`border_air`.

    Examples
    --------
    >>> [(found.one, found.other) for found in uneven_air({"top": 1.3, "bottom": 1.0, "left": 1.1})]
    [('top', 'bottom')]
    """
    for one, other in OPPOSITE:
        level, other_level = (levels.get(border, 0.0) for border in (one, other))
        if min(level, other_level) < OPAQUE:  # a part, or no air
            continue
        if max(level, other_level) > MOST_UNEVEN * min(level, other_level):
            yield Uneven(one, other, level, other_level)

"""Air along the borders of a radiograph and in its corners, which an open field makes even."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np

from xden1k.values.arrays import Image, Mask

__all__ = ["BORDERS", "OPAQUE", "Uneven", "border_air", "corner_ratio", "falls_off", "uneven_air"]

MOST_UNEVEN: Final = 1.1
"""Ratio of air at opposite borders: an open field divides it away, whatever the heel effect."""
MOST_FALL: Final = 0.015
"""By which air may be darker, or brighter, in all corners than in the middles of borders: in the
mean it is by 0.4 % at most in 172 radiographs of 86 simulated objects, of ours and by the other
simulator, scatter included, and by 4 % in some that were not divided by an open field."""
COLLIMATED: Final = 0.4
"""Corners that are darker than this share are beside a round field: the cosine's fourth power falls
so far 37 degrees off the axis alone."""
PATCH: Final = 20
"""Patches of air along a side, at a corner; along the middle of a border one is four as long."""
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


def corner_ratio(image: Image, drawn: Mask, known: Mask) -> float | None:
    """Transmission of the corners over that of the middles of the borders, those that are nearest.

    Of an open field that falls off, or is brighter outwards, all corners are beyond all middles;
    what stands at a border or in a corner makes but some of them other, and the ratio is 1. None
    where a part reaches a corner or more than two middles, or half of one was not measured.

    Parameters
    ----------
    image, drawn, known
        As of :func:`border_air`.
    """
    (top, upright, bottom), (left, level, right) = map(_thirds, image.shape)

    def air(*patches: tuple[slice, slice]) -> list[float]:
        """Of those that show air alone."""
        return [
            float(np.median(image[patch][known[patch]]))
            for patch in patches
            if not drawn[patch].any() and known[patch].mean() >= 0.5
        ]

    corners = air((top, left), (top, right), (bottom, left), (bottom, right))
    middles = air((top, level), (bottom, level), (upright, left), (upright, right))
    if len(corners) < 4 or len(middles) < 2 or min(middles) <= OPAQUE:
        return None
    return min(max(corners) / min(middles), 1.0) * max(min(corners) / max(middles), 1.0)


def _thirds(side: int) -> tuple[slice, slice, slice]:
    """First and last pixels of a side, and between them some about its middle."""
    patch, middle = max(side // PATCH, 3), side // 2
    return slice(None, patch), slice(middle - 2 * patch, middle + 2 * patch), slice(-patch, None)


def falls_off(ratio: float | None) -> bool:
    """Whether air is not even, by :func:`corner_ratio`; a round field's rim is no such air.

    Examples
    --------
    >>> [falls_off(ratio) for ratio in (None, 0.3, 0.96, 0.99, 1.0, 1.04)]
    [False, False, True, False, False, True]
    """
    return ratio is not None and ratio > COLLIMATED and abs(ratio - 1) > MOST_FALL

"""Colours of phantoms: what bare materials usually look like, and coats of paint.

A batch has its own shade and hue: a usual colour times a shade, plus a hue. How far a colour is
from a usual one, in those terms, tells paint from bare material where an eye could.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from xden1k.values.materials import load_materials

__all__ = ["HUE_SD", "PAINTS", "SHADE_SD", "Color", "is_coat", "usual_colors"]

Color = tuple[float, float, float]
"""Red, green, blue, from 0 to 1, as displayed."""

SHADE_SD, HUE_SD = 0.03, 0.008
"""Of the factor and of the summand by which a batch differs."""
COAT_SHARE = 0.2
"""Of lifelike batches, those that are painted."""

PAINTS: Final = (
    (0.80, 0.16, 0.15),
    (0.93, 0.52, 0.13),
    (0.95, 0.80, 0.20),
    (0.25, 0.55, 0.27),
    (0.16, 0.40, 0.70),
    (0.14, 0.15, 0.17),
    (0.45, 0.47, 0.50),
    (0.90, 0.90, 0.88),
)
"""Colours of coats, as of plastics."""
_BY_FAMILY: Final[dict[str, tuple[Color, ...]]] = {
    "metal": ((0.66, 0.67, 0.69), (0.76, 0.77, 0.79)),
    "polymer": PAINTS,
    "elastomer": ((0.13, 0.13, 0.14), (0.25, 0.26, 0.28), *PAINTS[:5]),
    "foam": ((0.95, 0.94, 0.90), (0.35, 0.36, 0.40)),
    "wood": ((0.80, 0.63, 0.42), (0.69, 0.49, 0.29)),
    "paper": ((0.93, 0.92, 0.88), (0.74, 0.60, 0.42)),
    "textile": ((0.92, 0.90, 0.85), (0.60, 0.34, 0.20)),
    "glass": ((0.78, 0.88, 0.86), (0.50, 0.66, 0.52)),
    "ceramic": ((0.93, 0.92, 0.89), (0.35, 0.48, 0.60), (0.72, 0.38, 0.27)),
    "mineral": ((0.62, 0.61, 0.59),),
    "liquid": ((0.66, 0.82, 0.92),),
    "composite": ((0.15, 0.42, 0.24),),
}
_BY_NAME: Final[dict[str, tuple[Color, ...]]] = {
    "alkaline_cell": ((0.13, 0.13, 0.14), (0.75, 0.55, 0.22)),
    "brass": ((0.79, 0.65, 0.33),),
    "cast_iron": ((0.28, 0.28, 0.30),),
    "copper": ((0.78, 0.48, 0.34),),
    "cork": ((0.76, 0.57, 0.36),),
    "graphite": ((0.20, 0.20, 0.22),),
    "leather": ((0.93, 0.91, 0.86),),
    "oil_vegetable": ((0.90, 0.78, 0.30),),
    "phenolic": ((0.12, 0.11, 0.11),),
    "water_like": ((0.93, 0.90, 0.80),),
}
_UNKNOWN: Final = ((0.7, 0.7, 0.7),)


def usual_colors(material: str) -> tuple[Color, ...]:
    """Usual colours of a bare part of a material of the library, or of a family."""
    return _BY_NAME.get(material, _BY_FAMILY.get(_family(material), _UNKNOWN))


def is_coat(material: str, color: Color) -> bool:
    """Whether a part of this material has more likely a coat of paint than its own colour.

    Where paint and the material have the same colours, as plastics do, it is bare; no coat keeps on
    what flows.
    """
    if _family(material) in ("gas", "liquid"):
        return False
    coat = np.log(COAT_SHARE) + _likelihood(color, PAINTS)
    return bool(coat > np.log(1 - COAT_SHARE) + _likelihood(color, usual_colors(material)))


def _family(material: str) -> str:
    library = load_materials()
    return library[material].family if material in library else material


def _likelihood(color: Color, usual: Sequence[Color]) -> float:
    """Logarithm of the likelihood that a batch has this colour, all usual ones alike."""
    each = [_gaussian(np.array(color) - one, np.array(one)) for one in usual]
    return float(np.logaddexp.reduce(each) - np.log(len(each)))


def _gaussian(difference: np.ndarray, usual: np.ndarray) -> float:
    """Logarithm of a batch's density about a usual colour, but for what all have in common."""
    spread = HUE_SD**2 * np.eye(3) + SHADE_SD**2 * np.outer(usual, usual)
    distance_squared = difference @ np.linalg.solve(spread, difference)
    return float(-(distance_squared + np.linalg.slogdet(spread)[1]) / 2)

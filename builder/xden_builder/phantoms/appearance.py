"""Colours and finish that a camera would see, by material."""

from __future__ import annotations

from typing import Final

import numpy as np

from xden1k.values.materials import load_materials

__all__ = ["draw_color", "draw_finish", "draw_paint"]

Color = tuple[float, float, float]

_PAINTS: Final = (
    (0.80, 0.16, 0.15),
    (0.93, 0.52, 0.13),
    (0.95, 0.80, 0.20),
    (0.25, 0.55, 0.27),
    (0.16, 0.40, 0.70),
    (0.14, 0.15, 0.17),
    (0.45, 0.47, 0.50),
    (0.90, 0.90, 0.88),
)
_BY_FAMILY: Final[dict[str, tuple[Color, ...]]] = {
    "metal": ((0.66, 0.67, 0.69), (0.76, 0.77, 0.79)),
    "polymer": _PAINTS,
    "elastomer": ((0.13, 0.13, 0.14), (0.25, 0.26, 0.28), *_PAINTS[:5]),
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
_METALNESS: Final = {"metal": 1.0}
_ROUGHNESS: Final = {
    "metal": (0.2, 0.5),
    "polymer": (0.25, 0.6),
    "elastomer": (0.6, 0.9),
    "glass": (0.02, 0.12),
    "ceramic": (0.1, 0.5),
    "liquid": (0.0, 0.05),
}
"""Of a microfacet model as glTF 2.0 has it; what is not here is as rough as wood or paper."""
_SHADE_SD, _HUE_SD = 0.03, 0.008


def draw_color(rng: np.random.Generator, material: str) -> Color:
    """Draw a base colour that a part of this material may have, three values from 0 to 1."""
    family = load_materials()[material].family
    usual = _BY_NAME.get(material, _BY_FAMILY.get(family, ((0.7, 0.7, 0.7),)))
    return _varied(rng, usual[rng.integers(len(usual))])


def _varied(rng: np.random.Generator, color: Color) -> Color:
    """Give a colour the shade and hue of one batch."""
    varied = np.array(color) * rng.normal(1.0, _SHADE_SD) + rng.normal(0.0, _HUE_SD, 3)
    red, green, blue = varied.clip(0.0, 1.0).round(3).tolist()
    return red, green, blue


def draw_finish(rng: np.random.Generator, material: str) -> tuple[float, float]:
    """Draw metalness and roughness, both from 0 to 1, of a bare part."""
    family = load_materials()[material].family
    rough = rng.uniform(*_ROUGHNESS.get(family, (0.6, 0.95)))
    return _METALNESS.get(family, 0.0), round(float(rough), 3)


def draw_paint(rng: np.random.Generator, shades: np.random.Generator) -> tuple[Color, float]:
    """Draw base colour and roughness of a coat of paint; it is never metallic.

    Parameters
    ----------
    rng
        Chooses the paint and its roughness.
    shades
        Vary its colour, as that of bare materials is varied: nothing tells a coat by its colour.
    """
    color = _varied(shades, _PAINTS[rng.integers(len(_PAINTS))])
    return color, round(float(rng.uniform(0.2, 0.7)), 3)

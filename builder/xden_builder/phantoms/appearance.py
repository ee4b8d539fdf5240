"""Colours and finish that a camera would see, by material."""

from __future__ import annotations

from typing import Final

import numpy as np

from xden1k.values.materials import load_materials
from xden1k.values.palette import HUE_SD, PAINTS, SHADE_SD, Color, usual_colors

__all__ = ["draw_color", "draw_finish", "draw_paint"]

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


def draw_color(rng: np.random.Generator, material: str) -> Color:
    """Draw a base colour that a part of this material may have, three values from 0 to 1."""
    usual = usual_colors(material)
    return _varied(rng, usual[rng.integers(len(usual))])


def _varied(rng: np.random.Generator, color: Color) -> Color:
    """Give a colour the shade and hue of one batch."""
    varied = np.array(color) * rng.normal(1.0, SHADE_SD) + rng.normal(0.0, HUE_SD, 3)
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
    color = _varied(shades, PAINTS[rng.integers(len(PAINTS))])
    return color, round(float(rng.uniform(0.2, 0.7)), 3)

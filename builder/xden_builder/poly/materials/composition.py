"""How far what a thing is made of may be off what the library says its material is made of."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

from xden1k.values.materials import Material

__all__ = ["composition_sd"]

USUAL: Final = 0.03
BY_FAMILY: Final = MappingProxyType(
    {
        "metal": 0.02,
        "liquid": 0.02,
        "wood": 0.02,
        "elastomer": 0.08,
        "glass": 0.04,
        "ceramic": 0.08,
        "mineral": 0.08,
        "tissue": 0.05,
        "composite": 0.12,
    }
)
"""Standard deviation of the mass attenuation coefficient between 30 and 100 keV, as a share of it:
alloys and liquids differ by a per cent or two, pigments by several, fillers of rubber, clays and
glazes by more, circuit boards by their bromine most (assumed, from the spread of grades within one
trade name; the last four after a look at 36 objects of the other simulator, seeds 21 to 23)."""


def composition_sd(material: Material) -> float:
    """Return the standard deviation of a material's attenuation coefficient, as a share of it.

    Examples
    --------
    >>> from xden1k.values.materials import load_materials
    >>> library = load_materials()
    >>> composition_sd(library["steel"]), composition_sd(library["pcb_fr4"])
    (0.02, 0.12)
    """
    return BY_FAMILY.get(material.family, USUAL)

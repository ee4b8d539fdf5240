"""How far what a thing is made of may be off what the library says its material is made of."""

from __future__ import annotations

import math
from functools import cache
from types import MappingProxyType
from typing import Final

import numpy as np

from xden1k.values.materials import Material, load_materials
from xden_builder.physics.attenuation import element_fractions, mac_cm2_g

__all__ = ["composition_sd"]

USUAL: Final = 0.03
BY_FAMILY: Final = MappingProxyType(
    {
        "metal": 0.02,
        "liquid": 0.02,
        "wood": 0.02,
        "elastomer": 0.08,
        "foam": 0.12,
        "paper": 0.05,
        "glass": 0.04,
        "ceramic": 0.08,
        "mineral": 0.08,
        "tissue": 0.05,
        "composite": 0.12,
    }
)
"""Standard deviation of the mass attenuation coefficient between 30 and 100 keV, as a share of it:
alloys and liquids differ by a per cent or two, pigments by several, fillers of rubber and paper,
clays and glazes by more, fillers of foam and the bromine of circuit boards most (assumed, from the
spread of grades within one trade name; those of elastomers, foam, paper, ceramics and composites
after a look at 101 objects of the other simulator, seeds 21 to 23 and 601 to 605)."""
DOSED: Final = 0.2
"""Standard deviation of how much of an additive a grade has, as a share of what the library says:
a tenth of barium oxide stands for 8 to 12 % (assumed)."""
TO_MEASURE: Final = frozenset({"metal", "liquid", "composite"})
"""Families whose grades are alloyed or diluted by a standard, or that err by more already."""
TYPICAL_KEV: Final = 60.0
"""Of the photons that come through an object, at 100 kV."""


def composition_sd(material: Material) -> float:
    """Return the standard deviation of a material's attenuation coefficient, as a share of it.

    A grade that owes its attenuation to an additive may have more or less of that, too.

    Examples
    --------
    >>> library = load_materials()
    >>> composition_sd(library["steel"]), composition_sd(library["pcb_fr4"])
    (0.02, 0.12)
    >>> [round(composition_sd(library[each]), 2) for each in ("abs", "abs_brominated")]
    [0.03, 0.16]
    """
    usual = BY_FAMILY.get(material.family, USUAL)
    return usual if material.family in TO_MEASURE else _with_additives(material.name, usual)


@cache
def _with_additives(name: str, usual: float) -> float:
    return math.hypot(usual, DOSED * _additive_share(load_materials()[name]))


def _additive_share(material: Material) -> float:
    """Return the share of a grade's attenuation that its base does not have, at 60 keV.

    It is that of the elements of which the grade has more; a base has none.
    """
    base = element_fractions(load_materials()[material.base].composition)
    more = {
        element: share - base.get(element, 0.0)
        for element, share in element_fractions(material.composition).items()
    }
    added = [
        share * mac_cm2_g(((element, 1.0),), TYPICAL_KEV)
        for element, share in more.items()
        if share > 0
    ]
    return float(np.sum(added) / mac_cm2_g(material.composition, TYPICAL_KEV))

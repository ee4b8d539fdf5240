"""What makes simulated objects as untidy as real ones: pores, paint, labels that err."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from xden1k.errors import DataError
from xden1k.values.materials import load_materials

__all__ = ["LIFELIKE", "TIDY", "Realism", "draw_label", "draw_solid_share"]

_MAY_BE_POROUS: Final = frozenset({"polymer", "elastomer", "wood", "ceramic", "mineral", "paper"})
LEAST_SOLID: Final = 0.35
"""Foamed mouldings: from a third of the solid's density up."""


@dataclass(frozen=True, slots=True)
class Realism:
    """How often each thing happens, as a share from 0 to 1.

    Parameters
    ----------
    porous_share
        Of the batches of non-metals: material with pores, which no label tells.
    wrong_label_share
        Of the parts: labelled as another material of the same family.
    missing_label_share
        Of the parts: without a label.
    paint_share
        Of the batches: painted or coated in a colour that hides the material.

    Raises
    ------
    DataError
        If a share is not within 0 and 1, or labels err more often than always.
    """

    porous_share: float = 0.0
    wrong_label_share: float = 0.0
    missing_label_share: float = 0.0
    paint_share: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            if not 0.0 <= (share := getattr(self, field.name)) <= 1.0:
                raise DataError(f"{field.name} must be from 0 to 1, got {share}")
        if (sum_of_both := self.wrong_label_share + self.missing_label_share) > 1.0:
            raise DataError(f"wrong and missing labels must be 1 at most, got {sum_of_both}")


TIDY: Final = Realism()
"""All solid, labelled rightly and bare."""

LIFELIKE: Final = Realism(
    porous_share=0.15, wrong_label_share=0.05, missing_label_share=0.05, paint_share=0.2
)
"""As annotators and everyday things are."""


def draw_solid_share(rng: np.random.Generator, material: str, porous_share: float) -> float:
    """Draw which share of a batch's volume is material rather than pores.

    The same random numbers are used up whatever comes of it.
    """
    chance, solid = rng.random(), rng.uniform(LEAST_SOLID, 1.0)
    may = load_materials()[material].family in _MAY_BE_POROUS
    return float(solid) if may and chance < porous_share else 1.0


def draw_label(rng: np.random.Generator, material: str, realism: Realism) -> str:
    """Draw what an annotator takes a part's material for; empty when it is left out.

    Annotators err among the bases of the library; none writes a grade.
    """
    chance, pick = rng.random(), rng.random()
    if chance < realism.missing_label_share:
        return ""
    if chance >= realism.missing_label_share + realism.wrong_label_share:
        return material
    bases, family = load_materials().bases, load_materials()[material].family
    others = [name for name in bases if name != material]
    alike = [name for name in others if bases[name].family == family]
    wrong = alike or others
    return wrong[int(pick * len(wrong))]

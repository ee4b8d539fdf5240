"""What the bench's objects are made of: real compositions, of which few are in our library.

The table is ``substances.csv``: composition, range of densities and source of each, and the label
that an annotator would give it.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from xden1k.values.materials import Composition, load_materials, parse_composition

__all__ = ["Substance", "labels_alike", "load_substances", "substances_called"]

TABLE: Final = Path(__file__).with_name("substances.csv")


@dataclass(frozen=True, slots=True)
class Substance:
    """One substance.

    Parameters
    ----------
    name
        Its own.
    label
        The material of our library that an annotator takes it for.
    composition
        Formulas and mass fractions.
    density_low_g_cm3, density_high_g_cm3
        Range it is found with.
    """

    name: str
    label: str
    composition: Composition
    density_low_g_cm3: float
    density_high_g_cm3: float


@cache
def load_substances() -> Mapping[str, Substance]:
    """Read the table, once: by name.

    Examples
    --------
    >>> load_substances()["brass_cw614n"].label
    'brass'
    """
    with TABLE.open(newline="", encoding="utf-8") as file:
        return {row["name"]: _substance(row) for row in csv.DictReader(file)}


def _substance(row: Mapping[str, str]) -> Substance:
    return Substance(
        name=row["name"],
        label=row["label"],
        composition=parse_composition(row["composition"]),
        density_low_g_cm3=float(row["density_low_g_cm3"]),
        density_high_g_cm3=float(row["density_high_g_cm3"]),
    )


def substances_called(label: str) -> Sequence[Substance]:
    """List what may hide behind a label, in the order of the table."""
    return [each for each in load_substances().values() if each.label == label]


def labels_alike(label: str) -> Sequence[str]:
    """List the labels a part may be given by mistake: others of the family, else any other.

    Examples
    --------
    >>> labels_alike("glass_soda_lime")
    ['glass_borosilicate']
    """
    known = load_materials()
    others = list(dict.fromkeys(each.label for each in load_substances().values()))
    others.remove(label)
    return [o for o in others if known[o].family == known[label].family] or others

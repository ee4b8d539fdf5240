"""The material library: what things are made of and how dense they can be.

One file, ``materials.csv``, each row with the source of its figures. Names are lower case with
underscores. A label of a part is a name, an alias, a family (``metal``), an everyday word for one
(``plastic``) or empty; these never coincide, and only upper and lower case are forgiven. A grade
(``abs_brominated``) is a material of its own, and names the base that an annotator would rather
write (``abs``).
"""

from __future__ import annotations

import csv
import difflib
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, reduce
from importlib.resources import files
from operator import add
from types import MappingProxyType
from typing import Final

from xden1k.errors import DataError

__all__ = [
    "FAMILY_WORDS",
    "Composition",
    "Material",
    "MaterialLibrary",
    "check_label",
    "families",
    "load_materials",
    "parse_composition",
]

Composition = tuple[tuple[str, float], ...]
"""Chemical formulas and their mass fractions, which add up to 1."""

FAMILY_WORDS: Final = MappingProxyType(
    {"fabric": "textile", "plastic": "polymer", "rubber": "elastomer"}
)
"""Everyday words for families."""
_FORMULA = re.compile(r"(?:[A-Z][a-z]?\d*\.?\d*)+")


@dataclass(frozen=True, slots=True)
class Material:
    """A material: composition and the densities it is found with.

    Parameters
    ----------
    name, family
        Lower case, underscores for spaces.
    composition
        Chemical formulas and their mass fractions, which add up to 1.
    density_low_g_cm3, density_nominal_g_cm3, density_high_g_cm3
        Range of the bulk material and its usual value.
    composition_source, density_source
        Where the figures are from; ``assumed`` is said where it is so.
    aliases
        Other names.
    grade_of
        The base that this is a grade of; empty for a base.

    Raises
    ------
    DataError
        If not 0 < low <= nominal <= high.
    """

    name: str
    family: str
    composition: Composition
    density_low_g_cm3: float
    density_nominal_g_cm3: float
    density_high_g_cm3: float
    composition_source: str
    density_source: str
    aliases: tuple[str, ...] = ()
    grade_of: str = ""

    def __post_init__(self) -> None:
        low, nominal, high = (
            self.density_low_g_cm3,
            self.density_nominal_g_cm3,
            self.density_high_g_cm3,
        )
        if not 0 < low <= nominal <= high < math.inf:
            raise DataError(
                f"material {self.name}: densities must be 0 < low <= nominal <= high, "
                f"got {low}, {nominal}, {high}"
            )

    @property
    def density_sd_g_cm3(self) -> float:
        """Standard deviation when nothing but the material is known: its range taken as uniform."""
        return (self.density_high_g_cm3 - self.density_low_g_cm3) / math.sqrt(12)

    @property
    def base(self) -> str:
        """What an annotator would rather write: the base of a grade, else the own name."""
        return self.grade_of or self.name

    def called(self, label: str) -> bool:
        """Whether a label may mean this: nothing, its family, its own name or its base's.

        Examples
        --------
        >>> leaded = load_materials()["brass_leaded"]
        >>> leaded.called("brass"), leaded.called("metal"), leaded.called("bronze")
        (True, True, False)
        """
        return label in ("", self.family, self.name, self.base)


class MaterialLibrary(Mapping[str, Material]):
    """Materials by name; looked up by name or alias, in any case.

    Raises
    ------
    DataError
        If two materials share a name or an alias, or one is called like a family, or a grade is not
        one of a base of its own family.
    """

    def __init__(self, materials: tuple[Material, ...]) -> None:
        self._materials = {material.name: material for material in materials}
        labels = [label for each in materials for label in (each.name, *each.aliases)]
        labels += {material.family for material in materials}
        if twice := sorted({label for label in labels if labels.count(label) > 1}):
            raise DataError(f"material library: used more than once: {twice}")
        self._by_label = {label: each for each in materials for label in (each.name, *each.aliases)}
        self._bases = {each.name: each for each in materials if not each.grade_of}
        for each in materials:
            _check_grade(each, self._bases.get(each.base))

    def __getitem__(self, name: str) -> Material:
        return self._by_label[name.lower()]

    def __iter__(self) -> Iterator[str]:
        return iter(self._materials)

    def __len__(self) -> int:
        return len(self._materials)

    @property
    def labels(self) -> tuple[str, ...]:
        """Every name and alias."""
        return tuple(self._by_label)

    @property
    def bases(self) -> Mapping[str, Material]:
        """Materials that are no grade of another, by name."""
        return MappingProxyType(self._bases)


def _check_grade(material: Material, base: Material | None) -> None:
    if base is None or base.family != material.family:
        raise DataError(
            f"material {material.name}: expected grade_of to be a base of the family "
            f"{material.family}, got {material.grade_of!r}"
        )


@cache
def load_materials() -> MaterialLibrary:
    """Read the packaged library, once.

    Examples
    --------
    >>> iron = load_materials()["Iron"]
    >>> iron.family, iron.composition, iron.density_nominal_g_cm3
    ('metal', (('Fe', 1.0),), 7.874)
    """
    text = files("xden1k.values").joinpath("materials.csv").read_text(encoding="utf-8")
    return MaterialLibrary(tuple(_material(row) for row in csv.DictReader(text.splitlines())))


@cache
def families() -> tuple[str, ...]:
    """Return the families of the library, sorted.

    Examples
    --------
    >>> "metal" in families(), "iron" in families()
    (True, False)
    """
    return tuple(sorted({material.family for material in load_materials().values()}))


def check_label(label: str) -> str:
    """Return the library's spelling of a part's material label.

    Parameters
    ----------
    label
        A name, an alias, a family or an everyday word for one, or empty for unknown.

    Raises
    ------
    DataError
        If it is none of them; the message names the nearest ones, and all families.

    Examples
    --------
    >>> check_label("Polypropylene"), check_label("METAL"), check_label("plastic"), check_label("")
    ('pp', 'metal', 'polymer', '')
    """
    lowered = label.lower()
    lowered = FAMILY_WORDS.get(lowered, lowered)
    if lowered in ("", *families()):
        return lowered
    library = load_materials()
    if lowered in library:
        return library[lowered].name
    near = difflib.get_close_matches(lowered, (*library.labels, *families(), *FAMILY_WORDS))
    raise DataError(
        f"unknown material {label!r}: expected a name of the material library, a family "
        f"({', '.join(families())}) or nothing" + (f"; near: {', '.join(near)}" if near else "")
    )


def parse_composition(text: str) -> Composition:
    """Read a formula, or formulas with mass fractions.

    Raises
    ------
    DataError
        If a formula or a fraction cannot be read, or the fractions do not add up to 1.

    Examples
    --------
    >>> parse_composition("C3H6")
    (('C3H6', 1.0),)
    >>> parse_composition("SiO2:0.75 Na2O:0.25")
    (('SiO2', 0.75), ('Na2O', 0.25))
    """
    if ":" not in text:
        text = f"{text.strip()}:1"
    pairs = tuple(_formula_and_fraction(term) for term in text.split())
    # sum() rounds otherwise from Python 3.12 on
    total = reduce(add, (fraction for _, fraction in pairs))
    if not abs(total - 1) < 1e-3:
        raise DataError(f"composition {text!r}: mass fractions must add up to 1, got {total:g}")
    return tuple((formula, fraction / total) for formula, fraction in pairs)


def _formula_and_fraction(term: str) -> tuple[str, float]:
    formula, _, number = term.partition(":")
    try:
        fraction = float(number)
    except ValueError:
        fraction = math.nan
    if not _FORMULA.fullmatch(formula) or not 0 < fraction <= 1:
        raise DataError(f"composition: expected FORMULA:MASS_FRACTION, got {term!r}")
    return formula, fraction


def _material(row: Mapping[str, str]) -> Material:
    return Material(
        name=row["name"],
        family=row["family"],
        composition=parse_composition(row["composition"]),
        density_low_g_cm3=float(row["density_low_g_cm3"]),
        density_nominal_g_cm3=float(row["density_nominal_g_cm3"]),
        density_high_g_cm3=float(row["density_high_g_cm3"]),
        composition_source=row["composition_source"],
        density_source=row["density_source"],
        aliases=tuple(row["aliases"].split()),
        grade_of=row["grade_of"],
    )

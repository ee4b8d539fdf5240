"""What there is to simulate: categories, and the materials that their parts are made of.

The table is ``catalogue.csv``. A new category takes the row of one that goes, or the end, and no
other row moves: which split an object falls into depends on the place of its category.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from xden1k.errors import DataError
from xden1k.values.materials import load_materials
from xden_builder.phantoms.archetypes import ARCHETYPES

__all__ = ["CATALOGUE", "Category", "read_catalogue"]

TABLE: Final = Path(__file__).with_name("catalogue.csv")
COLUMNS: Final = ["category", "family", "archetype", "size_min_cm", "size_max_cm", "materials"]


@dataclass(frozen=True, slots=True)
class Category:
    """One kind of object.

    Parameters
    ----------
    name, family
        Its class, and the group of classes it belongs to.
    archetype
        A key of :data:`xden_builder.phantoms.archetypes.ARCHETYPES`.
    size_cm
        Least and largest length (of what lies) or height (of what stands).
    materials
        By role of a part: names of the material library, separated by spaces, all as likely.

    Raises
    ------
    DataError
        If the archetype, a role or a material is unknown, or the sizes are not ascending.
    """

    name: str
    family: str
    archetype: str
    size_cm: tuple[float, float]
    materials: Mapping[str, str]

    def __post_init__(self) -> None:
        if not self.name.replace("_", "").isalnum():
            raise DataError(f"expected letters, digits and _, got category {self.name!r}")
        if self.archetype not in ARCHETYPES:
            raise DataError(f"unknown archetype {self.archetype!r}")
        known = ARCHETYPES[self.archetype].roles.split()
        if strange := sorted(set(self.materials) - set(known)):
            raise DataError(f"unknown roles {strange}; {self.archetype} has {sorted(known)}")
        least, most = self.size_cm
        if not 0 < least <= most:
            raise DataError(f"sizes must be positive and ascending, got {least:g} and {most:g} cm")
        for role, names in self.materials.items():
            if not names or (strange := sorted(set(names.split()) - set(load_materials()))):
                raise DataError(f"role {role} needs known materials, got {names!r}")


def read_catalogue(path: Path) -> tuple[Category, ...]:
    """Read a table of categories.

    Its last column says ``role=material material; role=material``.

    Raises
    ------
    DataError
        If the columns are others, a row is not a sound category, or a name comes twice.
    """
    with path.open(newline="", encoding="utf-8") as file:
        rows = csv.DictReader(file, strict=True)
        if rows.fieldnames != COLUMNS:
            raise DataError(f"{path.name}: expected columns {COLUMNS}, got {rows.fieldnames}")
        categories = tuple(_category(row, f"{path.name}:{rows.line_num}") for row in rows)
    _check_names(path, [category.name for category in categories])
    return categories


def _category(row: Mapping[str, str], where: str) -> Category:
    try:
        materials = dict(entry.strip().split("=") for entry in row["materials"].split(";"))
        size_cm = (float(row["size_min_cm"]), float(row["size_max_cm"]))
    except (AttributeError, TypeError, ValueError) as error:
        raise DataError(
            f"{where}, {row['category']}: expected numbers and role=materials, got {row}"
        ) from error
    try:
        return Category(row["category"], row["family"], row["archetype"], size_cm, materials)
    except DataError as error:
        raise DataError(f"{where}, {row['category']}: {error}") from None


def _check_names(path: Path, names: Iterable[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise DataError(f"{path.name}: category {name} comes twice")
        seen.add(name)


CATALOGUE: Final = read_catalogue(TABLE)
"""Every category; an object takes the next one, over and over."""

"""What stands in a beam, as tables tell it."""

from __future__ import annotations

from functools import cache
from typing import Any

from xden1k.errors import require
from xden1k.values.materials import load_materials
from xden_builder.capture.tables import TomlTable, is_number

__all__ = ["read_filters"]


def read_filters(table: TomlTable) -> dict[str, float]:
    """Read thicknesses in cm, by element or name of the material library.

    Raises
    ------
    DataError
        If a name is neither, or a thickness is negative or no number.
    """
    filters = {}
    for name in table.values:
        if name not in _elements() and name not in load_materials():
            raise table.error(name, "is neither an element nor a name of the material library")
        filters[name] = float(table.get(name, _is_thickness, "a thickness in cm, 0 or more"))
    return filters


@cache
def _elements() -> frozenset[str]:
    """Symbols of the elements that the attenuation tables know."""
    xraydb = require("xraydb", "build")
    return frozenset(xraydb.atomic_symbol(number) for number in range(1, 99))


def _is_thickness(value: Any) -> bool:
    return is_number(value) and value >= 0

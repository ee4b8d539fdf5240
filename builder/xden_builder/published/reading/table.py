"""Attenuation of each part of an object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from xden1k.errors import DataError
from xden1k.values.physics import apparent_density_g_cm3
from xden_builder.published.reading.tolerant import field_named, is_number, parse_object

__all__ = ["PartTable", "read_table"]

LAC: Final = ("lac",)
DENSITY: Final = ("density",)
MOST_PER_CM: Final = 60.0
"""Lead at 60 keV: nothing that people own attenuates more."""
RULE_TOLERANCE: Final = 0.01


@dataclass(frozen=True, slots=True)
class PartTable:
    """A table of parts.

    Parameters
    ----------
    lac_per_cm
        By the part's key, in the file's order.
    density_g_cm3
        As published; only the parts that have one.
    other_rule
        Keys of the parts whose density is not LAC / 0.17 within 1 %.
    """

    lac_per_cm: Mapping[str, float]
    density_g_cm3: Mapping[str, float]
    other_rule: tuple[str, ...]


def read_table(content: bytes, where: object) -> PartTable:
    """Read a table of parts.

    Parameters
    ----------
    content
        JSON: by part, an object with ``LAC`` (1/cm) and perhaps ``Density`` (g/cm³).
    where
        Name of the file, for messages.

    Raises
    ------
    DataError
        If it is something else, or an attenuation is negative, not finite or above 60 1/cm.

    Examples
    --------
    >>> read_table(b'{"head": {"LAC": 0.17, "Density": 1.0}}', "t.json").lac_per_cm
    {'head': 0.17}
    """
    values = parse_object(content, where)
    lac = {str(key): _lac(key, value, where) for key, value in values.items()}
    told = {str(key): field_named(value, DENSITY) for key, value in values.items()}
    density = {key: float(value) for key, value in told.items() if is_number(value)}
    other = [key for key, value in density.items() if not _is_the_rule(lac[key], value)]
    return PartTable(lac, density, tuple(other))


def _lac(key: object, part: Any, where: object) -> float:
    value = field_named(part, LAC)
    if value is None:
        found = ", ".join(part) if isinstance(part, dict) else repr(part)
        raise DataError(f'{where}: part "{key}": expected a field LAC, got {found}')
    if not is_number(value) or not 0 <= value <= MOST_PER_CM:
        raise DataError(
            f'{where}: part "{key}": LAC must be from 0 to {MOST_PER_CM:g} 1/cm, got {value!r}'
        )
    return float(value)


def _is_the_rule(lac_per_cm: float, density_g_cm3: float) -> bool:
    expected = apparent_density_g_cm3(lac_per_cm)
    return abs(density_g_cm3 - expected) <= RULE_TOLERANCE * expected

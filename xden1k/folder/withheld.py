"""A row without its answers: what is published of an object whose truth is kept back.

What a method may look at stays: radiographs and their geometry, meshes, grids of shares, labels,
names. Whatever holds or tells a density goes, to the value an unknown figure has: materials and
the colours that follow from them, flags, the fit report, the scale.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any, Final

from xden1k.format.shapes import ON_PARTNEXT, is_on_partnext
from xden1k.format.shards import Row
from xden1k.values.types import PRIVATE

__all__ = ["ANSWER_COLUMNS", "leaks", "withhold"]

GREY: Final = (0.7, 0.7, 0.7)
"""The colour of a part of which none is known."""
_NAN: Final = float("nan")


def _for_each_part(value: Any) -> Callable[[Mapping[str, Any]], Any]:
    return lambda row: [value] * len(row["part_names"])


def _geometry_alone(row: Mapping[str, Any]) -> str:
    meta = {"views": json.loads(row["meta_json"])["views"]}
    if is_on_partnext(row):
        meta["notes"] = ON_PARTNEXT
    return json.dumps(meta, sort_keys=True, ensure_ascii=False, allow_nan=False)


_UNKNOWN: Final[Mapping[str, Callable[[Mapping[str, Any]], Any]]] = {
    "flags": lambda _: [],
    "weighed_mass_g": lambda _: None,
    "mass_g": lambda _: _NAN,
    "com_cm": lambda _: [_NAN] * 3,
    "inertia_g_cm2": lambda _: [_NAN] * 6,
    "part_materials": _for_each_part(""),
    "part_lac_per_cm": _for_each_part(_NAN),
    "part_apparent_density_g_cm3": _for_each_part(_NAN),
    "part_density_g_cm3": _for_each_part(_NAN),
    "part_density_sd_g_cm3": _for_each_part(_NAN),
    "part_density_source": _for_each_part("withheld"),
    "part_flags": _for_each_part([]),
    "part_color_rgb": _for_each_part(list(GREY)),
    "density": lambda _: None,
    "apparent_density": lambda _: None,
    "meta_json": _geometry_alone,
}
ANSWER_COLUMNS = tuple(_UNKNOWN)
"""Columns that hold an answer or tell one, in the schema's order."""


def withhold(row: Mapping[str, Any]) -> Row:
    """Return a row with every answer unknown, in the split ``private``.

    Parameters
    ----------
    row
        An encoded row, every column.
    """
    return {**row, "split": PRIVATE, **{name: of(row) for name, of in _UNKNOWN.items()}}


def leaks(row: Mapping[str, Any]) -> list[str]:
    """Names of the columns in which an encoded row holds an answer."""
    # repr: not a number is equal to itself here
    return [name for name, of in _UNKNOWN.items() if repr(row[name]) != repr(of(row))]

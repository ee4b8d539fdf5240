"""Reading what a chat model says of objects and materials: captions, semicolon lists, and JSON.

Densities are asked in kg/m³, as the originals do, and become g/cm³ here, once. What is given in
another unit is converted, what makes no sense raises a DataError: then the question is asked again.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Any

from xden1k.errors import DataError
from xden_baselines.chat.candidates import MAX_CANDIDATES, Candidate, Range, check_density
from xden_baselines.chat.wording import answer_lines, bare, said

__all__ = ["paired", "parse_caption", "parse_densities", "parse_json", "parse_thicknesses"]

G_CM3 = {"kg/m3": 1e-3, "g/cm3": 1.0, "g/cc": 1.0}
"""By unit, to g/cm³; the first is meant where none is written."""
CM = {"cm": 1.0, "mm": 0.1, "m": 100.0}
"""By unit, to cm."""

_NUMBER = r"\d+(?:\.\d+)?(?:e[+-]?\d+)?"
_DASH = r"-|\u2212|\u2013|\u2014|~|to"
_ABOUT = r"(?:~|\u2248|about|around|approximately|approx\.?|ca\.?)?\s*"
_UNIT = r"[a-z][^\s\d]*?(?:\^?[3\u00b3])?"
_RANGE = re.compile(
    rf"{_ABOUT}({_NUMBER})\s*(?:({_UNIT})?\s*(?:{_DASH})\s*({_NUMBER}))?\s*([a-z].*)?",
    re.IGNORECASE,
)
_BETWEEN = re.compile(r";|(?<=\))\s*,\s*(?=\()")
"""What divides items: commas too, between brackets."""
_TEMPLATE = re.compile(r"material(\s*\d*)|name|[<\[{.].*", re.IGNORECASE)
"""Names a model leaves in when it repeats the template."""
_IN_BRACKETS = re.compile(r"([^:;]*[^:;\s])\s*:?\s*\(([^a-z()]*\d[^()]*)\)", re.IGNORECASE)
"""An item whose range is in brackets behind its name."""
_REMARK = re.compile(r"[^:;()]*:?|[^:;()\d]*:[^:;()\d]*", re.IGNORECASE)
"""A line that is no item: a lead-in or a remark after the list."""
_REFUSAL = re.compile(
    r"(i['\u2019]m|i am) (sorry|unable|not able)|sorry\b|as an ai\b|unfortunately\b"
    r"|i (can['\u2019]?t|cannot|could not|do not|don['\u2019]?t) |(n/?a|none|unknown|unclear)$"
    r"|(there is )?no (image|picture|object)\b",
    re.IGNORECASE,
)
"""How a model begins that does not answer."""
LONGEST_CAPTION = 400
"""Characters: a sentence of 30 words has some 200."""


def parse_caption(text: str) -> str:
    r"""Read a sentence about an object, without lead-in lines, quotes around it and its full stop.

    Raises
    ------
    DataError
        If there is none, it is too long for one, or the model says that it does not answer.

    Examples
    --------
    >>> parse_caption('Here it is:\n"A red mug with a handle."')
    'A red mug with a handle'
    """
    lines = [line for line in answer_lines(text) if not line.endswith(":")]
    caption = bare(" ".join(lines)).rstrip(".").replace('"', "'")
    if not caption or len(caption) > LONGEST_CAPTION or _REFUSAL.match(caption):
        raise DataError(f"expected a sentence about the object, got {text.strip()[:60]!r}")
    return caption


def parse_densities(text: str) -> dict[str, Range]:
    """Read ``(steel: 7,750-8,050 kg/m^3);(oak: 600-900 kg/m^3)``: g/cm³ by name.

    Raises
    ------
    DataError
        If it is no such list of one to five items of different names, or a density is of no
        matter: the first question is asked again, not the second about it.

    Examples
    --------
    >>> parse_densities("(Steel: 7,750-8,050 kg/m^3);(pine: 500 kg/m^3)")
    {'steel': (7.75, 8.05), 'pine': (0.5, 0.5)}
    """
    found = _parse_list(text, G_CM3)
    for name, density in found.items():
        check_density(name, density)
    return found


def parse_thicknesses(text: str) -> dict[str, Range]:
    """Read ``(steel: 0.1-0.2 cm);(oak: 20-30 mm)``: cm by name.

    Raises
    ------
    DataError
        As of :func:`parse_densities`.

    Examples
    --------
    >>> parse_thicknesses("(steel: 0.1-0.2 cm);(oak: 20-30 mm)")
    {'steel': (0.1, 0.2), 'oak': (2.0, 3.0)}
    """
    return _parse_list(text, CM)


def paired(
    densities: Mapping[str, Range], thicknesses: Mapping[str, Range]
) -> tuple[Candidate, ...]:
    """Put densities and thicknesses of the same name together, in the order of the densities.

    By name, never by place: a model that puts its second list in another order must not swap
    materials.

    Raises
    ------
    DataError
        If the names differ, or a range is out of bounds.
    """
    if densities.keys() != thicknesses.keys():
        raise DataError(
            f"expected thicknesses of {sorted(densities)}, got those of {sorted(thicknesses)}"
        )
    return tuple(Candidate(name, densities[name], thicknesses[name]) for name in densities)


def parse_json(text: str) -> tuple[Candidate, ...]:
    """Read ``{"materials": [{"name", "density_kg_m3": [low, high], "thickness_cm": ...}, ...]}``.

    Text around it and a code fence are passed over; the original's key ``mass density (kg/m^3)``,
    single numbers and ranges as text are taken too.

    Raises
    ------
    DataError
        If there is no such object, with one to five materials of different names.
    """
    densities: dict[str, Range] = {}
    thicknesses: dict[str, Range] = {}
    for item in _materials(text):
        name = _name(item.get("name"), densities)
        density = item.get("density_kg_m3", item.get("mass density (kg/m^3)"))
        densities[name] = _range(density, G_CM3)
        thicknesses[name] = _range(item.get("thickness_cm"), CM)
    return paired(_counted(densities), thicknesses)


def _parse_list(text: str, units: Mapping[str, float]) -> dict[str, Range]:
    items = [
        item.strip()
        for line in answer_lines(text)
        if not _REMARK.fullmatch(line)
        for item in _BETWEEN.split(line.rstrip(".;,"))
    ]
    if not items:
        raise DataError(f"expected '(name: low-high unit)', got {text.strip()[:60]!r}")
    found: dict[str, Range] = {}
    for item in items:
        inner = bare(item)
        if bracketed := _IN_BRACKETS.fullmatch(inner):
            inner = ": ".join(bracketed.groups())
        if inner.count(":") != 1 or inner.startswith("("):
            raise DataError(f"expected '(name: low-high unit)', got {item[:60]!r}")
        name, _, value = inner.partition(":")
        found[_name(name, found)] = _range(value, units)
    return _counted(found)


def _counted(found: dict[str, Range]) -> dict[str, Range]:
    if not 1 <= len(found) <= MAX_CANDIDATES:
        raise DataError(f"expected 1 to {MAX_CANDIDATES} materials, got {len(found)}")
    return found


def _name(name: object, taken: Mapping[str, Range]) -> str:
    """Return a name in lower case, its spaces single; refuse what is none, and a second one."""
    if not isinstance(name, str):
        raise DataError(f"expected the name of a material, got {name!r}")
    plain = " ".join(bare(name).lower().split())
    if not plain or plain[0].isdigit() or _TEMPLATE.fullmatch(plain):
        raise DataError(f"expected the name of a material, got {name!r}")
    if plain in taken:
        raise DataError(f"the material {plain!r} comes twice")
    return plain


def _range(value: object, units: Mapping[str, float]) -> Range:
    """Read a range: text, two numbers, or one."""
    if isinstance(value, str):
        return _range_of_text(value, units)
    numbers: list[Any] = value if isinstance(value, list) else [value]
    if not (1 <= len(numbers) <= 2 and all(_is_number(number) for number in numbers)):
        raise DataError(f"expected a number or a range, got {value!r}")
    factor = next(iter(units.values()))
    return _scaled(numbers[0], numbers[-1], factor)


def _range_of_text(text: str, units: Mapping[str, float]) -> Range:
    found = _RANGE.fullmatch(re.sub(r"(?<=\d),(?=\d{3})", "", text).strip())
    if found is None:
        raise DataError(f"expected a range like 600-900, got {text.strip()[:60]!r}")
    low, first_unit, high, unit = found.groups()
    factor = _factor(unit or first_unit, units)
    if first_unit and _factor(first_unit, units) != factor:
        raise DataError(f"expected one unit for both ends, got {text.strip()[:60]!r}")
    return _scaled(float(low), float(high or low), factor)


def _factor(unit: str | None, units: Mapping[str, float]) -> float:
    plain = re.sub(r"[\s^]", "", (unit or next(iter(units))).lower()).replace("³", "3")
    if plain not in units:
        raise DataError(f"expected a unit of {list(units)}, got {unit!r}")
    return units[plain]


def _scaled(low: float, high: float, factor: float) -> Range:
    # to 12 digits: what was written in decimals stays so
    return float(f"{low * factor:.12g}"), float(f"{high * factor:.12g}")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _materials(text: str) -> list[dict[str, Any]]:
    plain = said(text)
    start = plain.find("{")
    try:
        values, _ = json.JSONDecoder().raw_decode(plain, start if start >= 0 else 0)
    except (ValueError, RecursionError) as err:
        raise DataError(f"expected a JSON object, got {text[:60]!r}") from err
    materials = values.get("materials") if isinstance(values, dict) else None
    if not (isinstance(materials, list) and all(isinstance(each, dict) for each in materials)):
        raise DataError(f"expected a list of objects under 'materials', got {text[:60]!r}")
    return materials

"""A simulated scanner from a TOML file."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

from xden1k.errors import DataError
from xden1k.settings import read_toml
from xden_builder.capture.tables import is_number
from xden_builder.phantoms.scanner.model import Scanner

__all__ = ["load_scanner"]


def load_scanner(path: Path) -> Scanner:
    """Read a scanner from a TOML file.

    Its key ``preset`` is ``realistic`` (the default) or ``monochromatic``; every other key is a
    field of :class:`Scanner` that replaces the preset's.

    Raises
    ------
    DataError
        If the file is not TOML, has an unknown key or a value of a wrong kind, or the scanner is
        impossible.
    """
    values = read_toml(path)
    presets = {"realistic": Scanner.realistic, "monochromatic": Scanner.monochromatic}
    preset = values.pop("preset", "realistic")
    if preset not in presets:
        raise DataError(f"{path}: preset: expected one of {sorted(presets)}, got {preset!r}")
    known = {each.name: each.type for each in fields(Scanner)}
    if unknown := sorted(values.keys() - known.keys()):
        raise DataError(f"{path}: unknown keys {unknown}; known keys are {sorted(known)}")
    for key, value in values.items():
        if not _fits(value, str(known[key])):
            raise DataError(f"{path}: {key}: expected {known[key]}, got {value!r}")
    try:
        return replace(presets[preset](), **values)
    except DataError as err:
        raise DataError(f"{path}: {err}") from err


def _fits(value: object, kind: str) -> bool:
    """Whether a value of TOML is of the kind that a field is annotated with."""
    if kind.startswith("Mapping"):
        return isinstance(value, dict) and all(is_number(each) for each in value.values())
    if kind == "bool":
        return isinstance(value, bool)
    return is_number(value) and (kind.startswith("float") or isinstance(value, int))

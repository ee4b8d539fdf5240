"""A simulated scanner from a TOML file of its effects, and as the file a real one comes with."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

from xden1k.errors import DataError
from xden1k.values.settings import read_toml
from xden_builder.capture import ScannerFile, ViewFile
from xden_builder.capture.tables import is_number
from xden_builder.phantoms.scanner.model import VIEWS, Scanner
from xden_builder.physics.source import Detector

__all__ = ["load_scanner", "panel_name", "scanner_file"]


def load_scanner(path: Path) -> Scanner:
    """Read a scanner from a TOML file.

    Its key ``preset`` is ``realistic`` (the default) or ``monochromatic``; every other key is a
    field of :class:`Scanner` that replaces the preset's. 0 stands for None, which TOML has not:
    ``bits = 0`` is no converter, ``energy_kev = 0`` a tube.

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
    absent = {key: None for key in ("bits", "energy_kev") if values.get(key) == 0}
    try:
        return replace(presets[preset](), **values | absent)
    except DataError as err:
        raise DataError(f"{path}: {err}") from err


def _fits(value: object, kind: str) -> bool:
    """Whether a value of TOML is of the kind that a field is annotated with."""
    if kind.startswith("Mapping"):
        return isinstance(value, dict) and all(is_number(each) for each in value.values())
    if kind == "bool":
        return isinstance(value, bool)
    return is_number(value) and (kind.startswith("float") or isinstance(value, int))


def panel_name(kind: str, view: str, setting: str = "standard") -> str:
    """Name the ``flat`` or ``dark`` of a view, relative to the capture folder.

    Examples
    --------
    >>> panel_name("flat", "pa"), panel_name("dark", "lat", "large")
    ('flat_pa.tif', 'large_dark_lat.tif')
    """
    return f"{'' if setting == 'standard' else setting + '_'}{kind}_{view}.tif"


def scanner_file(scanner: Scanner, setting: str = "standard") -> ScannerFile:
    """Give what ``scanner.toml`` says of a scanner, in one of the settings it can be in."""
    counted = scanner.bits is not None
    return ScannerFile(
        tube=scanner.tube,
        detector=Detector("" if scanner.energy_kev is not None else "CsI", scanner.bits),
        views={
            view: ViewFile(
                image=f"{view}.tif",
                quantity="counts" if counted else "transmission",
                geometry=scanner.geometry(view),
                polarity="linear" if counted else None,
                flat=panel_name("flat", scanner.panel_of(view), setting) if counted else None,
                dark=panel_name("dark", scanner.panel_of(view), setting) if counted else None,
                turned=scanner.is_turned(view),
            )
            for view in VIEWS
        },
    )

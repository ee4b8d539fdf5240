"""The scanner file: tube, detector and the geometry of each view.

``read_scanner`` and ``write_scanner`` are each other's inverse, so that a simulator and the builder
share one definition of the file.
"""

from __future__ import annotations

import datetime
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Final, Literal, cast, get_args

from xden1k.errors import DataError
from xden1k.values.settings import read_toml
from xden1k.values.views import ViewGeometry
from xden_builder.capture.calibrated import (
    ScannerCalibration,
    is_date,
    panel_values,
    read_calibration,
    read_panel,
)
from xden_builder.capture.dicom import spacing_note
from xden_builder.capture.filters import read_filters
from xden_builder.capture.images import Polarity
from xden_builder.capture.tables import TomlTable, is_number, is_positive, is_vector
from xden_builder.physics.attenuation import ENERGY_RANGE_KEV
from xden_builder.physics.source import Detector, Tube

__all__ = [
    "DATASET_VIEWS",
    "SCHEMA",
    "Quantity",
    "ScannerFile",
    "ViewFile",
    "read_scanner",
    "write_scanner",
]

SCHEMA = "xden-scanner/1"
DATASET_VIEWS: Final = ("pa", "lat")
"""Always fitted; the first is the one whose frame is the scanner's."""
Quantity = Literal["counts", "transmission", "attenuation"]
KV_RANGE: Final = (20.0, 500.0)
"""Mammography to the strongest tubes of industry; beyond it the unit is not kV."""

_A_DATE = "a date, such as 2026-03-14"
_POSITIONS = ("pixel00_cm", "column_step_cm", "row_step_cm")
_ABSENT: tuple[object, ...] = (None, "", {})
_EMITTERS = {"cone": "source_cm", "parallel": "direction"}
_CALIBRATION = ("flat", "flat_value", "dark", "dark_value")
_VIEW_KEYS = (
    "image",
    "quantity",
    "polarity",
    *_CALIBRATION,
    "beam",
    *_EMITTERS.values(),
    *_POSITIONS,
    "shape",
    "fit",
    "turned",
)


@dataclass(frozen=True, eq=False)
class ViewFile:
    """How one view is stored and where it was taken from.

    Parameters
    ----------
    image
        File name, relative to the object's folder.
    quantity
        What a pixel holds: ``counts``, ``transmission`` (I / I0) or ``attenuation`` (-ln I / I0).
    geometry
        Where the image was taken from.
    polarity
        Counts only. ``linear``: more photons, larger value; ``inverted``: the contrary; None:
        the DICOM header of the image says it.
    flat
        Counts only: the open field, an image relative to the capture folder or one value.
    dark
        Counts only: without beam, likewise; None where it was not taken.
    fit
        Whether a view other than ``pa`` and ``lat``, which always are, is fitted too.
    turned
        Whether the object was turned by hand before a view that is fitted: ``geometry`` is told
        roughly, and the view's pose is its own.
    """

    image: str
    quantity: Quantity
    geometry: ViewGeometry
    polarity: Polarity | None = None
    flat: str | float | None = None
    dark: str | float | None = None
    fit: bool = False
    turned: bool = False


@dataclass(frozen=True, eq=False)
class ScannerFile:
    """What a ``scanner.toml`` says.

    Parameters
    ----------
    views
        By name, in the order of the file.
    tube
        None where the source is not known: attenuation only, no density.
    detector
        All unknown by default.
    taken
        Day of the captures; None where it is not told.
    calibration
        Where the numbers come from; None where the scanner was not calibrated.
    """

    views: Mapping[str, ViewFile]
    tube: Tube | None = None
    detector: Detector = field(default_factory=Detector)
    taken: datetime.date | None = None
    calibration: ScannerCalibration | None = None

    @property
    def further_names(self) -> tuple[str, ...]:
        """Views that are fitted beside ``pa`` and ``lat``."""
        return tuple(name for name, view in self._others() if view.fit)

    @property
    def audit_names(self) -> tuple[str, ...]:
        """Views that are not fitted."""
        return tuple(name for name, view in self._others() if not view.fit)

    def _others(self) -> list[tuple[str, ViewFile]]:
        return [each for each in self.views.items() if each[0] not in DATASET_VIEWS]


def read_scanner(path: Path, object_folder: Path | None = None) -> ScannerFile:
    """Read a ``scanner.toml``.

    Parameters
    ----------
    path
        The file.
    object_folder
        Where the images are. Only messages use it: what the header of a DICOM image offers where
        the geometry is missing.

    Raises
    ------
    DataError
        If the file is missing or is no TOML, a key is unknown, missing or of a wrong kind, or the
        geometry of a view is impossible; the message names the file and the key.
    """
    if not path.is_file():
        raise DataError(f"{path}: no such file")
    table = TomlTable(path, "", read_toml(path))
    table.refuse_unknown(("schema", "frame", "date", "tube", "detector", "calibration", "views"))
    table.choice("schema", (SCHEMA,))
    table.choice("frame", ("object",))
    views = table.table("views")
    if not views.values:
        raise table.error("views", "is missing, expected a table for each view")
    tube, detector = _read_tube(table.table("tube")), _read_detector(table.table("detector"))
    taken = table.get_or_none("date", is_date, _A_DATE)
    return ScannerFile(
        views={name: _read_view(name, views.table(name), object_folder) for name in views.values},
        tube=tube,
        detector=detector,
        taken=taken,
        calibration=read_calibration(table.table("calibration"), tube, detector, taken),
    )


def _read_tube(table: TomlTable) -> Tube | None:
    table.refuse_unknown(("energy_kev", "kv", "mas", "filtration", "name"))
    if not table.values:
        return None
    if "energy_kev" in table and len(table.values) > 1:
        raise table.error("energy_kev", "is a monochromatic source: no kv, mas, filtration or name")
    if "energy_kev" in table:
        return Tube(energy_kev=_within(table, "energy_kev", ENERGY_RANGE_KEV, "keV"))
    mas = table.get_or_none("mas", is_positive, "a positive number")
    return Tube(
        kv=_within(table, "kv", KV_RANGE, "kV", " (or energy_kev instead)"),
        mas=None if mas is None else float(mas),
        filtration_cm=read_filters(table.table("filtration")),
        name=table.get_or_none("name", _is_text, "a name") or "",
    )


def _within(
    table: TomlTable, key: str, limits: tuple[float, float], unit: str, hint: str = ""
) -> float:
    low, high = limits
    expected = f"a number from {low:g} to {high:g} {unit}{hint}"
    return float(table.get(key, lambda value: is_number(value) and low <= value <= high, expected))


def _read_detector(table: TomlTable) -> Detector:
    return Detector(
        bits=table.get_or_none("bits", _is_bits, "a whole number from 1 to 32"),
        **read_panel(table, ("bits",)),
    )


def _read_view(name: str, table: TomlTable, object_folder: Path | None) -> ViewFile:
    table.refuse_unknown(_VIEW_KEYS)
    image = table.get("image", _is_inner_path, "a path inside the object's folder")
    quantity = cast(Quantity, table.choice("quantity", get_args(Quantity)))
    if quantity != "counts":
        _refuse_calibration(table, quantity)
    geometry = _read_geometry(table, object_folder / image if object_folder else None)
    fit, turned = _read_fit(table, name), _read_turned(table, name)
    if quantity != "counts":
        return ViewFile(image, quantity, geometry, fit=fit, turned=turned)
    flat = _read_calibration(table, "flat")
    if flat is None:
        raise table.error("flat", "is missing, expected flat (an image) or flat_value")
    polarity, dark = _read_polarity(table, image), _read_calibration(table, "dark")
    return ViewFile(image, quantity, geometry, polarity, flat, dark, fit, turned)


def _read_fit(table: TomlTable, name: str) -> bool:
    """Read whether a view is fitted, which ``pa`` and ``lat`` are without a word."""
    always = name in DATASET_VIEWS
    fit = table.get_or_none("fit", _is_bool, "true or false")
    if always and fit is False:
        raise table.error("fit", "must be true, or left out: pa and lat are always fitted")
    return bool(fit) and not always


def _read_turned(table: TomlTable, name: str) -> bool:
    turned = bool(table.get_or_none("turned", _is_bool, "true or false"))
    if turned and name == "pa":
        raise table.error("turned", "must be false, or left out: poses are told in the frame of pa")
    if turned and name not in DATASET_VIEWS and not _read_fit(table, name):
        raise table.error("turned", "goes with a view that is fitted: fit = true")
    return turned


def _refuse_calibration(table: TomlTable, quantity: Quantity) -> None:
    """Refuse what only counts have; a polarity that says nothing new is none of it."""
    for key in _CALIBRATION:
        if key in table:
            raise table.error(key, f"goes with counts only, not with {quantity}")
    if "polarity" in table and table.choice("polarity", get_args(Polarity)) != "linear":
        raise table.error("polarity", f"is linear by definition with {quantity}, or left out")


def _read_polarity(table: TomlTable, image: str) -> Polarity | None:
    """Return the polarity, which only a DICOM image may leave to its own header."""
    if "polarity" not in table and image.lower().endswith(".dcm"):
        return None
    return cast(Polarity, table.choice("polarity", get_args(Polarity)))


def _read_calibration(table: TomlTable, key: str) -> str | float | None:
    """Return the image or the value that ``key`` or ``key_value`` gives."""
    value_key = f"{key}_value"
    if key in table and value_key in table:
        raise table.error(key, f"and {value_key} exclude each other")
    if value_key in table:
        return float(table.get(value_key, is_number, "a number"))
    path = table.get_or_none(key, _is_inner_path, "a path inside the capture folder")
    return None if path is None else str(path)


def _read_geometry(table: TomlTable, image: Path | None) -> ViewGeometry:
    beam = table.choice("beam", tuple(_EMITTERS))
    emitter = _EMITTERS[beam]
    for other in _EMITTERS.values():
        if other != emitter and other in table:
            raise table.error(other, f"does not go with a {beam} beam, which needs {emitter}")
    values: dict[str, Any] = {"beam": beam}
    for key in (emitter, *_POSITIONS):
        if key not in table and image is not None and image.suffix.lower() == ".dcm":
            raise table.error(key, f"is missing; {spacing_note(image)}")
        values[key] = table.get(key, is_vector, "three finite numbers")
    values["shape"] = table.get("shape", _is_shape, "rows and columns, whole numbers from 1")
    try:
        return ViewGeometry.from_dict(values)
    except DataError as err:
        raise DataError(f"{table.file}: {table.prefix.rstrip('.')}: {err}") from err


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_bool(value: object) -> bool:
    return isinstance(value, bool)


def _is_bits(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= 32


def _is_shape(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(_is_size(size) for size in value)


def _is_size(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 1


def _is_inner_path(value: object) -> bool:
    """Whether a relative path stays inside its folder: a capture is self-contained."""
    if not isinstance(value, str) or not value or "\\" in value:
        return False
    path = PurePosixPath(value)
    return not path.is_absolute() and ".." not in path.parts


def write_scanner(scanner: ScannerFile, path: Path) -> None:
    """Write a ``scanner.toml`` that :func:`read_scanner` reads back unchanged."""
    blocks = [_block("", {"schema": SCHEMA, "frame": "object", "date": scanner.taken})]
    if scanner.tube is not None:
        blocks.append(_block("tube", _tube_values(scanner.tube)))
    blocks.append(_block("detector", vars(scanner.detector)))
    if scanner.calibration is not None:
        blocks.append(_block("calibration", _calibration_values(scanner.calibration)))
    blocks += [_block(f"views.{_key(name)}", _view_values(v)) for name, v in scanner.views.items()]
    path.write_text("\n".join(blocks), encoding="utf-8")


def _tube_values(tube: Tube) -> dict[str, Any]:
    named = {"name": tube.name, "energy_kev": tube.energy_kev, "kv": tube.kv, "mas": tube.mas}
    return {**named, "filtration": dict(tube.filtration_cm)}


def _calibration_values(calibration: ScannerCalibration) -> dict[str, Any]:
    tube = calibration.tube or Tube()
    return {
        "date": calibration.date,
        "valid_until": calibration.valid_until,
        "tube": tube.name,
        "kv": tube.kv,
        "filtration": dict(tube.filtration_cm),
        "panel": {} if calibration.detector is None else panel_values(calibration.detector),
        "made_from": list(calibration.made_from),
        "found": dict(calibration.found),
    }


def _view_values(view: ViewFile) -> dict[str, Any]:
    calibration = {
        key if isinstance(value, str) else f"{key}_value": value
        for key, value in (("flat", view.flat), ("dark", view.dark))
    }
    return {
        "image": view.image,
        "quantity": view.quantity,
        "polarity": view.polarity,
        **calibration,
        **view.geometry.to_dict(),
        "fit": view.fit or None,
        "turned": view.turned or None,
    }


def _block(name: str, values: Mapping[str, Any]) -> str:
    """One TOML table; what is None or empty is left out."""
    lines = [f"[{name}]"] if name else []
    lines += [f"{key} = {_toml(value)}" for key, value in values.items() if value not in _ABSENT]
    return "\n".join(lines) + "\n"


def _toml(value: object) -> str:
    """One TOML value: text, a number, a day, a list or an inline table."""
    if isinstance(value, Mapping):
        return (
            "{ " + ", ".join(f"{_key(key)} = {_toml(item)}" for key, item in value.items()) + " }"
        )
    if isinstance(value, datetime.date):
        return value.isoformat()
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    # JSON's text and numbers are TOML's, but for DEL, which TOML wants escaped
    return json.dumps(value, ensure_ascii=False, allow_nan=False).replace("\x7f", "\\u007f")


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _toml(name)

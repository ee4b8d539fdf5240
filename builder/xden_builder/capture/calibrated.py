"""What ``scanner.toml`` says of its calibration, and whether that holds for these captures."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from xden_builder.capture.filters import read_filters
from xden_builder.capture.tables import TomlTable, is_number, is_positive
from xden_builder.physics.source import Detector, Tube
from xden_builder.physics.spectrum.panels import PANELS

__all__ = ["ScannerCalibration", "is_date", "panel_values", "read_calibration", "read_panel"]

_PANEL: Final = ("scintillator", "layer_g_cm2", "escape", "threshold_kev")


@dataclass(frozen=True, eq=False)
class ScannerCalibration:
    """Where the numbers of a ``scanner.toml`` come from.

    Parameters
    ----------
    date
        Of the scans of phantoms.
    valid_until
        Last day it holds for; None where no day is set.
    tube
        For which it holds: name, voltage and filters; None where only the geometry was found.
    detector
        For which it holds, but for its bits; None where only the geometry was found, or the file is
        of a version that took the panel for given.
    made_from
        The images.
    found
        Further numbers, for people.
    """

    date: datetime.date
    valid_until: datetime.date | None
    tube: Tube | None
    detector: Detector | None
    made_from: tuple[str, ...]
    found: Mapping[str, Any]


def read_calibration(
    table: TomlTable, tube: Tube | None, detector: Detector, taken: datetime.date | None
) -> ScannerCalibration | None:
    """Read ``[calibration]``; None where the file has none.

    Parameters
    ----------
    table
        That table.
    tube, detector
        Of the same file.
    taken
        When the captures were taken, as far as the file tells.

    Raises
    ------
    DataError
        If it is of another tube, voltage, filter or panel, or of another time.
    """
    if not table.values:
        return None
    table.refuse_unknown(
        ("date", "valid_until", "tube", "kv", "filtration", "panel", "made_from", "found")
    )
    calibration = ScannerCalibration(
        date=table.get("date", is_date, "a date, such as 2026-03-14"),
        valid_until=table.get_or_none("valid_until", is_date, "a date, such as 2027-03-14"),
        tube=_read_tube(table),
        detector=Detector(**read_panel(table.table("panel"))) if "panel" in table else None,
        made_from=tuple(table.get_or_none("made_from", _is_names, "a list of names") or ()),
        found=table.table("found").values,
    )
    _refuse_other_tube(table, calibration.tube, tube)
    if calibration.detector not in (None, replace(detector, bits=None)):
        raise table.error("panel", "differs from detector: calibrate anew")
    _refuse_other_time(table, calibration, taken)
    return calibration


def _read_tube(table: TomlTable) -> Tube | None:
    name = table.get_or_none("tube", lambda value: isinstance(value, str), "a name") or ""
    if "kv" not in table:
        return Tube(name=name) if name else None
    kv = float(table.get("kv", is_positive, "a positive number of kV"))
    return Tube(kv=kv, filtration_cm=read_filters(table.table("filtration")), name=name)


def read_panel(table: TomlTable, others: tuple[str, ...] = ()) -> dict[str, Any]:
    """Read what stops the photons, and what of them counts.

    Parameters
    ----------
    table
        ``[detector]``, or what a calibration tells of it.
    others
        Further keys that it may have.

    Raises
    ------
    DataError
        If a key is not known, or a value is none.
    """
    table.refuse_unknown((*_PANEL, *others))
    name = table.get_or_none("scintillator", _is_text, "a name") or ""
    counting = name in PANELS and PANELS[name].counting
    if counting and "escape" in table:
        raise table.error("escape", "goes with scintillators, not with counting sensors")
    if not counting and "threshold_kev" in table:
        raise table.error("threshold_kev", "goes with counting sensors only")
    return {
        "scintillator": name,
        "layer_g_cm2": table.get_or_none("layer_g_cm2", is_positive, "a positive number"),
        "escape": table.get_or_none("escape", _is_share, "a number from 0 to 1"),
        "threshold_kev": table.get_or_none("threshold_kev", is_positive, "a positive number"),
    }


def panel_values(detector: Detector) -> dict[str, Any]:
    """Give what :func:`read_panel` reads, as far as it is known."""
    values = {key: getattr(detector, key) for key in _PANEL}
    return {key: value for key, value in values.items() if value not in (None, "")}


def _refuse_other_tube(table: TomlTable, calibrated: Tube | None, tube: Tube | None) -> None:
    if calibrated is None or tube is None:
        return
    if calibrated.name and tube.name and calibrated.name != tube.name:
        raise table.error("tube", f"is {calibrated.name!r}, but tube.name is {tube.name!r}")
    if calibrated.kv is None:
        return
    if calibrated.kv != tube.kv:
        raise table.error("kv", f"is {calibrated.kv:g}, but tube.kv is {tube.kv}: calibrate anew")
    if calibrated.filtration_cm != tube.filtration_cm:
        raise table.error("filtration", "differs from tube.filtration: calibrate anew")


def _refuse_other_time(
    table: TomlTable, calibration: ScannerCalibration, taken: datetime.date | None
) -> None:
    if taken is None:
        return
    last = calibration.valid_until
    if taken < calibration.date:
        raise table.error("date", f"is {calibration.date}, after that of the captures, {taken}")
    if last is not None and taken > last:
        raise table.error("valid_until", f"is {last}, before the date of the captures, {taken}")


def is_date(value: object) -> bool:
    """Whether a TOML value is a day without a time."""
    return isinstance(value, datetime.date) and not isinstance(value, datetime.datetime)


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_share(value: Any) -> bool:
    return is_number(value) and 0 <= value <= 1


def _is_names(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(each, str) for each in value)

"""What a whole capture folder is told once."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from xden1k.errors import DataError
from xden_builder.physics.spectrum.spectrum import filter_depth
from xden_builder.pipeline.storage import Place, inside, read_bytes

__all__ = ["calibration_remark", "filtration_remark", "is_calibrated"]

SCANNER: Final = "scanner.toml"
FILTER_KEV: Final = 60.0
LEAST_LIGHT: Final = 0.35
MEASURED_WITHIN: Final = 0.1
"""Of the light behind each probe of a calibration, in shares of it: 0.1 mm of copper more or less
changes it by a quarter."""
MOST_KV: Final = 160.0
"""Of photons of this energy at least so many pass the filters of a tube of at most so many
kilovolts: 0.3 mm of copper let 65 % through, 1 mm 24 %, 2.5 mm of aluminium 83 %, 2.5 cm 15 %."""


def is_calibrated(captures: Place) -> bool:
    """Whether the beam of the common scanner was measured, so well that no filter can be missing.

    A calibration by balls alone measures none, and one by few steps hardly.
    """
    return _left_open(_scanner(captures) or {}) is None


def calibration_remark(captures: Place) -> str:
    """Say what of the common scanner was not calibrated; empty where all was.

    Empty too where there is no common file, or none that can be read: its objects say that.
    """
    values = _scanner(captures)
    if not values or (said := _left_open(values)) is None:
        return ""
    return f"{inside(captures, SCANNER)}: {said}; see `xden-build calibrate`"


def _left_open(values: Mapping[str, Any]) -> str | None:
    """Say what a scanner file leaves open of its beam; None where that was measured."""
    calibration = _calibration(values)
    if calibration is None:
        return "the scanner was not calibrated: tube and geometry are as told"
    if "kv" not in calibration:
        tube = values.get("tube")
        if not isinstance(tube, dict) or "kv" not in tube:
            return None  # wedges calibrate a tube's spectrum, and none is told
        return "the tube was not calibrated, by wedges: kv and filtration are as told"
    try:
        spreads = dict(calibration["found"]["transmission_sd"])
        probe, spread = max(spreads.items(), key=lambda item: float(item[1]))
        if float(spread) <= MEASURED_WITHIN:
            return None
    except (KeyError, TypeError, ValueError):
        return None  # it was not written by us, and is believed
    return (
        f"the calibration leaves the tube open: light through {probe} is known to {spread:.1%}, "
        f"expected {MEASURED_WITHIN:.0%} or better"
    )


def filtration_remark(captures: Place) -> str:
    """Say that the common scanner's filters let next to nothing through; empty where they do.

    They are told in centimetres, and elsewhere mostly in millimetres.
    """
    values = _scanner(captures) or {}
    if "kv" in (_calibration(values) or {}):
        return ""  # it was measured
    try:
        kv, told = float(values["tube"]["kv"]), values["tube"]["filtration"]
        filters = {name: float(cm) for name, cm in told.items()}
        depth = float(filter_depth(filters, np.array([FILTER_KEV]))[0])
    except (DataError, ValueError, KeyError, TypeError, AttributeError):
        return ""  # there are none, or each object says what is wrong
    if kv > MOST_KV or not -math.log(LEAST_LIGHT) < depth < math.inf:
        return ""
    through = math.exp(-depth)
    words = ", ".join(f"{10 * cm:g} mm {name}" for name, cm in filters.items())
    return (
        f"{inside(captures, SCANNER)}: tube.filtration is in cm, and told as {words}, which lets "
        f"{through:.1%} of {FILTER_KEV:g} keV through: is that what stood there?"
    )


def _calibration(values: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Return the calibration's table; None where there is none."""
    found = values.get("calibration")
    return found if isinstance(found, dict) else None


def _scanner(captures: Place) -> dict[str, Any] | None:
    """Read the common file; None where there is none, or none that can be read."""
    content = read_bytes(inside(captures, SCANNER))
    try:
        return None if content is None else tomllib.loads(content.decode())
    except ValueError:
        return None

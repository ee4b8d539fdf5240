"""What a whole capture folder is told once."""

from __future__ import annotations

import tomllib
from typing import Any

from xden_builder.pipeline.storage import Place, inside, read_bytes

__all__ = ["calibration_remark", "is_calibrated"]


def is_calibrated(captures: Place) -> bool:
    """Whether the common scanner was calibrated."""
    return "calibration" in (_scanner(captures) or {})


def calibration_remark(captures: Place) -> str:
    """Say that the common scanner was not calibrated; empty where it was.

    Empty too where there is no common file, or none that can be read: its objects say that.
    """
    values = _scanner(captures)
    if not values or "calibration" in values:
        return ""
    return (
        f"{inside(captures, 'scanner.toml')}: the scanner was not calibrated: tube and geometry "
        "are as told; see `xden-build calibrate`"
    )


def _scanner(captures: Place) -> dict[str, Any] | None:
    """Read the common file; None where there is none, or none that can be read."""
    content = read_bytes(inside(captures, "scanner.toml"))
    try:
        return None if content is None else tomllib.loads(content.decode())
    except ValueError:
        return None

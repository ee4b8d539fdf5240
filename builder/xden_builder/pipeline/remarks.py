"""What a whole capture folder is told once."""

from __future__ import annotations

import tomllib

from xden_builder.pipeline.storage import Place, inside, read_bytes

__all__ = ["calibration_remark"]


def calibration_remark(captures: Place) -> str:
    """Say that the common scanner was not calibrated; empty where it was.

    Empty too where there is no common file, or none that can be read: its objects say that.
    """
    content = read_bytes(inside(captures, "scanner.toml"))
    try:
        values = {} if content is None else tomllib.loads(content.decode())
    except ValueError:
        return ""
    if not values or "calibration" in values:
        return ""
    return (
        f"{inside(captures, 'scanner.toml')}: the scanner was not calibrated: tube and geometry "
        "are as told; see `xden-build calibrate`"
    )

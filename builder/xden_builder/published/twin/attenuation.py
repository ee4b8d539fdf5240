"""Attenuation coefficients as the paper's own fit finds them, from simulated radiographs."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from xden_builder.capture import CaptureFolder
from xden_builder.capture.space import divide
from xden_builder.phantoms.phantom import Plan
from xden_builder.phantoms.realism import LIFELIKE
from xden_builder.phantoms.scanner import Scanner
from xden_builder.phantoms.writer import write_planned
from xden_builder.reconstruct.explained import explain
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.registration.capture import Registered

__all__ = ["fitted_lac_per_cm"]

PIXELS: Final = 256
"""Along each side of a radiograph."""


def fitted_lac_per_cm(plan: Plan) -> dict[str, float]:
    """Simulate an object's radiographs and fit them as the paper does.

    The scanner is the realistic one: a tube's spectrum with beam hardening, scattered light and
    noise, seen through meshes that lie a little off. A part that no ray met has no attenuation, 0.

    Returns
    -------
    dict
        By the name of the part, 1/cm.
    """
    scanner = replace(Scanner.realistic(), size_px=PIXELS)
    with tempfile.TemporaryDirectory(prefix="xden-twin-") as folder:
        captures = Path(folder) / "captures"
        write_planned(captures, [plan], scanner, LIFELIKE)
        capture = CaptureFolder(captures).read(plan.object_id)
    fit = explain(Registered(capture), divide(capture.parts), BuildSettings(model="paper")).fit
    names = [part.name for part in capture.parts]
    return dict(zip(names, np.nan_to_num(fit.lac_per_cm).tolist(), strict=True))

"""Residuals of a calibration, to be looked at."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from xden1k.errors import require
from xden_builder.calibrate.geometry import GeometryFit, ViewFit
from xden_builder.calibrate.readings import ImageReadings
from xden_builder.calibrate.spectrum import SpectrumFit

__all__ = ["draw_balls", "draw_steps"]

INCHES: Final = (6.0, 4.0)
DPI: Final = 120
LONGEST_ARROW: Final = 0.05
"""Of the image's height."""


def draw_steps(images: Sequence[ImageReadings], fit: SpectrumFit, path: Path) -> None:
    """Draw what is read behind each step over what the fit expects, against the thickness.

    Bars are two of the standard deviations that readings are trusted to.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    figure, axes = _figure(len(images))
    fitted = zip(fit.expected, fit.expected_sd, strict=True)
    for axis, image, (expected, sd) in zip(axes, images, fitted, strict=True):
        names = _apart([wedge.material.name for wedge in image.wedges])
        for place, name in enumerate(names):
            mine = [at for at, each in enumerate(image.readings) if each.wedge == place]
            read = np.array([image.readings[at].transmission for at in mine])
            paths = [10 * image.readings[at].path_cm for at in mine]
            percent = 100 * (read / expected[mine] - 1)
            bars = 200 * sd[mine] / expected[mine]
            line = "o-" if max(paths) > 1.01 * min(paths) else "o"  # a staircase, or stops
            axis.errorbar(paths, percent, bars, fmt=line, ms=3, lw=1, elinewidth=0.6, label=name)
        axis.axhline(0.0, color="0.7", lw=0.8)
        axis.set(xlabel="thickness, mm", ylabel="read over expected, %", title=image.name)
        axis.set_xscale("log")
        axis.xaxis.set_major_formatter("{x:g}")
        axis.legend(fontsize="small", loc="upper left")
    figure.savefig(path, dpi=DPI)


def _apart(names: Sequence[str]) -> list[str]:
    """Tell names apart that are there more than once."""
    return [
        f"{name} {names[: place + 1].count(name)}" if names.count(name) > 1 else name
        for place, name in enumerate(names)
    ]


def draw_balls(fit: GeometryFit, path: Path) -> None:
    """Draw by how much each shadow lies off, as many times as long as can be seen.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    figure, axes = _figure(len(fit.views))
    for axis, (name, view) in zip(axes, fit.views.items(), strict=True):
        _draw_view(axis, name, view)
    figure.savefig(path, dpi=DPI)


def _draw_view(axis: Any, name: str, view: ViewFit) -> None:
    off = view.seen - view.expected
    longest = max(float(np.linalg.norm(off, axis=1).max()), 1e-9)
    times = LONGEST_ARROW * view.geometry.shape[0] / longest
    axis.plot(*view.seen.T, "o", ms=3, color="0.6")
    axis.quiver(*view.seen.T, *(times * off).T, angles="xy", scale_units="xy", scale=1, width=0.004)
    rows, columns = view.geometry.shape
    axis.set(xlim=(0, columns), ylim=(rows, 0), xlabel="column", ylabel="row", aspect="equal")
    axis.set_title(f"{name}: {view.rms_px:.4f} px rms; the longest arrow is {longest:.3f} px")


def _figure(count: int) -> tuple[Any, Sequence[Any]]:
    """Return a figure and its axes, one below the other; its canvas is its own."""
    figures = require("matplotlib.figure", "view")
    figure = figures.Figure(figsize=(INCHES[0], INCHES[1] * count), layout="constrained")
    return figure, figure.subplots(count, 1, squeeze=False)[:, 0].tolist()

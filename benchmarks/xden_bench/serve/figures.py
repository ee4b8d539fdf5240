"""Pictures of the web app as SVG: radiographs, slices, colour bars, intervals. Extra ``view``.

Colour scales are perceptually uniform and safe for the colour-blind: ``viridis`` for densities
and their deviations, ``cividis`` for the size of an error, ``RdBu`` for signed differences.
Figures have no ground, and their text is text in the colour of the page's own, so that they read
on a light page and on a dark one, whichever it becomes.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from html import escape
from threading import Lock
from typing import Any, Final

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps, rc_context
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from xden1k.pictures import looks
from xden1k.pictures.radiographs import MADE_WORDS, Comparison
from xden1k.values.arrays import Vec3
from xden_bench.serve.board import ORACLE

__all__ = [
    "AXES",
    "Picture",
    "bar_picture",
    "density_scale",
    "error_scale",
    "interval_picture",
    "radiograph_pictures",
    "signed_scale",
    "slice_picture",
]

Picture = str
"""An SVG element, with a text for those who do not see it."""
Entry = Mapping[str, Any]

AXES: Final = ("x", "y", "z")
INK, FAINT, NO_VALUE = "#010203", "#8a8a8a", "#bdbdbd"
"""Text, which becomes the page's colour; lines; and pixels without a value."""
RANKED: Final = "#1a7fae"
NOTHING: Final = "none"
_DRAWING = Lock()  # matplotlib's settings are one for all threads
DPI: Final = 150


def density_scale(highest: float) -> ScalarMappable:
    """Colours from 0 to a density or deviation, g/cm³."""
    return _scale("viridis", 0.0, max(highest, 1e-3))


def error_scale(highest: float) -> ScalarMappable:
    """Colours from 0 to the size of an error, g/cm³."""
    return _scale("cividis", 0.0, max(highest, 1e-3))


def signed_scale(limit: float) -> ScalarMappable:
    """Colours from red, ``-limit``, to blue, ``limit``; white is no difference."""
    limit = max(limit, 1e-3)
    return _scale("RdBu", -limit, limit)


def radiograph_pictures(
    found: Comparison, source: str, view: str
) -> tuple[Picture, Picture, Picture]:
    """Draw a view as it is, as reprojected, and the difference.

    The first two as attenuation -ln T, in which light and heavy matter both show.

    Parameters
    ----------
    found
        The images.
    source
        ``scan``, ``phantom``, ``ct`` or ``published``: how the radiograph came to be.
    view
        Its name, for the titles.
    """
    made = MADE_WORDS[source]
    measured, model = looks.attenuation(found.measured), looks.attenuation(found.model)
    grey = looks.grey_scale(measured, model)
    aspect, times = looks.readable_aspect(measured.shape, found.aspect)
    bar = "attenuation -ln (I / I₀)" + (f"; rows {times:.3g} times as high" if times != 1 else "")
    return (
        _radiograph(measured, aspect, grey, f"{view} {made}", bar),
        _radiograph(model, aspect, grey, f"{view} reprojected parts", bar),
        _radiograph(
            found.residual,
            aspect,
            signed_scale(found.limit),
            f"{view} residual, mean |r| = {found.mean_abs_residual:.2g}",
            f"{made} - reprojected, I / I₀",
        ),
    )


def slice_picture(
    plane: Float[np.ndarray, "across up"],
    axis: int,
    origin_cm: Vec3,
    voxel_size_cm: float,
    limits_cm: Float[np.ndarray, "3 2"],
    scale: ScalarMappable,
    title: str,
    label: str,
) -> Picture:
    """Draw one plane of a field, cut to a square around the object.

    Parameters
    ----------
    plane
        The other two axes in their order; masked or nan is left blank.
    axis
        That the plane is perpendicular to: 0, 1 or 2.
    origin_cm
        Shape (3,): centre of voxel (0, 0, 0).
    voxel_size_cm
        Edge of a voxel.
    limits_cm
        Lowest and highest coordinate of the object on each axis.
    scale
        Colours; the same for what is compared.
    title, label
        Of the picture, and of the colour bar with its unit.
    """
    across, up = (other for other in range(3) if other != axis)
    low = origin_cm - voxel_size_cm / 2
    width, height = voxel_size_cm * np.array(plane.shape)
    extent = (low[across], low[across] + width, low[up], low[up] + height)
    figure, axes = _sheet(4.0, 4.1)
    _show(axes, plane.T, scale, NOTHING, origin="lower", extent=extent)
    half = 0.56 * float(np.ptp(limits_cm[[across, up]], axis=1).max())
    middle = limits_cm.mean(axis=1)
    axes.set_xlim(middle[across] - half, middle[across] + half)
    axes.set_ylim(middle[up] - half, middle[up] + half)
    axes.set_xlabel(f"{AXES[across]}, cm", fontsize=10, color=INK)
    axes.set_ylabel(f"{AXES[up]}, cm", fontsize=10, color=INK)
    axes.set_title(title, fontsize=11, color=INK, loc="left")
    _bar(figure, axes, scale, label)
    return _picture(figure, f"Slice perpendicular to {AXES[axis]}: {title}, {label}")


def bar_picture(scale: ScalarMappable, label: str) -> Picture:
    """Draw a colour bar alone, for the 3D view."""
    figure, axes = _sheet(6.0, 0.65)
    bar = figure.colorbar(scale, cax=axes, orientation="horizontal")
    bar.outline.set_linewidth(0.4)
    axes.tick_params(labelsize=9, length=2, width=0.4, colors=INK)
    axes.set_xlabel(label, fontsize=10, color=INK, labelpad=2)
    return _picture(figure, f"Colour scale: {label}")


def interval_picture(
    rows: Sequence[Entry], metric: str, heading: str, apart: Sequence[str]
) -> Picture:
    """Draw mean and 95 % interval, if any, of each row, best on top, then those apart in grey.

    Parameters
    ----------
    rows
        In the order of the table, best first.
    metric, heading
        Which, and its title with the unit.
    apart
        Why a row stands apart; empty where it does not. An oracle is a dashed line through all.
    """
    figure, axes = _sheet(4.6, 0.7 + 0.26 * len(rows))
    pairs = sorted(zip(rows, apart, strict=True), key=lambda pair: bool(pair[1]))
    for place, (row, reason) in enumerate(pairs):
        if metric in row["metrics"]:
            _interval(axes, place, row["metrics"][metric], reason)
    names = [_short(row["method"]["name"]) for row, _ in pairs]
    axes.set_yticks(range(len(rows)), names, fontsize=10, parse_math=False, color=INK)
    axes.set(ylim=(len(rows) - 0.4, -0.6), xlim=(0, None))
    axes.set_xlabel(heading, fontsize=10, color=INK)
    axes.grid(axis="x", color=FAINT, alpha=0.35, linewidth=0.6)
    axes.tick_params(length=0, labelcolor=INK)
    axes.spines[:].set_visible(False)
    return _picture(figure, f"{heading} of {len(rows)} methods, as in the table below")


def _interval(axes: Any, place: int, found: Mapping[str, Any], reason: str) -> None:
    """Draw one row of the chart."""
    colour = FAINT if reason else RANKED
    if reason.startswith(ORACLE):
        axes.axvline(found["mean"], color=FAINT, linewidth=1.2, linestyle=(0, (4, 3)))
    if found.get("ci95"):
        axes.plot(found["ci95"], [place, place], color=colour, linewidth=2.2)
    face = NOTHING if reason else colour
    axes.plot(found["mean"], place, "o", color=colour, markerfacecolor=face, markersize=6.5)


def _short(name: str) -> str:
    """Give a stranger's name a width, and nothing that a font lacks."""
    plain = "".join(one if one.isprintable() and ord(one) < 0x250 else "?" for one in name)
    return plain if len(plain) <= 28 else f"{plain[:27]}…"


def _scale(name: str, low: float, high: float) -> ScalarMappable:
    return ScalarMappable(Normalize(low, high), colormaps[name].with_extremes(bad=NO_VALUE))


def _radiograph(
    image: Float[np.ndarray, "rows columns"],
    aspect: float,
    scale: ScalarMappable,
    title: str,
    label: str,
) -> Picture:
    figure, axes = _sheet(4.0, 4.1)
    _show(axes, image, scale, looks.NO_VALUE, aspect=aspect)
    axes.set(xticks=[], yticks=[])
    note = "; orange: no value" if np.isnan(image).any() else ""
    axes.set_title(title, fontsize=11, color=INK, loc="left")
    _bar(figure, axes, scale, label + note)
    return _picture(figure, f"{title}, {label}{note}")


def _sheet(width: float, height: float) -> tuple[Figure, Any]:
    """Return a figure without a ground and its axes; inches."""
    figure = Figure(figsize=(width, height), facecolor=NOTHING, layout="constrained", dpi=DPI)
    return figure, figure.add_subplot(facecolor=NOTHING)


def _show(axes: Any, image: np.ndarray, scale: ScalarMappable, nothing: str, **how: Any) -> None:
    cmap = scale.get_cmap().with_extremes(bad=nothing)
    axes.imshow(image, cmap=cmap, norm=scale.norm, interpolation="antialiased", **how)
    axes.tick_params(labelsize=9, length=2, width=0.4, colors=INK)
    axes.spines[:].set(linewidth=0.5, color=FAINT)


def _bar(figure: Figure, axes: Any, scale: ScalarMappable, label: str) -> None:
    bar = figure.colorbar(scale, ax=axes, orientation="horizontal", pad=0.02, aspect=32, shrink=0.9)
    bar.locator = MaxNLocator(4)
    bar.update_ticks()
    bar.outline.set_linewidth(0.4)
    bar.ax.tick_params(labelsize=9, length=2, width=0.4, colors=INK)
    bar.set_label(label, fontsize=10, color=INK)


def _picture(figure: Figure, words: str) -> Picture:
    """Return a figure as an element of a page.

    Parameters
    ----------
    figure
        Drawn.
    words
        What it shows.
    """
    stream = io.StringIO()
    with _DRAWING, rc_context({"svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    svg = stream.getvalue()
    svg = svg[svg.index("<svg") :].replace(INK, "currentColor")
    svg = re.sub(r"<style.*?</style>|<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(words)}"', 1)

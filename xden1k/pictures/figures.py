"""Pictures of objects: one on a page, many on a sheet. Needs the extra ``view``.

Figures are drawn on their own canvas; matplotlib's global state is left alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from xden1k.errors import DataError
from xden1k.pictures.looks import NO_VALUE, attenuation, grey_scale, readable_aspect, reduced
from xden1k.pictures.page import (
    FAINT,
    INK,
    RULE,
    SOURCE_WORDS,
    Page,
    cut_short,
    draw_image,
)
from xden1k.pictures.radiographs import MADE_WORDS, compare
from xden1k.values.arrays import Image
from xden1k.values.physics import PAPER_MAC_CM2_G
from xden1k.values.types import AXES, DensityField, DensityObject, Part
from xden1k.values.views import XRayView
from xden1k.values.windows import object_window

__all__ = ["contact_sheet", "object_sheet"]

STRIPE = "#f4f4f1"
DENSITY_COLOURS, LAC_COLOURS = "magma_r", "viridis_r"
CROSS = {DENSITY_COLOURS: "#1f9e89", LAC_COLOURS: "#e4572e"}
"""Colour of the centre of mass, by the colours it lies on."""
RADIOGRAPHS_HEIGHT = 3.6
"""Of the part of a page that radiographs take, inches."""
LINE = 0.2
"""Height of a line of the part table, inches."""
TABLE_ROWS = 12
TABLE_COLUMNS = (
    *((0.24, "left", 24), (2.05, "left", 20), (4.15, "right", 10)),
    *((5.45, "right", 16), (5.62, "left", 9), (6.3, "left", 23)),
)
"""Of the part table: position in inches, alignment, characters that fit."""
CELL_GAP = 0.06
"""Between the pictures of an object on a contact sheet, inches."""


class _Cell(NamedTuple):
    """An object on a contact sheet."""

    name: str
    note: str
    plane: str
    views: tuple[Image, ...]
    cut: Float[np.ndarray, "down across"]
    colours: str
    aspects: tuple[float, ...]


def object_sheet(obj: DensityObject, path: Path) -> None:
    """Draw one object: radiographs against their reprojection, if any, density slices, parts.

    Parameters
    ----------
    obj
        What to draw.
    path
        The PNG to write.

    Raises
    ------
    DataError
        If the answers of the object are withheld.
    MissingExtraError
        If the projector's libraries (extra ``build``) are not installed.
    """
    above = RADIOGRAPHS_HEIGHT if obj.views else 0.0
    page = Page(16.7, 4.25 + above)
    _title(page, obj)
    for left, view in zip((0.35, 8.65), obj.views, strict=False):
        _radiographs(page, left, obj, view)
    _slices(page, 1.6 + above, obj)
    _part_table(page, 1.33 + above, obj.parts)
    page.save(path)


def _title(page: Page, obj: DensityObject) -> None:
    page.text(0.35, 0.28, obj.object_id, fontsize=20, weight="bold")
    centre = ", ".join(_centimetres(value) for value in obj.com_cm)
    words = [
        obj.category,
        f"{obj.mass_g:.4g} g" if np.isfinite(obj.mass_g) else "mass unknown",
        *([] if obj.weighed_mass_g is None else [f"weighed {obj.weighed_mass_g:.4g} g"]),
        *([f"centre of mass ({centre}) cm"] if np.isfinite(obj.com_cm).all() else []),
        SOURCE_WORDS[obj.source],
        f"{obj.split} split",
        *obj.flags,
    ]
    page.text(0.35, 0.68, cut_short("   ·   ".join(words), 180), fontsize=11, color=FAINT)


def _centimetres(value: float) -> str:
    return f"{round(float(value), 2) + 0.0:.2f}"  # no minus zero


def _radiographs(page: Page, left: float, obj: DensityObject, view: XRayView) -> None:
    """Draw a view as it is, as reprojected, and the difference, all cut to the object."""
    top, size, gap, made = 1.45, 2.5, 0.1, MADE_WORDS[obj.source]
    found = compare(obj, view)
    limit, residual = found.limit, found.residual
    measured, model = attenuation(found.measured), attenuation(found.model)
    grey = grey_scale(measured, model)
    split = _scale("RdBu", Normalize(-limit, limit))
    aspect, times = readable_aspect(residual.shape, found.aspect)
    columns = (
        (made, measured, grey),
        ("reprojected", model, grey),
        (f"residual, mean |r| = {found.mean_abs_residual:.2g}", residual, split),
    )
    for column, (label, image, scale) in enumerate(columns):
        start = left + column * (size + gap)
        page.text(start, top - 0.24, f"{view.name.upper()} {label}", fontsize=10)
        draw_image(page.axes(start, top, size, size), image, scale, aspect=aspect)
    note = "; orange: no value" if np.isnan(residual).any() else ""
    if times != 1:
        note += f"; rows drawn {times:.3g} times as high"
    bar, inset = top + size + 0.1, 0.25
    wide = (left + inset, bar, 2 * size + gap - 2 * inset, 0.09)
    page.colour_bar(wide, grey, f"attenuation -ln (I / I₀){note}")
    narrow = (left + 2 * (size + gap) + inset, bar, size - 2 * inset, 0.09)
    page.colour_bar(narrow, split, f"{made} - reprojected, I / I₀", [-limit, 0, limit])


def _scale(name: str, norm: Normalize) -> ScalarMappable:
    return ScalarMappable(norm, colormaps[name].with_extremes(bad=NO_VALUE))


def _slices(page: Page, top: float, obj: DensityObject) -> None:
    """Draw three slices through the centre of mass, or of the attenuation if that is all."""
    field, colours = _shown_field(obj)
    what = "density, g/cm³" if obj.density else "LAC, 1/cm"
    centre = field.com_cm if field.mass_g > 0 else field.origin_cm
    cuts = [_cut(field, axis, centre) for axis in (1, 0, 2)]
    size, gap = 1.95, 0.56
    scale = _scale(colours, Normalize(0, max(1e-3, *(float(cut.max()) for cut in cuts))))
    for number, (axis, cut) in enumerate(zip((1, 0, 2), cuts, strict=True)):
        left = 0.75 + number * (size + gap)
        page.text(
            left, top - 0.24, f"plane {AXES[axis]} = {_centimetres(centre[axis])} cm", fontsize=10
        )
        axes = page.axes(left, top, size, size)
        _draw_cut(axes, field, axis, cut, centre, scale)
    page.colour_bar((0.83 + 3 * size + 2 * gap, top, 0.1, size), scale, what)


def _shown_field(obj: DensityObject) -> tuple[DensityField, str]:
    """Return the density, or where only attenuation is known that in 1/cm; and the colours."""
    if obj.density:
        return obj.density, DENSITY_COLOURS
    field = obj.best_field
    return replace(field, density_g_cm3=field.density_g_cm3 * PAPER_MAC_CM2_G), LAC_COLOURS


def _cut(field: DensityField, axis: int, centre: np.ndarray) -> Float[np.ndarray, "down across"]:
    """Plane of voxels at the centre, rows downwards along the last axis left."""
    return field.sliced(AXES[axis], float(centre[axis])).T.astype(np.float32)


def _draw_cut(
    axes: Axes,
    field: DensityField,
    axis: int,
    cut: Float[np.ndarray, "down across"],
    centre: np.ndarray,
    scale: ScalarMappable,
) -> None:
    across, up = (other for other in range(3) if other != axis)
    low = field.origin_cm - field.voxel_size_cm / 2
    high = low + field.voxel_size_cm * np.array(field.density_g_cm3.shape)
    extent = (low[across], high[across], low[up], high[up])
    empty = np.where(cut > 0, cut, np.nan)
    clear = ScalarMappable(scale.norm, scale.cmap.with_extremes(bad="white"))
    draw_image(axes, empty, clear, origin="lower", extent=extent)
    cross = CROSS[scale.cmap.name]
    axes.plot(centre[across], centre[up], "+", color=cross, markersize=9, markeredgewidth=1.4)
    columns, rows = _filled(cut, 1), _filled(cut, 0)
    half = 0.6 * field.voxel_size_cm * max(np.ptp(columns), np.ptp(rows))
    for side, number, span in ((axes.xaxis, across, columns), (axes.yaxis, up, rows)):
        middle = low[number] + field.voxel_size_cm * span.mean()
        side.set_view_interval(middle - half, middle + half, ignore=True)
        side.set_major_locator(MaxNLocator(4))
    axes.tick_params(labelsize=8, length=2, width=0.4, colors=FAINT)
    axes.set_xlabel(f"{AXES[across]}, cm", fontsize=9, color=INK, labelpad=2)
    axes.set_ylabel(f"{AXES[up]}, cm", fontsize=9, color=INK, labelpad=1)


def _filled(cut: Float[np.ndarray, "down across"], axis: int) -> Float[np.ndarray, "2"]:
    """First and last edge of what is filled along an axis, in voxels; all if nothing is."""
    filled = np.flatnonzero(cut.any(axis=1 - axis))
    return np.array([filled[0], filled[-1] + 1.0] if len(filled) else [0.0, cut.shape[axis]])


def _part_table(page: Page, top: float, parts: Sequence[Part]) -> None:
    """Draw one line for each part, as many as there is room for."""
    left, width, height = 8.65, 7.7, 2.65
    axes = page.axes(left, top, width, height)
    axes.set(xlim=(0, width), ylim=(height, 0))
    axes.axis("off")
    rows: list[tuple[tuple[float, float, float] | None, tuple[str, ...]]] = [
        (part.color_rgb, _part_cells(part)) for part in parts
    ]
    if len(rows) > TABLE_ROWS:
        more = f"and {len(rows) - TABLE_ROWS + 1} more parts"
        rows = [*rows[: TABLE_ROWS - 1], (None, (more, *[""] * 5))]
    heads = ("part", "material", "LAC 1/cm", "density g/cm³", "source", "flags")
    _table_line(axes, 0, heads, color=FAINT)
    axes.plot([0, width], [0.22, 0.22], color=RULE, linewidth=0.8)
    for number, (color, cells) in enumerate(rows, start=1):
        if number % 2 == 0:
            axes.add_patch(Rectangle((0, number * LINE + 0.02), width, LINE, color=STRIPE))
        if color is not None:
            axes.add_patch(
                Rectangle((0.03, number * LINE + 0.06), 0.12, 0.12, fc=color, ec=RULE, lw=0.5)
            )
        _table_line(axes, number, cells, color=INK)


def _table_line(axes: Axes, number: int, cells: Sequence[str], color: str) -> None:
    for text, (position, side, room) in zip(cells, TABLE_COLUMNS, strict=True):
        middle = number * LINE + 0.02 + LINE / 2
        axes.text(
            position,
            middle,
            cut_short(text, room),
            ha=side,
            va="center",
            fontsize=8.5,
            color=color,
        )


def _part_cells(part: Part) -> tuple[str, ...]:
    known = not np.isnan(part.density_g_cm3)
    spread = f" ± {part.density_sd_g_cm3:.3f}" if part.density_sd_g_cm3 > 0 else ""
    return (
        part.name,
        part.material or "unknown",
        "-" if np.isnan(part.lac_per_cm) else f"{part.lac_per_cm:.4f}",
        f"{part.density_g_cm3:.3f}{spread}" if known else "unknown",
        part.density_source,
        ", ".join(part.flags),
    )


def contact_sheet(objects: Iterable[DensityObject], path: Path, columns: int = 4) -> None:
    """Draw many objects: both radiographs where there are any, a density slice, name and mass.

    Radiographs are the attenuation -ln T, each on its own scale, air black. The slice is the one of
    the three planes through the centre of mass in which the object is largest; which one is written
    below it. One colour scale for all densities, by the square root. An object of which only the
    attenuation is known shows that, in other colours of their own scale, and no mass; it says so.
    A note says whether the objects are scans or simulated.

    Parameters
    ----------
    objects
        What to draw, in this order; at least one. Taken one at a time.
    path
        The PNG to write.
    columns
        Objects in a row.

    Raises
    ------
    DataError
        If there are no objects.
    """
    cells, sources = [], set()
    for obj in objects:
        cells.append(_cell(obj))
        sources.add(obj.source)
    if not cells:
        raise DataError("a contact sheet needs at least one object")
    size = 1.25
    across = 1 + max(len(cell.views) for cell in cells)
    inner = across * size + (across - 1) * CELL_GAP
    width, height = inner + 0.35, size + 0.62
    rows = -(-len(cells) // columns)
    columns = min(columns, len(cells))
    page = Page(columns * width + 0.35, rows * height + 1.2)
    looks = {
        colours: _scale(colours, PowerNorm(0.5, 0, max(1e-3, *highest)))
        for colours in (DENSITY_COLOURS, LAC_COLOURS)
        if (highest := [float(np.nanmax(c.cut)) for c in cells if c.colours == colours])
    }
    for number, cell in enumerate(cells):
        left, top = 0.35 + number % columns * width, 0.15 + number // columns * height
        _draw_cell(page, left, top, size, inner, cell, looks[cell.colours])
    room = page.width - 0.35
    for number, (colours, look) in enumerate(looks.items()):
        label = "density, g/cm³" if colours == DENSITY_COLOURS else "LAC, 1/cm"
        start = 0.35 + number * room / len(looks)
        wide = min(5.0, room / len(looks) - 0.35)
        page.colour_bar((start, rows * height + 0.25, wide, 0.09), look, label)
    words = " / ".join(SOURCE_WORDS[source] for source in sorted(sources, reverse=True))
    shown = "PA, LAT, and the widest slice" if across > 1 else "The widest slice"
    page.text(
        0.35,
        page.height - 0.3,
        f"{shown} through the centre of mass; {words}",
        fontsize=9,
        color=FAINT,
    )
    page.save(path)


def _draw_cell(
    page: Page,
    left: float,
    top: float,
    size: float,
    width: float,
    cell: _Cell,
    look: ScalarMappable,
) -> None:
    """Draw radiographs from the left, the slice at the right end."""
    right = left + width
    page.text(left, top + 0.07, cell.name, fontsize=9, weight="bold")
    page.text(right, top + 0.07, cell.note, fontsize=9, ha="right", color=FAINT)
    clear = ScalarMappable(look.norm, look.cmap.with_extremes(bad="white"))
    pictures = [(image, grey_scale(image)) for image in cell.views]
    for column, (image, scale) in enumerate(pictures):
        start = left + column * (size + CELL_GAP)
        axes = page.axes(start, top + 0.3, size, size)
        draw_image(axes, image, scale, aspect=cell.aspects[column])
        page.text(start, top + 0.33 + size, ("PA", "LAT")[column], fontsize=7, color=FAINT)
    draw_image(page.axes(right - size, top + 0.3, size, size), cell.cut, clear, aspect=1.0)
    page.text(right - size, top + 0.33 + size, cell.plane, fontsize=7, color=FAINT)


def _cell(obj: DensityObject) -> _Cell:
    """Gather an object's texts and pictures, reduced so that many fit into memory."""
    field, colours = _shown_field(obj)
    centre = field.com_cm if field.mass_g > 0 else field.origin_cm
    cuts = {axis: _cut(field, axis, centre) for axis in (1, 0, 2)}
    axis = max(cuts, key=lambda each: _filled_area(cuts[each]))
    what = "" if obj.density else "LAC, "
    cut = cuts[axis][::-1]
    small = [reduced(view, object_window(obj, view)) for view in obj.views]
    return _Cell(
        name=obj.object_id,
        note=f"{obj.mass_g:.4g} g" if np.isfinite(obj.mass_g) else "attenuation only",
        plane=f"{what}{AXES[axis]} = {_centimetres(centre[axis])} cm",
        views=tuple(image for image, _ in small),
        cut=np.where(cut > 0, cut, np.nan),
        colours=colours,
        aspects=tuple(aspect for _, aspect in small),
    )


def _filled_area(cut: Float[np.ndarray, "down across"]) -> float:
    return float(np.ptp(_filled(cut, 0)) * np.ptp(_filled(cut, 1)))

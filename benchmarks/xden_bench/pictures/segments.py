"""Clusters of methods beside the true regions, an object a row. Needs the extra ``view``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any, Final

import numpy as np
from jaxtyping import Float64, Integer
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Rectangle

from xden1k.folder import DatasetFolder
from xden1k.pictures.looks import grey_scale, readable_aspect, reduced
from xden1k.pictures.page import (
    FAINT,
    INK,
    RULE,
    SOURCE_WORDS,
    Page,
    cut_short,
    draw_image,
)
from xden1k.pictures.shaded import shaded
from xden1k.rays import outer_surface
from xden1k.segmentation import material_regions
from xden1k.values.types import AXES, DensityObject
from xden1k.values.windows import object_window
from xden_bench.pictures.cuts import OUTSIDE, Cut, widest_cut
from xden_bench.pictures.rows import Row, matched
from xden_bench.scoring.regions import DrawnObject, SegmentReference

__all__ = ["draw_segments"]

VOID: Final = "#e3e3df"
COLOURS: Final = (
    *("#88ccee", "#ddcc77", "#44aa99", "#cc6677", "#332288", "#117733", "#882255", "#999933"),
    *("#aa4499", "#ee7733", "#0077bb", "#555555"),
)
"""Of regions from the lightest on: Paul Tol's muted and vibrant schemes (SRON/EPS/TN/09-002)."""
NO_REGION: Final = "#ffffff"
"""Of a cluster beyond the number of regions."""
SIZE: Final = 1.6
GAP: Final = 0.1
EDGE: Final = 0.3
"""Of a picture, between pictures, and around the page, inches."""
HEAD: Final = 0.55
ROW: Final = 0.34 + SIZE + 0.62
HEAD_LETTERS: Final = 18
"""Of a line above a picture."""
CAPTION_LETTERS: Final = 14.0
CAPTION_LINE: Final = 0.17
"""Letters an inch, and height of a line."""
SHADED_PX: Final = 190


def draw_segments(reference: SegmentReference, rows: Sequence[Row], path: Path) -> None:
    """Draw objects, a row each: surface, radiographs, true regions in a cut, and each answer.

    Clusters are those of protocol A, in the colour of the region that each is assigned to. They are
    known at points: a pixel of the cut has the cluster of the nearest. Lines are the borders of the
    true regions. The page says where each object comes from.

    Parameters
    ----------
    reference
        The truth.
    rows
        At least one, with answers of the same methods.
    path
        The PNG to write.
    """
    columns = 4 + len(rows[0].answers)
    width = 2 * EDGE + columns * (SIZE + GAP) - GAP
    sources = dict.fromkeys(SOURCE_WORDS[row.drawn.row["source"]] for row in rows)
    caption = wrap(_caption(" / ".join(sources)), int(CAPTION_LETTERS * (width - 2 * EDGE)))
    body = HEAD + len(rows) * ROW
    page = Page(width, body + EDGE + CAPTION_LINE * len(caption))
    heads = ("outer surface", "PA", "LAT", "true regions")
    for place, text in enumerate((*heads, *(one.method for one in rows[0].answers))):
        middle = _left(place) + SIZE / 2
        head = "\n".join(wrap(text, HEAD_LETTERS)[:2])
        page.text(middle, HEAD - 0.12, head, fontsize=10, weight="bold", ha="center", va="bottom")
    for number, row in enumerate(rows):
        _draw_row(page, HEAD + number * ROW, reference, row)
    page.text(EDGE, body + 0.1, "\n".join(caption), fontsize=9, color=FAINT, linespacing=1.3)
    page.save(path)


def _caption(sources: str) -> str:
    return (
        f"{sources[0].upper()}{sources[1:]}. Clusters in the colour of the region that each is "
        "assigned to; lines are borders of true regions. IoU by protocol A, percent: as many "
        "clusters as there are true regions, one to one. A pixel has the cluster of the nearest of "
        "the points that are asked for. Numbers before parts: g/cm³."
    )


def _left(column: int) -> float:
    return EDGE + column * (SIZE + GAP)


def _draw_row(page: Page, top: float, reference: SegmentReference, row: Row) -> None:
    drawn, gap = row.drawn, reference.rules.region_gap_g_cm3
    cut = widest_cut(drawn, gap)
    truth = row.truth
    name = row.object_id
    page.text(EDGE, top, name, fontsize=11, weight="bold")
    _, times = readable_aspect(cut.regions.T.shape, 1.0)
    where = f"cut at {AXES[cut.axis]} = {round(cut.place_cm, 1) + 0.0:.1f} cm"
    if times != 1:
        where += f", drawn {max(times, 1 / times):.1f} times as {'high' if times > 1 else 'wide'}"
    page.text(page.width - EDGE, top + 0.02, where, fontsize=9, color=FAINT, ha="right")
    page.figure.add_artist(_rule(page, top - 0.06))
    top += 0.3

    def place(column: int) -> Axes:
        return page.axes(_left(column), top, SIZE, SIZE)

    _bare(place(0), shaded(outer_surface(drawn.meshes), SHADED_PX))
    _draw_radiographs(page, top, reference.folder, name)
    _draw_cut(place(3), cut, cut.regions, {one: one for one in np.unique(truth).tolist()})
    below = top + SIZE + 0.06
    style: dict[str, Any] = {"fontsize": 10, "ha": "center"}
    page.text(_left(3) + SIZE / 2, below, f"{row.regions} regions", **style)
    for column, answer in enumerate(row.answers, start=4):
        spread = cut.nearest(drawn.points, answer.clusters)
        _draw_cut(place(column), cut, spread, matched(truth, answer.clusters), lines=True)
        told = "one region: not scored" if np.isnan(answer.iou_a) else f"IoU {answer.iou_a:.1f}"
        page.text(_left(column) + SIZE / 2, below, told, **style)
    _draw_legend(page, below + 0.25, drawn, gap, np.unique(truth).tolist())


def _rule(page: Page, top: float) -> Rectangle:
    """Thin line across the page."""
    y, thin = 1 - top / page.height, 0.006 / page.height
    left = EDGE / page.width
    return Rectangle((left, y), 1 - 2 * left, thin, color=RULE, transform=page.figure.transFigure)


def _bare(axes: Axes, image: Float64[np.ndarray, "rows columns 3"], **how: Any) -> None:
    draw_image(axes, image, **how)
    axes.axis("off")


def _draw_radiographs(page: Page, top: float, folder: DatasetFolder, object_id: str) -> None:
    obj: DensityObject = folder.object(object_id)
    for column, view in enumerate(obj.views, start=1):
        image, aspect = reduced(view, object_window(obj, view))
        axes = page.axes(_left(column), top, SIZE, SIZE)
        draw_image(axes, image, grey_scale(image), aspect=aspect)


def _draw_cut(
    axes: Axes,
    cut: Cut,
    labels: Integer[np.ndarray, "across up"],
    region_of: Mapping[int, int],
    *,
    lines: bool = False,
) -> None:
    """Draw labels of a plane in the colours of their regions, in a square about it."""
    image = np.ones((*labels.shape, 3))
    for label in np.unique(labels[labels != OUTSIDE]).tolist():
        image[labels == label] = _colour(region_of.get(label))
    aspect, _ = readable_aspect(labels.T.shape, 1.0)
    _bare(axes, np.swapaxes(image, 0, 1), origin="lower", aspect=aspect)
    axes.set_anchor("C")
    _outline(axes, cut.inside, 0.8)
    if lines:
        for region in np.unique(cut.regions[cut.inside])[1:]:
            _outline(axes, cut.regions == region, 0.5)


def _outline(axes: Axes, mask: np.ndarray, width: float) -> None:
    axes.contour(mask.T.astype(float), [0.5], colors=[INK], linewidths=[width])


def _colour(region: int | None) -> tuple[float, float, float]:
    if region is None:
        return to_rgb(NO_REGION)
    return to_rgb(COLOURS[(region - 1) % len(COLOURS)] if region else VOID)


def _told(drawn: DrawnObject, region: int, gap_g_cm3: float) -> str:
    """Density of a region, and the parts that are of it."""
    densities = drawn.densities_g_cm3
    of = material_regions(densities, gap_g_cm3)
    names = ["void", *drawn.row["part_names"]]
    own = [owner for owner in range(len(names)) if of[owner] == region]
    lowest, highest = (f"{end(densities[owner] for owner in own):.2f}" for end in (min, max))
    span = lowest if lowest == highest else f"{lowest} to {highest}"
    return f"{span}: {', '.join(names[owner] for owner in own)}"


def _draw_legend(
    page: Page, top: float, drawn: DrawnObject, gap_g_cm3: float, there: Sequence[int]
) -> None:
    """Say which colour is what: density and parts of each region that has points."""
    entries = [(region, _told(drawn, region, gap_g_cm3)) for region in there]
    room = (page.width - 2 * EDGE) / max(len(entries), 4)
    axes = page.axes(EDGE, top, page.width - 2 * EDGE, 0.2)
    axes.set(xlim=(0, page.width - 2 * EDGE), ylim=(0.2, 0))
    axes.axis("off")
    for place, (region, text) in enumerate(entries):
        left = place * room
        axes.add_patch(Rectangle((left, 0.03), 0.13, 0.13, fc=_colour(region), ec=RULE, lw=0.5))
        shown = cut_short(text, int(room / 0.062) - 4)
        axes.text(left + 0.19, 0.1, shown, fontsize=8.5, va="center", color=INK)

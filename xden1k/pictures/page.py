"""A page on which pictures are placed in inches. Needs the extra ``view``.

Figures are drawn on their own canvas; matplotlib's global state is left alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

__all__ = ["FAINT", "INK", "RULE", "SOURCE_WORDS", "Page", "cut_short", "draw_image"]

INK, FAINT, RULE = "#1b1b1b", "#777777", "#c9c9c4"
DPI: Final = 120
SOURCE_WORDS: Final = {
    "scan": "scan",
    "phantom": "simulated, never on a scanner",
    "ct": "views computed from a CT",
    "published": "the authors' release",
}
"""What objects of each source are, for captions."""


class Page:
    """A figure whose axes are placed in inches from its top left corner.

    Parameters
    ----------
    width, height
        Inches.
    """

    def __init__(self, width: float, height: float) -> None:
        self.width, self.height = width, height
        self.figure = Figure(figsize=(width, height), facecolor="white")
        FigureCanvasAgg(self.figure)

    def axes(self, left: float, top: float, width: float, height: float) -> Axes:
        """Place axes."""
        bottom = self.height - top - height
        return self.figure.add_axes(
            (left / self.width, bottom / self.height, width / self.width, height / self.height)
        )

    def text(self, left: float, top: float, text: str, **style: Any) -> None:
        """Write words, in matplotlib's style; their top is at the place unless it says else."""
        self.figure.text(
            left / self.width, 1 - top / self.height, text, **{"color": INK, "va": "top"} | style
        )

    def colour_bar(
        self,
        box: tuple[float, float, float, float],
        scale: ScalarMappable,
        label: str,
        ticks: Sequence[float] | None = None,
    ) -> None:
        """Draw a bar into a box (left, top, width, height), along its longer side."""
        axes = self.axes(*box)
        upright = box[3] > box[2]
        bar = self.figure.colorbar(
            scale, cax=axes, orientation="vertical" if upright else "horizontal", ticks=ticks
        )
        bar.outline.set_linewidth(0.4)
        bar.set_label(label, fontsize=9, color=INK)
        axes.tick_params(labelsize=8, length=2, width=0.4, colors=FAINT)

    def save(self, path: Path) -> None:
        """Write a PNG without the library's version: the same page gives the same bytes."""
        self.figure.savefig(path, dpi=DPI, metadata={"Software": None})


def draw_image(
    axes: Axes, image: np.ndarray, scale: ScalarMappable | None = None, **how: Any
) -> None:
    """Draw an image without ticks, in a thin frame.

    Parameters
    ----------
    axes
        Where.
    image
        Shape (rows, columns); or (rows, columns, 3) of colours.
    scale
        Colours of values.
    how
        Options of ``imshow``.
    """
    if scale is not None:
        how |= {"cmap": scale.cmap, "norm": cast("Normalize", scale.norm)}
    axes.imshow(image, interpolation="antialiased", **how)
    axes.set(xticks=[], yticks=[], anchor="NW")
    for spine in axes.spines.values():
        spine.set(linewidth=0.5, color=RULE)


def cut_short(text: str, room: int) -> str:
    """Return a text of at most so many characters.

    Examples
    --------
    >>> cut_short("polypropylene", 8)
    'polypro…'
    """
    return text if len(text) <= room else f"{text[: room - 1]}…"

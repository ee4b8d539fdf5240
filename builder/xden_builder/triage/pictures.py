"""Small pictures of a view: as it is, as reprojected, the difference, and where to look."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from jaxtyping import Float64, UInt8
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from xden1k.pictures.looks import NO_VALUE, attenuation, grey_scale, readable_aspect
from xden1k.pictures.radiographs import MADE_WORDS
from xden1k.values.types import DensityObject
from xden1k.values.views import XRayView
from xden1k.values.windows import Window, object_window, pixel_aspect
from xden_builder.audit.replay import stored_model
from xden_builder.poly.model.frames import binned, coarse

__all__ = ["RESIDUAL_LIMIT", "Frame", "Picture", "ViewPictures", "draw", "picture"]

PICTURE_PX: Final = 200
"""Longest side of a picture."""
QUALITY: Final = 60
"""Of WebP, 0 to 100."""
RESIDUAL_LIMIT: Final = 0.1
"""End of the colours of residuals, in transmission: one scale for all objects, to compare them."""
FRAME_MARGIN: Final = 0.02
"""Between what a frame points at and the frame, as a share of the picture."""

Box = Float64[np.ndarray, "2 2"]
"""First row and column, last row and column."""


@dataclass(frozen=True, slots=True)
class Picture:
    """An image for a page.

    Parameters
    ----------
    label
        What it shows.
    uri
        The image itself, as a ``data:`` URI.
    width, height
        In pixels.
    """

    label: str
    uri: str
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Frame:
    """A rectangle to look into, as shares of a picture's width and height.

    Parameters
    ----------
    kind
        ``content`` or ``shadow``.
    left, top, width, height
        0 to 1.
    """

    kind: str
    left: float
    top: float
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class ViewPictures:
    """Pictures of one view, cut to the object, and frames that hold for each of them."""

    pictures: tuple[Picture, ...]
    frames: tuple[Frame, ...]


def draw(obj: DensityObject, view: XRayView, unexplained: Mapping[str, Any]) -> ViewPictures:
    """Draw a view of an object.

    Parameters
    ----------
    obj
        From the dataset.
    view
        One of its own.
    unexplained
        Boxes to frame, ``content_box`` and ``shadow_box``: first row, first column, last row, last
        column; a missing one, or None, is not drawn.
    """
    boxes = {
        kind: np.array(unexplained[f"{kind}_box"], dtype=np.float64).reshape(2, 2)
        for kind in ("content", "shadow")
        if unexplained.get(f"{kind}_box") is not None
    }
    wide = _window(obj, view, boxes.values(), 1)
    binning = max(round(max(side.stop - side.start for side in wide) / PICTURE_PX), 1)
    small = _binned(view, binning)
    window = _window(obj, small, boxes.values(), binning)
    measured = np.where(small.valid, small.transmission, np.float32(np.nan))[window]
    model = stored_model(obj, small)[window]
    aspect, _ = readable_aspect(measured.shape, pixel_aspect(small))
    dark = attenuation(measured), attenuation(model)
    grey, split = grey_scale(*dark), _residual_colours()
    pictures = (
        picture(MADE_WORDS[obj.source], grey.to_rgba(dark[0], bytes=True), aspect),
        picture("reprojected", grey.to_rgba(dark[1], bytes=True), aspect),
        picture("difference", split.to_rgba(measured - model, bytes=True), aspect),
    )
    frames = (_frame(kind, box, window, binning) for kind, box in boxes.items())
    return ViewPictures(pictures, tuple(frames))


def _window(obj: DensityObject, view: XRayView, boxes: Iterable[Box], binning: int) -> Window:
    """Rows and columns of the object, its margin, and what is framed."""
    rows, columns = object_window(obj, view)
    low, high = [rows.start, columns.start], [rows.stop, columns.stop]
    for first, last in boxes:
        low = np.minimum(low, first // binning).astype(int).tolist()
        high = np.maximum(high, last // binning + 1).astype(int).tolist()
    height, width = view.geometry.shape
    return slice(low[0], min(high[0], height)), slice(low[1], min(high[1], width))


def _binned(view: XRayView, binning: int) -> XRayView:
    """Read several pixels of a view as one."""
    transmission, valid = binned(view, binning)
    geometry = coarse(view.geometry, binning)
    return replace(view, transmission=transmission, valid=valid, geometry=geometry)


def _residual_colours() -> ScalarMappable:
    colours = colormaps["RdBu"].with_extremes(bad=NO_VALUE)
    return ScalarMappable(Normalize(-RESIDUAL_LIMIT, RESIDUAL_LIMIT), colours)


def picture(
    label: str,
    colours: UInt8[np.ndarray, "rows columns 4"],
    aspect: float,
    longest_px: int = PICTURE_PX,
) -> Picture:
    """Make an image for a page.

    Parameters
    ----------
    label
        What it shows.
    colours
        Red, green, blue and what is not looked at.
    aspect
        Height of a pixel over its width.
    longest_px
        Its longest side.
    """
    from PIL import Image

    rows, columns = colours.shape[0] * aspect, colours.shape[1]
    scale = longest_px / max(rows, columns)
    size = max(round(columns * scale), 1), max(round(rows * scale), 1)
    file = io.BytesIO()
    image = Image.fromarray(np.ascontiguousarray(colours[..., :3])).resize(size)
    image.save(file, format="webp", quality=QUALITY)
    data = base64.b64encode(file.getvalue()).decode("ascii")
    return Picture(label, f"data:image/webp;base64,{data}", *size)


def _frame(kind: str, box: Box, window: Window, binning: int) -> Frame:
    """Place a box of pixels in a picture, with a margin, cut to it."""
    start = np.array([side.start for side in window])
    size = np.array([side.stop - side.start for side in window])
    first, last = box
    top, left = ((first / binning - start) / size - FRAME_MARGIN).clip(0, 1).tolist()
    bottom, right = (((last + 1) / binning - start) / size + FRAME_MARGIN).clip(0, 1).tolist()
    return Frame(kind, left, top, right - left, bottom - top)

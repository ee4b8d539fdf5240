"""An object as HTML, as a notebook shows it: one string, no script, no external resources."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Float

from xden1k.values.types import AXES, Axis, DensityField, Part
from xden1k.values.views import XRayView
from xden1k.values.windows import object_window, pixel_aspect

if TYPE_CHECKING:
    from xden1k.values.types import DensityObject

__all__ = ["object_html"]

PICTURE: Final = 200
"""Longest side of a picture on the page, pixels."""
DARKEST: Final = 1e-3
"""Transmission below which a picture makes no difference."""
_RAMP: Final = np.array(
    [[255, 255, 255], [254, 206, 145], [241, 96, 93], [158, 46, 126], [59, 15, 112], [0, 0, 4]],
    dtype=np.float64,
)
"""Colours of densities: white is air, black the densest."""
_CELL: Final = "padding:2px 10px;text-align:left;white-space:nowrap"
_HEADS: Final = ("part", "material", "LAC 1/cm", "density g/cm³", "source", "flags")


def object_html(obj: DensityObject) -> str:
    """Page of an object: radiographs, two slices, parts; every text of the data escaped.

    Radiographs are drawn as the root of the attenuation -ln T, air black, the most attenuated
    pixel white; slices go through the centre of mass, the two in which most is filled, white is
    air and black the densest.

    Parameters
    ----------
    obj
        What to show.
    """
    figures = "".join([*_radiographs(obj), *_slices(obj)])
    rows = "".join(_part_row(part) for part in obj.parts)
    heads = "".join(f'<th style="{_CELL}">{head}</th>' for head in _HEADS)
    return (
        f'<div><p style="margin:4px 0"><b>{escape(obj.object_id)}</b> · {_summary(obj)}</p>'
        f'<div style="display:flex;flex-wrap:wrap;gap:12px;align-items:flex-end">{figures}</div>'
        f'<table style="border-collapse:collapse;margin-top:8px"><tr>{heads}</tr>{rows}</table>'
        "</div>"
    )


def _summary(obj: DensityObject) -> str:
    words = [
        obj.category,
        f"{obj.mass_g:.4g} g" if np.isfinite(obj.mass_g) else "mass unknown",
        *([] if obj.weighed_mass_g is None else [f"weighed {obj.weighed_mass_g:.4g} g"]),
        "simulated" if obj.source == "phantom" else obj.source,
        f"{obj.split} split",
        *obj.flags,
    ]
    return " · ".join(escape(word) for word in words)


def _radiographs(obj: DensityObject) -> Iterator[str]:
    for view in obj.views:
        yield _figure(_grey(obj, view), f"{view.name.upper()} radiograph, √(-ln T)")


def _grey(obj: DensityObject, view: XRayView) -> Float[np.ndarray, "rows columns 3"]:
    """Picture of the object in one view, as wide and high as it is in cm."""
    window = object_window(obj, view)
    image = np.where(view.valid, view.transmission, np.float32(1))[window]
    attenuation = -np.log(image.clip(DARKEST, 1))
    # by the square root, so that plastic beside metal is not black
    grey = 255 * np.sqrt(attenuation / max(float(attenuation.max()), 1e-6))
    height, width = grey.shape[0] * pixel_aspect(view), grey.shape[1]
    return np.repeat(_scaled(grey, height / width)[..., None], 3, axis=2)


def _scaled(image: Float[np.ndarray, "rows columns"], ratio: float) -> np.ndarray:
    """Take the nearest pixels of a picture of this height over width, at least a fifth."""
    ratio = min(max(ratio, 0.2), 5)
    rows, columns = (PICTURE, PICTURE / ratio) if ratio > 1 else (PICTURE * ratio, PICTURE)
    sizes = (max(1, round(rows)), max(1, round(columns)))
    picks = [
        (np.arange(count) + 0.5) * size / count
        for count, size in zip(sizes, image.shape, strict=True)
    ]
    return image[np.ix_(*(pick.astype(int) for pick in picks))]


def _slices(obj: DensityObject) -> Iterator[str]:
    """Draw two planes through the centre of mass; nothing where the answers are withheld."""
    field = obj.density or obj.apparent_density
    if field is None or field.mass_g == 0:
        return
    what = "density" if obj.density else "apparent density"
    densest = float(field.density_g_cm3.max())
    for axis in sorted(AXES, key=lambda axis: -np.count_nonzero(field.sliced(axis)))[:2]:
        at = round(float(field.com_cm[AXES.index(axis)]), 2) + 0.0  # no minus zero
        colours = _colours(field, axis, densest)
        yield _figure(colours, f"{what}, {axis} = {at:.2f} cm, 0 to {densest:.3g} g/cm³")


def _colours(
    field: DensityField, axis: Axis, densest: float
) -> Float[np.ndarray, "rows columns 3"]:
    plane = field.sliced(axis).T[::-1].astype(np.float64)
    # by the square root, so that foam beside steel is not white
    place = np.sqrt(_scaled(plane, 1.0) / densest) * (len(_RAMP) - 1)
    ends = np.arange(len(_RAMP))
    return np.stack([np.interp(place, ends, channel) for channel in _RAMP.T], axis=2)


def _figure(colours: np.ndarray, caption: str) -> str:
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(np.rint(colours).astype(np.uint8)).save(file, format="png")
    data = base64.b64encode(file.getvalue()).decode("ascii")
    return (
        f'<figure style="margin:0"><img alt="{escape(caption)}" '
        f'src="data:image/png;base64,{data}"/>'
        f'<figcaption style="font-size:smaller">{escape(caption)}</figcaption></figure>'
    )


def _part_row(part: Part) -> str:
    red, green, blue = (round(255 * min(max(value, 0), 1)) for value in part.color_rgb)
    swatch = (
        f'<span style="display:inline-block;width:0.9em;height:0.9em;margin-right:6px;'
        f'background:rgb({red},{green},{blue})"></span>'
    )
    spread = f" ± {part.density_sd_g_cm3:.3g}" if part.density_sd_g_cm3 > 0 else ""
    cells = (
        part.material or "unknown",
        "-" if np.isnan(part.lac_per_cm) else f"{part.lac_per_cm:.4g}",
        "unknown" if np.isnan(part.density_g_cm3) else f"{part.density_g_cm3:.4g}{spread}",
        part.density_source,
        ", ".join(part.flags),
    )
    texts = [swatch + escape(part.name), *map(escape, cells)]
    columns = (f'<td style="{_CELL}">{text}</td>' for text in texts)
    return f"<tr>{''.join(columns)}</tr>"

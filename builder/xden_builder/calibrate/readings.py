"""Mean transmission behind each step of the wedges of an image, and in the air around them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64
from scipy.ndimage import distance_transform_edt

from xden1k.errors import DataError
from xden1k.rays import PathLengths
from xden1k.values.arrays import Image, Mask
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.calibrate.told import Wedge
from xden_builder.capture.calibration import CalibratedView

__all__ = ["ImageReadings", "Reading", "read_image_steps"]

KEPT: Final = 0.5
"""Share of a step's height and width that is read: beside it edges blur and lean."""
LEAST_PIXELS: Final = 9
AIR_CELLS: Final = 16
"""Along each side of the image; those without any wedge near are read as air."""
AIR_MARGIN_CM: Final = 1.5
"""On the panel, from wedges to what is read as air."""
AIR_LEVEL: Final = 0.97
"""Of the median cell: what is darker is something that nobody told of."""
LEAST_SHADOW: Final = 0.02
"""By which a wedge's darkest step is below air at least."""
UNEVEN: Final = 0.1
"""Relative spread of the pixels of one step that noise does not make."""
OUT_OF_ORDER: Final = 0.02
"""Relative brightness by which a thicker step may not exceed a thinner one."""
_FAINT: Final = 0.005
"""Of the open field: where stray light rules, order and evenness say nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """The mean over one step, or over a cell of air.

    Parameters
    ----------
    wedge, step
        Which wedge of the image, and which step; -1 for air.
    path_cm
        Way of the rays through the step; 0 in air.
    pixel
        Flat index of its middle.
    region
        Flat indices of all that was read; of air its middle alone, where light hardly varies.
    transmission, sd
        Mean, and its standard deviation by the spread of its pixels.
    """

    wedge: int
    step: int
    path_cm: float
    pixel: int
    region: Int64[np.ndarray, "_n"]
    transmission: float
    sd: float


@dataclass(frozen=True, slots=True, eq=False)
class ImageReadings:
    """All readings of one image.

    Parameters
    ----------
    view
        The radiograph.
    open_field
        As of :class:`xden_builder.capture.calibration.CalibratedView`.
    wedges
        Those in the image.
    readings
        Of steps and of air.
    lengths
        Way through each wedge at every pixel, as the told places have it.
    """

    view: XRayView
    open_field: Image | None
    wedges: tuple[Wedge, ...]
    readings: tuple[Reading, ...]
    lengths: PathLengths

    @property
    def name(self) -> str:
        """Scan and view."""
        return f"{self.wedges[0].scan}/{self.view.name}"


def read_image_steps(seen: CalibratedView, wedges: Sequence[Wedge]) -> ImageReadings:
    """Read all wedges of one image.

    Raises
    ------
    DataError
        If a step lies outside the image or is too small in it, a wedge casts no shadow, a step is
        not even, or a thicker step is brighter than a thinner one; the message names the wedge.
    """
    view = seen.view
    steps = [_read_wedge(seen, place, wedge) for place, wedge in enumerate(wedges)]
    for wedge, readings in zip(wedges, steps, strict=True):
        _refuse_implausible(wedge, readings)
    lengths = _path_lengths(view.geometry, wedges)
    air = _read_air(view, lengths)
    if not air:
        raise DataError(f"{wedges[0].scan}/{view.name}: no air is seen beside the wedges")
    every = (*(reading for readings in steps for reading in readings), *air)
    return ImageReadings(view, seen.open_field, tuple(wedges), every, lengths)


def _read_wedge(seen: CalibratedView, place: int, wedge: Wedge) -> list[Reading]:
    found, view = [], seen.view
    for step, thickness_cm in enumerate(wedge.thickness_cm):
        inside = _step_pixels(view.geometry, wedge, step, KEPT)
        row, column = wedge.centres_px[step]
        where = f"{wedge.name}, step {step + 1} at row {row:g}, column {column:g}"
        if inside is None:
            raise DataError(f"{where}: lies outside of the image, {view.geometry.shape}")
        region = np.flatnonzero(inside & view.valid)
        values = view.transmission.flat[region].astype(np.float64)
        if len(values) < LEAST_PIXELS:
            full = 0 if seen.at_least is None else int((inside & ~np.isnan(seen.at_least)).sum())
            saturated = f", and {full} that are saturated: expose image and flat less"
            raise DataError(
                f"{where}: {len(values)} valid pixels, expected {LEAST_PIXELS} or more"
                f"{saturated if full else ''}"
            )
        mean, sd = float(values.mean()), float(values.std(ddof=1))
        if sd > UNEVEN * mean + _FAINT:
            raise DataError(
                f"{where}: is not even, its pixels spread by {sd / mean:.0%}: an edge runs through "
                "it, so first_px, last_px, step_cm or width_cm are wrong"
            )
        pixel = int(np.ravel_multi_index((round(row), round(column)), view.geometry.shape))
        path_cm = thickness_cm * float(_obliquity(view.geometry, np.array([pixel]))[0])
        found.append(Reading(place, step, path_cm, pixel, region, mean, _sd_of_mean(values)))
    return found


def _refuse_implausible(wedge: Wedge, readings: Sequence[Reading]) -> None:
    """Refuse a wedge that casts no shadow, or whose steps are in another order."""
    darkest = min(reading.transmission for reading in readings)
    if darkest > 1 - LEAST_SHADOW:
        raise DataError(
            f"{wedge.name}: no shadow where the wedge should be, its darkest step lets "
            f"{darkest:.3f} pass: expected other first_px and last_px, or another image"
        )
    cm = wedge.thickness_cm
    for thin, thick in pairwise(sorted(readings, key=lambda reading: cm[reading.step])):
        brighter = thick.transmission > (1 + OUT_OF_ORDER) * thin.transmission + _FAINT
        if brighter and cm[thick.step] > cm[thin.step]:
            raise DataError(
                f"{wedge.name}: step {thick.step + 1} ({cm[thick.step]:g} cm) is "
                f"brighter than step {thin.step + 1} ({cm[thin.step]:g} cm): the "
                "steps stand in another order than thickness_cm, or first_px and last_px are "
                "exchanged"
            )


def _step_pixels(
    geometry: ViewGeometry, wedge: Wedge, step: int, share: float
) -> Bool[np.ndarray, "rows columns"] | None:
    """Say which pixels belong to the middle of a step; None where it is not in the image."""
    away = np.moveaxis(np.indices(geometry.shape), 0, -1) - wedge.centres_px[step]
    along = wedge.along
    height_px, width_px = (
        size_cm * _magnification(geometry) / _pixel_cm(geometry)
        for size_cm in (wedge.step_cm, wedge.width_cm)
    )
    corner = np.abs(along) * height_px / 2 + np.abs(along[::-1]) * width_px / 2
    low, high = wedge.centres_px[step] - share * corner, wedge.centres_px[step] + share * corner
    if (low < 0).any() or (high > np.array(geometry.shape) - 1).any():
        return None
    across = np.array([-along[1], along[0]])
    return np.asarray(
        (np.abs(away @ along) <= share * height_px / 2)
        & (np.abs(away @ across) <= share * width_px / 2)
    )


def _magnification(geometry: ViewGeometry) -> float:
    """Of what stands at the origin of the object frame."""
    if geometry.source_cm is None:
        return 1.0
    return 1 / float(geometry.project(np.zeros((1, 3)))[0, 2])


def _pixel_cm(geometry: ViewGeometry) -> float:
    return float(np.linalg.norm(geometry.column_step_cm))


def _obliquity(geometry: ViewGeometry, pixels: Int64[np.ndarray, "n"]) -> Float64[np.ndarray, "n"]:
    """Way through a plate that is parallel to the panel, over its thickness."""
    normal = np.cross(geometry.column_step_cm, geometry.row_step_cm)
    normal /= np.linalg.norm(normal)
    if geometry.source_cm is None:
        ways = np.broadcast_to(geometry.matrix[:, 2], (len(pixels), 3))
    else:
        rows, columns = np.divmod(pixels, geometry.shape[1])
        centres = geometry.pixel_centres_cm(rows.astype(float), columns.astype(float))
        ways = centres - geometry.source_cm
    return np.asarray(np.linalg.norm(ways, axis=1) / np.abs(ways @ normal))


def _path_lengths(geometry: ViewGeometry, wedges: Sequence[Wedge]) -> PathLengths:
    """Way through each wedge at each pixel, its steps taken for plates parallel to the panel."""
    thickness = np.zeros((len(wedges), *geometry.shape), dtype=np.float32)
    for place, wedge in enumerate(wedges):
        for step, thickness_cm in enumerate(wedge.thickness_cm):
            inside = _step_pixels(geometry, wedge, step, 1.0)
            if inside is not None:
                thickness[place][inside] = thickness_cm
    pixels = np.flatnonzero(thickness.any(axis=0))
    lengths = (
        thickness.reshape(len(wedges), -1)[:, pixels].T * _obliquity(geometry, pixels)[:, None]
    )
    nothing = np.zeros(len(pixels))
    return PathLengths(
        pixels,
        lengths[:, None].astype(np.float32),
        nothing.astype(np.float32),
        nothing.astype(np.bool_),
        geometry.shape,
    )


def _read_air(view: XRayView, lengths: PathLengths) -> list[Reading]:
    bare = np.ones(view.transmission.shape, dtype=np.bool_)
    bare.flat[lengths.pixels] = False
    margin_px = AIR_MARGIN_CM / _pixel_cm(view.geometry)
    air = view.valid & (distance_transform_edt(bare) > margin_px)
    cells = [_air(view, cell, air) for cell in _cells(air)]
    level = AIR_LEVEL * np.median([each.transmission for each in cells]) if cells else 0.0
    return [each for each in cells if each.transmission > level]


def _cells(air: Mask) -> Iterator[tuple[slice, slice]]:
    """Yield the cells of a coarse grid that hold nothing but air."""
    height, width = (max(side // AIR_CELLS, 1) for side in air.shape)
    for row in range(0, air.shape[0] - height + 1, height):
        for column in range(0, air.shape[1] - width + 1, width):
            cell = slice(row, row + height), slice(column, column + width)
            if air[cell].mean() > 0.9:
                yield cell


def _air(view: XRayView, cell: tuple[slice, slice], air: Mask) -> Reading:
    values = view.transmission[cell][air[cell]].astype(np.float64)
    middle = tuple((side.start + side.stop) // 2 for side in cell)
    pixel = int(np.ravel_multi_index(middle, air.shape))
    mean, region = float(values.mean()), np.array([pixel])
    return Reading(-1, -1, 0.0, pixel, region, mean, _sd_of_mean(values))


def _sd_of_mean(values: Float[np.ndarray, "n"]) -> float:
    return float(values.std(ddof=1)) / float(np.sqrt(len(values)))

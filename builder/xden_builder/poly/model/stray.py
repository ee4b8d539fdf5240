"""Light that does not come straight from the source: scatter and glare."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float64, Int64
from scipy.ndimage import gaussian_filter, map_coordinates

from xden1k.rays import PathLengths
from xden1k.values.arrays import Vec3
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.poly.model import kernels
from xden_builder.poly.model.beam import ViewBeam
from xden_builder.poly.model.frames import binned

__all__ = [
    "GLARE",
    "NO_STRAY",
    "SCATTERS",
    "WIDTHS",
    "StrayShapes",
    "coarse_binning",
    "glare_of",
    "interpolated",
    "middle_of",
    "pitches_cm",
    "scatter_reaches_cm",
    "spread_by_glare",
    "stray_image",
    "stray_light",
]

Values = Float64[np.ndarray, "rows columns"]

REACHES: Final = (0.1, 0.3)
"""Standard deviations on the panel of the two Gaussians that scatter is made of, near and far, for
each centimetre between object and panel: assumed."""
SCATTERS: Final = len(REACHES)
WIDTHS: Final = np.array([-0.5, 0.0, 0.5])
"""Logarithms of the widths that shapes are computed for, over those assumed; between them they are
interpolated."""
GLARE_CM: Final = 1.0
"""Standard deviation of the light's far spread in the scintillator: assumed."""
GLARE: Final = (0.03, 0.02, 0.0, 0.1)
"""Mean, standard deviation, least and most of the share of the light that spreads so: assumed."""
NO_STRAY: Final = (0.0, 1e-6, 0.0, 1e-6)
"""The same of light that is left out."""
COARSE_PX: Final = 128
"""Stray light is smooth: about so many pixels along a side show all of it."""
USUAL_GAP_CM: Final = 20.0
"""Where a parallel beam tells no distance."""
GAPS_CM: Final = (5.0, 60.0)
"""What is nearer to the panel or farther away is reckoned to be so far from it."""
FADED_SDS: Final = 6.0
"""Standard deviations from which on nothing is left of a Gaussian."""


@dataclass(frozen=True, slots=True, eq=False)
class StrayShapes:
    """Shapes of stray light at some pixels, those of scatter for several widths.

    Parameters
    ----------
    each
        Near scatter for each of :data:`WIDTHS`, far scatter likewise, then glare.
    """

    each: Float64[np.ndarray, "n 7"]

    def at(self, widths: Float64[np.ndarray, "2"]) -> Float64[np.ndarray, "n 3"]:
        """Near scatter, far scatter and glare, where these are the logarithms of the widths."""
        return np.column_stack([self._scatter(map(interpolated, widths)), self.each[:, -1:]])

    def slopes(self, widths: Float64[np.ndarray, "2"]) -> Float64[np.ndarray, "n 2"]:
        """Derive near and far scatter by those logarithms."""
        return self._scatter(map(interpolated_slope, widths))

    def _scatter(
        self, shares: Iterable[Float64[np.ndarray, "widths"]]
    ) -> Float64[np.ndarray, "n 2"]:
        kinds = np.split(self.each[:, :-1], SCATTERS, axis=1)
        return np.column_stack([kind @ each for kind, each in zip(kinds, shares, strict=True)])


def interpolated(width: float) -> Float64[np.ndarray, "widths"]:
    """Shares of the shapes for :data:`WIDTHS` that make one between them, by a parabola.

    Parameters
    ----------
    width
        Logarithm of the width over that assumed.

    Examples
    --------
    >>> interpolated(0.5).tolist(), interpolated(0.25).tolist()
    ([0.0, 0.0, 1.0], [-0.125, 0.75, 0.375])
    """
    place = width / WIDTHS[-1]
    return np.array([place * (place - 1) / 2, 1 - place**2, place * (place + 1) / 2])


def interpolated_slope(width: float) -> Float64[np.ndarray, "widths"]:
    """Derive :func:`interpolated` by the width."""
    place = width / WIDTHS[-1]
    return np.asarray(np.array([place - 0.5, -2 * place, place + 0.5]) / WIDTHS[-1])


def middle_of(meshes: Sequence[trimesh.Trimesh]) -> Vec3:
    """Return the middle of the box around an object's meshes."""
    low = np.min([mesh.bounds[0] for mesh in meshes], axis=0)
    high = np.max([mesh.bounds[1] for mesh in meshes], axis=0)
    return np.asarray((low + high) / 2)


def scatter_reaches_cm(geometry: ViewGeometry, middle_cm: Vec3) -> tuple[float, float]:
    """Return the assumed standard deviations on the panel of near and far scatter.

    They grow with the gap: what is scattered by an angle t arrives as far away as tan t times it.
    Of a parallel beam only the panel's place across it is told.

    Parameters
    ----------
    geometry
        Of the view.
    middle_cm
        Of the object.

    Examples
    --------
    >>> steps = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
    >>> panel = np.array([-4.0, 30, -4]), *steps, (8, 8)
    >>> cone = ViewGeometry("cone", *panel, source_cm=np.array([0.0, -90, 0]))
    >>> [round(reach_cm, 2) for reach_cm in scatter_reaches_cm(cone, np.zeros(3))]
    [3.0, 9.0]
    """
    gap_cm = USUAL_GAP_CM
    if geometry.source_cm is not None:
        normal = np.cross(geometry.column_step_cm, geometry.row_step_cm)
        gap_cm = abs(float((middle_cm - geometry.pixel00_cm) @ normal / np.linalg.norm(normal)))
    least_cm, most_cm = GAPS_CM
    near, far = (min(max(gap_cm, least_cm), most_cm) * reach for reach in REACHES)
    return near, far


def coarse_binning(shape: tuple[int, int]) -> int:
    """How many pixels along each side are averaged where only smooth light matters.

    Examples
    --------
    >>> coarse_binning((512, 512)), coarse_binning((96, 96))
    (4, 1)
    """
    return max(min(shape) // COARSE_PX, 1)


def glare_of(view: XRayView, shape: tuple[int, int]) -> Values:
    """Return the light of a view as it spreads in the scintillator, on a coarse panel.

    Parameters
    ----------
    view
        The radiograph.
    shape
        Rows and columns of the coarse panel, by :func:`coarse_binning`.
    """
    binning = view.transmission.shape[0] // shape[0]
    light = binned(view, binning)[0].astype(np.float64)
    return spread_by_glare(light, pitches_cm(view, binning))


def spread_by_glare(light: Values, pitches_cm: tuple[float, float]) -> Values:
    """Spread an image as light does in the scintillator; beyond its rims it is as at them.

    Parameters
    ----------
    light
        Of any binning.
    pitches_cm
        From row to row, and from column to column.
    """
    along_rows, along_columns = pitches_cm
    sds_px = (GLARE_CM / along_rows, GLARE_CM / along_columns)
    return np.asarray(gaussian_filter(light, sds_px, mode="nearest"))


def stray_light(
    view: XRayView,
    beam: ViewBeam,
    lengths: PathLengths,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    scattering_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    pixels: Int64[np.ndarray, "n"],
    measured: Float64[np.ndarray, "n"],
    reaches_cm: Sequence[float],
    glare: Values | None = None,
) -> Float64[np.ndarray, "n shapes"]:
    """Shapes of scatter and glare at some pixels, in shares of the open field.

    Scatter: the signal that the beam loses by coherent and incoherent scattering and nothing
    else, spread by Gaussians (Ohnesorge, Flohr and Klingenbeck-Regn 1999,
    doi:10.1007/s003300050710). Glare: the image spread by a Gaussian, less the image.

    Parameters
    ----------
    view
        The radiograph.
    beam
        Of its panel.
    lengths
        Of the coarse panel, by :func:`coarse_binning`.
    mac_cm2_g, scattering_cm2_g
        Of each part in each energy group: attenuation, and the scattering part of it.
    density_g_cm3
        Of each part.
    pixels
        Flat indices into the radiograph.
    measured
        Transmission there, which glare takes away from.
    reaches_cm
        Standard deviations of the Gaussians that spread scatter: a shape for each.
    glare
        Of the view, by :func:`glare_of`; None where that was not called.
    """
    shapes = _shapes(
        view, beam, lengths, mac_cm2_g, scattering_cm2_g, density_g_cm3, reaches_cm, glare
    )
    binning = view.transmission.shape[0] // lengths.shape[0]
    index = np.stack(np.divmod(pixels, view.transmission.shape[1]))
    places = (index - (binning - 1) / 2) / binning
    found = [map_coordinates(shape, places, order=1, mode="nearest") for shape in shapes]
    return np.stack([*found[:-1], found[-1] - measured], axis=1)


def stray_image(
    view: XRayView,
    beam: ViewBeam,
    lengths: PathLengths,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    scattering_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    amplitudes: Float64[np.ndarray, "3"],
    reaches_cm: Sequence[float],
    glare: Values | None = None,
) -> Float64[np.ndarray, "_rows _columns"]:
    """Stray light of a whole view: the shapes of :func:`stray_light` times their amplitudes.

    Parameters
    ----------
    view, beam, lengths, mac_cm2_g, scattering_cm2_g, density_g_cm3, reaches_cm, glare
        As of :func:`stray_light`.
    amplitudes
        Of near scatter, far scatter and glare.
    """
    shapes = _shapes(
        view, beam, lengths, mac_cm2_g, scattering_cm2_g, density_g_cm3, reaches_cm, glare
    )
    whole = sum(share * shape for share, shape in zip(amplitudes.tolist(), shapes, strict=True))
    binning = view.transmission.shape[0] // lengths.shape[0]
    smooth = whole
    for size in view.transmission.shape:  # along rows, then along columns
        smooth = _enlarged(smooth, binning, size).T
    return np.asarray(smooth - amplitudes[2] * np.where(view.valid, view.transmission, 1.0))


def _shapes(
    view: XRayView,
    beam: ViewBeam,
    lengths: PathLengths,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    scattering_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    reaches_cm: Sequence[float],
    glare: Values | None,
) -> list[Values]:
    """Shapes of scatter, one for each reach, and of glare, on the coarse panel."""
    binning = view.transmission.shape[0] // lengths.shape[0]
    source = np.empty(len(lengths.pixels))
    kernels.scattered(
        lengths.lengths_cm,
        mac_cm2_g,
        scattering_cm2_g,
        density_g_cm3,
        beam.weights(lengths.pixels, binning),
        source,
    )
    scattered = np.zeros(lengths.shape)
    scattered.flat[lengths.pixels] = source
    scatter = _spread(scattered, reaches_cm, pitches_cm(view, binning))
    return [*scatter, glare_of(view, lengths.shape) if glare is None else glare]


def _spread(
    values: Values, sds_cm: Sequence[float], pitches_cm: tuple[float, float]
) -> list[Values]:
    """Spread an image with nothing around it by several Gaussians: along columns, then rows."""
    (rows, columns), (down, along) = values.shape, pitches_cm
    return [_gaussian(rows, sd / down) @ values @ _gaussian(columns, sd / along) for sd in sds_cm]


def _gaussian(size: int, sd_px: float) -> Values:
    """Weights of pixels in a row by how far they are apart; those of an endless row add up to 1."""
    reach = max(size, math.ceil(FADED_SDS * sd_px))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sd_px) ** 2)
    places = np.arange(size)
    return np.asarray((weights / weights.sum())[reach + places[:, None] - places])


def pitches_cm(view: XRayView, binning: int) -> tuple[float, float]:
    """Return how far rows, and how far columns, of a binned image are apart on the panel."""
    steps = view.geometry.row_step_cm, view.geometry.column_step_cm
    down, along = (binning * float(np.linalg.norm(step)) for step in steps)
    return down, along


def _enlarged(values: Values, binning: int, size: int) -> Float64[np.ndarray, "_size _columns"]:
    """Interpolate between rows that are means of so many, those beyond the ends as at them."""
    places = ((np.arange(size) - (binning - 1) / 2) / binning).clip(0, len(values) - 1)
    below = places.astype(np.int64)
    above, share = np.minimum(below + 1, len(values) - 1), (places - below)[:, None]
    return np.asarray((1 - share) * values[below] + share * values[above])

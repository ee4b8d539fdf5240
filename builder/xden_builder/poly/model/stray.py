"""Light that does not come straight from the source: scatter and glare."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Float64, Int64
from scipy.ndimage import gaussian_filter, map_coordinates

from xden1k.rays import PathLengths
from xden1k.values.views import XRayView
from xden_builder.poly.model import kernels
from xden_builder.poly.model.beam import ViewBeam
from xden_builder.poly.model.frames import binned

__all__ = [
    "FAR_CM",
    "GLARE",
    "NEAR_CM",
    "NO_STRAY",
    "coarse_binning",
    "glare_of",
    "spread_by_glare",
    "stray_image",
    "stray_light",
]

Values = Float64[np.ndarray, "rows columns"]

NEAR_CM: Final = 2.0
FAR_CM: Final = 6.0
"""Standard deviations on the panel of the two Gaussians that scatter is made of: assumed."""
GLARE_CM: Final = 1.0
"""Standard deviation of the light's far spread in the scintillator: assumed."""
GLARE: Final = (0.03, 0.02, 0.0, 0.1)
"""Mean, standard deviation, least and most of the share of the light that spreads so: assumed."""
NO_STRAY: Final = (0.0, 1e-6, 0.0, 1e-6)
"""The same of light that is left out."""
COARSE_PX: Final = 128
"""Stray light is smooth: about so many pixels along a side show all of it."""


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
    return spread_by_glare(light, _pixel_cm(view, binning))


def spread_by_glare(light: Values, pixel_cm: float) -> Values:
    """Spread an image as light does in the scintillator; beyond its rims it is as at them."""
    return np.asarray(gaussian_filter(light, GLARE_CM / pixel_cm, mode="nearest"))


def stray_light(
    view: XRayView,
    beam: ViewBeam,
    lengths: PathLengths,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    scattering_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    pixels: Int64[np.ndarray, "n"],
    measured: Float64[np.ndarray, "n"],
    glare: Values | None = None,
    reaches_cm: Sequence[float] = (NEAR_CM, FAR_CM),
) -> Float64[np.ndarray, "n shapes"]:
    """Shapes of near scatter, far scatter and glare at some pixels, in shares of the open field.

    Scatter: the signal that the beam loses by coherent and incoherent scattering and nothing
    else, spread by two Gaussians (Ohnesorge, Flohr and Klingenbeck-Regn 1999,
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
    glare
        Of the view, by :func:`glare_of`; None where that was not called.
    reaches_cm
        Standard deviations of the Gaussians that spread scatter: a shape for each.
    """
    shapes = _shapes(
        view, beam, lengths, mac_cm2_g, scattering_cm2_g, density_g_cm3, glare, reaches_cm
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
    glare: Values | None = None,
) -> Float64[np.ndarray, "_rows _columns"]:
    """Stray light of a whole view: the shapes of :func:`stray_light` times their amplitudes.

    Parameters
    ----------
    view, beam, lengths, mac_cm2_g, scattering_cm2_g, density_g_cm3, glare
        As of :func:`stray_light`.
    amplitudes
        Of near scatter, far scatter and glare.
    """
    shapes = _shapes(view, beam, lengths, mac_cm2_g, scattering_cm2_g, density_g_cm3, glare)
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
    glare: Values | None,
    reaches_cm: Sequence[float] = (NEAR_CM, FAR_CM),
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
    scatter = [
        gaussian_filter(scattered, reach_cm / _pixel_cm(view, binning), mode="constant")
        for reach_cm in reaches_cm
    ]
    return [*scatter, glare_of(view, lengths.shape) if glare is None else glare]


def _pixel_cm(view: XRayView, binning: int) -> float:
    return binning * float(np.linalg.norm(view.geometry.column_step_cm))


def _enlarged(values: Values, binning: int, size: int) -> Float64[np.ndarray, "_size _columns"]:
    """Interpolate between rows that are means of so many, those beyond the ends as at them."""
    places = ((np.arange(size) - (binning - 1) / 2) / binning).clip(0, len(values) - 1)
    below = places.astype(np.int64)
    above, share = np.minimum(below + 1, len(values) - 1), (places - below)[:, None]
    return np.asarray((1 - share) * values[below] + share * values[above])

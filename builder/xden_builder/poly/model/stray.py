"""Light that does not come straight from the source: scatter and glare."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Float64, Int64
from scipy.ndimage import gaussian_filter, map_coordinates

from xden1k.rays import PathLengths
from xden1k.values.views import XRayView
from xden_builder.poly.model import kernels
from xden_builder.poly.model.beam import ViewBeam
from xden_builder.poly.model.frames import binned

__all__ = ["coarse_binning", "stray_light"]

NEAR_CM: Final = 2.0
FAR_CM: Final = 6.0
"""Standard deviations on the panel of the two Gaussians that scatter is made of: assumed."""
GLARE_CM: Final = 1.0
"""Standard deviation of the light's far spread in the scintillator: assumed."""
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


def stray_light(
    view: XRayView,
    beam: ViewBeam,
    lengths: PathLengths,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    scattering_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    pixels: Int64[np.ndarray, "n"],
    measured: Float64[np.ndarray, "n"],
) -> Float64[np.ndarray, "n 3"]:
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
    """
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
    light = binned(view, binning)[0].astype(np.float64)
    pixel_cm = binning * float(np.linalg.norm(view.geometry.column_step_cm))
    shapes = (
        gaussian_filter(scattered, NEAR_CM / pixel_cm, mode="constant"),
        gaussian_filter(scattered, FAR_CM / pixel_cm, mode="constant"),
        gaussian_filter(light, GLARE_CM / pixel_cm, mode="nearest"),
    )
    index = np.stack(np.divmod(pixels, view.transmission.shape[1]))
    places = (index - (binning - 1) / 2) / binning
    found = [map_coordinates(shape, places, order=1, mode="nearest") for shape in shapes]
    return np.stack([*found[:2], found[2] - measured], axis=1)

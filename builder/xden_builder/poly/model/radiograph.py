"""The model of a whole radiograph: direct beam, stray light and the gain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.rays import PathLengths
from xden1k.values.arrays import Image
from xden1k.values.views import XRayView
from xden_builder.capture.saturation import GainBounds
from xden_builder.poly.model.beam import ViewBeam
from xden_builder.poly.model.direct import transmissions
from xden_builder.poly.model.stray import stray_image

__all__ = ["GAIN", "TERMS", "WIDTH_TERMS", "gain_prior", "model_image"]

TERMS = ("gain", "near_scatter", "far_scatter", "glare")
"""What a view has of its own, in the order of the unknowns."""
WIDTH_TERMS = ("near_scatter_cm", "far_scatter_cm")
"""Standard deviations on the panel of what spreads there."""
GAIN: Final = (1.0, 0.05)
"""Mean and standard deviation of the gain of a view."""
TOLD_GAIN_SD: Final = 0.003
"""Of a gain that little air tells, far from the object."""
UNTOLD_GAIN_SD: Final = 0.2
"""Of a gain that no air tells but from below: how far it may be above."""


def gain_prior(bounds: GainBounds | None) -> tuple[float, float]:
    """Return mean and standard deviation of a view's gain.

    Parameters
    ----------
    bounds
        Of a view whose air is saturated, by :func:`xden_builder.capture.saturation.gain_bounds`.
    """
    if bounds is None:
        return GAIN
    low, high = bounds
    return (low, TOLD_GAIN_SD) if low == high else (max(GAIN[0], low), UNTOLD_GAIN_SD)


def model_image(
    view: XRayView,
    beam: ViewBeam,
    lengths: PathLengths,
    smooth: PathLengths,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    scattering_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    nuisances: Float64[np.ndarray, "4"],
    reaches_cm: Sequence[float],
    glare: Float64[np.ndarray, "coarse_rows coarse_columns"] | None = None,
) -> Image:
    """Compute direct beam and stray light of a view, with the gain, shape (rows, columns).

    Parameters
    ----------
    view, beam
        The radiograph, which glare is made of, and what reaches its panel.
    lengths, smooth
        Of its pixels, and of the coarse panel.
    mac_cm2_g, scattering_cm2_g, density_g_cm3
        Of the parts.
    nuisances
        By :data:`TERMS`.
    reaches_cm
        Standard deviations of near and far scatter on the panel.
    glare
        Of the view, by :func:`xden_builder.poly.model.stray.glare_of`; None where that was not
        called.
    """
    stray = stray_image(
        view,
        beam,
        smooth,
        mac_cm2_g,
        scattering_cm2_g,
        density_g_cm3,
        nuisances[1:],
        reaches_cm,
        glare,
    )
    light = (stray + 1.0).ravel()
    weights = beam.weights(lengths.pixels)
    direct = transmissions(lengths.lengths_cm, weights, mac_cm2_g, density_g_cm3)
    light[lengths.pixels] += direct - 1.0
    image = nuisances[0] * light.reshape(view.transmission.shape)
    return np.asarray(image, dtype=np.float32)

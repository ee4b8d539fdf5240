"""Variances of pixels, and the weights that follow from them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from xden_builder.fit.crops import Crop, neighbours
from xden_builder.fit.observed import ViewData
from xden_builder.fit.problem import Weighting
from xden_builder.fit.values import FitSettings

__all__ = ["edge_steps", "uniform", "variances", "weights_of"]

Pixels = Float64[np.ndarray, "n"]


def variances(
    view: ViewData, transmission: Pixels, gain: float, settings: FitSettings
) -> tuple[Pixels, float]:
    """Variance of each pixel about the model, and of a pixel of air.

    With the weights ``edge`` it is noise + model error² + (edge error * edge step)²; with
    ``none`` noise alone.
    """
    noise, air = view.noise_variance(gain * transmission), view.noise_variance(np.ones(1))
    if settings.weights == "none":
        return noise, float(air[0])
    blur = settings.edge_error_px * gain * edge_steps(view, transmission)
    return noise + settings.model_error**2 + blur**2, float(air[0]) + settings.model_error**2


def edge_steps(view: ViewData, transmission: Pixels) -> Pixels:
    """Largest difference to one of the four neighbours, in the model's image."""
    pixels = view.lengths.pixels
    if not len(pixels):
        return np.zeros(0)
    crop = Crop.around(pixels, view.lengths.shape, margin_px=1)
    image = crop.image(transmission, background=1.0)
    return np.asarray(np.abs(neighbours(image) - image).max(axis=0)[crop.rows, crop.columns])


def weights_of(view: ViewData, variance: tuple[Pixels, float]) -> tuple[Pixels, float]:
    """Inverse variances; 0 where a pixel is not usable."""
    return np.where(view.usable, 1 / variance[0], 0.0), 1 / variance[1]


def uniform(views: tuple[ViewData, ...]) -> Weighting:
    """Weight 1 for every usable pixel."""
    return [(view.usable.astype(np.float64), 1.0) for view in views]

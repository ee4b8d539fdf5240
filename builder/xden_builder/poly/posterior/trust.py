"""How far each sample is trusted."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64

from xden1k.rays import PathLengths
from xden_builder.fit.crops import Crop, neighbours
from xden_builder.poly.model.beam import ViewBeam
from xden_builder.poly.model.direct import transmissions
from xden_builder.poly.model.pixels import ViewPixels, block_width
from xden_builder.poly.model.stray import SCATTERS, StrayShapes
from xden_builder.poly.settings import PolySettings

__all__ = ["USUAL_VEIL", "Veil", "sample_sd"]


class Veil(NamedTuple):
    """Near and far scatter of a view.

    Parameters
    ----------
    amplitudes
        Of both.
    widths
        Logarithms of their widths over those assumed.
    """

    amplitudes: Float64[np.ndarray, "2"]
    widths: Float64[np.ndarray, "2"]


USUAL_VEIL: Final = Veil(np.full(2, 0.08), np.zeros(2))
"""Before the fit; the scatter's error is reckoned with these amplitudes at least."""
CLEAR: Final = 0.1
"""Transmission above which much light comes through: labelled parts that say how far a folder errs
are hardly seen in anything darker."""


def sample_sd(
    samples: ViewPixels,
    lengths: PathLengths,
    blocks: PathLengths,
    beam: ViewBeam,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    stray: StrayShapes,
    veil: Veil,
    noise_sd: float,
    settings: PolySettings,
) -> Float64[np.ndarray, "n"]:
    """Estimate the standard deviation of each sample about the model, shape (n,).

    Four errors, independent of each other: edges that are off, times the steepest step to a
    neighbour; coefficients, spectrum and scale that are off, in proportion to -T ln T; stray light
    of another shape; and a floor, with the noise.

    Parameters
    ----------
    samples
        Of one view.
    lengths, blocks
        What they were chosen from.
    beam
        Of the panel.
    mac_cm2_g, density_g_cm3
        The model's.
    stray
        Shapes of the stray light, by :func:`xden_builder.poly.model.stray.stray_light`.
    veil
        Scatter as it is thought to be: its error is in proportion to it.
    noise_sd
        Of a pixel behind something opaque. Blocks are given as much, though they are means: in a
        scintillator neighbours share their noise.
    settings
        Sizes of the errors.
    """
    transmission, step = np.ones(len(samples.pixels)), np.zeros(len(samples.pixels))
    width = block_width(lengths, blocks)
    for source, binning, mine in (
        (lengths, 1, ~samples.is_block),
        (blocks, width, samples.is_block),
    ):
        near = _beside(samples.index[mine], source.shape)[source.pixels]
        pixels, lengths_cm = source.pixels[near], source.lengths_cm[near]
        weights = beam.weights(pixels, binning)
        model = transmissions(lengths_cm, weights, mac_cm2_g, density_g_cm3)
        image, steps = _steps(pixels, source.shape, model)
        transmission[mine] = image.flat[samples.index[mine]]
        step[mine] = steps.flat[samples.index[mine]]
    pixel_cm = float(np.linalg.norm(beam.geometry.column_step_cm))
    reach_cm = pixel_cm * np.where(samples.is_block, width, 1)
    edge = settings.edge_error_cm / reach_cm * step if settings.edge_weights else 0.0
    times = settings.image_errors
    model = -times * settings.model_share * transmission * np.log(transmission.clip(min=1e-4))
    scatter = stray.at(veil.widths)[:, :SCATTERS]
    scatter_sd = (
        times
        * settings.stray_share
        * (scatter @ np.maximum(veil.amplitudes, USUAL_VEIL.amplitudes))
    )
    floor = np.where(transmission > CLEAR, times * settings.clear_floor, settings.floor)
    return np.asarray(np.sqrt(edge**2 + model**2 + scatter_sd**2 + floor**2 + noise_sd**2))


def _beside(index: Int64[np.ndarray, "n"], shape: tuple[int, int]) -> Bool[np.ndarray, "pixels"]:
    """Mark some pixels and their neighbours: all that their steps depend on."""
    marked = np.zeros(shape, dtype=np.bool_)
    marked.flat[index] = True
    return np.asarray(marked | neighbours(marked).any(axis=0)).ravel()


def _steps(
    pixels: Int64[np.ndarray, "n"], shape: tuple[int, int], transmission: Float64[np.ndarray, "n"]
) -> tuple[Float64[np.ndarray, "rows columns"], Float64[np.ndarray, "rows columns"]]:
    """Put the model into an image, and find the largest step of each pixel to a neighbour."""
    image, steps = np.ones(shape), np.zeros(shape)
    if len(transmission):
        image.flat[pixels] = transmission
        box = Crop.around(pixels, shape, margin_px=1).box
        steps[box] = np.abs(neighbours(image[box]) - image[box]).max(axis=0)
    return image, steps

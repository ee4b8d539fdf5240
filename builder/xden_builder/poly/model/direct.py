"""The direct beam behind some path lengths, and how it changes with the densities."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from xden1k.rays import PathLengths
from xden_builder.poly.model import kernels
from xden_builder.poly.model.beam import ViewBeam

__all__ = ["transmissions", "transmissions_and_slopes"]


def transmissions(
    lengths: PathLengths,
    beam: ViewBeam,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    binning: int = 1,
) -> Float64[np.ndarray, "n"]:
    """Transmission of the direct beam in every pixel of some path lengths, shape (n,).

    Parameters
    ----------
    lengths
        Of a view, or of blocks of its pixels.
    beam
        Of the panel.
    mac_cm2_g, density_g_cm3
        Of the parts.
    binning
        Pixels along each side of a block.
    """
    none = np.empty((0, len(density_g_cm3)))
    return _predicted(lengths, beam, mac_cm2_g, density_g_cm3, binning, none)


def transmissions_and_slopes(
    lengths: PathLengths,
    beam: ViewBeam,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    binning: int = 1,
) -> tuple[Float64[np.ndarray, "n"], Float64[np.ndarray, "n k"]]:
    """Give the same, and its derivatives by the densities, shape (n, K)."""
    slopes = np.empty((len(lengths.pixels), len(density_g_cm3)))
    return _predicted(lengths, beam, mac_cm2_g, density_g_cm3, binning, slopes), slopes


def _predicted(
    lengths: PathLengths,
    beam: ViewBeam,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    binning: int,
    slopes: Float64[np.ndarray, "m k"],
) -> Float64[np.ndarray, "n"]:
    """Run the kernel, which writes the slopes if there is room for any."""
    count, rays, _ = lengths.lengths_cm.shape
    transmission = np.empty(count)
    kernels.predict(
        lengths.lengths_cm,
        np.full(count, rays),
        mac_cm2_g,
        density_g_cm3,
        beam.weights(lengths.pixels, binning),
        transmission,
        slopes,
    )
    return transmission

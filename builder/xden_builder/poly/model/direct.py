"""The direct beam behind some path lengths, and how it changes with the densities."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Float64

from xden_builder.poly.model import kernels

__all__ = ["transmissions", "transmissions_and_slopes"]


def transmissions(
    lengths_cm: Float32[np.ndarray, "n s k"],
    weights: Float64[np.ndarray, "n groups"],
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
) -> Float64[np.ndarray, "n"]:
    """Transmission of the direct beam in some pixels, shape (n,).

    Parameters
    ----------
    lengths_cm
        Shape (n, s, K): way of each of the s rays of a pixel through each part.
    weights
        Shape (n, groups): shares of the energy groups in the open field of each pixel.
    mac_cm2_g, density_g_cm3
        Of the parts.
    """
    none = np.empty((0, len(density_g_cm3)))
    return _predicted(lengths_cm, weights, mac_cm2_g, density_g_cm3, none)


def transmissions_and_slopes(
    lengths_cm: Float32[np.ndarray, "n s k"],
    weights: Float64[np.ndarray, "n groups"],
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
) -> tuple[Float64[np.ndarray, "n"], Float64[np.ndarray, "n k"]]:
    """Give the same, and its derivatives by the densities, shape (n, K)."""
    slopes = np.empty((len(lengths_cm), len(density_g_cm3)))
    return _predicted(lengths_cm, weights, mac_cm2_g, density_g_cm3, slopes), slopes


def _predicted(
    lengths_cm: Float32[np.ndarray, "n s k"],
    weights: Float64[np.ndarray, "n groups"],
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    slopes: Float64[np.ndarray, "m k"],
) -> Float64[np.ndarray, "n"]:
    """Run the kernel, which writes the slopes if there is room for any."""
    count, rays, _ = lengths_cm.shape
    transmission = np.empty(count)
    every = np.full(count, rays)
    kernels.predict(lengths_cm, every, mac_cm2_g, density_g_cm3, weights, transmission, slopes)
    return transmission

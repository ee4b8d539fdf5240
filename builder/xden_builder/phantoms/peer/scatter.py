"""Scattered light: one Compton collision, seen from the panel, times what further ones add.

A photon scattered in the middle of the object at the angle t reaches the panel at the distance
r = g tan t from where it would have gone, g being the gap between them; Klein and Nishina (1929,
doi:10.1007/BF01366453) say how likely that is. How much is scattered is what the direct beam does
at each pixel: transmitted share times Compton's part of its attenuation. Energy lost in the
collision and coherent scatter are left to the factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.signal import fftconvolve

from xden1k.values.arrays import Image
from xden_builder.phantoms.peer.matter import xraylib

__all__ = ["Scatter", "draw_scatter", "single_scatter"]


@dataclass(frozen=True, slots=True)
class Scatter:
    """What an object adds to single scatter.

    Parameters
    ----------
    factor
        On single scatter: further collisions.
    floor
        Light from elsewhere, as a share of the open field.
    """

    factor: float
    floor: float


def draw_scatter(rng: np.random.Generator, factor: float | None = None) -> Scatter:
    """Draw a factor of 1.2 to 2, if none is given, and a floor of up to 0.5 %."""
    drawn, floor = rng.uniform(1.2, 2.0), rng.uniform(0.0, 0.005)
    return Scatter(drawn if factor is None else factor, floor)


def single_scatter(
    scattered: Image, pitch_cm: float, gap_cm: float, energy_kev: float
) -> Float[np.ndarray, "rows columns"]:
    """Light scattered once, per pixel, in the units of its cause.

    Parameters
    ----------
    scattered
        Shape (n, n): light that is scattered on the way to each pixel.
    pitch_cm, gap_cm
        Of the pixels, and from the object to the panel.
    energy_kev
        That stands for the beam.
    """
    offsets = np.arange(1 - len(scattered), len(scattered)) * pitch_cm
    across = np.hypot(offsets[:, None], offsets)
    angles = np.arctan(across / gap_cm)
    kernel = pitch_cm**2 * _share_per_sr(energy_kev, angles) * np.cos(angles) ** 3 / gap_cm**2
    return np.asarray(fftconvolve(scattered, kernel, mode="same").clip(min=0.0))


def _share_per_sr(energy_kev: float, angles: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """Share of Compton-scattered photons that go into a steradian at each angle."""
    lib = xraylib()
    known = np.linspace(0.0, np.pi / 2, 91)
    shares = [lib.DCS_KN(energy_kev, angle) / lib.CS_KN(energy_kev) for angle in known]
    return np.asarray(np.interp(angles, known, shares))

"""What attenuation the paper's fit finds in a part of a material, behind an effective beam.

The paper fits one coefficient to each part, by least squares of transmission (Eq. 7), to
radiographs of a 100 kV tube. A strong absorber hardens the beam, and its darkest pixels show
stray light; the fit, which knows of neither, finds less than any tabulated coefficient. Both are
simulated here, over the ways that the rays take through this very part.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.values.materials import load_materials
from xden_builder.physics.source import Tube
from xden_builder.physics.spectrum import tube_spectrum
from xden_builder.published.hypotheses import Hypotheses

__all__ = ["Beam", "PartRays", "fitted_depth"]

TUBE_KV: Final = 100.0
"""Voltage of the paper's scanner."""
GROUPS: Final = 24
AREAL_G_CM2: Final = np.geomspace(1e-4, 400.0, 220)
"""Areal densities at which transmission is tabulated."""
DEPTHS: Final = np.geomspace(1e-4, 30.0, 160)
"""Coefficients that are tried, times the mean way."""
LEAST: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Beam:
    """Effective beam of a release.

    Parameters
    ----------
    filter_mm_al
        Aluminium that hardens a bare tungsten tube's spectrum as much as all filters together.
    stray
        Stray light as a share of the open field.
    knee
        Depth, coefficient times way, beyond which the fit finds ever less of what is 1 cm wide; see
        :func:`xden_builder.published.likelihood.reached`.
    spread
        How much wider than a light part's a strong absorber's coefficient scatters; see
        :func:`xden_builder.published.likelihood.log_sd`.
    axes
        Axes of the volume along which the radiographs were taken.
    """

    filter_mm_al: float
    stray: float
    knee: float
    spread: float
    axes: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class PartRays:
    """Rays through one part.

    Parameters
    ----------
    paths_cm
        Shape (rays,): way through it.
    others
        Shape (rays,): transmission of all else on the way, by the published coefficients.
    weights
        Shape (rays,): how many rays each stands for.
    volume_cm3
        Of the part.
    narrow_cm
        Width of its shadow where it is narrowest, over the radiographs: so far off a mesh misses
        it.
    """

    paths_cm: Float64[np.ndarray, "rays"]
    others: Float64[np.ndarray, "rays"]
    weights: Float64[np.ndarray, "rays"]
    volume_cm3: float
    narrow_cm: float

    @property
    def mean_cm(self) -> float:
        """Mean way."""
        return float(np.average(self.paths_cm, weights=self.weights))

    @property
    def clear(self) -> float:
        """Mean transmission of all else."""
        return max(float(np.average(self.others, weights=self.weights)), LEAST)


@lru_cache(maxsize=64)
def _transmissions(names: tuple[str, ...], filter_mm_al: float) -> Float64[np.ndarray, "names q"]:
    """Transmission of each material at :data:`AREAL_G_CM2`."""
    from xden_builder.physics.attenuation import mac_cm2_g

    spectrum = tube_spectrum(Tube(kv=TUBE_KV, filtration_cm={"Al": filter_mm_al / 10}))
    weights = spectrum.grouped(GROUPS).weights
    library = load_materials()
    mac = np.stack(
        [
            spectrum.group_means(
                mac_cm2_g(library[name].composition, spectrum.energies_kev), GROUPS
            )
            for name in names
        ]
    )
    return np.stack([np.exp(-np.outer(AREAL_G_CM2, each)) @ weights for each in mac])


@lru_cache(maxsize=64)
def fitted_depth(
    rays: PartRays, tried: Hypotheses, filter_mm_al: float, stray: float
) -> Float64[np.ndarray, "h"]:
    """Coefficient that a perfect fit finds, times the mean way, for each hypothesis.

    Kept for the last parts, since beams that differ in knee and spread alone share it; not to be
    written to.
    """
    table = _transmissions(tried.names, filter_mm_al)
    areal = np.log(tried.density_g_cm3[:, None] * rays.paths_cm)
    low, step = np.log(AREAL_G_CM2[0]), np.log(AREAL_G_CM2[1] / AREAL_G_CM2[0])
    place = ((areal - low) / step).clip(0, len(AREAL_G_CM2) - 1.001)
    below = place.astype(np.int64)
    share = place - below
    rows = tried.material[:, None]
    through = (1 - share) * table[rows, below] + share * table[rows, below + 1]
    seen = (rays.others - stray).clip(LEAST) * through + np.minimum(stray, rays.others)
    model = rays.others * np.exp(-DEPTHS[:, None] * rays.paths_cm / rays.mean_cm)
    loss = (model**2) @ rays.weights - 2 * (seen * rays.weights) @ model.T
    depth = np.asarray(np.exp(_lowest(np.log(DEPTHS), loss)))
    depth.flags.writeable = False
    return depth


def _lowest(
    at: Float64[np.ndarray, "n"], loss: Float64[np.ndarray, "h n"]
) -> Float64[np.ndarray, "h"]:
    """Where each row is lowest, by a parabola through the lowest of equal steps."""
    best = loss.argmin(axis=1).clip(1, len(at) - 2)
    row = np.arange(len(loss))
    left, mid, right = (loss[row, best + step] for step in (-1, 0, 1))
    bend = left - 2 * mid + right
    shift = np.where(bend > 0, (left - right) / np.where(bend > 0, 2 * bend, 1.0), 0.0)
    return np.asarray(at[best] + shift.clip(-1, 1) * (at[1] - at[0]))
